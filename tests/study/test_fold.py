"""A fold rates what was predicted, and what was drawn, against the test."""

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.signals.metrics import Metric, pulse_metrics
from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.estimate import Estimate
from crashfuse.study.fold import Fold


@pytest.fixture(autouse=True)
def few_draws() -> None:
    """None here: as many are rated as are said to be."""


def test_drawn_pulses_are_rated_as_any_pulse_is(campaign: Campaign) -> None:
    """Of two draws, the test itself rates 1 and a softer pulse what ISO/TS 18571 gives it."""
    test = campaign.tests[1]
    softer = 0.8 * test.pulse.accel_mps2
    prediction = Prediction(test.condition, softer, np.array([test.pulse.accel_mps2, softer]))
    fold = Fold.of(test, [Estimate("fused", prediction, {}, 0.0)], [40.0, 60.0])
    for window in (40.0, 60.0):
        expected = rate_windows(test.pulse, Pulse(test.pulse.time_s, softer), [window])[window].overall
        np.testing.assert_allclose(fold.rating_draws("fused", window), [1.0, expected], atol=1e-3)
    lower, upper = fold.rating_interval("fused", 60.0)
    assert expected < lower < upper < 1.0


def test_the_interval_of_ratings_leaves_a_fortieth_out_at_either_end(campaign: Campaign) -> None:
    """Of 100 ever softer draws its ends lie between the third and the fourth, from below and from above."""
    test = campaign.tests[1]
    draws = np.linspace(1.0, 0.6, 100)[:, None] * test.pulse.accel_mps2
    fold = Fold.of(test, [Estimate("fused", Prediction(test.condition, draws[40], draws), {}, 0.0)], [60.0])
    lower, upper = fold.rating_interval("fused", 60.0)

    def rating(number: int) -> float:
        return rate_windows(test.pulse, Pulse(test.pulse.time_s, draws[number]), [60.0])[60.0].overall

    assert rating(97) < lower < rating(96) < rating(3) < upper < rating(2)


@pytest.mark.parametrize(("n_draws", "n_rated", "second"), [(100, 100, 1), (101, 51, 2), (400, 100, 4)])
def test_at_most_a_hundred_draws_are_rated_evenly_over_all(
    campaign: Campaign, n_draws: int, n_rated: int, second: int
) -> None:
    """Each as it would be alone."""
    test = campaign.tests[1]
    draws = np.linspace(0.5, 1.0, n_draws)[:, None] * test.pulse.accel_mps2
    fold = Fold.of(test, [Estimate("fused", Prediction(test.condition, draws[0], draws), {}, 0.0)], [20.0])
    found = fold.rating_draws("fused", 20.0)
    assert found.shape == (n_rated,)
    alone = rate_windows(test.pulse, Pulse(test.pulse.time_s, draws[second]), [20.0])[20.0].overall
    assert found[1] == pytest.approx(alone, abs=1e-3)
    assert fold.estimate("fused").prediction.draws_mps2 is draws
    assert fold.with_band == ("fused",)


@pytest.mark.parametrize("name", ["max_crush", "peak"])
def test_crush_and_peak_lie_inside_the_intervals_that_are_told(campaign: Campaign, name: str) -> None:
    """Which may hold the test where its draws do not, and the other way round; without any the draws count."""
    test = campaign.tests[1]
    measured = {own.name: own.value for own in pulse_metrics(test.pulse.accel_mps2, test.condition.speed_mps)}
    value, field = measured[name], {"max_crush": "crush", "peak": "peak"}[name]
    assert value is not None

    def inside(draws: FloatArray, lower: float | None, upper: float | None) -> bool:
        interval = Metric(name, value, lower, upper, "mm", drawn=True)
        others = tuple(own for own in pulse_metrics(draws[0], test.condition.speed_mps) if own.name != name)
        estimate = Estimate("fused", Prediction(test.condition, draws[0], draws), {}, 0.0)
        vars(estimate)["metrics"] = (interval, *others)  # instead of those that it would compute
        found = Fold.of(test, [estimate], [60.0]).coverage("fused")
        return bool(getattr(found, field))

    around, beside = (np.linspace(*ends, 21)[:, None] * test.pulse.accel_mps2 for ends in ((0.9, 1.1), (0.6, 0.8)))
    assert inside(beside, value - 1, value + 1)
    assert not inside(around, value + 1, value + 2)
    assert inside(around, None, None)
    assert not inside(beside, None, None)


def test_an_approach_without_a_band_has_no_spread(campaign: Campaign) -> None:
    """There is one pulse and one rating; who asks for a spread is told that there is none."""
    test = campaign.tests[1]
    fold = Fold.of(test, [Estimate("cae", Prediction(test.condition, test.pulse.accel_mps2), {}, 0.0)], [60.0])
    assert fold.with_band == ()
    with pytest.raises(UsageError, match="cae has no band"):
        fold.rating_draws("cae", 60.0)
    with pytest.raises(UsageError, match="There is no prediction of this test by 'fused'; choose from cae"):
        fold.estimate("fused")
    assert fold.ratings["cae"][60.0].overall == pytest.approx(1.0)
