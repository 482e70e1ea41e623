"""Condition tables: ``tests.csv`` and ``cae.csv``, one row a test or run."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem
from crashfuse.pulse import Condition, FloatArray
from crashfuse.units import MASS, SPEED

_QUANTITIES: dict[str, Mapping[str, float]] = {"speed": SPEED, "front_weight": MASS, "rear_weight": MASS}
_MOST_PROBLEMS = 20  # of one kind in one file: the rest is counted, not listed


@dataclass(frozen=True, slots=True)
class ConditionTable:
    """The rows of a condition table; row ``i`` of the file's data is at index ``i``."""

    ids: tuple[str, ...]
    conditions: tuple[Condition, ...]


def read_conditions(path: Path, *, standstill_allowed: bool, problems: list[Problem]) -> ConditionTable | None:
    """Read a condition table, converting units by the endings of the column names.

    Parameters
    ----------
    path : Path
    standstill_allowed : bool
        Whether a speed of 0 is a valid condition (a CAE run may start there, a test may not).
    problems : list of Problem
        What is wrong is appended here.

    Returns
    -------
    ConditionTable or None
        None if the table cannot be used.
    """
    before = len(problems)
    frame = _read_text(path, problems)
    if frame is None:
        return None
    columns = {
        name: find_column(frame.columns, name, units, path.name, problems) for name, units in _QUANTITIES.items()
    }
    if "id" not in frame.columns:
        problems.append(
            Problem(path.name, "a column id", f"the columns {_listed(frame.columns)}", "name each row in a column id")
        )
    if len(problems) > before:
        return None
    ids = frame["id"].str.strip()
    _check_ids(ids, path.name, problems)
    values = {}
    for name, found in columns.items():
        assert found is not None  # noqa: S101 - find_column has reported it otherwise
        column, factor = found
        smallest_allowed = standstill_allowed and name == "speed"
        values[name] = factor * _numbers(frame[column], column, path.name, smallest_allowed, problems)
    if len(problems) > before:
        return None
    used = {"id", *(column for column, _ in filter(None, columns.values()))}
    extra = [str(column) for column in frame.columns if column not in used]
    factors = [tuple(zip(extra, row, strict=True)) for row in frame[extra].to_numpy(dtype=str).tolist()]
    rows = zip(values["speed"], values["front_weight"], values["rear_weight"], factors, strict=True)
    conditions = tuple(Condition(float(v), float(front), float(rear), fac) for v, front, rear, fac in rows)
    return ConditionTable(tuple(ids), conditions)


def find_column(
    columns: "pd.Index[str]", quantity: str, units: Mapping[str, float], where: str, problems: list[Problem]
) -> tuple[str, float] | None:
    """Find the one column of a quantity and its factor to SI by its ending; a problem is appended otherwise."""
    wanted = {f"{quantity}_{unit}": factor for unit, factor in units.items()}
    found = [str(column) for column in columns if column in wanted]
    if len(found) == 1:
        return found[0], wanted[found[0]]
    expected = f"one column {' or '.join(wanted)}"
    if found:
        problems.append(Problem(where, expected, _listed(found), "keep one of them"))
        return None
    alike = [str(column) for column in columns if str(column).startswith(quantity)]
    shown = _listed(alike) if alike else f"the columns {_listed(columns)}"
    problems.append(Problem(where, expected, shown, "let the column's name end in its unit"))
    return None


def not_a_number(cells: pd.Series, column: str, where: str, first_row: int, problems: list[Problem]) -> FloatArray:
    """Convert text cells to float64, appending a problem for each cell that is no finite number."""
    numbers: FloatArray = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(numbers))
    for index in bad[:_MOST_PROBLEMS]:
        cell = cells.iloc[index]
        text = "" if pd.isna(cell) else str(cell).strip()
        found = repr(text) if text else "an empty cell"
        problems.append(Problem(where, "a number", found, "correct the cell", column, int(index) + first_row))
    _count_rest(bad.size, "cells that are no number", where, column, problems)
    return numbers


def read_candidates(path: Path) -> tuple[Condition, ...]:
    """Read conditions that could be tested, from a table of the form of ``tests.csv``.

    Raises
    ------
    DataError
        With every problem of the table.
    """
    problems: list[Problem] = []
    table = read_conditions(path, standstill_allowed=False, problems=problems)
    if table is None or problems:
        raise DataError(problems)
    return table.conditions


def _read_text(path: Path, problems: list[Problem]) -> pd.DataFrame | None:
    if not path.is_file():
        problems.append(Problem(path.name, "this file", "no such file", "add it to the campaign folder"))
        return None
    try:
        frame = pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8-sig", skipinitialspace=True)
    except pd.errors.EmptyDataError:
        frame = pd.DataFrame()
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        found = " ".join(str(error).split())
        problems.append(Problem(path.name, "a comma-separated table in UTF-8", found, "export it again as CSV"))
        return None
    if frame.empty:
        problems.append(Problem(path.name, "a header and at least one row", "an empty table", "add the rows"))
        return None
    frame.columns = frame.columns.str.strip()
    return frame


def _check_ids(ids: pd.Series, where: str, problems: list[Problem]) -> None:
    for index in np.flatnonzero(ids.str.contains(r"[/\\:\x00]|^\.*$", regex=True))[:_MOST_PROBLEMS]:
        found = repr(ids.iloc[index])
        problems.append(Problem(where, "an id that can name a file", found, "rename it", "id", int(index) + 2))
    repeated = np.flatnonzero(ids.duplicated())
    for index in repeated[:_MOST_PROBLEMS]:
        found = f"{ids.iloc[index]!r} a second time"
        problems.append(Problem(where, "each id once", found, "rename or remove the row", "id", int(index) + 2))
    _count_rest(repeated.size, "repeated ids", where, "id", problems)


def _numbers(cells: pd.Series, column: str, where: str, zero_allowed: bool, problems: list[Problem]) -> FloatArray:
    numbers = not_a_number(cells, column, where, 2, problems)
    low = np.flatnonzero((numbers < 0) if zero_allowed else (numbers <= 0))
    for index in low[:_MOST_PROBLEMS]:
        expected = "0 or above" if zero_allowed else "a number above 0"
        problems.append(Problem(where, expected, cells.iloc[index], "correct the cell", column, int(index) + 2))
    _count_rest(low.size, "numbers that are too low", where, column, problems)
    return numbers


def _count_rest(count: int, what: str, where: str, column: str, problems: list[Problem]) -> None:
    if count > _MOST_PROBLEMS:
        found = f"{count - _MOST_PROBLEMS} more {what}"
        problems.append(Problem(where, "none", found, "correct them too", column))


def _listed(names: object) -> str:
    shown = [str(name) for name in names]  # type: ignore[attr-defined]
    return ", ".join(shown[:12]) + (f" and {len(shown) - 12} more" if len(shown) > 12 else "")
