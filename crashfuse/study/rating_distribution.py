"""What the rating of a single test will be, from how left-out tests rated and how well a prediction's draws agree."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.metric_calibration import Distribution
from crashfuse.signals.pulse import DT_S, FloatArray
from crashfuse.signals.rating import WEIGHTS, corridor_score, slope_score
from crashfuse.units import MPH

_COMPARED_S, _DRAWS = 0.06, 100  # of each draw, and about how many
_SPREAD, _KNOWN_TESTS = 0.4, 4  # what the log of a rating's distance to 1 scatters by, and how many tests that is worth
_HEEDED, _DOUBT = 0.5, 0.25  # how far ratings follow the agreement of draws, and the standard deviation of that
_REACH_MPS = 10 * MPH  # a test this much farther away counts for a third
_LEAST_LACK = 1e-4  # of a rating to 1


def agreement(prediction: Prediction) -> float:
    """How well a prediction's draws agree with it, 0 to 1: their median score over 0–60 ms; NaN without draws.

    By corridor and slope, whose scores take no search for shifts and warps.
    """
    if prediction.draws_mps2 is None:
        return float("nan")
    n, every = round(_COMPARED_S / DT_S), max(len(prediction.draws_mps2) // _DRAWS, 1)
    pulse, draws = prediction.accel_mps2[:n], np.asarray(prediction.draws_mps2[::every, :n], dtype=np.float64)
    corridor, slope = WEIGHTS["corridor"], WEIGHTS["slope"]
    scores = corridor * corridor_score(pulse, draws) + slope * slope_score(pulse, draws)
    return float(np.median(scores)) / (corridor + slope)


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

        ``away_mps`` are the differences of their speeds from the one asked for: the nearer, the more they count.
        ``agreements`` are the :func:`agreement` of the prediction of each, ``here`` that of the prediction whose rating
        is asked for: where less is known, ratings are lower.
        """
        weights = np.exp((away_mps.min() - away_mps) / _REACH_MPS)  # the nearest test counts once
        surer = np.nan_to_num(_logs(here) - _logs(agreements)) * np.ones_like(ratings)
        expected = _logs(ratings) + _HEEDED * surer
        centre = np.average(expected, weights=weights)
        freedom = _KNOWN_TESTS + weights.sum() - 1
        off = weights @ (expected - centre) ** 2
        variance = (_KNOWN_TESTS * _SPREAD**2 + off) / freedom * (1 + (weights**2).sum() / weights.sum() ** 2)
        scale = np.hypot(np.sqrt(variance), _DOUBT * np.average(surer, weights=weights))
        return cls(float(centre), float(scale), float(freedom))

    def cdf(self, x: float) -> float:
        """Probability of a rating of at most ``x``."""
        return super().cdf(float(_logs(x)))

    def quantile(self, share: float) -> float:
        """The rating that a share of tests stays below."""
        return -float(np.expm1(-(super().quantile(share) or 0.0)))


def _logs(ratings: FloatArray | float) -> FloatArray:
    return np.asarray(-np.log(np.maximum(1 - np.asarray(ratings), _LEAST_LACK)))
