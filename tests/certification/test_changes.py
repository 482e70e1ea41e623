"""An earlier certification beside a later one: what came true, what changed, and what cannot be compared."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Certification, certify_matrix
from crashfuse.certification.changes import Changes
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.earlier import Earlier, EarlierVerdict, parse_earlier
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import RemovedTest, Word
from crashfuse.condition import Condition
from crashfuse.errors import DataError
from crashfuse.execution.cache import Cache
from crashfuse.reporting.certification_changes import change_sentences, changes_table, saved_and_missed, shown_changes
from crashfuse.reporting.certification_exceptions import exceptions
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.certification_sentences import beside_matrix, summary
from crashfuse.reporting.report import certification_report
from crashfuse.signals.metrics import metric_values
from crashfuse.signals.occupant import OccupantModel
from crashfuse.study.config import StudyConfig
from crashfuse.units import KPH, MPH

pytestmark = pytest.mark.usefixtures("one_cache")

CRUSH, PEAK = Criterion("crush", "max_crush", at_most=430.0), Criterion("peak", "peak", at_most=25.0)
GOOD = Criterion("good", "rating", at_least=0.5, window_ms=60.0)
MET, MISSED = EarlierVerdict("met", 0.97, 100.0, 425.0), EarlierVerdict("not met", 0.02, 26.0, 27.0)
OPEN = EarlierVerdict("open", 0.6, 10.0, 500.0)
Row = tuple[EarlierVerdict, ...]


@pytest.fixture(scope="module")
def later(campaign: Campaign, shared_cache: Path) -> Certification:
    """Verdicts of the raw CAE model at the condition of each test, and at 20 mph."""
    conditions = [test.condition for test in campaign.tests]
    slow = replace(conditions[1], speed_mps=20 * MPH)
    matrix = Matrix((*(f"at {test}" for test in campaign.test_ids), "slow"), (*conditions, slow))
    config, criteria = StudyConfig(approaches=("cae",)), Criteria((CRUSH, PEAK, GOOD), 0.8)
    return certify_matrix(campaign, criteria, matrix, config, cache=Cache(shared_cache), workers=1)


def earlier(later: Certification, rows: Sequence[Row], *known: str, **others: Any) -> Earlier:
    """A certification that said this of the same conditions, from these tests, or from the first alone."""
    read, first = parse_earlier(certification_json(later)), later.campaign.test_ids[0]
    tests = {test: read.tests[test] for test in known or (first,)}
    return replace(read, **{"tests": tests, "run": {}, "verdicts": tuple(rows), **others})


def compared(before: Earlier, today: Certification) -> Changes:
    """Today's certification beside an earlier one."""
    return Changes.of(today.beside(before))


def alike(*verdicts: EarlierVerdict) -> list[Row]:
    """All criteria alike, a verdict a condition."""
    return [(own, own, own) for own in verdicts]


def said(changes: Changes) -> str:
    """All sentences."""
    return " ".join(map(str, change_sentences(changes)))


def measured(later: Certification, test: str) -> dict[str, float]:
    """The metrics of a test."""
    return {metric.name: metric.value or 0.0 for metric in later.campaign.metrics_of(later.campaign.test(test))}


def test_a_certification_beside_itself_says_that_nothing_changed(later: Certification) -> None:
    """Read from its own file: all verdicts as they were, and no test since."""
    changes = compared(parse_earlier(certification_json(later)), later)
    n = len(later.cells)
    assert [before for _, before, _ in changes.compared] == [
        EarlierVerdict(own.word, own.probability, own.lower, own.upper) for _, own in later.cells
    ]
    assert (changes.since.new, changes.since.gone, changes.tested, changes.outcomes) == ((), (), {}, (0, 0, 0))
    assert shown_changes(changes).empty
    told = said(changes)
    assert "it knew every test" in told
    assert "was run where it judged" not in told
    assert f"Of {n} verdicts that both have, as they were: {n}; decided since: 0; no longer decided: 0." in told
    assert "otherwise" not in told
    assert "Not compared" not in told


@pytest.mark.parametrize(("word", "wrong"), [("met", True), ("not met", False)])
def test_a_test_run_since_tells_whether_a_verdict_came_true(later: Certification, word: Word, wrong: bool) -> None:
    """By what was measured, against the limit; an open verdict is neither right nor wrong."""
    tests = later.campaign.tests
    fastest = max(tests, key=lambda test: test.condition.speed_mps).id
    found = measured(later, fastest)
    assert found["peak"] > 25
    rows = [(OPEN, OPEN, OPEN)] * len(later.matrix.ids)
    rows[later.campaign.test_ids.index(fastest)] = (OPEN, EarlierVerdict(word, 0.5, 0.0, 1.0), MET)
    changes = compared(earlier(later, rows, *(test.id for test in tests if test.id != fastest)), later)
    assert changes.since.new == (fastest,)
    assert changes.tested == {f"at {fastest}": (fastest,)}
    assert changes.outcomes == (1, int(wrong), 1)
    assert changes.record.intervals == (int(10 <= found["max_crush"] <= 500), 2)
    (row,) = changes_table(changes).query("came_true != ''").to_dict("records")
    assert (row["id"], row["criterion"], row["came_true"]) == (f"at {fastest}", "peak", not wrong)
    assert row["measured"] == pytest.approx(found["peak"])
    told = [own for own in change_sentences(changes) if "was said to be" in own]
    assert len(told) == int(wrong)
    assert all(fastest in own and "at most 25 g" in own for own in told)
    assert (shown_changes(changes)["Came true"].iloc[0] == f"{fastest} NO") is wrong


def test_what_is_asked_today_hides_no_wrong_verdict(later: Certification) -> None:
    """A criterion that was dropped is measured all the same, of a single test too, which leaves no record."""
    fastest = max(later.campaign.tests, key=lambda test: test.condition.speed_mps).id
    n = len(later.matrix.ids)
    before = earlier(later, alike(*[MET] * n), *(test for test in later.campaign.test_ids if test != fastest))
    today = replace(
        later,
        criteria=Criteria((CRUSH,), 0.8),
        judged=tuple(row[:1] for row in later.judged),
        record=TrackRecord(()),
    )
    ((missed, unknown),) = compared(before, today).waived_outcomes[f"at {fastest}"].values()
    assert "peak" in missed
    assert unknown == ()  # ratings are left aside


def test_two_limits_or_conditions_alike_are_one_metric_of_a_test(later: Certification) -> None:
    """Or a criterion written twice would make a record; a wrong one counts."""
    n, first = len(later.matrix.ids), later.campaign.test_ids[0]
    loose = replace(PEAK, name="loose", at_most=1000.0)
    before = earlier(later, [(OPEN, MET, MET)] * n, criteria=Criteria((CRUSH, PEAK, loose), 0.8))
    peaks = [measured(later, test)["peak"] for test in later.campaign.test_ids if test != first]
    wrong = sum(peak > 25.0 for peak in peaks)
    assert compared(before, later).outcomes == (len(peaks), wrong, len(peaks))
    twice = replace(
        later.matrix,
        ids=(*later.matrix.ids, "beside"),
        conditions=(*later.matrix.conditions, replace(c := later.matrix.conditions[-2], speed_mps=c.speed_mps * 1.001)),
    )
    before = replace(before, matrix=twice, verdicts=((OPEN, MET, MET),) * (n + 1))
    assert compared(before, later).outcomes == (len(peaks), wrong, len(peaks))


def test_of_conditions_that_needed_no_test_it_is_told_what_was_missed_and_what_is_unknown(later: Certification) -> None:
    """That answer is what a test is saved by; one that was not met is none, and a short record tells nothing."""
    first, second, *others = later.campaign.test_ids
    n = len(later.matrix.ids)
    short = replace(
        later.campaign.test(second), pulse=replace(later.campaign.test(second).pulse, accel_mps2=np.full(1250, -1.0))
    )
    campaign = replace(later.campaign, tests=tuple(short if t.id == second else t for t in later.campaign.tests))
    changes = compared(earlier(later, alike(*[MET] * (n - 1), MISSED)), replace(later, campaign=campaign))
    assert changes.waived_outcomes[f"at {second}"] == {second: ((), ("crush",))}
    for test in others:
        missed = tuple(own.name for own in (CRUSH, PEAK) if not own.is_met_by(measured(later, test)[own.metric]))
        assert changes.waived_outcomes[f"at {test}"] == {test: (missed, ())}
    assert f"at {first}" not in changes.waived_outcomes
    assert f"at {second} needed no test by an earlier certification; {second} cannot tell crush." in said(changes)
    assert "missed peak" in said(changes)


def test_a_record_is_known_by_its_content(later: Certification) -> None:
    """Under another id it is no new test; another vehicle's file is refused."""
    campaign, (first, second, *_) = later.campaign, later.campaign.test_ids
    before = earlier(later, alike(*[OPEN] * len(later.matrix.ids)), first, second)
    renamed = replace(campaign.test(second), id="renamed")
    others = tuple(test for test in campaign.tests if test.id != second)
    same = replace(later, campaign=replace(campaign, tests=(*others, renamed)))
    assert "renamed" not in compared(before, same).since.new
    with pytest.raises(DataError, match="a certification of this campaign, found one of Tiny"):
        compared(replace(before, tests={"X1": "of another vehicle"}), later)


def test_a_record_that_was_retouched_is_no_test_since(later: Certification) -> None:
    """The earlier certification had learned from it: what it shows proves nothing. A new filter class changes all."""
    campaign, n = later.campaign, len(later.matrix.ids)
    before = earlier(later, alike(*[MET] * n), *campaign.test_ids)
    louder = tuple(
        replace(test, pulse=replace(test.pulse, accel_mps2=1.1 * test.pulse.accel_mps2)) for test in campaign.tests
    )
    for tests in ((louder[0], *campaign.tests[1:]), louder):
        changes = compared(before, replace(later, campaign=replace(campaign, tests=tests)))
        assert changes.since.changed == tuple(test.id for test in tests if test in louder)
        assert (changes.since.new, changes.since.gone, changes.outcomes) == ((), (), (0, 0, 0))
    assert f"which it had learned from: {', '.join(campaign.test_ids)}" in said(changes)
    filtered = {**before.settings, "CAE runs": "24, another fingerprint"}
    assert compared(replace(before, settings=filtered), changes.later).since.changed == campaign.test_ids
    with pytest.raises(DataError):  # of another name, beside other CAE runs, an id is not enough
        compared(replace(before, settings={**filtered, "campaign": "Coupe"}), changes.later)


def test_a_test_is_made_for_the_nearest_condition_though_a_little_off(later: Certification) -> None:
    """To 1 km/h and 2 %, and the sentence says where it was run; of one made for none, that it tells nothing."""
    campaign, first = later.campaign, later.campaign.test_ids[0]
    at = {test.id: test.condition for test in campaign.tests}
    rows = alike(*[MET] * len(later.matrix.ids))
    for off_kph, told in ((0.95, True), (1.1, False)):
        moved = tuple(
            replace(test, condition=replace(at[test.id], speed_mps=at[test.id].speed_mps + off_kph * KPH))
            if test.id != first
            else test
            for test in campaign.tests
        )
        changes = compared(earlier(later, rows), replace(later, campaign=replace(campaign, tests=moved)))
        others = campaign.test_ids[1:]
        assert changes.since.at == ({test: f"at {test}" for test in others} if told else {})
        assert changes.since.elsewhere == (() if told else others)
        expected = (
            f"at {others[0]} (test {others[0]}, at {moved[1].condition})" if told else "Run at none of its conditions"
        )
        assert expected in said(changes)


def test_a_repeat_of_a_test_that_was_known_counts_for_nothing(later: Certification) -> None:
    """Its verdict was given by one who had seen the answer."""
    first, second, *_ = later.campaign.test_ids
    rows = alike(*[MET] * len(later.matrix.ids))
    known = {f"at {second}": {first: {"crush": 1.0}}}
    without, beside = (compared(earlier(later, rows, run=run), later) for run in ({}, known))
    assert beside.since.repeats == {second: f"at {second}"}
    assert (without.outcomes[2], beside.outcomes[2]) == (3, 2)
    assert f"Run where it knew a test already, and not counted: at {second} (test {second})." in said(beside)


def test_metrics_are_measured_as_they_were_then(later: Certification) -> None:
    """An occupant model that was changed since makes no verdict on OLC wrong."""
    olc, first = Criterion("olc", "olc", at_most=1000.0), later.campaign.test_ids[0]
    before = earlier(later, [(MET,)] * len(later.matrix.ids), criteria=Criteria((olc,), 0.8))
    stiffer = replace(later.campaign, occupant=OccupantModel(olc_free_flight_mm=30.0))
    then, now = compared(before, later), compared(before, replace(later, campaign=stiffer))
    measured = [cell.measured for cell in then.cells if cell.before]
    assert any(measured)
    assert [cell.measured for cell in now.cells if cell.before] == measured
    assert f"at {first}" not in now.tested


def test_wrong_verdicts_of_then_take_support_from_those_of_today(later: Certification) -> None:
    """They are the strongest evidence that there is; a test that is left out as well counts once."""
    right = TrackRecord(tuple(replace(own, verdict=replace(own.verdict, word="met" if own.met else "not met"))
                              for own in later.record.trials))  # fmt: skip
    sure = replace(later, record=right)
    n = len(later.matrix.ids)
    loose, tight = (Criteria((replace(PEAK, at_most=most),), 0.8) for most in (1e4, 1e-4))
    one = [(EarlierVerdict("met", 0.99, 1.0, 2.0),)] * n
    for criteria, wrong in ((loose, 0), (tight, 3)):
        beside = sure.beside(earlier(later, one, criteria=criteria))
        own, before = beside.record.support(PEAK), right.support(PEAK)
        assert (own.own_decided, own.own_wrong) == (before.own_decided, wrong)  # one a test, the wrong one if any is
        assert (own.confidence < before.confidence) is (wrong > 0)
    assert right.counts() == beside.record.counts()  # of left-out tests alone
    unsure = [(EarlierVerdict("met", 0.7, 1.0, 2.0),)] * n
    assert sure.beside(earlier(later, unsure, criteria=tight)).record.support(PEAK) == right.support(PEAK)


def test_a_certification_in_between_forgets_no_wrong_verdict(later: Certification) -> None:
    """Its file holds what those before it had said of tests that were run since."""
    n, tight = len(later.matrix.ids), Criteria((replace(PEAK, at_most=1e-4),), 0.8)
    one = [(EarlierVerdict("met", 0.99, 1.0, 2.0),)] * n
    between = later.beside(earlier(later, one, criteria=tight))
    again = later.beside(parse_earlier(certification_json(between)))
    assert again.since is not None
    assert again.since.new == ()
    assert again.record.support(PEAK) == between.record.support(PEAK) != later.record.support(PEAK)
    before = "Certifications before it: verdicts met or not met on 3 metrics of 3 tests run since, 3 wrong"
    assert before in said(Changes.of(again))
    assert Changes.of(again).waived_outcomes == Changes.of(between).waived_outcomes != {}
    told = exceptions(again)["Verdicts that tests run since contradict"]
    assert len(told) == 3
    assert "before it was run: peak (at most 0.0001 g) at 25.0 mph" in told[0]
    assert "was said to be met (probability 0.990)" in told[0]
    third = later.beside(parse_earlier(certification_json(again)))
    assert third.record.support(PEAK) == between.record.support(PEAK)


def test_intervals_that_hold_too_little_are_an_exception_with_each_miss(later: Certification) -> None:
    """Three of three missed cannot be intervals of 95 %; that no verdict was wrong hides it not."""
    first, *others = later.campaign.test_ids
    narrow = EarlierVerdict("open", 0.5, 1.0, 2.0)
    beside = later.beside(earlier(later, [(OPEN, narrow, OPEN)] * len(later.matrix.ids)))
    found = exceptions(beside)["Intervals that tests run since contradict"]
    assert "held what tests run since measured, made to hold 95 %: they were too narrow" in found[0]
    peak = measured(later, others[0])["peak"]
    assert f"{others[0]} peak {peak:#.4g} g, not 1.000 to 2.000 g" in found[0]
    assert found[0] in [str(own) for own in summary(beside)]
    assert first not in found[0]


def test_a_test_that_is_not_used_any_more_is_not_forgotten(later: Certification) -> None:
    """What it had shown is held against today's verdicts on the same metric, whatever the limit was."""
    second = later.campaign.test_ids[1]
    place = f"at {second}"
    campaign = later.campaign.without([second])
    kept = tuple(tuple(replace(own, run={}, word="met") for own in row) for row in later.judged)
    everything = TrackRecord(tuple(replace(own, verdict=replace(own.verdict, word="met" if own.met else "not met"))
                                   for own in later.record.trials))  # fmt: skip
    today = replace(later, campaign=campaign, judged=kept, record=everything)
    shown = {second: {"crush": 1e4, "peak": 1.0, "good": 0.1}}
    beside = today.beside(
        earlier(later, alike(*[MET] * len(later.matrix.ids)), *later.campaign.test_ids, run={place: shown})
    )
    crush, peak, good = beside.rows[place]
    assert crush.word == "open"
    gone = f"Test {second}, whose record of then is not used any more, missed it there with 1.000e+04 mm."
    assert crush.reason.endswith(gone)
    assert "met it there" in peak.reason
    assert second not in good.reason  # a rating was another prediction's
    here = later.campaign.test(second).condition
    told = f"{second} was run at {here}, and its record of then is not used any more; it missed crush, good of"
    assert "not measured" not in str(exceptions(beside)["Tests that are not used"][0])
    assert told in str(exceptions(beside)["Tests that are not used"][0])
    assert any(told in str(own) for own in summary(beside))
    again = today.beside(parse_earlier(certification_json(beside)))  # beside one that is beside one that used the test
    assert again.since is not None
    assert again.since.gone == ()
    assert [own.reason for own in again.rows[place]] == [own.reason for own in beside.rows[place]]
    assert any(told in str(own) for own in exceptions(again)["Tests that are not used"])


def test_statements_that_were_gained_and_withdrawn_are_listed_by_the_ids_of_today(later: Certification) -> None:
    """With what stands against them; a condition that was run since is neither. By other limits only what both have."""
    row = later.judged[-1]
    right = tuple(
        replace(t, verdict=replace(t.verdict, word="met" if t.met else "not met")) for t in later.record.trials
    )

    def today(*words: Word, each: float = 1.0) -> Certification:
        own = tuple(replace(verdict, word=word, probability=each) for verdict, word in zip(row, words, strict=True))
        return replace(later, judged=(*later.judged[:-1], own), record=TrackRecord(right))

    others = [OPEN] * (len(later.matrix.ids) - 1)
    renamed = replace(later.matrix, ids=tuple(f"x{i}" for i in later.matrix.ids))
    gained = compared(earlier(later, alike(*others, OPEN), matrix=renamed), today("met", "met", "met"))
    assert (gained.newly_waived, gained.withdrawn) == (("slow",), {})
    lost = compared(earlier(later, alike(*others, MET), matrix=renamed), today("open", "not met", "met"))
    assert lost.newly_waived == ()
    assert "Need not be run any more: slow." in said(gained)
    assert "Said then to need no test, and not now: slow (crush open, peak not met)." in said(lost)
    assert "Turned round: slow (then xslow) (peak)." in said(lost)
    unsure = compared(earlier(later, alike(*others, MET), matrix=renamed), today("met", "met", "met", each=0.9))
    assert "Said then to need no test, and not now: slow (each met, all at once uncertain)." in said(unsure)
    loose = Criteria((CRUSH, replace(PEAK, at_most=99.0), GOOD), 0.8)
    by_others = compared(earlier(later, alike(*others, OPEN), criteria=loose), today("met", "met", "met"))
    assert by_others.newly_waived == ()
    lost = compared(earlier(later, alike(*others, MET), criteria=loose), today("open", "not met", "met"))
    assert {i: [own.criterion.name for own in rest] for i, rest in lost.withdrawn.items()} == {"slow": ["crush"]}


def test_another_limit_or_condition_is_not_compared(later: Certification) -> None:
    """It is counted, and stands in the table beside nothing."""
    n = len(later.matrix.ids)
    slower = replace(later.matrix.conditions[-1], speed_mps=19 * MPH)
    other = earlier(
        later,
        alike(*[OPEN] * n),
        matrix=replace(later.matrix, conditions=(*later.matrix.conditions[:-1], slower)),
        criteria=Criteria((CRUSH, replace(PEAK, at_most=24.0), GOOD), 0.8),
    )
    changes = compared(other, later)
    assert len(changes.compared) == 2 * (n - 1)
    assert f"another: {n + 2} verdicts of then, {n + 2} of now." in said(changes)
    table = changes_table(changes)
    assert (table["earlier_verdict"] == "").sum() == n + 2
    there = table[table["earlier_id"] == "slow"].drop_duplicates("speed_mph")
    assert there[["id", "speed_mph"]].values.tolist() == [["", 19.0]]
    assert "slow (then)" in shown_changes(changes)["Condition"].tolist()
    assert "not asked" in shown_changes(changes)["Then"].tolist()


def test_what_was_made_otherwise_is_told(later: Certification) -> None:
    """Seed, confidence, CAE runs and what metrics rest on decide verdicts as tests do."""
    before = earlier(later, alike(*[OPEN] * len(later.matrix.ids)))
    settings = {**before.settings, "seed": "7", "occupant model": "100 + 200 mm"}
    told = said(compared(replace(before, settings=settings, tests={**before.tests, "OLD": "x"}), later))
    assert "Made otherwise: seed 0 (then 7); occupant model the usual one (then 100 + 200 mm)." in told
    assert "no longer used: OLD" in told


def test_what_became_of_it_stands_in_json_and_report(later: Certification) -> None:
    """With the whole digest of the earlier file; without an earlier one, nothing is said of it."""
    beside = later.beside(earlier(later, alike(*[MET] * len(later.matrix.ids))))
    changes, record = Changes.of(beside), json.loads(certification_json(beside))
    since, (n, wrong, tests) = record["since"], changes.outcomes
    assert wrong > 0
    assert since["decided"] == {"metrics": n, "tests": tests, "wrong": wrong, "wrong_at_most": pytest.approx(1, abs=1)}
    assert since["sha256"] == changes.earlier.digest
    assert since["sentences"] == [str(own) for own in change_sentences(changes)]
    assert "--since EARLIER" in record["command"]
    report = certification_report(beside)
    assert "<h2>Earlier verdicts, and what became of them</h2>" in report
    assert changes.earlier.digest in report
    assert "Earlier verdicts" not in certification_report(later)
    assert "since" not in json.loads(certification_json(later))


def test_intervals_that_were_missed_one_test_at_a_time_add_up(later: Certification) -> None:
    """Each step has one test more: two misses of three in all are told, as they would be in a single step."""
    first, *others = later.campaign.test_ids
    narrow = EarlierVerdict("open", 0.5, 1.0, 2.0)
    rows = [(OPEN, narrow, OPEN)] * len(later.matrix.ids)
    at_once = compared(earlier(later, rows), later)
    kept, known = earlier(later, rows), [first]
    for test in others:
        known.append(test)
        some = later.campaign.without([other for other in later.campaign.test_ids if other not in known])
        step = replace(later, campaign=some).beside(kept)
        kept = replace(parse_earlier(certification_json(step)), run={}, verdicts=tuple(rows))
        assert len(kept.before) == len(known) - 1
    again = Changes.of(later.beside(kept))
    assert again.record.intervals == at_once.record.intervals
    assert [{own.held_out for own in each.record.missed_intervals} for each in (again, at_once)] == [{*others}] * 2
    assert "they were too narrow" in said(again)
    assert "It was beside others in its turn, the latest first, by SHA-256: " in said(again)


def test_a_record_that_was_replaced_under_its_id_is_not_forgotten(later: Certification) -> None:
    """What the test had shown stands against the verdict there, whatever was put in its place; so in the next one."""
    second = later.campaign.test_ids[1]
    place, test = f"at {second}", later.campaign.test(second)
    softer = replace(test, pulse=replace(test.pulse, accel_mps2=0.98 * test.pulse.accel_mps2))
    campaign = replace(later.campaign, tests=tuple(softer if own.id == second else own for own in later.campaign.tests))
    shown = {second: {"crush": 1e4, "peak": 1.0, "good": 0.1}}
    before = earlier(later, alike(*[MET] * len(later.matrix.ids)), *later.campaign.test_ids, run={place: shown})
    beside = replace(later, campaign=campaign).beside(before)
    again = replace(later, campaign=campaign).beside(parse_earlier(certification_json(beside)))
    for own in (beside, again):
        assert (
            "whose record of then is not used any more, missed it there with 1.000e+04 mm" in own.rows[place][0].reason
        )
        assert f"run as {second} with another record, not used" in " ".join(map(str, summary(own)))
    filtered = tuple(
        replace(own, pulse=replace(own.pulse, accel_mps2=0.98 * own.pulse.accel_mps2)) for own in later.campaign.tests
    )
    everything = replace(later, campaign=replace(later.campaign, tests=filtered)).beside(before)
    assert "record of then" not in everything.rows[place][0].reason  # another filter class changes every record


def test_reasons_and_names_in_braces_are_told_as_they_are(later: Certification) -> None:
    """They are a laboratory's words, no places for others."""
    second = later.campaign.test_ids[1]
    odd = replace(CRUSH, name="crush {A}")
    rows = [(MET,)] * len(later.matrix.ids)
    run = {f"at {second}": {second: {odd.name: 1e4}}}
    before = earlier(later, rows, *later.campaign.test_ids, criteria=Criteria((odd,), 0.8), run=run)
    unused = ((second, later.campaign.test(second).condition),)
    campaign = replace(later.campaign.without([second]), unused=unused, why_unused={second: "bracket {left} loose"})
    told = str(exceptions(replace(later, campaign=campaign).beside(before))["Tests that are not used"])
    assert "(bracket {left} loose); it missed crush {A} of the criteria" in told
    assert "was not measured" not in told
    assert f"{second} (bracket {{left}} loose) was run there" in str(exceptions(replace(later, campaign=campaign)))


def test_a_test_left_out_of_use_is_told_where_it_was_made_for_a_condition_though_a_little_off(
    later: Certification,
) -> None:
    """Nobody gets rid of what it showed by a speed that was not quite met."""
    second = later.campaign.test_ids[1]
    here = later.campaign.test(second).condition
    off = replace(here, speed_mps=here.speed_mps + 0.8 * KPH)
    campaign = replace(later.campaign.without([second]), unused=((second, off),))
    rows = tuple(tuple(replace(own, run={}) for own in row) for row in later.verdicts)
    found = replace(later, campaign=campaign, verdicts=rows)
    told = f"at {second}: {second} (no reason given; at {off}) was run there and is left out of use"
    assert told in " ".join(exceptions(found)["Tests that are not used"])
    assert f"run as {second}, not used" in " ".join(summary(found))


def test_of_a_metric_that_was_not_asked_of_a_test_it_is_not_said_that_none_was_missed() -> None:
    """Nobody knows."""
    gone = RemovedTest("T1", "d", Condition.of_vector([10.0, 900.0, 700.0]), {"max_crush": 500.0})
    assert gone.not_asked([PEAK, CRUSH]) == ("peak",)
    assert gone.missed([PEAK, CRUSH]) == ("crush",)


def test_what_was_said_to_need_no_test_and_missed_counts_in_the_dossier(later: Certification) -> None:
    """As on the page: beside the record of left-out tests, and with its own bound."""
    n = len(later.matrix.ids)
    beside = later.beside(earlier(later, alike(*[MET] * n)))
    told, missed = saved_and_missed(beside)
    counts = json.loads(certification_json(beside))["track_record"]["waived_with_those_since"]
    assert (counts["n"], counts["wrong"]) == (told, missed)
    assert missed > 0


def test_what_one_test_alone_missed_is_no_sign_that_intervals_are_too_narrow(later: Certification) -> None:
    """Its metrics hang together; what it missed is told all the same, and that it was not quite at the condition."""
    _, second, *rest = later.campaign.test_ids
    some = later.campaign.without(rest)
    test = some.test(second)
    off = replace(test.condition, speed_mps=test.condition.speed_mps + 0.5 * KPH)
    moved = replace(some, tests=tuple(replace(own, condition=off) if own.id == second else own for own in some.tests))
    narrow = EarlierVerdict("open", 0.5, 1.0, 2.0)
    rows = [(narrow, narrow, OPEN)] * len(later.matrix.ids)
    for campaign, told in ((some, ""), (moved, f"; not quite at its condition: {second} at {off}")):
        beside = replace(later, campaign=campaign).beside(earlier(later, rows))
        assert "Intervals that tests run since contradict" not in exceptions(beside)
        told_of = said(Changes.of(beside))
        assert "0 of 2 intervals held what tests run since measured (made to hold 95 %); outside: " in told_of
        assert told in told_of
        assert ("not quite" in told_of) is bool(told)


def test_what_a_test_off_its_condition_measured_is_moved_there_as_the_cae_model_says(later: Certification) -> None:
    """By the emulator at both; the peak jumps, and stays. Where that decides, it is told, and the chain knows it."""
    second, *rest = later.campaign.test_ids[1:]
    here = later.campaign.test(second).condition
    off = replace(here, speed_mps=here.speed_mps + 0.9 * KPH)
    some = later.campaign.without(rest)
    moved = replace(some, tests=tuple(replace(own, condition=off) if own.id == second else own for own in some.tests))
    emulator = CaeModel(cache=Cache()).fit(moved.cae).emulator_
    there, planned = (float(metric_values(emulator.predict(c), c.speed_mps)["max_crush"]) for c in (off, here))
    raw = {own.name: own.value or 0.0 for own in moved.metrics_of(moved.test(second))}
    limit = replace(CRUSH, at_most=raw["max_crush"] - 0.5 * (there - planned))
    before = earlier(later, alike(*[MET] * len(later.matrix.ids)), criteria=Criteria((limit, PEAK, GOOD), 0.8))
    beside = replace(later, campaign=moved).beside(before)
    again = replace(later, campaign=moved).beside(parse_earlier(certification_json(beside)))
    for own in (beside, again):
        assert own.since is not None
        crush, peak = own.since.told
        assert crush.shift == pytest.approx(there - planned) != 0
        assert crush.measured + crush.shift == pytest.approx(raw["max_crush"])
        assert (crush.wrong, peak.shift) == (False, 0)
        assert peak.measured == pytest.approx(raw["peak"])
    words = f"{limit.shown(raw['max_crush'])} ({limit.shown(crush.measured)} at its condition, by the CAE model)"
    told = f"{second} crush ({limit.limits}), said to be met, {words}, counts as right."
    for sentences in (change_sentences(Changes.of(beside)), summary(beside), beside_matrix(beside)):
        assert f"Where a test was run decides whether its verdict came true: {told}" in sentences
    assert f"{second} {words}" in shown_changes(Changes.of(beside))["Measured since"].tolist()
    (row,) = changes_table(Changes.of(beside)).query("test != '' and criterion == 'crush'").to_dict("records")
    assert row["measured"] + row["shift"] == pytest.approx(raw["max_crush"])
