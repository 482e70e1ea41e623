"""Text: what a terminal prints of a result; JSON, Parquet and lines with tabs for other programs."""

import io
import json
from collections.abc import Mapping, Sequence
from html import escape

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.files.csv_text import neutral
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.result import Result
from crashfuse.results.table import PARTS, Cell, Column, Table

_MOST_ROWS, _MOST_OF_CARD = 40, 30  # of a table in a terminal; in a notebook


def lines(result: Result, display: Display) -> list[str]:
    """What a command prints: facts of the data, the answer, tables that answer, and what speaks against it."""
    printed = [*dict.fromkeys(map(display.words, (*result.notices, *result.answer)))]
    for table in (result.tables[name] for name in result.shown):
        left = [f"{len(table) - _MOST_ROWS:,} more rows are in the files."] * (len(table) > _MOST_ROWS)
        printed += [table.name] * (len(result.shown) > 1) + [table.head(_MOST_ROWS).to_string(display), *left]
    remarks = map(display.words, result.sentences.get("remarks", ()))
    return [*printed, *(text for text in remarks if text not in printed), *against_lines(result, display)]


def against_lines(result: Result, display: Display) -> list[str]:
    """What speaks most against the answer, a line a subject."""
    return [f"{subject}: {display.words(text)}" for subject, text in result.against.items()]


def json_bytes(values: Mapping[str, object]) -> bytes:
    """Return a record as the text of its file."""
    return (json.dumps(values, indent=2, ensure_ascii=False) + "\n").encode()


def parquet_bytes(table: pd.DataFrame) -> bytes:
    """Return a table as a Parquet file: float64 at full precision, text as dictionaries, empty cells as nulls."""
    arrow = pa.Table.from_pandas(table, preserve_index=False).replace_schema_metadata(None)
    for at, field in enumerate(arrow.schema):
        if pa.types.is_string(field.type) or pa.types.is_large_string(field.type):
            arrow = arrow.set_column(at, field.name, arrow.column(at).cast(pa.string()).dictionary_encode())
    stream = io.BytesIO()
    pq.write_table(arrow, stream, compression="zstd")
    return stream.getvalue()


def spreadsheet_text(table: Table, display: Display = DEFAULT) -> str:
    """Return a table as tabbed lines for a spreadsheet: intervals and grades in several columns."""
    columns = []
    for heading, (column, cells) in table.cells(display).items():
        cell_of = _text_cell if column.kind == "text" else _number_cell
        for place, end in enumerate(PARTS.get(column.kind, ("",))):
            parts = [(cell.parts or (cell.text,))[place] for cell in cells]
            columns.append([_text_cell(f"{heading}{end}"), *map(cell_of, parts)])
    return "\n".join(map("\t".join, zip(*columns, strict=True)))


def _number_cell(text: str) -> str:
    return "" if text == "–" else text.replace("−", "-")  # no value; the minus sign of print


def _text_cell(text: str) -> str:
    return neutral(_number_cell(" ".join(text.split())))


def card(title: str, table: Table, notes: Sequence[str] = (), display: Display = DEFAULT) -> str:
    """HTML of a small table with title and sentences; everything in it is text."""
    if len(table) > _MOST_OF_CARD:
        notes = (f"The first {_MOST_OF_CARD} of {len(table)} rows.", *notes)
    below = "".join(f"<div>{escape(note)}</div>" for note in notes if note)
    columns = [_column(heading, *own) for heading, own in table.head(_MOST_OF_CARD).cells(display).items()]
    head, *rows = (f"<tr>{''.join(cells)}</tr>" for cells in zip(*columns, strict=True))
    return f"<div><b>{escape(title)}</b><table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>{below}</div>"


def result_html(result: Result) -> str:
    """A result in a notebook: what answers, and what has to be known of the data."""
    display = result.usual_display
    table = result.tables[result.shown[0]] if result.shown else Table.of("nothing", ())
    told = dict.fromkeys(map(display.words, (*result.answer, *result.notices)))
    notes = [*told, *against_lines(result, display)]
    return card(display.words(result.heading), table, notes, display)


def _column(heading: str, column: Column, cells: Sequence[Cell]) -> list[str]:
    side = "right" if column.is_numeric else "left"  # Jupyter would have all at the right
    return [
        f'<th style="text-align: {side}">{escape(heading)}</th>',
        *(f'<td style="text-align: {side}; white-space: nowrap">{escape(cell.text)}</td>' for cell in cells),
    ]
