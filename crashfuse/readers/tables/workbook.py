"""Tables in workbooks of Excel 2007 and later: one per sheet that holds a table."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from zipfile import BadZipFile

import pandas as pd

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import Budget, Limits, zip_members
from crashfuse.readers.tables.sheet import SAMPLE, Sheet, header_of, is_number, sheet_of

_MOST_CELLS = 500_000


def read_workbook(path: Path, limits: Limits) -> tuple[Sheet, ...]:
    """Read every sheet that holds a table."""
    try:
        from openpyxl import load_workbook
    except ImportError:
        advice = "install crashfuse[excel], or save the sheet as CSV"
        raise DataError(Problem(path.name, "openpyxl to read workbooks with", "none installed", advice)) from None
    with path.open("rb") as stream:  # a workbook is an untrusted zip: its true size is counted before parsing
        budget = Budget(limits, path.stat().st_size)
        for member in zip_members(stream, path.name, limits):
            for _ in member.chunks(budget):
                pass
    problems: list[Problem] = []
    found = []
    try:
        book = load_workbook(path, read_only=True, data_only=True)
        try:
            shown_sheets = [sheet for sheet in book.worksheets if sheet.sheet_state == "visible"]
            hidden = [printable(sheet.title, 40) for sheet in book.worksheets if sheet not in shown_sheets]
            for sheet in shown_sheets:
                name = path.name if len(book.worksheets) == 1 else f"{path.name}: {printable(sheet.title)}"
                rows = [
                    [_shown_cell(cell) for cell in row] for row in _bounded(sheet.iter_rows(values_only=True), name)
                ]
                if any(any(row) for row in rows):
                    try:
                        found.append(_grid_sheet(rows, name, hidden))
                    except DataError as error:
                        problems.extend(_explained(problem, path, sheet.title, rows) for problem in error.problems)
        finally:
            book.close()
    except (BadZipFile, KeyError, ValueError, TypeError, AttributeError, IndexError, SyntaxError, OSError) as error:
        reason = printable(" ".join(str(error).split())) or type(error).__name__
        raise DataError(Problem(path.name, "a sound workbook", reason, "save it again as .xlsx or CSV")) from None
    if not found:
        none = f"hidden ones alone ({', '.join(hidden)})" if hidden and not problems else "none"
        raise DataError(problems or Problem(path.name, "a sheet with a table", none, "export the data again"))
    return tuple(found)


def _bounded(rows: Iterator[tuple[object, ...]], name: str) -> Iterator[tuple[object, ...]]:
    cells = 0
    for row in rows:
        cells += len(row)
        if cells > _MOST_CELLS:
            raise DataError(Problem(name, f"at most {_MOST_CELLS} cells", "more", "save the sheet as CSV"))
        yield row


def _grid_sheet(rows: list[list[str]], name: str, hidden: Sequence[str]) -> Sheet:
    decimal = "."  # numbers in a workbook have no decimal sign of their own
    header = header_of(rows[:SAMPLE], decimal, name)
    width = len(header.columns)
    body = [(row + [""] * width)[:width] for row in rows[header.begin :]]
    while body and not any(body[-1]):
        body.pop()
    cells = pd.DataFrame(body, columns=range(width), dtype=str)
    return sheet_of(name, header, cells, decimal, *([f"Left out as hidden: {', '.join(hidden)}."] if hidden else []))


def _explained(problem: Problem, path: Path, title: str, rows: list[list[str]]) -> Problem:
    """The problem, with the reason why visible numbers were not found: text, or formulas never calculated."""
    text = next((cell for row in rows for cell in row if "," in cell and is_number(cell, ",")), None)
    if text is not None:
        advice = "turn them into numbers (in Excel: Data, Text to Columns), or save the sheet as CSV"
        return replace(problem, found=f"numbers kept as text, such as {text!r}", advice=advice)
    if _has_formulas(path, title):
        advice = "open the workbook in Excel and save it, or save the sheet as CSV"
        return replace(problem, found="formulas whose values are not in the file", advice=advice)
    return problem


def _has_formulas(path: Path, title: str) -> bool:
    from openpyxl import load_workbook

    book = load_workbook(path, read_only=True)
    try:
        rows = book[title].iter_rows(values_only=True)
        return any(isinstance(cell, str) and cell.startswith("=") for row in rows for cell in row)
    finally:
        book.close()


def _shown_cell(cell: object) -> str:
    if cell is None or isinstance(cell, bool):
        return "" if cell is None else str(cell)
    return repr(cell) if isinstance(cell, float) else str(cell).strip()
