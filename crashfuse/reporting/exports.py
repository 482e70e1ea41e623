"""Tables in formats for other programs: Parquet files, and text that a spreadsheet takes from the clipboard."""

import io

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq


def parquet_bytes(table: pd.DataFrame) -> bytes:
    """Return a table as a Parquet file: float64 at full precision, text as dictionaries, empty cells as nulls."""
    arrow = pa.Table.from_pandas(table, preserve_index=False).replace_schema_metadata(None)
    for at, field in enumerate(arrow.schema):
        if pa.types.is_string(field.type) or pa.types.is_large_string(field.type):
            arrow = arrow.set_column(at, field.name, arrow.column(at).cast(pa.string()).dictionary_encode())
    stream = io.BytesIO()
    pq.write_table(arrow, stream, compression="zstd")
    return stream.getvalue()
