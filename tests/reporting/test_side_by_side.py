"""Metrics of several predictions: differences are from the first, in the reader's units."""

from dataclasses import replace

import pandas as pd
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.reporting.side_by_side import cautions, predictions_table, side_by_side
from crashfuse.signals.metrics import Metric
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit
from crashfuse.units import KPH, LB, MPH, G


def predicted(campaign: Campaign, speed_mph: float, seed: int = 0, **changed: float | None) -> PredictedPulse:
    """At the condition of a test but for its speed, with that test's metrics, some of them changed."""
    condition = replace(campaign.tests[0].condition, speed_mps=speed_mph * MPH)
    own = campaign.metrics_of(campaign.tests[0])
    metrics = tuple(Metric(m.name, changed.get(m.name, m.value), None, None, m.unit) for m in own)
    found = Estimate("cae", Prediction(condition, campaign.tests[0].pulse.accel_mps2), {}, 0.0)
    vars(found)["metrics"] = metrics
    return PredictedPulse(campaign, (found,), StudyConfig(seed=seed))


def test_each_column_is_followed_by_its_differences_from_the_first(campaign: Campaign) -> None:
    """Rounded as the values are; unknown where one of both is."""
    base = predicted(campaign, 20, peak=20.0, max_crush=500.0, t0=None)
    other = predicted(campaign, 21, peak=23.25, max_crush=499.99, t0=70.0)
    table = side_by_side([base, other]).set_index("Pulse metric")
    assert list(table) == ["20.0 mph", "21.0 mph", "21.0 mph − 20.0 mph"]
    assert table.loc["Peak deceleration (g)", "21.0 mph − 20.0 mph"] == "+3.2"
    assert table.loc["Maximum dynamic crush (mm)", "21.0 mph − 20.0 mph"] == "0.0"
    assert table.loc["Time of zero velocity (TTZV) (ms)", "21.0 mph − 20.0 mph"] == "–"
    in_si = side_by_side([base, other], Display(unit="m/s²"))
    peak = in_si.set_index("Pulse metric").loc["Peak deceleration (m/s²)"]
    assert float(peak["21.0 mph − 20.0 mph"]) == pytest.approx(3.25 * G, abs=0.05)


def test_a_column_beside_says_where_it_is_an_extrapolation(campaign: Campaign) -> None:
    """Of the first column the page and the report speak themselves."""
    far = predicted(campaign, 61)  # beyond all CAE runs
    (outside,) = cautions([far, predicted(campaign, 60)])
    assert outside.startswith("60.0 mph: Extrapolation: speed 60.0 mph lies outside")
    assert cautions([far, predicted(campaign, 20)]) == []


def test_another_seed_is_told_by_it(campaign: Campaign) -> None:
    """At the same condition and at others; what the first column says of it, its extrapolation, is not said again."""
    first, *others = (predicted(campaign, mph, seed) for mph, seed in ((60, 0), (60, 1), (61, 0), (61, 1)))
    columns = list(side_by_side([first, *others]))[1:]
    names = [name for name in columns if " − " not in name]
    assert names == ["60.0 mph", "60.0 mph, seed 1", "61.0 mph", "61.0 mph, seed 1"]
    assert all("seed 1" not in sentence for sentence in cautions([first, others[0]]))


def test_a_file_holds_every_approach_at_every_condition(campaign: Campaign) -> None:
    """Numbered, in the units of all files, with the difference from the first condition by the same approach."""
    fit = Fit.of(campaign, "cae", StudyConfig(approaches=("cae",)))
    conditions = [campaign.tests[0].condition, Condition.of_vector([64 * KPH, 900.0, 700.0], (("drive", "FWD"),))]
    config = StudyConfig(seed=1)
    table = predictions_table([PredictedPulse(campaign, (fit.estimate(own),), config) for own in conditions])
    assert (set(table["preset"]), set(table["seed"])) == ({"fast"}, {1})
    first, second = (own.set_index("metric") for _, own in table.groupby("id", sort=False))
    assert set(first["speed_mph"]) == {15.0}
    assert second["speed_mph"].to_numpy() == pytest.approx(64 * KPH / MPH)
    assert second["front_weight_lb"].to_numpy() == pytest.approx(900.0 / LB)
    assert (set(first["drive"]), set(second["drive"])) == ({dict(conditions[0].factors).get("drive", "")}, {"FWD"})
    assert (first["difference"].dropna() == 0).all()
    pd.testing.assert_series_equal(second["difference"], second["value"] - first["value"], check_names=False)
