"""A certification in words: what came of the matrix, what the record says, and every exception to it."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from crashfuse.certification.certify import Certification
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import WORDS, Verdict
from crashfuse.reporting.certification_tables import verdict_counts
from crashfuse.reporting.track_record_sentences import (
    brier_sentence,
    counted,
    record_sentence,
    waived_sentence,
    wrong_sentences,
)
from crashfuse.wording import Sentence, joined

_NAMED, _EXPLAINED = 20, 3  # conditions in a sentence, and with a reason each
_UNSUPPORTED = "Criteria whose record does not support the confidence"
_UNTOUCHED = "Criteria whose limit no left-out test came near"
_NOT_GIVEN, _NOT_TOGETHER = "Conditions without a factor that the tests have", "Factors that no test has together"
_FEW = "Criteria whose own record does not support the confidence alone"


def summary(certification: Certification) -> tuple[str, ...]:
    """What came of the matrix, where a test is needed, and what the record says, in a few sentences."""
    record = certification.record
    said = (matrix_sentence(certification), *to_test(certification), record_sentence(record), *brier_sentence(record))
    against = exceptions(certification)
    told = _NOT_GIVEN, _NOT_TOGETHER, _UNSUPPORTED, _UNTOUCHED, _FEW
    return (*said, *(sentence for subject in told for sentence in against.get(subject, ())))


def beside_matrix(certification: Certification) -> tuple[str, ...]:
    """What stands beside the matrix: what came of it, on which factors, and why likely criteria are open."""
    told, subjects = exceptions(certification), (_NOT_GIVEN, _NOT_TOGETHER, _UNSUPPORTED)
    return (*to_test(certification), *(sentence for subject in subjects for sentence in told.get(subject, ())))


def matrix_sentence(certification: Certification) -> str:
    """How many verdicts of each kind the matrix has."""
    n, criteria = len(certification.matrix.ids), len(certification.criteria.items)
    counts = ", ".join(f"{count} {word}" for word, count in verdict_counts(certification).items())
    confidence = certification.criteria.confidence
    return f"{counted(n, 'condition')} × {counted(criteria, 'criterion')}, confidence {confidence:g}: {counts}."


def to_test(certification: Certification) -> Iterator[str]:
    """Which conditions need no test, which would miss a criterion, which need a test, and which lie outside."""
    rows, run = {word: _by_condition(certification, word) for word in WORDS}, certification.run
    if run:
        yield f"Run already: {listed(list(_run(certification)))}."
    if waived := certification.waived:
        yield (
            "Need not be run, as every criterion is met (in brackets the probability that all are, at least): "
            f"{listed(_with_least(waived))}."
        )
        yield from waived_sentence(certification.record, certification.criteria)
        yield from _little_known(certification)
    if uncertain := certification.uncertain:
        yield (
            f"To be tested, as each criterion is met but all at once not with a confidence of "
            f"{certification.criteria.confidence:g} (in brackets): {listed(_with_least(uncertain))}."
        )
    known, missing = _open(certification, known=True), {i: own for i, own in rows["not met"].items() if i not in run}
    for told, some in (
        ("A test would miss", missing),
        ("To be tested, or redesigned", {i: own for i, own in known.items() if i not in run and i not in missing}),
        ("Run, yet open for another test", {i: own for i, own in known.items() if i in run}),
        (
            "Recordings end too early to tell, so a test there has to be recorded for longer",
            {i: own for i, own in _open(certification, known=False).items() if i not in run and i not in missing},
        ),
    ):
        if some:
            yield f"{told}: {listed([f'{i} ({_names(own)})' for i, own in some.items()])}."
    if first := certification.run_first:
        yield f"Run {first} first, the fastest that a test can settle, and certify again: others may then need none."
    if certification.domain.too_few_tests:
        yield from certification.domain.too_few_tests
    elif rows["outside"]:
        yield Sentence("Outside what the tests check: {}", _outside(rows["outside"]))
    if not (rows["open"].keys() | rows["outside"].keys() | uncertain.keys()) - run.keys() - missing.keys():
        if not missing:
            yield "No condition of the matrix needs a test."
        elif len(missing) < len(certification.matrix.ids):
            yield "No other condition of the matrix needs a test."


def least_text(all_met: tuple[float, float]) -> str:
    """The least probability that a test meets all criteria, rounded down."""
    return f"{np.floor(1000 * all_met[0] + 1e-9) / 1000:.3f}"


def _run(certification: Certification) -> Iterator[str]:
    """Conditions that were run, with the tests there and what these miss."""
    for i, row in certification.rows.items():
        tests = []
        for test in row[0].run:
            values = [(own.criterion, own.run[test]) for own in row]
            missed = [
                criterion.name for criterion, value in values if value is not None and not criterion.is_met_by(value)
            ]
            tests.append(f"{test}, which missed {', '.join(missed)}" if missed else test)
        if tests:
            yield f"{i} (test {' and '.join(tests)})"


def _with_least(bounds: Mapping[str, tuple[float, float]]) -> list[str]:
    return [f"{i} ({least_text(own)})" for i, own in bounds.items()]


def _little_known(certification: Certification) -> Iterator[str]:
    """Which criteria these answers rest on although left-out tests say little of them."""
    if weak := _reservations(certification):
        yield f"Look at the exceptions first: by themselves left-out tests say little or nothing of {', '.join(weak)}."


def _reservations(certification: Certification) -> dict[str, str]:
    """Why the record says little of a criterion by itself, by its name, where it does."""
    record, criteria = certification.record, certification.criteria
    told = {own.name: record.support(own).reservation(criteria.confidence) for own in criteria.items}
    return {name: sentence for name, sentence in told.items() if sentence is not None}


def _outside(verdicts: Mapping[str, list[Verdict]]) -> str:
    """Conditions outside, with the reason of each if they are few."""
    if len(verdicts) > _EXPLAINED:
        return f"{listed(list(verdicts))}; each verdict says why."
    return joined([joined([i, own.reason], ": ") for i, (own, *_) in verdicts.items()])


def exceptions(certification: Certification) -> dict[str, tuple[str, ...]]:
    """Everything that a reviewer has to know against the verdicts, by subject; subjects without any are left out."""
    confidence, record = certification.criteria.confidence, certification.record
    supports = {criterion.name: record.support(criterion) for criterion in certification.criteria.items}
    short = {name: s for name, own in supports.items() if (s := own.shortfall(confidence)) is not None}
    weak = _reservations(certification)
    outside = dict.fromkeys(joined([i, own.reason], ": ") for i, own in certification.cells if own.word == "outside")
    found = {
        "Warnings about the campaign": certification.campaign.remarks,
        "Conditions outside the validated domain": certification.domain.too_few_tests or tuple(outside),
        _NOT_GIVEN: tuple(_without_factor(certification)),
        _NOT_TOGETHER: tuple(_new_together(certification)),
        "Open, because recordings end too early to predict": tuple(
            f"{i}: {_names(unknown)}." for i, unknown in _open(certification, known=False).items()
        ),
        "Tests outside the range of the CAE runs": tuple(
            joined([test.id, joined(notes)], ": ")
            for test in certification.campaign.tests
            if (notes := certification.campaign.cae.extrapolation(test.condition))
        ),
        "Wrong verdicts on left-out tests": tuple(wrong_sentences(record)),
        "Probabilities that left-out tests contradict": tuple(
            f"{own.low:g} to {own.high:g}, {own.probability:.3f} on average: {round(own.met * own.n)} of {own.n} met "
            f"it (exact 95 % bounds {own.lower:.3f} to {own.upper:.3f})."
            for own in record.reliability
            if not own.holds
        ),
        "Probabilities no better than those of the raw CAE": tuple(brier_sentence(record)) if _no_gain(record) else (),
        _UNSUPPORTED: _grouped(short),
        _UNTOUCHED: _grouped({name: s for name, s in weak.items() if record.trials and not supports[name].near}),
        _FEW: _grouped({name: s for name, s in weak.items() if name not in short and supports[name].near}),
        "No record": () if record.trials else (record_sentence(record),),
    }
    return {subject: sentences for subject, sentences in found.items() if sentences}


def _without_factor(certification: Certification) -> Iterator[str]:
    """Which conditions do not name a factor, and what their verdicts are then on."""
    for name in certification.domain.factors:
        some = [i for i, c in certification.matrix.items if not dict(c.factors).get(name)]
        if some:
            yield (
                f"{listed(some)}: no {name} is given, so the verdicts are on a vehicle of which it is not known, not "
                "on the least favourable one; name it to have its own."
            )


def _new_together(certification: Certification) -> Iterator[str]:
    """Which conditions have factors of which each was tested, but never with the others."""
    tested = [dict(test.condition.factors) for test in certification.campaign.tests]
    found: dict[str, list[str]] = {}
    for i, condition in certification.matrix.items:
        given = {name: value for name, value in condition.factors if value and name in certification.domain.factors}
        known = all(value in certification.domain.factors[name] for name, value in given.items())
        if known and not any(given.items() <= own.items() for own in tested):
            found.setdefault(", ".join(f"{name} {value}" for name, value in given.items()), []).append(i)
    for together, some in found.items():
        yield f"{listed(some)}: no test has {together}; each was tested with another."


def _grouped(sentences: Mapping[str, str]) -> tuple[str, ...]:
    """Each sentence once, after the names that it is about."""
    names: dict[str, list[str]] = {}
    for name, sentence in sentences.items():
        names.setdefault(sentence, []).append(name)
    return tuple(joined([", ".join(own), sentence], ": ") for sentence, own in names.items())


def _no_gain(record: TrackRecord) -> bool:
    return record.brier is not None and record.brier[0] >= record.brier[1]


def _by_condition(certification: Certification, word: str) -> Mapping[str, list[Verdict]]:
    found: dict[str, list[Verdict]] = {}
    for i, verdict in certification.cells:
        if verdict.word == word:
            found.setdefault(i, []).append(verdict)
    return found


def _open(certification: Certification, *, known: bool) -> Mapping[str, list[Verdict]]:
    """Open verdicts by condition: with a known probability, or those that a longer record alone can tell."""
    some = {
        i: [verdict for verdict in own if (verdict.probability is not None) is known]
        for i, own in _by_condition(certification, "open").items()
    }
    return {i: own for i, own in some.items() if own}


def _names(verdicts: Sequence[Verdict]) -> str:
    return ", ".join(verdict.criterion.name for verdict in verdicts)


def listed(names: Sequence[str]) -> str:
    """The first names, and how many there are more."""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
