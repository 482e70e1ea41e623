"""What the rating of a single test will be, from how predictions of left-out tests rated."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from crashfuse.approaches.metric_calibration import Distribution
from crashfuse.signals.pulse import FloatArray

_SPREAD, _KNOWN_TESTS = 0.4, 4  # what the log of a rating's distance to 1 scatters by, and how many tests that is worth
_HEEDED, _DOUBT = 0.5, 0.25  # how far ratings follow what draws say of them, and the standard deviation of that
_LEAST_LACK = 1e-4  # of a rating to 1


@dataclass(frozen=True)
class RatingDistribution(Distribution):
    """Distribution of the rating of a single test: what it lacks to 1 is log-t, so that it cannot be above 1.

    ``centre`` and ``scale`` are of minus the logarithm of what it lacks.
    """

    @classmethod
    def learned(cls, ratings: FloatArray, drawn: FloatArray | float = np.nan, here: float = np.nan) -> Self:
        """From ratings of left-out tests; three of them say little of their spread, so that of other campaigns counts.

        Parameters
        ----------
        ratings : ndarray, shape (n_tests,)
            Of left-out tests, one at least.
        drawn : ndarray, shape (n_tests,), optional
            What the prediction of each rated against its own draws; NaN without draws.
        here : float, optional
            The same of the prediction whose rating is asked for. Bands are wider where less is known, and ratings
            lower, by about half as much.
        """
        surer = np.nan_to_num(_logs(here) - _logs(drawn))
        expected = _logs(ratings) + _HEEDED * surer
        freedom = _KNOWN_TESTS + expected.size - 1
        off = float(((expected - expected.mean()) ** 2).sum())
        variance = (_KNOWN_TESTS * _SPREAD**2 + off) / freedom * (1 + 1 / expected.size)
        scale = np.hypot(np.sqrt(variance), _DOUBT * surer.mean())
        return cls(float(expected.mean()), float(scale), freedom)

    def cdf(self, x: float) -> float:
        """Probability of a rating of at most ``x``."""
        return super().cdf(float(_logs(x)))

    def quantile(self, share: float) -> float:
        """The rating that a share of tests stays below."""
        return -float(np.expm1(-(super().quantile(share) or 0.0)))


def _logs(ratings: FloatArray | float) -> FloatArray:
    return np.asarray(-np.log(np.maximum(1 - np.asarray(ratings), _LEAST_LACK)))
