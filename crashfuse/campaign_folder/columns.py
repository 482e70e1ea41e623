"""Columns of campaign tables: lookup by quantity and unit, and a check of each cell."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from crashfuse.errors import Problem, printable
from crashfuse.signals.pulse import FloatArray

MOST_PROBLEMS = 20
"""Problems listed per kind and column; the rest are only counted."""

RowNumbers = npt.NDArray[np.integer[Any]]


def find_column(
    columns: Sequence[str], quantity: str, units: Mapping[str, float], where: str, problems: list[Problem]
) -> tuple[str, float] | None:
    """Find the one column of a quantity and, from its name's ending, its factor to SI; append a problem otherwise."""
    wanted = {f"{quantity}_{unit}": factor for unit, factor in units.items()}
    found = [column for column in columns if column in wanted]
    if len(found) == 1:
        return found[0], wanted[found[0]]
    expected = f"one column {' or '.join(wanted)}"
    if found:
        problems.append(Problem(where, expected, listed(found), "keep one of them"))
        return None
    alike = [column for column in columns if column.startswith(quantity)]
    if alike:
        problems.append(Problem(where, expected, listed(alike), "let the column's name end in its unit"))
    else:
        problems.append(Problem(where, expected, f"the columns {listed(columns)}", "add the column"))
    return None


def not_a_number(
    cells: pd.Series, column: str, where: str, rows: RowNumbers, problems: list[Problem], largest: float
) -> FloatArray:
    """Convert cells to float64; a cell that is not a number, or is beyond ``largest``, is a problem and becomes NaN.

    Each such cell is a separate problem, except that consecutive empty cells are reported together.
    """
    numbers = _as_numbers(cells)
    bad = np.flatnonzero(~(np.abs(numbers) <= largest))
    wrong, rows_of = cells.iloc[bad], rows[bad]
    empty = _are_empty(wrong)
    starts = np.flatnonzero(np.r_[True, (np.diff(rows_of) > 1) | ~empty[1:] | ~empty[:-1]][: bad.size])
    stops = np.r_[starts[1:], bad.size][:MOST_PROBLEMS]
    for start, stop in zip(starts, stops, strict=False):
        row, last = int(rows_of[start]), int(rows_of[stop - 1])
        expected = f"a number up to {largest:.3g}" if np.isfinite(numbers[bad[start]]) else "a number"
        found, advice = repr(printable(str(wrong.iloc[start]).strip(), 60)), "correct the cell"
        if empty[start]:
            found, advice = "an empty cell", "fill it in"
        if stop - start > 1:
            found, advice = f"rows {row}–{last}, empty", "fill them in"
        problems.append(Problem(where, expected, found, advice, column, row))
    count_rest(bad.size, int(stops[-1]), "cells that are no number", where, column, problems)
    numbers[bad] = np.nan
    return numbers


def count_rest(count: int, told: int, what: str, where: str, column: str, problems: list[Problem]) -> None:
    """Append a problem with the count of those that were not listed, if any."""
    if count > told:
        found = f"{count - told} more {what}" if count - told > 1 else f"1 more of the {what}"
        problems.append(Problem(where, "none", found, "correct them too", column))


def listed(names: Iterable[str]) -> str:
    """The names of the columns as text, a dozen at most."""
    shown = [printable(name, 40) for name in names]
    return ", ".join(shown[:12]) + (f" and {len(shown) - 12} more" if len(shown) > 12 else "")


def _are_empty(cells: pd.Series) -> npt.NDArray[np.bool_]:
    if isinstance(cells.dtype, pd.CategoricalDtype):  # strip each distinct text only once
        of_texts = _are_empty(pd.Series(cells.cat.categories, dtype=cells.cat.categories.dtype))
        by_code: npt.NDArray[np.bool_] = np.append(of_texts, True)[cells.cat.codes]
        return by_code
    return np.array([pd.isna(cell) or (isinstance(cell, str) and not cell.strip()) for cell in cells], dtype=bool)


def _as_numbers(cells: pd.Series) -> FloatArray:
    if isinstance(cells.dtype, pd.CategoricalDtype):  # text in Parquet
        values = _as_numbers(pd.Series(cells.cat.categories))
        by_code: FloatArray = np.append(values, np.nan)[cells.cat.codes]
        return by_code
    if pd.api.types.is_bool_dtype(cells.dtype):
        return np.full(len(cells), np.nan)
    return np.array(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
