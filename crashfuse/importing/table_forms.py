"""The tables of a source by their headers, so that what their columns are is said once for all that are alike."""

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
    """Tables with the same headers: their names; of the first, what its columns are taken for, and its first rows."""

    names: tuple[str, ...]
    proposed: mappings.Mapping
    head: pd.DataFrame

    @property
    def columns(self) -> tuple[str, ...]:
        """Headers, in their order."""
        return tuple(use.column for use in self.proposed.uses)

    def unit_of(self, columns: Sequence[str]) -> str | None:
        """The unit that all of these columns have, as far as their headers tell."""
        units = {use.unit for use in self.proposed.uses if use.column in columns}
        return units.pop() if len(units) == 1 else None

    def choices(
        self, picked: Mapping[ColumnRole, Sequence[str]], units: Mapping[ColumnRole, str | None]
    ) -> tuple[ColumnChoice, ...]:
        """What a user says of the columns, where it differs from the proposal.

        Picked are the columns of each role that was asked for: one that was proposed in such a role and is not picked
        is ignored.
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
        """Every column ignored."""
        return self.choices(dict.fromkeys(get_args(ColumnRole), ()), {})


def table_forms(paths: Sequence[Path]) -> tuple[TableForm, ...]:
    """Sort tables by their headers; those that cannot be read are passed over, for reading them says why."""
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
