"""The tables of a source, some with pulses and some with conditions, joined by id."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

from crashfuse.campaign_folder.columns import listed
from crashfuse.errors import DataError, Problem, UsageError, collecting, one_of, printable
from crashfuse.readers.axes import Travel
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.tables.headers import likelihood
from crashfuse.readers.tables.mapping import ColumnRole, propose
from crashfuse.readers.tables.sheet import Sheet, is_unnamed
from crashfuse.readers.tables.sheets import read_sheets
from crashfuse.readers.tables.table_reader import apply_conditions, apply_mapping, told_of


@dataclass(frozen=True, slots=True)
class ColumnChoice:
    """A user's assignment of one column of a foreign table."""

    column: str
    role: ColumnRole
    unit: str | None = None

    def __post_init__(self) -> None:
        one_of("role of a column", self.role, dict.fromkeys(get_args(ColumnRole)))

    @classmethod
    def parsed(cls, text: str) -> "ColumnChoice":
        """Read ``COLUMN=ROLE`` or ``COLUMN=ROLE:UNIT``, as in ``Zeit=time:ms``; a UsageError if it is neither."""
        column, _, use = text.rpartition("=")
        name, _, unit = use.partition(":")
        role = next((known for known in get_args(ColumnRole) if known == name), None)
        if not column or role is None:
            roles = ", ".join(get_args(ColumnRole))
            raise UsageError(f"A column is mapped as COLUMN=ROLE or COLUMN=ROLE:UNIT, not {text!r}; roles are {roles}.")
        return cls(column, role, unit or None)


class OneCrashOrSeveral(DataError):
    """Several accelerations in one table that may be sensors of one crash or separate crashes."""


@dataclass
class TableSet:
    """The content of several tables.

    Parameters
    ----------
    of_table : dict of (Path, str) to list of Record
        The records of each table (split tables included), by its file and name.
    with_ids, parted : set of (Path, str)
        Tables that identify their own records, and those that stood side by side and were split.
    conditions : dict of str to (str, PartialCondition, tuple of str)
        The id as written, the condition and how it was read, by the id in lower case.
    neither : list of str
        A sentence for each table with neither pulses nor conditions.
    unread : list of Problem
        Problems of tables of conditions.
    """

    of_table: dict[tuple[Path, str], list[Record]] = field(default_factory=dict)
    with_ids: set[tuple[Path, str]] = field(default_factory=set)
    parted: set[tuple[Path, str]] = field(default_factory=set)
    conditions: dict[str, tuple[str, PartialCondition, tuple[str, ...]]] = field(default_factory=dict)
    neither: list[str] = field(default_factory=list)
    unread: list[Problem] = field(default_factory=list)

    @property
    def records(self) -> list[Record]:
        """All records, in the order of the tables."""
        return [record for records in self.of_table.values() for record in records]

    def add(
        self, sheet: Sheet, path: Path, columns: Sequence[ColumnChoice], *, together: bool, travel: Travel | None = None
    ) -> None:
        """Add one more table."""
        mapping = propose(sheet, travel)
        for choice in columns:
            if choice.column in sheet.columns:
                mapping = mapping.overruled(choice.column, choice.role, choice.unit)
        if mapping.kind == "pulses":
            own_name = path.stem if sheet.name == path.name else sheet.name.rpartition(": ")[2]
            table = path, sheet.part_of or sheet.name
            self.of_table.setdefault(table, []).extend(
                apply_mapping(sheet, mapping, record_id=own_name, together=together)
            )
            if mapping.of("id"):
                self.with_ids.add(table)
            elif sheet.part_of:
                self.parted.add(table)
        elif mapping.kind == "conditions":
            with collecting(self.unread):
                read = apply_conditions(sheet, mapping)
                self.conditions |= {name.casefold(): (name, known, told_of(mapping)) for name, known in read.items()}
        else:
            reasons = [f"{printable(use.column, 40)}: {use.why}" for use in mapping.uses if use.role == "ignored"]
            because = f" ({'; '.join(reasons[:12])})" if reasons else ""
            self.neither.append(f"{sheet.name} with the columns {listed(sheet.columns)}{because}")

    def given_to(self, record: Record) -> Record:
        """The record with the condition of its id (case ignored); if there is none, it says so of its speed."""
        if record.id.casefold() not in self.conditions:
            there = {other.id.casefold() for other in self.records} or self.conditions.keys()
            if idle := [run_id for key, (run_id, *_) in self.conditions.items() if key not in there]:
                return replace(record, no_speed=f"conditions without a record, of {listed(idle)}")
            return record
        _, condition, told = self.conditions[record.id.casefold()]
        steps = (*record.steps, "Condition from the table of conditions.", *told)
        return replace(record, condition=record.condition.overruled(condition), steps=steps)

    def check_ids(self, ids: Sequence[str]) -> None:
        """Raise a DataError if there are conditions but none matches a record.

        Raise OneCrashOrSeveral if a table has several accelerations and neither ids nor conditions for each.
        """
        if self.conditions and not self.conditions.keys() & set(map(str.casefold, ids)):
            found = f"those of {listed([run_id for run_id, *_ in self.conditions.values()])}"
            raise DataError(Problem("conditions", f"conditions for {listed(ids)}", found, "make the ids the same"))
        unclear = [
            _unclear(name, alike, without, parted=(path, name) in self.parted)
            for (path, name), records in self.of_table.items()
            if (path, name) not in self.with_ids
            for is_simulated in (False, True)
            if len(alike := [record for record in records if record.is_simulated == is_simulated]) > 1
            if (without := [record.id for record in alike if record.id.casefold() not in self.conditions])
        ]
        if unclear:
            raise OneCrashOrSeveral(unclear)


def _unclear(table: str, records: Sequence[Record], without: Sequence[str], *, parted: bool) -> Problem:
    """What several accelerations are, of which those in ``without`` have no conditions."""
    if len(without) < len(records):  # crashes, as the conditions of the others say
        found = f"those of {listed(record.id for record in records if record.id not in without)}"
        advice = "add a row for each to the table of conditions, or leave its column out (--column COLUMN=ignored)"
        return Problem(table, f"conditions for {listed(without)}", found, advice)
    best_first = sorted(records, key=lambda record: likelihood(record.channels[0].name))
    one = f"average them (--id ID) or choose among them (--channel {shlex.quote(best_first[0].channels[0].name)})"
    one = "leave out the others (--column COLUMN=ignored)" if parted else one
    crashes = "give a table of their conditions (--conditions TABLE)"
    advice = f"if they are sensors of one crash, {one}; if they are crashes, {crashes}"
    expected = "one acceleration of the vehicle, or conditions for each"
    found = listed(record.id for record in best_first)
    if parted:
        found += ", each with a time of its own"
    elif all(is_unnamed(record.id) for record in records):
        found += ", without names"
    return Problem(table, expected, found, advice)


def read_tables(
    paths: Sequence[Path],
    columns: Sequence[ColumnChoice],
    problems: list[Problem],
    *,
    together: bool,
    travel: Travel | None = None,
) -> TableSet:
    """Read tables, each according to its columns; append the problems of each to ``problems``.

    Parameters
    ----------
    columns : sequence of ColumnChoice
        Override the proposal in every table that has such a column.
    together : bool
        Treat the columns of one table as channels of one record.
    travel : str, optional
        The direction of travel; by default found.

    Raises
    ------
    DataError
        If a table of conditions cannot be read: no record can be judged without it.
    UsageError
        If a mapped column is in none of the tables.
    """
    tables = TableSet()
    there: set[str] = set()
    faults: list[Problem] = []
    for path in paths:
        with collecting(faults):
            for sheet in read_sheets(path):
                there.update(sheet.columns)
                tables.add(sheet, path, columns, together=together, travel=travel)
    if tables.unread:
        raise DataError([*faults, *tables.unread])
    absent = [choice.column for choice in columns if choice.column not in there]
    if absent and not faults:
        raise UsageError(f"There is no column {listed(absent)}; there are {listed(sorted(there))}.")
    problems += faults
    return tables
