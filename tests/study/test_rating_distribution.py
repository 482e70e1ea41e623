"""What a single test will rate follows from how left-out tests rated, and from how wide their bands were."""

import numpy as np
import pytest
from scipy.stats import t

from crashfuse.study.rating_distribution import RatingDistribution


def test_what_ratings_lack_is_log_t_and_other_campaigns_count_as_four_tests() -> None:
    """Of 0.9 and 0.8 the median is 1 - sqrt(0.1 x 0.2); five degrees of freedom for the spread."""
    logs = np.log([0.1, 0.2])
    scale = np.sqrt((4 * 0.4**2 + ((logs - logs.mean()) ** 2).sum()) / 5 * 1.5)
    found = RatingDistribution.learned(np.array([0.9, 0.8]))
    assert found.quantile(0.5) == pytest.approx(1 - np.sqrt(0.02))
    assert found.quantile(0.1) == pytest.approx(1 - np.exp(logs.mean() + t.ppf(0.9, 5) * scale))
    assert found.probability(0.85, None) == pytest.approx(t.cdf((np.log(0.15) - logs.mean()) / scale, 5))


def test_no_rating_is_above_one_or_below_zero() -> None:
    """However bad or good the left-out tests were."""
    for ratings in ([0.05, 0.6], [1.0, 1.0, 1.0], [0.999, 0.4]):
        found = RatingDistribution.learned(np.array(ratings))
        assert all(0 <= found.quantile(share) <= 1 for share in (0.001, 0.025, 0.5, 0.975, 0.999))


def test_a_rating_and_its_share_are_each_others_inverse() -> None:
    """As of every distribution."""
    found = RatingDistribution.learned(np.array([0.9, 0.7, 0.8]), np.array([0.95, 0.9, 0.9]), 0.85)
    for share in (0.1, 0.5, 0.9):
        assert found.cdf(found.quantile(share)) == pytest.approx(share)


def test_a_wider_band_than_those_of_left_out_tests_lowers_the_rating_by_half_as_much() -> None:
    """In logarithms: four times what the draws lack there is twice what the rating lacks."""
    ratings, drawn = np.array([0.9, 0.9]), np.array([0.95, 0.95])
    alike, wider = (RatingDistribution.learned(ratings, drawn, here) for here in (0.95, 0.8))
    assert alike.quantile(0.5) == pytest.approx(0.9)
    assert wider.quantile(0.5) == pytest.approx(0.8)
    assert wider.scale > alike.scale  # half is not known for certain


def test_the_range_holds_as_many_tests_as_it_says() -> None:
    """Ratings drawn with the usual spread about what bands say of them: 80 and 95 % of new ones lie inside."""
    rng, inside = np.random.default_rng(0), []
    for _ in range(400):
        drawn = 1 - np.exp(rng.normal(-3, 0.5, 9))
        lack = np.sqrt(1 - drawn) * np.exp(rng.normal(-0.7, 0.4, 9))
        found = RatingDistribution.learned(1 - lack[1:], drawn[1:], float(drawn[0]))
        inside.append([low < found.cdf(1 - lack[0]) < 1 - low for low in (0.1, 0.025)])
    assert np.mean(inside, axis=0) == pytest.approx([0.8, 0.95], abs=0.04)
