"""The tables of a source grouped by header, so that columns are assigned once for all tables that are alike."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import pandas as pd

from crashfuse.errors import DataError
from crashfuse.importing.joined_tables import ColumnChoice
from crashfuse.readers.tables import mapping as mappings
from crashfuse.readers.tables.mapping import ColumnRole, propose
from crashfuse.readers.tables.sheets import read_sheets

_HEAD = 3  # rows


@dataclass(frozen=True, eq=False, slots=True)
class TableForm:
    """Tables with the same headers: their names, and the proposed mapping and first rows of the first table."""

    names: tuple[str, ...]
    proposed: mappings.Mapping
    head: pd.DataFrame

    @property
    def columns(self) -> tuple[str, ...]:
        """The headers, in order."""
        return tuple(use.column for use in self.proposed.uses)

    def unit_of(self, columns: Sequence[str]) -> str | None:
        """The common unit of these columns according to their headers; None if they differ."""
        units = {use.unit for use in self.proposed.uses if use.column in columns}
        return units.pop() if len(units) == 1 else None

    def choices(
        self, picked: Mapping[ColumnRole, Sequence[str]], units: Mapping[ColumnRole, str | None]
    ) -> tuple[ColumnChoice, ...]:
        """The user's column assignments where they differ from the proposal.

        ``picked`` holds the columns chosen for each role on offer; a column proposed for such a role but not picked is
        ignored.
        """
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
