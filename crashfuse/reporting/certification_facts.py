"""What is said of a certification: every fact once, with its code and values, and where each of them is shown."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import lru_cache
from itertools import chain, groupby
from typing import Literal, NamedTuple

from crashfuse.certification.certify import Answer, Certification
from crashfuse.certification.changes import Changes
from crashfuse.certification.forecasts import quantity
from crashfuse.certification.verdict import Verdict, all_met
from crashfuse.condition import Condition
from crashfuse.reporting import evidence_facts
from crashfuse.reporting.certification_tables import ANSWER_WORDS
from crashfuse.reporting.evidence_facts import fact, listed, listed_conditions
from crashfuse.study.facts import Fact, by_importance, campaign_facts, tuning_fact
from crashfuse.study.outliers import departures_near
from crashfuse.wording import Sentence, counted, joined, number, probability_text, read_out

Place = Literal["answer", "costs", "summary", "matrix", "record", "domain", "changes"]
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
    "since.moved": "Verdicts on tests run since that depend on their place",
    "since.too_narrow": "Intervals that tests run since contradict",
    "record.too_narrow": "Intervals that left-out tests contradict",
    "record.bin": "Probabilities that left-out tests contradict",
    "record.no_gain": "Probabilities no better than those of the raw CAE",
    "criterion.untouched": "Criteria whose limit no left-out test came near",
    "criterion.few": "Criteria with too few verdicts of their own",
}
"""What speaks against the verdicts, by code, the most important first: its heading among the exceptions."""
DECISIVE = tuple(SUBJECTS.values())[: list(SUBJECTS).index("condition.new_together") + 1]
"""The subjects that stand beside the answer itself: down to factors that no test has together."""
ANSWERS: Mapping[Answer, tuple[str, str]] = {
    "run": ("Run already", "{}"),
    "need not be run": ("Need not be run (probability that all criteria are met at once)", "all met at once: {}"),
    "to be tested": (
        "To be tested, as all criteria at once are uncertain (their probability)",
        "all met at once: only {}",
    ),
    "would miss": ("A test would miss", "misses {}"),
    "test or redesign": ("To be tested, or redesigned", "open: {}"),
    "record for longer": ("To be recorded for longer", "records too short for {}"),
    "outside": ("Outside what the tests check", "outside what the tests check{}"),
}
"""Of each answer, what stands before the conditions that have it, and what beside a single one."""
_ANSWER = ("matrix.saved", *(f"answer.{answer}" for answer in ANSWERS))
_COSTS = ("costs.confidence", "costs.saving")
_MATRIX = ("matrix.every", "matrix.none_needed", "matrix.run_first")
_RECORD = ("record.waived", "since.waived", "record.decided", "record.with_runs")
_SINCE = ("since.dated", "since.outcomes", "since.intervals", "since.too_narrow", "since.waived_outcome", "since.moved")
_CONDITIONS = ("test.not_used", "condition.no_factor", "condition.new_together")
_CRITERIA = ("criterion.unsupported", "criterion.untouched", "criterion.few")
PLACES: Mapping[Place, tuple[str, ...]] = {
    "answer": _ANSWER,
    "costs": _COSTS,
    "summary": (
        *(*_ANSWER, *_COSTS, "matrix.counts", *_MATRIX, *_RECORD, "record.brier", "record.no_gain", *_SINCE),
        *(*_CONDITIONS, *_CRITERIA, "record.none", "tests.cae_tuned"),
    ),
    "matrix": (
        *("test.stands_apart", *_ANSWER, *_COSTS, *_MATRIX, *_RECORD[:2], "since.wrong", "since.moved"),
        *("since.too_narrow", "test.not_used", "criterion.unsupported"),
    ),
    "record": (
        *(*_RECORD, "record.intervals", "record.too_narrow", "record.whole", "record.no_gain"),
        *("record.none", "tests.cae_tuned"),
    ),
    "domain": ("domain.checked",),
    "changes": (
        *("since.beside", "since.settings", "since.tested", *_SINCE, "since.wrong", "since.compared"),
        *("since.turned", "since.newly_waived", "since.withdrawn"),
    ),
}
"""The codes that are shown at each place, the most important one first: at the head of terminal, report and slides,
below the page's answer, and in tabs of the page and sections of the report."""
_WITH_PROBABILITY = ("need not be run", "to be tested")  # that all criteria are met at once
_FEW = 6  # conditions, each with its own probability
_EXPLAINED = 3  # conditions outside, each with its reason


@lru_cache(maxsize=8)  # asked for by every place
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
        () if certification.since is None else evidence_facts.change_facts(Changes.of(certification)),
    )
    return tuple(replace(own, label=SUBJECTS.get(own.code, "")) for own in found)


class Planned(NamedTuple):
    """A planned test: the answer in a word (:data:`ANSWER_WORDS`), and what decides it."""

    id: str
    condition: Condition
    word: str
    why: str


@lru_cache(maxsize=8)  # asked for by three parts of a page
def planned(certification: Certification) -> tuple[Planned, ...]:
    """The answer at every planned test, in the order of speed."""
    notes, same, found = _notes_at(certification)[1], certification.counted_once, []
    for i, condition in sorted(certification.matrix.items, key=lambda item: item[1].speed_mps):
        answer = certification.answers[i]
        why = Sentence(ANSWERS[answer][1], _detail(certification, i))
        as_other = f"counts as {same[i]}" if i in same else ""
        texts = [text for text in (why, notes.get(i, ""), as_other) if text]
        found.append(Planned(i, condition, ANSWER_WORDS[answer], joined(texts, "; ")))
    return tuple(found)


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
    told = ", ".join(f"{n} {word}" for word, n in certification.counts.items())
    if n := sum(len(certification.rows[i]) for i in certification.run):
        told += f"; {n} of these at {listed(list(certification.run))}, tested already and learned from"
    yield fact("matrix.counts", f"{size}, confidence {confidence:g}: {told}.", **certification.counts)
    n, of = certification.saved
    once = [f"{i} as {other}" for i, other in certification.counted_once.items()]
    alike = f" Counted once, being within 1 km/h and 2 % of each weight: {listed(once)}." if once else ""
    told = f"{n:,} of {counted(of, 'planned test')} need not be run to know these pulse criteria.{alike}"
    yield fact("matrix.saved", told, n=n, of=of)
    of_all, notes = _notes_at(certification)
    if of_all:
        yield fact("matrix.every", f"Of every condition: {'; '.join(of_all)}.", notes=of_all)
    for answer, (heading, _) in ANSWERS.items():
        details = {i: _detail(certification, i) for i, own in certification.answers.items() if own == answer}
        if details:
            if answer in _WITH_PROBABILITY and len(details) > _FEW:
                details = _least_of_alike(certification, details, notes)
            text = {i: joined([t for t in (details[i], notes.get(i)) if t], "; ") for i in details}
            listing = listed_conditions(ids, text)
            if answer == "outside" and len(details) <= _EXPLAINED:
                listing = joined([joined([i, certification.rows[i][0].reason], ": ") for i in details])
            sentence = Sentence("{}: {}{}", heading, listing, "" if listing.endswith(".") else ".")
            if answer == "outside" and certification.domain.too_few_tests:
                (sentence,) = map(Sentence, certification.domain.too_few_tests)
            yield fact(f"answer.{answer}", sentence, conditions={i: str(detail) for i, detail in details.items()})
    if set(certification.answers.values()) <= {"run", "need not be run"}:
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
    told = f"Skipping a test pays from a confidence of {pays:g} ({costs}, declared with the criteria); {asked}."
    values = {**asdict(costs), "pays_from": pays, "confidence": confidence, "follows": criteria.declared is None}
    yield fact("costs.confidence", told, **values)
    skipped = [met.probability for i, met in certification.waived.items() if i not in certification.counted_once]
    if not skipped:
        return
    expected, n = sum(costs.saving(1 - probability) for probability in skipped), len(skipped)
    most, cautious = certification.record.bounds()["tests"].at_most, None
    told = f"Expected saving by {counted(n, 'test')} that need not be run, by their probabilities: {_amount(expected)}"
    if most is not None:
        cautious = n * costs.saving(most)
        told += f"; if as many answers are wrong as the record allows, {100 * most:.1f} % by test: {_amount(cautious)}"
    yield fact("costs.saving", f"{told}.", n=n, expected=expected, cautious=cautious, wrong_at_most=most)


def _amount(value: float) -> str:
    return number(float(f"{value:.3g}"), ",.10g")


def _detail(certification: Certification, i: str) -> str:
    answer, row, confidence = certification.answers[i], certification.rows[i], certification.criteria.confidence
    if answer == "run":
        return _tests_there(certification, row)
    if answer in _WITH_PROBABILITY:
        return probability_text(all_met(row).probability, confidence)
    asked = {"would miss": "not met", "test or redesign": "open", "record for longer": "open"}.get(answer)
    longer = answer == "record for longer"
    return ", ".join(v.criterion.name for v in row if v.word == asked and (v.probability is None) <= longer)


def _least_of_alike(
    certification: Certification, details: Mapping[str, str], notes: Mapping[str, str]
) -> dict[str, str]:
    """Of many conditions the least probability of those with equal notes, so that they can be named as a range."""
    met = {i: all_met(certification.rows[i]).probability for i in details}
    least = {note: min(p for i, p in met.items() if notes.get(i) == note) for note in map(notes.get, met)}
    confidence = certification.criteria.confidence
    return {i: f"{probability_text(least[notes.get(i)], confidence)} or more" for i in met}


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
    campaign, matrix, since = certification.campaign, certification.matrix, certification.since
    gone = () if since is None else since.gone_runs
    found = {}
    for (i, condition), unused in zip(matrix.items, matrix.run(campaign.unused), strict=True):
        removed = [test.test for test in gone if test.condition.is_at(condition)]
        others = (f"{test} with another record" if test in campaign.test_ids else test for test in removed)
        if names := dict.fromkeys((*unused, *others)):
            found[i] = list(names)
    return found


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
        named = listed_conditions(certification.matrix.ids, dict.fromkeys(ids, ""))
        yield fact(code, f"{named}: {told}", conditions=ids)


def _not_used(certification: Certification) -> Iterator[Fact]:
    campaign, since = certification.campaign, certification.since
    removed = () if since is None else since.gone_runs
    planned, unused = dict(certification.matrix.items), dict(campaign.unused)
    told = "{}: {} was run there{}; the verdicts do not use it ({})."
    for i, names in _unused_at(certification).items():
        for name in names:
            if name in unused and name not in {test.test for test in removed}:
                off = "" if unused[name].is_at(planned[i]) else Sentence(", at {},", unused[name])
                yield fact("test.not_used", Sentence(told, i, name, off, campaign.reason_of(name)), test=name)
    told = "{} was run at {}, not used any more{}. By the criteria of then: missed {}, unknown {}."
    for test in removed:
        criteria = [] if since is None else since.earlier.criteria.items
        shown = {criterion.name: test.measured.get(quantity(criterion)) for criterion in criteria}
        missed = [c.name for c in criteria if (v := shown[c.name]) is not None and not c.is_met_by(v)]
        unknown = [name for name, value in shown.items() if value is None]
        why = f" ({campaign.reason_of(test.test)})" if test.test in unused else ""
        texts = (", ".join(missed) or "none", ", ".join(unknown) or "none")
        sentence = Sentence(told, test.test, test.condition, why, *texts)
        yield fact("test.not_used", sentence, test=test.test, missed=missed, unknown=unknown)
