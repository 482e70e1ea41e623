"""Verdicts held against evidence: the record of left-out tests, and the tests that were run at their conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria
from crashfuse.certification.earlier import RemovedTest
from crashfuse.certification.forecasts import quantity
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import Verdict
from crashfuse.condition import Condition
from crashfuse.study.outliers import departures_near
from crashfuse.wording import Sentence, joined, probability_text, read_out

Rows = tuple[tuple[Verdict, ...], ...]


def hold(
    judged: Rows,
    campaign: Campaign,
    criteria: Criteria,
    record: TrackRecord,
    removed: Sequence[RemovedTest] = (),
) -> Rows:
    """Verdicts held against the record and the tests at each condition: run there, apart there, or removed since."""
    supports = {criterion: record.support(criterion) for criterion in criteria.items}

    def held(verdict: Verdict, apart: Sequence[str]) -> Verdict:
        support = supports[verdict.criterion]
        if verdict.decided and (shortfall := support.shortfall(criteria.confidence)):
            verdict = _with_reason(verdict, shortfall, contradicted=True)
        elif verdict.decided and (reservation := support.reservation(criteria.confidence)):
            verdict = _with_reason(verdict, reservation)
        if verdict.run:
            verdict = beside_tests(verdict, *_measured(verdict, record))
        if apart:
            may = Sentence("another test may fold as it did.")
            if verdict.folds:
                alike, otherwise = (probability_text(share, criteria.confidence) for share in verdict.folds)
                may = Sentence("met with probability {} if a test folds as it did, else {}.", otherwise, alike)
            caveat = Sentence("{} stands apart at about this speed: {}", read_out(apart), may)
            verdict = _with_reason(verdict, caveat)
        return _beside_removed(verdict, removed)

    found = []
    for row in judged:
        apart = [departure.test for departure in departures_near(campaign, row[0].condition)]
        found.append(tuple(held(verdict, apart) for verdict in row))
    return tuple(found)


def _measured(verdict: Verdict, record: TrackRecord) -> tuple[dict[str, float | None], dict[str, Condition]]:
    trials = {
        trial.held_out: trial
        for trial in (*record.trials, *record.tuned)
        if trial.left_out == "test" and trial.held_out in verdict.run and trial.verdict.criterion == verdict.criterion
    }
    off = {i: t.verdict.condition for i, t in trials.items() if not t.verdict.condition.is_at(verdict.condition)}
    return {test: trials[test].measured if test in trials else None for test in verdict.run}, off


def beside_tests(verdict: Verdict, run: Mapping[str, float | None], off: Mapping[str, Condition] = {}) -> Verdict:
    """The verdict beside what tests at its condition measured; open if one of them contradicts it.

    ``off`` are the conditions of those that were not quite there.
    """
    criterion, contradicted, told = verdict.criterion, False, []
    did = "and measured" if criterion.window_ms is None else "and, predicted without it, rated"
    for test, value in run.items():
        if value is not None:
            met = criterion.is_met_by(value)
            where = Sentence("for it, at {},", off[test]) if test in off else "there"
            does = "meets" if met else "misses"
            told.append(
                Sentence("Test {} was run {} {} {}, which {} it.", test, where, did, criterion.shown(value), does)
            )
            contradicted |= met is not (verdict.word == "met")
    return replace(_with_reason(verdict, *told, contradicted=contradicted), run=run)


def _beside_removed(verdict: Verdict, removed: Sequence[RemovedTest]) -> Verdict:
    """The verdict beside what tests that are not used any more had shown there; open if one of them contradicts it.

    A rating had been that of another prediction, and says nothing of this one.
    """
    criterion = verdict.criterion
    for test in removed if criterion.window_ms is None else ():
        value = test.measured.get(quantity(criterion)) if test.condition.is_at(verdict.condition) else None
        if value is not None:
            met = criterion.is_met_by(value)
            told = "Test {}, whose record of then is not used any more, {} it there with {}."
            sentence = Sentence(told, test.test, "met" if met else "missed", criterion.shown(value))
            verdict = _with_reason(verdict, sentence, contradicted=met is not (verdict.word == "met"))
    return verdict


def _with_reason(verdict: Verdict, *sentences: str, contradicted: bool = False) -> Verdict:
    word = "open" if verdict.decided and contradicted else verdict.word
    return replace(verdict, word=word, reason=joined([verdict.reason, *sentences]))
