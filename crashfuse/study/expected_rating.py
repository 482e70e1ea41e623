"""Expected rating of a prediction before there is a test to rate it against."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from crashfuse.campaign import Campaign, CrashTest
from crashfuse.condition import Condition
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import grade, rate_windows
from crashfuse.units import MPH
from crashfuse.wording import Sentence, speed

_REACH_MPS = 5 * MPH
_LEAST = 3  # minimum number of tests, at any distance
_BESIDE_MPS = 1 * MPH  # a test this near counts as beside the condition


@dataclass(frozen=True, slots=True)
class ExpectedRating:
    """Ratings of tests near a condition, each predicted as if it had not been run.

    Attributes
    ----------
    mean, lowest, highest : float
        Overall ISO/TS 18571 ratings over one window.
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
    window_ms: float
    tests: tuple[str, ...]
    reach_mps: float
    farther: bool

    @property
    def sentence(self) -> str:
        """A sentence on the expected rating, and the number of tests that it rests on."""
        n, within = len(self.tests), speed(self.reach_mps)
        tests, rated = f"{n} left-out test{'s' * (n > 1)}", f"{self.lowest:.2f} to {self.highest:.2f}"
        if self.farther:
            return Sentence(
                f"How it will rate is not known: expect less than the {rated} over 0–{self.window_ms:g} ms of {tests} "
                "within {}, each of which had a nearer test to learn from.",
                within,
            )
        expected = f"Expected rating over 0–{self.window_ms:g} ms: about {self.mean:.2f} ({grade(self.mean)})"
        return Sentence(f"{expected}; {tests} within {{}} rated {rated}.", within)


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
        rate_windows(test.pulse, Pulse(GRID_S, left_out_mps2[test.id]), [window_ms])[float(window_ms)].overall
        for test in near
    ]
    gaps = [np.sort(np.abs(speeds - test.condition.speed_mps))[1:2].sum() for test in near]  # to the next other test
    return ExpectedRating(
        float(np.mean(ratings)),
        min(ratings),
        max(ratings),
        float(window_ms),
        tuple(test.id for test in near),
        away(near[-1]),
        bool(np.abs(speeds - condition.speed_mps).min() > max(*gaps, _BESIDE_MPS)),
    )
