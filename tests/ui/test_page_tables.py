"""Tables say what is asked for first, in the unit that was chosen."""

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.signals.metrics import Metric
from crashfuse.study.next_test import NextTest
from crashfuse.ui import page_tables
from crashfuse.units import LB, MPH


def test_accelerations_follow_the_unit_and_other_metrics_do_not() -> None:
    """10 g are 98.1 m/s², interval included; what is missing stays missing, and mm stay mm."""
    peak, olc = Metric("peak", 10.0, 9.0, None, "g"), Metric("olc", None, None, None, "g")
    crush = Metric("max_crush", 500.0, None, None, "mm")
    in_g = page_tables.metrics([("Test", [peak, olc, crush])]).data
    assert in_g["Pulse metric"].tolist()[0] == "Peak deceleration (g)"
    assert in_g["Test"].tolist() == ["10.0 [9.0, beyond the record]", "–", "500.0"]
    shown = page_tables.metrics([("Test", [peak, olc, crush])], "m/s²").data
    assert shown["Pulse metric"].tolist()[0] == "Peak deceleration (m/s²)"
    assert shown["Pulse metric"].tolist()[2] == "Maximum dynamic crush (mm)"
    assert shown["Test"].tolist() == ["98.1 [88.3, beyond the record]", "–", "500.0"]


def test_ratings_and_range_come_before_weights_and_factors(campaign: Campaign) -> None:
    """What lies beyond the edge of a narrow page is what can be done without."""
    columns = page_tables.conditions(campaign).data.columns.tolist()
    assert columns[:2] == ["Test", "Speed (mph)"]
    assert columns[2:6] == ["0–20 ms", "0–40 ms", "0–60 ms", "In CAE range"]
    assert {"Speed (km/h)", "Front (lb)", "Rear (lb)", "Paired run"} <= set(columns[6:])


def test_the_next_tests_show_their_gain_first_and_equal_digits() -> None:
    """3.10 beside 3.09, not 3.1; whether it is an extrapolation stands beside the gain."""
    ranked = [
        NextTest(Condition(30 * MPH, 2000 * LB, 1500 * LB), 3.5 * 9.80665, 3.1 * 9.80665),
        NextTest(Condition(31.5 * MPH, 2000 * LB, 1500 * LB), 3.5 * 9.80665, 3.09 * 9.80665, ("Extrapolation.",)),
    ]
    table = page_tables.next_tests(ranked).data
    assert table.columns[:4].tolist() == ["Rank", "Speed (mph)", "Gain (%)", "Extrapolation"]
    assert table["Band then (± g)"].tolist() == ["3.10", "3.09"]
    assert table["Speed (mph)"].tolist() == ["30.0", "31.5"]
    assert table["Gain (%)"].tolist() == ["11.4", "11.7"]
    assert table["Extrapolation"].tolist() == ["no", "yes"]
