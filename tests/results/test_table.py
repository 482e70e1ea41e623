"""A table holds numbers; units, sign and words come in when it is shown."""

import numpy as np
import pandas as pd
import pytest

from crashfuse.condition import Condition
from crashfuse.results.display import Display
from crashfuse.results.table import CONDITION, Column, Table, of_condition
from crashfuse.units import KPH_KG, Quantity, Sentence

METRIC = Display(unit="m/s²", deceleration=True, system=KPH_KG)
NAN = np.nan


@pytest.mark.parametrize(
    ("column", "row", "text"),
    [
        (Column("x"), {"x": True}, "yes"),
        (Column("x"), {"x": None}, "–"),
        (Column("x"), {"x": Sentence("at {}", Quantity((10.0,), "mph"))}, "at 16.1 km/h"),
        (Column("x", units="u"), {"x": "Peak", "u": "g"}, "Peak (m/s²)"),
        (Column("x", units="u"), {"x": "Ratio", "u": ""}, "Ratio"),
        (Column("x", "number", units="u", unitless=".2f"), {"x": 0.123, "u": ""}, "0.12"),
        (Column("x", "number", "mph"), {"x": 10.0}, "16.1"),
        (Column("x", "number", "g", "+.1f", flips=True), {"x": -1.0}, "+9.8"),
        (Column("x", "number", "g", "+.1f"), {"x": -1.0}, "−9.8"),
        (Column("x", "number", form=",.0f", missing="none"), {"x": 1234}, "1,234"),
        (Column("x", "number", missing="none"), {"x": NAN}, "none"),
        (Column("x", "share"), {"x": 0.951}, "95.1 %"),
        (Column("x", "share", "%", ".0f"), {"x": 0.951}, "95"),
        (Column("x", "interval", "g"), {"x": 1.0, "x lower": 0.9, "x upper": 1.1}, "9.8 [8.8, 10.8]"),
        (Column("x", "interval"), {"x": 1.0, "x lower": NAN, "x upper": NAN}, "1.0"),
        (Column("x", "interval"), {"x": 1.0, "x lower": -np.inf, "x upper": np.inf}, "1.0 [open]"),
        (Column("x", "interval"), {"x": NAN, "x lower": 2.0, "x upper": np.inf}, "≥ 2.0 (95 %, record too short)"),
        (
            Column("x", "interval", form=".3f", ends_form=".2f"),
            {"x": 1, "x lower": 0, "x upper": 2},
            "1.000 [0.00, 2.00]",
        ),
        (Column("x", "range", form=".2f", further=("a", "b")), {"a": 0.1, "b": 0.2}, "0.10–0.20"),
        (Column("x", "range", further=("a", "b")), {"a": NAN, "b": NAN}, "–"),
        (Column("x", "estimate", form="+.3f", further=("e",)), {"x": 0.01, "e": 0.002}, "+0.010 ± 0.002"),
        (Column("x", "estimate", form="+.3f", further=("e",)), {"x": -0.01, "e": NAN}, "−0.010"),
        (Column("x", "difference", further=("y",)), {"x": 1.26, "y": 1.04}, "+0.3"),
        (Column("x", "difference", further=("y",)), {"x": 1.26, "y": NAN}, "–"),
        (Column("x", "grade"), {"x": 0.9}, "0.900 Good"),
        (Column("x", "grade"), {"x": 0.94001}, "0.9400 Excellent"),
        (Column("x", "probability", confidence=0.95), {"x": 0.9499}, "0.9499"),
    ],
)
def test_a_number_becomes_words_in_the_units_of_its_reader(column: Column, row: dict[str, object], text: str) -> None:
    assert column.cell(row, METRIC).text == text


def test_a_condition_has_its_speed_and_both_weights_in_the_units_of_its_reader() -> None:
    row = of_condition(Condition.of_vector([15.0, 950.0, 700.0], (("drive", "AWD"),)))
    assert [column.cell(row, METRIC).text for column in CONDITION] == ["54.0", "950", "700"]
    assert row["drive"] == "AWD"


def test_headings_have_the_unit_of_the_reader() -> None:
    columns = (Column("Speed", "number", "mph"), Column("Band", "spread", "g"), Column("Ratio", "number"))
    table = Table("x", pd.DataFrame({column.title: [1.0, 2.0] for column in columns}), columns)
    assert list(table.texts(METRIC)) == ["Speed (km/h)", "Band (± m/s²)", "Ratio"]
    assert table.without("Band").head(1).to_string().split() == ["Speed", "(mph)", "Ratio", "1.0", "1.0"]
    assert "Speed (mph)" in table._repr_html_()


def test_sentences_of_a_table_can_still_be_said_in_other_units() -> None:
    """Where all cells are sentences, or some are empty; numbers beside them stay numbers."""
    at = Sentence("at {}", Quantity((10.0,), "mph"))
    table = Table.of("x", [{"Where": at, "n": 1.0}, {"Where": None, "n": 2}, {"n": None}], Column("n", "number"))
    assert table.texts(METRIC).to_numpy().tolist() == [["at 16.1 km/h", "1.0"], ["–", "2.0"], ["–", "–"]]
    assert table.frame["n"].dtype == float


def test_readers_see_a_dash_for_an_interval_wider_than_its_value() -> None:
    """The parts, of which files are made, keep its ends."""
    column = Column("Time of peak", "interval", "ms", widest=1.0)
    for ends, detail in (((24.9, 95.4), "[–]"), ((44.9, 75.4), "[44.9, 75.4]")):
        row = dict(zip(("Time of peak", "Time of peak lower", "Time of peak upper"), (60.1, *ends), strict=True))
        cell = column.cell(row, METRIC)
        assert cell.text == f"60.1 {detail}"
        assert cell.parts == ("60.1", *(f"{end}" for end in ends))
