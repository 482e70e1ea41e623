"""Tables on a page."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.certification.domain import Domain
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.results import result_tables
from crashfuse.results.display import Display
from crashfuse.results.planning import next_tests_table
from crashfuse.results.plots.conditions import condition_space
from crashfuse.results.result_tables import metrics_shown
from crashfuse.results.table import Column, Table
from crashfuse.signals.occupant import OccupantModel
from crashfuse.study.planning import ConditionRange, NextTests
from crashfuse.ui.kit.results import styled
from crashfuse.units import KPH_KG, LB, MPH, G
from tests.ui.conftest import as_read


def test_numbers_stand_at_the_right_and_words_at_the_left() -> None:
    """A rating with its grade begins with a number, stays in line; intervals are lighter."""
    row = {"Test": "T_1", "Peak": 25.3, "Peak lower": 24.1, "Peak upper": 26.0, "Rating": 0.85}
    columns = (Column("Test"), Column("Peak", "interval", "g"), Column("Rating", "grade"))
    styler = styled(Table("metrics", pd.DataFrame([row]), columns), Display())
    styler._compute()
    drawn = styler._translate(sparse_index=False, sparse_cols=False)
    right = {cell for style in drawn["cellstyle"] for cell in style["selectors"] if "right" in str(style["props"])}
    assert [cell.rpartition("_")[2] for cell in right] == ["col1"]
    assert [style["selector"] for style in drawn["table_styles"]] == ["th.col1"]
    cells = [as_read(str(cell["display_value"])) for cell in drawn["body"][0] if cell["is_visible"]]
    assert cells == ["T_1", "25.3 :gray[[24.1, 26.0]]", "0.850 Good"]
    assert "\N{NO-BREAK SPACE}" in drawn["body"][0][3]["display_value"]


def test_settings_of_the_occupant_stand_beside_its_metrics(campaign: Campaign) -> None:
    own = replace(campaign, occupant=OccupantModel(olc_restraint_mm=200.0), channel_filter_class=60.0)
    main, _ = metrics_shown([("Test", own.metrics_of(own.tests[0]))], own)
    expected = {"OLC, occupant load criterion, 65 + 200 mm, CFC 60 (g)", "VPI, vehicle pulse index, CFC 60 (g)"}
    assert {*main.texts()["Pulse metric"]} >= expected


def test_an_interval_that_does_not_hold_what_the_test_measured_is_coloured(campaign: Campaign) -> None:
    """Only that one; a metric that is not known is no miss, and without a test nothing is."""
    test = campaign.metrics_of(campaign.tests[0])
    misses = [replace(own, lower=(own.value or 0.0) + 1, upper=(own.value or 0.0) + 2) for own in test]
    holds = [replace(own, lower=(own.value or 0.0) - 1, upper=None) for own in test]
    unknown = [replace(own, lower=None, upper=None) for own in test]
    columns = [("Test", test), ("Off", misses), ("On", holds), ("Unknown", unknown)]
    main, more = metrics_shown(columns, campaign, test="Test")
    for table in (main, more):
        values = table.frame["Test"].notna().tolist()
        assert table.frame[["Test missed", "Off missed", "On missed", "Unknown missed"]].to_numpy().tolist() == [
            [False, is_known, False, False] for is_known in values
        ]
    assert not metrics_shown(columns[1:], campaign, test="Test")[0].is_marked
    html = styled(main, Display()).to_html()
    cells = re.findall(r"#T_\w+_row\d+_col(\d) *(?:, *#T_\w+)* *{\s*background-color", html)
    assert set(cells) == {"2"}  # after the metric's name and the test


def test_the_next_tests_show_their_gain_first_and_equal_digits(campaign: Campaign) -> None:
    """3.10 beside 3.09, not 3.1; whether it is an extrapolation stands beside the gain."""
    conditions = tuple(Condition.of_vector([mph * MPH, 2000 * LB, 1500 * LB]) for mph in (30, 61.5))
    over, after = ConditionRange.of(campaign.tests), np.array([3.1, 3.09]) * G
    table = next_tests_table(ranking := NextTests(campaign, over, conditions, 3.5 * G, after)).texts()
    assert table.columns[:4].tolist() == ["Rank", "Speed (mph)", "Gain (%)", "Extrapolation"]
    assert table["Band then (± g)"].tolist() == ["3.10", "3.09"]
    assert table["Speed (mph)"].tolist() == ["30.0", "61.5"]
    assert table["Gain (%)"].tolist() == ["11.4", "11.7"]
    assert table["Extrapolation"].tolist() == ["no", "yes"]
    metric = next_tests_table(ranking).texts(Display(unit="m/s²", system=KPH_KG))
    assert metric["Speed (km/h)"].tolist() == ["48.3", "99.0"]
    assert metric["Front weight (kg)"].tolist() == ["907", "907"]
    assert metric["Band then (± m/s²)"].tolist() == ["30.40", "30.30"]


def test_conditions_are_in_the_chosen_units_alone(campaign: Campaign) -> None:
    table = result_tables.tests_table(campaign).texts(Display(system=KPH_KG)).set_index("Test")
    assert table.loc["T1", ["Speed (km/h)", "Front weight (kg)", "Rear weight (kg)"]].tolist() == ["24.1", "907", "658"]
    assert not [name for name in table.columns if "mph" in name or "lb" in name]


@pytest.mark.parametrize("paired", [True, False])
def test_page_report_and_figure_say_one_range(campaign: Campaign, paired: bool) -> None:
    """A test far from all other runs is in range if it has a run at its own condition, and nowhere if it has none."""
    far = CrashTest("far", Condition.of_vector([30 * MPH, 2400 * LB, 1500 * LB]), campaign.tests[0].pulse)
    library = CaeLibrary(
        (*campaign.cae.ids, "its own"),
        (*campaign.cae.conditions, far.condition if paired else campaign.cae.conditions[0]),
        np.vstack([campaign.cae.accel_mps2, campaign.cae.accel_mps2[:1]]),
    )
    wider = replace(campaign, cae=library, tests=(*campaign.tests, far))
    shown = result_tables.tests_table(wider).texts().iloc[-1]
    legend = {trace.legendgroup for trace in condition_space(library, wider.tests).figure().data if trace.text}
    assert shown["Inside the CAE runs' range"] == ("yes" if paired else "no")
    assert shown["CAE pulse"] == ("its own" if paired else "emulator")
    assert ("Tests outside it: extrapolation" in legend) is not paired
    assert any("front weight" in why for why in Domain.of(wider).exceeded_by(far.condition)) is not paired
