"""A table goes on to other programs without loss."""

import io

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.approaches.base import Prediction
from crashfuse.condition import Condition
from crashfuse.results.render.text import parquet_bytes, spreadsheet_text
from crashfuse.results.result_tables import pulses_table
from crashfuse.results.table import Column, Table
from crashfuse.signals.pulse import GRID_S
from crashfuse.study.estimate import Estimate


def test_parquet_keeps_every_digit_and_every_empty_cell() -> None:
    condition, pulse = Condition.of_vector([15.0, 950.0, 700.5]), np.sin(GRID_S) - 250.0
    bare, banded = Prediction(condition, 1.1 * pulse), Prediction(condition, pulse, pulse + np.arange(20.0)[:, None])
    table = pulses_table(Estimate(**vars(own), approach="cae", seconds=0.1) for own in (bare, banded))
    content = parquet_bytes(table)
    again = pd.read_parquet(io.BytesIO(content)).astype({"held_out": "str", "approach": "str"})
    pd.testing.assert_frame_equal(again, table.reset_index(drop=True), check_exact=True)
    arrow = pq.read_table(io.BytesIO(content))
    assert {str(field.type) for field in arrow.schema if field.name not in ("held_out", "approach")} == {"double"}
    assert all(pa.types.is_dictionary(arrow.schema.field(name).type) for name in ("held_out", "approach"))
    assert arrow.column("lower_g").null_count == GRID_S.size
    assert pq.ParquetFile(io.BytesIO(content)).metadata.row_group(0).column(2).compression == "ZSTD"


def test_a_table_goes_into_a_spreadsheet_with_a_number_in_each_cell() -> None:
    """Intervals and grades become columns of their own, the minus of print that of numbers, a dash an empty cell."""
    frame = pd.DataFrame(
        {
            "label": ["Peak\n", "OLC", "Δ"],
            "unit": ["g", "g", "%"],
            "CAE": [41.2, np.nan, -5.0],
            "CAE lower": [34.1, np.nan, np.nan],
            "CAE upper": [47.8, np.nan, np.nan],
            "Fused": [0.912, 0.95, np.nan],
            "Best": [0.912, 0.5, np.nan],
        }
    )
    columns = (
        *(Column("Metric", source="label", units="unit"), Column("CAE", "interval", units="unit")),
        *(Column("Fused", "grade"), Column("Best", "number", form=".3f")),
    )
    again = pd.read_csv(io.StringIO(spreadsheet_text(Table("metrics", frame, columns))), sep="\t")
    assert list(again) == ["Metric", "CAE", "CAE lower", "CAE upper", "Fused", "Fused grade", "Best"]
    assert again["Metric"].tolist() == ["Peak (g)", "OLC (g)", "Δ (%)"]
    assert again["Fused grade"].tolist()[:2] == ["Good", "Excellent"]
    pd.testing.assert_frame_equal(again[[*frame.columns[2:]]], frame[[*frame.columns[2:]]])


def test_an_interval_that_a_record_leaves_open_has_the_ends_that_are_known() -> None:
    rows = [(3.6, -np.inf, 4.3), (3.5, 3.1, np.inf), (3.4, -np.inf, np.inf), (np.nan, -np.inf, 15.3), (3.5, 3.1, 3.9)]
    frame = pd.DataFrame([*rows, (np.nan,) * 3], columns=["OLC", "OLC lower", "OLC upper"])
    table = Table("metrics", frame, (Column("OLC", "interval"),))
    lines = spreadsheet_text(table).split("\n")
    assert lines[0] == "OLC\tOLC lower\tOLC upper"
    assert lines[1:] == ["3.6\t\t4.3", "3.5\t3.1\t", "3.4\t\t", "\t\t15.3", "3.5\t3.1\t3.9", "\t\t"]


def test_no_cell_of_a_copied_table_is_a_formula() -> None:
    """Text that a spreadsheet would run stays text; numbers with a sign stay numbers."""
    cells = ["=HYPERLINK(1)", "+cmd|' /C calc'!A0", "-1+cmd|x", "@SUM(1)", "-5", "-1.5e-3"]
    first, *rest = spreadsheet_text(Table.of("x", pd.DataFrame({"=x": cells}))).split("\n")
    assert first == "'=x"
    assert rest == [f"'{cell}" for cell in cells[:4]] + cells[4:]
    gain = Table("x", pd.DataFrame({"x": [0.01], "e": [0.02]}), (Column("x", "estimate", form="+.2f", further=("e",)),))
    assert spreadsheet_text(gain) == "x\n+0.01 ± 0.02"
