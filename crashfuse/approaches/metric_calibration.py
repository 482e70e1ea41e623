"""Distribution of one number at a single test, such as a metric, calibrated on left-out tests.

Draws of whole pulses say how a metric is spread at a condition; left-out tests say how much wider or narrower it has to
be. Each metric has a scale of its own, because the same draws can be too wide in one metric and too narrow in another.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.stats import norm, t

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.signals.metrics import METRIC_LABELS, Metric, metric_values, pulse_metrics
from crashfuse.signals.pulse import FloatArray

_TAIL = 0.1  # draws beyond the central 80 % do not count: in a mixture they may all be those of one component
_PRIOR_SCALE, _PRIOR_TESTS = 0.85, 8.0  # t with 8 degrees of freedom and this scale has the 95 % of the normal
_WORST = 4.0  # a larger standardised error counts as this one: one odd test must not set the scale alone
_LEVEL = 0.95

Errors = Mapping[str, FloatArray]
"""Standardised errors of left-out tests by metric, shape (n_tests,); NaN where a metric is unknown."""


@dataclass(frozen=True, slots=True)
class Distribution:
    """Distribution of a positive number at a single test: Student's t with a scale on either side of the median.

    Parameters
    ----------
    median : float
    below, above : float
        Scale below and above the median.
    freedom : float
        Degrees of freedom.
    lowest, highest : float
        Probability that it is smaller, or larger, than the record can show.
    """

    median: float
    below: float
    above: float
    freedom: float
    lowest: float = 0.0
    highest: float = 0.0

    @classmethod
    def of(cls, values: FloatArray, errors: FloatArray) -> Self | None:
        """Calibrate draws, shape (n_draws,), by the standardised errors of left-out tests, shape (n_tests,).

        A single value has no spread of its own: errors are shares of it, and left-out tests alone tell how large.
        None if the record ends too early for more than one draw in ten, or a single value has no left-out tests.
        """
        quantiles = _quantiles(values)
        known = np.clip(errors[~np.isnan(errors)], -_WORST, _WORST)
        prior = _PRIOR_TESTS if values.size > 1 else 0.0
        freedom = prior + known.size
        if quantiles is None or not freedom:
            return None
        scale = float(np.sqrt((prior * _PRIOR_SCALE**2 + (known**2).sum()) / freedom))
        median, below, above = quantiles
        lowest, highest = float(_share(values, -np.inf)), float(_share(values, np.inf))
        return cls(median, scale * below, scale * above, freedom, lowest, highest)

    def cdf(self, x: float) -> float:
        """Probability of a value of at most ``x``."""
        side = self.below if x < self.median else self.above
        within = float(t.cdf((x - self.median) / side, self.freedom)) if side else float(x >= self.median)
        return self.lowest + (1 - self.lowest - self.highest) * within

    def probability(self, at_least: float | None, at_most: float | None) -> float:
        """Probability of a value between the limits."""
        upper = 1.0 if at_most is None else self.cdf(at_most)
        lower = 0.0 if at_least is None else self.cdf(at_least)
        return max(upper - lower, 0.0)

    def quantile(self, share: float) -> float | None:
        """The value that a share of tests stays below, not under 0; None if it lies beyond the record."""
        within = (share - self.lowest) / (1 - self.lowest - self.highest)
        if not 0 < within < 1:
            return None
        step = float(t.ppf(within, self.freedom))
        return max(self.median + step * (self.below if step < 0 else self.above), 0.0)

    def interval(self, level: float = _LEVEL) -> tuple[float | None, float | None]:
        """Central interval; an end is None if it lies beyond the record."""
        return self.quantile((1 - level) / 2), self.quantile((1 + level) / 2)


def standardised_error(values: FloatArray, measured: float) -> float:
    """Error of a left-out test in units of its draws' spread, or of the single value; NaN where unknown."""
    quantiles = _quantiles(values)
    if quantiles is None or not np.isfinite(measured):
        return float("nan")
    median, below, above = quantiles
    side = below if measured < median else above
    return (measured - median) / side if side else float("nan")


def metric_errors(left_out: Mapping[str, Prediction], campaign: Campaign) -> Errors:
    """Standardised errors of all metrics for tests that were left out, in the order of their ids in ``left_out``."""
    errors = []
    for test_id, prediction in left_out.items():
        test = campaign.test(test_id)
        measured = metric_values(test.pulse.accel_mps2, test.condition.speed_mps)
        drawn = drawn_metrics(prediction)
        errors.append([standardised_error(drawn[name], float(measured[name])) for name in METRIC_LABELS])
    table = np.array(errors, dtype=np.float64).reshape(-1, len(METRIC_LABELS))
    return dict(zip(METRIC_LABELS, table.T, strict=True))


def drawn_metrics(prediction: Prediction) -> dict[str, FloatArray]:
    """Metrics of a prediction's draws, or of the pulse itself if there are none; each of shape (n_draws,)."""
    draws = prediction.accel_mps2[None] if prediction.draws_mps2 is None else prediction.draws_mps2
    return metric_values(np.asarray(draws, dtype=np.float64), prediction.condition.speed_mps)


def calibrated_metrics(prediction: Prediction, errors: Errors) -> tuple[Metric, ...]:
    """Metrics of a predicted pulse, with the calibrated 95 % interval for a single test if it has draws."""
    metrics = pulse_metrics(prediction.accel_mps2, prediction.condition.speed_mps)
    if prediction.draws_mps2 is None:
        return metrics
    drawn = drawn_metrics(prediction)
    found = {name: Distribution.of(drawn[name], errors.get(name, np.empty(0))) for name in drawn}
    intervals = {name: (None, None) if own is None else own.interval() for name, own in found.items()}
    return tuple(Metric(m.name, m.value, *intervals[m.name], m.unit) for m in metrics)


def _quantiles(values: FloatArray) -> tuple[float, float, float] | None:
    """Median and the scale on either side, from the central 80 % of draws; None if that reaches beyond the record.

    The scale of a single value is the value itself.
    """
    if values.size == 1:
        value = float(values[0])
        return (value, abs(value), abs(value)) if np.isfinite(value) else None
    lowest, highest = (np.where(np.isnan(values), beyond, values) for beyond in (-np.inf, np.inf))
    ends = np.quantile(lowest, _TAIL, method="lower"), np.quantile(highest, 1 - _TAIL, method="higher")
    median = np.quantile(lowest, 0.5, method="higher")
    if not np.isfinite([*ends, median]).all():
        return None
    unit = float(norm.ppf(1 - _TAIL))
    return float(median), float(median - ends[0]) / unit, float(ends[1] - median) / unit


def _share(values: FloatArray, end: float) -> float:
    """Share of draws at an infinite end; NaN, neither small nor large, counts at both."""
    return float(((values == end) | np.isnan(values)).mean())
