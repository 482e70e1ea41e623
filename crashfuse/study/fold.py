"""One test left out and predicted: the only place where a prediction meets the test that it was made for."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from crashfuse.campaign import CrashTest
from crashfuse.errors import UsageError
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import Rating, rate_many, rate_windows
from crashfuse.study.estimate import Estimate

_RATED_DRAWS = 100


@dataclass(frozen=True, eq=False)
class Fold:
    """One held-out test: what each approach predicted for it, and how that rates against what was measured.

    Attributes
    ----------
    ratings : dict of str to dict of float to Rating
        By approach, then by window in ms.
    """

    test: CrashTest
    estimates: tuple[Estimate, ...]
    ratings: dict[str, dict[float, Rating]]
    _drawn: dict[tuple[str, float], FloatArray] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, test: CrashTest, estimates: Sequence[Estimate], windows_ms: Sequence[float]) -> Self:
        """Rate what was predicted for a test, now that it may be looked at."""
        ratings = {
            estimate.approach: rate_windows(test.pulse, Pulse(GRID_S, estimate.prediction.accel_mps2), windows_ms)
            for estimate in estimates
        }
        return cls(test, tuple(estimates), ratings)

    @property
    def held_out(self) -> str:
        """Id of the test."""
        return self.test.id

    @property
    def with_band(self) -> tuple[str, ...]:
        """Approaches that say how far the test may lie from what they expect."""
        return tuple(each.approach for each in self.estimates if each.prediction.draws_mps2 is not None)

    def estimate(self, approach: str) -> Estimate:
        """The estimate of this approach."""
        return next(estimate for estimate in self.estimates if estimate.approach == approach)

    def rating_draws(self, approach: str, window_ms: float) -> FloatArray:
        """Overall ratings of single pulses drawn from the band of an approach, shape (n_draws,).

        A measured pulse is one such draw if the band is right, so this is what a repeated test might be rated.
        """
        key = approach, window_ms
        if key not in self._drawn:  # a hundred ratings: only for who asks, and once
            draws = self.estimate(approach).prediction.draws_mps2
            if draws is None:
                raise UsageError(f"{approach} has no band to draw pulses from.")
            n = round(window_ms / 1e3 / DT_S)
            some = draws[:: -(-len(draws) // _RATED_DRAWS), :n]
            rated = rate_many(self.test.pulse.accel_mps2[:n], some, dt_s=DT_S)
            self._drawn[key] = np.array([rating.overall for rating in rated])
        return self._drawn[key]

    def rating_interval(self, approach: str, window_ms: float) -> tuple[float, float]:
        """Central 95 % of the ratings of drawn pulses."""
        lower, upper = np.quantile(self.rating_draws(approach, window_ms), [0.025, 0.975])
        return float(lower), float(upper)
