"""A metric's distribution at a single test: the shape from the draws, place and width from left-out tests."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.ndimage import gaussian_filter1d

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.metric_calibration import (
    MATCHED,
    Distribution,
    calibrated_metrics,
    drawn_metrics,
    metric_distributions,
    metric_errors,
    representative_pulses,
    standardised_error,
)
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.signals.metrics import METRIC_LABELS, metric_values, pulse_metrics
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.units import G
from tests.conftest import not_none

NONE = np.empty(0)
DRAWS = stats.norm(100.0, 5.0).ppf((np.arange(2000) + 0.5) / 2000)


def spread(draws: FloatArray = DRAWS, errors: FloatArray = NONE, metric: str = "") -> Distribution:
    """The calibrated distribution of draws, which there must be."""
    return not_none(Distribution.of(draws, errors, metric))


def ends(distribution: Distribution) -> tuple[float, float]:
    """Both ends of the 95 % interval, which there must be."""
    lower, upper = map(not_none, distribution.interval)
    return lower, upper


def test_without_left_out_tests_the_interval_is_about_that_of_normal_draws() -> None:
    """Eight tests' worth of doubt at a scale below 1 has about the 95 % interval of the normal."""
    np.testing.assert_allclose(ends(spread()), stats.norm(100.0, 5.0).interval(0.95), atol=0.4)


@pytest.mark.parametrize(("centre", "scale"), [(3.5, 2.0), (0.1, 1.0), (100.0, 5.0)])
def test_a_metric_is_a_positive_number(centre: float, scale: float) -> None:
    """Where t would reach below 0 it is cut off there; else nothing changes."""
    found, law = Distribution(centre, scale, 10.0), stats.t(10, centre, scale)
    assert 0 < ends(found)[0] < not_none(found.median) < ends(found)[1]
    for share in (0.025, 0.5, 0.975):
        value = not_none(found.quantile(share))
        assert (law.cdf(value) - law.cdf(0)) / (1 - law.cdf(0)) == pytest.approx(share)
        assert found.cdf(value) == pytest.approx(share)
    assert found.cdf(-1.0) == 0


def test_left_out_errors_move_and_scale_it_as_if_eight_more_tests_were_usual() -> None:
    """Centre, scale and degrees of freedom follow from the errors in closed form."""
    errors = np.array([1.0, -0.5, 2.0, 1.5, np.nan])
    found = spread(errors=errors)
    moved = 4.0 / (4 + 8)
    scale = np.sqrt((8 * 0.88**2 + ((errors[:4] - moved) ** 2).sum()) / 12)
    np.testing.assert_allclose(found.centre, 100 + 5 * moved, rtol=1e-3)
    np.testing.assert_allclose(found.scale, 5 * scale, rtol=2e-3)
    assert found.freedom == 12
    law = stats.t(12, found.centre, found.scale)
    np.testing.assert_allclose(ends(found), law.interval(0.95), rtol=1e-9)
    np.testing.assert_allclose(found.cdf(97.0), law.cdf(97.0), rtol=1e-9)


@pytest.mark.parametrize("errors", [NONE, np.array([1.0, -0.5, 2.0, 1.5])])
def test_a_probability_is_the_mean_of_those_that_the_tests_leave_open(errors: FloatArray) -> None:
    """A normal law whose scale and centre are drawn from what is known of them is Student's t."""
    found, rng = spread(errors=errors), np.random.default_rng(0)
    scale = found.scale * np.sqrt(found.freedom / rng.chisquare(found.freedom, 200_000))
    centre = found.centre + scale * rng.standard_normal(scale.size) / np.sqrt(found.freedom + 1)
    for limits in ((None, 109.0), (93.0, None), (95.0, 112.0)):
        lower, upper = (own if end is None else end for own, end in zip((-np.inf, np.inf), limits, strict=True))
        law = stats.norm(centre, scale * np.sqrt(found.freedom / (found.freedom + 1)))
        simulated, by_law = law.cdf(upper) - law.cdf(lower), found.probabilities(*limits)
        assert by_law.mean() == pytest.approx(found.probability(*limits), abs=2e-3)
        shares = [0.025, 0.5, 0.975]
        np.testing.assert_allclose(np.quantile(by_law, shares), np.quantile(simulated, shares), atol=0.02)
    assert np.ptp(replace(found, freedom=1e6).probabilities(None, 109.0)) < 0.01
    assert replace(found, scale=0.0).probabilities(None, 109.0).tolist() == [1.0]
    cut = replace(found, centre=3.0, lowest=0.1, highest=0.2)
    for limits in ((None, 5.0), (5.0, None)):
        assert cut.probabilities(*limits).mean() == pytest.approx(cut.probability(*limits), abs=0.01)


def test_the_interval_of_a_probability_holds_the_true_one() -> None:
    """Of 400 vehicles whose errors scatter as usual vehicles' do, 11 tests each: 95 % of them."""
    rng, held = np.random.default_rng(1), []
    for _ in range(400):
        scale = 0.88 * np.sqrt(8 / rng.chisquare(8))
        moved = scale * rng.standard_normal() / np.sqrt(8)
        found = spread(errors=rng.normal(moved, scale, 11))
        lower, upper = np.quantile(found.probabilities(None, 107.0), [0.025, 0.975])
        held.append(lower <= stats.norm(100 + 5 * moved, 5 * scale).cdf(107.0) <= upper)
    assert np.mean(held) == pytest.approx(0.95, abs=0.03)


@pytest.mark.slow
def test_where_tests_are_far_off_the_draws_the_interval_holds_what_it_promises() -> None:
    """With 200 left-out tests more than twice as scattered as the draws say, it holds 95 % of new ones."""
    rng = np.random.default_rng(0)
    held = []
    for _ in range(40):
        errors = np.array([standardised_error(DRAWS, y) for y in rng.normal(102.0, 12.0, 200)])
        lower, upper = ends(spread(errors=errors))
        held.append(((lower < (new := rng.normal(102.0, 12.0, 500))) & (new < upper)).mean())
    assert 0.935 < np.mean(held) < 0.96


def test_one_odd_test_does_not_set_the_scale_alone() -> None:
    """An error beyond five spreads counts as five."""
    ordinary = np.array([0.5, -0.5] * 5)
    assert spread(errors=np.r_[ordinary, 80.0]) == spread(errors=np.r_[ordinary, 5.0])
    assert spread(errors=np.r_[ordinary, 5.0]).scale > spread(errors=np.r_[ordinary, 4.0]).scale


def test_crush_is_known_no_better_than_tests_repeat() -> None:
    """Draws that agree leave 1.5 % of the crush, in the unit of errors, too; a spread of 5 % hides nearly all of it."""
    sure = np.full(400, 300.0)
    assert standardised_error(sure, 309.0, "max_crush") == pytest.approx(2.0)
    assert spread(sure, metric="max_crush").scale == pytest.approx(0.8 * 0.015 * 300)
    assert spread(sure, metric="olc").scale == 0.0
    wider = spread(metric="max_crush").scale / spread(metric="olc").scale
    assert wider == pytest.approx(0.8 / 1.05 * np.hypot(5, 1.5) / 5, rel=1e-3)


def test_outer_draws_do_not_count() -> None:
    """One component of a mixture may give a few wild draws at both ends: they change nothing."""
    wild = np.r_[DRAWS[100:-100], np.full(100, 1.0), np.full(100, 1e4)]
    np.testing.assert_allclose(ends(spread(wild)), ends(spread()), rtol=1e-3)


@pytest.mark.parametrize(
    ("end", "lowest", "highest"), [(np.inf, 0.0, 0.05), (-np.inf, 0.05, 0.0), (np.nan, 0.05, 0.05)]
)
def test_draws_beyond_the_record_leave_that_end_open(end: float, lowest: float, highest: float) -> None:
    """One draw in twenty that does not stop: no probability is certain beyond, and that end is not known."""
    found = spread(np.r_[DRAWS[:1900], np.full(100, end)])
    assert (found.lowest, found.highest) == (lowest, highest)
    lower, upper = found.interval
    assert (lower is None, upper is None) == (lowest > 0, highest > 0)
    assert found.probability(None, 1e9) == pytest.approx(1 - highest)
    assert found.probability(0.0, None) == pytest.approx(1 - lowest)


def test_a_draw_that_creeps_on_leaves_no_doubt_that_the_vehicle_stops(campaign: Campaign) -> None:
    """With a twentieth of the speed left at 100 ms in one draw of twenty, a limit of twice the crush is surely met."""
    test = campaign.tests[1]
    speed = test.condition.speed_mps
    draws = np.linspace(0.95, 1.05, 400)[:, None] * test.pulse.accel_mps2
    change = float(np.trapezoid(test.pulse.accel_mps2, dx=test.pulse.dt_s))
    draws[::20] = -0.95 * speed / change * test.pulse.accel_mps2
    drawn = drawn_metrics(Prediction(test.condition, test.pulse.accel_mps2, draws))
    found = not_none(metric_distributions(drawn, {})["max_crush"])
    assert found.highest == 0.0
    assert found.probability(None, 2 * found.centre) > 0.999


@pytest.mark.parametrize("end", [np.inf, -np.inf, np.nan])
def test_too_many_draws_beyond_the_record_leave_nothing_to_tell(end: float) -> None:
    """With more than one draw in ten beyond it there is no distribution, and no error of a left-out test."""
    draws = np.r_[DRAWS[300:], np.full(300, end)]
    assert Distribution.of(draws, NONE) is None
    assert np.isnan(standardised_error(draws, 100.0))
    assert np.isnan(standardised_error(DRAWS, end))


def test_a_time_within_the_pulse_is_no_later_than_its_end() -> None:
    """The grid ends at 99.92 ms; a mass has no such limit."""
    late = DRAWS - 3.0
    assert spread(late).interval[1] > 105.0  # type: ignore[operator]
    assert not_none(Distribution.of(late, NONE, "peak_time")).interval[1] == pytest.approx(99.92)


def test_the_median_is_the_middle_of_the_interval() -> None:
    """Left-out tests that came out 1.8 scales higher move it by half of that, eight tests against eight of others."""
    assert spread().median == pytest.approx(100.0, abs=0.1)
    assert spread(errors=np.full(8, 1.8)).median == pytest.approx(100.0 + 0.9 * 5.0, abs=0.1)
    assert Distribution(70.0, 60.0, 8.0, highest=0.6).median is None


def test_an_interval_from_zero_to_beyond_the_record_says_nothing() -> None:
    """At least 1 ms is true of any time: neither end is known; one far above 0 is, and one below a known end."""
    wide = Distribution(70.0, 60.0, 8.0, highest=0.05)
    assert wide.interval == (None, None)
    lower, upper = replace(wide, scale=5.0).interval
    assert lower is not None
    assert (lower > 50.0, upper) == (True, None)
    assert 0 < ends(replace(wide, highest=0.0))[0] < 20


def test_a_value_without_draws_is_judged_by_left_out_tests_alone() -> None:
    """Its errors are shares of it: Student's t with as many degrees of freedom as there are tests."""
    value = np.array([200.0])
    errors = np.array([standardised_error(value, y) for y in (220.0, 190.0, 210.0)])
    np.testing.assert_allclose(errors, [0.1, -0.05, 0.05])
    found = spread(value, errors)
    assert (found.centre, found.freedom) == (200.0, 3)
    assert found.scale == pytest.approx(200 * np.sqrt(0.015 / 3))
    assert Distribution.of(value, NONE) is None


def test_errors_of_left_out_tests_are_those_of_their_metrics(campaign: Campaign) -> None:
    """Draws around a pulse 5 % too hard: the error in the peak is that of the normal scale of the draws' peaks."""
    test = campaign.tests[1]
    factors = 1.05 + 0.02 * stats.norm.ppf((np.arange(400) + 0.5) / 400)
    draws = factors[:, None] * test.pulse.accel_mps2
    said = Prediction(test.condition, 1.05 * test.pulse.accel_mps2, draws)
    errors = metric_errors({test.id: said}, campaign)
    assert list(errors) == list(METRIC_LABELS)
    np.testing.assert_allclose(errors["peak"], [-0.05 / 0.02], rtol=2e-2)
    np.testing.assert_allclose(drawn_metrics(said)["peak"], -draws.min(axis=1) / G)
    assert metric_errors({}, campaign)["peak"].shape == (0,)


def test_metrics_are_those_of_a_single_test_beside_those_of_the_averaged_pulse(campaign: Campaign) -> None:
    """Draws 5 % above their average; the interval widens with the errors; without draws the pulse is all there is."""
    test = campaign.tests[1]
    factors = 1 + 0.02 * stats.norm.ppf((np.arange(400) + 0.5) / 400)
    said = Prediction(test.condition, test.pulse.accel_mps2 / 1.05, factors[:, None] * test.pulse.accel_mps2)
    usual, wide = (calibrated_metrics(said, drawn_metrics(said), {"peak": np.array(z)}) for z in ([], [3.0, -3.0] * 5))
    raw = pulse_metrics(said.accel_mps2, test.condition.speed_mps)
    assert [metric.of_pulse for metric in usual] == [metric.value for metric in raw]
    assert usual[0].value == pytest.approx(1.05 * float(raw[0].value or 0), rel=1e-3)
    widths = [float(own[0].upper or 0) - float(own[0].lower or 0) for own in (usual, wide)]
    assert widths[1] == pytest.approx(
        widths[0] * np.sqrt((8 * 0.9**2 + 90) / 18) / 0.9 * stats.t(18).ppf(0.975) / stats.t(8).ppf(0.975), rel=1e-6
    )
    assert usual[1:] == wide[1:]
    odd = factors > 1.02  # fold in another way, and have metrics of their own
    both = calibrated_metrics(replace(said, apart=odd, apart_as="T9"), drawn_metrics(said), {})
    only = replace(said, draws_mps2=not_none(said.draws_mps2)[odd])
    expected = calibrated_metrics(only, drawn_metrics(only), {})[0]
    folded = both[0].folds["T9"]
    assert (folded.value, folded.lower, folded.upper) == (expected.value, expected.lower, expected.upper)
    assert both[0].value == usual[0].value
    alone = calibrated_metrics(Prediction(test.condition, said.accel_mps2), {}, {})
    assert all(m.lower is None and m.value == m.of_pulse for m in alone)


def humped(n: int, seed: int = 0) -> Prediction:
    """Draws of a short hump on a long half sine that come earlier or later, so that their average is flatter."""
    rng = np.random.default_rng(seed)
    late, large = 0.003 * rng.standard_normal((n, 1)), 1 + 0.05 * rng.standard_normal((n, 1))
    waves = np.sin(np.pi * np.clip(GRID_S / 0.08, 0, 1)) + 0.8 * np.exp(-(((GRID_S - 0.045 - late) / 0.004) ** 2))
    noise = gaussian_filter1d(rng.standard_normal((n, GRID_S.size)), 60, axis=1)  # standard deviation 4.8 ms
    draws = -25 * G * large * waves + 1.5 * G * noise / noise.std() * (GRID_S > 0.01)
    return Prediction(Condition.of(speed_mps=12.0, front_weight_kg=900, rear_weight_kg=700), draws.mean(axis=0), draws)


def test_a_representative_pulse_has_the_metrics_of_a_test_where_the_average_has_lower_ones() -> None:
    """Peak, SM25, OLC and crush are the medians that a single test shows; errors of left-out tests move it along."""
    prediction = humped(300)
    errors = {"peak": np.array([0.5, 1.0, 0.8])}
    medians = {each.name: each.value for each in calibrated_metrics(prediction, drawn_metrics(prediction), errors)}
    averaged = metric_values(prediction.accel_mps2, 12.0)
    assert averaged["peak"] < 0.97 * (medians["peak"] or 0.0)
    reached = metric_values(representative_pulses(prediction, drawn_metrics(prediction), errors)[0], 12.0)
    for name in MATCHED:
        assert reached[name] == pytest.approx(medians[name], rel=2e-3)
    assert abs(reached["t0"] - averaged["t0"]) < 1.0  # ms: it stays a pulse of this crash


def test_draws_as_single_tests_are_spread_as_errors_are() -> None:
    """Left-out tests say that draws differ too much: theirs is the spread of metrics, in the order of the draws."""
    prediction = humped(200)
    errors = {name: np.tile([0.3, -0.3], 20) for name in MATCHED}
    drawn = drawn_metrics(prediction)
    reached = metric_values(representative_pulses(prediction, drawn, errors, range(200))[1:], 12.0)
    distributions = metric_distributions(drawn, errors)
    for name in MATCHED:
        distribution = not_none(distributions[name])
        shares = [distribution.cdf(value) for value in reached[name]]
        assert stats.kstest(shares, "uniform").statistic < 0.096  # 95 % of 200 uniform draws
        assert stats.spearmanr(reached[name], drawn[name]).statistic > 0.85


def test_without_draws_or_where_some_never_stop_nothing_is_made_up() -> None:
    """The pulse stays as it is; a metric that some draws lack is not asked for."""
    prediction = humped(50)
    alone = replace(prediction, draws_mps2=None)
    np.testing.assert_array_equal(representative_pulses(alone, drawn_metrics(alone), {})[0], prediction.accel_mps2)
    fast = replace(prediction, condition=replace(prediction.condition, speed_mps=40.0))  # none stops in the record
    pulse = representative_pulses(fast, drawn_metrics(fast), {})[0]
    assert np.isfinite(pulse).all()
    peak = not_none(metric_distributions(drawn_metrics(fast), {})["peak"])
    assert metric_values(pulse, 40.0)["peak"] == pytest.approx(peak.median, rel=2e-3)
