"""Sweeps over impact speed: pulse metrics predicted by each approach, at fixed weights."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from crashfuse.approaches.registry import LABELS
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.metrics import Metric, missing_sentences
from crashfuse.signals.pulse import DT_S, FloatArray, kinematics
from crashfuse.study.estimate import Estimate, Fit, estimates_at
from crashfuse.units import MPH
from crashfuse.wording import Sentence, speed, weight

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
    """Predict at several impact speeds, all else equal: one sweep for each fit, all of one campaign.

    ``each`` is called with the estimates at each speed; the sweep keeps their metrics only.
    """
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
    """Every full mph in the range of a campaign's CAE runs and tests, and the ends of that range, in m/s.

    The ends are runs or tests of 5 mph at least whose vehicle stops within the record, as most metrics need.
    """
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
    """Sentences on the speeds at which a metric has no value, and on what the record is too short for there."""
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
