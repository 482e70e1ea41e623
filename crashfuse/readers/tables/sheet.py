"""A table with its header and its units, and where in a grid of cells these are found.

The data begin where the numbers begin. The row above them is the header, or the row of units with the header above it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import Limits
from crashfuse.readers.unit_spelling import unit_named
from crashfuse.signals.pulse import FloatArray

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
    first_row : int
        Row of the file that the data begin in, counted from 1.
    steps : tuple of str
        What was found of the file's form.
    titles : tuple of str
        What stood above the headers, "" where nothing did.
    part_of : str
        Name of the table that this one was side by side with others in, unless titles name each as another test.
    """

    name: str
    columns: tuple[str, ...]
    units: tuple[str, ...]
    cells: pd.DataFrame
    decimal: str
    first_row: int
    steps: tuple[str, ...] = ()
    titles: tuple[str, ...] = ()
    part_of: str = ""

    def text(self, column: str) -> list[str]:
        """Cells of a column, without spaces around them."""
        return [str(cell).strip() for cell in self.cells.iloc[:, self.columns.index(column)]]

    def parsed(self, column: str) -> FloatArray:
        """A column as float64, NaN where a cell is no number."""
        cells = self.cells.iloc[:, self.columns.index(column)]
        plain = cells.str.replace(self.decimal, ".", regex=False) if self.decimal != "." else cells
        numbers: FloatArray = pd.to_numeric(plain, errors="coerce").to_numpy(np.float64, copy=True)
        return numbers

    def numbers(self, column: str) -> FloatArray:
        """A column as float64, NaN where a cell is empty; a DataError names a cell that holds no number."""
        numbers = self.parsed(column)
        if np.isfinite(numbers).all():
            return numbers
        cells = self.cells.iloc[:, self.columns.index(column)].str.strip()
        wrong = np.flatnonzero(
            ~np.isfinite(numbers) & (cells != "").to_numpy() & (cells.str.lower() != "nan").to_numpy()
        )
        if wrong.size:
            row = int(wrong[0])
            found, advice = repr(printable(cells.iloc[row], 40)), "correct the cell, or map the column otherwise"
            raise DataError(Problem(self.name, "a number", found, advice, printable(column), row + self.first_row))
        return numbers


@dataclass(frozen=True, slots=True)
class Header:
    """Where in a grid the data begin (from 0), and the headers, units and titles above them."""

    begin: int
    columns: tuple[str, ...]
    units: tuple[str, ...]
    titles: tuple[str, ...]

    @property
    def told(self) -> str:
        """What was taken for the header, for the user."""
        row_of_units = ", a row of units" if any(self.units) else ""
        names = ", ".join(printable(name, 40) for name in self.columns[:12]) + (" …" if len(self.columns) > 12 else "")
        return f"Data from row {self.begin + 1}{row_of_units}, columns: {names}."


def header_of(grid: Sequence[Sequence[str]], decimal: str, name: str) -> Header:
    """Where the data begin, and what stands above them."""
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
    header = _padded(above.pop(), width) if above and len(above[-1]) >= width - 1 else [""] * width
    titles = _padded(above[-1] if above else [], width)
    return Header(begin, _unique(header), *(tuple(cell.strip() for cell in row) for row in (units, titles)))


def sheet_of(name: str, header: Header, cells: pd.DataFrame, decimal: str, *form: str) -> Sheet:
    """A sheet with this header; the sentences on its form become its first steps."""
    steps = (*form, header.told)
    return Sheet(name, header.columns, header.units, cells, decimal, header.begin + 1, steps, header.titles)


def _first_data_row(grid: Sequence[Sequence[str]], decimal: str) -> int | None:
    """Where the largest and widest block of numbers begins: half of the cells in its rows at least, else any.

    Blocks before it are a preamble with numbers, unless a remark or a gap among the data is all that parts them.
    """
    for least in (0.5, 1e-9):
        blocks = _blocks(grid, decimal, least)
        if blocks:
            most = max(blocks, key=lambda block: block.numbers * len(block.numeric))
            return next(block.begin for block in blocks if block is most or block.goes_on_in(most, grid))
    return None


@dataclass(frozen=True, slots=True)
class _Block:
    """Rows with numbers that follow each other, and in which of their columns most cells are numbers."""

    begin: int
    end: int
    numbers: int
    numeric: tuple[bool, ...]

    def goes_on_in(self, other: "_Block", grid: Sequence[Sequence[str]]) -> bool:
        width = len(other.numeric)
        between = [sum(map(bool, row)) for row in grid[self.end : other.begin]]
        return self.numeric == other.numeric or (len(self.numeric) == width and max(between) < width - 1)


def _blocks(grid: Sequence[Sequence[str]], decimal: str, least: float) -> list[_Block]:
    """Blocks of at least five rows, or of fewer at the end of the grid; empty rows belong to them."""
    found: list[_Block] = []
    rows: list[list[bool | None]] = []
    begin = 0
    for number, row in enumerate([*grid, ["end"]]):
        cells = [is_number(cell, decimal) if cell.strip() else None for cell in row]
        filled = [cell for cell in cells if cell is not None]
        if len(filled) > 1 and sum(filled) >= least * len(filled):
            begin = begin if rows else number
            rows.append(cells)
        elif filled:
            if len(rows) >= _RUN or (rows and number == len(grid)):
                counts = [sum(cell is True for cell in column) for column in zip_longest(*rows)]
                found.append(_Block(begin, number, sum(counts), tuple(2 * count > len(rows) for count in counts)))
            rows = []
    return [block for block in found if block.begin < _LONGEST_PREAMBLE]


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
