"""A table with header and units, how these are located in a grid of cells, and the tables in workbooks.

The data start where the numbers start. The row above them is the header, or a row of units with the header above it;
above that are titles of columns, or lines about all of them. A workbook (Excel 2007 and later) is an untrusted zip of
XML: sizes and elements are counted before it is parsed.
"""

import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple, Self
from zipfile import BadZipFile, is_zipfile

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem, printable, refusal, refuse_if
from crashfuse.files.archive import Budget, Limits, Member, zip_members
from crashfuse.files.csv_text import original
from crashfuse.readers.table_headers import Heading, is_key, listed_channels, named_above
from crashfuse.readers.vocabulary import statement_of_simulation, unit_named
from crashfuse.signals.pulse import FloatArray

SHEET_LIMITS = Limits(total_bytes=256 << 20, member_bytes=64 << 20, rows=2_000_000)
SAMPLE = 400  # rows examined to detect the layout of a table

_MOST_COLUMNS, _LONGEST_HEADER, _LONGEST_PREAMBLE = 2000, 200, 200
_RUN = 5  # rows of data
_HEADER_ROWS = 3  # names, units and what else may stand between them and the data
_MOST = 0.9
_GROUPED = {
    ".": r"[-+]?\d{1,3}(?:(?:,\d{3})+\.\d+|(?:,\d{3}){2,}|(?:['’ \u00a0\u202f]\d{3})+(?:\.\d+)?)",
    ",": r"[-+]?\d{1,3}(?:(?:\.\d{3})+,\d+|(?:\.\d{3}){2,}|(?:['’ \u00a0\u202f]\d{3})+(?:,\d+)?)",
}  # numbers with thousands separators that can be nothing else, by the decimal sign
_NUMBER = {
    sign: re.compile(rf"[-+]?(\d+({re.escape(sign)}\d*)?|{re.escape(sign)}\d+)([eE][-+]?\d+)?|{grouped}")
    for sign, grouped in _GROUPED.items()
}
_QUANTITY = re.compile(r"(?<!\w)\d+(?:[.,]\d+)?\s*([^\s;,)]+)")
_UNNAMED = re.compile(r"column \d+")
_MOST_CELLS, _MOST_CELLS_IN_ALL, _MOST_SHEETS = 500_000, 2_000_000, 500
_AS_CSV = "save the sheet as CSV"
_MOST_MARKS = {"xl/worksheets/": 4_000_000, "": 500_000}  # angle brackets, or equality signs, in a part
_LONGEST_TAG = 50_000  # bytes; a parser that waits for its end begins anew with each block
_ENDLESS = re.compile(rb"<[^<>]{%d}" % _LONGEST_TAG)
_FOREIGN = re.compile(rb"""<!DOCTYPE|\0|<\?xml[^>]*encoding\s*=\s*["'](?!utf-8|us-ascii)""", re.IGNORECASE)
_AGAIN = "save it again"
_NO_VALUE = re.compile(rb"<f\b[^<]*(?:/>|</f>)\s*(?:</c>|<v\s*/>|<v></v>)")


@dataclass(frozen=True, eq=False, slots=True)
class Sheet:
    """A table as found in a file; its cells are still text."""

    name: str  # of the file, and of the sheet if a workbook has several
    columns: tuple[str, ...]  # headers, made unique
    units: tuple[str, ...]  # the cells of a row of units below the headers, empty if there is none
    cells: pd.DataFrame
    decimal: str
    first_row: int  # of the data, counted from 1
    steps: tuple[str, ...] = ()
    titles: tuple[tuple[str, ...], ...] = ()  # rows of cells above the headers, the lowest first
    heading: tuple[str, ...] = ()  # what lines above the table name all its curves
    part_of: str = ""  # the table that it was split from, unless titles name each part as a test of its own
    origin: str = ""  # the line above it that says that a program computed it

    def of_columns(self, numbers: Sequence[int]) -> Self:
        """The sheet with some of its columns, by their numbers."""
        rows = (self.columns, self.units, *self.titles)
        columns, units, *titles = (tuple(row[number] for number in numbers) for row in rows)
        cells = self.cells.iloc[:, list(numbers)]
        return replace(self, columns=columns, units=units, titles=tuple(titles), cells=cells)

    def column(self, name: str) -> pd.Series:
        """The cells below a header."""
        return self.cells.iloc[:, self.columns.index(name)]

    def titles_of(self, column: str) -> tuple[str, ...]:
        """The titles above a column, or above the nearest one to its left that has one."""
        before = [row[: self.columns.index(column) + 1] for row in self.titles]
        return tuple(filter(None, (next(filter(None, reversed(cells)), "") for cells in before)))

    def said_of(self, column: str) -> tuple[str, ...]:
        """All that names a column: its header, titles, lines above the table, and the name of the sheet."""
        sheet = _without_quantities(self.name.partition(": ")[2])
        return (column, *self.titles_of(column), *self.heading, *filter(None, [sheet]))

    def has_row_names(self, column: str) -> bool:
        """Whether a column is the first, and has no header although others have one."""
        return column == self.columns[0] and is_unnamed(column) and not all(map(is_unnamed, self.columns))

    def filled(self, column: str) -> int:
        """The number of cells of a column with content."""
        return int((self.column(column) != "").sum())

    def text(self, column: str) -> list[str]:
        """The cells of a column, stripped of surrounding spaces."""
        return [original(str(cell).strip()) for cell in self.column(column)]

    def parsed(self, column: str) -> FloatArray:
        """A column as float64, NaN where a cell is not a number."""
        cells = self.column(column)
        plain = cells.str.replace(self.decimal, ".", regex=False) if self.decimal != "." else cells
        numbers: FloatArray = pd.to_numeric(plain, errors="coerce").to_numpy(np.float64, copy=True)
        return numbers

    def numbers(self, column: str) -> FloatArray:
        """A column as float64, NaN where a cell is empty; a DataError names a cell that is not a number."""
        numbers = self.parsed(column)
        if np.isfinite(numbers).all():
            return numbers
        cells = self.column(column).str.strip()
        wrong = np.flatnonzero(~np.isfinite(numbers) & ~cells.str.lower().isin(["", "nan"]).to_numpy())
        for row in wrong[:1].tolist():
            found, advice = repr(printable(cells.iloc[row], 40)), "correct it, without thousands separators"
            raise refusal(self.name, "a number", found, advice, printable(column), row + self.first_row)
        return numbers


class Header(NamedTuple):
    """The row of a grid where the data start (from 0), and the headers, units, titles and other lines above it."""

    begin: int
    columns: tuple[str, ...]
    units: tuple[str, ...]
    titles: tuple[tuple[str, ...], ...] = ()
    lines: tuple[str, ...] = ()


def header_of(grid: Sequence[Sequence[str]], decimal: str, name: str, lines: Sequence[str] = ()) -> Header:
    """Locate the first data row of a grid and what stands above it; ``lines`` are its rows as written, if text."""
    begin = _first_data_row(grid, decimal)
    if begin is None:
        expected = f"rows of numbers in the first {_LONGEST_PREAMBLE} rows"
        raise refusal(name, expected, "none", "export it with one header")
    lines = lines or ["\t".join(filter(None, row)) for row in grid[: begin + 1]]
    rows = zip(grid[:begin], lines, strict=False)
    above = [(_trimmed(row), line) for row, line in rows if any(cell.strip() for cell in row)]
    width, filled = len(grid[begin]), max(len(_trimmed(row)[: len(grid[begin])]) for row in grid[begin:])
    widest = max(width, *(len(row) for row, _ in above[-1:]), 0)
    refuse_if(widest > _MOST_COLUMNS, name, f"at most {_MOST_COLUMNS} columns", f"{widest}", "export fewer")
    index = above.pop()[0] if _names_an_index([row for row, _ in above], filled) else []
    units = _popped_units(above, width)
    last = above[-1][0] if above else []
    is_header = above and (len(last) >= max(filled - 1, 2) or Heading(last[0]).use.role == "time")
    header, header_line = above.pop() if is_header else ([], "")
    names = [*index, *header[len(index) :]]
    if len(names) == filled - 1:
        names = _aligned(names, grid[begin:], decimal, name)
    width, has_prose = max(width, len(names)), ", " not in header_line + lines[begin]
    titles, rest = list[list[str]](), list[str]()
    for place, (row, line) in enumerate(above, 1):
        is_prose = has_prose and ", " in line and '"' not in line
        if not is_prose and _is_of_titles(row, width, is_last=place == len(above)):
            titles.insert(0, ["" if _is_value(cell) else _without_quantities(cell) for cell in row])
            rest += [line] if width == 2 else []
        else:
            rest.append(line)
    if listed := listed_channels(rest, width):
        titles.append([listed.get(number, "") for number in range(width)])
    names, units, *titles = ([*row, *[""] * width][:width] for row in (names, units, *titles))
    return Header(begin, unique(names), tuple(map(str.strip, units)), tuple(map(tuple, titles)), tuple(rest))


def _names_an_index(above: Sequence[Sequence[str]], width: int) -> bool:
    # one name below those of the other columns, as pandas writes it
    if len(above) < 2 or len(above[-1]) != 1 or not 1 < len(above[-2]) <= width:
        return False
    is_free = not above[-2][0].strip() or Heading(above[-1][0]).use.role == "time"
    return is_free and not any(_is_value(cell) for cell in above[-2][1:])


def _popped_units(above: list[tuple[list[str], str]], width: int) -> list[str]:
    for place in range(len(above) - 1, max(len(above) - _HEADER_ROWS, 0 if len(above) > 1 else 1) - 1, -1):
        row = above[place][0]
        is_near = place == len(above) - 1 or any(unit_named(cell, "acceleration") for cell in row)
        if is_near and _is_units(row, width):
            return above.pop(place)[0]
    return []


def _is_of_titles(row: Sequence[str], width: int, *, is_last: bool) -> bool:
    if all(map(_is_value, row[1:])) or len(row) > width or all(map(is_unnamed, row)):
        return False
    return width > 2 or not row[0] or Heading(row[0]).use.role == "time" or (is_last and not is_key(row[0]))


def _is_value(cell: str) -> bool:
    return re.search(r"[^\W\d_]", _without_quantities(cell)) is None


def _without_quantities(text: str) -> str:
    return _QUANTITY.sub(lambda match: "" if unit_named(match[1]) else match[0], _in_one_line(text)).strip()


def _in_one_line(cell: str) -> str:
    return " ".join(cell.replace("_x000D_", " ").split())


def sheet_of(name: str, header: Header, cells: pd.DataFrame, decimal: str, *form: str) -> Sheet:
    """A sheet without idle columns and row numbers; the sentences in ``form`` become its first steps."""
    titled = [any(row[number] for row in header.titles) for number in range(len(header.columns))]
    unnamed = [not title and is_unnamed(column) for column, title in zip(header.columns, titled, strict=True)]
    numbered = unnamed[0] and not all(unnamed) and numbers_rows(cells.iloc[:SAMPLE, 0])

    def is_idle(number: int) -> bool:
        return unnamed[number] and ((number == 0 and numbered) or not (cells.iloc[:, number] != "").any())

    kept = [number for number in range(len(unnamed)) if not is_idle(number)]
    heading, origin = named_above(header.lines), statement_of_simulation(header.lines)
    sheet = Sheet(name, header.columns, header.units, cells, decimal, header.begin + 1, (), header.titles, heading)
    sheet = replace(sheet.of_columns(kept), origin=origin)
    row_of_units = ", a row of units" * any(sheet.units)
    names = ", ".join(printable(name, 40) for name in sheet.columns[:12]) + " …" * (len(sheet.columns) > 12)
    layout = f"Data from row {sheet.first_row}{row_of_units}, columns: {names}."
    return replace(sheet, steps=(*form, layout, *["Left out: the numbers of the rows."] * numbered))


def numbers_rows(cells: pd.Series) -> bool:
    """Whether a column counts its rows: whole numbers, one more in each row."""
    if len(cells) < _RUN or not cells.iloc[0].strip().isdecimal():
        return False
    is_whole = cells.str.fullmatch(r"\s*\d{1,9}\s*").all()
    return bool(is_whole and (np.diff(cells.str.strip().astype(np.int64)) == 1).all())


def is_unnamed(column: str) -> bool:
    """Whether a column has the name that is given to one without a header."""
    return _UNNAMED.fullmatch(column) is not None


def _aligned(names: list[str], data: Sequence[Sequence[str]], decimal: str, name: str) -> list[str]:
    """Of names one fewer than the columns, as R writes them above row names; "" for the column without."""
    if len(names) == 1:
        return [*names, ""]
    rows = [[*row, *[""] * (len(names) + 1)] for row in data if any(row)]
    columns = [pd.Series([row[number] for row in rows], dtype=str) for number in range(len(names) + 1)]

    def increases(number: int) -> bool:
        values = pd.to_numeric(columns[number].str.replace(decimal, ".", regex=False), errors="coerce")
        return bool((np.diff(values.dropna()) > 0).all()) and bool(values.notna().mean() > _MOST)

    if sum(is_number(cell, decimal) for cell in columns[-1]) < _MOST * len(rows):
        return [*names, ""]
    clocks = [number for number, text in enumerate(names) if Heading(text).use.role == "time"]
    has_row_names = numbers_rows(columns[0]) or not any(is_number(cell, decimal) for cell in columns[0])
    if all(increases(number + 1) for number in clocks) and (clocks or has_row_names or increases(0)):
        return ["", *names]
    found = f"{len(names)} names above {len(names) + 1} columns of numbers"
    raise refusal(name, "a name for each column", found, "name all columns")


class _Block(NamedTuple):
    begin: int
    end: int
    numbers: int
    numeric: tuple[bool, ...]


def _first_data_row(grid: Sequence[Sequence[str]], decimal: str) -> int | None:
    if not (blocks := _blocks(grid, decimal, 0.5) or _blocks(grid, decimal, 1e-9)):
        return None
    most = max(blocks, key=lambda block: block.numbers * len(block.numeric))
    width = len(most.numeric)

    def goes_on(block: _Block) -> bool:
        between = [sum(map(bool, row)) for row in grid[block.end : most.begin]]
        return block.numeric == most.numeric or (len(block.numeric) == width and max(between) < width - 1)

    begin = next(block.begin for block in blocks if block is most or goes_on(block))
    return begin + (Heading(grid[begin][0]).use.role == "time")  # a header whose other names are numbers


def _blocks(grid: Sequence[Sequence[str]], decimal: str, least: float) -> list[_Block]:
    found, rows = list[_Block](), list[list[bool | None]]()
    begin: int | None = None
    for number, row in enumerate([*grid, ["end"]]):
        cells = [is_number(cell, decimal) if cell.strip() else None for cell in row]
        filled = [cell for cell in cells if cell is not None]
        is_row = len(filled) > 1 and sum(filled) >= least * len(filled)
        if is_row or (len(row) > 1 and filled == [True]):  # of two columns, one has a gap here
            begin = number if begin is None else begin
            rows += [cells] * is_row
        elif filled:
            if begin is not None and (len(rows) >= _RUN or (rows and number == len(grid))):
                counts = [sum(cell is True for cell in column) for column in zip_longest(*rows)]
                found.append(_Block(begin, number, sum(counts), tuple(2 * count > len(rows) for count in counts)))
            rows, begin = [], None
    return [block for block in found if block.begin < _LONGEST_PREAMBLE]


def _is_units(row: Sequence[str], width: int) -> bool:
    cells = [cell.strip() for cell in row]
    if Heading(cells[0]).use.role == "time" and unit_named(cells[0], "time") is None:
        return False
    named = sum(unit_named(cell) is not None for cell in cells)
    blank = sum(cell.strip("[]()- ") == "" for cell in cells)
    return len(cells) <= width and named > 0 and 2 * (named + blank) >= len(cells) and named + blank >= len(cells) - 1


def _trimmed(row: Sequence[str]) -> list[str]:
    end = max((number for number, cell in enumerate(row, start=1) if cell.strip()), default=0)
    return list(row[:end])


def unique(header: Sequence[str]) -> tuple[str, ...]:
    """Headers that tell their columns apart; those without one are numbered."""
    names, seen = list[str](), set[str]()
    for number, cell in enumerate(header, start=1):
        name = original(_in_one_line(cell))[:_LONGEST_HEADER] or f"column {number}"
        while name in seen:
            name += f" ({number})"
        seen.add(name)
        names.append(name)
    return tuple(names)


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number with this decimal sign."""
    return _NUMBER[decimal].fullmatch(cell.strip()) is not None


def read_workbook(path: Path, limits: Limits) -> tuple[Sheet, ...]:
    """Read every sheet that holds a table."""
    refuse_if(not is_zipfile(path), path.name, "a sound workbook", "a damaged one (no zip)", _AGAIN)
    with path.open("rb") as stream:
        budget = Budget(limits, path.stat().st_size)
        uncalculated = [_examined(member, budget) for member in zip_members(stream, path.name, limits)]
    try:
        from openpyxl import load_workbook
    except ImportError:
        advice = f'python -m pip install ".[excel]" in a checkout, or {_AS_CSV}'
        raise refusal(path.name, "openpyxl to read workbooks with", "none installed", advice) from None
    problems: list[Problem] = []
    found, cells = list[Sheet](), 0
    try:
        with (
            warnings.catch_warnings(action="ignore"),  # what openpyxl leaves out is no table
            closing(load_workbook(path, read_only=True, data_only=True)) as book,
        ):
            n, sheets = len(book.worksheets), book.worksheets
            refuse_if(n > _MOST_SHEETS, path.name, f"at most {_MOST_SHEETS} sheets", f"{n}", "leave out others")
            hidden = [printable(sheet.title, 40) for sheet in sheets if sheet.sheet_state != "visible"]
            for sheet in sheets:
                if sheet.sheet_state != "visible":
                    continue
                name = path.name if len(sheets) == 1 else f"{path.name}: {printable(sheet.title)}"
                sheet.reset_dimensions()  # what the file declares may be far more than it holds
                rows = _grid(sheet.iter_rows(values_only=True), name, min(_MOST_CELLS, _MOST_CELLS_IN_ALL - cells))
                cells += sum(map(len, rows))
                try:
                    found += [_grid_sheet(rows, name, hidden)] if any(map(any, rows)) else []
                except DataError as error:
                    problems += [_explained(problem, rows, uncalculated) for problem in error.problems]
    except (BadZipFile, KeyError, ValueError, TypeError, AttributeError, IndexError, SyntaxError, OSError) as error:
        reason = printable(" ".join(str(error).split()), 150) or type(error).__name__
        raise refusal(path.name, "a sound workbook", reason, _AGAIN) from None
    if not found:
        none = f"hidden ones alone ({', '.join(hidden)})" if hidden else "none"
        raise DataError(problems or Problem(path.name, "a sheet with a table", none, "export the data again"))
    return tuple(found)


def _examined(member: Member, budget: Budget) -> bool:
    """Whether a part has formulas without values."""
    name = str(member.path)
    most = next(most for start, most in _MOST_MARKS.items() if name.startswith(start))
    marks, uncalculated, end = {b"<": 0, b"=": 0}, False, b""
    for chunk in member.chunks(budget):
        if not name.endswith((".xml", ".rels")):
            continue
        marks, joined = {mark: count + chunk.count(mark) for mark, count in marks.items()}, end + chunk
        is_wrong = max(marks.values()) > most or _ENDLESS.search(joined) or _FOREIGN.search(joined)
        found = f"more than {most // 2} elements, or what no workbook has"
        refuse_if(is_wrong, member.where, "the XML of a workbook", found, _AS_CSV)
        uncalculated = uncalculated or _NO_VALUE.search(joined) is not None
        end = joined[-_LONGEST_TAG:]
    return uncalculated


def _grid(rows: Iterator[tuple[object, ...]], name: str, most: int) -> list[list[str]]:
    grid, cells, width = list[list[str]](), 0, 0
    for row in rows:
        shown = ["" if cell is None else repr(cell) if isinstance(cell, float) else str(cell).strip() for cell in row]
        while shown and not shown[-1]:
            shown.pop()
        grid.append(shown)
        width = max(width, len(shown))
        cells += max(len(row), 1)
        refuse_if(cells > most or width * len(grid) > most, name, f"at most {most} cells", "more", _AS_CSV)
    return [row + [""] * (width - len(row)) for row in grid]


def _grid_sheet(rows: list[list[str]], name: str, hidden: Sequence[str]) -> Sheet:
    decimal = "."  # numbers in a workbook have no decimal sign of their own
    header = header_of(rows[:SAMPLE], decimal, name)
    width = len(header.columns)
    body = [(row + [""] * width)[:width] for row in rows[header.begin :]]
    while body and not any(body[-1]):
        body.pop()
    cells = pd.DataFrame(body, columns=range(width), dtype=str)
    return sheet_of(name, header, cells, decimal, *[f"Left out as hidden: {', '.join(hidden)}."] * bool(hidden))


def _explained(problem: Problem, rows: list[list[str]], uncalculated: list[bool]) -> Problem:
    advice = "turn its cells into numbers"
    if text := next((cell for row in rows for cell in row if "," in cell and is_number(cell, ",")), ""):
        return replace(problem, found=f"numbers kept as text, such as {text!r}", advice=advice)
    if any(uncalculated):
        return replace(problem, found="formulas without their values", advice=advice)
    return problem
