"""Tables in the workbooks of Excel 2007 and later: one a sheet that holds a table."""

from collections.abc import Iterator
from pathlib import Path
from zipfile import BadZipFile

import pandas as pd

from crashfuse.errors import DataError, Problem
from crashfuse.formats.archive import Budget, Limits, shown, zip_members
from crashfuse.formats.sheet import SAMPLE, Sheet, header_of, header_told

_MOST_CELLS = 500_000


def read_workbook(path: Path, limits: Limits) -> tuple[Sheet, ...]:
    """Read every sheet that holds a table.

    Raises
    ------
    DataError
        If there is none, or the file is larger than allowed or no sound workbook.
    """
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
        if cells > _MOST_CELLS:
            raise DataError(Problem(name, f"at most {_MOST_CELLS} cells", "more", "save the sheet as CSV"))
        yield row


def _grid_sheet(rows: list[list[str]], name: str) -> Sheet:
    decimal = "."  # numbers in a workbook have no sign of their own
    begin, columns, units = header_of(rows[:SAMPLE], decimal, name)
    width = len(columns)
    body = [(row + [""] * width)[:width] for row in rows[begin:]]
    while body and not any(body[-1]):
        body.pop()
    cells = pd.DataFrame(body, columns=range(width), dtype=str)
    return Sheet(name, columns, units, cells, decimal, begin + 1, (header_told(columns, units, begin),))


def _shown_cell(cell: object) -> str:
    if cell is None or isinstance(cell, bool):
        return "" if cell is None else str(cell)
    return repr(cell) if isinstance(cell, float) else str(cell).strip()
