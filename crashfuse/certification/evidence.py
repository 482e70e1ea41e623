"""Verdicts held against evidence: the record of left-out tests, and the tests that were run at their conditions."""

from collections.abc import Sequence
from dataclasses import replace

from crashfuse.approaches.registry import BASELINE
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria
from crashfuse.certification.domain import Domain
from crashfuse.certification.forecasts import Asked, Forecast, quantity
from crashfuse.certification.matrix import SAME_SPEED_MPS, SAME_WEIGHT, Matrix
from crashfuse.certification.track_record import LeftOut, Support, TrackRecord, Trial
from crashfuse.certification.verdict import Verdict, beside_tests, judge
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.study.facts import departures_near
from crashfuse.wording import Sentence, joined, read_out


def run_near(campaign: Campaign, condition: Condition) -> tuple[CrashTest, ...]:
    """The tests that were run within 1 km/h and 2 % of the mass of a condition, though not all were made for it."""
    return tuple(
        test
        for test in campaign.tests
        if abs(test.condition.speed_mps - condition.speed_mps) <= SAME_SPEED_MPS + 1e-9
        and abs(test.condition.mass_kg / condition.mass_kg - 1) <= SAME_WEIGHT + 1e-9
        and test.condition.may_be(condition)
    )


def run_at(campaign: Campaign, matrix: Matrix) -> tuple[tuple[str, ...], ...]:
    """By condition of a matrix the ids of the tests of a campaign that were run there, by :meth:`Matrix.run`."""
    return matrix.run((test.id, test.condition) for test in campaign.tests)


def held(
    judged: tuple[tuple[Verdict, ...], ...],
    campaign: Campaign,
    matrix: Matrix,
    criteria: Criteria,
    record: TrackRecord,
) -> tuple[tuple[Verdict, ...], ...]:
    """Verdicts held against the record, and against the tests that were run at each condition, or stand apart there."""
    supports = {own: record.support(own) for own in criteria.items}
    found = []
    for row, tests, condition in zip(judged, run_at(campaign, matrix), matrix.conditions, strict=True):
        own = (_supported(verdict, supports[verdict.criterion], criteria.confidence) for verdict in row)
        beside = (_beside_tests(verdict, tests, record) for verdict in own)
        apart = [departure.test for departure in departures_near(campaign, condition)]
        found.append(tuple(_beside_apart(verdict, apart) for verdict in beside))
    return tuple(found)


def _beside_apart(verdict: Verdict, tests: Sequence[str]) -> Verdict:
    """The verdict with a word on tests that stand apart at about its speed."""
    if not tests:
        return verdict
    caveat = Sentence("{} stands apart at about this speed: another test may fold as it did.", read_out(tests))
    return replace(verdict, reason=joined([verdict.reason, caveat]))


def _beside_tests(verdict: Verdict, run: Sequence[str], record: TrackRecord) -> Verdict:
    """The verdict beside the tests that were run at its condition, if there are any."""
    if not run:
        return verdict
    measured: dict[str, float | None] = dict.fromkeys(run)
    off: dict[str, Condition] = {}
    for trial in record.trials:
        if trial.held_out in measured and trial.left_out == "test" and trial.verdict.criterion == verdict.criterion:
            measured[trial.held_out] = trial.measured
            if not trial.verdict.condition.is_at(verdict.condition):
                off[trial.held_out] = trial.verdict.condition
    return beside_tests(verdict, measured, off)


def _supported(verdict: Verdict, support: Support, confidence: float) -> Verdict:
    """The verdict, open if the record does not support the confidence, with what the record says of the limit."""
    if not verdict.decided:
        return verdict
    if (shortfall := support.shortfall(confidence)) is not None:
        return replace(verdict, word="open", reason=joined([verdict.reason, shortfall]))
    if (reservation := support.reservation(confidence)) is not None:
        return replace(verdict, reason=joined([verdict.reason, reservation]))
    return verdict


def left_out(campaign: Campaign) -> list[tuple[str, LeftOut, tuple[str, ...]]]:
    """Each test with what is left out with it: nothing else, or its speed group if other tests remain."""
    if len(campaign.tests) < 2:
        return []
    groups = [(test, campaign.speed_group(test)) for test in campaign.test_ids]
    return [
        *((test, "test", (test,)) for test in campaign.test_ids),
        *((test, "speed group", group) for test, group in groups if len(group) < len(campaign.tests)),
    ]


def record_of(campaign: Campaign, criteria: Criteria, approach: str, forecasts: dict[Asked, Forecast]) -> TrackRecord:
    """Compare the verdicts on left-out tests, each from the others alone, with what was measured."""
    trials = []
    for test_id, way, held_out in left_out(campaign):
        test, domain = campaign.test(test_id), Domain.of(campaign.without(held_out), for_record=True)
        own, cae = (forecasts[Asked(held_out, name, test.condition)] for name in (approach, BASELINE))
        for verdict in judge(own, test.condition, criteria, domain.exceeded_by(test.condition)):
            criterion = verdict.criterion
            measured = own.measured(criterion, test, campaign.occupant)
            baseline = cae.distributions[quantity(criterion)] if criterion.window_ms is None else None
            raw = None if baseline is None else baseline.probability(criterion.at_least, criterion.at_most)
            if measured is not None:
                trials.append(Trial(test_id, way, verdict, measured, raw))
    return TrackRecord(tuple(trials))
