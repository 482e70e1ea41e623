"""Verdicts that were given before tests were run: right or wrong, what counts, and what nobody gets rid of."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Certification, certify_matrix
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.earlier import Earlier, parse_earlier
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.tested_since import TestedSince
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import EarlierVerdict, Word
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.reporting.certification_facts import exceptions, facts, outcomes, saved_and_missed, sentences
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.certification_tables import SHOWN, track_record_table
from crashfuse.reporting.plots.display import DEFAULT
from crashfuse.reporting.report.certification import certification_report
from crashfuse.reporting.verdicts import planned
from crashfuse.signals.metrics import metric_values
from crashfuse.signals.occupant import OccupantModel
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.study.config import StudyConfig
from crashfuse.units import KPH, MPH
from tests.conftest import not_none
from tests.golden import assert_golden

pytestmark = pytest.mark.usefixtures("one_cache")

CRUSH, PEAK = Criterion("crush", "max_crush", at_most=430.0), Criterion("peak", "peak", at_most=25.0)
GOOD = Criterion("good", "rating", at_least=0.5, window_ms=60.0)
MET, MISSED = EarlierVerdict("met", 0.97, 100.0, 425.0), EarlierVerdict("not met", 0.02, 26.0, 27.0)
OPEN, NARROW = EarlierVerdict("open", 0.6, 10.0, 500.0), EarlierVerdict("open", 0.5, 1.0, 2.0)
SURE = EarlierVerdict("met", 0.99, 1.0, 2.0)
TIGHT = Criteria((replace(PEAK, at_most=1e-4),), 0.8)


@pytest.fixture(scope="module")
def later(campaign: Campaign, shared_cache: Path) -> Certification:
    """Verdicts of the raw CAE model at the condition of each test, and at 20 mph."""
    conditions = [test.condition for test in campaign.tests]
    slow = replace(conditions[1], speed_mps=20 * MPH)
    matrix = Matrix((*(f"at {test}" for test in campaign.test_ids), "slow"), (*conditions, slow))
    config, criteria = StudyConfig(approaches=("cae",)), Criteria((CRUSH, PEAK, GOOD), 0.8)
    return certify_matrix(campaign, criteria, matrix, config, Run(Cache(shared_cache)))


def earlier(
    later: Certification, said: EarlierVerdict | Sequence[EarlierVerdict], *known: str, **others: Any
) -> Earlier:
    """A certification that said this of every condition, from these tests, or from the first alone."""
    read, first = parse_earlier(certification_json(later)), later.campaign.test_ids[0]
    tests = {test: read.tests[test] for test in known or (first,)}
    criteria, matrix = others.get("criteria", read.criteria), others.get("matrix", read.matrix)
    row = (said,) * len(criteria.items) if isinstance(said, EarlierVerdict) else tuple(said)
    same = {"tests": tests, "run": {}, "verdicts": (row,) * len(matrix.ids), "digest": "0" * 64}
    of = replace(read, **{**same, "date": "2026-11-24 12:00 UTC", **others})
    waived = of.matrix.ids if {verdict.word for verdict in row} == {"met"} else ()
    return replace(of, waived=tuple(i for i in waived if i not in of.run))


def since(certification: Certification, before: Earlier) -> TestedSince:
    """The tests of a certification beside an earlier one."""
    return not_none(certification.beside(before).since)


def again(certification: Certification, today: Certification) -> Certification:
    """One that is beside the file of a certification."""
    return today.beside(parse_earlier(certification_json(certification)))


def values(certification: Certification, code: str) -> list[dict[str, Any]]:
    """The values of the facts of a code, and what they are about."""
    return [{"about": fact.about, **fact.values} for fact in facts(certification) if fact.code == code]


def measured(later: Certification, test: str) -> dict[str, float]:
    """The metrics of a test."""
    return {metric.name: metric.value or 0.0 for metric in later.campaign.metrics_of(later.campaign.test(test))}


def changed(certification: Certification, change: Callable[[CrashTest], CrashTest], *tests: str) -> Certification:
    """The same with some tests changed."""
    campaign = certification.campaign
    new = tuple(change(one) if one.id in tests else one for one in campaign.tests)
    return replace(certification, campaign=replace(campaign, tests=new))


def moved(certification: Certification, off_kph: float, *tests: str) -> Certification:
    """The same of tests that were run a little faster."""

    def faster(one: CrashTest) -> CrashTest:
        return replace(one, condition=replace(one.condition, speed_mps=one.condition.speed_mps + off_kph * KPH))

    return changed(certification, faster, *tests)


def louder(certification: Certification, factor: float, *tests: str) -> Certification:
    """The same with other records of these tests."""

    def scaled(one: CrashTest) -> CrashTest:
        return replace(one, pulse=replace(one.pulse, accel_mps2=factor * one.pulse.accel_mps2))

    return changed(certification, scaled, *tests)


def of(later: Certification, campaign: Campaign) -> Certification:
    """The same verdicts, as if no test was at a condition, from a campaign that may lack some."""
    judged, verdicts = ([[replace(v, run={}) for v in row] for row in rows] for rows in (later.judged, later.verdicts))
    return replace(later, campaign=campaign, judged=tuple(map(tuple, judged)), verdicts=tuple(map(tuple, verdicts)))


def test_all_sentences_are_those_that_were_read(later: Certification) -> None:
    """Of an earlier certification that was wrong, one whose intervals were too narrow, and of a test that is gone."""
    first, second, *_ = later.campaign.test_ids
    run = {f"at {second}": {second: {"crush": 1e4, "peak": 1.0, "good": 0.1}}}
    gone = earlier(later, MET, *later.campaign.test_ids, run=run)
    off = moved(later, 0.9, second)
    lines: dict[str, None] = {}
    for name, own in (
        ("wrong verdicts", later.beside(earlier(later, MET))),
        ("intervals too narrow, a repeat", later.beside(earlier(later, NARROW, run={f"at {second}": {}}))),
        ("other limits", later.beside(earlier(later, SURE, criteria=TIGHT))),
        ("a test that is not used any more", of(later, later.campaign.without([second])).beside(gone)),
        ("off its condition", off.beside(earlier(off, MET, first))),
    ):
        told = (fact for fact in facts(own) if fact.code.startswith(("since", "test.not_used")))
        lines |= dict.fromkeys((f"# {name}", *(f"{fact.code}: {fact.sentence}" for fact in told)))
    assert_golden("certification_since", lines)


@pytest.mark.parametrize(("word", "wrong"), [("met", True), ("not met", False)])
def test_a_test_run_since_tells_whether_a_verdict_came_true(later: Certification, word: Word, wrong: bool) -> None:
    """By what was measured, against the limit: an open verdict is neither; in tables, JSON and the report."""
    *known, fastest = sorted(later.campaign.tests, key=lambda test: test.condition.speed_mps)
    found = measured(later, fastest.id)
    assert found["peak"] > 25
    said = (OPEN, EarlierVerdict(word, 0.9, 0.0, 1.0), MET)
    beside = later.beside(earlier(later, said, *(test.id for test in known)))
    own, share = not_none(beside.since), (int(wrong), 1)
    assert (own.new, outcomes(own)) == ((fastest.id,), {"verdicts": share, "tests": share})
    assert TrackRecord(own.with_intervals).intervals == (int(10 <= found["max_crush"] <= 500), 2)
    table = track_record_table(beside).query("left_out == 'planned' and criterion == 'peak'")
    assert (table["verdict"].item(), table["met"].item()) == (word, False)
    assert table["measured"].item() == pytest.approx(found["peak"])
    told = [(own["about"], own["criterion"], own["said"]) for own in values(beside, "since.wrong")]
    assert told == [((fastest.id,), "peak", "met")] * wrong
    assert SHOWN["since"](beside, DEFAULT)["The test"].tolist()[1] == "missed it" + ", wrong" * wrong
    record, report = json.loads(certification_json(beside)), certification_report(beside)
    assert (record["since"]["decided"]["wrong"], record["since"]["decided"]["tests"]) == share
    assert record["since"]["sentences"] == [str(one) for one in sentences(beside, "since")]
    assert "--since EARLIER" in record["command"]
    assert own.earlier.digest in report
    assert "<h2>Earlier verdicts, and what became of them</h2>" in report
    assert "Earlier verdicts" not in certification_report(later)
    assert "since" not in json.loads(certification_json(later))


def test_two_limits_or_conditions_alike_are_one_metric_of_a_test(later: Certification) -> None:
    """Or a criterion written twice would make a record; a wrong one counts."""
    first, *others = later.campaign.test_ids
    loose, last = replace(PEAK, name="loose", at_most=1000.0), later.matrix.conditions[-2]
    conditions = (*later.matrix.conditions, replace(last, speed_mps=last.speed_mps * 1.001))
    twice = replace(later.matrix, ids=(*later.matrix.ids, "beside"), conditions=conditions)
    wrong = sum(measured(later, test)["peak"] > 25.0 for test in others)
    criteria = Criteria((CRUSH, PEAK, loose), 0.8)
    for matrix in (later.matrix, twice):
        found = since(later, earlier(later, (OPEN, MET, MET), first, criteria=criteria, matrix=matrix))
        assert outcomes(found) == {"verdicts": (wrong, len(others)), "tests": (wrong, len(others))}


def test_a_test_where_none_was_needed_saved_or_missed(later: Certification) -> None:
    """By what it measured; a record that is too short saves nothing, nor does one where a rating is unknown."""
    second, *others = later.campaign.test_ids[1:]
    short = Pulse(GRID_S, np.full(1250, -1.0))
    criteria = Criteria((CRUSH, replace(PEAK, at_most=30.0)), 0.8)
    today = changed(later, lambda test: replace(test, pulse=short), second)
    beside = today.beside(earlier(later, MET, criteria=criteria))
    limits = {test: (measured(later, test)["max_crush"] > 430, measured(later, test)["peak"] > 30) for test in others}
    found = not_none(beside.since).waived
    assert found == {test: any(missed) for test, missed in limits.items()}  # not the short one
    assert saved_and_missed(beside) == (len(found), sum(found.values()))
    counts = json.loads(certification_json(beside))["track_record"]["waived_with_those_since"]
    assert (counts["n"], counts["wrong"]) == saved_and_missed(beside)
    rated = since(later, earlier(later, MET, criteria=Criteria((*criteria.items, GOOD), 0.8))).waived
    assert set(rated.values()) == {True}
    assert since(later, earlier(later, (MET, MISSED), criteria=criteria)).waived == {}


def test_a_record_is_known_by_its_content(later: Certification) -> None:
    """Under another id it is no new test, nor is any beside its own file; another vehicle's file is refused."""
    first, second, *_ = later.campaign.test_ids
    before = earlier(later, OPEN, first, second)
    assert "renamed" not in since(changed(later, lambda test: replace(test, id="renamed"), second), before).new
    own = not_none(again(later, later).since)
    assert (own.new, own.gone, own.trials) == ((), (), ())
    with pytest.raises(DataError, match="a certification of this campaign, found one of Tiny"):
        since(later, replace(before, tests={"X1": "of another vehicle"}))


def test_a_record_that_was_retouched_is_no_test_since(later: Certification) -> None:
    """The earlier certification had learned from it: what it shows proves nothing. A new filter class changes all."""
    ids = later.campaign.test_ids
    before = earlier(later, MET, *ids)
    filtered = {**before.settings, "CAE runs": "24, another fingerprint"}
    for some in (ids[:1], ids):
        found = since(louder(later, 1.1, *some), before)
        assert (found.changed, found.new, found.gone, found.trials) == (some, (), (), ())
    assert since(louder(later, 1.1, *ids), replace(before, settings=filtered)).changed == ids
    with pytest.raises(DataError):  # of another name, beside other CAE runs, an id is not enough
        since(louder(later, 1.1, *ids), replace(before, settings={**filtered, "campaign": "Coupe"}))


@pytest.mark.parametrize(("off_kph", "counts"), [(0.95, True), (1.1, False)])
def test_a_test_is_made_for_the_nearest_condition_though_a_little_off(
    later: Certification, off_kph: float, counts: bool
) -> None:
    """To 1 km/h and 2 %; one made for none tells nothing."""
    others = later.campaign.test_ids[1:]
    found = since(moved(later, off_kph, *others), earlier(later, MET))
    assert found.made_for == ({test: f"at {test}" for test in others} if counts else {})
    assert bool(found.trials) is counts


def test_what_a_test_off_its_condition_measured_is_moved_there_as_the_cae_model_says(later: Certification) -> None:
    """By the emulator at both; the peak jumps, and stays. The chain knows it."""
    second, *rest = later.campaign.test_ids[1:]
    here = later.campaign.test(second).condition
    today = moved(of(later, later.campaign.without(rest)), 0.9, second)
    off, raw = today.campaign.test(second).condition, measured(today, second)
    emulator = CaeModel().fit(today.campaign.cae, Run()).emulator_
    there, planned = (float(metric_values(emulator.predict(c), c.speed_mps)["max_crush"]) for c in (off, here))
    limit = replace(CRUSH, at_most=raw["max_crush"] - 0.5 * (there - planned))
    beside = today.beside(earlier(later, MET, criteria=Criteria((limit, PEAK, GOOD), 0.8)))
    for own in (beside, again(beside, today)):
        crush, peak = not_none(own.since).trials
        assert crush.shift == pytest.approx(there - planned) != 0
        assert crush.measured + crush.shift == pytest.approx(raw["max_crush"])
        assert (crush.wrong, peak.shift) == (False, 0)
        assert peak.measured == pytest.approx(raw["peak"])
        words = f"{limit.shown(raw['max_crush'])} ({limit.shown(crush.measured)} at its condition, by the CAE model)"
        assert words in [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in SHOWN["since"](own, DEFAULT)["Measured"]]


def test_what_does_not_count(later: Certification) -> None:
    """Right verdicts on tests that the CAE model was tuned to; any on repeats, whose answer had been seen."""
    first, second, *_ = later.campaign.test_ids
    before = earlier(later, MET)
    found = since(changed(later, lambda test: replace(test, cae_tuned=True), *later.campaign.test_ids), before)
    assert {trial.wrong for trial in found.trials} == {False, True}
    assert found.counted == tuple(trial for trial in since(later, before).counted if trial.wrong)
    seen = since(later, earlier(later, MET, run={f"at {second}": {first: {"crush": 1.0}}}))
    assert {trial.held_out for trial in seen.trials} == {*later.campaign.test_ids} - {first, second}


def test_metrics_are_measured_as_they_were_then(later: Certification) -> None:
    """An occupant model that was changed since makes no verdict on OLC wrong."""
    before = earlier(later, MET, criteria=Criteria((Criterion("olc", "olc", at_most=1000.0),), 0.8))
    stiffer = replace(later.campaign, occupant=OccupantModel(olc_free_flight_mm=30.0))
    then, now = (since(own, before) for own in (later, replace(later, campaign=stiffer)))
    assert [trial.measured for trial in now.trials] == [trial.measured for trial in then.trials] != []


def all_right(later: Certification) -> TrackRecord:
    """The record as if every verdict in it had been right."""
    trials = later.record.trials
    return TrackRecord(
        tuple(replace(t, verdict=replace(t.verdict, word="met" if t.met else "not met")) for t in trials)
    )


def test_wrong_verdicts_of_then_take_support_from_those_of_today(later: Certification) -> None:
    """They are the strongest evidence that there is; a test that is left out as well counts once."""
    right = all_right(later)
    sure, loose = replace(later, record=right), Criteria((replace(PEAK, at_most=1e4),), 0.8)
    for criteria, wrong in ((loose, 0), (TIGHT, 3)):
        beside = sure.beside(earlier(later, SURE, criteria=criteria))
        own, before = beside.record.support(PEAK), right.support(PEAK)
        assert (own.own_decided, own.own_wrong) == (before.own_decided, wrong)  # one a test, the wrong one if any is
        assert (own.confidence < before.confidence) is (wrong > 0)
    assert right.counts() == beside.record.counts()  # of left-out tests alone
    unsure = earlier(later, EarlierVerdict("met", 0.7, 1.0, 2.0), criteria=TIGHT)
    assert sure.beside(unsure).record.support(PEAK) == right.support(PEAK)


def test_a_certification_in_between_forgets_nothing(later: Certification) -> None:
    """Its file holds what those before it had said of tests that were run since."""
    between = later.beside(earlier(later, SURE, criteria=TIGHT))
    support, waived = between.record.support(PEAK), not_none(between.since).waived
    assert support != later.record.support(PEAK)
    assert waived
    for own in (second := again(between, later), again(second, later)):
        assert not_none(own.since).new == ()
        assert (own.record.support(PEAK), not_none(own.since).waived) == (support, waived)
        assert [one["criterion"] for one in values(own, "since.wrong")] == ["peak"] * 3


def test_what_one_test_alone_missed_is_no_sign_that_intervals_are_too_narrow(later: Certification) -> None:
    """Its metrics hang together."""
    _, second, *rest = later.campaign.test_ids
    today = of(later, later.campaign.without(rest))
    for own in (today, moved(today, 0.5, second)):
        beside = own.beside(earlier(later, NARROW))
        assert not values(beside, "since.too_narrow")
        assert [(own["inside"], own["n"]) for own in values(beside, "since.intervals")] == [(0, 2)]


@pytest.mark.parametrize("way", ["gone", "replaced"])
def test_what_a_test_showed_that_is_not_used_any_more_is_not_forgotten(later: Certification, way: str) -> None:
    """Out of use or with another record under its id: it is held against today's verdicts, now and in the next one."""
    second = later.campaign.test_ids[1]
    place, run = f"at {second}", {f"at {second}": {second: {"crush": 1e4, "peak": 1.0, "good": 0.1}}}
    before = earlier(later, MET, *later.campaign.test_ids, run=run)
    kept = tuple(tuple(replace(own, run={}, word="met") for own in row) for row in later.judged)
    without = of(later, later.campaign.without([second])) if way == "gone" else louder(later, 0.98, second)
    today = replace(without, judged=kept, record=all_right(later))
    for own in (beside := today.beside(before), again(beside, today)):
        crush, peak, good = own.rows[place]
        assert (crush.word, peak.word) == ("open", "met")
        assert "not used any more, missed it there with 1.000e+04 mm." in crush.reason
        assert "met it there" in peak.reason
        assert "of then" not in good.reason  # a rating was another prediction's
        (told,) = values(own, "test.not_used")
        assert (told["about"], "crush" in told["missed"]) == ((second,), True)
    everything = louder(later, 0.98, *later.campaign.test_ids).beside(before)
    assert "record of then" not in everything.rows[place][0].reason  # another filter class changes every record


def test_a_test_left_out_of_use_is_told_at_its_condition_with_the_reason(later: Certification) -> None:
    """Though a little off it: nobody gets rid of what it showed. Braces are a laboratory's words."""
    second = later.campaign.test_ids[1]
    off = moved(later, 0.8, second).campaign.test(second).condition
    why = {second: "bracket {left} loose"}
    found = of(later, replace(later.campaign.without([second]), unused=((second, off),), why_unused=why))
    assert [own["about"] for own in values(found, "test.not_used")] == [(second,)]
    told = " ".join(map(str, exceptions(found)["Tests that are not used"]))
    assert str(off) in told
    assert "bracket {left} loose" in told
    assert f"run as {second}, not used" in " ".join(row.why for row in planned(found))
    odd = replace(CRUSH, name="crush {A}")
    run = {f"at {second}": {second: {odd.name: 1e4}}}
    before = earlier(later, MET, *later.campaign.test_ids, criteria=Criteria((odd,), 0.8), run=run)
    assert odd.name in str(exceptions(found.beside(before))["Tests that are not used"])
