"""An earlier certification beside a later one: what came true, what changed, and what cannot be compared."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Certification, certify_matrix
from crashfuse.certification.changes import Changes
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.earlier import Earlier, EarlierVerdict
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.verdict import Word
from crashfuse.execution.cache import Cache
from crashfuse.reporting.certification_changes import change_sentences, changes_table, shown_changes
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.report import certification_report
from crashfuse.study.config import StudyConfig
from crashfuse.units import MPH

pytestmark = pytest.mark.usefixtures("one_cache")

CRUSH, PEAK = Criterion("crush", "max_crush", at_most=430.0), Criterion("peak", "peak", at_most=25.0)
MET, MISSED = EarlierVerdict("met", 0.97, 100.0, 425.0), EarlierVerdict("not met", 0.02, 26.0, 27.0)
OPEN = EarlierVerdict("open", 0.6, 10.0, 500.0)


@pytest.fixture(scope="module")
def later(campaign: Campaign, shared_cache: Path) -> Certification:
    """Verdicts of the raw CAE model at the condition of each test, and at 20 mph."""
    conditions = [test.condition for test in campaign.tests]
    slow = replace(conditions[1], speed_mps=20 * MPH)
    matrix = Matrix((*(f"at {test}" for test in campaign.test_ids), "slow"), (*conditions, slow))
    config = StudyConfig(approaches=("cae",))
    return certify_matrix(campaign, Criteria((CRUSH, PEAK), 0.8), matrix, config, cache=Cache(shared_cache), workers=1)


def earlier(later: Certification, rows: Sequence[tuple[EarlierVerdict, ...]], tests: tuple[str, ...] = ()) -> Earlier:
    """A certification that said this of the same conditions, from these tests."""
    read = Earlier.parse(certification_json(later))
    return replace(read, tests=tests, run={}, verdicts=tuple(rows))


def rows(*words: EarlierVerdict) -> list[tuple[EarlierVerdict, ...]]:
    """Both criteria alike, a verdict a condition."""
    return [(own, own) for own in words]


def test_a_certification_beside_itself_says_that_nothing_changed(later: Certification) -> None:
    """Read from its own file: all verdicts as they were, and no test since."""
    changes = Changes.of(Earlier.parse(certification_json(later)), later)
    n = len(later.cells)
    assert [(before, now.word) for _, before, now in changes.compared] == [
        (EarlierVerdict(own.word, own.probability, own.lower, own.upper), own.word) for _, own in later.cells
    ]
    assert (changes.new_tests, changes.run_since, changes.outcomes) == ((), {}, (0, 0))
    assert shown_changes(changes).empty
    said = " ".join(change_sentences(changes))
    assert "no test is new" in said
    assert "No test was run at its conditions since" in said
    assert f"Of {n} verdicts that both have, {n} are as they were" in said
    assert "otherwise" not in said
    assert "Not compared" not in said


@pytest.mark.parametrize(("word", "wrong"), [("met", True), ("not met", False)])
def test_a_test_run_since_tells_whether_a_verdict_came_true(later: Certification, word: Word, wrong: bool) -> None:
    """By what was measured, against the limit; an open verdict is neither right nor wrong."""
    campaign = later.campaign
    fastest = max(campaign.tests, key=lambda test: test.condition.speed_mps)
    measured = {metric.name: metric.value for metric in campaign.metrics_of(fastest)}
    assert (measured["peak"] or 0) > 25
    said = [(OPEN, OPEN)] * len(later.matrix.ids)
    said[campaign.test_ids.index(fastest.id)] = (OPEN, EarlierVerdict(word, 0.5, 0.0, 1.0))
    known = tuple(test for test in campaign.test_ids if test != fastest.id)
    changes = Changes.of(earlier(later, said, known), later)
    assert changes.new_tests == (fastest.id,)
    assert changes.run_since == {f"at {fastest.id}": (fastest.id,)}
    assert changes.outcomes == (1, int(wrong))
    (row,) = changes_table(changes).query("came_true != ''").to_dict("records")
    assert (row["id"], row["criterion"], row["came_true"]) == (f"at {fastest.id}", "peak", not wrong)
    assert row["measured"] == pytest.approx(measured["peak"])
    assert changes.intervals == (sum([10 <= (measured["max_crush"] or 0) <= 500, False]), 2)
    told = [own for own in change_sentences(changes) if "was said to be" in own]
    assert len(told) == int(wrong)
    assert all(fastest.id in own and "at most 25 g" in own for own in told)


def test_two_limits_on_one_metric_are_one_verdict(later: Certification) -> None:
    """Or a criterion written twice would make a record; a wrong one counts."""
    n = len(later.matrix.ids)
    loose = replace(PEAK, name="loose", at_most=1000.0)
    before = replace(earlier(later, [(OPEN, MET, MET)] * n), criteria=Criteria((CRUSH, PEAK, loose), 0.8))
    changes = Changes.of(before, later)
    peaks = [m.value or 0.0 for t in later.campaign.tests for m in later.campaign.metrics_of(t) if m.name == "peak"]
    assert changes.outcomes == (len(peaks), sum(peak > 25.0 for peak in peaks))


def test_of_conditions_that_needed_no_test_it_is_told_which_criteria_were_missed(later: Certification) -> None:
    """That answer is what a test is saved by; one that was not met is no such answer."""
    tests = later.campaign.test_ids
    changes = Changes.of(earlier(later, rows(*[MET] * (len(tests) - 1), MISSED, OPEN)), later)
    measured = {t.id: {m.name: m.value or 0.0 for m in later.campaign.metrics_of(t)} for t in later.campaign.tests}
    expected = {
        f"at {test}": {
            test: tuple(
                own.name for own in (CRUSH, PEAK) if not own.is_met_by(measured[test][own.metric])
            )
        }
        for test in tests[:-1]
    }  # fmt: skip
    assert changes.waived_outcomes == expected
    assert any(names for own in expected.values() for names in own.values())
    assert any("needed no test, yet missed: " in own for own in change_sentences(changes))


def test_statements_that_were_gained_and_withdrawn_are_listed(later: Certification) -> None:
    """By the ids of today, whatever the earlier ones were; a condition that was run since is neither."""
    crush, peak = later.verdicts[-1]
    met = replace(later, verdicts=(*later.verdicts[:-1], (replace(crush, word="met"), replace(peak, word="met"))))
    others = [OPEN] * (len(later.matrix.ids) - 1)
    renamed = replace(later.matrix, ids=tuple(f"x{i}" for i in later.matrix.ids))
    gained = Changes.of(replace(earlier(later, rows(*others, OPEN)), matrix=renamed), met)
    assert (gained.newly_waived, gained.withdrawn) == (("slow",), ())
    open_now = replace(later, verdicts=(*later.verdicts[:-1], (replace(crush, word="open"), peak)))
    lost = Changes.of(replace(earlier(later, rows(*others, MET)), matrix=renamed), open_now)
    assert (lost.newly_waived, lost.withdrawn) == ((), ("slow",))
    said = [*change_sentences(gained), *change_sentences(lost)]
    assert "Need not be run any more: slow." in said
    assert "Needed no test then, and do now: slow." in said


def test_verdicts_that_turned_round_are_named(later: Certification) -> None:
    """From met to not met, as what was said was wrong then or is now."""
    crush, peak = later.verdicts[-1]
    now = replace(later, verdicts=(*later.verdicts[:-1], (replace(crush, word="not met"), replace(peak, word="met"))))
    before = rows(*[OPEN] * (len(later.matrix.ids) - 1), MET)
    assert "Turned round: slow (crush)." in change_sentences(Changes.of(earlier(later, before), now))


def test_another_limit_or_condition_is_not_compared(later: Certification) -> None:
    """It is counted, and stands in the table beside nothing."""
    before = earlier(later, rows(*[OPEN] * len(later.matrix.ids)))
    slower = replace(later.matrix.conditions[-1], speed_mps=19 * MPH)
    other = replace(
        before,
        matrix=replace(later.matrix, conditions=(*later.matrix.conditions[:-1], slower)),
        criteria=Criteria((CRUSH, replace(PEAK, at_most=24.0)), 0.8),
    )
    changes = Changes.of(other, later)
    n = len(later.matrix.ids)
    assert len(changes.compared) == n - 1
    said = change_sentences(changes)
    assert f"Not compared, as a condition or a limit is another: {n + 1} verdicts of then, {n + 1} of now." in said
    table = changes_table(changes)
    assert (table["earlier_verdict"] == "").sum() == (table["verdict"] == "").sum() == n + 1
    assert "not asked" in shown_changes(changes)["Then"].tolist()


def test_what_was_made_otherwise_is_told(later: Certification) -> None:
    """Seed, approach and confidence decide verdicts as tests do."""
    before = replace(earlier(later, rows(*[OPEN] * len(later.matrix.ids))), criteria=Criteria((CRUSH, PEAK), 0.9))
    before = replace(before, settings={**before.settings, "seed": 7}, tests=("OLD",))
    said = " ".join(change_sentences(Changes.of(before, later)))
    assert "Made otherwise: seed 0 (then 7); confidence 0.8 (then 0.9)." in said
    assert "no longer used: OLD" in said


def test_what_became_of_it_stands_in_json_and_report(later: Certification) -> None:
    """With the digest of the earlier file; without an earlier one, nothing is said of it."""
    changes = Changes.of(earlier(later, rows(*[MET] * len(later.matrix.ids))), later)
    since = json.loads(certification_json(later, changes))["since"]
    n, wrong = changes.outcomes
    assert wrong > 0
    assert (since["decided"]["n"], since["decided"]["wrong"]) == (n, wrong)
    assert since["sha256"] == changes.earlier.digest
    assert since["sentences"] == [str(own) for own in change_sentences(changes)]
    report = certification_report(later, changes=changes)
    assert "<h2>Earlier verdicts, and what became of them</h2>" in report
    assert changes.earlier.digest[:12] in report
    assert "Earlier verdicts" not in certification_report(later)
    assert "since" not in json.loads(certification_json(later))
