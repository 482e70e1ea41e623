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
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path

import pandas as pd

from crashfuse.errors import DataError, Problem
from crashfuse.files.archive import Limits
from crashfuse.readers.credibility import statement_of_simulation
from crashfuse.readers.members import as_text
from crashfuse.readers.tables.labview import is_labview, labview_sheet
from crashfuse.readers.tables.sheet import SAMPLE, SHEET_LIMITS, Sheet, counts, header_of, is_number, sheet_of
from crashfuse.readers.tables.side_by_side import parted
from crashfuse.readers.tables.workbook import read_workbook

_MOST_CELLS, _LONGEST_LINE = 20_000_000, 1 << 18
_LARGEST_SAMPLE = 4 << 20  # characters
_AGAIN = "export it again as CSV"
_GROUPED_CELLS = re.compile(r"(?<![\w.])[-+]?[1-9]\d{0,2},\d{3}(?!\d)(\.\d+)?")
_DECIMALS = re.compile(r"-0,\d+|[-+]?\d+,(0\d+|\d+[eE][-+]?\d+)")
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
    if is_labview(lines[0]):
        return labview_sheet(lines, path.name, _cells)
    if lines[0].strip() == "Curveplot":
        expected, advice = "a table with a row of names", "save the curves as CSV"
        raise DataError(Problem(path.name, expected, "a curve file of LS-PrePost", advice))
    delimiter, decimal = _dialect([line for line in sample if line.strip()], path.name)
    grid = [_split(line, delimiter) for line in sample]
    if delimiter == " ":
        grid = _with_whole_names(sample, grid, decimal)
    if delimiter == "," and decimal == ".":
        _refuse_commas_in_numbers(grid, path.name)
    names = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}
    form = f"Columns separated by {names[delimiter]}, decimal {names.get(decimal, 'point')}."
    header = header_of(grid, decimal, path.name)
    rest = lines[header.begin :]
    while rest and not rest[-1].strip(f" {delimiter}"):
        rest.pop()
    if len(rest) * len(header.columns) > _MOST_CELLS:
        raise DataError(Problem(path.name, f"at most {_MOST_CELLS} cells", "more", "export fewer columns"))
    cells = _cells(rest, delimiter, len(header.columns), path.name, header.begin + 1)
    sheet = sheet_of(path.name, header, cells, decimal, form)
    return replace(sheet, origin=statement_of_simulation(lines[: header.begin]))


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
        rows = ((at, _split(line, delimiter)) for at, line in enumerate(lines, start=first_row))
        longer = list(islice((row for row in rows if len(row[1]) > width), SAMPLE))
        if delimiter == "," and longer and (broken := _commas_in_numbers(longer, name, is_ragged=True)) is not None:
            raise DataError(broken) from None
        found = " ".join(str(error).split())[:160]
        advice = f"export it again (the data begin in row {first_row})"
        raise DataError(Problem(name, f"{width} cells in each row", found, advice)) from None


def _refuse_commas_in_numbers(grid: Sequence[Sequence[str]], name: str) -> None:
    """Raise a DataError if numbers with commas stand in a table separated by commas."""
    rows = [(at, row) for at, row in enumerate(grid) if len(row) > 1 and all(is_number(c, ".") for c in row if c)]
    first = rows[0][0] if rows else 0
    names = max((sum(map(bool, row)) for row in grid[max(first - 2, 0) : first]), default=0)
    longer = [(at + 1, row) for at, row in rows if not names or len(row) > names]
    is_ragged = bool(names) and len(longer) < len(rows)
    if longer and (broken := _commas_in_numbers(longer, name, is_ragged=is_ragged)) is not None:
        raise DataError(broken)


def _commas_in_numbers(rows: Sequence[tuple[int, Sequence[str]]], name: str, *, is_ragged: bool) -> Problem | None:
    """What commas in numbers do to rows, given with their numbers, that have more cells than there are names.

    Decimal commas: -0,063 is no -0 and 063, and no cell has a point. Thousands separators: -1,234.5 is no -1 and 234.5,
    and the table is ragged, as other rows have as many cells as there are names.
    """
    broken = [(at, match[0]) for at, row in rows if (match := _GROUPED_CELLS.search(",".join(row)))]
    what, instead = "thousands separators", "without them"
    if not is_ragged or len(broken) < len(rows):
        pairs = ((at, ",".join(pair)) for at, row in rows for pair in pairwise(row))
        broken = [(at, pair) for at, pair in pairs if _DECIMALS.fullmatch(pair)]
        what, instead = "decimal commas", "with decimal points"
        if not broken or any("." in cell for _, row in rows for cell in row):
            return None
    at, number = broken[0]
    found = f"{what}, as in {number}, in a table separated by commas"
    advice = f"export it {instead}, or with semicolons or tabs between the columns"
    return Problem(name, "a comma either between columns or in numbers", found, advice, row=at)


def _decoded(content: bytes, name: str) -> str:
    text = "\x00"
    with suppress(UnicodeDecodeError):
        text = content.decode("utf-16") if content[:2] in (b"\xff\xfe", b"\xfe\xff") else as_text(content)
    if "\x00" in text:
        raise DataError(Problem(name, "a table as text", "bytes that are no text", "export it again as CSV in UTF-8"))
    return text


def _dialect(lines: Sequence[str], name: str) -> tuple[str, str]:
    """The delimiter and decimal sign for which the most cells, and the largest share of them, are numbers."""
    best, best_score, best_width = None, 0.0, 0
    for delimiter, decimal in _DIALECTS:
        rows = [_split(line, delimiter) for line in lines]
        width = Counter(len(row) for row in rows if len(row) > 1).most_common(1)
        if not width:
            continue
        numbers = [sum(is_number(cell, decimal) for cell in row) for row in rows if len(row) == width[0][0]]
        score = sum(count**2 for count in numbers) / width[0][0]
        if delimiter == " " and best is not None and best[0] == "\t" and width[0][0] == best_width:
            continue  # they are the same columns, and names may hold blanks
        if score > best_score:
            best_width = width[0][0]
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
    has_row_names = counts(pd.Series([row[0] for row, numeric in zip(grid, data, strict=True) if numeric], dtype=str))

    def names(line: str) -> list[str]:
        text = line.strip().lstrip("#%!*").strip()
        words = _split(text, " ")
        if len(words) == width or (len(words) == width - 1 and ('"' in text or has_row_names)):
            return words
        splits = (re.split(between, text) for between in _BETWEEN_NAMES)
        return next((cells for cells in splits if len(cells) == width), unnamed)

    return [
        row if numeric or not line.strip() else names(line)
        for line, row, numeric in zip(lines, grid, data, strict=True)
    ]


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == " " and '"' in line:
        return [cell.strip('"') for cell in re.findall(r'(?:"[^"]*"|[^\s"])+', line)]
    if delimiter == " ":
        return re.split(r"\s+(?![\[(])", line.strip())
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return [line]
