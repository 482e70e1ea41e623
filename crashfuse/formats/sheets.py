"""Tables as programs and people export them: CSV, TSV or Excel, with whatever delimiter, decimal sign and header.

Nothing is asked of the file but that it holds a table: the delimiter and the decimal sign are those under which most
cells are numbers, and the data begin where the numbers begin. The row above them is the header, or the row of units
with the header above it.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem
from crashfuse.formats.archive import Budget, Limits, shown, zip_members
from crashfuse.formats.spelling import unit_named
from crashfuse.pulse import FloatArray

SHEET_LIMITS = Limits(total_bytes=256 << 20, member_bytes=64 << 20, rows=2_000_000)
"""Sizes beyond which a table is refused."""

TEXT_ENDINGS = (".csv", ".tsv", ".txt", ".asc", ".dat")
EXCEL_ENDINGS = (".xlsx", ".xlsm")
_MOST_COLUMNS, _MOST_CELLS, _MOST_CELLS_IN_EXCEL = 2000, 20_000_000, 500_000
_LONGEST_LINE, _LONGEST_HEADER = 1 << 18, 200
_AGAIN = "export it again as CSV"
_SAMPLE = 400  # lines looked at
_LONGEST_PREAMBLE = 200
_RUN = 5  # rows of data
_DIALECTS = ((",", "."), (";", ","), (";", "."), ("\t", ","), ("\t", "."), ("|", "."), (" ", "."), (" ", ","))
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


def read_sheets(path: Path, limits: Limits = SHEET_LIMITS) -> tuple[Sheet, ...]:
    """Read the tables of a text file (one) or a workbook (one a sheet that holds a table).

    Raises
    ------
    DataError
        If the file holds no table or is larger than allowed.
    """
    if not path.is_file():
        raise DataError(Problem(str(path), "a table", "no such file", "check the path"))
    if path.stat().st_size > limits.member_bytes:
        expected, found = f"at most {limits.member_bytes >> 20} MiB a table", f"{path.stat().st_size >> 20} MiB"
        raise DataError(Problem(path.name, expected, found, "export a shorter record"))
    if path.suffix.lower() in EXCEL_ENDINGS:
        return _workbook(path, limits)
    if path.suffix.lower() == ".xls":
        raise DataError(Problem(path.name, "a workbook of Excel 2007 or later", "an .xls file", "save it as .xlsx"))
    return (_text_sheet(path, limits),)


def _text_sheet(path: Path, limits: Limits) -> Sheet:
    content = path.read_bytes()
    if content.count(b"\n") + content.count(b"\r") > 2 * limits.rows:
        raise DataError(Problem(path.name, f"at most {limits.rows} rows", "more", "export a shorter record"))
    text = _decoded(content, path.name)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    del content, text
    if max(map(len, lines)) > _LONGEST_LINE:
        raise DataError(Problem(path.name, f"lines of at most {_LONGEST_LINE} characters", "a longer one", _AGAIN))
    delimiter, decimal = _dialect([line for line in lines[:_SAMPLE] if line.strip()], path.name)
    grid = [_split(line, delimiter) for line in lines[:_SAMPLE]]
    names = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}
    form = f"Columns parted by {names[delimiter]}, decimal {names.get(decimal, 'point')}."
    begin, columns, units = _header(grid, decimal, path.name)
    rest = lines[begin:]
    while rest and not rest[-1].strip(f" {delimiter}"):
        rest.pop()
    if len(rest) * len(columns) > _MOST_CELLS:
        raise DataError(Problem(path.name, f"at most {_MOST_CELLS} cells", "more", "export fewer columns"))
    cells = _cells(rest, delimiter, len(columns), path.name, begin + 1)
    return Sheet(path.name, columns, units, cells, decimal, begin + 1, (form, _told(columns, units, begin)))


def _cells(lines: Sequence[str], delimiter: str, width: int, name: str, first_row: int) -> pd.DataFrame:
    try:
        return pd.read_csv(
            io.StringIO("\n".join(lines)),
            sep=r"\s+" if delimiter == " " else delimiter,
            header=None,
            names=range(width),
            index_col=False,
            dtype=str,
            keep_default_na=False,
            na_filter=False,
            skip_blank_lines=False,
            skipinitialspace=True,
            on_bad_lines="error",
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, pd.errors.ParserWarning, ValueError) as error:
        found = " ".join(str(error).split())[:160]
        advice = f"export it again (the data begin in row {first_row})"
        raise DataError(Problem(name, f"{width} cells in each row", found, advice)) from None


def _workbook(path: Path, limits: Limits) -> tuple[Sheet, ...]:
    try:
        from openpyxl import load_workbook
    except ImportError:
        advice = "install crashfuse[excel], or save the sheet as CSV"
        raise DataError(Problem(path.name, "openpyxl to read workbooks with", "none installed", advice)) from None
    with path.open("rb") as stream:  # nothing is believed of a zip: its true size is counted before it is parsed
        budget = Budget(limits, path.stat().st_size)
        for member in zip_members(stream, path.name, limits):
            for _ in member.chunks(budget):
                pass
    problems: list[Problem] = []
    found = []
    try:
        book = load_workbook(path, read_only=True, data_only=True)
        try:
            for sheet in book.worksheets:
                name = path.name if len(book.worksheets) == 1 else f"{path.name}: {shown(sheet.title)}"
                rows = [
                    [_shown_cell(cell) for cell in row] for row in _bounded(sheet.iter_rows(values_only=True), name)
                ]
                if any(any(row) for row in rows):
                    try:
                        found.append(_grid_sheet(rows, name))
                    except DataError as error:
                        problems.extend(error.problems)
        finally:
            book.close()
    except (BadZipFile, KeyError, ValueError, TypeError, AttributeError, IndexError, SyntaxError, OSError) as error:
        reason = shown(" ".join(str(error).split())) or type(error).__name__
        raise DataError(Problem(path.name, "a sound workbook", reason, "save it again as .xlsx or CSV")) from None
    if not found:
        raise DataError(problems or Problem(path.name, "a sheet with a table", "none", "export the data again"))
    return tuple(found)


def _bounded(rows: Iterator[tuple[object, ...]], name: str) -> Iterator[tuple[object, ...]]:
    cells = 0
    for row in rows:
        cells += len(row)
        if cells > _MOST_CELLS_IN_EXCEL:
            raise DataError(Problem(name, f"at most {_MOST_CELLS_IN_EXCEL} cells", "more", "save the sheet as CSV"))
        yield row


def _grid_sheet(rows: list[list[str]], name: str) -> Sheet:
    decimal = "."  # numbers in a workbook have no sign of their own
    begin, columns, units = _header(rows[:_SAMPLE], decimal, name)
    width = len(columns)
    body = [(row + [""] * width)[:width] for row in rows[begin:]]
    while body and not any(body[-1]):
        body.pop()
    cells = pd.DataFrame(body, columns=range(width), dtype=str)
    return Sheet(name, columns, units, cells, decimal, begin + 1, (_told(columns, units, begin),))


def _shown_cell(cell: object) -> str:
    if cell is None or isinstance(cell, bool):
        return "" if cell is None else str(cell)
    return repr(cell) if isinstance(cell, float) else str(cell).strip()


def _decoded(content: bytes, name: str) -> str:
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encodings: tuple[str, ...] = ("utf-16",)
    else:
        encodings = ("utf-8-sig", "cp1252", "latin-1")
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\x00" in text:
            break
        return text
    raise DataError(Problem(name, "a table as text", "bytes that are no text", "export it again as CSV in UTF-8"))


def _dialect(lines: Sequence[str], name: str) -> tuple[str, str]:
    """The delimiter and decimal sign under which the most cells, and the largest share of them, are numbers."""
    best, best_score = None, 0.0
    for delimiter, decimal in _DIALECTS:
        rows = [_split(line, delimiter) for line in lines]
        width = Counter(len(row) for row in rows if len(row) > 1).most_common(1)
        if not width:
            continue
        numbers = [sum(_is_number(cell, decimal) for cell in row) for row in rows if len(row) == width[0][0]]
        score = sum(count**2 for count in numbers) / width[0][0]
        if score > best_score:
            best, best_score = (delimiter, decimal), score
    if best is None:
        expected, found = "a table of at least two columns with numbers", "none"
        raise DataError(Problem(name, expected, found, _AGAIN))
    return best


def _header(grid: Sequence[Sequence[str]], decimal: str, name: str) -> tuple[int, tuple[str, ...], tuple[str, ...]]:
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
        None if not cells else sum(_is_number(cell, decimal) for cell in cells) / len(cells) if len(cells) > 1 else 0.0
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


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return re.split(r"\s+(?![\[(])", line.strip())
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return [line]


def _is_number(cell: str, decimal: str) -> bool:
    return _NUMBER[decimal].fullmatch(cell.strip()) is not None


def _told(columns: Sequence[str], units: Sequence[str], begin: int) -> str:
    row_of_units = ", a row of units" if any(units) else ""
    shown_names = ", ".join(shown(name, 40) for name in columns[:12]) + (" …" if len(columns) > 12 else "")
    return f"Data from row {begin + 1}{row_of_units}, columns: {shown_names}."
