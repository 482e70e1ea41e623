"""Tables in workbooks of Excel 2007 and later: one per sheet that holds a table.

A workbook is an untrusted zip of XML. Before it is parsed, its true size is counted, and so are its elements, each of
which takes many times its bytes; while it is parsed, rows and cells count by their positions, empty ones too.
"""

import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from xml.parsers import expat
from zipfile import BadZipFile, is_zipfile

import pandas as pd

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import Budget, Limits, Member, zip_members
from crashfuse.readers.credibility import statement_of_simulation
from crashfuse.readers.tables.sheet import SAMPLE, Sheet, header_of, is_number, sheet_of

_MOST_CELLS = 500_000  # of a sheet
_MOST_CELLS_IN_ALL = 2_000_000
_MOST_SHEETS = 500
_MOST_MARKS = {"xl/worksheets/": 4_000_000, "": 500_000}  # angle brackets, or equality signs, in a part
_LONGEST_TAG = 50_000  # bytes; a parser that waits for its end begins anew with each block
_ENDLESS = re.compile(rb"<[^<>]{%d}" % _LONGEST_TAG)
_AGAIN = "save it again as .xlsx or CSV"
_NO_VALUE = re.compile(rb"<f\b[^<]*(?:/>|</f>)\s*(?:</c>|<v\s*/>|<v></v>)")


def read_workbook(path: Path, limits: Limits) -> tuple[Sheet, ...]:
    """Read every sheet that holds a table."""
    if not is_zipfile(path):
        raise DataError(Problem(path.name, "a sound workbook", "a damaged one (no zip)", _AGAIN))
    with path.open("rb") as stream:
        budget = Budget(limits, path.stat().st_size)
        uncalculated = [_examined(member, budget) for member in zip_members(stream, path.name, limits)]
    with warnings.catch_warnings(action="ignore"):  # what openpyxl leaves out is no table
        return _sheets(path, calculated=not any(uncalculated))


def _sheets(path: Path, *, calculated: bool) -> tuple[Sheet, ...]:
    try:
        from openpyxl import load_workbook
    except ImportError:
        advice = "install crashfuse[excel], or save the sheet as CSV"
        raise DataError(Problem(path.name, "openpyxl to read workbooks with", "none installed", advice)) from None
    problems: list[Problem] = []
    found = []
    cells = 0
    try:
        book = load_workbook(path, read_only=True, data_only=True)
        try:
            if len(book.worksheets) > _MOST_SHEETS:
                expected, advice = f"at most {_MOST_SHEETS} sheets", "leave out the others"
                raise DataError(Problem(path.name, expected, f"{len(book.worksheets)}", advice))
            shown_sheets = [sheet for sheet in book.worksheets if sheet.sheet_state == "visible"]
            hidden = [printable(sheet.title, 40) for sheet in book.worksheets if sheet not in shown_sheets]
            for sheet in shown_sheets:
                name = path.name if len(book.worksheets) == 1 else f"{path.name}: {printable(sheet.title)}"
                sheet.reset_dimensions()  # what the file declares may be far more than it holds
                rows = _grid(sheet.iter_rows(values_only=True), name, min(_MOST_CELLS, _MOST_CELLS_IN_ALL - cells))
                cells += sum(map(len, rows))
                if any(any(row) for row in rows):
                    try:
                        found.append(_grid_sheet(rows, name, hidden))
                    except DataError as error:
                        problems.extend(_explained(problem, rows, calculated=calculated) for problem in error.problems)
        finally:
            book.close()
    except (BadZipFile, KeyError, ValueError, TypeError, AttributeError, IndexError, SyntaxError, OSError) as error:
        reason = printable(" ".join(str(error).split()), 150) or type(error).__name__
        raise DataError(Problem(path.name, "a sound workbook", reason, _AGAIN)) from None
    if not found:
        none = f"hidden ones alone ({', '.join(hidden)})" if hidden and not problems else "none"
        raise DataError(problems or Problem(path.name, "a sheet with a table", none, "export the data again"))
    return tuple(found)


def _examined(member: Member, budget: Budget) -> bool:
    """Whether a part has formulas without values; a DataError if it is too large to be parsed, or defines entities."""
    name = str(member.path)
    most = next(most for start, most in _MOST_MARKS.items() if name.startswith(start))
    is_xml = name.endswith((".xml", ".rels"))
    prolog = _Prolog(member.where)
    marks, uncalculated, end = {b"<": 0, b"=": 0}, False, b""
    for chunk in member.chunks(budget):
        if not is_xml:
            continue
        prolog.feed(chunk)
        for mark in marks:
            marks[mark] += chunk.count(mark)
            if marks[mark] > most:
                expected, advice = f"at most {most // 2} elements and {most} attributes", "save the sheets as CSV"
                raise DataError(Problem(member.where, expected, "more", advice))
        joined = end + chunk
        if _ENDLESS.search(joined):
            raise DataError(Problem(member.where, "the XML of a workbook", "an element without an end", _AGAIN))
        uncalculated = uncalculated or _NO_VALUE.search(joined) is not None
        end = joined[-_LONGEST_TAG:]
    return uncalculated


class _Prolog:
    """The part of an XML file before its first element, where entities are defined: none of a workbook is."""

    def __init__(self, where: str) -> None:
        self._parser: expat.XMLParserType | None = expat.ParserCreate()
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._parser.StartElementHandler = self._end
        self._where = where

    def feed(self, chunk: bytes) -> None:
        if self._parser is not None:
            try:
                self._parser.Parse(chunk)
            except expat.ExpatError:
                self._parser = None  # the workbook's parser says what is wrong

    def _refuse(self, *_: object) -> None:
        found = "a document type, which may define anything"
        raise DataError(Problem(self._where, "the XML of a workbook", found, _AGAIN))

    def _end(self, *_: object) -> None:
        self._parser = None


def _grid(rows: Iterator[tuple[object, ...]], name: str, most: int) -> list[list[str]]:
    """All rows as text, as wide as the widest; empty cells count as the others do."""
    grid: list[list[str]] = []
    cells = width = 0
    for row in rows:
        shown = [_shown_cell(cell) for cell in row]
        while shown and not shown[-1]:
            shown.pop()
        grid.append(shown)
        width = max(width, len(shown))
        cells += max(len(row), 1)
        if cells > most or width * len(grid) > most:
            raise DataError(Problem(name, f"at most {most} cells", "more", "save the sheet as CSV"))
    return [row + [""] * (width - len(row)) for row in grid]


def _grid_sheet(rows: list[list[str]], name: str, hidden: Sequence[str]) -> Sheet:
    decimal = "."  # numbers in a workbook have no decimal sign of their own
    header = header_of(rows[:SAMPLE], decimal, name)
    width = len(header.columns)
    body = [(row + [""] * width)[:width] for row in rows[header.begin :]]
    while body and not any(body[-1]):
        body.pop()
    cells = pd.DataFrame(body, columns=range(width), dtype=str)
    left = [f"Left out as hidden: {', '.join(hidden)}."] if hidden else []
    origin = statement_of_simulation(" ".join(row) for row in rows[: header.begin])
    return replace(sheet_of(name, header, cells, decimal, *left), origin=origin)


def _explained(problem: Problem, rows: list[list[str]], *, calculated: bool) -> Problem:
    """The problem, with the reason why visible numbers were not found: text, or formulas never calculated."""
    text = next((cell for row in rows for cell in row if "," in cell and is_number(cell, ",")), None)
    if text is not None:
        advice = "turn them into numbers (in Excel: Data, Text to Columns), or save the sheet as CSV"
        return replace(problem, found=f"numbers kept as text, such as {text!r}", advice=advice)
    if not calculated:
        advice = "open the workbook in Excel and save it, or save the sheet as CSV"
        return replace(problem, found="formulas whose values are not in the file", advice=advice)
    return problem


def _shown_cell(cell: object) -> str:
    if cell is None or isinstance(cell, bool):
        return "" if cell is None else str(cell)
    return repr(cell) if isinstance(cell, float) else str(cell).strip()
