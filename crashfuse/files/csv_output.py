"""CSV tables as crashfuse writes and reads them: no cell is a formula to a spreadsheet, and no text is lost.

Text from a laboratory (a factor, the name of a file or a campaign) may be ``=HYPERLINK(…)`` or ``+cmd|…``, which a
spreadsheet would run. It is written with an apostrophe before it, as spreadsheets mark text themselves, and read back
without it. Numbers stay as they are, negative ones included.
"""

import csv
import io
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Literal, TextIO

import pandas as pd

# where a cell begins, or where one begins in a spreadsheet that separates by semicolons or tabs
_CELL = r"""(?P<begin>(?:^|[;\t\r\n])[^\S\t\r\n]*"*)"""
_FORMULA = re.compile(rf"{_CELL}(?P<marks>'*)(?=[=+\-@＝＋－＠]|(?<![;\t\r\n])[\t\r\n])(?P<rest>[^;\t\r\n]*)")
_HARMLESS = re.compile(r"[-+]?([.,]?\d[\d.,]*([eE][-+]?\d+)?)?\s*")  # a number, decimal commas too, or a sign alone


def neutral(text: str) -> str:
    """Text as a cell that no spreadsheet takes for a formula; :func:`original` undoes it."""

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
    """A table as :func:`csv_bytes` wrote it, with text in all columns but ``numbers``.

    Nothing but an empty cell of a number is missing: a test may be called NA, nan, None, 007 or 1e5.

    Raises
    ------
    OSError, ValueError
        If there is no such table, or a number in it is none.
    """
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
