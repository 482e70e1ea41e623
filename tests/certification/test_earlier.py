"""An earlier certification is read from its JSON and from nothing else; tests run since prove it right or wrong."""

import json
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Certification, certify_matrix
from crashfuse.certification.criteria import Criteria, Criterion, criteria_of, criteria_text
from crashfuse.certification.earlier import FILE, Earlier, LaterTests, parse_earlier, read_earlier
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import Verdict, Word
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.results.certification import _criterion, certification_json, certification_result
from crashfuse.results.certification_facts import facts, outcomes, sentences
from crashfuse.results.certification_tables import track_record_table
from crashfuse.results.render.html import report as report_of
from crashfuse.signals.metrics import METRIC_UNITS, metric_values
from crashfuse.signals.occupant import USUAL_OCCUPANT, OccupantModel
from crashfuse.study.config import StudyConfig
from crashfuse.units import KPH, LB, MPH
from tests.conftest import not_none, problems_of
from tests.golden import assert_golden

pytestmark = pytest.mark.usefixtures("one_cache")

Said = tuple[Word, float, float, float]  # and the probability, and the ends of the interval

RECORD: dict[str, Any] = {
    "date": "2026-11-24T12:00:00+00:00",
    "settings": {"campaign": "Sedan", "approach": "Fused", "seed": "3"},
    "tests_sha256": {"T1": "a1", "T2": "b2"},
    "criteria": {
        "confidence": 0.9,
        "criterion": [
            {"name": "crush", "metric": "max_crush", "at_most": 600.0},
            {"name": "good", "metric": "rating", "window_ms": 60.0, "at_least": 0.8},
        ],
    },
    "matrix": [
        {"id": "A", "speed_mph": 20, "front_weight_lb": 2000, "rear_weight_lb": 1500, "drive": "FWD"},
        {"id": "B", "speed_mph": 30, "front_weight_lb": 2000, "rear_weight_lb": 1500, "drive": ""},
    ],
    "run": {"B": {"T2": {"crush": 510.0, "good": None}}},
    "cells": {
        "A": {"crush": ["met", 0.98, 400.0, 500.0], "good": ["met", 0.92, 0.7, 1.0]},
        "B": {"crush": ["open", 0.6, None, 610.0], "good": ["outside", None, None, None]},
    },
    "waived": {"A": {"at_least": 0.9, "probability": 0.91, "at_most": 0.92}},
}
TRIAL: dict[str, Any] = {
    "test": "T1",
    "condition": "20mph 2000lb 1500lb",
    "criterion": {"metric": "peak", "at_most": 40.0},
    "said": ["met", 0.97, 30.0, 38.0],
    "measured": 41.0,
}


def changed(at: tuple[object, ...], value: object) -> bytes:
    """The record with another value at a place."""
    record = json.loads(json.dumps(RECORD))
    part = record
    for key in at[:-1]:
        part = part[key]
    part[at[-1]] = value
    return json.dumps(record).encode()


def test_everything_that_is_compared_is_read(tmp_path: Path) -> None:
    """Of the file as of its folder: conditions in SI, criteria, verdicts, tests, settings and the file's digest."""
    (tmp_path / FILE).write_text(json.dumps(RECORD))
    earlier = read_earlier(tmp_path)
    assert earlier.matrix.ids == ("A", "B")
    assert earlier.matrix.conditions[0].vector.tolist() == pytest.approx([20 * MPH, 2000 * LB, 1500 * LB])
    assert earlier.matrix.conditions[0].factors == (("drive", "FWD"),)
    assert [own.limits for own in earlier.criteria.items] == ["at most 600 mm", "at least 0.80"]
    assert [(own.word, own.probability, own.lower, own.upper) for own in earlier.rows["B"]] == [
        ("open", 0.6, None, 610.0),
        ("outside", None, None, None),
    ]
    assert earlier.tests == {"T1": "a1", "T2": "b2"}
    assert earlier.run == ("B",)
    assert earlier.occupant == USUAL_OCCUPANT
    assert earlier.settings["approach"] == "Fused"
    assert earlier.date == "2026-11-24 12:00 UTC"
    assert earlier.waived == ("A",)
    assert read_earlier(tmp_path / FILE).digest == earlier.digest != parse_earlier(changed(("run",), {})).digest
    assert len(repr(earlier)) < 100


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"[" * 100_000,
        b'{"study": 1}',
        changed(("cells",), {}),
        changed(("cells", "A", "crush"), ["met", 1.5, 1.0, 2.0]),
        changed(("cells", "A", "crush"), ["met", float("nan"), 1.0, 2.0]),
        changed(("cells", "A", "crush"), ["perhaps", 0.5, 1.0, 2.0]),
        changed(("cells", "A", "crush"), ["met", 0.5, "1", 2.0]),
        changed(("cells", "A", "crush"), ["met"]),
        changed(("cells", "A", "crush"), ["met", True, 1.0, 2.0]),
        changed(("cells", "A", "crush"), ["met", 0.5, 2.0, 1.0]),
        changed(("cells", "A", "crush"), ["met", 0.5, 10**400, None]),
        changed(("matrix", 0, "speed_mph"), -20),
        changed(("matrix", 0, "id"), "<b>\n"),
        changed(("matrix",), []),
        changed(("matrix", 1, "id"), "A"),
        changed(("matrix", 0, "speed_mph"), 10**400),
        changed(("matrix", 0, "speed_mph"), 1e308),
        changed(("matrix", 0, "speed_kph"), 30),
        changed(("tests_sha256",), {"\x1b[31m": "a"}),
        changed(("tests_sha256",), "T01"),
        changed(("tests_sha256", "T1"), 7),
        changed(("settings", "seed"), 0),
        changed(("settings", "seed"), {"a": 1}),
        changed(("settings", "campaign"), "a\x1b]0;x\x07\nSigned: certified"),
        changed(("settings", "campaign"), "x" * 1000),
        changed(("settings", "campaign"), "\ud800"),
        changed(("date",), None),
        changed(("date",), "yesterday"),
        changed(("occupant",), {"olc_free_flight_mm": -1}),
        changed(("occupant",), [65, 235]),
        changed(("since",), {"verdicts": [{"test": "T1"}]}),
        changed(("since",), {"verdicts": [dict(TRIAL, measured="1")]}),
        changed(("since",), {"verdicts": [dict(TRIAL, condition="fast")]}),
        changed(("since",), {"verdicts": [dict(TRIAL, said=["right", 0.9, 1.0, 2.0])]}),
        changed(("since",), {"verdicts": [dict(TRIAL, test="\x1b")]}),
        changed(("criteria", "criterion"), [{"metric": "colour", "at_most": 1}]),
    ],
)
def test_another_file_is_one_sentence(content: bytes) -> None:
    """Whatever is wrong with it, what is expected and what to do is told in a line."""
    (problem,) = problems_of(lambda: parse_earlier(content))
    assert str(problem).startswith(f"{FILE}: expected the record of a certification, found ")
    assert "that crashfuse certify writes" in str(problem)
    assert str(problem).isprintable()


NUMBERS = st.floats(0, allow_nan=False, allow_infinity=False) | st.integers(0, 10**15)


@given(metric=st.sampled_from([*METRIC_UNITS]), limits=st.tuples(NUMBERS, NUMBERS), name=st.text(max_size=100))
def test_whatever_limit_was_judged_is_read_again(metric: str, limits: tuple[float, float], name: str) -> None:
    """A crush of at most 0.4 mm, too, if its unit was stated: in the record, among its trials, and in criteria.toml."""
    named = {"name": name} if name.strip() and name.isprintable() else {}
    stated = {"metric": metric, "unit": METRIC_UNITS[metric], "at_least": min(limits), "at_most": max(limits)}
    found = criteria_of([{**named, **stated}])
    (criterion,) = found.items
    record = json.loads(json.dumps(RECORD))
    record["criteria"]["criterion"] = [_criterion(criterion)]
    record["cells"] = {i: {criterion.name: ["met", 0.98, 1.0, 2.0]} for i in record["cells"]}
    record["run"], record["since"] = {}, {"verdicts": [dict(TRIAL, criterion=_criterion(criterion))]}
    earlier = parse_earlier(json.dumps(record).encode())
    assert earlier.criteria.items == tuple(trial.verdict.criterion for trial in earlier.trials) == found.items
    written = tomllib.loads(criteria_text(found))
    assert criteria_of(written["criterion"], written["confidence"]).items == found.items


def test_no_file_and_a_huge_one_are_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder without it, too."""
    for path in (tmp_path, tmp_path / "other.json"):
        with pytest.raises(DataError, match="expected the record of a certification, found no such file"):
            read_earlier(path)
    (tmp_path / FILE).write_text(json.dumps(RECORD))
    monkeypatch.setattr("crashfuse.certification.seal._LARGEST", 10)
    with pytest.raises(DataError, match="found 0 MB"):
        read_earlier(tmp_path)


CRUSH, PEAK = Criterion("crush", "max_crush", at_most=430.0), Criterion("peak", "peak", at_most=25.0)
GOOD = Criterion("good", "rating", at_least=0.5, window_ms=60.0)
MET: Said = ("met", 0.97, 100.0, 425.0)
OPEN: Said = ("open", 0.6, 10.0, 500.0)
SURE: Said = ("met", 0.99, 1.0, 2.0)
TIGHT = Criteria((replace(PEAK, at_most=1e-4),), 0.8)


@pytest.fixture(scope="module")
def today(campaign: Campaign, shared_cache: Path) -> Certification:
    """Verdicts of the raw CAE model at the condition of each test, and at 20 mph."""
    conditions = [test.condition for test in campaign.tests]
    slow = replace(conditions[1], speed_mps=20 * MPH)
    matrix = Matrix((*(f"at {test}" for test in campaign.test_ids), "slow"), (*conditions, slow))
    config, criteria = StudyConfig(approaches=("cae",)), Criteria((CRUSH, PEAK, GOOD), 0.8)
    return certify_matrix(campaign, criteria, matrix, config, Run(Cache(shared_cache)))


def earlier(today: Certification, said: Said | Sequence[Said], *known: str, **others: Any) -> Earlier:
    """A certification that said this of every condition, from these tests, or from the first alone."""
    read = replace(parse_earlier(certification_json(today)), run=(), **others)
    limits = read.criteria.items
    row = cast(Sequence[Said], (said,) * len(limits) if isinstance(said[0], str) else said)
    rows = {
        i: tuple(
            Verdict(condition, limit, None, lower, upper, probability, word, "")
            for limit, (word, probability, lower, upper) in zip(limits, row, strict=True)
        )
        for i, condition in read.matrix.items
    }
    tests = {test: read.tests[test] for test in known or read.tests.keys() & {today.campaign.test_ids[0]}}
    return replace(read, tests=tests, rows=rows, digest="0" * 64, date="2026-11-24 12:00 UTC")


def since(certification: Certification, before: Earlier) -> LaterTests:
    """The tests of a certification beside an earlier one."""
    return not_none(certification.beside(before).since)


def again(certification: Certification, today: Certification) -> Certification:
    """One that is beside the file of a certification."""
    return today.beside(parse_earlier(certification_json(certification)))


def measured(certification: Certification, test: str) -> dict[str, float]:
    """The metrics of a test."""
    campaign = certification.campaign
    return {metric.name: metric.value or 0.0 for metric in campaign.metrics_of(campaign.test(test))}


def altered(certification: Certification, change: Callable[[CrashTest], CrashTest], *tests: str) -> Certification:
    """The same with some tests changed."""
    campaign = certification.campaign
    new = tuple(change(one) if one.id in tests else one for one in campaign.tests)
    return replace(certification, campaign=replace(campaign, tests=new))


def moved(certification: Certification, off_kph: float, *tests: str) -> Certification:
    """The same of tests that were run a little faster."""

    def faster(one: CrashTest) -> CrashTest:
        return replace(one, condition=replace(one.condition, speed_mps=one.condition.speed_mps + off_kph * KPH))

    return altered(certification, faster, *tests)


def louder(one: CrashTest) -> CrashTest:
    """A test with another record."""
    return replace(one, pulse=replace(one.pulse, accel_mps2=1.1 * one.pulse.accel_mps2))


def test_all_sentences_are_those_that_were_read(today: Certification) -> None:
    """Of an earlier certification that was wrong, of one that had known a test, and of tests off their condition."""
    first, second, *_ = today.campaign.test_ids
    off = moved(today, 0.9, second)
    lines: dict[str, None] = {}
    for name, own in (
        ("wrong verdicts", today.beside(earlier(today, MET))),
        ("a repeat", today.beside(replace(earlier(today, OPEN), run=(f"at {second}",)))),
        ("other limits", today.beside(earlier(today, SURE, criteria=TIGHT))),
        ("off its condition", off.beside(earlier(off, MET, first))),
    ):
        told = (f"{fact.code}: {fact.sentence}" for fact in facts(own) if fact.code.startswith("since"))
        lines |= dict.fromkeys((f"# {name}", *told))
    assert_golden("certification_since", lines)


@pytest.mark.parametrize(("word", "wrong"), [("met", True), ("not met", False)])
def test_a_test_run_since_tells_whether_a_verdict_came_true(today: Certification, word: Word, wrong: bool) -> None:
    """By what was measured, against the limit: an open verdict is neither; in tables, JSON and the report."""
    *known, fastest = sorted(today.campaign.tests, key=lambda test: test.condition.speed_mps)
    peak = measured(today, fastest.id)["peak"]
    assert peak > 25
    beside = today.beside(earlier(today, (OPEN, (word, 0.9, 0.0, 1.0), MET), *(test.id for test in known)))
    own, share = not_none(beside.since), (int(wrong), 1)
    assert (own.new, outcomes(own)) == ((fastest.id,), {"verdicts": share, "tests": share})
    table = track_record_table(beside).query("left_out == 'planned' and criterion == 'peak'")
    assert (table["verdict"].item(), table["met"].item()) == (word, False)
    assert table["measured"].item() == pytest.approx(peak)
    told = [fact for fact in facts(beside) if fact.code == "since.wrong"]
    assert [(own.about, own.values["criterion"], own.values["said"]) for own in told] == [
        ((fastest.id,), "peak deceleration", "met")
    ] * wrong
    assert certification_result(beside).tables["since"].frame["The test"].tolist()[1] == "missed it" + ", wrong" * wrong
    record, report = json.loads(certification_json(beside)), report_of(certification_result(beside))
    assert (record["since"]["decided"]["wrong"], record["since"]["decided"]["tests"]) == share
    assert record["since"]["sentences"] == [str(one) for one in sentences(beside, "since")]
    assert "--since EARLIER" in record["command"]
    assert own.earlier.digest in report
    assert "<h2>Earlier verdicts, and what became of them</h2>" in report
    assert "Earlier verdicts" not in report_of(certification_result(today))
    assert "since" not in json.loads(certification_json(today))


def test_two_limits_or_conditions_alike_are_one_metric_of_a_test(today: Certification) -> None:
    """Or a criterion written twice would make a record; a wrong one counts."""
    first, *others = today.campaign.test_ids
    loose, last = replace(PEAK, name="loose", at_most=1000.0), today.matrix.conditions[-2]
    conditions = (*today.matrix.conditions, replace(last, speed_mps=last.speed_mps * 1.001))
    twice = replace(today.matrix, ids=(*today.matrix.ids, "beside"), conditions=conditions)
    wrong = sum(measured(today, test)["peak"] > 25.0 for test in others)
    criteria = Criteria((CRUSH, PEAK, loose), 0.8)
    for matrix in (today.matrix, twice):
        found = since(today, earlier(today, (OPEN, MET, MET), first, criteria=criteria, matrix=matrix))
        assert outcomes(found) == {"verdicts": (wrong, len(others)), "tests": (wrong, len(others))}


def test_a_record_is_known_by_its_content_and_by_its_id(today: Certification) -> None:
    """Renamed or retouched it is no new test; another vehicle's file is refused, whatever its ids."""
    ids, own = today.campaign.test_ids, not_none(again(today, today).since)
    assert (own.new, own.trials) == ((), ())
    before = earlier(today, OPEN, *ids[:2])
    assert since(altered(today, lambda test: replace(test, id="renamed"), ids[1]), before).new == ids[2:]
    assert since(altered(today, louder, ids[1]), before).new == ids[2:]
    with pytest.raises(DataError, match="a certification of this campaign, found one of Tiny"):
        since(today, replace(before, tests={"X1": "of another vehicle"}))
    another = {**before.settings, "CAE runs": "24, another fingerprint"}
    assert since(altered(today, louder, *ids), replace(before, settings=another)).new == ids[2:]  # it has its name
    with pytest.raises(DataError):
        since(altered(today, louder, *ids), replace(before, settings={**another, "campaign": "Coupe"}))


@pytest.mark.parametrize(("off_kph", "counts"), [(0.95, True), (1.1, False)])
def test_a_test_is_made_for_a_condition_a_little_off(today: Certification, off_kph: float, counts: bool) -> None:
    """To 1 km/h and 2 %; one made for none tells nothing."""
    others = today.campaign.test_ids[1:]
    found = since(moved(today, off_kph, *others), earlier(today, MET))
    assert found.made_for == ({test: f"at {test}" for test in others} if counts else {})
    assert bool(found.trials) is counts


def test_what_a_test_off_its_condition_measured_is_moved_there_as_the_cae_model_says(today: Certification) -> None:
    """By the emulator at both; the peak jumps, and stays. The next file knows it."""
    second, *rest = today.campaign.test_ids[1:]
    here = today.campaign.test(second).condition
    today = moved(replace(today, campaign=today.campaign.without(rest), record=TrackRecord(())), 0.9, second)
    off, raw = today.campaign.test(second).condition, measured(today, second)
    emulator = CaeModel().fit(today.campaign.cae, Run()).emulator_
    there, planned = (float(metric_values(emulator.predict(c), c.speed_mps)["max_crush"]) for c in (off, here))
    limit = replace(CRUSH, at_most=raw["max_crush"] - 0.5 * (there - planned))
    before = earlier(today, MET, today.campaign.test_ids[0], criteria=Criteria((limit, PEAK, GOOD), 0.8))
    beside = today.beside(before)
    for own in (beside, again(beside, today)):
        crush, peak = not_none(own.since).trials
        assert crush.shift == pytest.approx(there - planned) != 0
        assert crush.measured + crush.shift == pytest.approx(raw["max_crush"])
        assert (crush.wrong, peak.shift) == (False, 0)
        assert peak.measured == pytest.approx(raw["peak"])
        words = f"{limit.shown(raw['max_crush'])} ({limit.shown(crush.measured)} at its condition, by the CAE model)"
        assert words in certification_result(own).tables["since"].texts()["Measured"].tolist()


def test_what_does_not_count(today: Certification) -> None:
    """Right verdicts on tests that the CAE model was tuned to; any on repeats, whose answer had been seen."""
    first, second, *_ = today.campaign.test_ids
    before = earlier(today, MET)
    found = since(altered(today, lambda test: replace(test, cae_tuned=True), *today.campaign.test_ids), before)
    assert {trial.wrong for trial in found.trials} == {False, True}
    assert found.counted == tuple(trial for trial in since(today, before).counted if trial.wrong)
    seen = since(today, replace(before, run=(f"at {second}",)))
    assert {trial.held_out for trial in seen.trials} == {*today.campaign.test_ids} - {first, second}


def test_metrics_are_measured_as_they_were_then(today: Certification) -> None:
    """An occupant model that was changed since makes no verdict on OLC wrong."""
    before = earlier(today, MET, criteria=Criteria((Criterion("olc", "olc", at_most=1000.0),), 0.8))
    stiffer = replace(today.campaign, occupant=OccupantModel(olc_free_flight_mm=30.0))
    then, now = (since(own, before) for own in (today, replace(today, campaign=stiffer)))
    assert [trial.measured for trial in now.trials] == [trial.measured for trial in then.trials] != []


def test_wrong_verdicts_of_then_take_support_from_those_of_today(today: Certification) -> None:
    """They are the strongest evidence that there is; certifying in between forgets none."""
    right = TrackRecord(
        tuple(
            replace(trial, verdict=replace(trial.verdict, word="met" if trial.met else "not met"))
            for trial in today.record.trials
        )
    )
    sure, loose = replace(today, record=right), Criteria((replace(PEAK, at_most=1e4),), 0.8)
    for criteria, wrong in ((loose, 0), (TIGHT, 3)):
        beside = sure.beside(earlier(today, SURE, criteria=criteria))
        own, before = beside.record.support(PEAK), right.support(PEAK)
        assert (own.own_decided, own.own_wrong) == (before.own_decided, wrong)  # one a test, the wrong one if any is
        assert (own.confidence < before.confidence) is (wrong > 0)
        assert right.counts() == beside.record.counts()  # of left-out tests alone
        for later in (second := again(beside, sure), again(second, sure)):
            assert (not_none(later.since).new, later.record.support(PEAK)) == ((), own)
    unsure = earlier(today, ("met", 0.7, 1.0, 2.0), criteria=TIGHT)
    assert sure.beside(unsure).record.support(PEAK) == right.support(PEAK)
