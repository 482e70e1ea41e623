"""What has been computed on this server, and how to have it computed: the jobs behind the pages."""

import threading
from collections.abc import Hashable
from dataclasses import dataclass

import streamlit as st

from crashfuse.approaches import APPROACHES
from crashfuse.cache import Cache
from crashfuse.campaign import Campaign
from crashfuse.config import StudyConfig
from crashfuse.estimate import Estimate, Fit, find_estimate
from crashfuse.progress import Watch
from crashfuse.pulse import Condition
from crashfuse.study import Study, run_study
from crashfuse.ui.jobs import Job, Jobs


@st.cache_resource(show_spinner=False)
def jobs() -> Jobs:
    """The server's one queue of jobs."""
    return Jobs()


_PATIENCE_S = 3.0  # for what is in the cache; if it takes longer, its progress is shown


class _Lookups:
    """Searches of the cache on disk: one at a time, each key again only when a job has ended since."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.ended_before: dict[Hashable, int] = {}


@st.cache_resource(show_spinner=False)
def _lookups() -> _Lookups:
    return _Lookups()


def chosen_config() -> StudyConfig:
    """The settings made on the page Train, or the defaults where nobody has been there."""
    state = st.session_state
    return StudyConfig(
        approaches=tuple(name for name in APPROACHES if name in state.get("approaches", APPROACHES)),
        preset=state.get("preset", "fast"),
        seed=int(state.get("seed", 0)),
    )


@dataclass(frozen=True)
class StudyRequest:
    """Which tests of a campaign to leave out in turn, and how; names one job, whoever asks for it."""

    campaign: Campaign
    held_out: tuple[str, ...]
    config: StudyConfig

    @property
    def key(self) -> Hashable:
        """Equal for equal data and settings, wherever the files lie."""
        return "study", self.campaign.fingerprint, self.held_out, self.config

    @property
    def title(self) -> str:
        """What the user calls it."""
        tests = f"test {self.held_out[0]}" if len(self.held_out) == 1 else f"each of {len(self.held_out)} tests in turn"
        return f"{self.campaign.name}: predict {tests} from the others"

    def start(self) -> None:
        """Queue it, or join whoever had it queued before."""
        jobs().start(self.key, self.title, self._work)

    def find(self) -> Job[Study] | None:
        """The job, if there was one; what an earlier run left in the cache on disk is fetched from there."""
        if (job := jobs().get(self.key)) is not None:
            return job
        with _lookups().lock:  # who comes second waits for the answer
            if _lookups().ended_before.get(self.key) == jobs().ended:
                return jobs().get(self.key)
            with st.spinner("Looking for earlier results …"):
                if self._in_cache():
                    job = jobs().start_at_once(self.key, self.title, self._work)
                    job.wait(_PATIENCE_S)
            _lookups().ended_before[self.key] = jobs().ended
        return job

    def _work(self, watch: Watch) -> Study:
        return run_study(self.campaign, self.config, held_out=self.held_out, watch=watch)

    def _in_cache(self) -> bool:
        cache = Cache()
        return all(
            find_estimate(
                self.config.rest(self.campaign, test_id),
                self.campaign.test(test_id).condition,
                name,
                self.config,
                cache=cache,
            )
            is not None
            for test_id in self.held_out
            for name in reversed(self.config.approaches)
        )


@dataclass(frozen=True, eq=False)
class Fitted:
    """Approaches that have learned from all tests of a campaign and answer any condition at once."""

    fits: tuple[Fit, ...]

    def estimates(self, condition: Condition) -> list[Estimate]:
        """What each of them expects at a condition."""
        return [fit.estimate(condition) for fit in self.fits]


@dataclass(frozen=True)
class FitRequest:
    """Fit every approach on all tests of a campaign."""

    campaign: Campaign
    config: StudyConfig

    @property
    def key(self) -> Hashable:
        """Equal for equal data and settings."""
        return "fit", self.campaign.fingerprint, self.config

    def start(self) -> None:
        """Queue it, or join whoever had it queued before."""
        title = f"{self.campaign.name}: learn from all {len(self.campaign.tests)} tests"
        jobs().start(self.key, title, self._work)

    def find(self) -> Job[Fitted] | None:
        """The job, if there was one."""
        return jobs().get(self.key)

    def _work(self, watch: Watch) -> Fitted:
        names = self.config.approaches
        return Fitted(tuple(Fit.of(self.campaign, name, self.config, watch=watch) for name in names))
