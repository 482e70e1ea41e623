"""Leave-one-out studies: from a campaign to rated predictions.

hold out → fit → predict → rate. The held-out test's pulse is used in the last step only, and after it for how well
tests repeat: everything before works on ``campaign.without(test)``, whose fingerprint is also the key under which the
prediction is cached.
"""

import time
from collections import defaultdict
from collections.abc import Hashable, Mapping, MutableMapping, Sequence, Set
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from threadpoolctl import threadpool_limits

from crashfuse.approaches.calibration import Calibration, Coverage, shares_inside
from crashfuse.approaches.registry import APPROACHES
from crashfuse.campaign import Campaign, CrashTest
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.workers import Local, Workers
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit, estimates_at, find_estimate, store_estimate
from crashfuse.study.fold import Fold
from crashfuse.study.plan import StudyPlan
from crashfuse.study.repeatability import Repeatability, repeatability

_STEPS = {"test": "Held-out predictions", "speed group": "Held-out speed groups"}


@dataclass(frozen=True, eq=False)
class Study:
    """A finished study: one fold for each held-out test, in the order of the campaign.

    Attributes
    ----------
    speed_groups : Study, optional
        The same tests, each left out with all others at about its speed, if both were requested and are possible.
    repeatability : mapping of str to mapping of float to Repeatability
        By test, then window in ms, see :func:`crashfuse.study.repeatability.repeatability`.
    """

    campaign: Campaign
    config: StudyConfig
    folds: tuple[Fold, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    speed_groups: "Study | None" = None
    repeatability: Mapping[str, Mapping[float, Repeatability]] = field(default_factory=dict)

    def fold(self, held_out: str) -> Fold:
        """The fold with this test held out."""
        return next(fold for fold in self.folds if fold.held_out == held_out)

    def mean_rating(self, approach: str, window_ms: float) -> float:
        """Overall rating of an approach over one window, averaged over the held-out tests."""
        return float(np.mean([fold.ratings[approach][window_ms].overall for fold in self.folds]))

    def mean_repeat(self, window_ms: float) -> float | None:
        """What repeats would rate over one window, averaged over the held-out tests; None unless known for all."""
        values = [repeat.value for repeat in self.repeats(window_ms).values()]
        return float(np.mean(values)) if len(values) == len(self.folds) else None

    def repeats(self, window_ms: float) -> dict[str, Repeatability]:
        """What a repeat of each held-out test would rate over one window, where it is known."""
        found = {fold.held_out: self.repeatability.get(fold.held_out, {}).get(window_ms) for fold in self.folds}
        return {test: repeat for test, repeat in found.items() if repeat is not None}

    def rating_spread(self, window_ms: float) -> dict[str, dict[str, tuple[float, float, float]]]:
        """Overall rating over one window and interval of single draws, by test and approach with a band."""
        return {
            fold.held_out: {
                name: (fold.ratings[name][window_ms].overall, *fold.rating_interval(name, window_ms))
                for name in fold.with_band
            }
            for fold in self.folds
        }

    @cached_property
    def coverage(self) -> dict[str, Calibration]:
        """Coverage of the held-out tests by the 95 % band of each approach that has one."""
        found: dict[str, Calibration] = {}
        for name in self.config.approaches:
            folds = [(fold.test, fold.estimate(name).prediction.draws_mps2) for fold in self.folds]
            inside = tuple(Coverage.of(test, draws) for test, draws in folds if draws is not None)
            if inside:
                found[name] = Calibration(1.0, inside)
        return found

    @cached_property
    def reliability(self) -> dict[str, FloatArray]:
        """Mean share of a(t) inside the bands at :data:`~crashfuse.approaches.calibration.LEVELS`, by approach."""
        shares = defaultdict[str, list[FloatArray]](list)
        for fold in self.folds:
            for estimate in fold.estimates:
                if (draws := estimate.prediction.draws_mps2) is not None:
                    shares[estimate.approach].append(shares_inside(fold.test, draws))
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
    folds: MutableMapping[Hashable, Fold] | None = None,
) -> Study:
    """Leave out each test in turn, predict it with every approach from all the others, and rate the predictions.

    Parameters
    ----------
    held_out : sequence of str
        Ids of the tests to leave out in turn; empty for all.
    cache : Cache, optional
        Finished predictions are read from it and stored in it, so an interrupted study continues where it stopped.
    workers : int, optional
        Number of processes for the folds; default one per core. The results do not depend on it.
    scheduler : str, optional
        Address of a Dask scheduler (``tcp://host:port``), whose workers then compute the folds:
        :class:`crashfuse.execution.cluster.Cluster`.
    folds : mutable mapping, optional
        Finished folds by their :func:`fold_key`: folds found here are not computed or rated again, and new ones are
        added.

    Raises
    ------
    UsageError, DataError
        If the study is impossible, see :class:`crashfuse.study.plan.StudyPlan`.
    Cancelled
        If the watch was told to stop.
    CrashfuseError
        If workers die repeatedly, or the cluster cannot be reached or has other versions.
    """
    plan = StudyPlan(campaign, config, tuple(held_out))
    return run_plan(plan, cache=cache, watch=watch, workers=workers, scheduler=scheduler, folds=folds)


def run_plan(
    plan: StudyPlan,
    *,
    cache: Cache | None = None,
    watch: Watch = SILENT,
    workers: int | None = None,
    scheduler: str | None = None,
    folds: MutableMapping[Hashable, Fold] | None = None,
) -> Study:
    """Run a plan that has already been checked, as :func:`run_study` does."""
    folds = {} if folds is None else folds
    tests = [plan.campaign.test(test_id) for test_id in plan.held_out]
    with workers_at(scheduler, workers) as place:
        studies = [_leave_out(plan.campaign, tests, way, cache or Cache(), watch, place, folds) for way in plan.configs]
    start, config = time.perf_counter(), plan.config
    repeats = repeatability(plan.campaign, config.windows_ms, seed=config.seed, cache=cache, watch=watch)
    studies = [replace(study, repeatability=repeats) for study in studies]
    seconds = {**studies[0].seconds, "repeatability": time.perf_counter() - start}
    groups = studies[1] if len(studies) > 1 else None
    return replace(studies[0], config=config, seconds=seconds, speed_groups=groups)


def fold_key(campaign: Campaign, config: StudyConfig, test_id: str) -> Hashable:
    """Key of everything that determines the fold of a test; the config is one of ``split_configs``."""
    return campaign.fingerprint, config, test_id


def workers_at(scheduler: str | None, processes: int | None) -> AbstractContextManager[Workers]:
    """Workers of a Dask cluster if a scheduler is given, else processes on this machine."""
    if scheduler is None:
        return nullcontext(Local(processes))
    from crashfuse.execution.cluster import connected  # import takes 1 s and needs an optional extra

    return connected(scheduler)


_Task = list[tuple[CrashTest, list[str]]]
"""Tests predicted from the same others, each with the approaches to predict it."""


def _leave_out(
    campaign: Campaign,
    tests: Sequence[CrashTest],
    config: StudyConfig,
    cache: Cache,
    watch: Watch,
    workers: Workers,
    folds: MutableMapping[Hashable, Fold],
) -> Study:
    """Run the study for one way of leaving these tests out."""
    step = _STEPS[config.leave_out]
    start = time.perf_counter()
    finished = {test.id: fold for test in tests if (fold := folds.get(fold_key(campaign, config, test.id))) is not None}
    unfinished = [test for test in tests if test.id not in finished]
    estimates: dict[tuple[str, str], Estimate] = {}
    tasks: dict[tuple[str, ...], _Task] = {}
    for test in unfinished:
        training = config.training_campaign(campaign, test.id)
        found = {name: find_estimate(training, test.condition, name, config, cache) for name in config.approaches}
        estimates |= {(test.id, name): estimate for name, estimate in found.items() if estimate is not None}
        if missing := [name for name, estimate in found.items() if estimate is None]:
            tasks.setdefault(training.test_ids, []).append((test, missing))
    needed = {name for task in tasks.values() for _, names in task for name in names}
    shared = prepare(campaign, needed, config, cache, watch)
    prepared = time.perf_counter()

    total = len(unfinished) * len(config.approaches)
    watch.report(step, len(estimates), total)
    work = partial(_predict, config=config.on_this_device)
    with closing(workers.completed(work, campaign, list(tasks.values()), shared, watch)) as completed:
        for predicted in completed:
            estimates |= {(test_id, estimate.approach): estimate for test_id, estimate in predicted}
            watch.report(step, len(estimates), total)

    for test in unfinished:
        fold = Fold.of(test, [estimates[test.id, name] for name in config.approaches], config.windows_ms)
        folds[fold_key(campaign, config, test.id)] = finished[test.id] = fold
    seconds = {"prepare": prepared - start, "held_out_tests": time.perf_counter() - prepared}
    return Study(campaign, config, tuple(finished[test.id] for test in tests), seconds)


def prepare(campaign: Campaign, approaches: Set[str], config: StudyConfig, cache: Cache, watch: Watch) -> Cache:
    """Compute once, on all cores, what depends on the CAE runs alone; returns a new Cache on that folder."""
    cae_only = campaign.without(campaign.test_ids)
    shared = Cache(cache.folder)
    for name in sorted(approaches):
        config.create(name, shared).prepare(cae_only, watch)
    return shared


def _predict(
    campaign: Campaign, task: _Task, cache: Cache, watch: Watch, *, config: StudyConfig
) -> list[tuple[str, Estimate]]:
    """Predict the tests of a task; returns pairs of test id and estimate."""
    training = config.training_campaign(campaign, task[0][0].id)
    names = {name for _, names in task for name in names}
    predicted = []
    with threadpool_limits(1):  # contended BLAS threads multiply CPU time and change the numbers
        # mixtures come last, so that they find the fits of the others in the cache
        fits = {
            name: Fit.of(training, name, config, cache=cache, watch=watch)
            for name in sorted(names, key=APPROACHES.index)
        }
        for test, missing in task:
            for estimate in estimates_at([fits[name] for name in missing], test.condition):
                store_estimate(estimate, training, config, cache)
                predicted.append((test.id, estimate))
    return predicted
