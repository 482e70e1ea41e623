"""A certification as facts, tables and the dossier of a review; its sentences are in ``data/golden``."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markupsafe import escape

from crashfuse import cli
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import Certification, Rows, Variant, certify_matrix
from crashfuse.certification.criteria import Costs, Criteria, Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.earlier import parse_earlier
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import Verdict, Word
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.results.certification import certification_json, certification_record, certification_result
from crashfuse.results.certification_facts import (
    CATALOGUE,
    PLACES,
    SUBJECTS,
    against,
    exceptions,
    facts,
    sentences,
)
from crashfuse.results.certification_tables import certification_table, planned, turned_texts
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.figures import how_left_out
from crashfuse.results.provenance import certify_command
from crashfuse.results.render.figure_files import contents_of
from crashfuse.results.render.html import report
from crashfuse.signals.occupant import OccupantModel
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import rate_iso18571
from crashfuse.study.config import StudyConfig
from crashfuse.units import KPH, KPH_KG, MPH, G
from tests.golden import assert_golden

pytestmark = pytest.mark.usefixtures("one_cache")

CRITERIA = Criteria(
    (
        Criterion("crush", "max_crush", at_most=430.0),
        Criterion("OLC", "olc", at_most=20.0),
        Criterion("rating", "rating", at_least=0.02, window_ms=60.0),
    ),
    0.8,
)


def matrix(campaign: Campaign, *speeds_mph: float) -> Matrix:
    """Conditions at these speeds with the weights of the second test."""
    here = campaign.tests[1].condition
    return Matrix(tuple(f"M{v:g}" for v in speeds_mph), tuple(replace(here, speed_mps=v * MPH) for v in speeds_mph))


@pytest.fixture(scope="module")
def certification(campaign: Campaign, shared_cache: Path) -> Certification:
    """Verdicts of the raw CAE model at three speeds: the first as if too slow for OLC, the last outside."""
    asked = matrix(campaign, 20.0, 30.0, 70.0)
    config = StudyConfig(approaches=("cae",))
    found = certify_matrix(campaign, CRITERIA, asked, config, Run(Cache(shared_cache)))
    (crush, olc, rating), *others = found.verdicts
    unknown = replace(olc, value=None, lower=None, upper=None, probability=None, word="open")
    return replace(found, verdicts=((crush, unknown, rating), *others))


@pytest.fixture(scope="module")
def alone(campaign: Campaign, shared_cache: Path) -> Certification:
    """From a single test, at one speed."""
    one, config = replace(campaign, tests=campaign.tests[:1]), StudyConfig(approaches=("cae",))
    return certify_matrix(one, CRITERIA, matrix(campaign, 20.0), config, Run(Cache(shared_cache)))


@pytest.fixture(scope="module")
def text(certification: Certification, shared_cache: Path) -> str:
    """The report."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CRASHFUSE_CACHE", str(shared_cache))
        return report(certification_result(certification), DEFAULT)


def values(certification: Certification, code: str) -> list[dict[str, Any]]:
    """The values of the facts of a code."""
    return [dict(fact.values) for fact in facts(certification) if fact.code == code]


def wrong(certification: Certification) -> Certification:
    """The same with a verdict that a test contradicts."""
    first, *rest = certification.record.trials
    said = replace(first, verdict=replace(first.verdict, word="not met" if first.met else "met"))
    return replace(certification, record=TrackRecord((said, *rest)))


def row_as(row: Sequence[Verdict], word: Word, *p: float | None) -> tuple[Verdict, ...]:
    """The verdicts on a condition with this word, and these probabilities or one for all."""
    return tuple(replace(own, word=word, probability=p[i % len(p)]) for i, own in enumerate(row))


def all_as(certification: Certification, word: Word, *p: float | None) -> Rows:
    """The verdicts with this word everywhere, and a probability for each condition or one for all."""
    return tuple(row_as(row, word, p[i % len(p)]) for i, row in enumerate(certification.verdicts))


def with_factors(certification: Certification) -> Certification:
    """Drive and type of every test are known; of the conditions one is new together, one lacks a type."""
    kinds = (("FWD", "I"), ("AWD", "II"), ("FWD", "I"), ("FWD", "I"))
    of_tests = [(("drive", drive), ("type", kind)) for drive, kind in kinds]
    of_planned = ((("drive", "FWD"), ("type", "II")), (("drive", "FWD"),), (("drive", "AWD"), ("type", "II")))
    campaign = certification.campaign
    tests = (
        replace(test, condition=replace(test.condition, factors=factors))
        for test, factors in zip(campaign.tests, of_tests, strict=True)
    )
    campaign = replace(campaign, tests=tuple(tests))
    conditions = (
        replace(condition, factors=factors)
        for condition, factors in zip(certification.matrix.conditions, of_planned, strict=True)
    )
    own = Matrix(certification.matrix.ids, tuple(conditions))
    return replace(certification, campaign=campaign, matrix=own, domain=Domain.of(campaign))


def with_costs(certification: Certification, confidence: float | None) -> Certification:
    """All met with 0.97 at once; a test costs 5, a wrong answer 100."""
    criteria = replace(certification.criteria, declared=confidence, costs=Costs(5.0, 100.0))
    return replace(certification, verdicts=all_as(certification, "met", 0.99), criteria=criteria)


def near(certification: Certification) -> Certification:
    """All open at 0.717; four tests within 1 km/h and 2 % of the mass of the fastest, none made for it."""
    there = replace(certification.matrix.conditions[2], front_weight_kg=1000.0, rear_weight_kg=700.0)
    tests = tuple(
        replace(test, condition=replace(there, speed_mps=there.speed_mps + 0.6 * KPH, front_weight_kg=front))
        for test, front in zip(certification.campaign.tests, (975.0, 978.0, 1021.0, 1022.0), strict=True)
    )
    *rows, last = all_as(certification, "open", 0.717)
    last = tuple(replace(verdict, condition=there) for verdict in last)
    return replace(certification, verdicts=(*rows, last), campaign=replace(certification.campaign, tests=tests))


def variants(certification: Certification, alone: Certification) -> Iterator[tuple[str, Certification]]:
    """Certifications of every kind, with names."""
    campaign, (first, _, third) = certification.campaign, certification.verdicts
    olc = OccupantModel(olc_free_flight_mm=120.0)
    yield "as it is", certification
    yield (
        "a wrong verdict, a warning, an own occupant model",
        replace(wrong(certification), campaign=replace(campaign, warnings=("Two tests look alike.",), occupant=olc)),
    )
    yield "all met", replace(certification, verdicts=all_as(certification, "met", 0.99))
    yield "all met, with costs", with_costs(certification, 0.9)
    yield "each met, all at once uncertain", replace(certification, verdicts=all_as(certification, "met", 0.9))
    missed = tuple(replace(own, word="not met", run={"T3": 1e6}) for own in first)
    yield "run, would miss", replace(certification, verdicts=(missed, tuple(replace(o, run={}) for o in missed), third))
    yield "tests near", near(certification)
    yield "factors", with_factors(certification)
    inches = replace(certification.criteria.items[0], at_most=17.0)
    criteria = replace(certification.criteria, items=(inches, *certification.criteria.items[1:]))
    rows = tuple((replace(row[0], criterion=inches), *row[1:]) for row in certification.verdicts)
    yield "a limit in inches", replace(certification, criteria=criteria, verdicts=rows)
    yield "a single test", alone


def test_all_sentences_are_those_that_were_read(certification: Certification, alone: Certification) -> None:
    """By code, whatever place shows them; each once."""
    lines: dict[str, None] = {}
    for name, own in variants(certification, alone):
        lines |= dict.fromkeys((f"# {name}", *(f"{fact.code}: {fact.sentence}" for fact in facts(own))))
        lines |= dict.fromkeys(f"{row.id}: {row.word}: {'; '.join((row.why, *row.further))}" for row in planned(own))
    assert_golden("certification", lines)


def test_facts_stand_in_the_places_of_their_code_in_order(certification: Certification) -> None:
    """Every one stands somewhere; those against the verdicts under the subject of their code."""
    found = wrong(certification)
    assert {fact.code for fact in facts(found)} <= {code for codes in (*PLACES.values(), SUBJECTS) for code in codes}
    codes = [fact.code for fact in facts(found)]
    assert codes == sorted(codes, key=[*CATALOGUE].index)
    told = tuple(fact.sentence for fact in facts(found) if fact.code == "record.wrong")
    assert exceptions(found)["Wrong verdicts on left-out tests"] == told
    assert list(exceptions(found)) == [SUBJECTS[code] for code in SUBJECTS if SUBJECTS[code] in exceptions(found)]
    assert sentences(certification, "summary")[0] == sentences(certification, "answer")[0]


def test_answers_have_what_decides_them(certification: Certification) -> None:
    """One that would miss a criterion takes another design: a test there, though others are open, tells nothing new."""

    def told(*rows: tuple[Verdict, ...]) -> list[str]:
        found = planned(replace(certification, verdicts=rows))
        return [f"{own.word}: {own.why}" for own in found]

    first, second, third = certification.verdicts
    met = row_as(first, "met", 0.9, 0.99, 1)
    missed, undecided = replace(first[0], word="not met"), replace(second[1], word="open", probability=0.5)
    rest = tuple(replace(own, word="met") for own in second[2:])
    outside = "cannot say: not covered by tests"
    assert told(met, (missed, undecided, *rest), third) == [
        "skip: meets all: 0.890",
        "would miss: misses crush",
        outside,
    ]
    assert told(met, (replace(missed, word="met"), undecided, *rest), third)[1] == "run: open: OLC"
    short = "cannot say: records end early: crush, OLC, rating"
    assert told(met, row_as(second, "open", None), third)[1] == short


def test_skips_faster_than_any_that_was_checked_are_named(certification: Certification) -> None:
    """On a record whose skips are all slower; beside the answer, and in the file."""
    met = replace(certification, verdicts=all_as(certification, "met", 0.99))
    trials = certification.record.trials
    slow = min(trial.verdict.condition.speed_mps for trial in trials)
    hidden = [t for t in trials if t.verdict.condition.speed_mps == slow]
    skipped = tuple(replace(t, verdict=replace(t.verdict, word="met", probability=0.99)) for t in hidden)
    found = replace(met, record=TrackRecord(skipped))
    (fact,) = (fact for fact in facts(found) if fact.code == "record.slower")
    faster = [i for i, condition in met.matrix.items if condition.speed_mps > slow + KPH]
    assert list(fact.about) == faster
    assert "faster" in fact.sentence
    assert fact.sentence in against(found).values()
    assert fact.sentence in certification_record(found)["sentences"]  # type: ignore[operator]
    assert not values(certification, "record.slower")


def test_an_answer_that_turns_has_its_reason(certification: Certification) -> None:
    """The criterion that decides with its probability before, or what was asked for."""
    met, less = (replace(certification, verdicts=all_as(certification, "met", p)) for p in (0.99, 0.9))
    first, *others = turned_texts(met, less)
    assert first == f"{met.matrix.ids[0]}: skip → run (all at once: 0.700, was 0.970)"
    assert len(others) == 2
    (crush, *rest), *rows = met.verdicts
    undecided = replace(crush, word="open", probability=0.5)
    turned = turned_texts(met, replace(met, verdicts=((undecided, *rest), *rows)))
    assert turned == [f"{met.matrix.ids[0]}: skip → run (crush: 0.500, was 0.990)"]


def test_a_test_is_needed_where_all_criteria_are_not_met_at_once_with_the_confidence(
    certification: Certification,
) -> None:
    """Three of 0.93 each leave 0.79 for all, less than the 0.8 asked for; of 0.94 each, 0.82."""
    ids, rows = certification.matrix.ids, all_as(certification, "met", 0.93, 0.94, 0.99)
    found = replace(certification, verdicts=rows)
    assert (list(found.uncertain), list(found.waived), found.run_first) == ([ids[0]], [ids[1], ids[2]], None)
    assert [(own.word, own.why) for own in planned(found)][:1] == [("run", "meets all: only 0.790")]
    reasons = certification_table(found).set_index("id")["reason"]
    assert reasons.str.contains("meets all: only 0.790").tolist() == [True] * 3 + [False] * 6
    assert list(certification_record(found)["waived"]) == [ids[1], ids[2]]  # type: ignore[call-overload]


def test_conditions_that_are_one_are_one_test_that_need_not_be_run(certification: Certification) -> None:
    """Or copies would pad what is saved; beside one that was run or takes a test, a copy saves nothing."""
    many = matrix(certification.campaign, 20.0, 20.1, 20.2, 30.0)
    met = row_as(certification.verdicts[0], "met", 1.0)
    found = replace(certification, matrix=many, verdicts=(met,) * 4)
    record = certification_record(found)
    assert (record["saved"], record["counted_once"]) == ({"n": 2, "tests": 2}, {"M20.1": "M20", "M20.2": "M20"})
    assert [(own["n"], own["of"]) for own in values(found, "matrix.saved")] == [(2, 2)]
    assert [(own.id, own.word) for own in planned(found)] == [(i, "skip") for i in many.ids]
    ran = tuple(replace(own, run={"T1": 1.0}) for own in met)
    assert replace(found, verdicts=(met, met, ran, met)).saved == (1, 2)
    many = matrix(certification.campaign, 20.0, 20.3, 20.6, 30.0)
    unsettled = row_as(met, "open", 0.5)
    found = replace(certification, matrix=many, verdicts=(met, unsettled, met, met))
    assert (found.counted_once, found.saved) == ({"M20": "M20.3", "M20.6": "M20.3"}, (1, 2))
    found = replace(certification, matrix=many, verdicts=(ran, unsettled, met, met))
    assert (found.counted_once, found.saved) == ({"M20.6": "M20.3"}, (1, 3))


def test_of_conditions_to_be_tested_the_fastest_is_run_first(certification: Certification) -> None:
    """If a test can settle two or more: not one that was run, misses a criterion, or whose record is too short."""
    assert certification.run_first is None  # the record is too short for one, the other is outside
    ids, (one, two, three) = certification.matrix.ids, all_as(certification, "open", 0.5)

    def first(*rows: tuple[Verdict, ...]) -> str | None:
        return replace(certification, verdicts=rows).run_first

    assert first(one, two, three) == ids[2]
    missed = (replace(three[0], word="not met"), *three[1:])
    ran, unknown = (replace(own, run={"T01": 1.0}) for own in three), replace(three[0], probability=None)
    for settled in (missed, tuple(ran), (unknown, *three[1:])):
        assert first(one, two, settled) == ids[1]
    assert first(one, row_as(two, "met", 0.99), missed) is None
    assert first(one, row_as(two, "met", 0.9), missed) == ids[1]
    assert certification_record(replace(certification, verdicts=(one, two, three)))["run_first"] == ids[2]


def test_what_stands_apart_is_named_beside_the_answer(certification: Certification) -> None:
    """Where it does, and nowhere else: in the table, and in the list by speed."""
    found = near(certification)
    reasons = certification_result(found).tables["planned"].frame["Why"]
    assert reasons.str.contains("T1 stands apart").tolist() == [False, False, True]
    *_, last = planned(found)
    told = ("M70", "run", "open: crush, OLC, rating", ("T1 stands apart there",))
    assert (last.id, last.word, last.why, last.further) == told


def test_the_record_is_told_with_and_without_limits_that_no_test_came_near(certification: Certification) -> None:
    """1 of 9 wrong: at most 42.9 %, for with that share one or none of nine is wrong in 5 % of cases."""
    (told,) = values(wrong(certification), "record.decided")
    assert (told["n"], told["wrong"]) == (9, 1)
    assert pytest.approx(0.05, abs=5e-4) == 0.571**9 + 9 * 0.429 * 0.571**8
    record = certification.record
    (decided, _), (near, _) = record.decided, record.near_limit.decided
    assert 0 < near < decided
    kept = certification_record(certification)["track_record"]
    assert isinstance(kept, dict)
    assert next(iter(kept)) == "near_limit"
    assert sentences(certification, "record")[0].startswith(f"Near the limits, where it matters: {near} verdicts")
    far = replace(certification, record=TrackRecord(tuple(t for t in record.trials if not t.near)))
    assert sentences(far, "record")[0].startswith("Near the limits, where it matters: no verdict")
    at_most = pytest.approx(1 - 0.05 ** (1 / near), abs=1e-4)
    assert kept["near_limit"] == {"n": near, "wrong": 0, "wrong_at_most": at_most}
    assert kept["intervals"] == dict(zip(("inside", "n"), record.intervals, strict=True))


def test_each_criterion_stands_beside_what_its_own_record_supports(certification: Certification) -> None:
    record, asked = certification.record, certification.criteria
    table = certification_result(certification).tables["record"].frame
    first, *told, _, with_runs = table["What this record supports"]
    assert told == [record.support(own).text(asked.confidence) for own in asked.items]
    assert (first, with_runs, len({*told})) == ("", "", 2 + 1)
    near, *_, all_of_it, _ = table[["Met", "Not met"]].sum(axis=1)
    assert (near, all_of_it) == (record.near_limit.decided[0], record.decided[0])


def test_probabilities_that_did_not_come_true_or_gain_nothing_are_exceptions(certification: Certification) -> None:
    """A bin outside its bounds, and a Brier score that is not below that of the raw CAE."""
    first = next(trial for trial in certification.record.trials if trial.cae_probability is not None)
    said, limit = replace(first.verdict, probability=0.9, word="open"), first.verdict.criterion.at_most or 0.0
    for measured, contradicted in ((limit + 1, 1), (limit - 1, 0)):
        trials = tuple(
            replace(first, held_out=f"T{i}", verdict=said, measured=measured, cae_probability=0.8) for i in range(9)
        )
        found = replace(certification, record=TrackRecord(trials))
        assert len(values(found, "record.bin")) == contradicted
        assert len(values(found, "record.no_gain")) == contradicted


def test_the_saving_to_expect_is_that_of_the_costs(certification: Certification) -> None:
    """Each of three saves 5 less 100 times the probability of missing one, or the share that the record allows."""
    found = with_costs(certification, None)
    assert found.criteria.confidence == 0.95
    (costs,), (saving,) = values(found, "costs.confidence"), values(found, "costs.saving")
    assert costs == {"test": 5.0, "wrong_answer": 100.0, "pays_from": 0.95, "confidence": 0.95, "follows": True}
    most = 1 - 0.05**0.5  # none of two tests with a wrong verdict
    assert (saving["n"], saving["expected"]) == (3, pytest.approx(3 * (5 - 100 * 0.03)))
    assert saving["cautious"] == pytest.approx(3 * (5 - 100 * most), rel=1e-3)
    assert (set(found.answers.values()), found.saved, found.waived) == ({"run"}, (0, 3), {})  # that is a loss
    dear = replace(found, criteria=replace(found.criteria, costs=Costs(80.0, 100.0)))
    assert (set(dear.answers.values()), dear.saved) == ({"skip"}, (3, 3))  # at most 77.6 are lost of 80
    numbers = {key: value for key, value in saving.items() if isinstance(value, int | float)}
    assert certification_record(found)["costs"] == {"confidence": costs, "saving": numbers}
    assert parse_earlier(certification_json(found)).criteria == found.criteria
    text = report(certification_result(found), DEFAULT)
    assert all(str(escape(sentence)) in text for sentence in sentences(found, "costs"))
    assert "costs" not in certification_record(certification)


def test_the_order_is_that_of_a_review(text: str) -> None:
    """The answer, intended use, verification before validation, prediction, record, exceptions; signatures last."""
    first = text.partition("<section id=use>")[0].rpartition("<h1>")[2]
    places = [first.index(mark) for mark in ("class=verdict>", "<th>Planned test</th>", "<th>Limit</th>", "Made on")]
    assert places == sorted(places)
    assert first.count("<p>") <= 3 + 1  # and when it was made
    assert re.findall("<h2>(.*?)</h2>", text) == [
        "Intended use",
        "Validated domain, and the conditions in it",
        "Method and settings",
        "Is the CAE model fit to be believed?",
        "Data: 4 tests, 24 CAE runs",
        "How well tests repeat",
        "Evidence from left-out tests",
        "Credibility sheet",
        "Acceptance criteria",
        "Verdicts",
        "Track record of the verdicts",
        "Exceptions and discrepancies",
        "Limits",
        "Where this comes from",
        "Signatures",
    ]
    assert all(f"<tr><td>{who}</td>" in text for who in ("Prepared", "Checked", "Approved"))
    assert "claims no compliance with any regulation, standard or protocol" in text


def test_every_verdict_stands_in_it_with_colour_word_and_reason(certification: Certification, text: str) -> None:
    """A row a condition and criterion; the figure of the matrix, and the domain with the new conditions."""
    for _, verdict in certification.cells:
        assert str(escape(verdict.reason)) in text
    cells = re.findall("<td class=(met|not-met|open|outside)>", text)
    assert len(cells) == len(certification.cells) + len(certification.record.counted)
    assert text.count('class="plotly-graph-div"') == 1 + 2 + 1 + 1 + 1 + 4  # domain, record, matrix, scales, tests
    assert certification.campaign.fingerprint in text
    assert f"<code>{certification.campaign.cae.fingerprint}</code>" in text
    assert "<td>Solver of the CAE runs</td><td><code>not stated</code></td>" in text
    assert certify_command(certification) in text
    for place in ("summary", "domain", "record"):
        assert all(str(escape(sentence)) in text for sentence in sentences(certification, place))
    assert all(str(escape(sentence)) in text for told in exceptions(certification).values() for sentence in told)


def test_a_probability_stands_beside_what_the_tests_leave_open_of_it(certification: Certification) -> None:
    """In the file of verdicts, in the record and in the dossier; wider where seeds differ."""
    table = certification_table(certification)
    for (i, verdict), lower, upper in zip(
        certification.cells, table["probability_lower"], table["probability_upper"], strict=True
    ):
        if verdict.probability is not None and verdict.probability_interval is not None:
            assert 0 <= lower <= verdict.probability <= upper <= 1
            assert verdict.probability_interval == (lower, upper)
            kept = certification_record(certification)["monte_carlo"]
            assert kept[i]["interval"][verdict.criterion.name] == (lower, upper)  # type: ignore[index]
    shown = certification_result(certification).tables["verdicts"].frame["Probability, 95 %"]
    assert shown.str.fullmatch(r"[01]\.\d\d–[01]\.\d\d").all()


def test_slides_say_what_the_answer_rests_on(certification: Certification) -> None:
    """The record with its bounds, the quality of the CAE runs, and the seal."""
    for key, seal in (("", "Not sealed."), ("ab", "Sealed by the key ab.")):
        told = contents_of(certification_result(replace(certification, key=key)), DEFAULT).evidence
        assert told[0] == sentences(certification, "record")[0]
        assert told[2:] == (certification.campaign.quality.checks, seal)


def test_notes_on_tests_stand_in_the_dossier_as_text(certification: Certification, text: str) -> None:
    """A reviewer has to know that an accelerometer came loose; without any there is no such section."""
    notes = [Note("T2", "bracket <loose> at the tunnel", 30.0)]
    noted = report(certification_result(certification, notes), DEFAULT)
    assert "<td>T2</td><td class=when>30 ms</td><td>bracket &lt;loose&gt; at the tunnel</td>" in noted
    assert "id=notes" not in text


def test_left_out_tests_stand_beside_the_cae_model_and_what_was_predicted_without_them(
    certification: Certification, text: str
) -> None:
    """The CAE pulse is that of the run; the ratings of predictions are those by which the record judges."""
    campaign, result = certification.campaign, certification_result(certification)
    measured = {
        (trial.held_out, how_left_out(trial.left_out)): trial.measured
        for trial in certification.record.trials
        if trial.verdict.criterion.metric == "rating"
    }
    table = result.tables["left_out"].frame
    of_cae = table[table["Pulse"] == "CAE"].set_index("Test")["overall"]
    told = table[table["Pulse"] != "CAE"].set_index(["Test", "Pulse"])["overall"]
    assert {key: measured[key] for key in told.index} == pytest.approx(told.to_dict(), abs=1e-9)
    assert of_cae.index.tolist() == [*campaign.test_ids]
    for test, part in zip(campaign.tests, result.parts["left_out"], strict=True):
        run = campaign.cae.paired_run(test.condition)
        pulse = Pulse(GRID_S, campaign.cae.accel_mps2[run].astype(float))
        assert of_cae[test.id] == pytest.approx(rate_iso18571(test.pulse, pulse, 60.0).overall, abs=1e-9)
        lines = part.figures["overlay"].draw(DEFAULT).figure().data
        drawn = {line.name: line.y for line in lines if line.mode == "lines"}
        assert f"<h3>{part.title}</h3>" in text
        assert test.id in part.title
        np.testing.assert_allclose(drawn["Test"], test.pulse.accel_mps2 / G, rtol=1e-6)
        np.testing.assert_allclose(drawn["CAE"], pulse.accel_mps2 / G, rtol=1e-6)
    kept = certification_record(certification)["track_record"]["ratings"]  # type: ignore[index]
    assert kept == table.to_dict("records")


def test_a_single_test_makes_a_dossier_that_says_so(alone: Certification) -> None:
    """No record, no figures of one, no table of repeats; everything outside."""
    result = certification_result(alone)
    text = report(result, DEFAULT)
    assert [fact.code for fact in facts(alone) if fact.code.startswith("record")] == ["record.none"]
    assert not re.findall("<h2>(How well tests repeat)</h2>", text)
    assert "Each test was left out in turn" not in text
    assert set(result.tables["planned"].texts()["Why"]) == {"not covered by tests"}


def test_limits_stand_as_declared_beside_the_readers_units(certification: Certification) -> None:
    """48 km/h, not 29.83 mph alone; where the reader's units are those of the criteria, once."""
    limit = Criterion("change", "delta_v", at_most=48.0)
    criteria = replace(certification.criteria, items=(*certification.criteria.items[:2], limit))
    rows = tuple((*row[:2], replace(row[0], criterion=limit)) for row in certification.verdicts)
    found = replace(certification, criteria=criteria, verdicts=rows)
    result = certification_result(found)
    row = result.tables["criteria"].texts().iloc[-1]
    assert (row["Limit"], row["As declared"]) == ("at most 29.83 mph", "at most 48 km/h")
    assert "As declared" in report(result, DEFAULT)
    assert "As declared" not in report(result, Display(system=KPH_KG))


def test_long_tables_are_cut_and_say_where_the_rest_is(certification: Certification) -> None:
    """A matrix of 400 conditions by 3 criteria has 1200 rows in the CSV, of which the report shows 1000."""
    many = matrix(certification.campaign, *(20 + i / 40 for i in range(400)))
    found = replace(certification, matrix=many, verdicts=(certification.verdicts[0],) * 400)
    text = report(certification_result(found), DEFAULT)
    assert "360 more rows are in certification.csv." in text
    assert "200 more rows are in certification.csv." in text
    assert text.count('class="plotly-graph-div"') == 1 + 2 + 1 + 1 + 4  # the matrix as one figure, in colours alone


def test_the_command_is_parsed_back_to_its_settings(certification: Certification) -> None:
    """Approach, preset and device, as they were; that it was sealed, and what was tried."""
    config = StudyConfig(approaches=("displacement_domain",), preset="fast", device="cpu")
    criteria = replace(certification.criteria, costs=Costs(5.0, 100.0))
    tried = Variant("limits 5 % stricter", (1, 2), {}), Variant("without T1", (1, 2), {}, "T1")
    asked = replace(certification, config=config, criteria=criteria, key="ab", variants=tried)
    _, *command = certify_command(asked).split()
    parsed = cli.parser().parse_args(command)
    assert parsed.robustness
    assert (parsed.approach, parsed.preset, parsed.device) == ("displacement_domain", "fast", "cpu")
    assert (parsed.costs, parsed.seal) == ([5.0, 100.0], Path("KEY"))
    assert (parsed.criteria, parsed.matrix) == (Path("criteria.toml"), Path("matrix.csv"))
