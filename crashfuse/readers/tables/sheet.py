"""A table with header and units, and how these are located in a grid of cells.

The data start where the numbers start. The row above them is the header, or a row of units with the header above it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import Limits
from crashfuse.files.csv_output import original
from crashfuse.readers.unit_spelling import unit_named
from crashfuse.signals.pulse import FloatArray

SHEET_LIMITS = Limits(total_bytes=256 << 20, member_bytes=64 << 20, rows=2_000_000)
"""Size limits of a table."""

SAMPLE = 400
"""Rows examined to detect the layout of a table."""

_MOST_COLUMNS, _LONGEST_HEADER = 2000, 200
_LONGEST_PREAMBLE = 200
_RUN = 5  # rows of data
_NUMBER = {sign: re.compile(rf"[-+]?(\d+({re.escape(sign)}\d*)?|{re.escape(sign)}\d+)([eE][-+]?\d+)?") for sign in ".,"}


@dataclass(frozen=True, eq=False, slots=True)
class Sheet:
    """A table as found in a file; its cells are still text.

    Parameters
    ----------
    name : str
        Name of the file, and of the sheet if a workbook has several.
    columns, units : tuple of str
        Headers, made unique, and the cells of a row of units below them ("" if empty or missing).
    cells : DataFrame of str, shape (n_rows, n_columns)
    first_row : int
        Row of the file where the data start, counted from 1.
    steps : tuple of str
        Sentences on the detected file format.
    titles : tuple of str
        The cells above the headers, "" if empty or missing.
    part_of : str
        Name of the table that this one was split from, unless titles name each part as a separate test.
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
        """The cells of a column, stripped of surrounding spaces."""
        return [original(str(cell).strip()) for cell in self.cells.iloc[:, self.columns.index(column)]]

    def parsed(self, column: str) -> FloatArray:
        """A column as float64, NaN where a cell is not a number."""
        cells = self.cells.iloc[:, self.columns.index(column)]
        plain = cells.str.replace(self.decimal, ".", regex=False) if self.decimal != "." else cells
        numbers: FloatArray = pd.to_numeric(plain, errors="coerce").to_numpy(np.float64, copy=True)
        return numbers

    def numbers(self, column: str) -> FloatArray:
        """A column as float64, NaN where a cell is empty; a DataError names a cell that is not a number."""
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
    """The row of a grid where the data start (from 0), and the headers, units and titles above it."""

    begin: int
    columns: tuple[str, ...]
    units: tuple[str, ...]
    titles: tuple[str, ...]

    @property
    def told(self) -> str:
        """A sentence for the user on the detected header."""
        row_of_units = ", a row of units" if any(self.units) else ""
        names = ", ".join(printable(name, 40) for name in self.columns[:12]) + (" …" if len(self.columns) > 12 else "")
        return f"Data from row {self.begin + 1}{row_of_units}, columns: {names}."


def header_of(grid: Sequence[Sequence[str]], decimal: str, name: str) -> Header:
    """Locate the first data row of a grid and the headers, units and titles above it."""
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
    """A sheet with this header; the sentences in ``form`` become its first steps."""
    steps = (*form, header.told)
    return Sheet(name, header.columns, header.units, cells, decimal, header.begin + 1, steps, header.titles)


def _first_data_row(grid: Sequence[Sequence[str]], decimal: str) -> int | None:
    """The first row of the largest and widest block of rows with at least half of their cells numbers, else with any.

    Blocks before it are a preamble with numbers, unless only a remark or a gap in the data separates them from it.
    """
    for least in (0.5, 1e-9):
        blocks = _blocks(grid, decimal, least)
        if blocks:
            most = max(blocks, key=lambda block: block.numbers * len(block.numeric))
            return next(block.begin for block in blocks if block is most or block.goes_on_in(most, grid))
    return None


@dataclass(frozen=True, slots=True)
class _Block:
    """Consecutive rows with numbers; ``numeric`` marks the columns where most cells are numbers."""

    begin: int
    end: int
    numbers: int
    numeric: tuple[bool, ...]

    def goes_on_in(self, other: "_Block", grid: Sequence[Sequence[str]]) -> bool:
        width = len(other.numeric)
        between = [sum(map(bool, row)) for row in grid[self.end : other.begin]]
        return self.numeric == other.numeric or (len(self.numeric) == width and max(between) < width - 1)


def _blocks(grid: Sequence[Sequence[str]], decimal: str, least: float) -> list[_Block]:
    """The blocks of at least five rows, or fewer at the end of the grid; rows with gaps in them are part of a block."""
    found: list[_Block] = []
    rows: list[list[bool | None]] = []
    begin: int | None = None
    for number, row in enumerate([*grid, ["end"]]):
        cells = [is_number(cell, decimal) if cell.strip() else None for cell in row]
        filled = [cell for cell in cells if cell is not None]
        if len(filled) > 1 and sum(filled) >= least * len(filled):
            begin = number if begin is None else begin
            rows.append(cells)
        elif len(row) > 1 and filled == [True]:  # of two columns, one has a gap here
            begin = number if begin is None else begin
        elif filled:
            if begin is not None and (len(rows) >= _RUN or (rows and number == len(grid))):
                counts = [sum(cell is True for cell in column) for column in zip_longest(*rows)]
                found.append(_Block(begin, number, sum(counts), tuple(2 * count > len(rows) for count in counts)))
            rows, begin = [], None
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
        name = original(" ".join(cell.split()))[:_LONGEST_HEADER] or f"column {number}"
        while name in seen:
            name += f" ({number})"
        seen.add(name)
        names.append(name)
    return tuple(names)


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number with this decimal sign."""
    return _NUMBER[decimal].fullmatch(cell.strip()) is not None
