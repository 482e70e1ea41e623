"""Running a leave-one-out study: hold out → fit → predict → rate.

The held-out test's pulse is used in the last step only, and for how well tests repeat: all else works on
``campaign.without(test)``. Tests predicted from the same others are one task of a worker; what needs no network is
computed first, or while the networks train.
"""

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Hashable, Mapping, MutableMapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Unpack

from crashfuse.approaches.base import FITS
from crashfuse.approaches.registry import CLASSES
from crashfuse.campaign import Campaign
from crashfuse.errors import several
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run, RunOptions, give_back, one_thread_throughout
from crashfuse.execution.workers import running
from crashfuse.study.config import StudyConfig, StudyPlan
from crashfuse.study.estimate import Estimate, Fit, estimates_at, find_estimate, store_estimate
from crashfuse.study.repeatability import Repeatability, repeatability
from crashfuse.study.study import Fold, Study

_EARLY, _LATE = "Held-out predictions", "Held-out predictions by networks"


@dataclass(frozen=True, slots=True)
class Wanted:
    """A prediction of a test by an approach that learned from all tests but those left out."""

    left_out: tuple[str, ...]
    test: str
    approach: str


Estimates = dict[Wanted, Estimate]


@dataclass(frozen=True, slots=True)
class Task:
    """Predictions that share their fits; without any, the repeatability of tests."""

    wanted: tuple[Wanted, ...] = ()
    repeated: tuple[str, ...] = ()


def prepare(campaign: Campaign, approaches: Set[str], config: StudyConfig, run: Run) -> Run:
    """Compute once, on all cores, what no test's pulse affects; returns the run with a cache that used nothing else."""
    cae_only = campaign.without(campaign.test_ids)
    conditions = [test.condition for test in campaign.tests]
    shared = run.anew()
    for name in sorted(approaches):
        config.create(name).prepare(cae_only, conditions, shared)
    give_back()
    return shared


def _found_in(cache: Cache, campaign: Campaign, wanted: Sequence[Wanted], config: StudyConfig) -> Estimates:
    training = {left_out: campaign.without(left_out) for left_out in {one.left_out for one in wanted}}

    def find(one: Wanted) -> Estimate | None:
        return find_estimate(training[one.left_out], campaign.test(one.test).condition, one.approach, config, cache)

    return {one: estimate for one in wanted if (estimate := find(one)) is not None}


@dataclass(frozen=True, eq=False)
class Computation:
    """Computes the estimates of a study that are not in the cache."""

    campaign: Campaign
    config: StudyConfig
    run: Run
    known: Estimates  # new ones are added
    on_more: Callable[[], None]  # called each time that more is known
    seconds: dict[str, float] = field(default_factory=dict)  # duration of the training, and of all

    def compute(self, wanted: Sequence[Wanted], repeated: tuple[str, ...]) -> None:
        """Compute these; and the repeatability of these tests, where workers have time for it."""
        start = time.perf_counter()
        missing = [one for one in wanted if one not in self.known]
        late = [one for one in missing if CLASSES[one.approach].trains_networks]
        early = [one for one in missing if not CLASSES[one.approach].trains_networks]
        tasks = _tasks(early)
        shared = self._prepared(missing, self.run, trained=False)
        elsewhere = self.run.workers.are_elsewhere(tasks)
        if elsewhere:  # what is not known of repeatability in the end is computed there
            tasks.append(Task(repeated=repeated))
        if elsewhere and late:
            self._compute(_tasks(late), self._train_beside(tasks, late, shared, early), _LATE, late)
        else:  # here, one after the other: what can be shown first is not delayed by training
            self._compute(tasks, shared, _EARLY, early)
            if late:
                self._compute(_tasks(late), self._prepared(late, self.run), _LATE, late)
        self.seconds["held_out_tests"] = time.perf_counter() - start

    def _train_beside(self, tasks: Sequence[Task], late: Sequence[Wanted], shared: Run, early: Sequence[Wanted]) -> Run:
        stop = threading.Event()
        with ThreadPoolExecutor(1, "training") as thread:
            try:
                run = replace(self.run, watch=self.run.watch.also_cancelled_by(stop))
                training = thread.submit(self._prepared, late, run)
                self._compute(tasks, shared, _EARLY, early)
                trained = training.result()
            finally:
                stop.set()
        trained.cache.used |= {name for name in shared.cache.used if name.startswith(FITS)}  # mixtures are made of them
        return trained

    def _prepared(self, wanted: Sequence[Wanted], run: Run, *, trained: bool = True) -> Run:
        start = time.perf_counter()
        names = {one.approach for one in wanted if trained or not CLASSES[one.approach].trains_networks}
        shared = prepare(self.campaign, names, self.config, run)
        self.seconds["prepare"] = time.perf_counter() - start
        return replace(shared, watch=self.run.watch)

    def _compute(self, tasks: Sequence[Task], shared: Run, step: str, wanted: Sequence[Wanted]) -> None:
        """Progress is that of fits, which take the time."""
        work, fits = partial(_computed, config=self.config.on_this_device), _fits(wanted)
        with closing(shared.completed(work, self.campaign, tasks)) as completed:
            for estimates in completed:
                self.known.update(estimates)
                if fits:
                    left = _fits([one for one in wanted if one not in self.known])
                    shared.watch.report(step, len(fits - left), len(fits))
                if estimates:
                    self.on_more()


def _fits(wanted: Sequence[Wanted]) -> set[tuple[tuple[str, ...], str]]:
    return {(one.left_out, one.approach) for one in wanted}


def _tasks(wanted: Sequence[Wanted]) -> list[Task]:
    by_left_out = defaultdict[tuple[str, ...], list[Wanted]](list)
    for one in wanted:
        by_left_out[one.left_out].append(one)
    return [Task(tuple(shared)) for shared in by_left_out.values()]


def _computed(campaign: Campaign, task: Task, run: Run, *, config: StudyConfig) -> list[tuple[Wanted, Estimate]]:
    if task.repeated:
        repeatability(campaign, config.windows_ms, task.repeated, seed=config.seed, run=run)
        return []
    training = campaign.without(task.wanted[0].left_out)
    estimates: list[tuple[Wanted, Estimate]] = []
    with one_thread_throughout():
        # mixtures come last, so that they find the fits of the others in the cache
        names = sorted({one.approach for one in task.wanted}, key=CLASSES.declared.index)
        fits = {name: Fit.of(training, name, config, run) for name in names}
        for test in dict.fromkeys(one.test for one in task.wanted):
            wanted = [one for one in task.wanted if one.test == test]
            predicted = estimates_at([fits[one.approach] for one in wanted], campaign.test(test).condition)
            for estimate in predicted:
                store_estimate(estimate, training, config, run.cache)
            estimates += zip(wanted, predicted, strict=True)
    return estimates


def run_study(
    campaign: Campaign,
    config: StudyConfig = StudyConfig(),
    *,
    held_out: Sequence[str] = (),
    approaches: Sequence[str] = (),
    folds: MutableMapping[Hashable, Fold] | None = None,
    **run: Unpack[RunOptions],
) -> Study:
    """Leave out each test in turn, predict it with every approach from all the others, and rate the predictions.

    Parameters
    ----------
    held_out, approaches : sequence of str, or str
        Ids of the tests to leave out in turn, and names of the approaches; empty for all, and for those of the config.
    folds : mutable mapping, optional
        Finished folds by their :func:`fold_key`, which are not computed or rated again; new ones are added.
    **run
        See :class:`crashfuse.execution.run.RunOptions`; a watch is shown parts without repeatability.

    Raises
    ------
    CrashfuseError
        If the study is impossible, the watch was told to stop, workers die repeatedly, or the cluster is unfit.
    """
    if approaches:
        config = replace(config, approaches=several(approaches))
    plan = StudyPlan(campaign, config, several(held_out))
    with running(campaign, **run) as started:
        return _study(plan, started, {} if folds is None else folds)


def _study(plan: StudyPlan, run: Run, folds: MutableMapping[Hashable, Fold]) -> Study:
    plan = replace(plan, campaign=run.bind(plan.campaign))
    campaign, config, watch = plan.campaign, plan.config, run.watch
    by_fold = {
        fold_key(campaign, way, test): [Wanted(way.left_out(campaign, test), test, name) for name in config.approaches]
        for way in plan.configs
        for test in plan.held_out
    }
    finished = {key: fold for key in by_fold if (fold := folds.get(key)) is not None}
    wanted = [one for key, fold in by_fold.items() if key not in finished for one in fold]
    known = _found_in(run.cache, campaign, wanted, config)

    rated: dict[tuple[Wanted, ...], Fold] = {}

    def known_of(key: Hashable) -> Fold | None:
        part = tuple(one for one in by_fold[key] if one in known)
        if key not in finished and part and part not in rated:
            rated[part] = Fold.of(campaign.test(part[0].test), [known[one] for one in part], config.windows_ms)
        return finished.get(key) or rated.get(part)

    def show_part() -> None:
        parts = {key: fold for key in by_fold if (fold := known_of(key)) is not None} if watch.wants_parts else {}
        names = tuple(name for name in config.approaches if all(name in fold.ratings for fold in parts.values()))
        if names and any(fold_key(campaign, plan.configs[0], test) in parts for test in plan.held_out):
            watch.show_part(_joined(plan, replace(config, approaches=names), parts, {}, {}))

    computation = Computation(campaign, config, run, known, show_part)
    computation.compute(wanted, plan.held_out)
    finished |= {key: fold for key in by_fold if key not in finished and (fold := known_of(key)) is not None}
    folds.update(finished)
    repeats = repeatability(campaign, config.windows_ms, plan.held_out, seed=config.seed, run=run)
    return _joined(plan, config, finished, computation.seconds, repeats)


def _joined(
    plan: StudyPlan,
    config: StudyConfig,
    folds: Mapping[Hashable, Fold],
    seconds: dict[str, float],
    repeats: Mapping[str, Mapping[float, Repeatability]],
) -> Study:
    def study(way: StudyConfig) -> Study:
        keys = [fold_key(plan.campaign, way, test) for test in plan.held_out]
        known = tuple(folds[key] for key in keys if key in folds)
        return Study(plan.campaign, replace(way, approaches=config.approaches), known, seconds, repeatability=repeats)

    first, *others = [study(way) for way in plan.configs]
    return replace(first, config=config, speed_groups=others[0] if others and others[0].folds else None)


def fold_key(campaign: Campaign, config: StudyConfig, test_id: str) -> Hashable:
    """Key of all that determines the fold of a test; the config is one of ``split_configs``."""
    settings = replace(config, leave_out="test", to_ttzv=False, also=())  # both of tables alone
    return campaign.fingerprint, settings, config.left_out(campaign, test_id), test_id
