"""Column roles of a foreign table, proposed and overridden by the user; records and conditions from a mapped table."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt

from crashfuse.errors import DataError, Problem, UsageError, collecting, printable, refusal, refuse_all, refuse_if
from crashfuse.files.csv_text import MOST_ROWS
from crashfuse.readers.members import ONE_CLOCK
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel, proposal
from crashfuse.readers.table_headers import OF_A_DUMMY, OTHER_DIRECTION, ColumnRole, ColumnUse, Heading, axis_by_motion
from crashfuse.readers.table_sheet import SAMPLE, Sheet, numbers_rows
from crashfuse.readers.vocabulary import UNITS, Travel, is_simulated, unit_named
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import read_out

QUANTITIES = {name: name for name in ("time", "acceleration", "speed", "mass")}
QUANTITIES |= {"front_weight": "mass", "rear_weight": "mass", "front_share": "share"}  # by role
_OF_CONDITIONS: tuple[ColumnRole, ...] = ("speed", "mass", "front_weight", "rear_weight")
_FEWEST_ROWS = 20  # rows needed to take a time beside conditions for that of pulses

_Rows = npt.NDArray[np.signedinteger[Any]]
_LONGEST_S = 3.0  # beyond it a time without a unit is in ms, unless length and rate are those of no crash
_SHORTEST_S, _LONGEST_RECORD_S = 0.03, 60.0
_SLOWEST_HZ, _FASTEST_HZ = 500.0, 2e6
_PERIODS_S = (1.0, 60.0, 3600.0, 86400.0)  # after which clocks begin anew
_LISTED = 12  # columns in a sentence
_CHOSEN = "chosen by the user"
_AHEAD = "Ahead of the passenger cell, not averaged: {}."
_FEWEST_NUMBERS = 10  # numbers of each kind needed to tell thousands separators from decimal signs


@dataclass(frozen=True, slots=True)
class Mapping:
    """The roles of all columns of a sheet, in order, and a sentence on the direction of travel."""

    uses: tuple[ColumnUse, ...]
    travel: str = ""

    def of(self, role: ColumnRole) -> tuple[ColumnUse, ...]:
        """The columns with this role."""
        return tuple(use for use in self.uses if use.role == role)

    @property
    def kind(self) -> Literal["pulses", "conditions", "neither"]:
        """Pulses if it has a time, else conditions if it has a speed or a weight."""
        if self.of("time") and self.of("acceleration"):
            return "pulses"
        return "conditions" if any(self.of(role) for role in _OF_CONDITIONS) else "neither"

    def overruled(self, column: str, role: ColumnRole, unit: str | None = None) -> Self:
        """The mapping with a column assigned by the user, its unit kept if it fits; a UsageError for an unfit unit."""
        quantity = QUANTITIES.get(role)
        units = {} if quantity is None else UNITS[quantity]
        named = None if unit is None or quantity is None else unit_named(unit, quantity)
        if unit is not None and named is None:
            raise UsageError(f"A column that is {role} has {', '.join(units) or 'no unit'}, not {unit!r}.")

        def chosen(use: ColumnUse) -> ColumnUse:
            return ColumnUse(column, role, named or (use.unit if use.unit in units else None), _CHOSEN)

        return replace(self, uses=tuple(chosen(use) if use.column == column else use for use in self.uses))


def propose(sheet: Sheet, travel: Travel | None = None) -> Mapping:
    """Propose the role of each column; travel is along x unless given or told by the change of velocity."""
    if travel is not None:
        return replace(_along(sheet, travel[-1]), travel=f"Travel along {travel}, given by the user.")
    plain = _along(sheet, "x")
    if plain.kind == "conditions":
        return plain
    of_x = {use.column for use in plain.of("acceleration")}
    by_axis = {"x": plain}
    for axis in "yz":
        if any(Heading(name).along(axis) != name for name in (*sheet.columns, *chain(*sheet.titles), *sheet.heading)):
            by_axis[axis] = _along(sheet, axis)
    columns = {}
    for axis, mapping in by_axis.items():
        names = tuple(use.column for use in mapping.of("acceleration") if axis == "x" or use.column not in of_x)
        if names and mapping.kind == "pulses":
            columns[axis] = names
    axis, travels = axis_by_motion(columns, sheet.parsed)
    return replace(by_axis[axis], travel=travels)


def _along(sheet: Sheet, axis: str) -> Mapping:
    sample = replace(sheet, cells=sheet.cells.head(SAMPLE))
    cells = zip(sheet.columns, sheet.units, strict=True)
    uses = [replace(Heading(Heading(column).along(axis), unit).use, column=column) for column, unit in cells]
    if not any(use.role in _OF_CONDITIONS for use in uses):
        for place, use in enumerate(uses):
            if (use.is_unknown or use.role == "id") and numbers_rows(sample.column(use.column)):
                uses[place] = ColumnUse(use.column, "ignored", None, "it numbers the rows")
    if not (times := _clocks(sample, uses)):
        return Mapping(tuple(_of_conditions(uses)))
    pairs = zip(uses, sheet.units, strict=True)
    uses = [use if use.column in times else _beside_clock(sheet, sample, use, unit, axis) for use, unit in pairs]
    if not any(use.unit in UNITS["acceleration"] or use.role == "acceleration" for use in uses):
        beside = [use.is_unknown and use.column not in times for use in uses]
        of_a = [ColumnUse(use.column, "acceleration", None, "beside the time") for use in uses]
        uses = [new if is_beside else use for use, new, is_beside in zip(uses, of_a, beside, strict=True)]
    return Mapping(tuple(_of_pulses(uses, times)))


def _beside_clock(sheet: Sheet, sample: Sheet, use: ColumnUse, unit_cell: str, axis: str) -> ColumnUse:
    if not use.is_unknown and use.role != "acceleration":
        return use
    begun = next((part for part in (sample, sheet) if part.filled(use.column)), None)
    if begun is None:
        return ColumnUse(use.column, "ignored", None, "it is empty")
    above = [Heading(text).along(axis) for text in sheet.said_of(use.column)[1:]]
    if use.is_unknown:
        own = Heading(use.column).along(axis)
        titled = [(replace(Heading(f"{own} {text}", unit_cell).use, column=use.column), text) for text in above]
        use, text = next(((one, text) for one, text in titled if not one.is_unknown), (use, ""))
        if not use.is_unknown and use.role != "acceleration":
            why = use.why if use.role == "ignored" else "no acceleration"
            return ColumnUse(use.column, "ignored", None, f"{why}: {printable(text, 60)}")
        use = replace(use, why=f"its title is {printable(text, 60)}") if text else use
    if use.is_unknown:
        why_not = Heading(own).why_not_the_vehicle or Heading(use.column, unit_cell).why_no_acceleration
        if why_not or not _numeric(begun, use.column):
            return ColumnUse(use.column, "ignored", None, why_not or "no numbers")
    for text in above:
        title = Heading(text)
        why_not = title.why_not_the_vehicle or (title.why_no_acceleration if use.is_unknown else "")
        if why_not:
            return replace(use, role="ignored", unit=None, why=f"{why_not}: {printable(text, 60)}")
    return replace(use, why="it has no name") if use.is_unknown and sheet.has_row_names(use.column) else use


def _clocks(sheet: Sheet, uses: list[ColumnUse]) -> list[str]:
    named = [use for use in uses if use.role == "time"]
    conditions = any(use.role in _OF_CONDITIONS for use in uses)
    numeric = [use.column for use in named if _numeric(sheet, use.column)]
    running = [column for column in numeric if _runs(sheet.parsed(column))]
    times = [c for c in running if len(sheet.cells) >= _FEWEST_ROWS] if conditions else running or numeric
    described = {"speed"} < {use.role for use in uses if use.role in _OF_CONDITIONS}
    if not times and not described:
        unknown = (use.column for use in uses if use.is_unknown)
        times = [column for column in unknown if _runs_evenly(sheet.parsed(column))][:1]
    return times


def _numeric(sheet: Sheet, column: str) -> bool:
    filled = sheet.filled(column)
    return filled > 0 and 2 * np.isfinite(sheet.parsed(column)).sum() >= filled


def _runs(values: FloatArray) -> bool:
    steps = np.diff(values[np.isfinite(values)])
    return bool(steps.size and np.any(steps > 0) and np.mean(steps >= 0) > 0.9)


def _runs_evenly(values: FloatArray) -> bool:
    steps = np.diff(values)
    is_long = values.size > 50 and np.isfinite(steps).all()
    return bool(is_long and steps.min() > 0 and np.ptp(steps) < 0.1 * steps.mean())


def _of_pulses(uses: Sequence[ColumnUse], times: Sequence[str]) -> list[ColumnUse]:
    least_filtered: dict[tuple[str, str], ColumnUse] = {}
    # the time of each column: the nearest to its left; none for columns before the first of several
    clock_of, clock = {}, times[0] if len(times) == 1 else ""
    for use in uses:
        clock = use.column if use.column in times else clock
        clock_of[use.column] = clock
    accelerations = [use for use in uses if use.role == "acceleration"]
    for use in sorted(accelerations, key=lambda use: Heading(use.column).filter_order):
        least_filtered.setdefault((clock_of[use.column], Heading(use.column).place), use)
    used = {clock_of[use.column] for use in least_filtered.values()} or {times[0]}
    used = set(times) if "" in used else used  # the user must say which time applies
    settled = []
    for use in uses:
        role, why = use.role, use.why
        if use.column in used:
            role, why = "time", why or "it increases evenly"
        elif role == "time":
            role, why = "ignored", f"{', '.join(sorted(used))} is the time"
        elif role == "acceleration":
            best = least_filtered[clock_of[use.column], Heading(use.column).place]
            role, why = (role, why) if best is use else ("ignored", f"{best.column} is less filtered")
        elif role not in ("id", "ignored"):
            role, why = "ignored", "not part of a pulse"
        settled.append(replace(use, role=role, why=why))
    return settled


def _of_conditions(uses: Sequence[ColumnUse]) -> list[ColumnUse]:
    settled: list[ColumnUse] = []
    for use in uses:
        if use.role in ("time", "acceleration") or use.is_unknown:
            use = ColumnUse(use.column, "factor", None, "kept with the condition")
        elif use.role == "id" and any(other.role == "id" for other in settled):
            use = ColumnUse(use.column, "factor", None, "another column is the id")
        settled.append(use)
    if settled and settled[0].role == "factor" and not any(use.role == "id" for use in settled):
        settled[0] = ColumnUse(settled[0].column, "id", None, "the first column")
    return settled


def apply_mapping(sheet: Sheet, mapping: Mapping, *, record_id: str, together: bool = False) -> tuple[Record, ...]:
    """The records of a sheet of pulses: one per id, else one per column, or of all columns ``together``."""
    times, accelerations, ids = mapping.of("time"), mapping.of("acceleration"), mapping.of("id")
    wanted: dict[ColumnRole, bool] = {"time": len(times) == 1, "acceleration": bool(accelerations), "id": len(ids) <= 1}
    if not all(wanted.values()):
        raise DataError([_one_column(sheet, role, mapping.of(role)) for role, fine in wanted.items() if not fine])
    time, time_steps = _seconds(sheet, times[0])
    proposed = [use.column for use in accelerations if use.why != _CHOSEN]
    ahead = {column for column in proposed if any(Heading(text).is_ahead for text in sheet.said_of(column))}
    behind = tuple(use for use in accelerations if use.column not in ahead)
    excluded, noted = any(use.why.startswith((OTHER_DIRECTION, OF_A_DUMMY)) for use in mapping.of("ignored")), ""
    if behind and ahead and not together:
        noted, accelerations = _AHEAD.format(", ".join(map(printable, sorted(ahead)))), behind
    values = {use.column: _decimal(sheet, use.column) for use in accelerations}
    others = [f"{printable(use.column, 60)} ({use.why})" for use in mapping.of("ignored") if use.why]
    more = f" and {len(others) - _LISTED} more" if len(others) > _LISTED else ""
    left_out = f"Left out: {', '.join(others[:_LISTED])}{more}." if others else ""
    is_dummy = Heading(sheet.name.partition(": ")[2] or sheet.name).names_a_dummy
    doubt = f"Careful: by the name of {sheet.name} it is a dummy's." if is_dummy else ""

    def channel(use: ColumnUse, rows: _Rows) -> RecordedChannel:
        column, unit = use.column, use.unit if use.unit in UNITS["acceleration"] else None
        kept = rows[np.isfinite(values[column][rows])]
        _check_order(sheet, times[0], time, kept, once=True)
        origin, accel, heading = _origin(sheet, column), values[column][kept], Heading(column)
        return RecordedChannel(column, heading.name, time[kept], accel, unit, heading.cutoff_hz, origin=origin)

    def behind_alone(columns: Sequence[str]) -> tuple[tuple[str, ...], str]:
        chosen = tuple(column for column in columns if column not in ahead)
        others = ", ".join(printable(column) for column in columns if column in ahead)
        if chosen or not others:
            return chosen, _AHEAD.format(others) if others else ""
        if excluded:
            return (), f"Ahead of the passenger cell is all that is left: {others}."
        return tuple(columns), f"Careful: {others}: ahead of the passenger cell, which stops later."

    def record(name: str, uses: tuple[ColumnUse, ...], rows: _Rows) -> Record:
        channels = {use.column: channel(use, rows) for use in uses}
        averaged, why = proposal(channels, behind_alone)
        notes = filter(None, (left_out, noted, mapping.travel, doubt, *why))
        steps = (*sheet.steps, *_role_sentences((*times, *ids, *uses)), *notes, *time_steps)
        return Record(name, sheet.name, PartialCondition(), tuple(channels.values()), averaged, steps)

    rows = np.flatnonzero(np.isfinite(time))
    if ids:
        names, groups = sheet.text(ids[0].column), dict[str, list[int]]()
        for row in rows.tolist():
            groups.setdefault(names[row], []).append(row)
        return tuple(record(name, accelerations, np.array(of)) for name, of in groups.items() if name)
    _check_order(sheet, times[0], time, rows, once=False)
    if together or len(accelerations) == 1:
        return (record(record_id, accelerations, rows),)
    return tuple(record(Heading(use.column).name, (use,), rows) for use in accelerations)


def _origin(sheet: Sheet, column: str) -> str:
    if "approach" in sheet.columns or {"lower_g", "upper_g"} <= set(sheet.columns):
        return "prediction"
    names = {Heading(name).name for name in sheet.columns}
    own = Heading(column).name
    expected = re.sub(", (lower|upper)$", "", own)
    if {expected, f"{expected}, lower", f"{expected}, upper"} <= names:  # as the tables of figures have them
        return "prediction"
    texts = (own, *sheet.titles_of(column), *(row[0] for row in sheet.titles), *sheet.heading)
    return next(filter(is_simulated, texts), "") or sheet.origin


def apply_conditions(sheet: Sheet, mapping: Mapping) -> dict[str, PartialCondition]:
    """Read the conditions of a sheet by id; ids must be present and unique."""
    ids = mapping.of("id")
    if len(ids) != 1:
        raise DataError(_one_column(sheet, "id", ids))
    are_many = len(sheet.cells) > MOST_ROWS
    refuse_if(are_many, sheet.name, f"conditions in at most {MOST_ROWS:,} rows", "more", "leave some out")
    names = sheet.text(ids[0].column)
    name, times = Counter(filter(None, names)).most_common(1)[0] if any(names) else ("", 0)
    found = f"{printable(name, 40)!r} {times} times" if times else "none"
    refuse_if(times != 1, sheet.name, "each id once", found, "correct the ids", ids[0].column)
    columns, problems = list[FloatArray | None](), list[Problem]()
    for role in (*_OF_CONDITIONS, "front_share"):
        with collecting(problems):
            columns.append(_quantity(sheet, mapping, role))
    refuse_all(problems, sheet.name)
    factors = [(use.column, sheet.text(use.column)) for use in mapping.of("factor")]
    conditions = {}
    for row, name in enumerate(names):
        if name:
            cells = (None if of is None or np.isnan(of[row]) else float(of[row]) for of in columns)
            speed, mass, front, rear, share = cells
            if front is None and rear is None:
                front, rear = PartialCondition(mass_kg=mass, front_share=share).axles()
            others = tuple((column, texts[row]) for column, texts in factors)
            conditions[name] = PartialCondition(speed, mass, front, rear, others)
    return conditions


def mapping_steps(mapping: Mapping) -> tuple[str, ...]:
    """Sentences on the roles of the columns in a sheet of conditions."""
    return tuple(_role_sentences(use for use in mapping.uses if use.role in ("id", *QUANTITIES)))


def _one_column(sheet: Sheet, role: ColumnRole, found: Sequence[ColumnUse]) -> Problem:
    have = ", ".join(printable(use.column, 40) for use in found) or f"none in {', '.join(sheet.columns[:12])}"
    return Problem(sheet.name, f"one column that is the {role}", have, "map the columns (--column COLUMN=ROLE:UNIT)")


def _decimal(sheet: Sheet, column: str) -> FloatArray:
    """A DataError for thousands separators."""
    numbers = sheet.numbers(column)
    finite = numbers[np.isfinite(numbers)]
    broken = finite[finite != np.round(finite)]
    is_mixed = _FEWEST_NUMBERS <= broken.size <= finite.size - _FEWEST_NUMBERS
    if is_mixed and np.abs(finite).max() < 1000 and np.abs(broken).min() >= 1:
        cells = [cell for cell in sheet.text(column) if cell]
        grouped = re.compile(rf"[-+]?\d{{1,3}}({re.escape(sheet.decimal)}\d{{3}})?")
        found = f"thousands separators, as in {max(cells, key=lambda cell: sheet.decimal in cell)}"
        are_grouped, where = all(map(grouped.fullmatch, cells)), (sheet.name, printable(column))
        refuse_if(are_grouped, where[0], "decimal signs", found, "export without them", where[1])
    return numbers


def _check_order(sheet: Sheet, use: ColumnUse, time: FloatArray, rows: _Rows, *, once: bool) -> None:
    steps = np.diff(time[rows])
    places = np.flatnonzero(steps == 0 if once else steps < 0)
    if not places.size:
        return
    expected, advice = "time that increases", f"map the column of ids (--column COLUMN=id), or {ONE_CLOCK}"
    if once:
        expected, advice = "each time once", f"export more digits ({places.size} duplicates)"
    texts, pair = sheet.text(use.column), rows[places[0] : places[0] + 2].tolist()
    before, after = (printable(texts[row], 20) for row in pair)
    column, row = printable(use.column), pair[1] + sheet.first_row
    raise refusal(sheet.name, expected, f"{after} after {before}", advice, column, row)


def _seconds(sheet: Sheet, use: ColumnUse) -> tuple[FloatArray, tuple[str, ...]]:
    time, unit, steps = sheet.numbers(use.column), use.unit, []
    if unit is None:
        unit, length = _time_unit(time[np.isfinite(time)])
        steps = [f"Time in {unit}: no unit is named, and the record is {length:.6g} long."]
    time_s, n_wraps = _unwrapped(time * UNITS["time"][unit])
    if n_wraps:
        clock = printable(use.column, 60)
        steps.append(f"Time is counted on where the clock of {clock} begins anew ({n_wraps} times).")
    return time_s, tuple(steps)


def _time_unit(times: FloatArray) -> tuple[str, float]:
    span, step = (float(np.ptp(times)), float(np.median(np.abs(np.diff(times))))) if times.size > 1 else (0.0, 0.0)
    for unit, factor in UNITS["time"].items():
        if _SHORTEST_S <= span * factor <= _LONGEST_RECORD_S and 1 / _FASTEST_HZ <= step * factor <= 1 / _SLOWEST_HZ:
            return unit, span
    return "s" if span <= _LONGEST_S else "ms", span


def _unwrapped(time_s: FloatArray) -> tuple[FloatArray, int]:
    """Time that goes on where a clock begins anew; and how often."""
    there = np.flatnonzero(np.isfinite(time_s))
    steps = np.diff(time_s[there])
    back = np.flatnonzero(steps < 0)
    if not back.size or not (steps > 0).any():
        return time_s, 0
    step, first, after = float(np.median(steps[steps > 0])), time_s[there[0]], time_s[there[back + 1]]
    period = next((period for period in _PERIODS_S if (np.abs(period + steps[back] - step) <= step).all()), np.nan)
    if not (np.nanmin(time_s) >= 0 and np.nanmax(time_s) < period) or (np.abs(after - first) <= step).any():
        return time_s, 0  # another record begins there
    time_s[there[1:]] += period * np.cumsum(steps < 0)
    return time_s, back.size


def _quantity(sheet: Sheet, mapping: Mapping, role: ColumnRole) -> FloatArray | None:
    uses = mapping.of(role)
    if not uses:
        return None
    refuse_all([_one_column(sheet, role, uses)] * (len(uses) > 1), sheet.name)
    use, quantity = uses[0], QUANTITIES[role]
    values = sheet.numbers(use.column)
    if quantity == "share" and use.unit != "1":  # Excel keeps 58 % as 0.58
        return np.where(values > 1, 0.01 * values, values)
    if use.unit is not None:
        return values * UNITS[quantity][use.unit]
    expected = f"a unit in the header ({', '.join(UNITS[quantity])})"
    raise refusal(sheet.name, expected, "none", "give its unit (--column COLUMN=ROLE:UNIT)", use.column)


def _role_sentences(uses: Iterable[ColumnUse]) -> Iterator[str]:
    for (role, unit, why), alike in groupby(uses, lambda use: (use.role, use.unit, use.why)):
        names = read_out([printable(use.column, 60) for use in alike])
        yield f"Read as {role.replace('_', ' ')}{f' in {unit}' if unit else ''}: {names} ({why})."
