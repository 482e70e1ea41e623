"""Tables and records in formats for other programs: JSON, Parquet, and text that a spreadsheet takes."""

import io
import json
import re
from collections.abc import Mapping

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from markupsafe import Markup

from crashfuse.files.csv_text import neutral
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.table import PARTS, Table


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


_INTERVAL = re.compile(r"(?P<value>\S+) \[(?P<lower>\S+), (?P<upper>\S+)\]")
_GRADED = re.compile(r"(?P<value>[\d.]+) (?P<grade>[A-Z][a-z]+)")
_ONE_ENDED = (  # intervals that a record leaves open, as such with two ends
    (re.compile(r"≤ (\S+) \(.*\)"), r"– [–, \1]"),
    (re.compile(r"≥ (\S+) \(.*\)"), r"– [\1, –]"),
    (re.compile(r"(\S+) \[≤ (\S+)\]"), r"\1 [–, \2]"),
    (re.compile(r"(\S+) \[≥ (\S+)\]"), r"\1 [\2, –]"),
    (re.compile(r"(\S+) \[open\]"), r"\1 [–, –]"),
)
_NUMBER = re.compile(r"[+-][\d.]+ ± [\d.]+")  # with its error, as no formula is


def spreadsheet_text(table: Table | pd.DataFrame, display: Display = DEFAULT) -> str:
    """Return a table as lines with tabs, which a spreadsheet takes: intervals and grades in columns of their own."""
    if isinstance(table, Table):
        shown = []
        for heading, (column, cells) in table.cells(display).items():
            cell_of = _text_cell if column.kind == "text" else _number_cell
            for place, end in enumerate(PARTS.get(column.kind, ("",))):
                parts = [(cell.parts or (cell.text,))[place] for cell in cells]
                shown.append([_text_cell(f"{heading}{end}"), *map(cell_of, parts)])
        return "\n".join(map("\t".join, zip(*shown, strict=True)))
    columns: list[list[str]] = []
    for name, own in table.items():
        cells = [_plain(cell) for cell in own]
        for pattern in (_INTERVAL, _GRADED):
            found = [pattern.fullmatch(cell) for cell in cells]
            if any(found):
                heads = [f"{name} {part}".replace(" value", "") for part in pattern.groupindex]
                parts = [part.groups("") if part else (cell, "", "") for part, cell in zip(found, cells, strict=True)]
                columns += [[head, *values] for head, values in zip(heads, zip(*parts, strict=False), strict=False)]
                break
        else:
            columns.append([str(name), *cells])
    return "\n".join("\t".join(map(_cell, row)) for row in zip(*columns, strict=True))


def _number_cell(text: str) -> str:
    return "" if text == "–" else text.replace("−", "-")  # no value; the minus sign of print


def _text_cell(text: str) -> str:
    return neutral(_number_cell(" ".join(text.split())))


def _plain(cell: object) -> str:
    shown = cell.striptags() if isinstance(cell, Markup) else "" if pd.isna(cell) else str(cell)
    text = " ".join(shown.split())
    return next((form.sub(both, text) for form, both in _ONE_ENDED if form.fullmatch(text)), text)


def _cell(text: str) -> str:
    text = "" if text == "–" else text.replace("−", "-")  # no value; the minus sign of print
    return text if _NUMBER.fullmatch(text) else neutral(text)
