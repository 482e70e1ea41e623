"""Expected rating of a prediction before there is a test to rate it against, and how the expectation came out."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from crashfuse.approaches.metric_calibration import Distribution
from crashfuse.campaign import Campaign
from crashfuse.crash_test import SPEED_STEP_MPS
from crashfuse.errors import require_number
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import grade, rate_windows
from crashfuse.signals.rating_explanation import rating_range
from crashfuse.study.estimate import Estimate
from crashfuse.units import MPH, Sentence, speed

_REACH_MPS = 5 * MPH
_LEAST = 3  # minimum number of tests, at any distance
_ALIKE_MPS = 0.1 * MPH  # no farther, as speeds are shown: a test as near as the last one is listed, too
_BESIDE_MPS = 1 * MPH  # a test this near counts as beside the condition
_SHARES = 0.5, 0.1, 0.9, 0.025, 0.975  # the median, the ends of the range that is shown, and of what is no surprise
_SPREAD, _KNOWN_TESTS = 0.4, 4  # what the log of a rating's distance to 1 scatters by, and how many tests that is worth
_HEEDED, _DOUBT = 0.5, 0.25  # how far ratings follow the agreement of draws, and the standard deviation of that
_THIRD_MPS = 10 * MPH  # a test this much farther away counts for a third
_LEAST_LACK = 1e-4  # of a rating to 1


@dataclass(frozen=True)
class RatingDistribution(Distribution):
    """Distribution of the rating of a single test: what it lacks to 1 is log-t, so that it cannot be above 1.

    ``centre`` and ``scale`` are of minus the logarithm of what it lacks.
    """

    @classmethod
    def learned(
        cls, ratings: FloatArray, away_mps: FloatArray, agreements: FloatArray | float = np.nan, here: float = np.nan
    ) -> Self:
        """From ratings of left-out tests; three of them say little of their spread, so that of other campaigns counts.

        ``away_mps`` are their differences in speed from the one asked for: the nearer, the more they count.
        ``agreements`` are those of the draws of each prediction, ``here`` that of the one asked for: where less is
        known, ratings are lower.
        """
        weights = np.exp((away_mps.min() - away_mps) / _THIRD_MPS)  # the nearest test counts once
        surer = np.nan_to_num(_logs(here) - _logs(agreements)) * np.ones_like(ratings)
        expected = _logs(ratings) + _HEEDED * surer
        centre = np.average(expected, weights=weights)
        freedom = _KNOWN_TESTS + weights.sum() - 1
        off = weights @ (expected - centre) ** 2
        variance = (_KNOWN_TESTS * _SPREAD**2 + off) / freedom * (1 + (weights**2).sum() / weights.sum() ** 2)
        scale = np.hypot(np.sqrt(variance), _DOUBT * np.average(surer, weights=weights))
        return cls(float(centre), float(scale), float(freedom))

    @property
    def _cut(self) -> float:
        return 0.0  # of a rating below 0 nothing is cut off

    def _place(self, x: float) -> float:
        return float(_logs(x))

    def quantile(self, share: float) -> float:
        """The rating that a share of tests stays below."""
        return -float(np.expm1(-(super().quantile(share) or 0.0)))


def _logs(ratings: FloatArray | float) -> FloatArray:
    return np.asarray(-np.log(np.maximum(1 - np.asarray(ratings), _LEAST_LACK)))


@dataclass(frozen=True, slots=True)
class ExpectedRating:
    """Rating of a single test at a condition, learned from tests that were each predicted as if they had not been run.

    Attributes
    ----------
    mean, lowest, highest : float
        Overall ISO/TS 18571 ratings, over one window, of those of them that are near the condition.
    median, lower, upper, least, most : float
        Of the rating of a test at the condition, with the central 80 % and 95 %; outside the latter it is a surprise.
    tests, reach_mps : tuple of str, float
        Ids of the near tests, nearest in speed first, and the speed difference of the farthest.
    farther, beyond : bool
        Whether it is farther in speed from all tests than any of these was from the others, and whether it is more than
        5 mph beyond all tests.
    side : {"", "slower", "faster"}
        What all tests are than it, if it is a step beyond all of them.
    """

    mean: float
    lowest: float
    highest: float
    median: float
    lower: float
    upper: float
    least: float
    most: float
    window_ms: float
    tests: tuple[str, ...]
    reach_mps: float
    farther: bool
    beyond: bool
    side: str

    @property
    def sentence(self) -> str:
        """The expected rating, and what it rests on."""
        n, rated = len(self.tests), rating_range(self.lowest, self.highest)
        where = f"up to {{}} {self.side}" if self.side else "within {}"
        return Sentence(
            f"We expect a rating of {self.range} over 0–{self.window_ms:g} ms (80 %, {self.likely}): "
            f"{n} left-out test{'s' * (n > 1)} {where} rated {rated}.",
            speed(self.reach_mps),
        )

    @property
    def range(self) -> str:
        """The likely range as displayed."""
        return rating_range(self.lower, self.upper)

    @property
    def likely(self) -> str:
        """The grades of the likely range, unless it is a guess."""
        return "a guess" if self.beyond else self.grades

    @property
    def grades(self) -> str:
        """Grades of both ends by the digits displayed."""
        return " to ".join(dict.fromkeys(grade(round(end, 2)) for end in (self.lower, self.upper)))

    def surprise(self, rating: float) -> str:
        """How a rating compares with what was expected, by the digits displayed."""
        lower, upper, least, most = (round(end, 2) for end in (self.lower, self.upper, self.least, self.most))
        rating = round(rating, 3)
        if lower <= rating <= upper:
            return "as expected"
        far = "" if least <= rating <= most else "far "
        return f"{far}{'below' if rating < lower else 'above'} what we expected"

    def is_missed_by(self, rating: float) -> bool:
        """Whether a rating is below what was expected."""
        return "below" in self.surprise(rating)

    def outcome(self, rating: float) -> str:
        """How the expectation came out, once the test is known."""
        rated, surprise = f"Rated {rating:.3f} ({grade(rating)})", self.surprise(rating)
        return f"{rated}, {surprise}: {self.range} (80 %)."


def expected_rating(estimate: Estimate, campaign: Campaign, window_ms: float = 60.0) -> ExpectedRating | None:
    """The rating of an estimate over [0, window_ms), once there is a test at its condition; None if none was left out.

    The range rests on all left-out tests, the nearer the more, and on how well the draws of their predictions agree.
    Near are those within 5 mph, at least three. The campaign is the one that the approach learned from.
    """
    require_number("window_ms", window_ms)
    speed_mps, left_out = estimate.condition.speed_mps, estimate.left_out_mps2
    speeds = np.array([test.condition.speed_mps for test in campaign.tests])
    tests = [test for test in campaign.tests if test.id in left_out]
    if not tests:
        return None
    tests.sort(key=lambda test: abs(test.condition.speed_mps - speed_mps))
    away = np.array([abs(test.condition.speed_mps - speed_mps) for test in tests])
    reach = max(_REACH_MPS, away[:_LEAST].max() + _ALIKE_MPS)
    near = tests[: int((away <= reach).sum())]
    ratings = [overall_rating(test.pulse, left_out[test.id], window_ms) for test in tests]
    agreements = np.array([estimate.agreements.get(test.id, np.nan) for test in tests])
    single = RatingDistribution.learned(np.array(ratings), away, agreements, estimate.agreement)
    median, lower, upper, least, most = map(single.quantile, _SHARES)
    below, above = speeds.min() - speed_mps, speed_mps - speeds.max()
    gaps = [np.sort(np.abs(speeds - test.condition.speed_mps))[1:2].sum() for test in near]  # to the next other test
    is_farther, is_beyond = np.abs(speeds - speed_mps).min() > max(*gaps, _BESIDE_MPS), max(below, above) > _REACH_MPS
    side = "faster" if below > SPEED_STEP_MPS else "slower" if above > SPEED_STEP_MPS else ""
    rated, ids, window = ratings[: len(near)], tuple(test.id for test in near), float(window_ms)
    numbers = float(np.mean(rated)), min(rated), max(rated), median, lower, upper, least, most, window
    return ExpectedRating(*numbers, ids, float(away[len(near) - 1]), bool(is_farther), bool(is_beyond), side)


def mean_near(estimate: Estimate, campaign: Campaign, tests: Sequence[str], window_ms: float) -> float:
    """Mean rating over [0, window_ms) of predictions of left-out tests."""
    left_out = estimate.left_out_mps2
    return float(np.mean([overall_rating(campaign.test(test).pulse, left_out[test], window_ms) for test in tests]))


def overall_rating(measured: Pulse, predicted_mps2: FloatArray, window_ms: float) -> float:
    """Overall rating of a predicted pulse over [0, window_ms)."""
    return _cached_overall(measured, predicted_mps2.astype(np.float64).tobytes(), float(window_ms))


@lru_cache(maxsize=512)  # at every condition the same tests are asked about; bytes, up to 10 kB, can be a key
def _cached_overall(measured: Pulse, predicted_mps2: bytes, window_ms: float) -> float:
    accel_mps2 = np.frombuffer(predicted_mps2)
    return rate_windows(measured, Pulse(GRID_S[: accel_mps2.size], accel_mps2), [window_ms])[window_ms].overall
