"""Planning: pulse metrics over impact speed at fixed weights, and where one more test would narrow the band most.

The ranking is a sequential design (docs/method/next-test.md) by the mean standard deviation of the bias, as a few wide
spots dominate the mean variance.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.approaches.registry import LABELS
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.run import one_thread
from crashfuse.signals.metrics import Metric, missing_sentences
from crashfuse.signals.pulse import DT_S, FloatArray, kinematics
from crashfuse.study.estimate import Estimate, Fit, estimates_at
from crashfuse.units import MPH, Sentence, speed, weight

_SLOWEST_MPS = 5 * MPH  # below, a vehicle hardly crushes, and 100 ms are too short for its occupant metrics
_STEP = "Sweep over speed"
_GAP_MPS = 3 * MPH  # widest gap between speeds of CAE runs that counts as covered


@dataclass(frozen=True, eq=False, slots=True)
class Sweep:
    """Metrics predicted by one approach over impact speed."""

    approach: str
    condition: Condition  # weights and factors at all speeds
    speeds_mps: FloatArray  # ascending, shape (n,)
    metrics: tuple[tuple[Metric, ...], ...]  # all metrics of the pulse at each speed

    def __repr__(self) -> str:
        return f"<Sweep by {self.approach} over {len(self.metrics)} speeds>"

    def over_speed(self, metric: str) -> tuple[Metric, ...]:
        """One metric at each speed."""
        return tuple(value for metrics in self.metrics for value in metrics if value.name == metric)


def sweep_speed(
    fits: Sequence[Fit],
    condition: Condition,
    speeds_mps: FloatArray,
    watch: Watch = SILENT,
    *,
    each: Callable[[Sequence[Estimate]], None] | None = None,
) -> tuple[Sweep, ...]:
    """One sweep for each fit, all of one campaign; ``each`` is called with the estimates at each speed."""
    speeds = np.unique(speeds_mps)
    rows = []
    for number, speed_mps in enumerate(speeds.tolist()):
        watch.report(_STEP, number, len(speeds))
        estimates = estimates_at(fits, replace(condition, speed_mps=speed_mps))
        rows.append([estimate.metrics for estimate in estimates])
        if each is not None:
            each(estimates)
    watch.report(_STEP, len(speeds), len(speeds))
    columns = zip(*rows, strict=True)
    return tuple(Sweep(fit.approach.name, condition, speeds, column) for fit, column in zip(fits, columns, strict=True))


def usual_speeds(campaign: Campaign) -> FloatArray:
    """Every full mph in the range of CAE runs and tests of 5 mph at least that stop within the record; and its ends."""
    runs = zip(campaign.cae.vectors[:, 0].tolist(), campaign.cae.accel_mps2, strict=True)
    crashes = [*runs, *((test.condition.speed_mps, test.pulse.accel_mps2) for test in campaign.tests)]
    crashes.sort(key=lambda crash: crash[0])
    quick = [crash for crash in crashes if crash[0] >= _SLOWEST_MPS] or crashes

    def stops(accel_mps2: FloatArray, speed_mps: float) -> bool:
        return bool(np.isfinite(kinematics(accel_mps2.astype(np.float64), speed_mps, DT_S).t0_s))

    low, high = (
        next((speed for speed, accel in ordered if stops(accel, speed)), ordered[0][0])
        for ordered in (quick, quick[::-1])
    )
    return speeds_between(low, high)


def speeds_between(low_mps: float, high_mps: float) -> FloatArray:
    """Every full mph between two speeds in m/s, and these themselves."""
    within = np.arange(np.ceil(low_mps / MPH), np.floor(high_mps / MPH) + 1) * MPH
    return np.unique(np.clip([low_mps, *within, high_mps], low_mps, high_mps))


def uncovered_speeds(library: CaeLibrary, low_mps: float, high_mps: float) -> tuple[tuple[float, float], ...]:
    """Parts of a range of speeds without CAE runs, as (from, to) in m/s: beyond all runs, or in wide gaps."""
    speeds = np.unique(library.vectors[:, 0])
    inner = [(low, high) for low, high in pairwise(speeds.tolist()) if high - low > _GAP_MPS]
    parts = [(low_mps, float(speeds[0])), *inner, (float(speeds[-1]), high_mps)]
    clipped = ((max(start, low_mps), min(end, high_mps)) for start, end in parts)
    return tuple((start, end) for start, end in clipped if start < end)


def missing_over_speed(sweeps: Sequence[Sweep], metric: str) -> list[str]:
    """Sentences on the speeds at which a metric has no value, and why."""
    missing = []
    for sweep in sweeps:
        over_speed = zip(sweep.speeds_mps.tolist(), sweep.over_speed(metric), strict=True)
        if gaps := [(v0, value) for v0, value in over_speed if value.value is None]:
            (low, first), (high, _) = gaps[0], gaps[-1]
            where = f"{{}} ({len(gaps)} of {len(sweep.metrics)} speeds, from {{}})"
            missing.append((Sentence(where, LABELS[sweep.approach], speed(low, high, between=" to ")), [first]))
    return missing_sentences(missing)


def weights_sentence(condition: Condition, tests: Sequence[CrashTest]) -> str:
    """The weights of a sweep, and those of the tests."""
    swept = Sentence("Swept at front {}, rear {}.", weight(condition.front_weight_kg), weight(condition.rear_weight_kg))
    if not tests:
        return swept
    weights = np.array([test.condition.vector[1:] for test in tests])
    front, rear = (weight(*ends) for ends in zip(weights.min(axis=0), weights.max(axis=0), strict=True))
    return Sentence("{} Weights of the tests: front {}, rear {}.", swept, front, rear)


_N_TARGETS = 48


@dataclass(frozen=True, slots=True)
class ConditionRange:
    """The range of speeds and weights of interest, for one combination of factors; equal limits keep a value fixed."""

    low: Condition
    high: Condition

    def __post_init__(self) -> None:
        low, high = self.low.vector, self.high.vector
        if not (np.isfinite(high).all() and (low > 0).all() and (low <= high).all()):
            raise UsageError(
                Sentence("A range goes from values above 0 to higher ones, not from {} to {}.", self.low, self.high)
            )
        if self.low.factors != self.high.factors:
            raise UsageError(f"A range is of one kind of vehicle, not from {self.low.factors} to {self.high.factors}.")

    @classmethod
    def of(cls, tests: Sequence[CrashTest]) -> Self:
        """The range of tests, with the combination of factors tested most often; a UsageError without tests."""
        if not tests:
            raise UsageError("A range needs a test, or limits of your own.")
        vectors = np.array([test.condition.vector for test in tests])
        [(kind, _)] = Counter(test.condition.factors for test in tests).most_common(1)
        return cls(*_conditions(np.array([vectors.min(axis=0), vectors.max(axis=0)]), kind))

    def grid(self, n_speeds: int, n_weights: int = 1) -> tuple[Condition, ...]:
        """Conditions at evenly spaced speeds and weights, limits included; if just one, the middle value."""
        numbers = (n_speeds, n_weights, n_weights)
        axes = [
            np.unique(np.linspace(low, high, n) if n > 1 else (low + high) / 2)
            for low, high, n in zip(self.low.vector, self.high.vector, numbers, strict=True)
        ]
        return _conditions(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), self.low.factors)

    def spread(self, n: int) -> tuple[Condition, ...]:
        """Conditions that fill the range evenly: the first points of the Halton sequence, so always the same."""
        from scipy.stats import qmc  # half a second

        shares = qmc.Halton(d=3, scramble=False).random(n + 1)[1:]  # the first is a corner
        return _conditions(self.low.vector + shares * (self.high.vector - self.low.vector), self.low.factors)


def _conditions(vectors: FloatArray, factors: tuple[tuple[str, str], ...]) -> tuple[Condition, ...]:
    return tuple(Condition.of_vector([v, front, rear], factors) for v, front, rear in vectors.tolist())


@dataclass(frozen=True, slots=True)
class NextTest:
    """A possible next test, and its effect on half the width of the 95 % band of the bias, mean over the range."""

    condition: Condition
    before_mps2: float
    after_mps2: float
    extrapolation: tuple[str, ...] = ()  # notes on its inputs outside the CAE runs' range

    def __repr__(self) -> str:
        return f"<NextTest at {self.condition}: {100 * self.gain:.1f} % narrower>"

    @property
    def gain(self) -> float:
        """Share by which the band would shrink."""
        return 1 - self.after_mps2 / self.before_mps2


def rank_next_tests(
    domain: DisplacementDomain,
    over: ConditionRange,
    candidates: Sequence[Condition] | None = None,
    planned: Sequence[Condition] = (),
) -> tuple[NextTest, ...]:
    """Rank conditions by how much a test there would shrink the band over a range, the largest gain first.

    The band is that of a new test's bias, averaged over the range and over displacement up to the crush of the CAE
    pulse, like which a candidate is assumed to crush. Rebound and emulator are left out. The domain has to have the
    hierarchical bias. Candidates, by default 14 speeds at the middle weights, may lie outside the range. Planned tests
    count as run: to choose several, add the best one each time.
    """
    candidates = over.grid(14) if candidates is None else candidates
    targets = [domain.expected_points(condition) for condition in over.spread(_N_TARGETS)]
    bias = domain.bias_
    if not isinstance(bias, HierarchicalBias):
        raise UsageError("The next test is chosen by the hierarchical bias (preset fast), not that of Table 4.")
    if open_factors := bias.unknown_factors(over.low):
        raise UsageError(f"Tests differ by {' and '.join(open_factors)}: say for which of these the range is.")
    with one_thread():
        bias = bias.also([domain.expected_points(condition) for condition in planned])
        now, then = bias.half_widths(targets, [domain.expected_points(condition) for condition in candidates])
    weights = np.concatenate([np.full(n := t.displacement_m.size, 1 / (n * len(targets))) for t in targets])
    widening, cae = domain.calibration_.widening, domain.model_.cae_
    before, after = (widening * half_width @ weights for half_width in (now, then))
    ranked = np.argsort(after, kind="stable")
    return tuple(
        NextTest(c := candidates[i], float(before), float(after[i]), cae.extrapolation(c)) for i in ranked.tolist()
    )
