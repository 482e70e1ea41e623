"""Distribution of one number at a single test, such as a metric, calibrated on left-out tests.

Draws of whole pulses say how a metric is spread at a condition; left-out tests say how much wider or narrower it has to
be, for each metric by itself, as the same draws can be too wide in one metric and too narrow in another.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np
from scipy.special import chdtri, ndtr, ndtri, stdtr, stdtrit

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.signals.metrics import METRIC_LABELS, Metric, checked_metrics, metric_values
from crashfuse.signals.occupant import USUAL_OCCUPANT, OccupantModel
from crashfuse.signals.pulse import GRID_S, FloatArray

_TAIL = 0.1  # draws beyond the central 80 % do not count: in a mixture they may all be those of one component
_PRIOR_TESTS = 8.0
_USUAL_SCALE = 0.88  # t with 8 degrees of freedom and this scale has about the 95 % interval of the normal
# Usual errors on random vehicles, in units of the draws' spread, with which intervals hold on sixteen others: what is
# integrated over a crash is known better than the draws of a mixture say, and the time of the peak jumps.
_USUAL_SCALES = {
    **{"peak": 0.9, "peak_time": 1.4, "delta_v": 0.95, "t0": 1.0, "max_crush": 0.8, "static_crush": 1.15},
    **{"mean": 1.0, "sm25": 1.1, "olc": 1.05, "vpi": 0.95},
    **{"esw": 0.8, "centroid_time": 0.8},  # functions of the crush
    **{"g1": 1.15, "g2": 1.05, "step_time": 1.05, "loading_ratio": 1.1},
}
# Crashes at one condition do not crush alike, however sure the draws beside a test are. The share is that of the best
# log score of 2,254 unseen crashes of 24 random vehicles.
_REPEATABILITY = dict.fromkeys(("max_crush", "esw", "centroid_time"), 0.015)  # of the value
_WORST = 5.0  # a larger standardised error counts as this one: one odd test must not set the scale alone
_LEVEL = 0.95
_MOST_CUT = 1 - 1e-9
_LAWS = (np.arange(40) + 0.5) / 40  # shares of the distributions of scale and centre
_LATEST_MS = dict.fromkeys(("peak_time", "step_time", "centroid_time"), float(GRID_S[-1]) * 1e3)
_MOST_DRAWS = 400  # computed at once: more leave the processor's cache
_HALVINGS = 40  # of the range in which a quantile lies

MATCHED = ("peak", "sm25", "olc", "max_crush")
"""Metrics of a representative pulse that are at the middle of their distributions."""

_NEAR, _MOST_STEPS = 2e-3, 10  # share of each metric that may be missing, and steps towards it
_CANDIDATES = 10  # draws of which one becomes the representative pulse where the average cannot

Errors = Mapping[str, FloatArray]
"""Standardised errors of left-out tests by metric, shape (n_tests,); NaN where a metric is unknown."""


@dataclass(frozen=True, slots=True)
class Distribution:
    """Distribution of a positive number at a single test: Student's t, cut off at 0."""

    centre: float
    scale: float  # 0 if there is no doubt
    freedom: float
    lowest: float = 0.0  # probability that it is smaller than the record can show
    highest: float = 0.0  # probability that it is larger than the record can show
    most: float = np.inf  # the largest value that there is: no time within a pulse is later than its end

    @classmethod
    def of(cls, values: FloatArray, errors: FloatArray, metric: str = "") -> Self | None:
        """Calibrate draws, shape (n_draws,), by the standardised errors of left-out tests, shape (n_tests,).

        The draws' median moves by the mean error of the left-out tests, the half width of their central 80 % is scaled
        by the size of these errors; both are shrunk as if 8 more tests had come out as draws usually do. None if the
        record ends too early for more than one draw in ten, or a single value has no left-out tests.
        """
        spread = _spread(values, metric)
        known = np.clip(errors[~np.isnan(errors)], -_WORST, _WORST)
        alone = values.size == 1
        prior, moved = (0.0, 0.0) if alone else (_PRIOR_TESTS, float(known.sum()) / (known.size + _PRIOR_TESTS))
        freedom = prior + known.size
        if spread is None or not freedom:
            return None
        usual = _USUAL_SCALES.get(metric, _USUAL_SCALE)
        scale = float(np.sqrt((prior * usual**2 + ((known - moved) ** 2).sum()) / freedom))
        median, unit = spread
        lowest, highest = _share(values, -np.inf), _share(values, np.inf)
        return cls(median + moved * unit, scale * unit, freedom, lowest, highest, _LATEST_MS.get(metric, np.inf))

    def cdf(self, x: float) -> float:
        """Probability of a value of at most ``x``."""
        within = max(self._uncut(self._place(x)) - self._cut, 0.0) / (1 - self._cut)
        return self.lowest + (1 - self.lowest - self.highest) * within

    def _uncut(self, x: float) -> float:
        away = x - self.centre
        return float(stdtr(self.freedom, away / self.scale)) if self.scale else float(away >= 0)

    def probabilities(self, at_least: float | None, at_most: float | None) -> FloatArray:
        """Probabilities between the limits by equally likely laws of a test, whose mean is :meth:`probability`.

        Each law is normal. Their centres and scales are those that the left-out tests leave open: with many tests all
        are alike.
        """
        if not self.scale:
            return np.array([self.probability(at_least, at_most)])
        scale = self.scale * np.sqrt(self.freedom / chdtri(self.freedom, _LAWS))
        centre = self.centre + ndtri(_LAWS)[:, np.newaxis] * scale / np.sqrt(self.freedom + 1)
        scale = scale * np.sqrt(self.freedom / (self.freedom + 1))
        cut = ndtr(-centre / scale) * (self._cut > 0)
        ends = (own if end is None else self._place(end) for own, end in ((-np.inf, at_least), (np.inf, at_most)))
        lower, upper = (np.maximum(ndtr((end - centre) / scale) - cut, 0.0) / (1 - cut) for end in ends)
        lowest, highest = self.lowest * (at_least is None), self.highest * (at_most is None)
        return np.asarray(lowest + highest + (1 - self.lowest - self.highest) * np.maximum(upper - lower, 0.0)).ravel()

    def _place(self, x: float) -> float:
        return x

    @property
    def _cut(self) -> float:
        return min(self._uncut(0.0), _MOST_CUT)

    def probability(self, at_least: float | None, at_most: float | None) -> float:
        """Probability of a value between the limits."""
        lower, upper = self.shares(at_least, at_most)
        return max(upper - lower, 0.0)

    def shares(self, at_least: float | None, at_most: float | None) -> tuple[float, float]:
        """The shares of tests that lie below each limit; without one 0 and 1."""
        return 0.0 if at_least is None else self.cdf(at_least), 1.0 if at_most is None else self.cdf(at_most)

    def quantile(self, share: float) -> float | None:
        """The value that a share of tests stays below; None beyond the record."""
        within = (share - self.lowest) / (1 - self.lowest - self.highest)
        if not 0 < within < 1:
            return None
        away = float(stdtrit(self.freedom, self._cut + within * (1 - self._cut)))
        return min(max(self.centre + self.scale * away, 0.0), self.most)

    @property
    def median(self) -> float | None:
        """What a single test shows in the middle; None beyond the record."""
        return self.quantile(0.5)

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Central 95 %; None beyond the record, or from next to 0 to beyond it."""
        tail = (1 - _LEVEL) / 2
        lower, upper = self.quantile(tail), self.quantile(1 - tail)
        return (None if upper is None and self._cut > tail else lower), upper


@lru_cache(maxsize=4096)
def mean_quantiles(parts: tuple[Distribution, ...]) -> tuple[float | None, float | None, float | None]:
    """Median and :attr:`Distribution.interval` of the mean of distributions."""
    median, lower, upper = (_mean_quantile(parts, share) for share in (0.5, (1 - _LEVEL) / 2, (1 + _LEVEL) / 2))
    is_open = upper is None and any(part.interval[0] is None for part in parts)
    return median, None if is_open else lower, upper


def _mean_quantile(parts: tuple[Distribution, ...], share: float) -> float | None:
    lowest, highest = (float(np.mean([getattr(part, end) for part in parts])) for end in ("lowest", "highest"))
    ends = [end for part in parts if (end := part.quantile(share)) is not None]
    if not ends or not lowest < share < 1 - highest:
        return None
    low, high = min(ends), max(ends)  # equal if there is but one part
    if len(ends) < len(parts):  # some records end too early for it
        low, high = 0.0, min(2 * high, parts[0].most)
    for _ in range(_HALVINGS if high > low else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if np.mean([part.cdf(middle) for part in parts]) < share else (low, middle)
    return high


def standardised_error(values: FloatArray, measured: float, metric: str = "") -> float:
    """Error of a left-out test in units of its draws' spread, or of the value; NaN where unknown."""
    spread = _spread(values, metric)
    if spread is None or not np.isfinite(measured) or not spread[1]:
        return float("nan")
    median, unit = spread
    return (measured - median) / unit


def metric_errors(
    left_out: Mapping[str, Prediction], campaign: Campaign, usual: Mapping[str, FloatArray] = {}
) -> Errors:
    """Standardised errors of all metrics: those that past vehicles teach, then of left-out tests, in their order."""
    taught = {name: usual.get(name, np.empty(0)) for name in METRIC_LABELS}
    if not left_out:
        return taught
    tests = [campaign.test(test_id) for test_id in left_out]
    speeds = np.array([test.condition.speed_mps for test in tests])
    accel = np.array([test.pulse.accel_mps2 for test in tests])
    measured = metric_values(accel, speeds, occupant=campaign.occupant)
    drawn = _drawn_together(list(left_out.values()), campaign.occupant)
    pairs = {name: zip(drawn, values, strict=True) for name, values in measured.items()}
    found = {name: [standardised_error(draws[name], v, name) for draws, v in rows] for name, rows in pairs.items()}
    return {name: np.concatenate([taught[name], errors]) for name, errors in found.items()}


def _drawn_together(predictions: Sequence[Prediction], occupant: OccupantModel) -> list[dict[str, FloatArray]]:
    """:func:`drawn_metrics` of many draws at once: a third of the time."""
    metrics: list[dict[str, FloatArray]] = []
    while left := predictions[len(metrics) :]:
        ends = np.cumsum([len(_drawn(prediction)) for prediction in left])
        n = max(int(np.searchsorted(ends, _MOST_DRAWS, side="right")), 1)
        draws = [_drawn(prediction) for prediction in left[:n]]
        speeds = np.repeat([prediction.condition.speed_mps for prediction in left[:n]], [len(rows) for rows in draws])
        values = metric_values(np.concatenate(draws, dtype=np.float64), speeds, occupant=occupant, predicted=True)
        split = {name: np.split(rows, ends[: n - 1]) for name, rows in values.items()}
        metrics += [{name: rows[i] for name, rows in split.items()} for i in range(n)]
    return metrics


def drawn_metrics(prediction: Prediction, occupant: OccupantModel = USUAL_OCCUPANT) -> dict[str, FloatArray]:
    """Metrics of a prediction's draws, or of the pulse itself if there are none; each of shape (n_draws,)."""
    return metric_values(_drawn(prediction), prediction.condition.speed_mps, occupant=occupant, predicted=True)


def _drawn(prediction: Prediction) -> FloatArray:
    return prediction.accel_mps2[None] if prediction.draws_mps2 is None else prediction.draws_mps2


def metric_distributions(drawn: Mapping[str, FloatArray], errors: Errors) -> dict[str, Distribution | None]:
    """Distributions for a single test from :func:`drawn_metrics`; None where :meth:`Distribution.of` has none."""
    return {name: Distribution.of(drawn[name], errors.get(name, np.empty(0)), name) for name in drawn}


def calibrated_metrics(
    prediction: Prediction, drawn: Mapping[str, FloatArray], errors: Errors, occupant: OccupantModel = USUAL_OCCUPANT
) -> tuple[Metric, ...]:
    """Metrics that a single test shows in the middle, with calibrated 95 % intervals; without draws, of the pulse."""
    metrics = checked_metrics(prediction.accel_mps2, prediction.condition.speed_mps, occupant=occupant)
    if prediction.draws_mps2 is None:
        return metrics
    distributions = metric_distributions(drawn, errors)
    folds = {} if prediction.apart is None else {"most": ~prediction.apart, prediction.apart_as: prediction.apart}
    parts = {fold: {name: values[draws] for name, values in drawn.items()} for fold, draws in folds.items()}
    by_fold = {fold: metric_distributions(values, errors) for fold, values in parts.items()}

    def expected(metric: Metric) -> Metric:
        unknown = replace(metric, value=None, of_pulse=None)
        both = {fold: _of_single_test(unknown, own[metric.name]) for fold, own in by_fold.items()}
        return replace(_of_single_test(metric, distributions[metric.name]), folds=both)

    return tuple(map(expected, metrics))


def _of_single_test(metric: Metric, distribution: Distribution | None) -> Metric:
    if distribution is None:
        return replace(metric, drawn=True)
    lower, upper = distribution.interval
    return replace(metric, value=distribution.median, lower=lower, upper=upper, drawn=True)


def representative_pulses(
    prediction: Prediction,
    drawn: Mapping[str, FloatArray],
    errors: Errors,
    numbers: Sequence[int] = (),
    occupant: OccupantModel = USUAL_OCCUPANT,
) -> FloatArray:
    """A whole pulse that looks like a test, then the draws with these numbers as single tests, shape (1 + n, 1250).

    An average of pulses is softer than any of them. It is changed until its peak, SM25, OLC and crush are the medians
    of their calibrated distributions, a draw until they are as rare as they were among the draws: by the update of the
    ensemble Kalman filter (Evensen, Ocean Dynamics 53, 2003), repeated because they are not linear. Where the average
    is too flat, the draw nearest to these medians is changed. A metric that some draws lack is left as it is.
    """
    draws, chosen, speed_mps = _drawn(prediction).astype(np.float64), list(numbers), prediction.condition.speed_mps
    names = [name for name in MATCHED if np.isfinite(drawn[name]).all() and np.ptp(drawn[name])]
    if not names:
        return np.vstack([prediction.accel_mps2, draws[chosen]])
    found = (Distribution.of(drawn[name], errors.get(name, np.empty(0)), name) for name in names)
    distributions = [distribution for distribution in found if distribution is not None]
    values = np.array([drawn[name] for name in names]).T
    gain = np.linalg.lstsq(values - values.mean(axis=0), draws - draws.mean(axis=0))[0]

    def matched(pulses: FloatArray, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows = [[d.quantile(share) for d, share in zip(distributions, row, strict=True)] for row in shares]
        wanted = np.array(rows, dtype=np.float64).reshape(shares.shape)
        nearest, least = pulses, np.full(len(pulses), np.inf)
        for _ in range(_MOST_STEPS):
            reached = metric_values(pulses, speed_mps, occupant=occupant, predicted=True, names=names)
            missing = wanted - np.array([reached[name] for name in names]).T
            away = np.nan_to_num(np.abs(missing / wanted).max(axis=1), nan=np.inf)
            nearest, least = np.where((away < least)[:, None], pulses, nearest), np.fmin(away, least)
            if (least < _NEAR).all():
                break
            pulses = pulses + np.where(np.isfinite(missing), missing, 0.0) @ gain
        return nearest, least

    middle = np.full((1, len(names)), 0.5)
    pulse, away = matched(prediction.accel_mps2[None], middle)
    if away[0] >= _NEAR:
        medians = np.array([distribution.centre for distribution in distributions])
        off = (values - medians) / np.array([distribution.scale or 1.0 for distribution in distributions])
        order = np.square(off).sum(axis=1).argsort(kind="stable")[:_CANDIDATES]
        candidates, still = matched(draws[order], np.repeat(middle, len(order), axis=0))
        if still.min() < away[0]:
            pulse = candidates[[still.argmin()]]
    below = (values.argsort(axis=0).argsort(axis=0)[chosen] + 0.5) / len(values)
    return np.vstack([pulse, matched(draws[chosen], below)[0]])


def _spread(values: FloatArray, metric: str) -> tuple[float, float] | None:
    """Median of draws, and normal scale of their central 80 % and repeats, or a value twice; None beyond the record."""
    if values.size == 1:
        value = float(values[0])
        return (value, abs(value)) if np.isfinite(value) else None
    lowest, highest = (np.where(np.isnan(values), beyond, values) for beyond in (-np.inf, np.inf))
    low, median = np.quantile(lowest, [_TAIL, 0.5], method="higher")
    high = np.quantile(highest, 1 - _TAIL, method="lower")
    if not np.isfinite([low, median, high]).all():
        return None
    scale = float(high - low) / (2 * float(ndtri(1 - _TAIL)))
    return float(median), math.hypot(scale, _REPEATABILITY.get(metric, 0.0) * float(median))


def _share(values: FloatArray, end: float) -> float:
    return float(((values == end) | np.isnan(values)).mean())
