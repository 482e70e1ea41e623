"""Certification of a campaign: a verdict for every condition and criterion, and the record of left-out tests."""

import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, cast

from threadpoolctl import threadpool_limits

from crashfuse.approaches.fit_cache import settings
from crashfuse.approaches.fused.approach import Fused
from crashfuse.approaches.registry import BASELINE
from crashfuse.approaches.settings import Device
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria
from crashfuse.certification.domain import Domain
from crashfuse.certification.forecast import Forecast, Forecaster, quantity
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import LeftOut, TrackRecord, Trial
from crashfuse.certification.verdict import Verdict, judge
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.code_digest import code_digest
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.workers import Workers
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.plan import check_window
from crashfuse.study.study import prepare, workers_at

APPROACH = Fused.name
"""The approach whose predictions are judged if no other is asked for."""

_KIND = "forecasts"  # kind of cache entry
_CHUNK = 10  # conditions predicted by one task: each task has to restore the fit


@dataclass(frozen=True, eq=False)
class Certification:
    """Verdicts on a matrix of conditions.

    Attributes
    ----------
    config : StudyConfig
        With the approach whose predictions were judged as its only one.
    verdicts : tuple of tuple of Verdict
        By condition of the matrix, then by criterion.
    record : TrackRecord
        Empty for a campaign of a single test.
    seconds : dict of str to float
        Time taken to learn, leaving tests out included, and to judge the matrix.
    """

    campaign: Campaign
    criteria: Criteria
    matrix: Matrix
    config: StudyConfig
    domain: Domain
    verdicts: tuple[tuple[Verdict, ...], ...]
    record: TrackRecord
    seconds: dict[str, float]

    @property
    def approach(self) -> str:
        """Name of the approach."""
        return self.config.approaches[0]

    @property
    def cells(self) -> tuple[tuple[str, Verdict], ...]:
        """All verdicts, each with the id of its condition."""
        return tuple((i, own) for i, row in zip(self.matrix.ids, self.verdicts, strict=True) for own in row)


class _Asked(NamedTuple):
    """A forecast: by an approach that learned from all tests but some, at a condition."""

    held_out: tuple[str, ...]
    approach: str
    condition: Condition


def certify_matrix(
    campaign: Campaign,
    criteria: Criteria,
    matrix: Matrix,
    config: StudyConfig = StudyConfig(approaches=(APPROACH,)),
    *,
    cache: Cache | None = None,
    watch: Watch = SILENT,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Certification:
    """Judge every criterion at every condition of a matrix, and keep the record of the tests, left out in turn.

    Parameters
    ----------
    config : StudyConfig
        Its first approach is judged, with its preset, seed and device.
    cache : Cache, optional
        Forecasts are read from it and stored in it; other limits then take no time.
    workers, scheduler
        As in :func:`crashfuse.study.study.run_study`.

    Raises
    ------
    UsageError
        If the campaign has no test, or a criterion cannot be judged at any condition.
    DataError
        If a test's record is shorter than the window of a rating.
    Cancelled
        If the watch was told to stop.
    """
    if not campaign.tests:
        raise UsageError("A verdict takes a test at least; this campaign has none.")
    config = replace(config, approaches=config.approaches[:1])
    config.check()
    for window in criteria.windows_ms:
        for test in campaign.tests:
            check_window(test, window)
    [approach] = config.approaches
    left_out = _left_out(campaign)
    trials, cells = _asked(campaign, matrix, approach)
    ask = _Asker(campaign, criteria.windows_ms, config, cache or Cache(), watch)
    with workers_at(scheduler, workers) as place:
        start = time.perf_counter()
        forecasts = ask.all(trials, place, "Left-out tests", learn_for=cells)
        learned = time.perf_counter()
        forecasts |= ask.all(cells, place, "Conditions of the matrix")
        seconds = {"learn": learned - start, "judge": time.perf_counter() - learned}
    record = _record(campaign, criteria, left_out, approach, forecasts)
    domain = Domain.of(campaign)
    verdicts = [
        judge(forecasts[cell], cell.condition, criteria, domain.too_few_tests or domain.exceeded_by(cell.condition))
        for cell in cells
    ]
    for column, criterion in enumerate(criteria.items):
        if not domain.too_few_tests and all(row[column].probability is None for row in verdicts):
            raise UsageError(
                f"The criterion {criterion.name} cannot be judged: at every condition the record is too short for the "
                f"{criterion.label}; remove the criterion, or take other conditions."
            )
    supported = tuple(tuple(_supported(own, record, criteria.confidence) for own in row) for row in verdicts)
    return Certification(campaign, criteria, matrix, config, domain, supported, record, seconds)


def is_computed(campaign: Campaign, criteria: Criteria, matrix: Matrix, config: StudyConfig, cache: Cache) -> bool:
    """Whether the cache has every forecast that a certification takes, so that it takes no time."""
    config = replace(config, approaches=config.approaches[:1])
    ask = _Asker(campaign, criteria.windows_ms, config, cache, SILENT)
    trials, cells = _asked(campaign, matrix, config.approaches[0])
    return all(ask.find(each) is not None for each in (*cells, *trials))


def _asked(campaign: Campaign, matrix: Matrix, approach: str) -> tuple[list[_Asked], list[_Asked]]:
    """Forecasts of left-out tests, by the raw CAE as well, and of the conditions of a matrix."""
    names = dict.fromkeys((approach, BASELINE))
    trials = [
        _Asked(held_out, name, campaign.test(test_id).condition)
        for test_id, _, held_out in _left_out(campaign)
        for name in names
    ]
    return trials, [_Asked((), approach, condition) for condition in matrix.conditions]


def _left_out(campaign: Campaign) -> list[tuple[str, LeftOut, tuple[str, ...]]]:
    """Each test with what is left out with it: nothing else, or its speed group if other tests remain."""
    if len(campaign.tests) < 2:
        return []
    groups = [(test, campaign.speed_group(test)) for test in campaign.test_ids]
    return [
        *((test, "test", (test,)) for test in campaign.test_ids),
        *((test, "speed group", group) for test, group in groups if len(group) < len(campaign.tests)),
    ]


def _record(
    campaign: Campaign,
    criteria: Criteria,
    left_out: Sequence[tuple[str, LeftOut, tuple[str, ...]]],
    approach: str,
    forecasts: dict[_Asked, Forecast],
) -> TrackRecord:
    """Compare the verdicts on left-out tests, each from the others alone, with what was measured."""
    trials = []
    for test_id, way, held_out in left_out:
        test, domain = campaign.test(test_id), Domain.of(campaign.without(held_out))
        own, cae = (forecasts[_Asked(held_out, name, test.condition)] for name in (approach, BASELINE))
        for verdict in judge(own, test.condition, criteria, domain.exceeded_by(test.condition)):
            criterion = verdict.criterion
            measured = own.measured(criterion, test)
            baseline = cae.distributions[quantity(criterion)] if criterion.window_ms is None else None
            raw = None if baseline is None else baseline.probability(criterion.at_least, criterion.at_most)
            if measured is not None:
                trials.append(Trial(test_id, way, verdict, measured, raw))
    return TrackRecord(tuple(trials))


def _supported(verdict: Verdict, record: TrackRecord, confidence: float) -> Verdict:
    """The verdict, open if the record does not support the confidence, with what the record says of the limit."""
    support = record.support(verdict.criterion)
    if verdict.decided and (shortfall := support.shortfall(confidence)) is not None:
        return replace(verdict, word="open", reason=f"{verdict.reason} {shortfall}")
    if verdict.decided and not support.near:
        far = "No left-out test came near this limit: the record says nothing about it."
        return replace(verdict, reason=f"{verdict.reason} {far}")
    return verdict


@dataclass(frozen=True, eq=False)
class _Asker:
    """Computes forecasts, or finds them in the cache."""

    campaign: Campaign
    windows_ms: tuple[float, ...]
    config: StudyConfig
    cache: Cache
    watch: Watch

    def all(
        self, asked: Sequence[_Asked], workers: Workers, step: str, learn_for: Sequence[_Asked] = ()
    ) -> dict[_Asked, Forecast]:
        """All forecasts asked for, and one of ``learn_for``, so that the fit to all tests is made beside the others."""
        found = {each: own for each in asked if (own := self.find(each)) is not None}
        missing = [each for each in dict.fromkeys(asked) if each not in found]
        tasks: dict[tuple[str, ...], list[_Asked]] = {}
        for each in missing:
            tasks.setdefault(each.held_out, []).append(each)
        chunks = [own[i : i + _CHUNK] for own in tasks.values() for i in range(0, len(own), _CHUNK)]
        chunks[:0] = [[each] for each in learn_for if self.find(each) is None][:1]
        shared = prepare(self.campaign, {each.approach for each in missing}, self.config, self.cache, self.watch)
        names = {each.approach for own in chunks for each in own}
        devices = [device for name in sorted(names) if (device := self.config.create(name).device)]
        config = replace(self.config, device=cast(Device, (devices or [self.config.device])[0]))
        work = partial(_forecast, config=config, windows_ms=self.windows_ms)
        done, total = len(found), len(found) + len(missing)
        self.watch.report(step, done, total)
        with closing(workers.completed(work, self.campaign, chunks, shared, self.watch)) as completed:
            for some in completed:
                found |= dict(some)
                self.watch.report(step, min(len(found), total), total)
        return found

    def find(self, asked: _Asked) -> Forecast | None:
        """The forecast in the cache, if there is one."""
        training = self.campaign.without(asked.held_out)
        return self.cache.find(_KIND, _key(training, asked, self.config, self.windows_ms), Forecast.restored)


def _forecast(
    campaign: Campaign,
    asked: list[_Asked],
    cache: Cache,
    watch: Watch,
    *,
    config: StudyConfig,
    windows_ms: tuple[float, ...],
) -> list[tuple[_Asked, Forecast]]:
    """Forecasts by approaches that learned from the same tests."""
    training, made = campaign.without(asked[0].held_out), []
    with threadpool_limits(1):  # contended BLAS threads multiply CPU time and change the numbers
        for name in dict.fromkeys(each.approach for each in asked):
            fit = Fit.of(training, name, config, cache=cache, watch=watch)
            forecaster = Forecaster.of(fit, training, windows_ms, cache)
            for each in asked:
                if each.approach == name:
                    forecast = forecaster.at(each.condition)
                    cache.put(_KIND, _key(training, each, config, windows_ms), forecast.entry)
                    made.append((each, forecast))
    return made


def _key(training: Campaign, asked: _Asked, config: StudyConfig, windows_ms: tuple[float, ...]) -> dict[str, object]:
    fit = settings(config.create(asked.approach))
    own = {"campaign": training.fingerprint, "condition": asked.condition, "windows_ms": windows_ms}
    return {**fit, **own, "code": code_digest(__name__)}
