"""Tables of a source together: pulses in some, conditions in others, joined by id."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

from crashfuse.campaign_folder.columns import listed
from crashfuse.errors import DataError, Problem, UsageError, collecting
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.tables.mapping import ColumnRole, propose
from crashfuse.readers.tables.sheet import Sheet
from crashfuse.readers.tables.sheets import read_sheets
from crashfuse.readers.tables.table_reader import apply_conditions, apply_mapping, told_of


@dataclass(frozen=True, slots=True)
class ColumnChoice:
    """What a user says of one column of a foreign table."""

    column: str
    role: ColumnRole
    unit: str | None = None

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
    """Several accelerations in one table, and nothing says whether they are sensors of one crash or crashes."""


_Given = tuple[str, PartialCondition, tuple[str, ...]]


@dataclass(frozen=True)
class TableSet:
    """What several tables hold.

    Parameters
    ----------
    conditions : mapping of str to (str, PartialCondition, tuple of str)
        The id as it is written, the condition and how it was read, by the id in small letters.
    neither : tuple of str
        A sentence for each table that holds neither.
    unclear : tuple of Problem
        One for each table whose records may as well be channels of one.
    """

    records: tuple[Record, ...]
    conditions: Mapping[str, _Given]
    neither: tuple[str, ...]
    unclear: tuple[Problem, ...] = ()

    def given_to(self, record: Record) -> Record:
        """Give a record the condition of its id, whatever the capitals; one without stays as it is."""
        if record.id.casefold() not in self.conditions:
            return record
        _, condition, told = self.conditions[record.id.casefold()]
        steps = (*record.steps, "Condition from the table of conditions.", *told)
        return replace(record, condition=record.condition.overruled(condition), steps=steps)

    def check_ids(self, ids: Sequence[str]) -> None:
        """Say if there are conditions, but for none of the records, and if it is unclear what a record is.

        Raises
        ------
        DataError
            If ids are not the same in both.
        OneCrashOrSeveral
            If a table has several accelerations, and neither ids nor conditions for each.
        """
        if self.conditions and not self.conditions.keys() & set(map(str.casefold, ids)):
            found = f"those of {listed([run_id for run_id, *_ in self.conditions.values()])}"
            raise DataError(Problem("conditions", f"conditions for {listed(ids)}", found, "make the ids the same"))
        if self.unclear:
            raise OneCrashOrSeveral(self.unclear)


def read_tables(
    paths: Sequence[Path], columns: Sequence[ColumnChoice], problems: list[Problem], *, together: bool
) -> TableSet:
    """Read tables, each taken for what its columns say.

    Parameters
    ----------
    columns : sequence of ColumnChoice
        Overrule the proposal in every table that has such a column.
    problems : list of Problem
        What is wrong with each table is appended.
    together : bool
        Columns of one table are channels of one record.

    Raises
    ------
    DataError
        If a table of conditions cannot be read: no record could be judged without it.
    UsageError
        If no table has a column that is mapped.
    """
    found = _Found()
    there: set[str] = set()
    faults: list[Problem] = []
    for path in paths:
        with collecting(faults):
            for sheet in read_sheets(path):
                there.update(sheet.columns)
                found.add(sheet, path, columns, together)
    if found.unread:
        raise DataError([*faults, *found.unread])
    absent = [choice.column for choice in columns if choice.column not in there]
    if absent and not faults:
        raise UsageError(f"There is no column {listed(absent)}; there are {listed(sorted(there))}.")
    problems += faults
    return TableSet(found.records(), found.conditions, tuple(found.neither), tuple(found.unclear()))


@dataclass
class _Found:
    """What was found in the tables so far.

    ``of_table`` has the records of each table, also of one that was parted; in ``with_ids`` are tables that say
    themselves which records these are.
    """

    of_table: dict[tuple[Path, str], list[Record]] = field(default_factory=dict)
    with_ids: set[tuple[Path, str]] = field(default_factory=set)
    parted: set[tuple[Path, str]] = field(default_factory=set)
    conditions: dict[str, _Given] = field(default_factory=dict)
    neither: list[str] = field(default_factory=list)
    unread: list[Problem] = field(default_factory=list)

    def add(self, sheet: Sheet, path: Path, columns: Sequence[ColumnChoice], together: bool) -> None:
        mapping = propose(sheet)
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
            self.neither.append(f"{sheet.name} with the columns {listed(sheet.columns)}")

    def records(self) -> tuple[Record, ...]:
        return tuple(record for records in self.of_table.values() for record in records)

    def unclear(self) -> Iterator[Problem]:
        """Tables whose records may as well be channels of one: neither ids nor conditions say that they are crashes."""
        for table, records in self.of_table.items():
            ids = [record.id for record in records]
            if (
                len(ids) > 1
                and table not in self.with_ids
                and not set(map(str.casefold, ids)) <= self.conditions.keys()
            ):
                one = "say so (--id, or --channel)"
                if table in self.parted:
                    one = "leave out the others (--column COLUMN=ignored)"
                crashes = "give a table of their conditions (--conditions)"
                advice = f"if they are sensors of one crash, {one}; if they are crashes, {crashes}"
                expected = "one acceleration of the vehicle, or conditions for each"
                yield Problem(table[1], expected, listed(ids), advice)
