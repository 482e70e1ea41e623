"""A table with its header and its units, and where in a grid of cells these are found.

The data begin where the numbers begin. The row above them is the header, or the row of units with the header above it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem
from crashfuse.formats.archive import Limits, shown
from crashfuse.formats.spelling import unit_named
from crashfuse.pulse import FloatArray

SHEET_LIMITS = Limits(total_bytes=256 << 20, member_bytes=64 << 20, rows=2_000_000)
"""Sizes beyond which a table is refused."""

SAMPLE = 400
"""Rows that are looked at to find out what a table is like."""

_MOST_COLUMNS, _LONGEST_HEADER = 2000, 200
_LONGEST_PREAMBLE = 200
_RUN = 5  # rows of data
_NUMBER = {sign: re.compile(rf"[-+]?(\d+({re.escape(sign)}\d*)?|{re.escape(sign)}\d+)([eE][-+]?\d+)?") for sign in ".,"}


@dataclass(frozen=True, eq=False, slots=True)
class Sheet:
    """A table as it was found; its cells are text still.

    Parameters
    ----------
    name : str
        Of the file, with the sheet's in a workbook of several.
    columns, units : tuple of str
        Headers, made unique, and what stood in a row of units below them ("" where nothing did).
    cells : DataFrame of str, shape (n_rows, n_columns)
    decimal : {".", ","}
    first_row : int
        Row of the file that the data begin in, counted from 1.
    steps : tuple of str
        What was found of the file's form.
    """

    name: str
    columns: tuple[str, ...]
    units: tuple[str, ...]
    cells: pd.DataFrame
    decimal: str
    first_row: int
    steps: tuple[str, ...] = ()

    def text(self, column: str) -> list[str]:
        """Cells of a column, without spaces around them."""
        return [str(cell).strip() for cell in self.cells.iloc[:, self.columns.index(column)]]

    def numbers(self, column: str) -> FloatArray:
        """A column as float64, NaN where a cell is empty.

        Raises
        ------
        DataError
            If a cell holds something that is no number.
        """
        cells = self.cells.iloc[:, self.columns.index(column)]
        plain = cells.str.replace(self.decimal, ".", regex=False) if self.decimal != "." else cells
        numbers: FloatArray = pd.to_numeric(plain, errors="coerce").to_numpy(np.float64, copy=True)
        if np.isfinite(numbers).all():
            return numbers
        cells = cells.str.strip()
        wrong = np.flatnonzero(
            ~np.isfinite(numbers) & (cells != "").to_numpy() & (cells.str.lower() != "nan").to_numpy()
        )
        if wrong.size:
            row = int(wrong[0])
            found, advice = repr(shown(cells.iloc[row], 40)), "correct the cell, or map the column otherwise"
            raise DataError(Problem(self.name, "a number", found, advice, shown(column), row + self.first_row))
        return numbers


def header_of(grid: Sequence[Sequence[str]], decimal: str, name: str) -> tuple[int, tuple[str, ...], tuple[str, ...]]:
    """Where the data begin, and the headers and units above them."""
    begin = _first_data_row(grid, decimal)
    if begin is None:
        expected, found = f"rows of numbers in the first {_LONGEST_PREAMBLE} rows", "none"
        raise DataError(Problem(name, expected, found, "export it again with one header"))
    width = max(len(grid[begin]), 1)
    if width > _MOST_COLUMNS:
        raise DataError(Problem(name, f"at most {_MOST_COLUMNS} columns", f"{width}", "export fewer columns"))
    above = [list(row) for row in grid[:begin] if any(cell.strip() for cell in row)]
    units = [""] * width
    if above and _is_units(above[-1], width) and len(above) > 1:
        units = _padded(above.pop(), width)
    header = _padded(above[-1], width) if above and len(above[-1]) >= width - 1 else [""] * width
    return begin, _unique(header), tuple(cell.strip() for cell in units)


def _first_data_row(grid: Sequence[Sequence[str]], decimal: str) -> int | None:
    """The first row that begins a run of rows with numbers: half their cells at least, else any."""
    filled = [[cell for cell in row if cell.strip()] for row in grid]
    shares = [  # None: an empty row
        None if not cells else sum(is_number(cell, decimal) for cell in cells) / len(cells) if len(cells) > 1 else 0.0
        for cells in filled
    ]
    for least in (0.5, 1e-9):
        for row, share in enumerate(shares[:_LONGEST_PREAMBLE]):
            run = [s for s in shares[row : row + _RUN] if s is not None]
            if share is not None and min(run) >= least:
                return row
    return None


def _is_units(row: Sequence[str], width: int) -> bool:
    cells = [cell.strip() for cell in row]
    named = sum(unit_named(cell) is not None for cell in cells)
    blank = sum(cell.strip("[]()- ") == "" for cell in cells)
    return len(cells) <= width and named > 0 and 2 * (named + blank) >= len(cells) and named + blank >= len(cells) - 1


def _padded(row: Sequence[str], width: int) -> list[str]:
    return [*row, *[""] * width][:width]


def _unique(header: Sequence[str]) -> tuple[str, ...]:
    names: list[str] = []
    seen: set[str] = set()
    for number, cell in enumerate(header, start=1):
        name = " ".join(cell.split())[:_LONGEST_HEADER] or f"column {number}"
        while name in seen:
            name += f" ({number})"
        seen.add(name)
        names.append(name)
    return tuple(names)


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number under this decimal sign."""
    return _NUMBER[decimal].fullmatch(cell.strip()) is not None


def header_told(columns: Sequence[str], units: Sequence[str], begin: int) -> str:
    """What was taken for the header, for the user."""
    row_of_units = ", a row of units" if any(units) else ""
    shown_names = ", ".join(shown(name, 40) for name in columns[:12]) + (" …" if len(columns) > 12 else "")
    return f"Data from row {begin + 1}{row_of_units}, columns: {shown_names}."
