"""Jobs behind the pages: what this server has computed, and how a page requests a computation."""

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar
from weakref import WeakValueDictionary

import numpy as np
import streamlit as st

from crashfuse.approaches.displacement_domain.events import CaeEvents, cae_events
from crashfuse.approaches.registry import BASELINE, CLASSES
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import read_folder
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError
from crashfuse.execution.jobs import Job, Jobs
from crashfuse.execution.progress import Watch
from crashfuse.execution.run import Run
from crashfuse.files.archive import zipped
from crashfuse.results.figures import otherwise
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit, estimates_at, is_estimate_cached
from crashfuse.study.history import PastResult, keep
from crashfuse.study.learning_curve import LearningCurve, is_curve_cached, learning_curve
from crashfuse.study.planning import SpeedSweep, sweep_speed, usual_speeds
from crashfuse.study.recommendation import Recommendation, recommend_for
from crashfuse.study.running import fold_key, run_study
from crashfuse.study.saved_models import model_bytes, model_file
from crashfuse.study.study import Fold, Study
from crashfuse.ui.kit import address
from crashfuse.ui.kit.campaigns import data_stamp
from crashfuse.ui.kit.visitors import visitor
from crashfuse.vehicle_archive import VehicleArchive

T = TypeVar("T")
_PATIENCE_S = 3.0  # to read from the cache; after that, progress is shown
_NETWORK_S, _START_S, _FIT_S, _QUICK_FIT_S = 9.0, 3.0, 1.6, 0.4  # on two quiet cores: the sample's study 45 s
_SWEEP_S, _VEHICLE_S, _CURVE_S = 10.0, 45.0, 12.0  # of all speeds; of a vehicle; of a test


@st.cache_resource(show_spinner=False)
def jobs() -> Jobs:
    """The server's single job queue."""
    return Jobs()


@st.cache_resource(max_entries=200, show_spinner=False, hash_funcs={tuple: hash})
def _is_kept(key: Hashable, ended: int, _in_cache: Callable[[], bool]) -> bool:  # noqa: ARG001 - the look's own key
    with suppress(CrashfuseError):  # starting the job shows it
        return _in_cache()
    return False


@st.cache_resource(show_spinner=False)
def _folds() -> WeakValueDictionary[Hashable, Fold]:
    return WeakValueDictionary()


def said_of(campaign: Campaign) -> Hashable:
    """Equal for equal data and remarks on them."""
    return campaign.fingerprint, campaign.remarks, tuple(test.statements for test in campaign.tests)


@dataclass(frozen=True)
class Request(Generic[T]):
    """A computation that any page can request; identifies one job."""

    key: Hashable  # equal for equal data and equal result-relevant settings, wherever the files are
    title: str  # shown to the user
    work: Callable[[Watch], T]
    in_cache: Callable[[], bool] = lambda: False  # whether the slow part of the result is in the disk cache
    usual_s: Callable[[], float] = lambda: 0.0  # what it takes on two quiet cores; 0: not known

    @property
    def expected_s(self) -> float:
        """Seconds on two quiet cores; 0 if it cannot be computed, which starting it shows."""
        with suppress(CrashfuseError):
            return self.usual_s()
        return 0.0

    def start(self, page: str | None = None) -> None:
        """Queue the job, or join it; the visitor will look for the result on this page or another."""
        job = jobs().start(self.key, self.title, self.work, visitor(), usual_s=self.expected_s)
        job.places[visitor()] = address.here(page)

    def ask(self, page: str) -> None:
        """Start the job for the visitor, who then opens this page, unless its result is known from earlier."""
        if not _is_kept(self.key, jobs().ended, self.in_cache):
            self.start(page)

    def find(self) -> Job[T] | None:
        """The job, if any; it is started at once if its result is in the disk cache."""
        if (job := jobs().get(self.key)) is not None:
            return job
        with st.spinner("Looking for earlier results …"):
            if _is_kept(self.key, jobs().ended, self.in_cache):  # a look each time that another job has ended
                job = jobs().start(self.key, self.title, self.work, visitor(), at_once=True)
                job.wait(_PATIENCE_S)
        return job

    @property
    def result(self) -> T | None:
        """What it has come to, once it is ready."""
        job = self.find()
        return None if job is None else job.result


def study_request(campaign: Campaign, held_out: tuple[str, ...], config: StudyConfig) -> Request[Study]:
    """Leave tests of a campaign out in turn."""
    tests = f"test {held_out[0]}" if len(held_out) == 1 else f"each of {len(held_out)} tests in turn"

    def work(watch: Watch) -> Study:
        study = run_study(campaign, config, held_out=held_out, watch=watch, folds=_folds())
        keep(PastResult.of_study(study))
        return study

    def known() -> Iterator[bool]:
        return (_is_fold_known(campaign, way, test_id) for way in config.split_configs for test_id in held_out)

    return Request(
        ("study", said_of(campaign), held_out, config),
        f"{campaign.name}: predict {tests} from the others{_unlike_usual(config)}",
        work,
        lambda: all(known()),
        lambda: usual_s(campaign, config, sum(not is_known for is_known in known())),
    )


def usual_s(campaign: Campaign, config: StudyConfig, n_fits: int) -> float:
    """Seconds that fits to most tests of a campaign take on two quiet cores, less if its network is known."""
    if config.preset == "paper":
        return math.inf
    networks = [name for name in config.approaches if CLASSES[name].trains_networks]
    known = not networks
    with suppress(CrashfuseError):  # starting the job shows it
        known = known or config.create(networks[0]).is_cached(campaign)
    return (_START_S if known else _NETWORK_S) + n_fits * (_FIT_S if networks else _QUICK_FIT_S)


def _is_fold_known(campaign: Campaign, way: StudyConfig, test_id: str) -> bool:
    if fold_key(campaign, way, test_id) in _folds():
        return True
    training, condition = way.training_campaign(campaign, test_id), campaign.test(test_id).condition
    return all(is_estimate_cached(training, condition, name, way) for name in way.approaches)


def _unlike_usual(config: StudyConfig) -> str:
    difference = otherwise(replace(config, leave_out="test"), StudyConfig())
    return f", {difference}" if difference else ""


@dataclass(frozen=True, eq=False)
class Fitted:
    """Approaches fitted to all tests of a campaign."""

    fits: tuple[Fit, ...]
    key: Hashable  # of what they learned from, and of their settings

    @property
    def approaches(self) -> tuple[str, ...]:
        """Their names: while a job fits them, of those that are ready."""
        return tuple(fit.approach.name for fit in self.fits)

    def models(self, campaign: Campaign) -> bytes:
        """The fitted approaches as a zip; ``crashfuse predict --models`` takes the unpacked folder."""
        return zipped({model_file(fit.approach.name): model_bytes(fit, campaign) for fit in self.fits})


def fit_request(campaign: Campaign, config: StudyConfig) -> Request[Fitted]:
    """Fit approaches to all tests of a campaign."""
    names = config.approaches
    key = "fit", said_of(campaign), names, config.preset, config.seed, config.device

    def work(watch: Watch) -> Fitted:
        early_first = sorted(names, key=lambda name: CLASSES[name].trains_networks)
        fits: dict[str, Fit] = {}
        for name in early_first:
            fits[name] = Fit.of(campaign, name, config, Run(watch=watch))
            if set(fits) - {BASELINE}:  # the raw CAE model alone answers nothing
                watch.show_part(Fitted(tuple(fits[name] for name in names if name in fits), key))
        fitted = Fitted(tuple(fits[name] for name in names), key)
        at_no_test = np.median(campaign.cae.vectors, axis=0)  # where nothing is known from earlier
        estimates_at(fitted.fits, Condition.of_vector(at_no_test))  # computes what all later answers share
        return fitted

    return Request(
        key,
        f"{campaign.name}: fit on all {len(campaign.tests)} tests{_unlike_usual(config)}",
        work,
        lambda: all(config.create(name).is_cached(campaign) for name in names),
        lambda: usual_s(campaign, config, 1),
    )


@st.cache_resource(max_entries=12, show_spinner=False, hash_funcs={Fitted: lambda own: (own.key, own.approaches)})
def answers(condition: Condition, fitted: Fitted) -> list[Estimate]:
    """Each approach's estimate at a condition, cached because a page asks at every click."""
    return estimates_at(fitted.fits, condition)


@st.cache_resource(max_entries=50, show_spinner=False)
def advised(
    key: Hashable,  # noqa: ARG001
    condition: Condition,
    window_ms: float,
    _estimates: Sequence[Estimate],
    _campaign: Campaign,
) -> Recommendation:
    """Which approach to use at a condition, cached as :func:`answers` are."""
    return recommend_for(_estimates, _campaign, condition, window_ms)


def sweep_over_speed(campaign: Campaign, fitted: Fitted, condition: Condition) -> Request[SpeedSweep]:
    """Predict over impact speed with approaches fitted to a campaign."""

    def compute(watch: Watch) -> SpeedSweep:
        return sweep_speed(campaign, fitted.fits, condition, usual_speeds(campaign), watch)

    key = "sweep", fitted.key, replace(condition, speed_mps=1.0)
    return Request(key, f"{campaign.name}: predict over speed", compute, usual_s=lambda: _SWEEP_S)


def mending_request(campaign: Campaign, window_ms: float) -> Request[CaeEvents]:
    """Find what to mend in the CAE model: started at once, as it takes seconds."""
    key, title = ("what to mend", said_of(campaign), window_ms), f"{campaign.name}: what to mend in the CAE model"
    return Request(key, title, lambda _: cae_events(campaign, window_ms), lambda: True)


def learn_vehicles(folders: Sequence[Path], seed: int) -> Request[VehicleArchive]:
    """Learn an archive of past vehicles from campaigns, which are read once the job begins."""

    def compute(watch: Watch) -> VehicleArchive:
        from crashfuse.study.archive_learning import learn_archive  # with PyTorch

        return learn_archive([read_folder(folder) for folder in folders], seed=seed, watch=watch)

    key = "archive", frozenset((folder, data_stamp(folder)) for folder in folders), seed
    title, usually_s = f"Learn an archive of {len(folders)} past vehicles", _VEHICLE_S * len(folders)
    return Request(key, title, compute, usual_s=lambda: usually_s)


def learn_curve(campaign: Campaign, config: StudyConfig) -> Request[LearningCurve]:
    """Predict the tests of a campaign from fewer of the others."""
    return Request(
        ("learning curve", said_of(campaign), config),
        f"{campaign.name}: predict tests from fewer of the others",
        lambda watch: learning_curve(campaign, config, watch=watch),
        lambda: is_curve_cached(campaign, config),
        lambda: _CURVE_S * len(campaign.tests),
    )
