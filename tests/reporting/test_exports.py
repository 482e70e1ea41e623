"""A table goes on to other programs without loss."""

import io

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.approaches.base import Prediction
from crashfuse.condition import Condition
from crashfuse.reporting.exports import parquet_bytes
from crashfuse.reporting.result_tables import pulses_table
from crashfuse.signals.pulse import GRID_S
from crashfuse.study.estimate import Estimate


def test_parquet_keeps_every_digit_and_every_empty_cell() -> None:
    """Columns, order, floats to the bit and missing bands come back; text is kept as dictionaries."""
    condition, pulse = Condition(15.0, 950.0, 700.5), np.sin(GRID_S) - 250.0
    predictions = (
        Prediction(condition, pulse * 1.1),
        Prediction(condition, pulse, pulse + np.linspace(-3, 3, 20)[:, None]),
    )
    table = pulses_table(("", Estimate("cae", prediction, {}, 0.1)) for prediction in predictions)
    content = parquet_bytes(table)
    again = pd.read_parquet(io.BytesIO(content)).astype({"held_out": "str", "approach": "str"})
    pd.testing.assert_frame_equal(again, table.reset_index(drop=True), check_exact=True)
    arrow = pq.read_table(io.BytesIO(content))
    assert {str(field.type) for field in arrow.schema if field.name not in ("held_out", "approach")} == {"double"}
    assert all(pa.types.is_dictionary(arrow.schema.field(name).type) for name in ("held_out", "approach"))
    assert arrow.column("lower_g").null_count == GRID_S.size
    assert pq.ParquetFile(io.BytesIO(content)).metadata.row_group(0).column(2).compression == "ZSTD"
