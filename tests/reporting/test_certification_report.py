"""The dossier of a certification holds what a review asks for, names every exception, and claims nothing more."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from markupsafe import escape

from crashfuse import cli
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import Certification, certify_matrix
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import Verdict, Word
from crashfuse.execution.cache import Cache
from crashfuse.reporting.certification_exceptions import exceptions
from crashfuse.reporting.certification_record import certification_record
from crashfuse.reporting.certification_sentences import summary, to_test
from crashfuse.reporting.evidence_sentences import (
    brier_sentence,
    domain_sentences,
    record_sentence,
    waived_sentence,
)
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.provenance import certify_command
from crashfuse.reporting.report import certification_report
from crashfuse.signals.occupant import OccupantModel
from crashfuse.study.config import StudyConfig
from crashfuse.units import KPH, MPH
from crashfuse.wording import KPH_KG

pytestmark = pytest.mark.usefixtures("one_cache")

CRITERIA = Criteria(
    (
        Criterion("crush", "max_crush", at_most=430.0),
        Criterion("OLC", "olc", at_most=20.0),
        Criterion("rating", "rating", at_least=0.02, window_ms=60.0),
    ),
    0.8,
)

_NOT_RUN = "Need not be run, as every criterion is met (in brackets the probability that all are, at least): {} ({})."


def matrix(campaign: Campaign, *speeds_mph: float) -> Matrix:
    """Conditions at these speeds with the weights of the second test."""
    here = campaign.tests[1].condition
    return Matrix(tuple(f"M{v:g}" for v in speeds_mph), tuple(replace(here, speed_mps=v * MPH) for v in speeds_mph))


@pytest.fixture(scope="module")
def certification(campaign: Campaign, shared_cache: Path) -> Certification:
    """Verdicts of the raw CAE model at three speeds: the first as if too slow for OLC, the last outside."""
    asked = matrix(campaign, 20.0, 30.0, 70.0)
    config = StudyConfig(approaches=("cae",))
    found = certify_matrix(campaign, CRITERIA, asked, config, cache=Cache(shared_cache), workers=1)
    (crush, olc, rating), *others = found.verdicts
    unknown = replace(olc, value=None, lower=None, upper=None, probability=None, word="open")
    return replace(found, verdicts=((crush, unknown, rating), *others))


@pytest.fixture(scope="module")
def text(certification: Certification, shared_cache: Path) -> str:
    """Its report."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CRASHFUSE_CACHE", str(shared_cache))
        return certification_report(certification)


def wrong(certification: Certification) -> Certification:
    """The same with a verdict that a test contradicts."""
    first, *rest = certification.record.trials
    said = replace(first, verdict=replace(first.verdict, word="not met" if first.met else "met"))
    return replace(certification, record=TrackRecord((said, *rest)))


def headings(text: str) -> list[str]:
    """All headings of sections, in order."""
    return re.findall("<h2>(.*?)</h2>", text)


def test_the_order_is_that_of_a_review(text: str) -> None:
    """Intended use first, verification before validation, prediction, track record, exceptions; signatures last."""
    assert headings(text) == [
        "Intended use",
        "Validated domain, and the conditions in it",
        "Method and settings",
        "Is the CAE model fit to be believed?",
        "Data: 4 tests, 24 CAE runs",
        "How well tests repeat",
        "Evidence from left-out tests",
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
    assert text.count('class="plotly-graph-div"') == 1 + 2 + 1 + 1  # domain, record, reliability, matrix
    assert certification.campaign.fingerprint in text
    assert certify_command(certification.config) in text


def test_exceptions_are_all_named(certification: Certification) -> None:
    """Warnings, conditions outside, cells that cannot be told, wrong verdicts, criteria without support or tests."""
    campaign = replace(certification.campaign, warnings=("Two tests look alike.",))
    found = exceptions(replace(wrong(certification), campaign=campaign))
    assert found["Warnings about the campaign"] == ("Two tests look alike.",)
    [outside] = found["Conditions outside the validated domain"]
    assert outside.startswith("M70: 70.0 mph is 35.0 mph above the fastest test")
    assert found["Open, because recordings end too early to predict"] == ("M20: OLC.",)
    [mistaken] = found["Wrong verdicts on left-out tests"]
    assert mistaken.startswith("T1, left out alone: crush (at most 430 mm) was said to be not met; measured 200.0 mm.")
    for unsupported in found["Criteria whose record does not support the confidence"]:
        assert "verdicts with no more than" in unsupported
    [untouched] = found["Criteria whose limit no left-out test came near"]
    assert untouched.startswith("rating: No left-out test came near")
    few = exceptions(certification)["Criteria whose own record does not support the confidence alone"]
    none, others = (
        "No verdict on this metric was held against a test",
        "with those on other criteria, at most 5 a test,",
    )
    told = f"crush: {none}; {others} 0 of 4 wrong."
    assert few == (told,)
    assert told in summary(certification)


def test_an_occupant_model_of_ones_own_is_an_exception(certification: Certification) -> None:
    """A limit on OLC means another number by it; crush does not."""
    own = replace(certification.campaign, occupant=OccupantModel(olc_free_flight_mm=120.0))
    subject = "Criteria by another occupant model than the usual one"
    (told,) = exceptions(replace(certification, campaign=own))[subject]
    assert told.startswith("OLC: by 120 + 235 mm, as campaign.toml has it")
    assert subject not in exceptions(certification)


def test_open_cells_say_how_far_their_limit_is(certification: Certification, text: str) -> None:
    """In the unit of the criterion, and in half widths of the interval."""
    verdict = certification.verdicts[1][0]
    assert verdict.word == "open"
    assert verdict.value is not None
    assert verdict.lower is not None
    assert verdict.upper is not None
    section = text[text.index("how far the limit is") :]
    share = (verdict.value - 430) / ((verdict.upper - verdict.lower) / 2)
    assert f"<td>{verdict.value - 430:.4g}\N{NO-BREAK SPACE}mm</td><td>{share:.2f}</td>" in section


def test_open_cells_whose_interval_has_an_open_end_are_among_them(certification: Certification) -> None:
    """Without a share of the interval, behind those that have one."""
    first, (crush, *others), third = certification.verdicts
    ended = replace(crush, lower=None)
    text = certification_report(replace(certification, verdicts=(first, (ended, *others), third)))
    section = text[text.index("how far the limit is") :]
    assert "mm</td><td>–</td>" in section


def test_the_record_is_told_with_its_exact_bound(certification: Certification) -> None:
    """1 of 9 wrong: at most 42.9 %, for with that share one or none of nine is wrong in 5 % of cases."""
    record = wrong(certification).record
    decided, mistaken = record.decided
    assert (decided, mistaken) == (9, 1)
    assert (
        "9 verdicts met or not met, 1 wrong (at most 42.9 %, exact 95 % bound if they did not hang together)"
        in record_sentence(record)
    )
    assert pytest.approx(0.05, abs=5e-4) == 0.571**9 + 9 * 0.429 * 0.571**8
    assert record_sentence(TrackRecord(())) == "There is no record: with a single test, none can be left out."


def test_what_need_not_be_run_is_told_with_its_record_of_whole_tests(certification: Certification) -> None:
    """Not of verdicts: a test need not be run if all its criteria are met. Where none was, nothing is known."""
    criteria, trials = certification.criteria, certification.record.trials
    fast = max(certification.campaign.tests, key=lambda test: test.condition.speed_mps).id
    one = [trial for trial in trials if (trial.held_out, trial.left_out) == (fast, "test")]
    assert len(one) == len(criteria.items)
    told: dict[Word, str] = {
        "met": "Of 1 test, left out alone and with the speed group, 1 need not have been run, as every criterion was ",
        "open": "Of 1 test, left out alone and with the speed group, none met every criterion by its verdicts. ",
    }
    for word, said in told.items():
        sure = (replace(trial, verdict=replace(trial.verdict, word=word, probability=0.99)) for trial in one)
        [sentence] = waived_sentence(TrackRecord(tuple(sure)), criteria)
        assert sentence.startswith(said)
        assert ("of these missed one all the same (at most " in sentence) is (word == "met")
    waived = tuple(
        replace(own, word="met", probability=p)
        for own, p in zip(certification.verdicts[0], (0.9, 0.99, 1), strict=True)
    )
    sentences = summary(replace(certification, verdicts=(waived, *certification.verdicts[1:])))
    at = sentences.index(_NOT_RUN.format(certification.matrix.ids[0], "0.890"))
    assert sentences[at + 1] == next(waived_sentence(certification.record, criteria))
    assert list(waived_sentence(TrackRecord(()), criteria)) == []


def test_every_condition_that_need_not_be_run_has_its_probability_in_the_dossier(certification: Certification) -> None:
    """The summary names neighbours as a range, with the least; the table of conditions has all."""
    many = matrix(certification.campaign, *(20 + i / 10 for i in range(30)))
    less, more = (
        tuple(
            replace(own, word="met", probability=p)
            for own, p in zip(certification.verdicts[0], (first, 0.9996, 1), strict=True)
        )
        for first in (0.9, 0.95)
    )
    found = replace(certification, matrix=many, verdicts=(more, *(less,) * 28, more))
    assert any(sentence.endswith(": M20 to M22.9 (0.900 or more).") for sentence in summary(found))
    assert certification_report(found).count("<td>≥ 0.900</td>") == 28
    assert "<td>≥" not in certification_report(certification).partition("<section id=method>")[0]


def test_a_brier_score_is_never_zero_beside_a_wrong_verdict_on_a_rating(certification: Certification) -> None:
    """It is that of metrics, and says so; what rounds to zero is below a bound."""
    [first, *_] = [trial for trial in certification.record.trials if trial.cae_probability is not None]
    sure = replace(first, verdict=replace(first.verdict, probability=1.0 if first.met else 0.0, word="open"))
    [sentence] = brier_sentence(TrackRecord((sure,)))
    assert sentence.startswith(
        "Brier score of the probabilities of metrics, ratings aside (0 is perfect): below 0.0001; "
    )


def test_probabilities_that_did_not_come_true_or_gain_nothing_are_exceptions(certification: Certification) -> None:
    """A bin outside its bounds, and a Brier score that is not below that of the raw CAE."""
    [first, *_] = [trial for trial in certification.record.trials if trial.cae_probability is not None]
    said, ours = (
        replace(first.verdict, probability=0.9, word="open"),
        "Probabilities no better than those of the raw CAE",
    )
    limit = first.verdict.criterion.at_most
    assert limit is not None
    for measured, cae, contradicted, worse in ((limit + 1, 0.8, True, True), (limit - 1, 0.8, False, False)):
        trials = tuple(
            replace(first, held_out=f"T{i}", verdict=said, measured=measured, cae_probability=cae) for i in range(9)
        )
        found = exceptions(replace(certification, record=TrackRecord(trials)))
        told = found.get("Probabilities that left-out tests contradict", ())
        assert told == (
            ("0.75 to 0.95, 0.900 on average: 0 of 9 met it (exact 95 % bounds 0.000 to 0.336).",) * contradicted
        )
        assert (ours in found) is worse


def test_the_summary_says_where_to_test(certification: Certification) -> None:
    """Conditions that need no test, would miss a criterion or are open; without any open or outside, none needs one.

    One that would miss a criterion takes another design: a test there, though others are open, would tell nothing new.
    """
    said = summary(certification)
    assert said[0].startswith("3 conditions × 3 criteria, confidence 0.8: ")
    assert any(own.startswith("Outside what the tests check: M70: 70.0 mph is 35.0 mph above") for own in said)
    too_early = "Recordings end too early to tell, so a test there has to be recorded for longer: M20 (OLC)."
    assert too_early in said  # a test as long as the others would not tell either
    first, second, third = certification.verdicts
    missed, undecided = replace(first[0], word="not met"), replace(second[1], word="open", probability=0.5)
    met_too = [undecided, *(replace(own, word="met") for own in second[2:])]
    rows = (
        tuple(replace(own, word="met", probability=p) for own, p in zip(first, (0.9, 1, 1), strict=True)),
        (missed, *met_too),
        third,
    )
    first_id, second_id, _ = certification.matrix.ids
    said = summary(replace(certification, verdicts=rows))
    assert _NOT_RUN.format(first_id, "0.900") in said
    assert f"A test would miss: {second_id} ({missed.criterion.name})." in said
    assert not any(second_id in sentence for sentence in said if sentence.startswith("To be tested"))
    said = summary(replace(certification, verdicts=(rows[0], (replace(first[0], word="met"), *met_too), third)))
    assert f"To be tested, or redesigned: {second_id} ({undecided.criterion.name})." in said
    met = tuple(tuple(replace(own, word="met", probability=0.99) for own in row) for row in certification.verdicts)
    assert "No condition of the matrix needs a test." in summary(replace(certification, verdicts=met))
    last = "No other condition of the matrix needs a test."
    assert last in summary(replace(certification, verdicts=(met[0], (missed, *met[1][1:]), met[2])))


def test_a_test_is_needed_where_all_criteria_are_not_met_at_once_with_the_confidence(
    certification: Certification,
) -> None:
    """Three of 0.93 each leave 0.79 for all, less than the 0.8 asked for; of 0.94 each, 0.82."""
    ids = certification.matrix.ids
    rows = [
        tuple(replace(own, word="met", probability=p) for own in row)
        for row, p in zip(certification.verdicts, (0.93, 0.94, 0.99), strict=True)
    ]
    found = replace(certification, verdicts=tuple(rows))
    assert (list(found.uncertain), list(found.waived), found.run_first) == ([ids[0]], [ids[1], ids[2]], None)
    said = summary(found)
    told = "To be tested, as each criterion is met but all at once not with a confidence of 0.8 (in brackets): "
    assert f"{told}{ids[0]} (0.790)." in said
    assert not any("needs a test" in sentence for sentence in said)
    assert list(certification_record(found)["waived"]) == [ids[1], ids[2]]  # type: ignore[call-overload]


def test_conditions_that_are_one_are_one_test_that_need_not_be_run(certification: Certification) -> None:
    """Or copies would pad what is saved; beside a condition that was run, a copy saves nothing."""
    many = matrix(certification.campaign, 20.0, 20.1, 20.2, 30.0)
    met = tuple(replace(own, word="met", probability=1.0) for own in certification.verdicts[0])
    found = replace(certification, matrix=many, verdicts=(met,) * 4)
    once = "need not be run, as conditions that are one to within 1 km/h and 2 % of each weight are counted once: "
    assert f"2 of 2 tests {once}M20.1 (as M20), M20.2 (as M20)." in summary(found)
    record = certification_record(found)
    assert (record["saved"], record["counted_once"]) == ({"n": 2, "tests": 2}, {"M20.1": "M20", "M20.2": "M20"})
    ran = tuple(replace(own, run={"T1": 1.0}) for own in met)
    assert replace(found, verdicts=(met, met, ran, met)).saved == (1, 2)
    assert "counted once" not in " ".join(summary(certification))


def test_notes_on_tests_stand_in_the_dossier_as_text(certification: Certification) -> None:
    """A reviewer has to know that an accelerometer came loose; without any there is no such section."""
    notes = [Note("T2", "bracket <loose> at the tunnel", 30.0)]
    report = certification_report(certification, notes=notes)
    assert "<td>T2</td><td class=when>30 ms</td><td>bracket &lt;loose&gt; at the tunnel</td>" in report
    assert "id=notes" not in certification_report(certification)


def test_a_test_that_is_needed_is_not_one_that_need_not_be_run(certification: Certification) -> None:
    """Who runs it runs the condition beside it, too, which so saves nothing; one run beside it does not settle it."""
    many = matrix(certification.campaign, 20.0, 20.3, 20.6, 30.0)
    met = tuple(replace(own, word="met", probability=1.0) for own in certification.verdicts[0])
    unsettled = tuple(replace(own, word="open", probability=0.5) for own in met)
    found = replace(certification, matrix=many, verdicts=(met, unsettled, met, met))
    assert (found.counted_once, found.saved) == ({"M20": "M20.3", "M20.6": "M20.3"}, (1, 2))
    ran = tuple(replace(own, run={"T1": 1.0}) for own in met)
    found = replace(certification, matrix=many, verdicts=(ran, unsettled, met, met))
    assert (found.counted_once, found.saved) == ({"M20.6": "M20.3"}, (1, 3))


def test_a_condition_that_was_run_is_told_by_what_it_showed(certification: Certification) -> None:
    """Not among those that a test would miss: the test did."""
    first, second, third = certification.verdicts
    missed = tuple(replace(own, word="not met", run={"T3": 1e6}) for own in first)
    said = summary(replace(certification, verdicts=(missed, second, third)))
    ids = certification.matrix.ids
    names = ", ".join(own.name for own in certification.criteria.items if not own.is_met_by(1e6))
    there = certification.campaign.test("T3").condition
    assert f"Run already: {ids[0]} (test T3, at {there}, which missed {names})." in said
    assert not any(sentence.startswith("A test would miss") and ids[0] in sentence for sentence in said)


def test_conditions_without_a_factor_or_with_a_new_combination_are_exceptions(certification: Certification) -> None:
    """A verdict on a vehicle of which the drive is not known, or on one that no test resembles, says so."""
    campaign = certification.campaign
    kinds = (("FWD", "I"), ("AWD", "II"), ("FWD", "I"), ("FWD", "I"))
    tests = tuple(
        replace(test, condition=replace(test.condition, factors=(("drive", drive), ("type", kind))))
        for test, (drive, kind) in zip(campaign.tests, kinds, strict=True)
    )
    campaign = replace(campaign, tests=tests)
    conditions = [
        replace(condition, factors=factors)
        for condition, factors in zip(
            certification.matrix.conditions,
            ((("drive", "FWD"), ("type", "II")), (("drive", "FWD"),), (("drive", "AWD"), ("type", "II"))),
            strict=True,
        )
    ]
    own = Matrix(certification.matrix.ids, tuple(conditions))
    found = exceptions(replace(certification, campaign=campaign, matrix=own, domain=Domain.of(campaign)))
    [together] = found["Factors that no test has together"]
    assert together == f"{own.ids[0]}: no test has drive FWD, type II; each was tested with another."
    [missing] = found["Conditions without a factor that the tests have"]
    assert missing.startswith(
        f"{own.ids[1]}: no type is given, so the verdicts are on a vehicle of which it is not known"
    )


def test_what_is_so_of_every_condition_is_said_once(certification: Certification) -> None:
    """Not in brackets after each of a hundred; what is so of one alone is."""
    kind = ("drive", "FWD"), ("type", "II")
    tests = (replace(own, condition=replace(own.condition, factors=kind)) for own in certification.campaign.tests)
    campaign = replace(certification.campaign, tests=tuple(tests))
    conditions = certification.matrix.conditions
    conditions = tuple(replace(own, factors=()) for own in conditions)
    first = replace(conditions[0], factors=(("type", "II"),))
    met = tuple(tuple(replace(own, word="met", probability=1.0) for own in row) for row in certification.verdicts)
    found = replace(certification, campaign=campaign, domain=Domain.of(campaign), verdicts=met)
    told = list(to_test(replace(found, matrix=Matrix(found.matrix.ids, (first, *conditions[1:])))))
    one, two, three = found.matrix.ids
    assert told[0] == "Of every condition: drive not given."
    assert f"{one} (>0.999), {two} (>0.999; type not given), {three} (>0.999; type not given)." in told[1]


def test_of_conditions_to_be_tested_the_fastest_is_run_first(certification: Certification) -> None:
    """Said if a test can settle two or more: not one that was run, misses a criterion, or whose record is too short."""
    assert certification.run_first is None  # the record is too short for one, the other is outside
    ids = certification.matrix.ids
    rows = certification.verdicts
    undecided = tuple(tuple(replace(own, word="open", probability=0.5) for own in row) for row in rows)
    speeds = [row[0].condition.speed_mps for row in undecided]
    assert speeds == sorted(speeds)

    def first(*rows: tuple[Verdict, ...]) -> str | None:
        return replace(certification, verdicts=rows).run_first

    assert first(*undecided) == ids[2]
    one, two, three = undecided
    missed = (replace(three[0], word="not met"), *three[1:])
    assert first(one, two, missed) == ids[1]
    assert first(one, two, tuple(replace(own, run={"T01": 1.0}) for own in three)) == ids[1]
    assert first(one, two, (replace(three[0], probability=None), *three[1:])) == ids[1]
    assert first(one, tuple(replace(own, word="met", probability=0.99) for own in two), missed) is None
    assert first(one, tuple(replace(own, word="met", probability=0.9) for own in two), missed) == ids[1]
    told = replace(certification, verdicts=undecided)
    expected = f"Run {ids[2]} first, the fastest that a test can settle, and certify again: others may then need none."
    assert expected in summary(told)
    assert certification_record(told)["run_first"] == ids[2]


def test_a_test_where_others_were_run_is_asked_for_with_the_numbers(certification: Certification) -> None:
    """Four within 1 km/h and 2 % of the mass, none made for it: what they showed, and what another one would."""
    there = replace(certification.matrix.conditions[2], front_weight_kg=1000.0, rear_weight_kg=700.0)
    near = [
        replace(test, condition=replace(there, speed_mps=there.speed_mps + 0.6 * KPH, front_weight_kg=front))
        for test, front in zip(certification.campaign.tests, (975.0, 978.0, 1021.0, 1022.0), strict=True)
    ]
    rows = tuple(
        tuple(replace(own, condition=replace(own.condition), word="open", probability=0.917) for own in row)
        for row in certification.verdicts
    )
    (*_, last), ids = rows, certification.matrix.ids
    rows = (*rows[:-1], tuple(replace(own, condition=there) for own in last))
    found = replace(certification, verdicts=rows, campaign=replace(certification.campaign, tests=tuple(near)))
    told = list(to_test(found))
    assert f"T1, T2, T3 and T4 were run within 0.4 mph and 55 lb of {ids[2]}" in "\n".join(told)
    crush = [t.measured for t in found.record.trials if t.left_out == "test" and t.verdict.criterion.name == "crush"]
    showed = CRITERIA.items[0].shown(min(crush), max(crush))
    short = "Another test meets it with probability 0.917, and 0.8 is asked for."
    assert f"Of crush (at most 430 mm) they showed {showed}. {short}" not in told  # it is asked for less
    rows = tuple(tuple(replace(own, probability=0.717) for own in row) for row in rows)
    told = list(to_test(replace(found, verdicts=rows)))
    assert f"Of crush (at most 430 mm) they showed {showed}. {short.replace('0.917', '0.717')}" in told
    far = tuple(
        replace(test, condition=replace(test.condition, speed_mps=there.speed_mps + 1.1 * KPH)) for test in near
    )
    told = list(to_test(replace(found, verdicts=rows, campaign=replace(found.campaign, tests=far))))
    assert not any("run within" in sentence for sentence in told)


def test_the_domain_is_told_in_numbers(certification: Certification) -> None:
    """From below the slowest test to above the fastest, within the CAE runs."""
    speeds, reach = domain_sentences(certification.domain)
    assert ": 10.0 to 35.0 mph, front and rear weight together " in speeds
    assert "drive FWD" in speeds
    assert "0.0 mph above the fastest, where the CAE runs end." in reach


def test_a_single_test_makes_a_dossier_that_says_so(campaign: Campaign, shared_cache: Path) -> None:
    """No record, no figures of one, no table of repeats; everything outside."""
    alone = replace(campaign, tests=campaign.tests[:1])
    config = StudyConfig(approaches=("cae",))
    found = certify_matrix(alone, CRITERIA, matrix(campaign, 20.0), config, cache=Cache(shared_cache), workers=1)
    text = certification_report(found)
    assert "There is no record: with a single test, none can be left out." in text
    assert "How well tests repeat" not in headings(text)
    assert "One test is too few to check verdicts" in text
    assert "Data: 1 test, 24 CAE runs" in headings(text)
    assert "With 1 test, no calibration" in text
    assert "Each test was left out in turn" not in text
    assert ">outside</td>" in text
    assert ">inside</td>" not in text


def test_the_bound_does_not_rest_on_limits_that_no_test_came_near(certification: Certification) -> None:
    """They are told apart, with the bound without them."""
    record = certification.record
    (decided, _), (telling, _) = record.decided, record.telling.decided
    assert 0 < telling < decided
    said = record_sentence(record)
    far = "show nothing more, on a metric a second time or on limits that no left-out test came near"
    assert f"{decided - telling} of the {decided} {far}" in said
    assert f"without them, 0 of {telling} wrong (at most {100 * (1 - 0.05 ** (1 / telling)):.1f} %)." in said
    assert record_sentence(record.telling).endswith(" open or outside.")
    told = certification_record(certification)["track_record"]["telling"]  # type: ignore[index]
    assert told == {"n": telling, "wrong": 0, "wrong_at_most": pytest.approx(1 - 0.05 ** (1 / telling), abs=1e-4)}


def test_the_dossier_says_what_its_bounds_and_intervals_rest_on(certification: Certification, text: str) -> None:
    """How many intervals held, that verdicts in one test hang together, and what lies beyond the counts."""
    inside, n = certification.record.intervals
    assert n > 0
    assert f"{inside} of {n} intervals held what the left-out test measured" in text
    assert certification_record(certification)["track_record"]["intervals"] == {"n": n, "inside": inside}  # type: ignore[index]
    words = " ".join(text.split())
    assert "as if verdicts were independent. They are not" in words
    assert "take errors to be distributed as Student's t" in words
    assert "Intervals hold 95 %" not in words
    assert "whatever the probability, it is open, too, where the record of left-out tests does not support" in words


def test_limits_stand_as_declared_beside_the_readers_units(certification: Certification) -> None:
    """48 km/h, not 29.83 mph alone; where the reader's units are those of the criteria, once."""
    limit = Criterion("change", "delta_v", at_most=48.0)
    criteria = replace(certification.criteria, items=(*certification.criteria.items[:2], limit))
    rows = tuple((*row[:2], replace(row[0], criterion=limit)) for row in certification.verdicts)
    found = replace(certification, criteria=criteria, verdicts=rows)
    assert "<td>at most 29.83 mph</td><td>at most 48 km/h</td>" in certification_report(found)
    metric = certification_report(found, Display(system=KPH_KG))
    assert "at most 48 km/h" in metric
    assert "As declared" not in metric


def test_long_tables_are_cut_and_say_where_the_rest_is(certification: Certification) -> None:
    """A matrix of 400 conditions by 3 criteria has 1200 rows in the CSV, of which the report shows 1000."""
    many = matrix(certification.campaign, *(20 + i / 40 for i in range(400)))
    text = certification_report(replace(certification, matrix=many, verdicts=(certification.verdicts[0],) * 400))
    assert "200 more rows are in certification.csv." in text
    assert text.count('class="plotly-graph-div"') == 1 + 2 + 1 + 1  # the matrix as one figure, in colours alone


def test_the_command_is_parsed_back_to_its_settings() -> None:
    """Approach, preset, seed and device, as they were."""
    config = StudyConfig(approaches=("displacement_domain",), preset="fast", seed=7, device="cpu")
    _, *command = certify_command(config).split()
    parsed = cli.parser().parse_args(command)
    assert (parsed.approach, parsed.preset, parsed.seed, parsed.device) == ("displacement_domain", "fast", 7, "cpu")
    assert (parsed.criteria, parsed.matrix) == (Path("criteria.toml"), Path("matrix.csv"))
