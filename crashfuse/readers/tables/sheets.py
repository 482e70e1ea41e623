"""Exported tables in CSV, TSV or Excel, with any delimiter, decimal sign and header.

The file only has to hold a table: the delimiter and the decimal sign are those for which the most cells are numbers.
"""

import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pandas as pd

from crashfuse.errors import DataError, Problem
from crashfuse.files.archive import Limits
from crashfuse.readers.members import as_text
from crashfuse.readers.tables.sheet import SAMPLE, SHEET_LIMITS, Sheet, header_of, is_number, sheet_of
from crashfuse.readers.tables.side_by_side import parted
from crashfuse.readers.tables.workbook import read_workbook

_MOST_CELLS, _LONGEST_LINE = 20_000_000, 1 << 18
_LARGEST_SAMPLE = 4 << 20  # characters
_AGAIN = "export it again as CSV"
_BETWEEN_NAMES = (r"\s{2,}|\t", r"(?<=[)\]])\s+", r"\s+(?![\[(])", r"\s+")  # the likeliest first
_DIALECTS = (
    (",", "."),
    (";", ","),
    (";", "."),
    ("\t", ","),
    ("\t", "."),
    ("|", "."),
    (" ", "."),
    (" ", ","),
    (",", ","),  # decimal commas in quoted cells
)


def read_sheets(path: Path, limits: Limits = SHEET_LIMITS) -> tuple[Sheet, ...]:
    """Read the tables of a text file or workbook: one per file or sheet, or one per time column in it."""
    if not path.is_file():
        raise DataError(Problem(str(path), "a table", "no such file", "check the path"))
    if path.stat().st_size > limits.member_bytes:
        expected, found = f"at most {limits.member_bytes >> 20} MiB a table", f"{path.stat().st_size >> 20} MiB"
        raise DataError(Problem(path.name, expected, found, "export a shorter record"))
    if path.suffix.lower() in (".xlsx", ".xlsm"):
        return tuple(part for sheet in read_workbook(path, limits) for part in parted(sheet))
    if path.suffix.lower() == ".xls":
        raise DataError(Problem(path.name, "a workbook of Excel 2007 or later", "an .xls file", "save it as .xlsx"))
    return parted(_text_sheet(path, limits))


def _text_sheet(path: Path, limits: Limits) -> Sheet:
    content = path.read_bytes()
    if content.count(b"\n") + content.count(b"\r") > 2 * limits.rows:
        raise DataError(Problem(path.name, f"at most {limits.rows} rows", "more", "export a shorter record"))
    text = _decoded(content, path.name)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    del content, text
    if max(map(len, lines)) > _LONGEST_LINE:
        raise DataError(Problem(path.name, f"lines of at most {_LONGEST_LINE} characters", "a longer one", _AGAIN))
    sample = lines[: max(1, min(SAMPLE, _LARGEST_SAMPLE // (1 + max(map(len, lines[:SAMPLE])))))]
    delimiter, decimal = _dialect([line for line in sample if line.strip()], path.name)
    grid = [_split(line, delimiter) for line in sample]
    if delimiter == " ":
        grid = _with_whole_names(sample, grid, decimal)
    names = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}
    form = f"Columns separated by {names[delimiter]}, decimal {names.get(decimal, 'point')}."
    header = header_of(grid, decimal, path.name)
    rest = lines[header.begin :]
    while rest and not rest[-1].strip(f" {delimiter}"):
        rest.pop()
    if len(rest) * len(header.columns) > _MOST_CELLS:
        raise DataError(Problem(path.name, f"at most {_MOST_CELLS} cells", "more", "export fewer columns"))
    cells = _cells(rest, delimiter, len(header.columns), path.name, header.begin + 1)
    return sheet_of(path.name, header, cells, decimal, form)


def _cells(lines: Sequence[str], delimiter: str, width: int, name: str, first_row: int) -> pd.DataFrame:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # cells beyond the width would be dropped
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


def _decoded(content: bytes, name: str) -> str:
    text = "\x00"
    with suppress(UnicodeDecodeError):
        text = content.decode("utf-16") if content[:2] in (b"\xff\xfe", b"\xfe\xff") else as_text(content)
    if "\x00" in text:
        raise DataError(Problem(name, "a table as text", "bytes that are no text", "export it again as CSV in UTF-8"))
    return text


def _dialect(lines: Sequence[str], name: str) -> tuple[str, str]:
    """The delimiter and decimal sign for which the most cells, and the largest share of them, are numbers."""
    best, best_score = None, 0.0
    for delimiter, decimal in _DIALECTS:
        rows = [_split(line, delimiter) for line in lines]
        width = Counter(len(row) for row in rows if len(row) > 1).most_common(1)
        if not width:
            continue
        numbers = [sum(is_number(cell, decimal) for cell in row) for row in rows if len(row) == width[0][0]]
        score = sum(count**2 for count in numbers) / width[0][0]
        if score > best_score:
            best, best_score = (delimiter, decimal), score
    if best is None:
        expected, found = "a table of at least two columns with numbers", "none"
        raise DataError(Problem(name, expected, found, _AGAIN))
    return best


def _with_whole_names(lines: Sequence[str], grid: Sequence[list[str]], decimal: str) -> list[list[str]]:
    """The grid of a table whose columns are separated by blanks, as names of columns may hold blanks, too.

    A line of text is split as gives one name a column; if no way does, the columns have no names.
    """
    data = [2 * sum(is_number(cell, decimal) for cell in row) >= len(row) for row in grid]
    widths = Counter(len(row) for row, numeric in zip(grid, data, strict=True) if numeric and len(row) > 1)
    width = widths.most_common(1)[0][0] if widths else 0
    unnamed = [f"column {number}" for number in range(1, width + 1)]

    def names(line: str) -> list[str]:
        text = line.strip().lstrip("#%!*").strip()
        splits = (re.split(between, text) for between in _BETWEEN_NAMES)
        return next((cells for cells in splits if len(cells) == width), unnamed)

    return [
        row if numeric or not line.strip() else names(line)
        for line, row, numeric in zip(lines, grid, data, strict=True)
    ]


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return re.split(r"\s+(?![\[(])", line.strip())
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return [line]
