"""Expected rating of a prediction before there is a test to rate it against, and how the expectation came out."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import grade, rate_windows
from crashfuse.study.rating_distribution import RatingDistribution
from crashfuse.units import MPH
from crashfuse.wording import Sentence, speed

_REACH_MPS = 5 * MPH
_LEAST = 3  # minimum number of tests, at any distance
_BESIDE_MPS = 1 * MPH  # a test this near counts as beside the condition
_ENDS = 0.1, 0.9, 0.025, 0.975  # of the range that is told, and of the one that is not surprising


@dataclass(frozen=True, slots=True)
class ExpectedRating:
    """Ratings of tests near a condition, each predicted as if it had not been run.

    Attributes
    ----------
    mean, lowest, highest : float
        Overall ISO/TS 18571 ratings over one window.
    lower, upper : float
        Where the rating of a single test at the condition is likely to be: the central 80 %.
    least, most : float
        The central 95 %; a rating outside is a surprise.
    tests : tuple of str
        Ids of those tests, nearest in speed first.
    reach_mps : float
        Speed difference of the farthest of them.
    farther : bool
        Whether the condition is farther in speed from all tests than any of these was from the others; the rating may
        then be lower.
    """

    mean: float
    lowest: float
    highest: float
    lower: float
    upper: float
    least: float
    most: float
    window_ms: float
    tests: tuple[str, ...]
    reach_mps: float
    farther: bool

    @property
    def sentence(self) -> str:
        """A sentence on the expected rating, and the number of tests that it rests on."""
        n, within = len(self.tests), speed(self.reach_mps)
        tests, rated = f"{n} left-out test{'s' * (n > 1)}", rating_range(self.lowest, self.highest)
        if self.farther:
            return Sentence(
                f"Expected rating over 0–{self.window_ms:g} ms: less than the {rated} of {tests} within {{}}, which "
                "had nearer tests.",
                within,
            )
        expected = f"Expected rating over 0–{self.window_ms:g} ms: {self.range} ({self.grades})"
        return Sentence(f"{expected}; {tests} within {{}} rated {rated}.", within)

    @property
    def range(self) -> str:
        """The likely range as displayed."""
        return rating_range(self.lower, self.upper)

    @property
    def brief(self) -> str:
        """What is expected in the fewest words: the likely range, or less than what nearer tests were rated."""
        return f"less than {rating_range(self.lowest, self.highest)}" if self.farther else self.range

    @property
    def grades(self) -> str:
        """Grades of both ends as they are displayed, so that 0.94 is Good beside "Excellent above 0.94"."""
        return " to ".join(dict.fromkeys(grade(round(end, 2)) for end in (self.lower, self.upper)))

    def surprise(self, rating: float) -> str:
        """How a rating compares with what was expected, in words; to two digits, as the range is displayed."""
        rating, highest, lower, upper, least, most = (
            round(each, 2) for each in (rating, self.highest, self.lower, self.upper, self.least, self.most)
        )
        if self.farther:
            return "as expected" if rating <= highest else "above what was expected"
        if lower <= rating <= upper:
            return "as expected"
        far = "" if least <= rating <= most else "far "
        return f"{far}{'below' if rating < lower else 'above'} what was expected"

    def is_missed_by(self, rating: float) -> bool:
        """Whether a rating is below what was expected."""
        return "below" in self.surprise(rating)

    def outcome(self, rating: float) -> str:
        """A sentence on how the expectation came out, once the test is known."""
        nearer = f"less than the {rating_range(self.lowest, self.highest)} of tests with nearer neighbours"
        expected = nearer if self.farther else self.range
        return f"Expected {expected}, came out {rating:.3f} ({grade(rating)}): {self.surprise(rating)}."


def expected_rating(
    left_out_mps2: Mapping[str, FloatArray], campaign: Campaign, condition: Condition, window_ms: float = 60.0
) -> ExpectedRating | None:
    """Rate an approach's predictions of tests near a condition, each as if that test had not been run.

    Uses all tests within 5 mph of it in speed, and at least the three nearest.

    Parameters
    ----------
    left_out_mps2 : mapping of str to ndarray, shape (1250,)
        As in :class:`crashfuse.study.estimate.Estimate`: pulses in m/s² by test id. If empty, the result is None.
    campaign : Campaign
        The campaign that the approach learned from.
    window_ms : float
        The rating is over [0, window_ms).
    """
    tests = [test for test in campaign.tests if test.id in left_out_mps2]
    if not tests:
        return None
    speeds = np.array([test.condition.speed_mps for test in campaign.tests])

    def away(test: CrashTest) -> float:
        return abs(test.condition.speed_mps - condition.speed_mps)

    near = [test for i, test in enumerate(sorted(tests, key=away)) if i < _LEAST or away(test) <= _REACH_MPS]
    ratings = [
        _overall(test.pulse, left_out_mps2[test.id].astype(np.float64).tobytes(), float(window_ms)) for test in near
    ]
    single = RatingDistribution.learned(np.array(ratings))
    lower, upper, least, most = map(single.quantile, _ENDS)
    gaps = [np.sort(np.abs(speeds - test.condition.speed_mps))[1:2].sum() for test in near]  # to the next other test
    return ExpectedRating(
        float(np.mean(ratings)),
        min(ratings),
        max(ratings),
        lower,
        upper,
        least,
        most,
        float(window_ms),
        tuple(test.id for test in near),
        away(near[-1]),
        bool(np.abs(speeds - condition.speed_mps).min() > max(*gaps, _BESIDE_MPS)),
    )


@lru_cache(maxsize=512)  # at every condition the same tests are asked about; up to 10 kB each
def _overall(measured: Pulse, predicted_mps2: bytes, window_ms: float) -> float:
    """Overall rating over one window of a prediction in m/s², given as bytes of float64 so that it can be a key."""
    predicted = Pulse(GRID_S, np.frombuffer(predicted_mps2))
    return rate_windows(measured, predicted, [window_ms])[window_ms].overall


def rating_range(lower: float, upper: float) -> str:
    """Both ends as displayed, one if they are equal."""
    return " to ".join(dict.fromkeys(f"{end:.2f}" for end in (lower, upper)))
