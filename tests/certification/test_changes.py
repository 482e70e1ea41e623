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
from crashfuse.certification.changes import Changes, saved_and_missed
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.earlier import Earlier, parse_earlier
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import EarlierVerdict, Word
from crashfuse.errors import DataError
from crashfuse.execution.cache import Cache
from crashfuse.reporting.certification_facts import exceptions, facts, planned, sentences
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.certification_tables import SHOWN, changes_table
from crashfuse.reporting.plots.display import DEFAULT
from crashfuse.reporting.report.certification import certification_report
from crashfuse.signals.metrics import metric_values
from crashfuse.signals.occupant import OccupantModel
from crashfuse.study.config import StudyConfig
from crashfuse.units import KPH, MPH
from tests.golden import assert_golden

pytestmark = pytest.mark.usefixtures("one_cache")

CRUSH, PEAK = Criterion("crush", "max_crush", at_most=430.0), Criterion("peak", "peak", at_most=25.0)
GOOD = Criterion("good", "rating", at_least=0.5, window_ms=60.0)
MET, MISSED = EarlierVerdict("met", 0.97, 100.0, 425.0), EarlierVerdict("not met", 0.02, 26.0, 27.0)
OPEN, NARROW = EarlierVerdict("open", 0.6, 10.0, 500.0), EarlierVerdict("open", 0.5, 1.0, 2.0)
SURE = EarlierVerdict("met", 0.99, 1.0, 2.0)
TIGHT = Criteria((replace(PEAK, at_most=1e-4),), 0.8)
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
    same = {"tests": tests, "run": {}, "verdicts": tuple(rows), "digest": "0" * 64, "date": "2026-11-24 12:00 UTC"}
    of = replace(read, **{**same, **others})
    met = {i for i, row in of.rows.items() if {verdict.word for verdict in row} == {"met"}}
    return replace(of, waived=tuple(i for i in of.matrix.ids if i in met - of.run.keys()))


def compared(before: Earlier, today: Certification) -> Changes:
    """Today's certification beside an earlier one."""
    return Changes.of(today.beside(before))


def alike(later: Certification, *verdicts: EarlierVerdict) -> list[Row]:
    """All criteria alike, a verdict a condition; the first one at all others."""
    first, *others = verdicts
    n = len(later.matrix.ids) - len(others)
    return [(verdict,) * 3 for verdict in (*[first] * n, *others)]


def values(certification: Certification, code: str) -> list[dict[str, Any]]:
    """The values of the facts of a code."""
    return [dict(fact.values) for fact in facts(certification) if fact.code == code]


def measured(later: Certification, test: str) -> dict[str, float]:
    """The metrics of a test."""
    return {metric.name: metric.value or 0.0 for metric in later.campaign.metrics_of(later.campaign.test(test))}


def moved(certification: Certification, off_kph: float, *tests: str) -> Certification:
    """The same of tests that were run a little faster."""

    def condition(one: Any) -> Any:
        return replace(one.condition, speed_mps=one.condition.speed_mps + off_kph * KPH)

    campaign = certification.campaign
    new = tuple(replace(one, condition=condition(one)) if one.id in tests else one for one in campaign.tests)
    return replace(certification, campaign=replace(campaign, tests=new))


def of(later: Certification, campaign: Campaign) -> Certification:
    """The same verdicts from another campaign, which may lack some tests."""
    judged, verdicts = (
        tuple(
            tuple(replace(v, run={t: shown for t, shown in v.run.items() if t in campaign.test_ids}) for v in row)
            for row in rows
        )
        for rows in (later.judged, later.verdicts)
    )
    return replace(later, campaign=campaign, judged=judged, verdicts=verdicts)


def fastest_of(campaign: Campaign) -> str:
    """Id of the fastest test."""
    return max(campaign.tests, key=lambda test: test.condition.speed_mps).id


def test_all_sentences_are_those_that_were_read(later: Certification) -> None:
    """Of an earlier certification that was wrong, one whose intervals were too narrow, and one made otherwise."""
    first, second, *_ = later.campaign.test_ids
    wrong = earlier(later, alike(later, MET, MISSED))
    run = {f"at {second}": {second: {"crush": 1e4, "peak": 1.0, "good": 0.1}}}
    gone = earlier(later, alike(later, MET), *later.campaign.test_ids, run=run)
    settings = {**wrong.settings, "seed": "7", "occupant model": "100 + 200 mm"}
    off = moved(later, 0.9, second)
    lines: dict[str, None] = {}
    for name, own in (
        ("wrong verdicts", later.beside(wrong)),
        ("intervals too narrow", later.beside(earlier(later, alike(later, NARROW)))),
        (
            "made otherwise, a test gone",
            later.beside(replace(wrong, settings=settings, tests={**wrong.tests, "X": "x"})),
        ),
        ("other limits", later.beside(earlier(later, [(SURE,)] * len(later.matrix.ids), criteria=TIGHT))),
        ("a test that is not used any more", of(later, later.campaign.without([second])).beside(gone)),
        ("off its condition", off.beside(earlier(off, alike(later, MET), first))),
    ):
        told = (fact for fact in facts(own) if fact.code.startswith(("since", "test.not_used")))
        lines |= dict.fromkeys((f"# {name}", *(f"{fact.code}: {fact.sentence}" for fact in told)))
    assert_golden("certification_since", lines)


def outcomes(changes: Changes) -> tuple[int, int, int]:
    """Verdicts on tests run since, the wrong ones, and the tests."""
    (wrong, n), (_, tests) = changes.outcomes.values()
    return n, wrong, tests


def test_a_certification_beside_itself_says_that_nothing_changed(later: Certification) -> None:
    """Read from its own file: all verdicts as they were, and no test since."""
    beside = later.beside(parse_earlier(certification_json(later)))
    changes, n = Changes.of(beside), len(later.cells)
    assert [before for _, before, _ in changes.compared] == [
        EarlierVerdict(own.word, own.probability, own.lower, own.upper) for _, own in later.cells
    ]
    assert (changes.since.new, changes.since.gone, changes.tested, outcomes(changes)) == ((), (), {}, (0, 0, 0))
    assert SHOWN["changes"](beside, DEFAULT).empty
    assert values(beside, "since.compared") == [{"both": n, "same": n, "gained": 0, "lost": 0, "gone": 0, "added": 0}]
    assert not values(beside, "since.settings")


@pytest.mark.parametrize(("word", "wrong"), [("met", True), ("not met", False)])
def test_a_test_run_since_tells_whether_a_verdict_came_true(later: Certification, word: Word, wrong: bool) -> None:
    """By what was measured, against the limit; an open verdict is neither right nor wrong."""
    tests, fastest = later.campaign.test_ids, fastest_of(later.campaign)
    found = measured(later, fastest)
    assert found["peak"] > 25
    rows = [(OPEN, OPEN, OPEN)] * len(later.matrix.ids)
    rows[tests.index(fastest)] = (OPEN, EarlierVerdict(word, 0.5, 0.0, 1.0), MET)
    beside = later.beside(earlier(later, rows, *(test for test in tests if test != fastest)))
    changes = Changes.of(beside)
    assert changes.since.new == (fastest,)
    assert changes.tested == {f"at {fastest}": (fastest,)}
    assert outcomes(changes) == (1, int(wrong), 1)
    assert changes.record.intervals == (int(10 <= found["max_crush"] <= 500), 2)
    (row,) = changes_table(beside).query("came_true != ''").to_dict("records")
    assert (row["id"], row["criterion"], row["came_true"]) == (f"at {fastest}", "peak", not wrong)
    assert row["measured"] == pytest.approx(found["peak"])
    assert values(beside, "since.wrong") == [{"test": fastest, "criterion": "peak", "said": "met"}] * wrong
    assert (SHOWN["changes"](beside, DEFAULT)["Came true"].iloc[0] == f"{fastest} NO") is wrong


def test_two_limits_or_conditions_alike_are_one_metric_of_a_test(later: Certification) -> None:
    """Or a criterion written twice would make a record; a wrong one counts."""
    n, first = len(later.matrix.ids), later.campaign.test_ids[0]
    loose = replace(PEAK, name="loose", at_most=1000.0)
    before = earlier(later, [(OPEN, MET, MET)] * n, criteria=Criteria((CRUSH, PEAK, loose), 0.8))
    peaks = [measured(later, test)["peak"] for test in later.campaign.test_ids if test != first]
    wrong = sum(peak > 25.0 for peak in peaks)
    assert outcomes(compared(before, later)) == (len(peaks), wrong, len(peaks))
    last = later.matrix.conditions[-2]
    conditions = (*later.matrix.conditions, replace(last, speed_mps=last.speed_mps * 1.001))
    twice = replace(later.matrix, ids=(*later.matrix.ids, "beside"), conditions=conditions)
    before = replace(before, matrix=twice, verdicts=((OPEN, MET, MET),) * (n + 1))
    assert outcomes(compared(before, later)) == (len(peaks), wrong, len(peaks))


def test_of_conditions_that_needed_no_test_it_is_told_what_was_missed_and_what_is_unknown(later: Certification) -> None:
    """That answer is what a test is saved by; one that was not met is none, and a short record tells nothing."""
    first, second, *others = later.campaign.test_ids
    whole = later.campaign.test(second)
    short = replace(whole, pulse=replace(whole.pulse, accel_mps2=np.full(1250, -1.0)))
    campaign = replace(later.campaign, tests=tuple(short if t.id == second else t for t in later.campaign.tests))
    beside = replace(later, campaign=campaign).beside(earlier(later, alike(later, MET, MISSED)))
    outcomes = Changes.of(beside).waived_outcomes
    assert outcomes[f"at {second}"] == {second: ((), ("crush",))}
    for test in others:
        missed = tuple(own.name for own in (CRUSH, PEAK) if not own.is_met_by(measured(later, test)[own.metric]))
        assert outcomes[f"at {test}"] == {test: (missed, ())}
    assert f"at {first}" not in outcomes
    told = values(beside, "since.waived_outcome")
    assert {"condition": f"at {second}", "test": second, "missed": (), "unknown": ("crush",)} in told
    n, missed_any = saved_and_missed(beside)
    counts = json.loads(certification_json(beside))["track_record"]["waived_with_those_since"]
    assert (counts["n"], counts["wrong"]) == (n, missed_any)
    assert missed_any > 0


def test_a_record_is_known_by_its_content(later: Certification) -> None:
    """Under another id it is no new test; another vehicle's file is refused."""
    campaign, (first, second, *_) = later.campaign, later.campaign.test_ids
    before = earlier(later, alike(later, OPEN), first, second)
    renamed = replace(campaign.test(second), id="renamed")
    others = tuple(test for test in campaign.tests if test.id != second)
    same = replace(later, campaign=replace(campaign, tests=(*others, renamed)))
    assert "renamed" not in compared(before, same).since.new
    with pytest.raises(DataError, match="a certification of this campaign, found one of Tiny"):
        compared(replace(before, tests={"X1": "of another vehicle"}), later)


def test_a_record_that_was_retouched_is_no_test_since(later: Certification) -> None:
    """The earlier certification had learned from it: what it shows proves nothing. A new filter class changes all."""
    campaign = later.campaign
    before = earlier(later, alike(later, MET), *campaign.test_ids)
    louder = tuple(
        replace(test, pulse=replace(test.pulse, accel_mps2=1.1 * test.pulse.accel_mps2)) for test in campaign.tests
    )
    for tests in ((louder[0], *campaign.tests[1:]), louder):
        changes = compared(before, replace(later, campaign=replace(campaign, tests=tests)))
        assert changes.since.changed == tuple(test.id for test in tests if test in louder)
        assert (changes.since.new, changes.since.gone, outcomes(changes)) == ((), (), (0, 0, 0))
    filtered = {**before.settings, "CAE runs": "24, another fingerprint"}
    assert compared(replace(before, settings=filtered), changes.later).since.changed == campaign.test_ids
    with pytest.raises(DataError):  # of another name, beside other CAE runs, an id is not enough
        compared(replace(before, settings={**filtered, "campaign": "Coupe"}), changes.later)


@pytest.mark.parametrize(("off_kph", "counts"), [(0.95, True), (1.1, False)])
def test_a_test_is_made_for_the_nearest_condition_though_a_little_off(
    later: Certification, off_kph: float, counts: bool
) -> None:
    """To 1 km/h and 2 %; one made for none tells nothing."""
    others = later.campaign.test_ids[1:]
    since = compared(earlier(later, alike(later, MET)), moved(later, off_kph, *others)).since
    assert since.at == ({test: f"at {test}" for test in others} if counts else {})
    assert since.elsewhere == (() if counts else others)


def test_verdicts_are_dated_against_their_tests(later: Certification) -> None:
    """By the dates of both; a later certification keeps when, and under which key, a verdict was given."""
    stated = {"T2": "2026-11-25", "T3": "2026-11-24", "T4": "in spring"}
    tests = tuple(
        replace(test, about=(("about_date", stated[test.id]),) if test.id in stated else ())
        for test in later.campaign.tests
    )
    dated = replace(later, campaign=replace(later.campaign, tests=tests))
    before = replace(earlier(dated, alike(dated, MET), "T1"), sealed="ab12")
    beside = dated.beside(before)
    groups = {fact["older"]: fact["tests"] for fact in values(beside, "since.dated")}
    assert groups == {True: ["T2"], False: ["T3"], None: ["T4"]}
    for key in ("cd34", ""):  # what is not sealed itself may say anything
        again = parse_earlier(certification_json(beside), sealed=key)
        assert {trial.given for trial in again.trials} == {(before.date, "ab12" if key else "")}


def test_of_tests_that_were_tuned_to_only_what_was_wrong_before_counts(later: Certification) -> None:
    """So that tuning hides no mistake, and no right verdict rests on it."""
    tuned = tuple(replace(test, cae_tuned=True) for test in later.campaign.tests)
    before = earlier(later, alike(later, MET), "T1")
    found = replace(later, campaign=replace(later.campaign, tests=tuned)).beside(before)
    assert found.since is not None
    assert {trial.wrong for trial in found.since.all_trials} == {False, True}
    assert found.record.since == tuple(t for t in later.beside(before).record.since if t.wrong)


def test_a_repeat_of_a_test_that_was_known_counts_for_nothing(later: Certification) -> None:
    """Its verdict was given by one who had seen the answer."""
    first, second, *_ = later.campaign.test_ids
    known = {f"at {second}": {first: {"crush": 1.0}}}
    without, beside = (compared(earlier(later, alike(later, MET), run=run), later) for run in ({}, known))
    assert beside.since.repeats == {second: f"at {second}"}
    assert (without.outcomes["tests"].n, beside.outcomes["tests"].n) == (3, 2)


def test_metrics_are_measured_as_they_were_then(later: Certification) -> None:
    """An occupant model that was changed since makes no verdict on OLC wrong."""
    olc, first = Criterion("olc", "olc", at_most=1000.0), later.campaign.test_ids[0]
    before = earlier(later, [(MET,)] * len(later.matrix.ids), criteria=Criteria((olc,), 0.8))
    stiffer = replace(later.campaign, occupant=OccupantModel(olc_free_flight_mm=30.0))
    then, now = compared(before, later), compared(before, replace(later, campaign=stiffer))
    showed = [cell.measured for cell in then.cells if cell.before]
    assert any(showed)
    assert [cell.measured for cell in now.cells if cell.before] == showed
    assert f"at {first}" not in now.tested


def all_right(later: Certification) -> TrackRecord:
    """The record as if every verdict in it had been right."""
    trials = later.record.trials
    return TrackRecord(
        tuple(replace(t, verdict=replace(t.verdict, word="met" if t.met else "not met")) for t in trials)
    )


def test_wrong_verdicts_of_then_take_support_from_those_of_today(later: Certification) -> None:
    """They are the strongest evidence that there is; a test that is left out as well counts once."""
    right, n = all_right(later), len(later.matrix.ids)
    sure, loose = replace(later, record=right), Criteria((replace(PEAK, at_most=1e4),), 0.8)
    for criteria, wrong in ((loose, 0), (TIGHT, 3)):
        beside = sure.beside(earlier(later, [(SURE,)] * n, criteria=criteria))
        own, before = beside.record.support(PEAK), right.support(PEAK)
        assert (own.own_decided, own.own_wrong) == (before.own_decided, wrong)  # one a test, the wrong one if any is
        assert (own.confidence < before.confidence) is (wrong > 0)
    assert right.counts() == beside.record.counts()  # of left-out tests alone
    unsure = [(EarlierVerdict("met", 0.7, 1.0, 2.0),)] * n
    assert sure.beside(earlier(later, unsure, criteria=TIGHT)).record.support(PEAK) == right.support(PEAK)


def test_a_certification_in_between_forgets_no_wrong_verdict(later: Certification) -> None:
    """Its file holds what those before it had said of tests that were run since."""
    between = later.beside(earlier(later, [(SURE,)] * len(later.matrix.ids), criteria=TIGHT))
    again = later.beside(parse_earlier(certification_json(between)))
    assert again.since is not None
    assert again.since.new == ()
    assert again.record.support(PEAK) == between.record.support(PEAK) != later.record.support(PEAK)
    assert Changes.of(again).outcomes_before == {"verdicts": (3, 3), "tests": (3, 3)}
    assert Changes.of(again).waived_outcomes == Changes.of(between).waived_outcomes != {}
    assert [own["criterion"] for own in values(again, "since.wrong")] == ["peak"] * 3
    third = later.beside(parse_earlier(certification_json(again)))
    assert third.record.support(PEAK) == between.record.support(PEAK)


def test_a_test_that_is_not_used_any_more_is_not_forgotten(later: Certification) -> None:
    """What it had shown is held against today's verdicts on the same metric, whatever the limit was."""
    second = later.campaign.test_ids[1]
    place, campaign = f"at {second}", later.campaign.without([second])
    kept = tuple(tuple(replace(own, run={}, word="met") for own in row) for row in later.judged)
    today = replace(later, campaign=campaign, judged=kept, record=all_right(later))
    run = {place: {second: {"crush": 1e4, "peak": 1.0, "good": 0.1}}}
    beside = today.beside(earlier(later, alike(later, MET), *later.campaign.test_ids, run=run))
    again = today.beside(parse_earlier(certification_json(beside)))  # beside one that is beside one that used the test
    assert again.since is not None
    assert again.since.gone == ()
    for own in (beside, again):
        crush, peak, good = own.rows[place]
        assert (crush.word, peak.word) == ("open", "met")
        assert "not used any more, missed it there with 1.000e+04 mm." in crush.reason
        assert "met it there" in peak.reason
        assert second not in good.reason  # a rating was another prediction's
        (told,) = values(own, "test.not_used")
        assert told["test"] == second
        assert "crush" in told["missed"]


def test_a_record_that_was_replaced_under_its_id_is_not_forgotten(later: Certification) -> None:
    """What the test had shown stands against the verdict there, whatever was put in its place; so in the next one."""
    second = later.campaign.test_ids[1]
    pulses = [replace(own.pulse, accel_mps2=0.98 * own.pulse.accel_mps2) for own in later.campaign.tests]
    soft = [replace(own, pulse=pulse) for own, pulse in zip(later.campaign.tests, pulses, strict=True)]
    place = f"at {second}"
    tests = tuple(new if new.id == second else old for new, old in zip(soft, later.campaign.tests, strict=True))
    today = replace(later, campaign=replace(later.campaign, tests=tests))
    run = {place: {second: {"crush": 1e4, "peak": 1.0, "good": 0.1}}}
    before = earlier(later, alike(later, MET), *later.campaign.test_ids, run=run)
    beside = today.beside(before)
    for own in (beside, today.beside(parse_earlier(certification_json(beside)))):
        assert "not used any more, missed it there with 1.000e+04 mm" in own.rows[place][0].reason
        assert f"run as {second} with another record, not used" in " ".join(row.why for row in planned(own))
    everything = replace(later, campaign=replace(later.campaign, tests=tuple(soft))).beside(before)
    assert "record of then" not in everything.rows[place][0].reason  # another filter class changes every record


def test_answers_that_were_gained_and_withdrawn_are_listed_by_the_ids_of_today(later: Certification) -> None:
    """With what stands against them; a condition that was run since is neither. By other limits only what both have."""
    row, record = later.judged[-1], all_right(later)

    def today(*words: Word, probability: float = 1.0) -> Certification:
        own = tuple(replace(v, word=word, probability=probability) for v, word in zip(row, words, strict=True))
        return replace(later, judged=(*later.judged[:-1], own), record=record)

    renamed = replace(later.matrix, ids=tuple(f"x{i}" for i in later.matrix.ids))
    needed, waived = (earlier(later, alike(later, OPEN, last), matrix=renamed) for last in (OPEN, MET))
    gained, lost = (compared(needed, today("met", "met", "met")), compared(waived, today("open", "not met", "met")))
    assert (gained.newly_waived, gained.withdrawn) == (("slow",), {})
    assert lost.newly_waived == ()
    assert values(lost.later, "since.withdrawn") == [{"conditions": {"slow": "crush open, peak not met"}}]
    assert values(lost.later, "since.turned") == [{"conditions": {"slow (then xslow) (peak)": ""}}]
    unsure = compared(waived, today("met", "met", "met", probability=0.9))
    assert unsure.withdrawn == {"slow": ()}
    loose = Criteria((CRUSH, replace(PEAK, at_most=99.0), GOOD), 0.8)
    needed, waived = (earlier(later, alike(later, OPEN, last), criteria=loose) for last in (OPEN, MET))
    assert compared(needed, today("met", "met", "met")).newly_waived == ()
    lost = compared(waived, today("open", "not met", "met"))
    assert {i: [own.criterion.name for own in rest] for i, rest in lost.withdrawn.items()} == {"slow": ["crush"]}


def test_another_limit_or_condition_is_not_compared(later: Certification) -> None:
    """It is counted, and stands in the table beside nothing."""
    n = len(later.matrix.ids)
    slower = replace(later.matrix.conditions[-1], speed_mps=19 * MPH)
    matrix = replace(later.matrix, conditions=(*later.matrix.conditions[:-1], slower))
    criteria = Criteria((CRUSH, replace(PEAK, at_most=24.0), GOOD), 0.8)
    beside = later.beside(earlier(later, alike(later, OPEN), matrix=matrix, criteria=criteria))
    (told,) = values(beside, "since.compared")
    assert (told["both"], told["gone"], told["added"]) == (2 * (n - 1), n + 2, n + 2)
    table, shown = changes_table(beside), SHOWN["changes"](beside, DEFAULT)
    assert (table["earlier_verdict"] == "").sum() == n + 2
    there = table[table["earlier_id"] == "slow"].drop_duplicates("speed_mph")
    assert there[["id", "speed_mph"]].values.tolist() == [["", 19.0]]
    assert "slow (then)" in shown["Condition"].tolist()
    assert "not asked" in shown["Then"].tolist()


def test_what_became_of_it_stands_in_json_and_report(later: Certification) -> None:
    """With the whole digest of the earlier file; without an earlier one, nothing is said of it."""
    beside = later.beside(earlier(later, alike(later, MET)))
    changes, record = Changes.of(beside), json.loads(certification_json(beside))
    since, (n, wrong, tests) = record["since"], outcomes(changes)
    assert wrong > 0
    expected = {"metrics": n, "n": n, "tests": tests, "wrong": wrong, "wrong_at_most": since["bounds"]["verdicts"]}
    assert since["decided"] == {**expected, "tests_wrong": changes.outcomes["tests"].wrong}
    assert since["sha256"] == changes.earlier.digest
    assert since["sentences"] == [str(own) for own in sentences(beside, "changes")]
    assert "--since EARLIER" in record["command"]
    report = certification_report(beside)
    assert "<h2>Earlier verdicts, and what became of them</h2>" in report
    assert changes.earlier.digest in report
    assert "Earlier verdicts" not in certification_report(later)
    assert "since" not in json.loads(certification_json(later))


def test_intervals_that_were_missed_one_test_at_a_time_add_up(later: Certification) -> None:
    """Each step has one test more: the misses of all are told, as they would be in a single step."""
    first, *others = later.campaign.test_ids
    rows = [(OPEN, NARROW, OPEN)] * len(later.matrix.ids)
    at_once = compared(earlier(later, rows), later)
    kept, known = earlier(later, rows), [first]
    for test in others:
        known.append(test)
        some = later.campaign.without([other for other in later.campaign.test_ids if other not in known])
        step = of(later, some).beside(kept)
        kept = replace(parse_earlier(certification_json(step)), run={}, verdicts=tuple(rows))
        assert len(kept.before) == len(known) - 1
    again = Changes.of(later.beside(kept))
    assert again.record.intervals == at_once.record.intervals
    assert [{own.held_out for own in each.record.missed_intervals} for each in (again, at_once)] == [{*others}] * 2
    assert again.too_narrow


def test_reasons_and_names_in_braces_are_told_as_they_are(later: Certification) -> None:
    """They are a laboratory's words, no places for others."""
    second = later.campaign.test_ids[1]
    odd = replace(CRUSH, name="crush {A}")
    run = {f"at {second}": {second: {odd.name: 1e4}}}
    rows, criteria = [(MET,)] * len(later.matrix.ids), Criteria((odd,), 0.8)
    before = earlier(later, rows, *later.campaign.test_ids, criteria=criteria, run=run)
    unused = ((second, later.campaign.test(second).condition),)
    campaign = replace(later.campaign.without([second]), unused=unused, why_unused={second: "bracket {left} loose"})
    for own, name in ((of(later, campaign), ""), (of(later, campaign).beside(before), odd.name)):
        told = str(exceptions(own)["Tests that are not used"])
        assert "bracket {left} loose" in told
        assert name in told


def test_a_test_left_out_of_use_is_told_where_it_was_made_for_a_condition_though_a_little_off(
    later: Certification,
) -> None:
    """Nobody gets rid of what it showed by a speed that was not quite met."""
    second = later.campaign.test_ids[1]
    off = moved(later, 0.8, second).campaign.test(second).condition
    campaign = replace(later.campaign.without([second]), unused=((second, off),))
    found = of(later, campaign)
    assert values(found, "test.not_used") == [{"test": second}]
    assert str(off) in " ".join(map(str, exceptions(found)["Tests that are not used"]))
    assert f"run as {second}, not used" in " ".join(row.why for row in planned(found))


def test_what_one_test_alone_missed_is_no_sign_that_intervals_are_too_narrow(later: Certification) -> None:
    """Its metrics hang together."""
    _, second, *rest = later.campaign.test_ids
    today = of(later, later.campaign.without(rest))
    for own in (today, moved(today, 0.5, second)):
        beside = own.beside(earlier(later, [(NARROW, NARROW, OPEN)] * len(later.matrix.ids)))
        assert not values(beside, "since.too_narrow")
        assert values(beside, "since.intervals") == [{"inside": 0, "n": 2}]


def test_what_a_test_off_its_condition_measured_is_moved_there_as_the_cae_model_says(later: Certification) -> None:
    """By the emulator at both; the peak jumps, and stays. Where that decides, it is told, and the chain knows it."""
    second, *rest = later.campaign.test_ids[1:]
    here = later.campaign.test(second).condition
    today = moved(of(later, later.campaign.without(rest)), 0.9, second)
    off = today.campaign.test(second).condition
    emulator = CaeModel(cache=Cache()).fit(today.campaign.cae).emulator_
    there, planned = (float(metric_values(emulator.predict(c), c.speed_mps)["max_crush"]) for c in (off, here))
    raw = measured(today, second)
    limit = replace(CRUSH, at_most=raw["max_crush"] - 0.5 * (there - planned))
    before = earlier(later, alike(later, MET), criteria=Criteria((limit, PEAK, GOOD), 0.8))
    beside = today.beside(before)
    for own in (beside, today.beside(parse_earlier(certification_json(beside)))):
        assert own.since is not None
        crush, peak = own.since.all_trials
        assert crush.shift == pytest.approx(there - planned) != 0
        assert crush.measured + crush.shift == pytest.approx(raw["max_crush"])
        assert (crush.wrong, peak.shift) == (False, 0)
        assert peak.measured == pytest.approx(raw["peak"])
        assert values(own, "since.moved") == [{"test": second, "wrong": False, "shift": crush.shift}]
    words = f"{limit.shown(raw['max_crush'])} ({limit.shown(crush.measured)} at its condition, by the CAE model)"
    assert f"{second} {words}" in SHOWN["changes"](beside, DEFAULT)["Measured since"].tolist()
    (row,) = changes_table(beside).query("test != '' and criterion == 'crush'").to_dict("records")
    assert row["measured"] + row["shift"] == pytest.approx(raw["max_crush"])
