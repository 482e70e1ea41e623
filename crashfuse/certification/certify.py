"""Certification of a campaign: a verdict for every condition and criterion, and the record of left-out tests."""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

from crashfuse.approaches.mixture import AboutFused
from crashfuse.approaches.registry import BASELINE
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import WINDOW_MS, Criteria
from crashfuse.certification.domain import Domain
from crashfuse.certification.earlier import Earlier
from crashfuse.certification.evidence import held, left_out, record_of, run_at
from crashfuse.certification.forecasts import Asked, Forecasts
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.tested_since import TestedSince
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import (
    Verdict,
    Word,
    all_met,
    beside_removed_tests,
    judge,
    needs_no_test,
)
from crashfuse.errors import UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.study.config import StudyConfig, check_window
from crashfuse.study.running import workers_at

APPROACH = AboutFused.name
"""The approach whose predictions are judged if no other is asked for."""
Rows = tuple[tuple[Verdict, ...], ...]
_LEARN, _JUDGE = "Left-out tests", "Conditions of the matrix"  # steps


@dataclass(frozen=True, eq=False)
class Certification:
    """Verdicts on a matrix of conditions.

    Attributes
    ----------
    config : StudyConfig
        With the approach whose predictions were judged as its only one, the windows of the criteria, and both ways of
        leaving tests out.
    judged, verdicts : tuple of tuple of Verdict
        By condition of the matrix, then by criterion: as the prediction alone has them, and held against the record and
        against tests at the condition, open where these contradict.
    record : TrackRecord
        Empty for a campaign of a single test.
    seconds : dict of str to float
        Time taken to learn, leaving tests out included, and to judge the matrix.
    since : TestedSince or None
        An earlier certification, with what tests that were run after it say of it.
    """

    campaign: Campaign
    criteria: Criteria
    matrix: Matrix
    config: StudyConfig
    domain: Domain
    judged: Rows
    verdicts: Rows
    record: TrackRecord
    seconds: dict[str, float]
    since: TestedSince | None = None

    def __repr__(self) -> str:
        size = f"{len(self.criteria.items)} × {len(self.matrix.ids)} verdicts"
        return f"<Certification of {self.campaign.name!r}: {size} by {self.approach}>"

    @property
    def approach(self) -> str:
        """Name of the approach."""
        return self.config.approaches[0]

    def beside(self, earlier: Earlier) -> Self:
        """The same beside an earlier certification, whose verdicts on tests that were run since are part of the record.

        Raises
        ------
        DataError
            If the campaign has none of the tests that the earlier one learned from: it is another vehicle's.
        """
        earlier.require_of(self.campaign)
        since = TestedSince(earlier, self.campaign)
        record = replace(self.record, since=since.trials(self.criteria))
        rows = held(self.judged, self.campaign, self.matrix, self.criteria, record)
        gone = [since.gone_at(condition) for condition in self.matrix.conditions]
        verdicts = tuple(
            tuple(beside_removed_tests(own, tests) for own in row) for row, tests in zip(rows, gone, strict=True)
        )
        return replace(self, verdicts=verdicts, record=record, since=since)

    @property
    def run(self) -> dict[str, tuple[str, ...]]:
        """Ids of the tests that were made for a condition of the matrix, by its id; of conditions with any."""
        return {i: tuple(row[0].run) for i, row in self.rows.items() if row[0].run}

    @cached_property
    def rows(self) -> dict[str, tuple[Verdict, ...]]:
        """The verdicts of each condition, by its id."""
        return dict(zip(self.matrix.ids, self.verdicts, strict=True))

    @property
    def cells(self) -> tuple[tuple[str, Verdict], ...]:
        """All verdicts, each with the id of its condition."""
        return tuple((i, own) for i, row in self.rows.items() for own in row)

    def of_word(self, word: Word) -> dict[str, list[Verdict]]:
        """Verdicts of one kind, by the id of their condition."""
        found = {i: [verdict for verdict in row if verdict.word == word] for i, row in self.rows.items()}
        return {i: own for i, own in found.items() if own}

    @property
    def waived(self) -> dict[str, tuple[float, float]]:
        """Conditions that need not be run, by :func:`needs_no_test`, and were not; with :func:`all_met` of each."""
        return self._each_met(at_once=True)

    @property
    def uncertain(self) -> dict[str, tuple[float, float]]:
        """Conditions, not run, where each criterion is met, but all at once not with the confidence; as ``waived``."""
        return self._each_met(at_once=False)

    def _each_met(self, *, at_once: bool) -> dict[str, tuple[float, float]]:
        return {
            i: all_met(row)
            for i, row in self.rows.items()
            if all(own.word == "met" and not own.run for own in row)
            and needs_no_test(row, self.criteria.confidence) is at_once
        }

    @cached_property
    def counted_once(self) -> dict[str, str]:
        """Conditions that are another one by :meth:`Matrix.alike`: one that still takes a test first, then one run.

        So one that need not be run saves nothing beside one that takes a test; and this is none of those that were run.
        """
        run, waived = self.run, self.waived
        return self.matrix.alike([i for i in self.matrix.ids if i not in run and i not in waived], list(run))

    @property
    def saved(self) -> tuple[int, int]:
        """How many tests need not be run, and of how many, each counted once."""
        n = len(self.matrix.ids) - len(self.counted_once)
        return len(self.waived.keys() - self.counted_once.keys()), n

    @property
    def run_first(self) -> str | None:
        """The fastest of two or more conditions that a test can settle, after which others may need none; or None.

        It was not run, misses no criterion, and has open ones, of which none takes a longer record to tell, or is
        uncertain to meet all at once.
        """
        uncertain = self.uncertain
        unsettled = [
            (row[0].condition.speed_mps, i)
            for i, row in self.rows.items()
            if i in uncertain
            or (
                not row[0].run
                and all(own.word != "not met" for own in row)
                and (undecided := [own for own in row if own.word == "open"])
                and all(own.probability is not None for own in undecided)
            )
        ]
        return max(unsettled)[1] if len(unsettled) > 1 else None


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
        As in :func:`crashfuse.study.running.run_study`.

    Raises
    ------
    UsageError
        If the campaign has no test.
    DataError
        If a test's record is shorter than the window of a rating.
    Cancelled
        If the watch was told to stop.
    """
    if not campaign.tests:
        raise UsageError("A verdict takes a test at least; this campaign has none.")
    config = replace(
        config, approaches=config.approaches[:1], windows_ms=criteria.windows_ms or (WINDOW_MS,), leave_out="both"
    )
    config.check()
    for window in criteria.windows_ms:
        for test in campaign.tests:
            check_window(test, window)
    [approach] = config.approaches
    trials, cells = _asked(campaign, matrix, approach)
    known = Forecasts(campaign, criteria.windows_ms, config, cache or Cache(), watch)
    with workers_at(scheduler, workers) as place:
        start = time.perf_counter()
        forecasts = known.all(trials, place, _LEARN, learn_for=cells)
        learned = time.perf_counter()
        forecasts |= known.all(cells, place, _JUDGE)
        seconds = {"learn": learned - start, "judge": time.perf_counter() - learned}
    record = record_of(campaign, criteria, approach, forecasts)
    domain, run = Domain.of(campaign), run_at(campaign, matrix)
    judged = tuple(
        judge(forecasts[cell], cell.condition, criteria, domain.outside(cell.condition), was_run=bool(tests))
        for cell, tests in zip(cells, run, strict=True)
    )
    verdicts = held(judged, campaign, matrix, criteria, record)
    return Certification(campaign, criteria, matrix, config, domain, judged, verdicts, record, seconds)


def is_computed(campaign: Campaign, criteria: Criteria, matrix: Matrix, config: StudyConfig, cache: Cache) -> bool:
    """Whether the cache has every forecast that a certification takes, so that it takes no time."""
    config = replace(config, approaches=config.approaches[:1])
    known = Forecasts(campaign, criteria.windows_ms, config, cache, SILENT)
    trials, cells = _asked(campaign, matrix, config.approaches[0])
    return all(known.find(each) is not None for each in (*cells, *trials))


def _asked(campaign: Campaign, matrix: Matrix, approach: str) -> tuple[list[Asked], list[Asked]]:
    """Forecasts of left-out tests, by the raw CAE as well, and of the conditions of a matrix."""
    names = dict.fromkeys((approach, BASELINE))
    trials = [
        Asked(held_out, name, campaign.test(test_id).condition)
        for test_id, _, held_out in left_out(campaign)
        for name in names
    ]
    return trials, [Asked((), approach, condition) for condition in matrix.conditions]


Answer = Literal[
    "run", "need not be run", "would miss", "test or redesign", "record for longer", "to be tested", "outside"
]
"""A test was made for it; it would meet all criteria at once; it would miss one; one is open, and only a test or
another design can tell; one is open as records end too early; each is met, but all at once not with the confidence; one
lies beyond what the campaign's tests check. The first that is true."""


def answers(certification: Certification) -> dict[str, Answer]:
    """The answer at each condition of the matrix, by its id."""
    waived, uncertain = certification.waived, certification.uncertain
    return {
        i: "need not be run" if i in waived else "to be tested" if i in uncertain else _answer(row)
        for i, row in certification.rows.items()
    }


def _answer(row: tuple[Verdict, ...]) -> Answer:
    if row[0].run:
        return "run"
    words = {own.word for own in row}
    if "not met" in words:
        return "would miss"
    if "open" not in words:
        return "outside"
    known = any(own.word == "open" and own.probability is not None for own in row)
    return "test or redesign" if known else "record for longer"
