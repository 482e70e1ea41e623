"""CSV tables: untrusted ones, read in bounds, and our own, in which no cell is a formula to a spreadsheet."""

import csv
import io
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, count
from pathlib import Path
from typing import Literal, Self, TextIO

import numpy as np
import numpy.typing as npt
import pandas as pd

from crashfuse.errors import KEEP_ONE, DataError, Problem, printable, refusal, refuse_if

# where a cell begins, or where one begins in a spreadsheet that separates by semicolons or tabs
_CELL = r"""(?P<begin>(?:^|[;\t\r\n])[^\S\t\r\n]*"*)"""
_FORMULA = re.compile(rf"{_CELL}(?P<marks>'*)(?=[=+\-@＝＋－＠]|(?<![;\t\r\n])[\t\r\n])(?P<rest>[^;\t\r\n]*)")
_HARMLESS = re.compile(r"[-+]?([.,]?\d[\d.,]*([eE][-+]?\d+)?)?\s*")  # a number, decimal commas too, or a sign alone


def neutral(text: str) -> str:
    """Text that no spreadsheet takes for a formula (``=A1`` gets an apostrophe); :func:`original` undoes it."""

    def marked(found: re.Match[str]) -> str:
        harmless = not found["marks"] and found["rest"] and _HARMLESS.fullmatch(found["rest"])
        return found[0] if harmless else f"{found['begin']}'{found['marks']}{found['rest']}"

    return _FORMULA.sub(marked, text)


def original(cell: str) -> str:
    """The text of a cell that :func:`neutral` made."""
    if "'" not in cell:  # as nearly all of millions
        return cell
    return _FORMULA.sub(lambda found: f"{found['begin']}{found['marks'][1:]}{found['rest']}", cell)


def without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """A table with every text :func:`neutral`, names of columns included."""
    safe = table.rename(columns=_neutral)
    for at in range(safe.shape[1]):
        if not pd.api.types.is_numeric_dtype((column := safe.iloc[:, at]).dtype):
            safe.isetitem(at, column.map({cell: _neutral(cell) for cell in column.unique()}))
    return safe


def csv_bytes(table: pd.DataFrame, float_format: Callable[[float], str] | None = "{:z.6g}".format) -> bytes:
    """A table as CSV in UTF-8, by default with six significant digits and without a negative zero."""
    text = without_formulas(table).to_csv(index=False, float_format=float_format, lineterminator="\n")
    return str(text).encode()


def read_csv_table(path: Path, numbers: Collection[str]) -> pd.DataFrame:
    """A table as :func:`csv_bytes` wrote it, text in all columns but ``numbers``: a test may be called NA or 007."""
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    return table.apply(lambda cells: pd.to_numeric(cells) if cells.name in numbers else cells.map(original))


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Rows as CSV; every text is quoted, so that leading and trailing spaces survive."""
    stream = io.StringIO()
    write_rows(stream, rows, quoting=csv.QUOTE_NONNUMERIC)
    return stream.getvalue()


def write_rows(stream: TextIO, rows: Iterable[Sequence[object]], quoting: Literal[0, 2] = csv.QUOTE_MINIMAL) -> None:
    """Write rows as CSV to a stream, one by one."""
    writer = csv.writer(stream, lineterminator="\n", quoting=quoting)
    writer.writerows([_neutral(cell) for cell in row] for row in rows)


def _neutral(cell: object) -> object:
    return neutral(cell) if isinstance(cell, str) else cell


_BLOCK = 4 << 20  # characters
_LONGEST_LINE = 100_000
_MOST_COLUMNS = 500
_LARGEST_TABLE, _MOST_LINES = 32 << 20, 500_000  # of a condition table; the first in characters
_MOST_CELLS = 2_000_000  # 100,000 runs with 20 columns
_MOST_PADDING = 5_000_000  # empty cells of a block whose lines are shorter than its header
MOST_ROWS = 200_000  # of a condition table: twice the largest library
_MOST_WIDE = 20  # lines with more cells than the header that are told
_COMMA, _POINT = re.compile(r"\s*[+-]?\d+,\d+\s*"), re.compile(r"\s*[+-]?\d+\.\d+\s*")
_LESS = "leave some out"
_AGAIN = "export it again as comma-separated text in UTF-8"


class CsvTable:
    """A CSV file read in blocks of whole lines; ``names`` is its header, stripped of spaces."""

    def __init__(self, stream: TextIO, where: str) -> None:
        self._stream, self._where = stream, where
        line = stream.readline(_LONGEST_LINE)
        _refuse_nul(line, where)
        self.names = _header_names(cells := _cells(line), where)
        self._width, n = len(cells), self.names.count("id")
        refuse_if(n > 1, where, "one column id", f"{n} of them", KEEP_ONE)

    @classmethod
    @contextmanager
    def opened(cls, path: Path, where: str) -> Iterator[Self]:
        """Open a file; a DataError here or later if it is empty, not comma-separated UTF-8, or cannot be read."""
        with text_from(path, where) as stream:
            yield cls(stream, where)

    def blocks(self, columns: Sequence[str]) -> Iterator[tuple[pd.DataFrame, npt.NDArray[np.int64]]]:
        """Yield these columns and the row numbers, the header is 1; ids are text, others numeric if all cells are."""
        at = [self.names.index(name) for name in columns]
        row, rest = 2, ""
        while text := self._stream.read(_BLOCK):
            _refuse_nul(text, self._where)
            lines, newline, rest = (rest + text).rpartition("\n")
            refuse_if(len(rest) > _LONGEST_LINE, self._where, "lines of a table", "one without an end", _AGAIN, row=row)
            if lines:
                frame = self._parsed(lines + newline, row)
                yield frame[at].set_axis(columns, axis=1), row + np.arange(len(frame))
                row += len(frame)
            elif newline:
                row += 1
        if rest:
            frame = self._parsed(rest, row)
            yield frame[at].set_axis(columns, axis=1), row + np.arange(len(frame))

    def _parsed(self, text: str, row: int) -> pd.DataFrame:
        if text.count("\n") * (self._width - 1) > len(text) + _MOST_PADDING:
            expected, advice = f"{self._width} cells in each line", "leave out empty lines and columns"
            raise refusal(self._where, expected, "lines with far fewer", advice, row=row)
        texts: dict[int, type] = {self.names.index("id"): str} if "id" in self.names else {}
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            try:
                form = {"header": None, "names": range(self._width), "index_col": False, "dtype": texts}
                blanks = {"keep_default_na": False, "skip_blank_lines": False, "skipinitialspace": True}
                frame = pd.read_csv(io.StringIO(text), low_memory=False, **form, **blanks)
            except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError):
                frame = pd.DataFrame()
        if len(frame) != text.count("\n") + (not text.endswith("\n")):
            raise DataError(self._ragged(text, row))
        return frame

    def _ragged(self, text: str, row: int) -> Problem:
        for number, line in enumerate(text.split("\n"), start=row):
            if line.count('"') % 2:
                found = f"one alone in {printable(line, 60)!r}"
                return Problem(self._where, "quotation marks in pairs on each line", found, _AGAIN, row=number)
            if len(cells := _cells(line)) > self._width:
                return _too_wide(self._where, self._width, cells, number)
        return Problem(self._where, "a comma-separated table", "lines that cannot be told apart", _AGAIN, row=row)


def read_rows(
    path: Path, where: str, *, by_hand: bool = False, most_rows: int = MOST_ROWS
) -> tuple[list[str], list[list[str]], list[int]]:
    """Header, padded rows and row numbers of a small table; ``by_hand``: with semicolons and decimal commas, too."""
    rows, numbers, wide, number = list[list[str]](), list[int](), list[Problem](), 1
    with text_from(path, where) as stream:
        lines = _lines(stream, where)
        first = next(lines, "")
        between = "," if not by_hand or "," in first else next((mark for mark in ";\t" if mark in first), ",")
        reader = csv.reader(chain([first], lines), skipinitialspace=True, strict=True, delimiter=between)
        try:
            names = _header_names(next(reader, []), where)
            if twice := sorted({printable(name, 40) for name in names if name and names.count(name) > 1}):
                raise refusal(where, "each column once", f"{', '.join(twice[:12])} twice", KEEP_ONE)
            most = min(most_rows, _MOST_CELLS // len(names))
            for number, cells in enumerate(reader, start=2):
                is_blank = not any(map(str.strip, cells))
                if number > _MOST_LINES or (len(rows) == most and not is_blank):
                    raise refusal(where, f"at most {most:,} rows in {len(names)} columns", "more", _LESS)
                if not is_blank:
                    if any(map(str.strip, cells[len(names) :])) and len(wide) < _MOST_WIDE:
                        wide.append(_too_wide(where, len(names), cells, number))
                    rows.append([*map(original, cells[: len(names)]), *[""] * (len(names) - len(cells))])
                    numbers.append(number)
        except csv.Error as error:
            broken = Problem(where, "cells of a comma-separated table", str(error), _AGAIN, row=number + 1)
            raise DataError([*wide, broken]) from None
    if wide:
        raise DataError(wide)
    if between != "," and not any(_POINT.fullmatch(cell) for row in rows for cell in row):  # else between thousands
        rows = [[cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell for cell in row] for row in rows]
    return names, rows, numbers


def _lines(stream: TextIO, where: str) -> Iterator[str]:
    size = 0
    for row in count(1):
        line = stream.readline(_LONGEST_LINE + 1)
        size += len(line)
        refuse_if(size > _LARGEST_TABLE, where, "a table of at most 32 MiB", "more", _LESS)
        _refuse_nul(line, where)
        refuse_if(len(line) > _LONGEST_LINE, where, "lines of a table", "one without an end", _AGAIN, row=row)
        if not line:
            return
        yield line


def _header_names(cells: Sequence[str], where: str) -> list[str]:
    names = [original(cell.strip()) for cell in cells]
    while names and not names[-1]:
        names.pop()  # a comma at the end of each line
    refuse_if(not names, where, "a table with a header", "an empty one", "export it again, with its rows")
    if len(names) > _MOST_COLUMNS:
        raise refusal(where, f"at most {_MOST_COLUMNS} columns", f"{len(names)}", "leave out the others")
    for between, called in ((";", "semicolons"), ("\t", "tabs")):
        if len(names) == 1 and between in names[0]:
            raise refusal(where, "commas between columns", called, "export it with commas, or import it")
    return names


@contextmanager
def text_from(path: Path, where: str) -> Iterator[TextIO]:
    """Open a file as UTF-8 text; system and decoding errors become a DataError."""
    require_file(path, where)
    try:
        with path.open(encoding="utf-8-sig") as stream:
            yield stream
    except UnicodeDecodeError:
        raise refusal(where, "text in UTF-8", "Latin-1, UTF-16, or no text at all", _AGAIN) from None
    except OSError as error:
        raise DataError(unreadable(where, error)) from None


def require_file(path: Path, where: str) -> None:
    """Raise a DataError if the path is not a regular file but, say, a folder or a pipe that never ends."""
    if not path.is_file():
        found = "a folder" if path.is_dir() else "a link to nothing, a pipe or a device"
        raise refusal(where, "a file", found, "put the file there")


def unreadable(where: str, error: OSError) -> Problem:
    """The problem of a file that the system cannot read."""
    found = (error.strerror or type(error).__name__).lower()
    return Problem(where, "a file that can be read", found, "check who may read it")


def _too_wide(where: str, width: int, cells: Sequence[str], row: int) -> Problem:
    found = f"{len(cells)} in the line {printable(','.join(cells), 60)!r}"
    return Problem(where, f"{width} cells as in the header", found, "write decimal points, quote commas", row=row)


def _refuse_nul(text: str, where: str) -> None:
    refuse_if("\0" in text, where, "text in UTF-8", "NUL characters (UTF-16, or no text)", _AGAIN)


def _cells(line: str) -> list[str]:
    try:
        return next(csv.reader([line], skipinitialspace=True), [])
    except csv.Error:
        return line.split(",")
