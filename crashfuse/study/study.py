"""Leave-one-out studies: from a campaign to rated predictions.

hold out → fit → predict → rate. The held-out test's pulse is used in the last step only, and after it for how well
tests repeat: everything before works on ``campaign.without(test)``, whose fingerprint is also the key under which the
prediction is cached.
"""

from collections import defaultdict
from collections.abc import Hashable, Mapping, MutableMapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from crashfuse.approaches.calibration import Calibration, Coverage, shares_inside
from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError, several
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.workers import Local, Workers
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.fold import Fold
from crashfuse.study.plan import StudyPlan
from crashfuse.study.repeatability import Repeatability, repeatability
from crashfuse.study.tasks import Computation, Wanted, found_in

if TYPE_CHECKING:
    from typing import Unpack

    import pandas as pd
    import plotly.graph_objects as go

    from crashfuse.campaign_folder.notes import Note
    from crashfuse.reporting.figures import Further
    from crashfuse.reporting.plots.display import DisplayOptions


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
        """The fold with this test held out.

        Raises
        ------
        UsageError
            If there is none.
        """
        for fold in self.folds:
            if fold.held_out == held_out:
                return fold
        known = ", ".join(fold.held_out for fold in self.folds)
        raise UsageError(f"Test {held_out!r} was not left out in this study; left out were {known}.")

    @property
    def scores(self) -> "pd.DataFrame":
        """Ratings, one row a held-out test, approach and window, as ``scores.csv``."""
        from crashfuse.reporting.result_tables import scores_table

        return scores_table(self)

    @property
    def pulses(self) -> "pd.DataFrame":
        """Predicted pulses with their bands, as ``pulses.csv``."""
        from crashfuse.reporting.result_tables import study_pulses

        return study_pulses(self)

    @property
    def metrics(self) -> "pd.DataFrame":
        """Pulse metrics of the tests and their predictions, as ``metrics.csv``."""
        from crashfuse.reporting.result_tables import study_metrics

        return study_metrics(self)

    @property
    def repeat_scores(self) -> "pd.DataFrame":
        """What a repeat of each held-out test would rate, one row a test and window, as in ``study.json``."""
        from crashfuse.reporting.result_tables import repeat_scores

        return repeat_scores(self)

    def plot(
        self,
        held_out: str = "",
        figure: str = "",
        *,
        approaches: Sequence[str] | None = None,
        also: "Sequence[Further]" = (),
        band: str | None = None,
        measured: bool = True,
        corridors: bool = False,
        notes: "Sequence[Note]" = (),
        **display: "Unpack[DisplayOptions]",
    ) -> "go.Figure":
        """A figure of the page Compare, of one held-out test, or of the page Study, of all of them.

        Parameters
        ----------
        held_out : str
            Id of the test; empty for a figure of all.
        figure : str
            Of a test: ``motion`` (the default), ``acceleration``, ``residuals``, ``displacement``, ``energy``,
            ``integration``, ``bias parts``, ``scores``, ``rating``, ``training``, ``fine-tuning``. Of all: ``ratings``
            (the default), ``draws``, ``calibration``.
        approaches : sequence of str, optional
            The approaches that are shown; by default all. Of several, ``rating`` and the figures of networks show the
            preferred one.
        also : sequence of str or PredictedPulse
            Pulses put beside those of a test: tests and CAE runs by their ids, and predictions elsewhere.
        band : str, optional
            The approach whose band is filled; by default the preferred one.
        measured : bool
            Whether to show the test itself.
        corridors : bool
            Whether to shade the corridors of the rating about the test.
        notes : sequence of Note
            Drawn as marks over time, those that are about this test.
        **display
            ``window_ms``, by default the longest, ``unit``, ``deceleration``, ``units``, see
            :class:`crashfuse.reporting.plots.display.DisplayOptions`.

        Raises
        ------
        UsageError
            If the test was not held out; if there is no such figure, approach, test, CAE run, option or unit; or if the
            study was not rated over this window.
        """
        from crashfuse.reporting.study_figures import figure_of_test, overview

        if not held_out:
            return overview(self, figure or "ratings", approaches, **display)
        return figure_of_test(
            self, held_out, figure or "motion", approaches,
            also=also, band=band, measured=measured, corridors=corridors, notes=notes, **display,
        )  # fmt: skip

    def __repr__(self) -> str:
        window = self.config.windows_ms[-1]
        means = ", ".join(f"{name} {self.mean_rating(name, window):.3f}" for name in self.config.approaches)
        tests = self.folds[0].held_out if len(self.folds) == 1 else f"{len(self.folds)} tests"
        return f"<Study of {self.campaign.name!r}, {tests} left out: {means} (0–{window:g} ms)>"

    def _repr_html_(self) -> str:
        from crashfuse.reporting.notebook import study_html

        return study_html(self)

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
    if scheduler is None:
        return nullcontext(Local(processes))
    from crashfuse.execution.cluster import connected  # import takes 1 s and needs an optional extra

    return connected(scheduler)
