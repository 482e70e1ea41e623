"""Tables on a page."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from pandas.io.formats.style import Styler

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.certification.domain import Domain
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.reporting.plots.conditions import condition_space
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.report import page as report_page
from crashfuse.signals.metrics import Metric, pulse_metrics
from crashfuse.signals.occupant import OccupantModel
from crashfuse.study.planning import NextTest
from crashfuse.ui.kit import results
from crashfuse.ui.kit.results import aligned
from crashfuse.ui.kit.text import as_read
from crashfuse.units import KPH_KG, LB, MPH, AccelerationUnit, G

UNBROKEN = "\N{NO-BREAK SPACE}"


def shown(cells: list[object]) -> tuple[bool, list[str]]:
    """True if a column stands at the right, and its cells as they are shown."""
    styler = aligned(pd.DataFrame({"Test": [f"T{i}" for i in range(len(cells))], "x": cells}).style)
    styler._compute()
    drawn = styler._translate(sparse_index=False, sparse_cols=False)
    styled = {cell for style in drawn["cellstyle"] for cell in style["selectors"] if "right" in str(style["props"])}
    assert not any(cell.endswith("col0") for cell in styled)  # names stay at the left
    assert any(style["selector"] == "th.col1" for style in drawn.get("table_styles", [])) == bool(styled)
    assert len(styled) in (0, len(cells))
    return bool(styled), [row[2]["display_value"] for row in drawn["body"]]


def test_numbers_of_any_type_stand_at_the_right_and_words_at_the_left() -> None:
    """Counts, signed numbers, ranges, open intervals; a rating with its grade begins with one, and stays in line."""
    for cells in ([1, 20], ["+0.28", "−1,200"], ["0.86–0.94", "–"], ["11 of 11", "9 of 11"], ["–", "–"]):
        assert shown(list(cells))[0], cells
    for words in (["0.846 Good", "0.951 Excellent"], ["", ""]):
        assert not shown(list(words))[0], words
    assert shown(["+0.075 ± 0.023", "−0.015"]) == (True, ["+0.075 ± 0.023", "−0.015"])
    texts = [Metric("olc", None, lower, 15.3, "g").text for lower in (None, 12.1)]
    right, cells = shown([*texts, "12.0 [≥ 11.0]"])
    assert right
    assert [cell.replace(UNBROKEN, " ") for cell in cells[:2]] == [
        f"{known} :gray[(95 %, record too short)]" for known in ("≤ 15.3", "12.1–15.3")
    ]


def test_accelerations_follow_the_unit_and_other_metrics_do_not(campaign: Campaign) -> None:
    """10 g are 98.1 m/s², interval included; what is missing stays missing, and mm stay mm."""
    accel = campaign.tests[0].pulse.accel_mps2
    draws = np.multiply.outer(np.linspace(0.9, 1.1, 101), accel)
    found = pulse_metrics(accel, campaign.tests[0].condition.speed_mps, draws_mps2=draws)
    peak, ratio = (next(m for m in found if m.name == name) for name in ("peak", "loading_ratio"))
    units: tuple[tuple[AccelerationUnit, float], ...] = (("g", 1.0), ("m/s²", G))
    for unit, factor in units:
        main, more = (table.data.set_index("Pulse metric")["Test"] for table in show(campaign, found, unit))
        assert list(main.index)[:2] == [f"Peak deceleration ({unit})", "Time of peak (ms)"]
        value, lower, upper = ((n or 0.0) * factor for n in (peak.value, peak.lower, peak.upper))
        assert main.iloc[0] == Metric("peak", value, lower, upper, unit).text
        assert f"OLC, occupant load criterion, filtered as supplied ({unit})" in main.index
        assert more["Front-to-back loading ratio"] == ratio.text
        assert f"Two-step pulse, G1 ({unit})" in more.index


def test_settings_of_the_occupant_stand_beside_its_metrics(campaign: Campaign) -> None:
    """With the filter class; the usual ones are left out."""
    own = replace(campaign, occupant=OccupantModel(olc_restraint_mm=200.0), channel_filter_class=60.0)
    main, _ = show(own, own.metrics_of(own.tests[0]), "g")
    expected = {"OLC, occupant load criterion, 65 + 200 mm, CFC 60 (g)", "VPI, vehicle pulse index, CFC 60 (g)"}
    assert {*main.data["Pulse metric"]} >= expected


def test_an_interval_that_does_not_hold_what_the_test_measured_is_coloured(campaign: Campaign) -> None:
    """Only that one; a metric that is not known is no miss, and without a test nothing is."""
    test = campaign.metrics_of(campaign.tests[0])
    misses = [replace(own, lower=(own.value or 0.0) + 1, upper=(own.value or 0.0) + 2) for own in test]
    holds = [replace(own, lower=(own.value or 0.0) - 1, upper=None) for own in test]
    unknown = [replace(own, lower=None, upper=None) for own in test]
    columns = [("Test", test), ("Off", misses), ("On", holds), ("Unknown", unknown)]
    assert results.missed_by(columns) == {"Off": {own.name for own in test if own.value is not None}}
    assert not results.missed_by(columns[1:])
    main, _ = results.metrics_tables(columns, campaign, Display())
    cells = re.findall(r"#T_\w+_row\d+_col(\d) *(?:, *#T_\w+)* *{\s*background-color", main.to_html())
    assert set(cells) == {"2"}  # after the metric's name and the test


def show(campaign: Campaign, found: tuple[Metric, ...], unit: AccelerationUnit) -> tuple[Styler, Styler]:
    """Both tables of a test's metrics."""
    return results.metrics_tables([("Test", found)], campaign, Display(unit=unit))


def test_the_next_tests_show_their_gain_first_and_equal_digits() -> None:
    """3.10 beside 3.09, not 3.1; whether it is an extrapolation stands beside the gain."""
    ranked = [
        NextTest(Condition.of_vector([mph * MPH, 2000 * LB, 1500 * LB]), 3.5 * G, then * G, why)
        for mph, then, why in ((30, 3.1, ()), (31.5, 3.09, ("Extrapolation.",)))
    ]
    table = results.next_tests_styled(ranked, Display()).data.rename(columns=as_read)
    assert table.columns[:4].tolist() == ["Rank", "Speed (mph)", "Gain (%)", "Extrapolation"]
    assert table["Band then (± g)"].tolist() == ["3.10", "3.09"]
    assert table["Speed (mph)"].tolist() == ["30.0", "31.5"]
    assert table["Gain (%)"].tolist() == ["11.4", "11.7"]
    assert table["Extrapolation"].tolist() == ["no", "yes"]
    metric = results.next_tests_styled(ranked, Display(unit="m/s²", system=KPH_KG)).data.rename(columns=as_read)
    assert metric["Speed (km/h)"].tolist() == ["48.3", "50.7"]
    assert metric["Front weight (kg)"].tolist() == ["907", "907"]
    assert metric["Band then (± m/s²)"].tolist() == ["30.40", "30.30"]


def test_conditions_are_in_the_chosen_units_alone(campaign: Campaign) -> None:
    """One column for each speed and weight; what may be cut off on a narrow page comes last."""
    table = results.conditions_table(campaign, Display(system=KPH_KG)).data.rename(columns=as_read).set_index("Test")
    assert table.columns[:5].tolist() == ["Speed (km/h)", "0–20 ms", "0–40 ms", "0–60 ms", "In CAE range"]
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
    on_page = results.conditions_table(wider, Display()).data.iloc[-1]
    in_report = report_page.tests_table(wider, Display()).iloc[-1]
    legend = {trace.legendgroup for trace in condition_space(library, wider.tests).data if trace.text}
    assert on_page["In CAE range"] == in_report["Inside the CAE runs' range"] == ("yes" if paired else "no")
    assert on_page["Paired run"] == ("its own" if paired else "none")
    assert ("Tests outside it: extrapolation" in legend) is not paired
    assert any("front weight" in why for why in Domain.of(wider).exceeded_by(far.condition)) is not paired
