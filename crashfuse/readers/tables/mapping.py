"""Column roles of a foreign table: proposed from headers and units, overridden by the user.

:func:`propose` and :meth:`Mapping.overruled` are pure, so that a page can show the mapping as a separate step;
:mod:`crashfuse.readers.tables.table_reader` applies it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from crashfuse.errors import UsageError, printable
from crashfuse.readers.axes import Travel
from crashfuse.readers.tables.directions import axis_by_motion, turned
from crashfuse.readers.tables.headers import (
    ColumnRole,
    ColumnUse,
    filter_order,
    place_of,
    use_of,
    why_no_acceleration,
    why_not_the_vehicle,
)
from crashfuse.readers.tables.sheet import SAMPLE, Sheet, counts
from crashfuse.readers.unit_spelling import UNITS, unit_named
from crashfuse.signals.pulse import FloatArray

__all__ = ["QUANTITIES", "ColumnRole", "ColumnUse", "Mapping", "propose"]

QUANTITIES: dict[str, str] = {
    "time": "time",
    "acceleration": "acceleration",
    "speed": "speed",
    "mass": "mass",
    "front_weight": "mass",
    "rear_weight": "mass",
    "front_share": "share",
}
"""The quantity of each column role that has a unit."""
_OF_CONDITIONS: tuple[ColumnRole, ...] = ("speed", "mass", "front_weight", "rear_weight")
_FEWEST = 20  # rows needed to take a time beside conditions for that of pulses


@dataclass(frozen=True, slots=True)
class Mapping:
    """The roles of all columns of a sheet, in order, and what has to be told of the direction of travel."""

    uses: tuple[ColumnUse, ...]
    travel: str = ""

    def of(self, role: ColumnRole) -> tuple[ColumnUse, ...]:
        """The columns with this role."""
        return tuple(use for use in self.uses if use.role == role)

    @property
    def kind(self) -> Literal["pulses", "conditions", "neither"]:
        """The content of the sheet: pulses if it has a time, else conditions if it has a speed or a weight."""
        if self.of("time") and self.of("acceleration"):
            return "pulses"
        return "conditions" if any(self.of(role) for role in _OF_CONDITIONS) else "neither"

    def overruled(self, column: str, role: ColumnRole, unit: str | None = None) -> "Mapping":
        """Return the mapping with one column assigned by the user; its unit is kept if it still fits.

        Raises
        ------
        UsageError
            If there is no such column, role, or unit.
        """
        if column not in [use.column for use in self.uses]:
            have = ", ".join(printable(use.column, 40) for use in self.uses[:20])
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

        return replace(self, uses=tuple(map(changed, self.uses)))


def propose(sheet: Sheet, travel: Travel | None = None) -> Mapping:
    """Propose the role of each column from its header, its unit, and the other columns of the sheet.

    An unrecognised column is ignored in a table with a time, and a factor in a table of conditions. If several columns
    could be one quantity, all of them are proposed, and rejected on reading. The direction of travel, if it is not
    given, is along x unless the change of velocity along another axis says otherwise.
    """
    if travel is not None:
        return replace(_along(sheet, travel[-1]), travel=f"Travel along {travel}, given by the user.")
    plain = _along(sheet, "x")
    if plain.kind == "conditions":
        return plain
    of_x = {use.column for use in plain.of("acceleration")}
    by_axis = {"x": plain} | {
        axis: _along(sheet, axis)
        for axis in "yz"
        if any(turned(name, axis) != name for name in (*sheet.columns, *sheet.titles))
    }
    columns = {
        axis: tuple(use.column for use in found.of("acceleration") if axis == "x" or use.column not in of_x)
        for axis, found in by_axis.items()
        if found.kind == "pulses"
    }
    axis, told = axis_by_motion({axis: own for axis, own in columns.items() if own}, sheet.parsed)
    return replace(by_axis[axis], travel=told)


def _along(sheet: Sheet, axis: str) -> Mapping:
    """The roles of the columns if travel is along an axis."""
    sample = replace(sheet, cells=sheet.cells.head(SAMPLE))
    uses = [
        replace(use_of(turned(column, axis), unit), column=column)
        for column, unit in zip(sheet.columns, sheet.units, strict=True)
    ]
    if not any(use.role in _OF_CONDITIONS for use in uses):
        uses = [_unless_it_counts(sample, use) for use in uses]
    times = _clocks(sample, uses)
    if not times:
        return Mapping(tuple(_of_conditions(uses)))
    uses = [
        use if use.column in times else _beside_clock(sheet, sample, use, unit, axis)
        for use, unit in zip(uses, sheet.units, strict=True)
    ]
    if not any(use.unit in UNITS["acceleration"] or use.role == "acceleration" for use in uses):
        uses = [use if use.column in times else _beside_time(use) for use in uses]
    return Mapping(tuple(_of_pulses(uses, times)))


def _unless_it_counts(sample: Sheet, use: ColumnUse) -> ColumnUse:
    """The use of a column, unless it numbers the rows: then it is neither a time nor an id."""
    unknown = use.role == "ignored" and not use.why
    if (unknown or use.role == "id") and counts(sample.cells.iloc[:, sample.columns.index(use.column)]):
        return ColumnUse(use.column, "ignored", None, "it numbers the rows")
    return use


def _beside_clock(sheet: Sheet, sample: Sheet, use: ColumnUse, unit_cell: str, axis: str) -> ColumnUse:
    """The use of a column beside the time, if it has numbers; the title above tells what its name does not."""
    unknown = use.role == "ignored" and not use.why
    if not unknown and use.role != "acceleration":
        return use
    begun = next((part for part in (sample, sheet) if part.filled(use.column)), None)
    if begun is None:
        return ColumnUse(use.column, "ignored", None, "it is empty")
    title = sheet.title(use.column)
    titled = use_of(turned(f"{use.column} {title}", axis), unit_cell) if title else use
    if unknown:
        if titled.role == "acceleration":
            return replace(titled, column=use.column, why=f"its title is {printable(title, 60)}")
        if titled.why or titled.role != "ignored":
            why = titled.why if titled.role == "ignored" else "no acceleration"
            return ColumnUse(use.column, "ignored", None, f"{why}: {printable(title, 60)}")
        why_not = why_no_acceleration(use.column, unit_cell) or ("" if _numeric(begun, use.column) else "no numbers")
        if not why_not and sheet.is_titled:
            why_not = why_not_the_vehicle(turned(title, axis)) or why_no_acceleration(title, unit_cell)
            why_not += f": {printable(title, 60)}" if why_not else ""
        if why_not:
            return ColumnUse(use.column, "ignored", None, why_not)
        return replace(use, why="it has no name") if sheet.has_row_names(use.column) else use
    above = (title if sheet.is_titled else "", sheet.name.partition(": ")[2])
    reasons = ((why_not_the_vehicle(turned(name, axis)), name) for name in above)
    why_not, name = next(((why, name) for why, name in reasons if why), ("", ""))
    return replace(use, role="ignored", why=f"{why_not}: {printable(name, 60)}") if why_not else use


def _clocks(sheet: Sheet, uses: list[ColumnUse]) -> list[str]:
    """The columns that are the time of pulses; a time of day among conditions is not."""
    named = [use for use in uses if use.role == "time"]
    conditions = any(use.role in _OF_CONDITIONS for use in uses)
    numeric = [use.column for use in named if _numeric(sheet, use.column)]
    running = [column for column in numeric if _runs(sheet.parsed(column))]
    times = [c for c in running if len(sheet.cells) >= _FEWEST] if conditions else running or numeric
    described = {"speed"} < {use.role for use in uses if use.role in _OF_CONDITIONS}
    if not times and not described:
        unknown = (use.column for use in uses if use.role == "ignored" and not use.why)
        times = [column for column in unknown if _runs_evenly(sheet.parsed(column))][:1]
    return times


def _numeric(sheet: Sheet, column: str) -> bool:
    """Whether most of the non-empty cells are numbers."""
    filled = sheet.filled(column)
    return filled > 0 and 2 * np.isfinite(sheet.parsed(column)).sum() >= filled


def _runs(values: FloatArray) -> bool:
    """Whether the numbers increase like time, except where the next of several records starts."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(steps.size and np.any(steps > 0) and np.mean(steps >= 0) > 0.9)


def _runs_evenly(values: FloatArray) -> bool:
    steps = np.diff(values)
    return bool(
        values.size > 50 and np.isfinite(steps).all() and steps.min() > 0 and np.ptp(steps) < 0.1 * steps.mean()
    )


def _beside_time(use: ColumnUse) -> ColumnUse:
    """The use of an unrecognised column in a sheet where no other column could be the acceleration."""
    unknown = use.role == "ignored" and not use.why
    return ColumnUse(use.column, "acceleration", None, "beside the time") if unknown else use


def _of_pulses(uses: Sequence[ColumnUse], times: Sequence[str]) -> list[ColumnUse]:
    """The roles of the columns in a sheet of pulses."""
    least_filtered: dict[tuple[str, str], ColumnUse] = {}
    clock_of = _clock_of([use.column for use in uses], times)
    by_filter = sorted((use for use in uses if use.role == "acceleration"), key=lambda use: filter_order(use.column))
    for use in by_filter:
        least_filtered.setdefault((clock_of[use.column], place_of(use.column)), use)
    used = {clock_of[use.column] for use in least_filtered.values()} or {times[0]}
    used = set(times) if "" in used else used  # the user must say which time applies
    settled = []
    for use in uses:
        role, why = use.role, use.why
        if use.column in used:
            role, why = "time", why or "it increases evenly"
        elif use.role == "time":
            role, why = "ignored", f"{', '.join(sorted(used))} is the time"
        elif use.role == "acceleration":
            best = least_filtered[clock_of[use.column], place_of(use.column)]
            role, why = ("acceleration", why) if best is use else ("ignored", f"{best.column} is less filtered")
        elif use.role not in ("id", "ignored"):
            role, why = "ignored", "not part of a pulse"
        settled.append(ColumnUse(use.column, role, use.unit, why))
    return settled


def _clock_of(columns: Sequence[str], times: Sequence[str]) -> dict[str, str]:
    """The time column of each column: the nearest to its left; none for columns before the first of several."""
    clocks, clock = {}, times[0] if len(times) == 1 else ""
    for column in columns:
        clock = column if column in times else clock
        clocks[column] = clock
    return clocks


def _of_conditions(uses: Sequence[ColumnUse]) -> list[ColumnUse]:
    """The roles of the columns in a sheet of conditions."""
    settled: list[ColumnUse] = []
    for use in uses:
        if use.role in ("time", "acceleration") or (use.role == "ignored" and not use.why):
            use = ColumnUse(use.column, "factor", None, "kept with the condition")
        elif use.role == "id" and any(other.role == "id" for other in settled):
            use = ColumnUse(use.column, "factor", None, "another column is the id")
        settled.append(use)
    if settled and settled[0].role == "factor" and not any(use.role == "id" for use in settled):
        settled[0] = ColumnUse(settled[0].column, "id", None, "the first column")
    return settled
