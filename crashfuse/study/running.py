"""Running a leave-one-out study: from a campaign to rated predictions.

hold out → fit → predict → rate. The held-out test's pulse is used in the last step only, and after it for how well
tests repeat: everything before works on ``campaign.without(test)``, whose fingerprint is also the key under which the
prediction is cached.
"""

from collections.abc import Hashable, Mapping, MutableMapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from numbers import Integral

from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError, printable, several
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.workers import Local, Workers
from crashfuse.study.config import StudyConfig
from crashfuse.study.fold import Fold
from crashfuse.study.plan import StudyPlan
from crashfuse.study.repeatability import Repeatability, repeatability
from crashfuse.study.study import Study
from crashfuse.study.tasks import Computation, Wanted, found_in


def run_study(
    campaign: Campaign,
    config: StudyConfig = StudyConfig(),
    *,
    held_out: Sequence[str] = (),
    approaches: Sequence[str] = (),
    cache: Cache | None = None,
    watch: Watch = SILENT,
    workers: int | None = None,
    scheduler: str | None = None,
    folds: MutableMapping[Hashable, Fold] | None = None,
) -> Study:
    """Leave out each test in turn, predict it with every approach from all the others, and rate the predictions.

    Parameters
    ----------
    held_out : sequence of str, or str
        Ids of the tests to leave out in turn; empty for all.
    approaches : sequence of str, or str
        Names of the approaches; empty for those of the config.
    cache : Cache, optional
        Finished predictions are read from it and stored in it, so an interrupted study continues where it stopped.
    watch : Watch, optional
        It is shown a study of what is known each time that more is: of the tests predicted so far, by the approaches
        that are known for all of them, or for some (see ``Fold.ratings``). What needs no network comes first.
        Repeatability is not known then.
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
    if approaches:
        config = replace(config, approaches=several(approaches))
    plan = StudyPlan(campaign, config, several(held_out))
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
    campaign, config, cache = plan.campaign, plan.config, cache or Cache()
    by_fold = {
        fold_key(campaign, way, test): [Wanted(way.left_out(campaign, test), test, name) for name in config.approaches]
        for way in plan.configs
        for test in plan.held_out
    }
    finished = {key: fold for key in by_fold if (fold := (folds or {}).get(key)) is not None}
    wanted = [each for key, own in by_fold.items() if key not in finished for each in own]
    known = found_in(cache, campaign, wanted, config)

    rated: dict[tuple[Wanted, ...], Fold] = {}

    def known_of(key: Hashable) -> Fold | None:
        """What is known of a fold, rated; None if nothing is."""
        own = tuple(each for each in by_fold[key] if each in known)
        if key not in finished and own and own not in rated:
            rated[own] = Fold.of(campaign.test(own[0].test), [known[each] for each in own], config.windows_ms)
        return finished.get(key) or rated.get(own)

    def show_part() -> None:
        some = {key: own for key in by_fold if (own := known_of(key)) is not None} if watch.wants_parts else {}
        names = tuple(name for name in config.approaches if all(name in own.ratings for own in some.values()))
        if names and any(fold_key(campaign, plan.configs[0], test) in some for test in plan.held_out):
            watch.show_part(_joined(plan, replace(config, approaches=names), some, {}, {}))

    with workers_at(scheduler, workers) as place:
        computation = Computation(campaign, config, cache, watch, place, known, show_part)
        computation.run(wanted, plan.held_out)
    finished |= {key: own for key in by_fold if key not in finished and (own := known_of(key)) is not None}
    if folds is not None:
        folds.update(finished)
    repeats = repeatability(campaign, config.windows_ms, plan.held_out, seed=config.seed, cache=cache, watch=watch)
    return _joined(plan, config, finished, computation.seconds, repeats)


def _joined(
    plan: StudyPlan,
    config: StudyConfig,
    folds: Mapping[Hashable, Fold],
    seconds: dict[str, float],
    repeats: Mapping[str, Mapping[float, Repeatability]],
) -> Study:
    """The study of these folds with these approaches, that of speed groups within it if there is one."""

    def study(way: StudyConfig) -> Study:
        keys = [fold_key(plan.campaign, way, test) for test in plan.held_out]
        known = tuple(folds[key] for key in keys if key in folds)
        config_of_way = replace(way, approaches=config.approaches)
        return Study(plan.campaign, config_of_way, known, seconds, repeatability=repeats)

    first, *others = [study(way) for way in plan.configs]
    return replace(first, config=config, speed_groups=others[0] if others and others[0].folds else None)


def fold_key(campaign: Campaign, config: StudyConfig, test_id: str) -> Hashable:
    """Key of everything that determines the fold of a test; the config is one of ``split_configs``."""
    return campaign.fingerprint, replace(config, leave_out="test"), config.left_out(campaign, test_id), test_id


def workers_at(scheduler: str | None, processes: int | None) -> AbstractContextManager[Workers]:
    """Workers of a Dask cluster if a scheduler is given, else processes on this machine."""
    if processes is not None and not (isinstance(processes, Integral) and processes >= 1):
        raise UsageError(f"The number of workers is 1 or more, not {printable(repr(processes), 20)}.")
    if scheduler is None:
        return nullcontext(Local(processes))
    from crashfuse.execution.cluster import connected  # import takes 1 s and needs an optional extra

    return connected(scheduler)
