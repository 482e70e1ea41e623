"""One test left out and predicted: the only place where a prediction is compared with its test."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from crashfuse.approaches.calibration import Coverage
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError, one_of
from crashfuse.signals.metrics import checked_metrics
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import Ratings, rate_many, rate_windows
from crashfuse.signals.rating_explanation import RatingExplanation, explain_rating
from crashfuse.study.estimate import Estimate

_RATED_DRAWS = 100


@dataclass(frozen=True, eq=False)
class Fold:
    """One held-out test: the prediction of each approach, and its rating against the measurement.

    Attributes
    ----------
    ratings : dict of str to Ratings
        By approach, then by window in ms.
    """

    test: CrashTest
    estimates: tuple[Estimate, ...]
    ratings: dict[str, Ratings]
    _drawn: dict[tuple[str, float], FloatArray] = field(default_factory=dict, repr=False)
    _explained: dict[tuple[str, float], RatingExplanation] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, test: CrashTest, estimates: Sequence[Estimate], windows_ms: Sequence[float]) -> Self:
        """Rate the predictions for a test, whose pulse is first used here."""
        ratings = {
            estimate.approach: rate_windows(test.pulse, Pulse(GRID_S, estimate.prediction.accel_mps2), windows_ms)
            for estimate in estimates
        }
        return cls(test, tuple(estimates), ratings)

    def __repr__(self) -> str:
        window_ms = max(next(iter(self.ratings.values()), {0.0: None}))
        rated = ", ".join(f"{name} {own[window_ms].overall:.3f}" for name, own in self.ratings.items())
        return f"<Fold of {self.held_out}: {rated} (0–{window_ms:g} ms)>"

    @property
    def held_out(self) -> str:
        """Id of the held-out test."""
        return self.test.id

    @property
    def with_band(self) -> tuple[str, ...]:
        """Names of the approaches whose predictions have a band."""
        return tuple(each.approach for each in self.estimates if each.prediction.draws_mps2 is not None)

    def coverage(self, approach: str) -> Coverage | None:
        """Whether the test lies inside an approach's band, and its crush and peak inside the intervals of metrics.

        These are wider or narrower than the band, as left-out tests showed; the band counts where they are unknown.
        None without a band.
        """
        estimate = self.estimate(approach)
        draws, speed_mps = estimate.prediction.draws_mps2, self.test.condition.speed_mps
        if draws is None:
            return None
        band, intervals = Coverage.of(self.test, draws), {own.name: own for own in estimate.metrics}
        measured = {own.name: own.value for own in checked_metrics(self.test.pulse.accel_mps2, speed_mps)}
        crush, peak = (intervals[name].holds(measured[name]) for name in ("max_crush", "peak"))
        return replace(band, crush=band.crush if crush is None else crush, peak=band.peak if peak is None else peak)

    def estimate(self, approach: str) -> Estimate:
        """The estimate of this approach; a UsageError if the study is without it."""
        return one_of("prediction of this test by", approach, {each.approach: each for each in self.estimates})

    def explained(self, approach: str, window_ms: float) -> RatingExplanation:
        """What the rating of an approach's prediction over [0, window_ms) is made of."""
        key = approach, window_ms
        if key not in self._explained:
            predicted = Pulse(GRID_S, self.estimate(approach).prediction.accel_mps2)
            self._explained[key] = explain_rating(self.test.pulse, predicted, window_ms)
        return self._explained[key]

    def rating_draws(self, approach: str, window_ms: float) -> FloatArray:
        """Overall ratings of single pulses drawn from the band of an approach, shape (n_draws,).

        If the band is right, a measured pulse is one such draw, so these are plausible ratings of a repeated test.
        """
        key = approach, window_ms
        if key not in self._drawn:  # a hundred ratings: computed on request, and once
            draws = self.estimate(approach).prediction.draws_mps2
            if draws is None:
                raise UsageError(f"{approach} has no band to draw pulses from.")
            n = round(window_ms / 1e3 / DT_S)
            some = draws[:: -(-len(draws) // _RATED_DRAWS), :n]
            rated = rate_many(self.test.pulse.accel_mps2[:n], some, dt_s=DT_S)
            self._drawn[key] = np.array([rating.overall for rating in rated])
        return self._drawn[key]

    def rating_interval(self, approach: str, window_ms: float) -> tuple[float, float]:
        """Central 95 % interval of the ratings of drawn pulses."""
        lower, upper = np.quantile(self.rating_draws(approach, window_ms), [0.025, 0.975])
        return float(lower), float(upper)
