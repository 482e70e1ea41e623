"""Forecasts: what an approach predicts for a single test, as calibrated distributions of all metrics and the rating."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Self

import numpy as np

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.fit_cache import settings
from crashfuse.approaches.metric_calibration import Distribution, metric_distributions
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import RATING, Criterion
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import Cache, Entry, finite, numbers
from crashfuse.execution.code_digest import code_digest
from crashfuse.signals.metrics import metric_values
from crashfuse.signals.occupant import OccupantModel
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.estimate import Fit
from crashfuse.study.rating_distribution import RatingDistribution

_RATED_DRAWS = 25
_UNKNOWN = (np.nan,) * 5


def quantity(criterion: Criterion) -> str:
    """What a criterion limits, as a key: the metric, or the rating over its window."""
    return _rating(criterion.window_ms) if criterion.window_ms is not None else criterion.metric


def _rating(window_ms: float) -> str:
    return f"{RATING} {window_ms:g}"


@dataclass(frozen=True, eq=False)
class Forecast:
    """What an approach predicts for a test at a condition.

    Attributes
    ----------
    accel_mps2 : ndarray, shape (1250,)
        The predicted pulse.
    values : dict of str to float or None
        Metrics of that pulse, and the expected rating by window; None where the record is too short.
    distributions : dict of str to Distribution or None
        The same for a single test; None where unknown.
    """

    accel_mps2: FloatArray
    values: dict[str, float | None]
    distributions: dict[str, Distribution | None]

    def measured(self, criterion: Criterion, test: CrashTest, occupant: OccupantModel) -> float | None:
        """What a test here shows: its metric, or the rating of this prediction against it; None if it is too short."""
        if criterion.window_ms is not None:
            return _overall(test.pulse, self.accel_mps2, criterion.window_ms)
        accel, speed = test.pulse.accel_mps2, test.condition.speed_mps
        values = metric_values(accel, speed, dt_s=test.pulse.dt_s, occupant=occupant)
        value = float(values[criterion.metric])
        return value if np.isfinite(value) else None

    @property
    def entry(self) -> dict[str, FloatArray]:
        """As arrays, for the cache."""
        rows = [
            (np.nan if (value := self.values[name]) is None else value, *(_UNKNOWN if own is None else astuple(own)))
            for name, own in self.distributions.items()
        ]
        names = np.array(list(self.values))
        return {"accel_mps2": self.accel_mps2, "names": names, "numbers": np.array(rows)}

    @classmethod
    def restored(cls, entry: Entry) -> Self:
        """Restore from :attr:`entry`."""
        values, distributions = {}, {}
        rows = numbers(entry, "numbers", None, None).tolist()
        for name, (value, *own) in zip(entry["names"].tolist(), rows, strict=True):
            values[name] = None if np.isnan(value) else value
            kind = RatingDistribution if name.startswith(RATING) else Distribution
            distributions[name] = None if np.isnan(own[0]) else kind(*own)
        return cls(finite(entry, "accel_mps2", N_SAMPLES), values, distributions)


@dataclass(frozen=True, eq=False)
class Forecaster:
    """A fitted approach, and how its predictions of tests that it had not seen rated.

    Attributes
    ----------
    rated : dict of float to ndarray, shape (2, n_tests)
        By window in ms: the ratings, and those against draws in the place of the tests; NaN without draws.
    """

    fit: Fit
    rated: dict[float, FloatArray]

    @classmethod
    def of(cls, fit: Fit, campaign: Campaign, windows_ms: Sequence[float], cache: Cache) -> Self:
        """Rate the left-out predictions of a fit over windows; the campaign is the one that it learned from."""

        def rate(window_ms: float) -> FloatArray:
            rows = []
            for test_id, prediction in fit.left_out.items():
                rating = _overall(campaign.test(test_id).pulse, prediction.accel_mps2, window_ms)
                rows.append((rating, drawn_rating(prediction, window_ms)))
            return np.array(rows, dtype=np.float64).reshape(-1, 2).T

        rated = {}
        for window in windows_ms:
            key = {**settings(fit.approach), "campaign": campaign.fingerprint, "window": window}
            key["code"] = code_digest(__name__)

            def compute(window: float = window) -> tuple[FloatArray, Entry]:
                found = rate(window)
                return found, {"rated": found}

            def restore(entry: Entry) -> FloatArray:
                return numbers(entry, "rated", 2, len(fit.left_out))

            rated[window] = cache.get_or_compute("left-out ratings", key, compute, restore)
        return cls(fit, rated)

    def at(self, condition: Condition) -> Forecast:
        """The forecast at a condition."""
        prediction = self.fit.estimate(condition).prediction
        occupant = self.fit.occupant
        values = metric_values(prediction.accel_mps2, condition.speed_mps, occupant=occupant)
        known = {name: float(value) if np.isfinite(value) else None for name, value in values.items()}
        found = metric_distributions(prediction, self.fit.metric_errors, occupant)
        for window in self.rated:
            rating = found[_rating(window)] = self._rating_at(prediction, window)
            known[_rating(window)] = None if rating is None else rating.quantile(0.5)
        return Forecast(prediction.accel_mps2, known, found)

    def _rating_at(self, prediction: Prediction, window_ms: float) -> RatingDistribution | None:
        """Distribution of the rating against a test here; None if no test could be left out."""
        rated, drawn = self.rated[window_ms]
        here = drawn_rating(prediction, window_ms)
        return RatingDistribution.learned(rated, drawn, here) if rated.size else None


def drawn_rating(prediction: Prediction, window_ms: float) -> float:
    """Rating of a predicted pulse against its draws, each in the place of a test: their median; NaN without draws."""
    n, draws = round(window_ms / 1e3 / DT_S), prediction.draws_mps2
    if draws is None:
        return float("nan")
    some = np.asarray(draws[:: -(-len(draws) // _RATED_DRAWS), :n], dtype=np.float64)
    return float(np.median([_overall(Pulse(GRID_S[:n], draw), prediction.accel_mps2[:n], window_ms) for draw in some]))


def _overall(reference: Pulse, accel_mps2: FloatArray, window_ms: float) -> float:
    comparison = Pulse(GRID_S[: accel_mps2.size], accel_mps2)
    return rate_windows(reference, comparison, [window_ms])[window_ms].overall
