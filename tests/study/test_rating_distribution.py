"""What a single test will rate follows from how left-out tests rated, and from how wide their bands were."""

import numpy as np
import pytest
from scipy.stats import t

from crashfuse.approaches.base import Prediction
from crashfuse.condition import Condition
from crashfuse.signals.pulse import GRID_S
from crashfuse.signals.rating import rate_iso18571
from crashfuse.study.rating_distribution import RatingDistribution, agreement
from crashfuse.units import MPH


def test_what_ratings_lack_is_log_t_and_other_campaigns_count_as_four_tests() -> None:
    """Of 0.9 and 0.8 the median is 1 - sqrt(0.1 x 0.2); five degrees of freedom for the spread."""
    logs = np.log([0.1, 0.2])
    scale = np.sqrt((4 * 0.4**2 + ((logs - logs.mean()) ** 2).sum()) / 5 * 1.5)
    found = RatingDistribution.learned(np.array([0.9, 0.8]), np.zeros(2))
    assert found.quantile(0.5) == pytest.approx(1 - np.sqrt(0.02))
    assert found.quantile(0.1) == pytest.approx(1 - np.exp(logs.mean() + t.ppf(0.9, 5) * scale))
    assert found.probability(0.85, None) == pytest.approx(t.cdf((np.log(0.15) - logs.mean()) / scale, 5))


def test_no_rating_is_above_one_or_below_zero() -> None:
    """However bad or good the left-out tests were."""
    for ratings in ([0.05, 0.6], [1.0, 1.0, 1.0], [0.999, 0.4]):
        found = RatingDistribution.learned(np.array(ratings), np.zeros(len(ratings)))
        assert all(0 <= found.quantile(share) <= 1 for share in (0.001, 0.025, 0.5, 0.975, 0.999))


def test_a_rating_and_its_share_are_each_others_inverse() -> None:
    """As of every distribution."""
    found = RatingDistribution.learned(np.array([0.9, 0.7, 0.8]), np.arange(3.0), np.array([0.95, 0.9, 0.9]), 0.85)
    for share in (0.1, 0.5, 0.9):
        assert found.cdf(found.quantile(share)) == pytest.approx(share)


def test_draws_agree_as_they_would_be_rated_by_corridor_and_slope() -> None:
    """Draws that all differ by one share of the pulse are rated alike, on the rating's own time step as on ours."""
    condition = Condition.of_vector([15.0, 800.0, 700.0])
    pulse = 200 * np.sin(np.pi * np.minimum(GRID_S / 0.08, 1))
    rating = rate_iso18571(pulse[:750], 1.2 * pulse[:750], dt_s=8e-5)
    found = agreement(Prediction(condition, pulse, np.tile(1.2 * pulse, (7, 1))))
    assert found == pytest.approx((0.4 * rating.corridor + 0.2 * rating.slope) / 0.6, abs=0.002)
    assert agreement(Prediction(condition, pulse, np.tile(pulse, (7, 1)))) == pytest.approx(1)


def test_without_draws_nothing_is_known_of_their_agreement() -> None:
    """As of the raw CAE model, whose rating follows from left-out tests alone."""
    prediction = Prediction(Condition.of_vector([15.0, 800.0, 700.0]), np.ones(1250))
    assert np.isnan(agreement(prediction))
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
