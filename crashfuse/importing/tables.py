"""Tables of a source together: pulses in some, conditions in others, joined by id."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import get_args

from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.formats.archive import shown
from crashfuse.formats.foreign import apply_conditions, apply_mapping
from crashfuse.formats.mapping import ColumnRole, propose
from crashfuse.formats.record import PartialCondition, Record
from crashfuse.formats.sheet import Sheet
from crashfuse.formats.sheets import read_sheets


@dataclass(frozen=True, slots=True)
class ColumnChoice:
    """What a user says of one column of a foreign table."""

    column: str
    role: ColumnRole
    unit: str | None = None

    @classmethod
    def parsed(cls, text: str) -> "ColumnChoice":
        """Read ``COLUMN=ROLE`` or ``COLUMN=ROLE:UNIT``, as in ``Zeit=time:ms``.

        Raises
        ------
        UsageError
            If the text is not of this form.
        """
        column, _, use = text.rpartition("=")
        name, _, unit = use.partition(":")
        role = next((known for known in get_args(ColumnRole) if known == name), None)
        if not column or role is None:
            roles = ", ".join(get_args(ColumnRole))
            raise UsageError(f"A column is mapped as COLUMN=ROLE or COLUMN=ROLE:UNIT, not {text!r}; roles are {roles}.")
        return cls(column, role, unit or None)


@dataclass(frozen=True)
class TableSet:
    """What several tables hold.

    Parameters
    ----------
    records : tuple of Record
    conditions : mapping of str to PartialCondition
        By id.
    neither : tuple of str
        A sentence for each table that holds neither.
    """

    records: tuple[Record, ...]
    conditions: Mapping[str, PartialCondition]
    neither: tuple[str, ...]

    def given_to(self, record: Record) -> Record:
        """Give a record the condition of its id, whatever the capitals; one without stays as it is."""
        known = self._by_id.get(record.id.casefold())
        if known is None:
            return record
        steps = (*record.steps, "Condition from the table of conditions.")
        return replace(record, condition=record.condition.overruled(known), steps=steps)

    def check_ids(self, ids: Sequence[str]) -> None:
        """Say if there are conditions, but for none of the records.

        Raises
        ------
        DataError
            If so: the ids are not the same in both.
        """
        if self.conditions and not {run_id.casefold() for run_id in ids} & self._by_id.keys():
            found = f"those of {_listed(list(self.conditions))}"
            raise DataError(Problem("conditions", f"conditions for {_listed(ids)}", found, "make the ids the same"))

    @cached_property
    def _by_id(self) -> dict[str, PartialCondition]:
        return {run_id.casefold(): condition for run_id, condition in self.conditions.items()}


def read_tables(
    paths: Sequence[Path], columns: Sequence[ColumnChoice], problems: list[Problem], *, together: bool
) -> TableSet:
    """Read tables, each taken for what its columns say.

    Parameters
    ----------
    paths : sequence of Path
    columns : sequence of ColumnChoice
        Overrule the proposal in every table that has such a column.
    problems : list of Problem
        What is wrong with each table is appended.
    together : bool
        Columns of one table are channels of one record.

    Raises
    ------
    UsageError
        If no table has a column that is mapped.
    """
    records: list[Record] = []
    conditions: dict[str, PartialCondition] = {}
    neither: list[str] = []
    there: set[str] = set()
    for path in paths:
        try:
            for sheet in read_sheets(path):
                there.update(sheet.columns)
                _sort_in(sheet, path, columns, together, records, conditions, neither)
        except DataError as error:
            problems.extend(error.problems)
    absent = [choice.column for choice in columns if choice.column not in there]
    if absent and not problems:
        raise UsageError(f"There is no column {_listed(absent)}; there are {_listed(sorted(there))}.")
    return TableSet(tuple(records), conditions, tuple(neither))


def _sort_in(
    sheet: Sheet,
    path: Path,
    columns: Sequence[ColumnChoice],
    together: bool,
    records: list[Record],
    conditions: dict[str, PartialCondition],
    neither: list[str],
) -> None:
    mapping = propose(sheet)
    for choice in columns:
        if choice.column in sheet.columns:
            mapping = mapping.overruled(choice.column, choice.role, choice.unit)
    if mapping.kind == "pulses":
        own_name = sheet.name.partition(": ")[2] or path.stem
        records.extend(apply_mapping(sheet, mapping, record_id=own_name, together=together))
    elif mapping.kind == "conditions":
        conditions.update(apply_conditions(sheet, mapping))
    else:
        neither.append(f"{sheet.name} with the columns {_listed(sheet.columns)}")


def _listed(names: Sequence[str]) -> str:
    text = ", ".join(shown(name, 40) for name in names[:12])
    return text + (f" and {len(names) - 12} more" if len(names) > 12 else "")
