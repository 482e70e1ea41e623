"""Records and conditions from tables with foreign headers, once the column roles are settled."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from crashfuse.errors import DataError, Problem, collecting, printable
from crashfuse.files.csv_text import MOST_ROWS
from crashfuse.readers.credibility import is_simulated
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel, proposal
from crashfuse.readers.tables.headers import bare_name, cutoff_of, is_ahead, names_a_dummy
from crashfuse.readers.tables.mapping import QUANTITIES, ColumnRole, ColumnUse, Mapping
from crashfuse.readers.tables.sheet import Sheet
from crashfuse.readers.unit_spelling import UNITS
from crashfuse.signals.pulse import FloatArray
from crashfuse.wording import read_out

Rows = npt.NDArray[np.signedinteger[Any]]
_LONGEST_S = 3.0  # beyond it a time without a unit is in ms
_LISTED = 12  # columns in a sentence
_FEWEST = 10  # numbers of each kind needed to tell thousands separators from decimal signs


def apply_mapping(sheet: Sheet, mapping: Mapping, *, record_id: str, together: bool = False) -> tuple[Record, ...]:
    """Read the records of a sheet of pulses: one per id if there is an id column.

    Parameters
    ----------
    record_id : str
        Id for a sheet with a single pulse, such as the file name.
    together : bool
        Treat several columns as channels of one record, to be averaged; by default each is a separate record.

    Raises
    ------
    DataError
        Unless there is one time and at least one acceleration; also if a cell is not a number, or the rows are of
        several records without ids.
    """
    times, accelerations, ids = mapping.of("time"), mapping.of("acceleration"), mapping.of("id")
    wanted: dict[ColumnRole, bool] = {"time": len(times) == 1, "acceleration": bool(accelerations), "id": len(ids) <= 1}
    if not all(wanted.values()):
        raise DataError([_one_column(sheet, role, mapping.of(role)) for role, fine in wanted.items() if not fine])
    time, told = _seconds(sheet, times[0])
    values = {use.column: _decimal(sheet, use.column) for use in accelerations}

    def channel(use: ColumnUse, rows: Rows) -> RecordedChannel:
        unit = use.unit if use.unit in UNITS["acceleration"] else None
        kept = rows[np.isfinite(values[use.column][rows])]
        _check_duplicates(sheet, times[0], time, kept)
        label = bare_name(use.column)
        return RecordedChannel(
            use.column,
            label,
            time[kept],
            values[use.column][kept],
            unit,
            cutoff_of(use.column),
            origin=_origin(sheet, use.column),
        )

    def record(name: str, uses: tuple[ColumnUse, ...], rows: Rows) -> Record:
        channels = {use.column: channel(use, rows) for use in uses}
        averaged, why = proposal(channels, _behind)
        by_name = names_a_dummy(sheet.name.partition(": ")[2] or sheet.name)
        doubt = f"Careful: by the name of {sheet.name} it is a dummy's." if by_name else ""
        notes = filter(None, (_left_out(mapping), mapping.travel, doubt, *why))
        steps = (*sheet.steps, *_told((*times, *ids, *uses)), *notes, *told)
        return Record(name, sheet.name, PartialCondition(), tuple(channels.values()), averaged, steps)

    rows = np.flatnonzero(np.isfinite(time))
    if ids:
        groups = _groups(sheet.text(ids[0].column), rows)
        return tuple(record(name, accelerations, of) for name, of in groups)
    _check_order(sheet, times[0], time, rows)
    if together or len(accelerations) == 1:
        return (record(record_id, accelerations, rows),)
    return tuple(record(bare_name(use.column), (use,), rows) for use in accelerations)


def _behind(columns: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Those of the columns that are not ahead of the passenger cell, unless all are, and a sentence on the others."""
    ahead = [column for column in columns if is_ahead(column)]
    behind = tuple(column for column in columns if column not in ahead)
    left = f"Ahead of the passenger cell, not averaged unless chosen: {', '.join(map(printable, ahead))}."
    return behind or tuple(ahead), left if ahead and behind else ""


def _left_out(mapping: Mapping) -> str:
    """A sentence on the columns that might have been taken for the pulse; empty if there are none."""
    others = [f"{printable(use.column, 60)} ({use.why})" for use in mapping.of("ignored") if use.why]
    more = f" and {len(others) - _LISTED} more" if len(others) > _LISTED else ""
    return f"Left out: {', '.join(others[:_LISTED])}{more}." if others else ""


def _origin(sheet: Sheet, column: str) -> str:
    """What says that it was not measured: the lines above, the columns that our predictions have, its name or title."""
    if "approach" in sheet.columns or {"lower_g", "upper_g"} <= set(sheet.columns):
        return "prediction"
    names = set(map(bare_name, sheet.columns))
    expected = re.sub(", (lower|upper)$", "", bare_name(column))
    if {expected, f"{expected}, lower", f"{expected}, upper"} <= names:  # as the tables of figures have them
        return "prediction"
    texts = (bare_name(column), sheet.title(column), sheet.titles[0]) if sheet.is_titled else (bare_name(column),)
    return next(filter(is_simulated, texts), "") or sheet.origin


def apply_conditions(sheet: Sheet, mapping: Mapping) -> dict[str, PartialCondition]:
    """Read the conditions of a sheet by id; ids must be present and unique."""
    ids = mapping.of("id")
    if len(ids) != 1:
        raise DataError(_one_column(sheet, "id", ids))
    if len(sheet.cells) > MOST_ROWS:
        expected, found = f"conditions in at most {MOST_ROWS:,} rows", f"{len(sheet.cells):,}"
        raise DataError(Problem(sheet.name, expected, found, "leave out what is not needed"))
    names = sheet.text(ids[0].column)
    name, times = Counter(filter(None, names)).most_common(1)[0] if any(names) else ("", 0)
    if times != 1:
        found = f"{printable(name, 40)!r} {times} times" if times else "none"
        raise DataError(Problem(sheet.name, "each id once", found, "correct the ids", ids[0].column))
    roles: tuple[ColumnRole, ...] = ("speed", "mass", "front_weight", "rear_weight")
    values: dict[ColumnRole, FloatArray | None] = {}
    problems: list[Problem] = []
    for role in (*roles, "front_share"):
        with collecting(problems):
            values[role] = _quantity(sheet, mapping, role)
    if problems:
        raise DataError(problems)
    share = values.pop("front_share")
    factors = [(use.column, sheet.text(use.column)) for use in mapping.of("factor")]
    conditions = {}
    for row, name in enumerate(names):
        if not name:
            continue
        speed, mass, front, rear = (None if v is None or np.isnan(v[row]) else float(v[row]) for v in values.values())
        if share is not None and mass is not None and front is None and rear is None and np.isfinite(share[row]):
            front = mass * float(share[row])
            rear = mass - front
        known = tuple((column, cells[row]) for column, cells in factors)
        conditions[name] = PartialCondition(speed, mass, front, rear, known)
    return conditions


def told_of(mapping: Mapping) -> tuple[str, ...]:
    """Sentences on the roles of the columns in a sheet of conditions."""
    return tuple(_told(use for use in mapping.uses if use.role in ("id", *QUANTITIES)))


def _one_column(sheet: Sheet, role: ColumnRole, found: Sequence[ColumnUse]) -> Problem:
    have = ", ".join(printable(use.column, 40) for use in found) or f"none in {', '.join(sheet.columns[:12])}"
    return Problem(sheet.name, f"one column that is the {role}", have, "map the columns (--column COLUMN=ROLE:UNIT)")


def _decimal(sheet: Sheet, column: str) -> FloatArray:
    """The numbers of a column; reject thousands separators (``-441.234`` among ``119``, never ``-44.1``: −441 234)."""
    numbers = sheet.numbers(column)
    known = numbers[np.isfinite(numbers)]
    broken = known[known != np.round(known)]
    if _FEWEST <= broken.size <= known.size - _FEWEST and np.abs(known).max() < 1000 and np.abs(broken).min() >= 1:
        cells = [cell for cell in sheet.text(column) if cell]
        grouped = re.compile(rf"[-+]?\d{{1,3}}({re.escape(sheet.decimal)}\d{{3}})?")
        if all(map(grouped.fullmatch, cells)):
            found = f"numbers such as {next(cell for cell in cells if sheet.decimal in cell)} among whole ones"
            advice = "these are thousands separators; export without them"
            raise DataError(Problem(sheet.name, "a decimal sign that is one", found, advice, printable(column)))
    return numbers


def _check_order(sheet: Sheet, use: ColumnUse, time: FloatArray, rows: Rows) -> None:
    """Raise a DataError if time decreases: without ids, the rows may be several records one below the other."""
    back = np.flatnonzero(np.diff(time[rows]) < 0)
    if back.size:
        before, after = (sheet.text(use.column)[row] for row in rows[back[0] : back[0] + 2].tolist())
        expected, found = "time that increases from row to row", f"{printable(after, 20)} after {printable(before, 20)}"
        advice = "map the column of ids (--column COLUMN=id) if the rows are of several records, else sort them by time"
        row = int(rows[back[0] + 1]) + sheet.first_row
        raise DataError(Problem(sheet.name, expected, found, advice, printable(use.column), row))


def _check_duplicates(sheet: Sheet, use: ColumnUse, time: FloatArray, rows: Rows) -> None:
    """Raise a DataError if two neighbouring rows have the same time."""
    twice = np.flatnonzero(np.diff(time[rows]) == 0)
    if twice.size:
        first, second = rows[twice[0] : twice[0] + 2].tolist()
        found = f"duplicate times: {printable(sheet.text(use.column)[first], 20)} in row {first + sheet.first_row} too"
        found += f", and {twice.size - 1} more" if twice.size > 1 else ""
        expected, advice = "each time once", "delete the duplicates, or export time with more digits"
        raise DataError(Problem(sheet.name, expected, found, advice, printable(use.column), second + sheet.first_row))


def _seconds(sheet: Sheet, use: ColumnUse) -> tuple[FloatArray, tuple[str, ...]]:
    time = sheet.numbers(use.column)
    if use.unit is not None:
        return time * UNITS["time"][use.unit], ()
    span = float(np.nanmax(time) - np.nanmin(time)) if np.isfinite(time).any() else 0.0
    unit = "s" if span <= _LONGEST_S else "ms"
    return time * UNITS["time"][unit], (f"Time in {unit}: no unit is named, and the record is {span:.6g} long.",)


def _quantity(sheet: Sheet, mapping: Mapping, role: ColumnRole) -> FloatArray | None:
    uses = mapping.of(role)
    if not uses:
        return None
    if len(uses) > 1:
        found = " and ".join(printable(use.column, 40) for use in uses)
        advice = "say which one it is by mapping the others (--column COLUMN=factor)"
        raise DataError(Problem(sheet.name, f"one column that is the {role}", found, advice))
    use, quantity = uses[0], QUANTITIES[role]
    values = sheet.numbers(use.column)
    if quantity == "share" and use.unit != "1":  # Excel keeps 58 % as 0.58
        return np.where(values > 1, 0.01 * values, values)
    if use.unit is not None:
        return values * UNITS[quantity][use.unit]
    expected = f"a unit in the header ({', '.join(UNITS[quantity])})"
    raise DataError(Problem(sheet.name, expected, "none", "give its unit (--column COLUMN=ROLE:UNIT)", use.column))


def _groups(names: list[str], rows: Rows) -> Iterator[tuple[str, Rows]]:
    """Yield each id with its rows, in order of first appearance."""
    of: dict[str, list[int]] = {}
    for row in rows.tolist():
        of.setdefault(names[row], []).append(row)
    for name, indices in of.items():
        if name:
            yield name, np.array(indices)


def _told(uses: Iterable[ColumnUse]) -> Iterator[str]:
    """A sentence on each role; columns that have it one after the other for the same reason share it."""
    for (role, unit, why), own in groupby(uses, lambda use: (use.role, use.unit, use.why)):
        names = [printable(use.column, 60) for use in own]
        columns = f"{'Each of the columns' if len(names) > 1 else 'Column'} {read_out(names)}"
        in_unit = f" in {unit}" if unit else ""
        yield f"{columns} is the {role.replace('_', ' ')}{in_unit}: {why}."
