"""The tables of a source: joined by id, some with pulses and some with conditions; grouped by header for choices."""

import shlex
from collections import abc
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

import pandas as pd

from crashfuse.campaign_folder.condition_tables import listed
from crashfuse.errors import DataError, Problem, UsageError, collecting, one_of, printable, refusal, require_a
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.table_headers import ColumnRole, Heading
from crashfuse.readers.table_mapping import Mapping, apply_conditions, apply_mapping, mapping_steps, propose
from crashfuse.readers.table_sheet import Sheet
from crashfuse.readers.tables import read_sheets
from crashfuse.readers.vocabulary import Travel

_HEAD = 3  # rows


@dataclass(frozen=True, slots=True)
class ColumnChoice:
    """A user's assignment of one column of a foreign table."""

    column: str
    role: ColumnRole
    unit: str | None = None

    def __post_init__(self) -> None:
        require_a(str, self.column, "the name of a column")
        require_a(str | None, self.unit, "a unit, or None")
        one_of("role of a column", self.role, dict.fromkeys(get_args(ColumnRole)))

    @classmethod
    def parsed(cls, text: str) -> "ColumnChoice":
        """Read ``COLUMN=ROLE`` or ``COLUMN=ROLE:UNIT``, as in ``Zeit=time:ms``; a UsageError if it is neither."""
        column, _, use = text.rpartition("=")
        name, _, unit = use.partition(":")
        roles: dict[str, ColumnRole] = {role: role for role in get_args(ColumnRole)}
        if not column or name not in roles:
            raise UsageError(f"A column is mapped as COLUMN=ROLE[:UNIT], not {text!r}; roles are {', '.join(roles)}.")
        return cls(column, roles[name], unit or None)


class OneCrashOrSeveral(DataError):
    """Several accelerations in one table that may be sensors of one crash or separate crashes."""


@dataclass
class _TableSet:
    of_table: dict[tuple[Path, str], list[Record]] = field(default_factory=dict)
    with_ids: set[tuple[Path, str]] = field(default_factory=set)  # tables that identify their own records
    parted: set[tuple[Path, str]] = field(default_factory=set)  # tables that stood side by side and were split
    # by ids in lower case: ids as written, conditions, and how they were read
    conditions: dict[str, tuple[str, PartialCondition, tuple[str, ...]]] = field(default_factory=dict)
    neither: list[str] = field(default_factory=list)  # a sentence for each table with neither pulses nor conditions
    unread: list[Problem] = field(default_factory=list)  # problems of tables of conditions

    @property
    def records(self) -> list[Record]:
        return [record for records in self.of_table.values() for record in records]

    def add(
        self, sheet: Sheet, path: Path, columns: Sequence[ColumnChoice], *, together: bool, travel: Travel | None
    ) -> None:
        mapping = propose(sheet, travel)
        for choice in columns:
            if choice.column in sheet.columns:
                mapping = mapping.overruled(choice.column, choice.role, choice.unit)
        if mapping.kind == "pulses":
            record_id = path.stem if sheet.name == path.name else sheet.name.rpartition(": ")[2]
            table = path, sheet.part_of or sheet.name
            records = apply_mapping(sheet, mapping, record_id=record_id, together=together)
            self.of_table.setdefault(table, []).extend(records)
            if mapping.of("id"):
                self.with_ids.add(table)
            elif sheet.part_of:
                self.parted.add(table)
        elif mapping.kind == "conditions":
            with collecting(self.unread):
                conditions, steps = apply_conditions(sheet, mapping), mapping_steps(mapping)
                self.conditions |= {name.casefold(): (name, one, steps) for name, one in conditions.items()}
        else:
            reasons = [f"{printable(use.column, 40)}: {use.why}" for use in mapping.uses if use.role == "ignored"]
            because = f" ({'; '.join(reasons[:12])})" if reasons else ""
            self.neither.append(f"{sheet.name} with the columns {listed(sheet.columns)}{because}")

    def given_to(self, record: Record) -> Record:
        if record.id.casefold() not in self.conditions:
            there = {other.id.casefold() for other in self.records} or self.conditions.keys()
            if idle := [run_id for key, (run_id, *_) in self.conditions.items() if key not in there]:
                return replace(record, no_speed=f"conditions without a record, of {listed(idle)}")
            return record
        _, condition, how = self.conditions[record.id.casefold()]
        steps = (*record.steps, "Condition from the table of conditions.", *how)
        return replace(record, condition=record.condition.overruled(condition), steps=steps)

    def check_ids(self, ids: Sequence[str]) -> None:
        if self.conditions and not self.conditions.keys() & set(map(str.casefold, ids)):
            found = f"those of {listed([run_id for run_id, *_ in self.conditions.values()])}"
            raise refusal("conditions", f"conditions for {listed(ids)}", found, "make the ids the same")
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
    if len(without) < len(records):  # crashes, as the conditions of the others say
        found = f"those of {listed(record.id for record in records if record.id not in without)}"
        advice = "add a row for each, or leave its column out (--column COLUMN=ignored)"
        return Problem(table, f"conditions for {listed(without)}", found, advice)
    best_first = sorted(records, key=lambda record: Heading(record.channels[0].name).likelihood)
    one = f"average them (--id ID) or choose (--channel {shlex.quote(best_first[0].channels[0].name)})"
    one = "leave out the others (--column COLUMN=ignored)" if parted else one
    advice = f"if they are sensors of one crash, {one}; if crashes, give conditions (--conditions TABLE)"
    found = f"{listed(record.id for record in best_first)}{', each with a time of its own' if parted else ''}"
    return Problem(table, "one acceleration of the vehicle, or conditions for each", found, advice)


def read_tables(
    paths: Sequence[Path],
    columns: Sequence[ColumnChoice],
    problems: list[Problem],
    *,
    together: bool,
    travel: Travel | None = None,
) -> _TableSet:
    """Read tables by their columns; a table of conditions must be readable, chosen columns there."""
    tables = _TableSet()
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


@dataclass(frozen=True, eq=False, slots=True)
class TableForm:
    """Tables with the same headers; the proposed mapping and first rows of the first."""

    names: tuple[str, ...]
    proposed: Mapping
    head: pd.DataFrame

    @property
    def columns(self) -> tuple[str, ...]:
        """The headers, in order."""
        return tuple(use.column for use in self.proposed.uses)

    def unit_of(self, columns: Sequence[str]) -> str | None:
        """The unit in the headers of these columns; None if they differ."""
        units = {use.unit for use in self.proposed.uses if use.column in columns}
        return units.pop() if len(units) == 1 else None

    def choices(
        self, picked: abc.Mapping[ColumnRole, Sequence[str]], units: abc.Mapping[ColumnRole, str | None]
    ) -> tuple[ColumnChoice, ...]:
        """Where columns picked for roles differ from the proposal; others are ignored."""
        role_of = {column: role for role in picked for column in picked[role]}
        choices = []
        for use in self.proposed.uses:
            role: ColumnRole = role_of.get(use.column, "ignored" if use.role in picked else use.role)
            unit = units.get(role)
            if role != use.role or (unit is not None and unit != use.unit):
                choices.append(ColumnChoice(use.column, role, unit))
        return tuple(choices)

    def nothing(self) -> tuple[ColumnChoice, ...]:
        """Choices that ignore every column."""
        return self.choices(dict.fromkeys(get_args(ColumnRole), ()), {})


def table_forms(paths: Sequence[Path]) -> tuple[TableForm, ...]:
    """Group tables by their headers; unreadable ones are skipped here, as reading them later reports why."""
    forms: dict[tuple[object, ...], TableForm] = {}
    names: dict[tuple[object, ...], list[str]] = {}
    for path in paths:
        try:
            sheets = read_sheets(path)
        except DataError:
            continue
        for sheet in sheets:
            key = (sheet.columns, sheet.units)
            names.setdefault(key, []).append(sheet.name)
            if key not in forms:
                head = sheet.cells.head(_HEAD).set_axis(list(sheet.columns), axis="columns")
                forms[key] = TableForm((), propose(sheet), head)
    return tuple(replace(form, names=tuple(names[key])) for key, form in forms.items())
