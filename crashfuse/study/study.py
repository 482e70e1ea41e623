"""Leave one test out: the straight line from a campaign to rated predictions.

hold out → fit → predict → rate. The held-out test's pulse is touched in the last step only: everything before it
works on ``campaign.without(test)``, whose fingerprint is also the key under which the prediction is cached.
"""

import time
from collections.abc import Sequence, Set
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import cast

import numpy as np
from threadpoolctl import threadpool_limits

from crashfuse.approaches.calibration import Calibration, Coverage, shares_inside
from crashfuse.approaches.fit_cache import settings
from crashfuse.approaches.registry import APPROACHES
from crashfuse.approaches.settings import Device
from crashfuse.campaign import Campaign, CrashTest
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.workers import Task, Workers, workers_at
from crashfuse.signals.pulse import DT_S, FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, estimate_at, find_estimate
from crashfuse.study.fold import Fold

_SLOWEST_S = 1e-3  # step of the slowest record: its last sample stands for that long
_STEPS = {"test": "Held-out predictions", "speed group": "Held-out speed groups"}


@dataclass(frozen=True, eq=False)
class Study:
    """A finished study: one fold for each held-out test, in the order of the campaign.

    Attributes
    ----------
    campaign : Campaign
    config : StudyConfig
    folds : tuple of Fold
    seconds : dict of str to float
    speed_groups : Study, optional
        The same tests, each left out with all others at about its speed; where both was asked for and is possible.
    """

    campaign: Campaign
    config: StudyConfig
    folds: tuple[Fold, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    speed_groups: "Study | None" = None

    def fold(self, held_out: str) -> Fold:
        """The fold of this test."""
        return next(fold for fold in self.folds if fold.held_out == held_out)

    def mean_rating(self, approach: str, window_ms: float) -> float:
        """Overall rating of an approach over one window, averaged over the held-out tests."""
        return float(np.mean([fold.ratings[approach][window_ms].overall for fold in self.folds]))

    def rating_spread(self, window_ms: float) -> dict[str, dict[str, tuple[float, float, float]]]:
        """By test and approach with a band: overall rating over one window, and the interval of single draws."""
        return {
            fold.held_out: {
                name: (fold.ratings[name][window_ms].overall, *fold.rating_interval(name, window_ms))
                for name in fold.with_band
            }
            for fold in self.folds
        }

    @cached_property
    def coverage(self) -> dict[str, Calibration]:
        """How much of the held-out tests lies inside the 95 % band of each approach that has one."""
        found: dict[str, Calibration] = {}
        for name in self.config.approaches:
            folds = [(self.campaign.test(f.held_out), f.estimate(name).prediction.draws_mps2) for f in self.folds]
            inside = tuple(Coverage.of(test, draws) for test, draws in folds if draws is not None)
            if inside:
                found[name] = Calibration(1.0, inside)
        return found

    @cached_property
    def reliability(self) -> dict[str, FloatArray]:
        """Mean share of a(t) inside bands of each of :data:`~crashfuse.approaches.calibration.LEVELS`, likewise."""
        shares: dict[str, list[FloatArray]] = {}
        for fold in self.folds:
            for estimate in fold.estimates:
                if (draws := estimate.prediction.draws_mps2) is not None:
                    own = shares_inside(self.campaign.test(fold.held_out), draws)
                    shares.setdefault(estimate.approach, []).append(own)
        return {name: np.mean(own, axis=0) for name, own in shares.items()}


def run_study(
    campaign: Campaign,
    config: StudyConfig = StudyConfig(),
    *,
    held_out: Sequence[str] = (),
    cache: Cache | None = None,
    watch: Watch = SILENT,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Study:
    """Leave out each test in turn, predict it with every approach from all the others, and rate the predictions.

    Parameters
    ----------
    campaign : Campaign
    config : StudyConfig
    held_out : sequence of str
        Ids of the tests to leave out in turn; empty for all.
    cache : Cache, optional
        Finished predictions are read from it and kept in it, so a study that was killed continues where it was.
    watch : Watch
    workers : int, optional
        Processes for the folds; default one for each core. The numbers don't depend on it.
    scheduler : str, optional
        Address of a Dask scheduler (``tcp://host:port``), whose workers then compute the folds:
        :class:`crashfuse.execution.cluster.Cluster`.

    Raises
    ------
    UsageError
        If a name, a window or the number of tests makes the study impossible.
    Cancelled
        If the watch was told to stop.
    CrashfuseError
        If workers die again and again, or the cluster cannot be reached or does not have the same versions.
    """
    check_study(campaign, config, held_out)
    tests = [campaign.test(test_id) for test_id in dict.fromkeys(held_out or campaign.test_ids)]
    with workers_at(scheduler, workers) as place:
        studies = [
            _leave_out(campaign, tests, way, cache or Cache(), watch, place)
            for way in config.each
            if config.hold_out != "both" or way.hold_out == "test" or _has_speed_groups(campaign)
        ]
    return replace(studies[0], config=config, speed_groups=studies[1] if len(studies) > 1 else None)


def _leave_out(
    campaign: Campaign, tests: Sequence[CrashTest], config: StudyConfig, cache: Cache, watch: Watch, workers: Workers
) -> Study:
    """Run the study that leaves these tests out in one way."""
    step = _STEPS[config.hold_out]
    start = time.perf_counter()
    # what mixes the others comes last: it then finds in the cache what they have learned
    wanted = [(test, name) for name in sorted(config.approaches, key=APPROACHES.index) for test in tests]
    estimates: dict[tuple[str, str], Estimate] = {}
    for test, name in wanted:
        if (
            kept := find_estimate(config.rest(campaign, test.id), test.condition, name, config, cache=cache)
        ) is not None:
            estimates[test.id, name] = kept
    alike: dict[tuple[str, tuple[str, ...]], list[CrashTest]] = {}  # tests that are predicted from the same others
    for test, name in wanted:
        if (test.id, name) not in estimates:
            alike.setdefault((name, config.rest(campaign, test.id).test_ids), []).append(test)
    tasks = [Task(name, tuple(tests)) for (name, _), tests in alike.items()]
    shared = _prepare(campaign, {task.approach for task in tasks}, config, cache, watch)
    prepared = time.perf_counter()

    watch.report(step, len(estimates), len(wanted))
    # "auto" must not mean something else on another machine
    devices = [device for name in config.approaches if (device := config.create(name).device)] or [config.device]
    work = partial(_hold_out, config=replace(config, device=cast(Device, devices[0])))
    with closing(workers.completed(work, campaign, tasks, shared, watch)) as completed:
        for found in completed:
            estimates |= {(test_id, estimate.approach): estimate for test_id, estimate in found}
            watch.report(step, len(estimates), len(wanted))

    folds = tuple(
        Fold.of(test, [estimates[test.id, name] for name in config.approaches], config.windows_ms) for test in tests
    )
    finished = time.perf_counter()
    return Study(campaign, config, folds, {"prepare": prepared - start, "held_out_tests": finished - prepared})


def check_study(campaign: Campaign, config: StudyConfig, held_out: Sequence[str] = ()) -> None:
    """Say what makes a study impossible before anything is computed.

    Raises
    ------
    UsageError
        If a name, a window or the number of tests makes it so.
    DataError
        If a held-out test does not vary over a window, or its record ends before: it cannot be rated.
    """
    campaign.without(held_out)
    if len(campaign.tests) < 2:
        raise UsageError("Leaving a test out takes at least 2 tests: one to predict and one to learn from.")
    if config.hold_out == "speed group" and not _has_speed_groups(campaign):
        raise UsageError("All tests are of one speed group: leaving it out leaves nothing to learn from.")
    if not config.approaches:
        raise UsageError(f"Name at least one approach: {', '.join(APPROACHES)}.")
    config.check()
    if not 0 <= config.seed < 2**32:
        raise UsageError(f"A seed is a whole number from 0 to {2**32 - 1}, not {config.seed}.")
    for window in config.windows_ms:
        if not 10 <= window <= 100:
            raise UsageError(f"A rating window of {window:g} ms is not possible; choose 10 to 100 ms.")
        for test_id in held_out or campaign.test_ids:
            test = campaign.test(test_id)
            if window / 1e3 > test.recorded_s + _SLOWEST_S:
                found, advice = f"{test.recorded_s * 1e3:.4g} ms", "rate a shorter window, or hold out other tests"
                raise DataError(Problem(test_id, f"a record over 0–{window:g} ms", found, advice))
            start = test.pulse.accel_mps2[: round(window / 1e3 / DT_S)]
            if np.ptp(start) == 0:
                found = "no change at all"
                advice = "check its time zero or rate a longer window"
                raise DataError(Problem(test_id, f"a pulse that varies over 0–{window:g} ms", found, advice))


def _has_speed_groups(campaign: Campaign) -> bool:
    """Whether a speed group can be left out and something remains."""
    return len(campaign.speed_group(campaign.test_ids[0])) < len(campaign.tests)


def _prepare(campaign: Campaign, approaches: Set[str], config: StudyConfig, cache: Cache, watch: Watch) -> Cache:
    """Fit once what only the CAE runs decide, with all cores; the folds then find it in the cache.

    Returns the same cache, but one that has been used for this and nothing else.
    """
    cae_only = campaign.without(campaign.test_ids)
    shared = Cache(cache.folder)
    for name in sorted(approaches):
        approach = config.create(name, shared)
        with shared.alone("prepared", {**settings(approach), "cae": campaign.cae.fingerprint}, watch):
            approach.prepare(cae_only, watch)
    return shared


def _hold_out(
    campaign: Campaign, task: Task, cache: Cache, watch: Watch, *, config: StudyConfig
) -> list[tuple[str, Estimate]]:
    """Predict the tests of a task; returns each one's id and what is expected of it."""
    tests, name = task.tests, task.approach
    rest = config.rest(campaign, tests[0].id)
    with threadpool_limits(1):  # contended BLAS threads cost many times the CPU, and other numbers
        return [(t.id, estimate_at(rest, t.condition, name, config, cache=cache, watch=watch)) for t in tests]
