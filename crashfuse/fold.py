"""One test left out and predicted: the only place where a prediction meets the test that it was made for."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from crashfuse.campaign import CrashTest
from crashfuse.estimate import Estimate
from crashfuse.pulse import DT_S, GRID_S, FloatArray, Pulse
from crashfuse.rating import Rating, rate_many, rate_windows

_RATED_DRAWS = 100


@dataclass(frozen=True, eq=False)
class Fold:
    """One held-out test: what each approach predicted for it, and how that rates against what was measured.

    Attributes
    ----------
    held_out : str
    estimates : tuple of Estimate
    ratings : dict of str to dict of float to Rating
        By approach, then by window in ms.
    rating_draws : dict of str to dict of float to ndarray, shape (n_draws,)
        Overall ratings of single pulses drawn from the band, likewise; only of approaches that have one. A measured
        pulse is one such draw if the band is right, so this is what a repeated test might be rated.
    """

    held_out: str
    estimates: tuple[Estimate, ...]
    ratings: dict[str, dict[float, Rating]]
    rating_draws: dict[str, dict[float, FloatArray]]

    @classmethod
    def of(cls, test: CrashTest, estimates: Sequence[Estimate], windows_ms: Sequence[float]) -> Self:
        """Rate what was predicted for a test, now that it may be looked at."""
        ratings = {
            estimate.approach: rate_windows(test.pulse, Pulse(GRID_S, estimate.prediction.accel_mps2), windows_ms)
            for estimate in estimates
        }
        drawn = {
            estimate.approach: {window: _overall(test.pulse, draws, window) for window in windows_ms}
            for estimate in estimates
            if (draws := estimate.prediction.draws_mps2) is not None
        }
        return cls(test.id, tuple(estimates), ratings, drawn)

    def estimate(self, approach: str) -> Estimate:
        """The estimate of this approach."""
        return next(estimate for estimate in self.estimates if estimate.approach == approach)

    def rating_interval(self, approach: str, window_ms: float) -> tuple[float, float]:
        """Central 95 % of the ratings of drawn pulses."""
        lower, upper = np.quantile(self.rating_draws[approach][window_ms], [0.025, 0.975])
        return float(lower), float(upper)


def _overall(measured: Pulse, draws_mps2: FloatArray, window_ms: float) -> FloatArray:
    n = round(window_ms / 1e3 / DT_S)
    some = draws_mps2[:: -(-len(draws_mps2) // _RATED_DRAWS), :n]
    return np.array([rating.overall for rating in rate_many(measured.accel_mps2[:n], some, dt_s=DT_S)])
