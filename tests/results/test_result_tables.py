"""Tables of results hold the numbers that they say, row by row, against pulses whose every number is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from crashfuse.cae_library import NAMED_LIMITS, RunQuality, judge_quality
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.results import result_tables as tables
from crashfuse.results.display import Display
from crashfuse.results.planning import curve_table
from crashfuse.signals.metrics import Metric
from crashfuse.signals.occupant import OccupantModel
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.planning import ConditionRange, NextTests, sweep_speed
from crashfuse.study.study import Fold, Study
from crashfuse.units import KPH, LB, MPH, G

SCALES = {"displacement_domain": 0.9, "cae": 0.7}  # an order of our own, which tables keep
SCORES = ["overall", "corridor", "phase", "magnitude", "slope"]
METRIC_COLUMNS = ("approach", "metric", "value", "lower", "upper", "unit", "basis", "of_pulse")


def study(campaign: Campaign, held_out: tuple[str, ...], scale: float = 1.0) -> Study:
    """A study in which each approach is off by its own factor, and by a common one."""
    config = StudyConfig(approaches=tuple(SCALES), seed=7, windows_ms=(20.0, 60.0))

    def fold(test: CrashTest) -> Fold:
        pulses = {name: scale * factor * test.pulse.accel_mps2 for name, factor in SCALES.items()}
        own = [Estimate(test.condition, accel, approach=name) for name, accel in pulses.items()]
        return Fold.of(test, own, config.windows_ms)

    return Study(campaign, config, tuple(fold(campaign.test(test_id)) for test_id in held_out))


def test_the_band_of_normal_draws_lies_1_96_standard_deviations_around_them(campaign: Campaign) -> None:
    """At each time the ends are the 2.5 % and 97.5 % quantiles in g, below and above; time counts up in ms."""
    centre, sd = -300 * np.sin(40 * GRID_S), 10 + 200 * GRID_S
    draws = centre + sd * norm.ppf(np.linspace(0, 1, 41).clip(1e-3, 1 - 1e-3))[:, None]  # every 2.5 % a draw
    shown = centre + 1.0  # the expected pulse need not be in the middle
    estimate = Estimate(campaign.tests[0].condition, shown, draws, approach="fused")
    table = tables.pulses_table([estimate])
    bands = ["lower_g", "upper_g", "whole_lower_g", "whole_upper_g"]
    assert table.columns.tolist() == ["held_out", "approach", "time_ms", "acceleration_g", *bands]
    assert table[["held_out", "approach"]].drop_duplicates().to_numpy().tolist() == [["", "fused"]]
    np.testing.assert_allclose(table["time_ms"], np.arange(1250) * 0.08, atol=1e-9)
    np.testing.assert_allclose(table["acceleration_g"], shown / 9.80665)
    np.testing.assert_allclose(table["lower_g"], (centre - 1.959964 * sd) / 9.80665, atol=1e-6)
    np.testing.assert_allclose(table["upper_g"], (centre + 1.959964 * sd) / 9.80665, atol=1e-6)


def test_a_pulse_without_draws_has_empty_ends(campaign: Campaign) -> None:
    """Each estimate has its own 1250 rows, in the order given; no band is no number."""
    test = campaign.tests[0]
    bare = Estimate(test.condition, test.pulse.accel_mps2, approach="cae")
    banded = replace(bare, approach="fused", draws_mps2=np.zeros((2, 1250)))
    table = tables.pulses_table([bare, banded])
    assert table["approach"].tolist() == ["cae"] * 1250 + ["fused"] * 1250
    assert table.groupby("approach")[["lower_g", "upper_g"]].count().to_numpy().tolist() == [[0, 0], [1250, 1250]]


def test_each_score_stands_in_the_row_of_its_test_approach_and_window(campaign: Campaign) -> None:
    """All five scores and the grade are those of ISO/TS 18571 for that pair of pulses."""
    table = tables.scores_table(study(campaign, ("T2", "T4")))
    assert table.columns.tolist() == ["held_out", "approach", "window_ms", *SCORES, "grade", "basis"]
    assert set(table["basis"]) == {"ISO/TS 18571:2024, 10 kHz, filtered as supplied"}
    keys = table[["held_out", "approach", "window_ms"]].to_numpy().tolist()
    assert keys == [[test, name, window] for test in ("T2", "T4") for name in SCALES for window in (20.0, 60.0)]
    for row in table.to_dict("records"):
        pulse = campaign.test(row["held_out"]).pulse
        predicted = replace(pulse, accel_mps2=SCALES[row["approach"]] * pulse.accel_mps2)
        rating = rate_windows(pulse, predicted, [row["window_ms"]])[row["window_ms"]]
        assert [row[name] for name in (*SCORES, "grade")] == [getattr(rating, name) for name in (*SCORES, "grade")]


def test_a_row_for_each_study_holds_the_mean_and_the_least_of_its_tests(campaign: Campaign) -> None:
    alone, groups = study(campaign, ("T2", "T3", "T4")), study(campaign, ("T2", "T4"), scale=0.8)
    groups = replace(groups, config=replace(groups.config, leave_out="speed group"))
    both = replace(alone, config=replace(alone.config, leave_out="both"), speed_groups=groups)
    table = tables.studies_table([("Tiny", both), ("Other", groups)])
    named = ("campaign", "preset", "seed", "left_out", "held_out")
    assert table.columns.tolist() == [*named, "approach", "window_ms", "tests", "mean", "least", "basis"]
    assert set(table["basis"]) == {"ISO/TS 18571:2024, 10 kHz, filtered as supplied"}
    about = table[["campaign", "left_out", "held_out", "tests"]].drop_duplicates().to_numpy().tolist()
    assert about == [
        ["Tiny", "test", "T2 T3 T4", 3],
        ["Tiny", "speed group", "T2 T4", 2],
        ["Other", "speed group", "T2 T4", 2],
    ]
    assert table["approach"].tolist() == [name for name in SCALES for _ in range(2)] * 3
    assert set(table["seed"]) == {7}
    for one, part in ((alone, table[:4]), (groups, table[4:8]), (groups, table[8:])):
        for row in part.to_dict("records"):
            overall = [fold.ratings[row["approach"]][row["window_ms"]].overall for fold in one.folds]
            assert row["mean"] == pytest.approx(sum(overall) / len(overall))
            assert row["least"] == min(overall)


def test_a_metric_stands_with_both_its_ends_and_what_it_rests_on(campaign: Campaign) -> None:
    """Each in the column of its name; what is not known is empty; the occupant's settings are named if unusual."""
    own = replace(campaign, channel_filter_class=60.0, occupant=OccupantModel(olc_free_flight_mm=50.0))
    found = (
        Metric("peak", 2.0, 1.0, 3.0, "g", of_pulse=1.9),
        Metric("t0", 70.0, 65.0, None, "ms"),
        Metric("olc", 9, 8, 10, "g"),
    )
    table = tables.metrics_table([("T1", "fused", found)], own)
    assert table.columns.tolist() == ["held_out", *METRIC_COLUMNS]
    assert table.iloc[0].tolist() == ["T1", "fused", "peak", 2.0, 1.0, 3.0, "g", "CFC 60", 1.9]
    assert table.loc[2, "basis"] == "50 + 235 mm, CFC 60"
    assert table.iloc[1, :5].tolist() == ["T1", "fused", "t0", 70.0, 65.0]
    assert np.isnan(table.loc[1, "upper"])


def test_pulses_and_metrics_of_a_study_begin_with_those_measured(campaign: Campaign) -> None:
    """Each pulse of 1250 rows, and its peak, in g: half sines of π/2 of their mean deceleration."""
    both, tests = study(campaign, ("T2", "T4")), [campaign.test(test_id) for test_id in ("T2", "T4")]
    table = tables.study_pulses(both)
    assert table["held_out"].tolist() == ["T2"] * 3750 + ["T4"] * 3750
    assert table["approach"].tolist() == [name for name in ("test", *SCALES) for _ in range(1250)] * 2
    pulses = [scale * test.pulse.accel_mps2 for test in tests for scale in (1, *SCALES.values())]
    np.testing.assert_allclose(table["acceleration_g"], np.concatenate(pulses) / G)
    table = tables.study_metrics(both)
    peaks = table[table["metric"] == "peak"]
    assert peaks["held_out"].tolist() == ["T2"] * 3 + ["T4"] * 3
    assert peaks["approach"].tolist() == ["test", *SCALES] * 2
    measured = [1.1 * np.pi / 2 * t.condition.speed_mps / (0.07 * t.condition.mass_kg / 1700) / G for t in tests]
    expected = [scale * peak for peak in measured for scale in (1.0, *SCALES.values())]
    np.testing.assert_allclose(peaks["value"], expected, rtol=1e-3)
    assert set(peaks["unit"]) == {"g"}


def test_a_sweep_has_a_row_for_each_number(campaign: Campaign) -> None:
    fits = [Fit.of(campaign, name) for name in ("cae", "displacement_domain")]
    sweep = sweep_speed(campaign, fits, campaign.test("T2").condition, np.array([15.0, 20.0, 30.0]) * MPH)
    table = sweep.table
    assert list(table.columns) == ["speed_mph", *METRIC_COLUMNS]
    assert set(table.basis) == {"filtered as supplied"}
    assert len(table) == 18 * (2 * 3 + 4)
    (row,) = table[(table.approach == "displacement_domain") & (table.metric == "peak") & (table.speed_mph == 20)].index
    peak = sweep.over_speed("displacement_domain", "peak")[1]
    assert table.loc[row, ["value", "lower", "upper"]].tolist() == [peak.value, peak.lower, peak.upper]
    tests = table[(table.approach == "test") & (table.metric == "delta_v")]
    np.testing.assert_allclose(tests.speed_mph, [15, 25, 26, 35])
    np.testing.assert_allclose(tests.value, 1.1 * tests.speed_mph * MPH / KPH, rtol=0.01)
    slow_test = replace(campaign.tests[0], pulse=Pulse(GRID_S, np.full(GRID_S.size, -1.0)))
    slow = replace(sweep, campaign=replace(campaign, tests=(slow_test,)), metrics={}).table
    assert slow[slow.metric == "t0"].value.isna().all()


def test_candidates_are_told_in_mph_lb_and_g_rounded(campaign: Campaign) -> None:
    condition = Condition.of_vector([50.04 * MPH, 2060.4 * LB, 1525 * LB])
    slower = replace(condition, speed_mps=12 * MPH, factors=(("drive", "AWD"),))
    over, after = ConditionRange.of(campaign.tests), np.array([3.0, 3.501]) * G
    table = NextTests(campaign, over, (slower, condition), 4.001 * G, after).table
    numbers = {"rank": 2, "speed (mph)": 50.0, "front weight (lb)": 2060, "rear weight (lb)": 1525}
    bands = {"band now (± g)": 4.0, "band then (± g)": 3.5, "gain (%)": 12.5, "extrapolation": "yes"}
    assert table.drop(columns="drive").iloc[1].to_dict() == numbers | bands
    assert (table["drive"][0], table["gain (%)"][0], table["extrapolation"][0]) == ("AWD", 25.0, "no")


def test_a_learning_curve_is_told_in_the_readers_unit(campaign: Campaign) -> None:
    """Ratings of 0.7, 0.8 and 0.9, half a band of 2 g in m/s²; a dash without a band, no row for the raw CAE model."""
    names = {"cae": np.nan, "fused": 2.0, "displacement_domain": np.nan}
    rows = [
        {"approach": name, "choice": "even", "n_tests": 3, "held_out": f"T{i}", "window_ms": 60.0,
         "overall": 0.7 + i / 10, "inside": 0.45 * half_g, "half_width_g": half_g}
        for name, half_g in names.items() for i in range(3)
    ]  # fmt: skip
    curve = LearningCurve(campaign, StudyConfig(approaches=tuple(names)), 1, pd.DataFrame(rows), (), 0.0)
    table = curve_table(curve).texts(Display(unit="m/s²"))
    assert table["Approach"].tolist() == ["Fused", "Displacement domain"]
    assert table.columns[-2:].tolist() == ["a(t) in band (%)", "Band (± m/s²)"]
    rated = ["3", "evenly", "3", "0.800 ± 0.058", "0.72–0.88"]
    assert table.iloc[:, 1:].to_numpy().tolist() == [[*rated, "90", "19.6"], [*rated, "–", "–"]]


def test_the_quality_of_runs_is_told_with_limits_and_worst_runs(campaign: Campaign) -> None:
    """In percent of what each is a share of; a quantity without a limit passes and fails none."""
    quality = [RunQuality(-0.02, 0.01, 0.0)] * len(campaign.cae)
    quality[3], quality[5] = RunQuality(0.01, 0.123, 0.0), RunQuality(0.02, None, 0.01)
    judged = judge_quality(replace(campaign.cae, quality=tuple(quality)), NAMED_LIMITS["euro-ncap-vt-2025"])
    assert tables.quality_table(judged).texts().to_numpy().tolist() == [
        ["Energy change, largest", "energy at the start", "none", "0", "0", "0", "−2", "C00"],
        ["Hourglass energy, largest", "largest internal energy", "< 10", "22", "1", "1", "12.3", "C03"],
        ["Added mass, largest", "mass at the start", "< 5", "24", "0", "0", "1", "C05"],
    ]
