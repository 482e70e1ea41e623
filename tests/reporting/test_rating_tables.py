"""Tables of what a rating is made of have a row for each hump and for each stretch outside the corridor."""

import json

from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.rating_tables import excursions_table, explanation_record, humps_table
from crashfuse.signals.rating_explanation import explain_rating
from tests.signals.test_rating_explanation import TEST, bump, pulse


def test_humps_have_their_times_in_both_curves() -> None:
    """The third comes 4 ms late; one that is missing is named as missing."""
    late = humps_table(explain_rating(pulse(TEST), pulse(bump(15, 200) + bump(33, 250) + bump(54, 220)), 70.0))
    assert list(late["Hump"]) == ["1", "2", "3"]
    assert late["Late (ms)"].iloc[2] in ("+3.9", "+4.0", "+4.1")
    missing = humps_table(explain_rating(pulse(TEST), pulse(bump(15, 200) + bump(33, 250)), 70.0))
    assert list(missing["Peak, prediction (ms)"])[2] == "none"
    assert list(missing["Late (ms)"])[2] == "–"


def test_stretches_outside_the_corridor_are_in_the_readers_unit_and_sign() -> None:
    """A pulse 20 % too strong; shown as deceleration it lies above."""
    explanation = explain_rating(pulse(TEST), pulse(1.2 * TEST), 70.0)
    table = excursions_table(explanation)
    assert len(table) == len(explanation.excursions) > 0
    assert all(value.startswith("−") for value in table["Prediction minus test, largest (g)"])
    flipped = excursions_table(explanation, Display(unit="m/s²", deceleration=True))
    assert all(value.startswith("+") for value in flipped["Prediction minus test, largest (m/s²)"])
    assert excursions_table(explain_rating(pulse(TEST), pulse(TEST), 70.0)).empty


def test_the_record_is_plain_json_whose_losses_complete_the_rating() -> None:
    """In ms and g."""
    explanation = explain_rating(pulse(TEST), pulse(1.2 * TEST), 70.0)
    record = json.loads(json.dumps(explanation_record(explanation, "comparison")))
    assert abs(1 - sum(record["losses"].values()) - explanation.rating.overall) < 1e-12
    assert set(record["sentences"]) == {"overall", "corridor", "phase", "magnitude", "slope"}
    assert [hump["late_ms"] for hump in record["humps"]] == [0.0, 0.0, 0.0]
