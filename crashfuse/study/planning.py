"""Planning: pulse metrics over impact speed at fixed weights, and where one more test would narrow the band most.

The ranking is a sequential design (docs/method/next-test.md) by the mean standard deviation of the bias, as a few wide
spots dominate the mean variance.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Self, Unpack, cast

import numpy as np
import pandas as pd

from crashfuse import views
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.approaches.registry import LABELS
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import SPEED_STEP_MPS, CrashTest
from crashfuse.errors import UsageError, one_of, printable, require_a, require_number, several
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.run import Run, one_thread
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_LABELS, Metric, missing_sentences
from crashfuse.signals.pulse import DT_S, FloatArray, kinematics
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import FASTEST_MPS, Estimate, Fit, check_factors, estimates_at, fits_of
from crashfuse.study.outliers import departures
from crashfuse.units import MPH, Sentence, acceleration, read_out, speed, weight

_SLOWEST_MPS = 5 * MPH  # below, a vehicle hardly crushes, and 100 ms are too short for its occupant metrics
_STEP = "Sweep over speed"
BEST = 5  # next tests that are shown first
_GAP_MPS = 3 * MPH  # widest gap between speeds of CAE runs that counts as covered


@dataclass(frozen=True, eq=False, repr=False)
class SpeedSweep:
    """Pulse metrics over impact speed, as one or several approaches predict them."""

    campaign: Campaign
    condition: Condition  # weights and factors at all speeds
    speeds_mps: FloatArray  # ascending, shape (n,)
    metrics: Mapping[str, tuple[tuple[Metric, ...], ...]]  # by approach: all metrics of the pulse at each speed
    config: StudyConfig = StudyConfig()

    @property
    def table(self) -> pd.DataFrame:
        """One row a speed, approach (or ``test``) and metric, as ``sweep.csv``."""
        return views.sweep_table(self)

    def over_speed(self, approach: str, metric: str) -> tuple[Metric, ...]:
        """One metric by one approach at each speed."""
        return tuple(value for metrics in self.metrics[approach] for value in metrics if value.name == metric)

    def missing(self, metric: str) -> list[str]:
        """Sentences on the speeds at which a metric has no value, and why."""
        missing = []
        for approach in self.metrics:
            over_speed = zip(self.speeds_mps.tolist(), self.over_speed(approach, metric), strict=True)
            if gaps := [(v0, value) for v0, value in over_speed if value.value is None]:
                (low, first), (high, _) = gaps[0], gaps[-1]
                where = f"{{}} ({len(gaps)} of {len(self.speeds_mps)} speeds, from {{}})"
                missing.append((Sentence(where, LABELS[approach], speed(low, high, between=" to ")), [first]))
        return missing_sentences(missing)

    def draw(self, metric: str = MAIN_METRICS[0], **display: Unpack[views.DisplayOptions]) -> "views.Drawing":
        """A metric over impact speed, every approach with its band, the tests as points."""
        one_of("metric", metric, METRIC_LABELS)
        return views.sweep_figure(self, metric, views.Display.of(self.campaign.units, **display))

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""

    def write(self, folder: str | Path, **display: Unpack[views.DisplayOptions]) -> None:
        """Write ``sweep.csv`` and ``report.html``."""
        views.write_result(views.sweep_result(self), folder, views.Display.of(self.campaign.units, **display))

    def __repr__(self) -> str:
        ends = speed(float(self.speeds_mps[0]), float(self.speeds_mps[-1]), between=" to ")
        return f"<SpeedSweep, {', '.join(self.metrics)}, {len(self.speeds_mps)} speeds from {ends}>"

    def _repr_html_(self) -> str:
        return views.result_html(views.sweep_result(self))


def sweep(
    campaign: Campaign,
    condition: Condition,
    speeds_mph: tuple[float, float] | None = None,
    approach: str | Fit | Sequence[str | Fit] = "fused",
    config: StudyConfig = StudyConfig(),
    *,
    cache: Cache | None = None,
    watch: Watch = SILENT,
) -> SpeedSweep:
    """Predict the pulse metrics over impact speed; otherwise as :func:`crashfuse.study.prediction.predict`.

    Parameters
    ----------
    condition : Condition
        Its weights and factors hold at all speeds; its own speed does not matter.
    speeds_mph : tuple of float, optional
        The lowest and the highest speed, by default those of the CAE runs and tests; every full mph between them.
    """
    check_factors(campaign, condition)
    require_a(StudyConfig, config, "crashfuse.StudyConfig()")
    speeds = usual_speeds(campaign)
    if speeds_mph is not None:
        for end in several(speeds_mph):
            require_number("A speed of a sweep", end)
        ends = [float(end) * MPH for end in several(speeds_mph)]
        if len(ends) != 2 or not 0 < ends[0] < ends[1] <= FASTEST_MPS:
            found, most = printable(repr(speeds_mph), 60), f"{FASTEST_MPS / MPH:.0f}"
            raise UsageError(f"A sweep takes a speed above 0 and a higher one, up to {most} mph, not {found}.")
        speeds = speeds_between(*ends)
    run, asked = Run.of(campaign, cache, watch), (approach,) if isinstance(approach, Fit) else several(approach)
    campaign = run.bind(campaign)
    return sweep_speed(campaign, fits_of(campaign, asked, config, run), condition, speeds, watch)


def sweep_speed(
    campaign: Campaign,
    fits: Sequence[Fit],
    condition: Condition,
    speeds_mps: FloatArray,
    watch: Watch = SILENT,
    *,
    each: Callable[[Sequence[Estimate]], None] | None = None,
) -> SpeedSweep:
    """A sweep by approaches fitted to the campaign; ``each`` is called with the estimates at each speed."""
    speeds = np.unique(speeds_mps)
    rows = []
    for number, speed_mps in enumerate(speeds.tolist()):
        watch.report(_STEP, number, len(speeds))
        estimates = estimates_at(fits, replace(condition, speed_mps=speed_mps))
        rows.append([estimate.metrics for estimate in estimates])
        if each is not None:
            each(estimates)
    watch.report(_STEP, len(speeds), len(speeds))
    metrics = dict(zip([fit.approach.name for fit in fits], zip(*rows, strict=True), strict=True))
    return SpeedSweep(campaign, condition, speeds, metrics, replace(fits[0].config, approaches=tuple(metrics)))


def usual_speeds(campaign: Campaign) -> FloatArray:
    """Every full mph in the range of CAE runs and tests of 5 mph at least that stop within the record; and its ends."""
    runs = zip(campaign.cae.vectors[:, 0].tolist(), campaign.cae.accel_mps2, strict=True)
    crashes = [*runs, *((test.condition.speed_mps, test.pulse.accel_mps2) for test in campaign.tests)]
    crashes.sort(key=lambda crash: crash[0])
    quick = [crash for crash in crashes if crash[0] >= _SLOWEST_MPS] or crashes
    stop = [v for v, accel in quick if np.isfinite(kinematics(accel.astype(np.float64), v, DT_S).t0_s)]
    return speeds_between(min(stop, default=quick[0][0]), max(stop, default=quick[-1][0]))


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
            wrong = "A range goes from values above 0 to higher ones, not from {} to {}."
            raise UsageError(Sentence(wrong, self.low, self.high))
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
        spans = zip(self.low.vector, self.high.vector, (n_speeds, n_weights, n_weights), strict=True)
        axes = [np.unique(np.linspace(low, high, n) if n > 1 else (low + high) / 2) for low, high, n in spans]
        return _conditions(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), self.low.factors)

    def spread(self, n: int) -> tuple[Condition, ...]:
        """Conditions that fill the range evenly: the first points of the Halton sequence."""
        from scipy.stats import qmc  # half a second

        shares = qmc.Halton(d=3, scramble=False).random(n + 1)[1:]  # the first is a corner
        return _conditions(self.low.vector + shares * (self.high.vector - self.low.vector), self.low.factors)


def _conditions(vectors: FloatArray, factors: tuple[tuple[str, str], ...]) -> tuple[Condition, ...]:
    return tuple(Condition.of_vector([v, front, rear], factors) for v, front, rear in vectors.tolist())


@dataclass(frozen=True, eq=False, repr=False)
class NextTests:
    """Possible next tests, the best first, and half the width of the 95 % band of the bias, mean over a range."""

    campaign: Campaign
    over: ConditionRange
    conditions: tuple[Condition, ...]
    before_mps2: float
    after_mps2: FloatArray  # with a test at each of the conditions
    config: StudyConfig = StudyConfig()

    @property
    def gains(self) -> FloatArray:
        """Share by which each would shrink the band."""
        return 1 - self.after_mps2 / self.before_mps2

    @property
    def repeats(self) -> tuple[str, ...]:
        """Which tests in the range to repeat first, in sentences: those that stand apart, as their ranking cannot."""
        slowest, fastest = self.over.low.speed_mps, self.over.high.speed_mps
        template = "Repeat {} first ({}): it differs from {} by {} or more. A repeat shows which way tests fold."
        return tuple(
            Sentence(template, own.test, at, read_out(own.neighbours), acceleration(min(own.bias_mps2)))
            for own in departures(self.campaign)
            for at in [self.campaign.test(own.test).condition]
            if slowest - SPEED_STEP_MPS < own.speed_mps < fastest + SPEED_STEP_MPS
        )

    @property
    def extrapolated(self) -> tuple[bool, ...]:
        """Whether each lies outside the range of the CAE runs."""
        return tuple(bool(self.campaign.cae.extrapolation(condition)) for condition in self.conditions)

    @property
    def table(self) -> pd.DataFrame:
        """One row a candidate, the best first, as ``next_tests.csv``."""
        return views.next_tests_file(self)

    def draw(self, **display: Unpack[views.DisplayOptions]) -> "views.Drawing":
        """How much each candidate would narrow the band, over its speed."""
        return views.next_tests_figure(self, views.Display.of(self.campaign.units, **display))

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""

    def write(self, folder: str | Path, **display: Unpack[views.DisplayOptions]) -> None:
        """Write ``next_tests.csv`` and ``report.html``."""
        views.write_result(views.next_tests_result(self), folder, views.Display.of(self.campaign.units, **display))

    def __repr__(self) -> str:
        share = f"{100 * self.gains[0]:.0f} % narrower"
        return f"<NextTests, the best of {len(self.conditions)} at {self.conditions[0]}: {share}>"

    def _repr_html_(self) -> str:
        return views.result_html(views.next_tests_result(self))


def next_test(
    campaign: Campaign,
    low: Condition | None = None,
    high: Condition | None = None,
    *,
    candidates: Sequence[Condition] | None = None,
    planned: Sequence[Condition] = (),
    config: StudyConfig = StudyConfig(),
    cache: Cache | None = None,
    watch: Watch = SILENT,
) -> NextTests:
    """Rank tests that might be run next by how much each would narrow the band of the displacement domain.

    Parameters
    ----------
    low, high : Condition, optional
        The range of speeds and weights of interest, by default that of the tests.
    candidates : sequence of Condition, optional
        The tests that could be run; by default speeds over the range, at the middle weights.
    planned : sequence of Condition
        Tests that are going to be run anyway.
    """
    require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    require_a(StudyConfig, config, "crashfuse.StudyConfig()")
    usual = ConditionRange.of(campaign.tests)
    low, high = usual.low if low is None else low, usual.high if high is None else high
    planned = cast(tuple[Condition, ...], several(planned))
    candidates = None if candidates is None else cast(tuple[Condition, ...], several(candidates))
    for condition in (low, high, *planned, *(candidates or ())):
        check_factors(campaign, condition)
    if candidates == ():
        raise UsageError("There is no candidate: name one, or leave candidates out.")
    over = ConditionRange(low, high)
    fit = Fit.of(campaign, DisplacementDomain.name, config, Run.of(campaign, cache, watch))
    assert isinstance(fit.approach, DisplacementDomain)  # noqa: S101 - for the type checker
    return rank_next_tests(fit.campaign, fit.approach, over, candidates, planned, config)


def rank_next_tests(
    campaign: Campaign,
    domain: DisplacementDomain,
    over: ConditionRange,
    candidates: Sequence[Condition] | None = None,
    planned: Sequence[Condition] = (),
    config: StudyConfig = StudyConfig(),
) -> NextTests:
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
    before, after = (domain.calibration_.widening * half_width @ weights for half_width in (now, then))
    ranked = np.argsort(after, kind="stable")
    return NextTests(campaign, over, tuple(candidates[i] for i in ranked), float(before), after[ranked], config)
