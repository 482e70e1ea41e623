"""What rating may be expected is learned from tests that were left out, and from how well draws agree."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.signals.rating import rate_iso18571, rate_windows
from crashfuse.study.estimate import Estimate
from crashfuse.study.expected_rating import RatingDistribution, expected_rating
from crashfuse.units import MPH
from tests.conftest import not_none


def drawn(accel_mps2: FloatArray, spread: float) -> FloatArray:
    return accel_mps2 * (1 + spread * np.linspace(-1, 1, 41)[:, None])


def at(
    campaign: Campaign, mph: float, left_out: Mapping[str, FloatArray], spread: float = 0.1, there: float = 0.1
) -> Estimate:
    """An estimate at the campaign's weights and this speed, with bands of a relative width there and here."""
    condition, pulse = replace(campaign.tests[0].condition, speed_mps=mph * MPH), campaign.tests[0].pulse.accel_mps2
    agreements = {test: Prediction(condition, accel, drawn(accel, there)).agreement for test, accel in left_out.items()}
    draws = drawn(pulse, spread)
    return Estimate(
        condition, pulse, draws, approach="displacement_domain", left_out_mps2=left_out, agreements=agreements
    )


@pytest.fixture
def softer(campaign: Campaign) -> dict[str, FloatArray]:
    """Predictions of left-out tests that are a fifth too soft."""
    return {test.id: 0.8 * test.pulse.accel_mps2 for test in campaign.tests}


def rated(campaign: Campaign, left_out: Mapping[str, FloatArray]) -> list[float]:
    """The rating of each prediction against its test, over 0–60 ms."""
    pairs = ((test.pulse, replace(test.pulse, accel_mps2=left_out[test.id])) for test in campaign.tests)
    return [rate_windows(*pair, [60.0])[60.0].overall for pair in pairs]


def test_the_nearest_tests_stand_beside_it(campaign: Campaign, softer: dict[str, FloatArray]) -> None:
    """At 30 mph those of 25, 26 and 35 mph count, each rated against its own pulse; the one of 15 mph does not."""
    found, ratings = not_none(expected_rating(at(campaign, 30.4, softer), campaign)), rated(campaign, softer)[1:]
    assert found.tests == ("T3", "T4", "T2")
    assert found.mean == pytest.approx(sum(ratings) / 3)
    assert (found.lowest, found.highest) == (min(ratings), max(ratings))
    assert found.reach_mps == pytest.approx(5.4 * MPH)


def test_a_test_as_near_as_the_last_is_not_left_unsaid(campaign: Campaign, softer: dict[str, FloatArray]) -> None:
    """At 24.95 mph the third is 9.95 mph away, and a fourth, 10.02 mph away, is told to be as near."""
    speeds = {"T1": 15.0, "T2": 25.0, "T3": 26.0, "T4": 34.97}
    tests = tuple(
        replace(test, condition=replace(test.condition, speed_mps=speeds[test.id] * MPH)) for test in campaign.tests
    )
    for mph, said in ((24.95, {"T1", "T2", "T3", "T4"}), (24.85, {"T1", "T2", "T3"})):
        assert set(not_none(expected_rating(at(campaign, mph, softer), replace(campaign, tests=tests))).tests) == said


@pytest.mark.parametrize(("mph", "guessed"), [(9.9, True), (10.1, False), (39.9, False), (40.1, True)])
def test_far_beyond_all_tests_there_is_no_grade(
    campaign: Campaign, softer: dict[str, FloatArray], mph: float, guessed: bool
) -> None:
    """The tests, of 15 to 35 mph, say nothing of how errors grow there; a guess that is Excellent is none."""
    found = not_none(expected_rating(at(campaign, mph, softer), campaign))
    assert found.beyond is guessed
    assert (found.grades in found.sentence) is not guessed


def test_the_range_rests_on_all_tests_by_distance_and_on_the_bands(
    campaign: Campaign, softer: dict[str, FloatArray]
) -> None:
    """It is that of the rating's distribution; a band twice as wide as those of the left-out tests lowers it."""
    alike, wider = (not_none(expected_rating(at(campaign, 30.4, softer, spread), campaign)) for spread in (0.1, 0.3))
    away = np.abs([test.condition.speed_mps - 30.4 * MPH for test in campaign.tests])
    known, here = at(campaign, 30.4, softer, 0.3).agreements, at(campaign, 30.4, softer, 0.3).agreement
    own = RatingDistribution.learned(np.array(rated(campaign, softer)), away, np.array([*known.values()]), here)
    assert (wider.lower, wider.median, wider.upper) == pytest.approx([own.quantile(share) for share in (0.1, 0.5, 0.9)])
    assert wider.median < alike.median
    assert wider.lower < alike.lower


def test_a_condition_farther_from_tests_than_they_from_each_other_is_flagged(campaign: Campaign) -> None:
    """The nearest three to 60 mph have neighbours within 9 mph of them; 60 mph has none within 25."""
    known = {test.id: test.pulse.accel_mps2 for test in campaign.tests}
    near, far = (not_none(expected_rating(at(campaign, mph, known), campaign)) for mph in (30.0, 60.0))
    assert not near.farther
    assert far.farther
    assert (near.side, far.side) == ("", "slower")


@pytest.mark.parametrize(
    ("mph", "said"),
    [(14.5, "within"), (13.1, "within"), (12.9, "faster"), (35.5, "within"), (36.9, "within"), (37.1, "slower")],
)
def test_a_condition_hardly_beyond_all_tests_has_tests_on_no_side(campaign: Campaign, mph: float, said: str) -> None:
    """The tests are of 15 to 35 mph; nearer than 2 mph is at about the speed of one of them."""
    known = {test.id: test.pulse.accel_mps2 for test in campaign.tests}
    found = not_none(expected_rating(at(campaign, mph, known), campaign))
    assert found.side == ("" if said == "within" else said)
    assert f" {said} " in found.sentence


def test_where_no_test_was_left_out_nothing_is_expected(campaign: Campaign) -> None:
    assert expected_rating(at(campaign, 30.0, {}), campaign) is None


def test_what_ratings_lack_is_log_t_and_other_campaigns_count_as_four_tests() -> None:
    """Of 0.9 and 0.8 the median is 1 - sqrt(0.1 x 0.2); five degrees of freedom for the spread."""
    logs = np.log([0.1, 0.2])
    scale = np.sqrt((4 * 0.4**2 + ((logs - logs.mean()) ** 2).sum()) / 5 * 1.5)
    found = RatingDistribution.learned(np.array([0.9, 0.8]), np.zeros(2))
    assert found.quantile(0.5) == pytest.approx(1 - np.sqrt(0.02))
    assert found.quantile(0.1) == pytest.approx(1 - np.exp(logs.mean() + t.ppf(0.9, 5) * scale))
    assert found.probability(0.85, None) == pytest.approx(t.cdf((np.log(0.15) - logs.mean()) / scale, 5))


def test_no_rating_is_above_one_or_below_zero() -> None:
    for ratings in ([0.05, 0.6], [1.0, 1.0, 1.0], [0.999, 0.4]):
        found = RatingDistribution.learned(np.array(ratings), np.zeros(len(ratings)))
        assert all(0 <= found.quantile(share) <= 1 for share in (0.001, 0.025, 0.5, 0.975, 0.999))


def test_a_rating_and_its_share_are_each_others_inverse() -> None:
    found = RatingDistribution.learned(np.array([0.9, 0.7, 0.8]), np.arange(3.0), np.array([0.95, 0.9, 0.9]), 0.85)
    for share in (0.1, 0.5, 0.9):
        assert found.cdf(found.quantile(share)) == pytest.approx(share)


def test_draws_agree_as_they_would_be_rated_by_corridor_and_slope() -> None:
    """Draws that all differ by one share of the pulse are rated alike, on the rating's own time step as on ours."""
    condition = Condition.of_vector([15.0, 800.0, 700.0])
    pulse = 200 * np.sin(np.pi * np.minimum(GRID_S / 0.08, 1))
    rating = rate_iso18571(pulse[:750], 1.2 * pulse[:750], dt_s=8e-5)
    found = Prediction(condition, pulse, np.tile(1.2 * pulse, (7, 1))).agreement
    assert found == pytest.approx((0.4 * rating.corridor + 0.2 * rating.slope) / 0.6, abs=0.002)
    assert Prediction(condition, pulse, np.tile(pulse, (7, 1))).agreement == pytest.approx(1)


def test_without_draws_nothing_is_known_of_their_agreement() -> None:
    assert np.isnan(Prediction(Condition.of_vector([15.0, 800.0, 700.0]), np.ones(1250)).agreement)
    ratings = np.array([0.9, 0.8])
    alone = RatingDistribution.learned(ratings, np.zeros(2))
    assert RatingDistribution.learned(ratings, np.zeros(2), np.array([np.nan, 0.9]), np.nan) == alone


def test_nearer_tests_count_for_more_and_far_ones_for_nothing() -> None:
    """One 10 mph farther away counts 1/e, one at any distance alone once, one 100 mph away not at all."""
    logs, weights = np.log([0.1, 0.2]), np.array([1, np.exp(-1)])
    found = RatingDistribution.learned(np.array([0.9, 0.8]), np.array([5.0, 5.0 + 10 * MPH]))
    assert found.quantile(0.5) == pytest.approx(1 - np.exp(np.average(logs, weights=weights)))
    assert found.freedom == pytest.approx(4 + np.exp(-1))
    alone = RatingDistribution.learned(np.array([0.9]), np.array([20.0]))
    beside = RatingDistribution.learned(np.array([0.9, 0.2]), np.array([0.0, 100 * MPH]))
    assert (beside.centre, beside.scale) == pytest.approx((alone.centre, alone.scale), rel=1e-3)


def test_a_wider_band_than_those_of_left_out_tests_lowers_the_rating_by_half_as_much() -> None:
    """In logarithms: four times what the draws lack there is twice what the rating lacks."""
    ratings, drawn = np.array([0.9, 0.9]), np.array([0.95, 0.95])
    alike, wider = (RatingDistribution.learned(ratings, np.zeros(2), drawn, here) for here in (0.95, 0.8))
    assert alike.quantile(0.5) == pytest.approx(0.9)
    assert wider.quantile(0.5) == pytest.approx(0.8)
    assert wider.scale > alike.scale  # half is not known for certain


def test_the_range_holds_as_many_tests_as_it_says() -> None:
    """Ratings drawn with the usual spread about what bands say of them: 80 and 95 % of new ones lie inside."""
    rng, inside = np.random.default_rng(0), []
    for _ in range(400):
        drawn = 1 - np.exp(rng.normal(-3, 0.5, 9))
        lack = np.sqrt(1 - drawn) * np.exp(rng.normal(-0.7, 0.4, 9))
        found = RatingDistribution.learned(1 - lack[1:], np.zeros(8), drawn[1:], float(drawn[0]))
        inside.append([low < found.cdf(1 - lack[0]) < 1 - low for low in (0.1, 0.025)])
    assert np.mean(inside, axis=0) == pytest.approx([0.8, 0.95], abs=0.04)
