"""A table with header and units, and how these are located in a grid of cells.

The data start where the numbers start. The row above them is the header, or a row of units with the header above it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import Limits
from crashfuse.files.csv_output import original
from crashfuse.readers.tables.headers import use_of
from crashfuse.readers.unit_spelling import unit_named
from crashfuse.signals.pulse import FloatArray

SHEET_LIMITS = Limits(total_bytes=256 << 20, member_bytes=64 << 20, rows=2_000_000)
"""Size limits of a table."""

SAMPLE = 400
"""Rows examined to detect the layout of a table."""

_MOST_COLUMNS, _LONGEST_HEADER = 2000, 200
_LONGEST_PREAMBLE = 200
_RUN = 5  # rows of data
_MOST = 0.9
_GROUPED = {
    ".": r"[-+]?\d{1,3}(?:(?:,\d{3})+\.\d+|(?:,\d{3}){2,}|(?:['’ \u00a0\u202f]\d{3})+(?:\.\d+)?)",
    ",": r"[-+]?\d{1,3}(?:(?:\.\d{3})+,\d+|(?:\.\d{3}){2,}|(?:['’ \u00a0\u202f]\d{3})+(?:,\d+)?)",
}
"""Numbers with thousands separators that can be nothing else, by the decimal sign."""
_NUMBER = {
    sign: re.compile(rf"[-+]?(\d+({re.escape(sign)}\d*)?|{re.escape(sign)}\d+)([eE][-+]?\d+)?|{grouped}")
    for sign, grouped in _GROUPED.items()
}
_UNNAMED = re.compile(r"column \d+")


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
    origin : str
        The line above it that says that a program computed it; empty if there is none.
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
    origin: str = ""

    def title(self, column: str) -> str:
        """The title above a column, or above the nearest one to its left that has one."""
        return next(filter(None, reversed(self.titles[: self.columns.index(column) + 1])), "")

    @property
    def is_titled(self) -> bool:
        """Whether the titles are those of columns, not one heading of the whole table."""
        return any(self.titles[1:])

    def has_row_names(self, column: str) -> bool:
        """Whether a column is the first, and has no header although others have one."""
        return column == self.columns[0] and is_unnamed(column) and not all(map(is_unnamed, self.columns))

    def filled(self, column: str) -> int:
        """The number of cells of a column with content."""
        return int((self.cells.iloc[:, self.columns.index(column)] != "").sum())

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
            cell = cells.iloc[row]
            found, advice = repr(printable(cell, 40)), "correct the cell, or map the column otherwise"
            if re.fullmatch(_GROUPED[self.decimal], cell):
                found, advice = f"{found}, with thousands separators", "export without them"
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
    above = [_trimmed(row) for row in grid[:begin] if any(cell.strip() for cell in row)]
    width, filled = len(grid[begin]), max(len(_trimmed(row)[: len(grid[begin])]) for row in grid[begin:])
    if (widest := max(width, len(above[-1]) if above else 0)) > _MOST_COLUMNS:
        raise DataError(Problem(name, f"at most {_MOST_COLUMNS} columns", f"{widest}", "export fewer columns"))
    units: list[str] = []
    if above and _is_units(above[-1], width) and len(above) > 1:
        units = above.pop()
    is_header = above and (len(above[-1]) >= max(filled - 1, 2) or use_of(above[-1][0], "").role == "time")
    names = above.pop() if is_header else []
    if len(names) == filled - 1:
        names = _aligned(names, grid[begin:], decimal, name)
    width = max(width, len(names))
    titles = above[-1] if above else []
    return Header(
        begin,
        unique(_padded(names, width)),
        *(tuple(cell.strip() for cell in _padded(row, width)) for row in (units, titles)),
    )


def sheet_of(name: str, header: Header, cells: pd.DataFrame, decimal: str, *form: str) -> Sheet:
    """A sheet with this header; the sentences in ``form`` become its first steps.

    Left out are columns without header and content, as a delimiter at the end of each row makes them, and a first one
    that numbers the rows.
    """
    unnamed = [not title and is_unnamed(column) for column, title in zip(header.columns, header.titles, strict=True)]
    numbered = unnamed[0] and not all(unnamed) and counts(cells.iloc[:SAMPLE, 0])
    kept = [
        number
        for number, without in enumerate(unnamed)
        if not (without and ((number == 0 and numbered) or not (cells.iloc[:, number] != "").any()))
    ]
    columns, units, titles = (
        tuple(row[number] for number in kept) for row in (header.columns, header.units, header.titles)
    )
    steps = [*form, replace(header, columns=columns, units=units, titles=titles).told]
    if numbered:
        steps.append("Left out: the first column, which numbers the rows.")
    return Sheet(name, columns, units, cells.iloc[:, kept], decimal, header.begin + 1, tuple(steps), titles)


def counts(cells: pd.Series) -> bool:
    """Whether a column counts its rows: whole numbers, one more in each row."""
    if len(cells) < _RUN or not cells.iloc[0].strip().isdecimal():
        return False
    if not cells.str.fullmatch(r"\s*\d{1,9}\s*").all():
        return False
    return bool((np.diff(cells.str.strip().astype(np.int64)) == 1).all())


def is_unnamed(column: str) -> bool:
    """Whether a column has the name that is given to one without a header."""
    return _UNNAMED.fullmatch(column) is not None


def _aligned(names: list[str], data: Sequence[Sequence[str]], decimal: str, name: str) -> list[str]:
    """Names of columns that are one fewer than the columns, as R writes them above row names; "" for the one without.

    They are those of the last columns if the first is one of row names or the clock; of the first ones if the last has
    no numbers, or if there is but one. Otherwise nobody can tell.
    """
    if len(names) == 1:
        return [*names, ""]
    rows = [[*row, *[""] * (len(names) + 1)] for row in data if any(row)]
    columns = [pd.Series([row[number] for row in rows], dtype=str) for number in range(len(names) + 1)]

    def increases(number: int) -> bool:
        values = pd.to_numeric(columns[number].str.replace(decimal, ".", regex=False), errors="coerce")
        return bool((np.diff(values.dropna()) > 0).all()) and bool(values.notna().mean() > _MOST)

    if sum(is_number(cell, decimal) for cell in columns[-1]) < _MOST * len(rows):
        return [*names, ""]
    clocks = [number for number, text in enumerate(names) if use_of(text, "").role == "time"]
    has_row_names = counts(columns[0]) or not any(is_number(cell, decimal) for cell in columns[0])
    if all(increases(number + 1) for number in clocks) and (clocks or has_row_names or increases(0)):
        return ["", *names]
    found = f"{len(names)} names above {len(names) + 1} columns of numbers"
    raise DataError(Problem(name, "a name for each column", found, "name all columns, or leave out what has no name"))


def _first_data_row(grid: Sequence[Sequence[str]], decimal: str) -> int | None:
    """The first row of the largest and widest block of rows with at least half of their cells numbers, else with any.

    Blocks before it are a preamble with numbers, unless only a remark or a gap in the data separates them from it.
    """
    for least in (0.5, 1e-9):
        blocks = _blocks(grid, decimal, least)
        if blocks:
            most = max(blocks, key=lambda block: block.numbers * len(block.numeric))
            begin = next(block.begin for block in blocks if block is most or block.goes_on_in(most, grid))
            return begin + (use_of(grid[begin][0], "").role == "time")  # a header whose other names are numbers
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


def _trimmed(row: Sequence[str]) -> list[str]:
    """A row without the empty cells at its end."""
    end = len(row)
    while end and not row[end - 1].strip():
        end -= 1
    return list(row[:end])


def _padded(row: Sequence[str], width: int) -> list[str]:
    return [*row, *[""] * width][:width]


def unique(header: Sequence[str]) -> tuple[str, ...]:
    """Headers that tell their columns apart; those without one are numbered."""
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
