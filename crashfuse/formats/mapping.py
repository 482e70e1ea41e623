"""Which column of a foreign table is what: proposed from headers and units, overruled by the user.

:func:`propose` and :meth:`Mapping.overruled` are pure, so that a page can show the mapping as a step of its own; what
follows from it is read by :mod:`crashfuse.formats.foreign`.
"""

import re
import unicodedata
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from crashfuse.errors import DataError, UsageError
from crashfuse.formats.archive import shown
from crashfuse.formats.sheet import Sheet
from crashfuse.formats.spelling import UNITS, unit_named

ColumnRole = Literal[
    "id",
    "time",
    "acceleration",
    "speed",
    "mass",
    "front_weight",
    "rear_weight",
    "front_share",
    "factor",
    "ignored",
]
"""What a column can be."""

QUANTITIES: dict[str, str] = {
    "time": "time",
    "acceleration": "acceleration",
    "speed": "speed",
    "mass": "mass",
    "front_weight": "mass",
    "rear_weight": "mass",
    "front_share": "share",
}
"""What the columns that have a unit measure."""
_WORDS: dict[ColumnRole, str] = {
    "id": r"id|(test|run) ?(id|nr|no|number|name)?|versuch(s ?(nr|nummer|name))?|lauf|name|nr|no|number|variante|"
    r"simulation|sim|case|record",
    "time": r"t|time|zeit|temps|tiempo|tempo|time.*|zeit.*",
    "acceleration": r"a|ax|a ?x|accx?|acc .*|accel.*|.* accel.*|beschl.*|.* beschl.*|decel.*|verzog.*|puls.*|.* pulse?",
    "speed": r"v|v0|v ?0|speed|.* speed|velocity|.* velocity|geschw.*|.*geschwindigkeit|vitesse.*",
    "front_weight": r".*(front|vorn|vorder).*|.*\b(va|fa)\b.*|wf",
    "rear_weight": r".*(rear|hint).*|.*\b(ha|ra)\b.*|wr",
    "mass": r".*(mass|masse|weight|gewicht).*|m",
}
_WEIGHT = re.compile(r".*(mass|masse|weight|gewicht|load|last|axle|achs).*|wf|wr")
_OTHER_AXIS = re.compile(r".*(^|[ ])(a ?)?[yz]$|acc ?[yz].*|.*\bres(ultant)?\b.*|.*resultier.*|.* [yz] .*")
_FILTER = re.compile(r"\b(raw|roh|cfc ?(\d+))\b")


@dataclass(frozen=True, slots=True)
class ColumnUse:
    """What one column is taken for.

    Parameters
    ----------
    column : str
    role : ColumnRole
    unit : str or None
        A name from :data:`crashfuse.formats.spelling.UNITS`; None where none is known or needed.
    why : str
        A short reason, for people.
    """

    column: str
    role: ColumnRole
    unit: str | None = None
    why: str = ""


@dataclass(frozen=True, slots=True)
class Mapping:
    """What every column of a sheet is taken for, in their order."""

    uses: tuple[ColumnUse, ...]

    def of(self, role: ColumnRole) -> tuple[ColumnUse, ...]:
        """The columns in this role."""
        return tuple(use for use in self.uses if use.role == role)

    @property
    def kind(self) -> Literal["pulses", "conditions", "neither"]:
        """What the sheet holds: pulses if there is a time, else conditions if there is a speed or a weight."""
        if self.of("time") and self.of("acceleration"):
            return "pulses"
        roles: tuple[ColumnRole, ...] = ("speed", "mass", "front_weight", "rear_weight")
        return "conditions" if any(self.of(role) for role in roles) else "neither"

    def overruled(self, column: str, role: ColumnRole, unit: str | None = None) -> "Mapping":
        """Return the mapping with one column used as the user says; its unit stays where it still makes sense.

        Raises
        ------
        UsageError
            If there is no such column, role, or unit.
        """
        if column not in [use.column for use in self.uses]:
            have = ", ".join(shown(use.column, 40) for use in self.uses[:20])
            raise UsageError(f"There is no column {column!r}; there are {have}.")
        if role not in get_args(ColumnRole):
            raise UsageError(f"A column can be {', '.join(get_args(ColumnRole))}, not {role!r}.")
        quantity = QUANTITIES.get(role)
        named = None if unit is None or quantity is None else unit_named(unit, quantity)
        if unit is not None and named is None:
            known = "no unit" if quantity is None else ", ".join(UNITS[quantity])
            raise UsageError(f"A column that is {role} has {known}, not {unit!r}.")

        def changed(use: ColumnUse) -> ColumnUse:
            if use.column != column:
                return use
            kept = use.unit if quantity is not None and use.unit in UNITS[quantity] else None
            return ColumnUse(column, role, named or kept, "chosen by the user")

        return Mapping(tuple(map(changed, self.uses)))


def propose(sheet: Sheet) -> Mapping:
    """Propose what each column is, from its header, its unit, and what else the sheet has.

    Parameters
    ----------
    sheet : Sheet

    Returns
    -------
    Mapping
        Whatever is not recognised is ignored beside a time, and a factor in a table of conditions.
    """
    uses = [_guess(column, unit) for column, unit in zip(sheet.columns, sheet.units, strict=True)]
    times = [use for use in uses if use.role == "time"]
    if not times and (clock := _clock(sheet, uses)) is not None:
        uses = [ColumnUse(u.column, "time", u.unit, "it increases evenly") if u.column == clock else u for u in uses]
        times = [use for use in uses if use.role == "time"]
    if times and not any(use.role == "acceleration" or use.why.startswith("another") for use in uses):
        uses = [
            ColumnUse(u.column, "acceleration", None, "beside the time") if u.role == "ignored" else u for u in uses
        ]
    pulses = bool(times) and any(use.role == "acceleration" for use in uses)
    least_filtered: dict[str, ColumnUse] = {}
    for use in sorted((use for use in uses if use.role == "acceleration"), key=lambda use: _filter_order(use.column)):
        least_filtered.setdefault(_unfiltered(use.column), use)
    settled: list[ColumnUse] = []
    for use in uses:
        if pulses:
            use = _among_pulses(use, times[0], least_filtered)
        elif use.role in ("time", "acceleration") or (use.role == "ignored" and not use.why):
            use = ColumnUse(use.column, "factor", None, "kept with the condition")
        elif use.role in [other.role for other in settled if other.role not in ("ignored", "factor")]:
            use = ColumnUse(use.column, "factor", None, f"another column is the {use.role}")
        settled.append(use)
    if not pulses and not any(use.role == "id" for use in settled) and settled and settled[0].role == "factor":
        settled[0] = ColumnUse(settled[0].column, "id", None, "the first column")
    return Mapping(tuple(settled))


def _guess(column: str, unit_cell: str) -> ColumnUse:
    """What a column is by itself."""
    name, unit = _name_and_unit(column, unit_cell)
    plain = _plain(name)
    why = f"its unit is {unit}" if unit else "its name says so"
    quantity = None if unit is None else next(q for q, units in UNITS.items() if unit in units)
    if quantity == "acceleration" or (unit is None and _is("acceleration", plain)):
        if _OTHER_AXIS.fullmatch(plain):
            return ColumnUse(column, "ignored", unit, "another direction than X")
        return ColumnUse(column, "acceleration", unit, why)
    if quantity == "time" or (unit is None and _is("time", plain)):
        return ColumnUse(column, "time", unit, why)
    if quantity == "speed" or (unit is None and _is("speed", plain)):
        return ColumnUse(column, "speed", unit, why)
    if quantity in ("mass", "share") or _WEIGHT.fullmatch(plain):
        for role in ("front_weight", "rear_weight", "mass"):
            if _is(role, plain):
                if quantity == "share":
                    return ColumnUse(column, "front_share" if role == "front_weight" else "ignored", unit, why)
                return ColumnUse(column, role, unit, why)
        return ColumnUse(column, "mass" if quantity == "mass" else "ignored", unit, why)
    if unit is None and re.fullmatch(r".*(front|vorn).*(share|anteil).*|.*(share|anteil).*(front|vorn).*", plain):
        return ColumnUse(column, "front_share", None, why)
    if unit is None and _is("id", plain):
        return ColumnUse(column, "id", None, why)
    return ColumnUse(column, "ignored")


def _among_pulses(use: ColumnUse, time: ColumnUse, least_filtered: dict[str, ColumnUse]) -> ColumnUse:
    """What a column is in a sheet of pulses."""
    if use.role == "time" and use is not time:
        return ColumnUse(use.column, "ignored", use.unit, f"{time.column} is the time")
    if use.role == "acceleration":
        best = least_filtered[_unfiltered(use.column)]
        if best is not use:
            return ColumnUse(use.column, "ignored", use.unit, f"{best.column} is less filtered")
        return use
    if use.role in ("time", "id", "ignored"):
        return use
    return ColumnUse(use.column, "ignored", use.unit, "not part of a pulse")


def _clock(sheet: Sheet, uses: list[ColumnUse]) -> str | None:
    """A column that increases in even steps, where no header says which the time is."""
    for use in uses:
        if use.role == "ignored":
            try:
                values = sheet.numbers(use.column)
            except DataError:
                continue
            steps = np.diff(values)
            if values.size > 50 and np.isfinite(steps).all() and steps.min() > 0 and np.ptp(steps) < 0.1 * steps.mean():
                return use.column
    return None


def _name_and_unit(column: str, unit_cell: str) -> tuple[str, str | None]:
    """Split a header into name and unit: ``a_x (g)``, ``Zeit [ms]``, ``AX_m/s^2``, ``t/ms``, ``time in s``."""
    if (unit := unit_named(unit_cell)) is not None:
        return column, unit
    for match in re.finditer(r"[\[({]([^\])}]*(?:\([^)]*\)[^\])}]*)?)[\])}]", column):
        if (unit := unit_named(match.group(1))) is not None:
            return (column[: match.start()] + column[match.end() :]).strip(" _-,"), unit
    for match in re.finditer(r"[\s_/,;:-]+(?:in[\s_]+)?", column):
        if match.start() and (unit := unit_named(column[match.end() :])) is not None:
            return column[: match.start()].strip(" _-,/"), unit
    return column, unit_named(column) if len(column) > 1 else None


def _plain(name: str) -> str:
    """Lower case, without accents, words apart."""
    flat = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    return " ".join(re.sub(r"[^a-z0-9]+", " ", flat).split())


def _is(role: ColumnRole, plain: str) -> bool:
    return re.fullmatch(_WORDS[role], plain) is not None


def _unfiltered(column: str) -> str:
    return _FILTER.sub("", _plain(_name_and_unit(column, "")[0]))


def _filter_order(column: str) -> float:
    cutoff = cutoff_of(column)
    return 0.0 if cutoff is None else 1 / cutoff


def cutoff_of(column: str) -> float | None:
    """−3 dB frequency of the CFC in a header, if there is one (SAE J211-1: 1.667 times the class)."""
    match = _FILTER.search(_plain(column))
    return float(match.group(2)) / 0.6 if match and match.group(2) and len(match.group(2)) <= 4 else None


def bare_name(column: str) -> str:
    """Return a header without its unit."""
    return _name_and_unit(column, "")[0] or column
