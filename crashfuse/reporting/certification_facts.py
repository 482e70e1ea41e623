"""What is said of a certification: every fact once, with its code and values, and where each of them is shown."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import chain, groupby
from typing import Literal, NamedTuple

import pandas as pd

from crashfuse.certification.certify import Answer, Certification
from crashfuse.certification.verdict import Verdict, all_met
from crashfuse.condition import Condition
from crashfuse.execution.cache import remembered
from crashfuse.reporting import evidence_facts
from crashfuse.reporting.certification_tables import at_once_text
from crashfuse.reporting.evidence_facts import fact, listed
from crashfuse.reporting.plots.display import Display
from crashfuse.study.facts import Fact, by_importance, campaign_facts, tuning_fact
from crashfuse.study.outliers import departures_near
from crashfuse.units import Sentence, counted, joined, number, read_out

Place = Literal["answer", "costs", "summary", "matrix", "record", "domain", "since"]
SUBJECTS = {
    "test.stands_apart": "Tests that stand apart",
    "since.wrong": "Verdicts that tests run since contradict",
    "record.none": "No record",
    "criterion.unsupported": "Criteria whose record does not support the confidence",
    "record.wrong": "Wrong verdicts on left-out tests",
    "test.extrapolated": "Tests outside the range of the CAE runs",
    "cae.runs_fail": "CAE runs in doubt",
    "tests.left_out_of_use": "Tests left out of use",
    "test.not_used": "Tests that are not used",
    "tests.cae_tuned": "What the CAE model has seen",
    "campaign.archive": "What past vehicles teach",
    "condition.no_factor": "Conditions without a factor that the tests have",
    "condition.new_together": "Factors that no test has together",
    "campaign.warning": "Warnings about the campaign",
    "condition.outside": "Conditions outside the validated domain",
    "condition.too_short": "Open, as recordings end too early",
    "criterion.occupant": "Criteria by another occupant model",
    "record.too_narrow": "Intervals that left-out tests contradict",
    "record.bin": "Probabilities that left-out tests contradict",
    "record.no_gain": "Probabilities no better than those of the raw CAE",
    "criterion.untouched": "Criteria whose limit no left-out test came near",
    "criterion.few": "Criteria with too few verdicts of their own",
}
"""What speaks against the verdicts, by code, the most important first: its heading among the exceptions."""
DECISIVE = tuple(SUBJECTS.values())[: list(SUBJECTS).index("condition.new_together") + 1]
"""The subjects that stand beside the answer itself: down to factors that no test has together."""
_ANSWER = ("matrix.saved",)
_COSTS = ("costs.confidence", "costs.saving")
_MATRIX = ("matrix.every", "matrix.none_needed", "matrix.run_first")
_RECORD = ("record.waived", "record.decided", "record.with_runs")
_CONDITIONS = ("test.not_used", "condition.no_factor", "condition.new_together")
_CRITERIA = ("criterion.unsupported", "criterion.untouched", "criterion.few")
PLACES: Mapping[Place, tuple[str, ...]] = {
    "answer": _ANSWER,
    "costs": _COSTS,
    "summary": (
        *(*_ANSWER, *_COSTS, "matrix.counts", *_MATRIX, *_RECORD, "record.brier", "record.no_gain", "since.outcomes"),
        *(*_CONDITIONS, *_CRITERIA, "record.none", "tests.cae_tuned"),
    ),
    "matrix": (
        *("test.stands_apart", *_ANSWER, *_COSTS, *_MATRIX, "record.waived", "since.wrong"),
        *("test.not_used", "criterion.unsupported"),
    ),
    "record": (
        *(*_RECORD, "record.intervals", "record.too_narrow", "record.whole", "record.no_gain"),
        *("record.none", "tests.cae_tuned"),
    ),
    "domain": ("domain.checked",),
    "since": ("since.beside", "since.outcomes", "since.wrong"),
}
"""The codes that are shown at each place, the most important one first: at the head of terminal, report and slides,
below the page's answer, and in tabs of the page and sections of the report."""


@remembered  # asked for by every place
def facts(certification: Certification) -> tuple[Fact, ...]:
    """All facts of a certification."""
    found = chain(
        _campaign(certification),
        _matrix(certification),
        _costs(certification),
        evidence_facts.record_facts(certification),
        evidence_facts.domain_facts(certification.domain),
        _conditions(certification),
        _not_used(certification),
        evidence_facts.criterion_facts(certification),
        () if certification.since is None else evidence_facts.since_facts(certification.since),
    )
    return tuple(replace(own, label=SUBJECTS.get(own.code, "")) for own in found)


class Planned(NamedTuple):
    """A planned test: the answer, and what decides it."""

    id: str
    condition: Condition
    word: Answer
    why: str


@remembered  # asked for by three parts of a page
def planned(certification: Certification) -> tuple[Planned, ...]:
    """The answer at every planned test, in the order of speed."""
    notes, same, found = _notes_at(certification)[1], certification.counted_once, []
    for i, condition in sorted(certification.matrix.items, key=lambda item: item[1].speed_mps):
        as_other = f"counts as {same[i]}" if i in same else ""
        texts = [text for text in (_why(certification, i), notes.get(i, ""), as_other) if text]
        found.append(Planned(i, condition, certification.answers[i], joined(texts, "; ")))
    return tuple(found)


def planned_table(certification: Certification, display: Display) -> pd.DataFrame:
    """The same as a table for readers."""
    return pd.DataFrame(
        {
            "Planned test": row.id,
            **display.columns(row.condition),
            **dict(row.condition.factors),
            "Answer": row.word,
            "Why": display.words(row.why),
        }
        for row in planned(certification)
    )


def shown(certification: Certification, place: Place) -> tuple[Fact, ...]:
    """The facts that a place shows, in its order."""
    order = PLACES[place]
    return by_importance((own for own in facts(certification) if own.code in order), order)


def sentences(certification: Certification, place: Place) -> tuple[str, ...]:
    """The same in words."""
    return tuple(own.sentence for own in shown(certification, place))


def exceptions(certification: Certification) -> dict[str, tuple[str, ...]]:
    """Everything that a reviewer has to know against the verdicts, by subject; subjects without any are left out."""
    order = tuple(SUBJECTS)
    against = by_importance((own for own in facts(certification) if own.code in order), order)
    return {subject: tuple(own.sentence for own in some) for subject, some in groupby(against, lambda own: own.label)}


def _campaign(certification: Certification) -> Iterator[Fact]:
    campaign = certification.campaign
    yield from (own for own in campaign_facts(campaign) if own.code in SUBJECTS and own.code != "tests.cae_tuned")
    if any(test.cae_tuned is not False for test in campaign.tests):
        yield tuning_fact(campaign)
    for test in campaign.tests:
        if notes := campaign.cae.extrapolation(test.condition):
            yield fact("test.extrapolated", joined([test.id, joined(notes)], ": "), test=test.id)


def _matrix(certification: Certification) -> Iterator[Fact]:
    ids, confidence = certification.matrix.ids, certification.criteria.confidence
    size = f"{counted(len(ids), 'condition')} × {counted(len(certification.criteria.items), 'criterion')}"
    told = ", ".join(f"{n} {word}" for word, n in certification.n_by_word.items())
    if n := sum(len(certification.rows[i]) for i in certification.run):
        told += f"; {n} of these at {listed(list(certification.run))}, tested already and learned from"
    yield fact("matrix.counts", f"{size}, confidence {confidence:g}: {told}.", **certification.counts)
    n, of = certification.saved
    once = [f"{i} as {other}" for i, other in certification.counted_once.items()]
    alike = f" Counted once, being within 1 km/h and 2 % of each weight: {listed(once)}." if once else ""
    yield fact("matrix.saved", f"{headline(certification)}.{alike}", n=n, of=of)
    of_all, _ = _notes_at(certification)
    if of_all:
        yield fact("matrix.every", f"Of every condition: {'; '.join(of_all)}.", notes=of_all)
    if set(certification.answers.values()) <= {"was run", "skip"}:
        yield fact("matrix.none_needed", "No condition of the matrix needs a test.")
    if first := certification.run_first:
        told = f"Run {first} first, the fastest that a test can settle, and certify again."
        yield fact("matrix.run_first", told, condition=first)


def _costs(certification: Certification) -> Iterator[Fact]:
    criteria, costs = certification.criteria, certification.criteria.costs
    if costs is None:
        return
    pays, confidence = costs.confidence, criteria.confidence
    asked = f"{'only ' * (confidence < pays)}{confidence:g} was asked for"
    if criteria.declared is None:
        nearest = ", the nearest that can be asked for" * (confidence != pays)
        asked = f"none was declared, so it follows from the costs: {confidence:g}{nearest}"
    told = f"By the costs ({costs}) skipping pays where an answer is right with {pays:g} or more; {asked}."
    values = {**asdict(costs), "pays_from": pays, "confidence": confidence, "follows": criteria.declared is None}
    yield fact("costs.confidence", told, **values)
    sure = [all_met(certification.rows[i]) for i in certification.sure if i not in certification.counted_once]
    if not sure:
        return
    expected, n = sum(costs.saving(1 - met.probability) for met in sure), len(sure)
    most, each = certification.record.bounds()["tests"].at_most, certification.cautious_saving
    cautious = None if each is None else n * each
    told = f"Skipping {counted(n, 'test')} that would meet all criteria {_outcome(expected)} on average."
    if most is not None and cautious is not None:
        told += f" If as many answers are wrong as the record cannot rule out ({100 * most:.0f} %), "
        told += f"it {_outcome(cautious)}{': none is skipped' * (cautious < 0)}."
    yield fact("costs.saving", told, n=n, expected=expected, cautious=cautious, wrong_at_most=most)


def headline(certification: Certification) -> str:
    """How many planned tests need not be run, or that skipping them does not pay."""
    n, of = certification.saved
    if certification.sure and certification.skipping_loses:
        return f"Skipping does not pay on this record: none of {counted(of, 'planned test')} is skipped"
    return f"{n:,} of {counted(of, 'planned test')} need not be run to know these pulse criteria"


def _outcome(saving: float) -> str:
    return f"{'saves' if saving >= 0 else 'loses'} {_amount(abs(saving))}"


def _amount(value: float) -> str:
    return number(float(f"{value:.3g}"), ",.10g")


def _why(certification: Certification, i: str) -> str:
    answer, row = certification.answers[i], certification.rows[i]
    if answer == "was run":
        return _tests_there(certification, row)
    if answer == "skip" or i in certification.uncertain:
        return at_once_text(certification, i)
    if answer == "cannot say" and any(verdict.word == "outside" for verdict in row):
        return "outside what the tests check"
    told = {"would miss": "misses {}", "run": "open: {}", "cannot say": "records too short for {}"}[answer]
    word, unknown = "not met" if answer == "would miss" else "open", answer == "cannot say"
    return told.format(
        ", ".join(v.criterion.name for v in row if v.word == word and (v.probability is None) is unknown)
    )


def _tests_there(certification: Certification, row: Sequence[Verdict]) -> str:
    tests = []
    for test_id in row[0].run:
        test = certification.campaign.test(test_id)
        parts: list[str] = [f"test {test_id}"]
        if not test.condition.is_at(row[0].condition):
            parts.append(Sentence("at {}", test.condition))
        shown = [(verdict.criterion, verdict.run[test_id]) for verdict in row]
        if missed := [criterion.name for criterion, v in shown if v is not None and not criterion.is_met_by(v)]:
            parts.append(f"which missed {', '.join(missed)}")
        if test.faults:
            parts.append(Sentence("in doubt as {}", joined([fault.text for fault in test.faults], "; ")))
        tests.append(joined(parts, ", "))
    unsettled = ", ".join(verdict.criterion.name for verdict in row if verdict.word == "open")
    return joined([*tests, *([f"open: {unsettled}"] if unsettled else [])], "; ")


def _notes_at(certification: Certification) -> tuple[list[str], dict[str, str]]:
    """What has to be known of all conditions, if there are several, and what else wherever one is named, by its id."""
    domain, unused, together = certification.domain, _unused_at(certification), _together(certification)
    notes: dict[str, list[str]] = {}
    for i, condition in certification.matrix.items:
        given = {name for name, value in condition.factors if value}
        notes[i] = [f"{name} not given" for name in domain.factors if name not in given]
        if i in together:
            notes[i].append(f"{together[i]} in no test together")
        if apart := [departure.test for departure in departures_near(certification.campaign, condition)]:
            notes[i].append(f"{read_out(apart)} stands apart there")
        if i in unused:
            notes[i].append(f"run as {listed(unused[i])}, not used")
    first, *others = notes.values()
    of_all = [note for note in first if others and all(note in each for each in others)]
    rest = {i: "; ".join(note for note in each if note not in of_all) for i, each in notes.items()}
    return of_all, {i: text for i, text in rest.items() if text}


def _together(certification: Certification) -> dict[str, str]:
    tested, known = [dict(t.condition.factors) for t in certification.campaign.tests], certification.domain.factors
    found = {}
    for i, condition in certification.matrix.items:
        given = {name: value for name, value in condition.factors if value and name in known}
        new = not any(given.items() <= factors.items() for factors in tested)
        if new and all(value in known[name] for name, value in given.items()):
            found[i] = ", ".join(f"{name} {value}" for name, value in given.items())
    return found


def _unused_at(certification: Certification) -> dict[str, list[str]]:
    matrix = certification.matrix
    unused = matrix.run(certification.campaign.unused)
    return {i: list(tests) for i, tests in zip(matrix.ids, unused, strict=True) if tests}


def _conditions(certification: Certification) -> Iterator[Fact]:
    domain, items = certification.domain, certification.matrix.items
    yield from (fact("condition.outside", sentence) for sentence in domain.too_few_tests)
    for i, condition in items:
        if not domain.too_few_tests and (why := domain.exceeded_by(condition)):
            yield fact("condition.outside", joined([i, joined(why)], ": "), condition=i)
        short = [v.criterion.name for v in certification.rows[i] if v.word == "open" and v.probability is None]
        if short:
            yield fact("condition.too_short", f"{i}: {', '.join(short)}.", condition=i, criteria=short)
    groups: dict[tuple[str, str], list[str]] = {}
    for i, factors in _together(certification).items():
        told = f"no test has {factors}; each was tested with another."
        groups.setdefault(("condition.new_together", told), []).append(i)
    for name in domain.factors:
        told = f"no {name} is given, so the verdicts cover every {name}; name it."
        without = [i for i, condition in items if not dict(condition.factors).get(name)]
        groups |= {("condition.no_factor", told): without} if without else {}
    for (code, told), ids in groups.items():
        yield fact(code, f"{listed(ids)}: {told}", conditions=ids)


def _not_used(certification: Certification) -> Iterator[Fact]:
    campaign, planned = certification.campaign, dict(certification.matrix.items)
    unused = dict(campaign.unused)
    told = "{}: {} was run there{}; the verdicts do not use it ({})."
    for i, names in _unused_at(certification).items():
        for name in names:
            off = "" if unused[name].is_at(planned[i]) else Sentence(", at {},", unused[name])
            yield fact("test.not_used", Sentence(told, i, name, off, campaign.reason_of(name)), test=name)
