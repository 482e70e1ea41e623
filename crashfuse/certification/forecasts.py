"""Forecasts of many conditions by approaches that learned from parts of the tests: computed side by side, and kept."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from crashfuse.approaches.fit_cache import settings
from crashfuse.campaign import Campaign
from crashfuse.certification.forecast import Forecast, Forecaster
from crashfuse.condition import Condition
from crashfuse.execution.cache import Cache
from crashfuse.execution.code_digest import code_digest
from crashfuse.execution.one_thread import one_thread_throughout
from crashfuse.execution.progress import Watch
from crashfuse.execution.workers import Workers
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.tasks import prepare

_KIND = "forecasts"  # kind of cache entry
_CHUNK = 10  # conditions predicted by one task: each task has to restore the fit


class Asked(NamedTuple):
    """A forecast: by an approach that learned from all tests but some, at a condition."""

    held_out: tuple[str, ...]
    approach: str
    condition: Condition


@dataclass(frozen=True, eq=False)
class Forecasts:
    """Computes forecasts, or finds them in the cache."""

    campaign: Campaign
    windows_ms: tuple[float, ...]
    config: StudyConfig
    cache: Cache
    watch: Watch

    def all(
        self, asked: Sequence[Asked], workers: Workers, step: str, learn_for: Sequence[Asked] = ()
    ) -> dict[Asked, Forecast]:
        """All forecasts asked for, and one of ``learn_for``, so that the fit to all tests is made beside the others."""
        found = {each: own for each in asked if (own := self.find(each)) is not None}
        missing = [each for each in dict.fromkeys(asked) if each not in found]
        tasks: dict[tuple[str, ...], list[Asked]] = {}
        for each in missing:
            tasks.setdefault(each.held_out, []).append(each)
        chunks = [own[i : i + _CHUNK] for own in tasks.values() for i in range(0, len(own), _CHUNK)]
        chunks[:0] = [[each] for each in learn_for if self.find(each) is None][:1]
        shared = prepare(self.campaign, {each.approach for each in missing}, self.config, self.cache, self.watch)
        work = partial(_forecast, config=self.config.on_this_device, windows_ms=self.windows_ms)
        done, total = len(found), len(found) + len(missing)
        self.watch.report(step, done, total)
        with closing(workers.completed(work, self.campaign, chunks, shared, self.watch)) as completed:
            for some in completed:
                found |= dict(some)
                self.watch.report(step, min(len(found), total), total)
        return found

    def find(self, asked: Asked) -> Forecast | None:
        """The forecast in the cache, if there is one."""
        training = self.campaign.without(asked.held_out)
        return self.cache.find(_KIND, _key(training, asked, self.config, self.windows_ms), Forecast.restored)


def _forecast(
    campaign: Campaign,
    asked: list[Asked],
    cache: Cache,
    watch: Watch,
    *,
    config: StudyConfig,
    windows_ms: tuple[float, ...],
) -> list[tuple[Asked, Forecast]]:
    """Forecasts by approaches that learned from the same tests."""
    training, made = campaign.without(asked[0].held_out), []
    with one_thread_throughout():
        for name in dict.fromkeys(each.approach for each in asked):
            fit = Fit.of(training, name, config, cache=cache, watch=watch)
            forecaster = Forecaster.of(fit, training, windows_ms)
            for each in asked:
                if each.approach == name:
                    forecast = forecaster.at(each.condition)
                    cache.put(_KIND, _key(training, each, config, windows_ms), forecast.entry)
                    made.append((each, forecast))
    return made


def _key(training: Campaign, asked: Asked, config: StudyConfig, windows_ms: tuple[float, ...]) -> dict[str, object]:
    fit = settings(config.create(asked.approach))
    own = {"campaign": training.fingerprint, "condition": asked.condition, "windows_ms": windows_ms}
    return {**fit, **own, "code": code_digest(__name__)}
