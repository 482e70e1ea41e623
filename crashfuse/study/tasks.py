"""Tasks of a study: tests to predict from the same others, computed by any worker.

What needs no trained network comes first, and is computed while the networks train.
"""

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial

from crashfuse.approaches.fit_cache import FITS
from crashfuse.approaches.registry import APPROACHES, CLASSES
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.execution.memory import give_back
from crashfuse.execution.one_thread import one_thread_throughout
from crashfuse.execution.progress import Watch
from crashfuse.execution.workers import Workers
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit, estimates_at
from crashfuse.study.estimate_cache import find_estimate, store_estimate
from crashfuse.study.repeatability import repeatability

_EARLY, _LATE = "Held-out predictions", "Held-out predictions by networks"


@dataclass(frozen=True, slots=True)
class Wanted:
    """One prediction of a study: of a test, by an approach that learned from all tests but those left out.

    A speed group of one test is the same as that test left out alone, so it is predicted once.
    """

    left_out: tuple[str, ...]
    test: str
    approach: str


Estimates = dict[Wanted, Estimate]


@dataclass(frozen=True, slots=True)
class Task:
    """Predictions that share their fits; without any, the repeatability of tests."""

    wanted: tuple[Wanted, ...] = ()
    repeated: tuple[str, ...] = ()


def prepare(campaign: Campaign, approaches: Set[str], config: StudyConfig, cache: Cache, watch: Watch) -> Cache:
    """Compute once, on all cores, what no test's pulse affects; returns a new Cache on that folder."""
    cae_only = campaign.without(campaign.test_ids)
    conditions = [test.condition for test in campaign.tests]
    shared = Cache(cache.folder)
    for name in sorted(approaches):
        config.create(name, shared).prepare(cae_only, conditions, watch)
    give_back()
    return shared


def found_in(cache: Cache, campaign: Campaign, wanted: Sequence[Wanted], config: StudyConfig) -> Estimates:
    """Those of these estimates that are in the cache."""
    found = {}
    training = {left_out: campaign.without(left_out) for left_out in {each.left_out for each in wanted}}
    for each in wanted:
        condition = campaign.test(each.test).condition
        estimate = find_estimate(training[each.left_out], condition, each.approach, config, cache)
        if estimate is not None:
            found[each] = estimate
    return found


@dataclass(frozen=True, eq=False)
class Computation:
    """Computes the estimates of a study that are not in the cache.

    Parameters
    ----------
    known : dict of Wanted to Estimate
        What is known already; new estimates are added.
    on_more : callable
        Called each time that more is known.

    Attributes
    ----------
    seconds : dict of str to float
        Duration of the training, and of all.
    """

    campaign: Campaign
    config: StudyConfig
    cache: Cache
    watch: Watch
    workers: Workers
    known: Estimates
    on_more: Callable[[], None]
    seconds: dict[str, float] = field(default_factory=dict)

    def run(self, wanted: Sequence[Wanted], repeated: tuple[str, ...]) -> None:
        """Compute these; and the repeatability of these tests, where workers have time for it."""
        start = time.perf_counter()
        missing = [each for each in wanted if each not in self.known]
        late = [each for each in missing if CLASSES[each.approach].trains_networks]
        early = [each for each in missing if not CLASSES[each.approach].trains_networks]
        tasks = _tasks(early)
        shared = self._prepared(missing, trained=False)
        elsewhere = self.workers.are_elsewhere(tasks)
        if elsewhere:  # what is not known of repeatability in the end is computed there
            tasks.append(Task(repeated=repeated))
        if elsewhere and late:
            trained = self._train_beside(tasks, late, shared, early)
            self._compute(_tasks(late), trained, _LATE, late)
        else:  # here, one after the other: what can be shown first is not delayed by training
            self._compute(tasks, shared, _EARLY, early)
            if late:
                self._compute(_tasks(late), self._prepared(late), _LATE, late)
        self.seconds["held_out_tests"] = time.perf_counter() - start

    def _train_beside(
        self, tasks: Sequence[Task], late: Sequence[Wanted], shared: Cache, early: Sequence[Wanted]
    ) -> Cache:
        """Train the networks in a thread of this process, while the workers compute what needs none."""
        stop = threading.Event()
        with ThreadPoolExecutor(1, "training") as thread:
            try:
                training = thread.submit(self._prepared, late, watch=self.watch.also_cancelled_by(stop))
                self._compute(tasks, shared, _EARLY, early)
                trained = training.result()
            finally:
                stop.set()
        trained.used |= {name for name in shared.used if name.startswith(FITS)}  # mixtures are made of them
        return trained

    def _prepared(self, wanted: Sequence[Wanted], *, trained: bool = True, watch: Watch | None = None) -> Cache:
        start = time.perf_counter()
        names = {each.approach for each in wanted if trained or not CLASSES[each.approach].trains_networks}
        shared = prepare(self.campaign, names, self.config, self.cache, watch or self.watch)
        self.seconds["prepare"] = time.perf_counter() - start
        return shared

    def _compute(self, tasks: Sequence[Task], shared: Cache, step: str, wanted: Sequence[Wanted]) -> None:
        """Compute tasks; progress is that of fits, which take the time however many tests each of them predicts."""
        work, fits = partial(_computed, config=self.config.on_this_device), _fits(wanted)
        with closing(self.workers.completed(work, self.campaign, tasks, shared, self.watch)) as completed:
            for estimates in completed:
                self.known.update(estimates)
                if fits:
                    left = _fits([each for each in wanted if each not in self.known])
                    self.watch.report(step, len(fits - left), len(fits))
                if estimates:
                    self.on_more()


def _fits(wanted: Sequence[Wanted]) -> set[tuple[tuple[str, ...], str]]:
    """The fits behind predictions: what was left out, and the approach."""
    return {(each.left_out, each.approach) for each in wanted}


def _tasks(wanted: Sequence[Wanted]) -> list[Task]:
    """One task for each set of tests left out."""
    by_left_out = defaultdict[tuple[str, ...], list[Wanted]](list)
    for each in wanted:
        by_left_out[each.left_out].append(each)
    return [Task(tuple(own)) for own in by_left_out.values()]


def _computed(
    campaign: Campaign, task: Task, cache: Cache, watch: Watch, *, config: StudyConfig
) -> list[tuple[Wanted, Estimate]]:
    """Compute a task; what it finds is in the cache, too."""
    if task.repeated:
        repeatability(campaign, config.windows_ms, task.repeated, seed=config.seed, cache=cache, watch=watch)
        return []
    training = campaign.without(task.wanted[0].left_out)
    estimates: list[tuple[Wanted, Estimate]] = []
    with one_thread_throughout():
        # mixtures come last, so that they find the fits of the others in the cache
        names = sorted({each.approach for each in task.wanted}, key=APPROACHES.index)
        fits = {name: Fit.of(training, name, config, cache=cache, watch=watch) for name in names}
        for test in dict.fromkeys(each.test for each in task.wanted):
            wanted = [each for each in task.wanted if each.test == test]
            found = estimates_at([fits[each.approach] for each in wanted], campaign.test(test).condition)
            for estimate in found:
                store_estimate(estimate, training, config, cache)
            estimates += zip(wanted, found, strict=True)
    return estimates
