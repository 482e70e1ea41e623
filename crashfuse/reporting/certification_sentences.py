"""A certification in words: what came of the matrix, and what the record says."""

from collections.abc import Iterator, Mapping, Sequence

from crashfuse.certification.certify import Certification, answers
from crashfuse.certification.changes import Changes
from crashfuse.certification.evidence import run_near
from crashfuse.certification.verdict import WORDS, Verdict, reaches
from crashfuse.reporting.certification_changes import outcome_sentences, saved_and_missed
from crashfuse.reporting.certification_exceptions import (
    APART,
    FEW,
    MOVED,
    NARROW_SINCE,
    NOT_GIVEN,
    NOT_TOGETHER,
    NOT_USED,
    UNSUPPORTED,
    UNTOUCHED,
    WRONG_SINCE,
    exceptions,
    reservations,
    reserved,
)
from crashfuse.reporting.certification_tables import verdict_counts
from crashfuse.reporting.evidence_sentences import (
    ONE_BY_ONE,
    at_most,
    brier_sentence,
    counted,
    listed,
    listed_conditions,
    record_sentence,
    waived_sentence,
)
from crashfuse.wording import Sentence, joined, probability_text, read_out, speed, weight

_EXPLAINED = 3  # conditions in a sentence with a reason each


def summary(certification: Certification) -> tuple[str, ...]:
    """What came of the matrix, where a test is needed, and what the record says, in a few sentences."""
    record = certification.record
    said = (matrix_sentence(certification), *to_test(certification), record_sentence(record), *brier_sentence(record))
    since = () if certification.since is None else outcome_sentences(Changes.of(certification))
    against = exceptions(certification)
    told = MOVED, NOT_USED, NOT_GIVEN, NOT_TOGETHER, UNSUPPORTED, UNTOUCHED, FEW
    return (*said, *since, *(sentence for subject in told for sentence in against.get(subject, ())))


def beside_matrix(certification: Certification) -> tuple[str, ...]:
    """What stands beside the matrix: what came of it, what speaks against it, and why likely criteria are open."""
    told, subjects = exceptions(certification), (APART, WRONG_SINCE, MOVED, NARROW_SINCE, NOT_USED, UNSUPPORTED)
    return (*to_test(certification), *(sentence for subject in subjects for sentence in told.get(subject, ())))


def matrix_sentence(certification: Certification) -> str:
    """How many verdicts of each kind the matrix has."""
    n, criteria = len(certification.matrix.ids), len(certification.criteria.items)
    counts = ", ".join(f"{count} {word}" for word, count in verdict_counts(certification).items())
    confidence = certification.criteria.confidence
    return f"{counted(n, 'condition')} × {counted(criteria, 'criterion')}, confidence {confidence:g}: {counts}."


def to_test(certification: Certification) -> Iterator[str]:
    """Which conditions need no test, which would miss a criterion, which need a test, and which lie outside."""
    rows, run = {word: certification.of_word(word) for word in WORDS}, certification.run
    ids, (of_all, known_of) = certification.matrix.ids, _reserved(certification)
    confidence = certification.criteria.confidence
    if of_all:
        yield f"Of every condition: {'; '.join(of_all)}."
    if run:
        yield Sentence("Run already: {}.", listed(list(_run(certification, known_of))))
    if waived := certification.waived:
        yield (
            "Need not be run, as every criterion is met (in brackets the probability that all are, at least): "
            f"{listed_conditions(ids, _least(waived, confidence, known_of))}."
        )
    yield from _counted_once(certification)
    if waived:
        yield from waived_sentence(certification.record, certification.criteria)
        yield from _with_those_since(certification)
        yield from _little_known(certification)
    if uncertain := certification.uncertain:
        yield (
            "To be tested, as each criterion is met but all at once not with a confidence of "
            f"{confidence:g} (in brackets): "
            f"{listed_conditions(ids, _least(uncertain, confidence, known_of))}."
        )
    given, known, unknown = answers(certification), _open(certification, known=True), _open(certification, known=False)
    missing = {i: own for i, own in rows["not met"].items() if given[i] == "would miss"}
    settled = {"run", "would miss"}
    for told, some in (
        ("A test would miss", missing),
        ("To be tested, or redesigned", {i: own for i, own in known.items() if given[i] not in settled}),
        ("Run, yet open for another test", {i: own for i, own in known.items() if i in run}),
        (
            "Recordings end too early to tell, so a test there has to be recorded for longer",
            {i: own for i, own in unknown.items() if given[i] not in settled},
        ),
    ):
        if some:
            each = {i: "; ".join(filter(None, (_names(own), known_of.get(i)))) for i, own in some.items()}
            yield f"{told}: {listed_conditions(ids, each)}."
    if first := certification.run_first:
        yield f"Run {first} first, the fastest that a test can settle, and certify again: others may then need none."
        yield from _despite_tests(certification, first)
    if certification.domain.too_few_tests:
        yield from certification.domain.too_few_tests
    elif rows["outside"]:
        yield Sentence("Outside what the tests check: {}", _outside(ids, rows["outside"]))
    if {*given.values()} <= settled | {"need not be run"}:
        if not missing:
            yield "No condition of the matrix needs a test."
        elif len(missing) < len(certification.matrix.ids):
            yield "No other condition of the matrix needs a test."


def _despite_tests(certification: Certification, first: str) -> Iterator[str]:
    """Why a condition takes a test although some were run near it, in numbers."""
    row, confidence = certification.rows[first], certification.criteria.confidence
    there = row[0].condition
    if not (tests := run_near(certification.campaign, there)):
        return
    away = (
        speed(max(abs(test.condition.speed_mps - there.speed_mps) for test in tests)),
        weight(max(abs(test.condition.mass_kg - there.mass_kg) for test in tests)),
    )
    ids, (who, were, whom) = [test.id for test in tests], ("they", "were", "them") if tests[1:] else ("it", "was", "it")
    said = "{} {} run within {} and {} of {}; the prediction there has learned from {}."
    yield Sentence(said, read_out(ids), were, *away, first, whom)
    for verdict in row:
        criterion, met = verdict.criterion, probability_text(verdict.probability, confidence)
        why: str | None = f"Another test meets it with probability {met}, and {confidence:g} is asked for."
        if reaches(verdict.probability or 0.0, confidence):
            why = certification.record.support(criterion).shortfall(confidence)
        alone = [trial for trial in certification.record.of(criterion) if trial.left_out == "test"]
        values = [trial.measured for trial in alone if trial.held_out in ids]
        if verdict.word == "open" and values and why:
            shown = criterion.shown(*dict.fromkeys((min(values), max(values))))
            yield Sentence("Of {} ({}) {} showed {}. {}", criterion.name, criterion.limits, who, shown, why)
    if first in certification.uncertain:
        least = probability_text(certification.uncertain[first][0], confidence)
        yield f"Another test meets all criteria at once with probability {least} or more; {confidence:g} is asked for."


def _counted_once(certification: Certification) -> Iterator[str]:
    """Which conditions are no tests of their own, and how many need not be run without them, if there are any."""
    if once := certification.counted_once:
        n, of = certification.saved
        many = f" ({len(once):,} of {len(certification.matrix.ids):,} are another one, named in certification.json)"
        which = many if len(once) > ONE_BY_ONE else f": {', '.join(f'{i} (as {other})' for i, other in once.items())}"
        yield (
            f"{n:,} of {counted(of, 'test')} need not be run, as conditions that are one to within 1 km/h and 2 % of "
            f"each weight are counted once{which}."
        )


def _with_those_since(certification: Certification) -> Iterator[str]:
    """The same with tests that an earlier certification said need not be run, and that were run since."""
    n, missed = saved_and_missed(certification)
    if n > certification.record.waived(certification.criteria)[1]:
        yield (
            f"With tests that earlier certifications said need not be run, and that were run since: {missed} of {n} "
            f"missed one ({at_most(missed, n)})."
        )


def _reserved(certification: Certification) -> tuple[list[str], dict[str, str]]:
    """What has to be known of all conditions, if there are several, and what else of each wherever it is named."""
    ids, known_of = certification.matrix.ids, reserved(certification)
    first, *others = (known_of.get(i, []) for i in ids)
    of_all = [own for own in first if others and all(own in each for each in others)]
    rest = {i: "; ".join(told for told in own if told not in of_all) for i, own in known_of.items()}
    return of_all, {i: own for i, own in rest.items() if own}


def _run(certification: Certification, known_of: Mapping[str, str]) -> Iterator[str]:
    """Conditions that were run, with the tests there and what these miss."""
    for i, row in certification.rows.items():
        tests = []
        for test in row[0].run:
            values = [(own.criterion, own.run[test]) for own in row]
            missed = [
                criterion.name for criterion, value in values if value is not None and not criterion.is_met_by(value)
            ]
            measured = certification.campaign.test(test)
            off = "" if measured.condition.is_at(row[0].condition) else Sentence(", at {}", measured.condition)
            what = f", which missed {', '.join(missed)}" if missed else ""
            failed = joined([fault.text for fault in measured.faults], "; ")
            doubt = Sentence(", in doubt as {}", failed) if measured.faults else ""
            tests.append(Sentence("{}{}{}{}", test, off, what, doubt))
        if tests:
            also = [known_of[i]] if i in known_of else []
            yield Sentence("{} (test {})", i, joined([joined(tests, " and "), *also], "; "))


def _least(bounds: Mapping[str, tuple[float, float]], confidence: float, known_of: Mapping[str, str]) -> dict[str, str]:
    """The least probability that a test meets all criteria, and what has to be known, by condition.

    Of many conditions, of which the same has to be known, it is that of the least probable one.
    """
    if len(bounds) <= ONE_BY_ONE:
        told = {i: probability_text(own, confidence) for i, (own, _) in bounds.items()}
        return {i: "; ".join(filter(None, (text, known_of.get(i)))) for i, text in told.items()}
    least: dict[str | None, float] = {}
    for i, (own, _) in bounds.items():
        least[known_of.get(i)] = min(own, least.get(known_of.get(i), own))
    return {
        i: "; ".join(filter(None, (f"{probability_text(least[known], confidence)} or more", known)))
        for i in bounds
        for known in [known_of.get(i)]
    }


def _little_known(certification: Certification) -> Iterator[str]:
    """Which criteria these answers rest on although left-out tests say little of them, or contradicted some."""
    weak, record = reservations(certification), certification.record
    wrong = {own.name for own in certification.criteria.items if record.support(own).own_wrong}
    said = [
        f"{told} {', '.join(names)}"
        for told, names in (
            ("by themselves tests say little or nothing of", [name for name in weak if name not in wrong]),
            ("tests contradicted verdicts on", [name for name in weak if name in wrong]),
        )
        if names
    ]
    if said:
        yield f"Look at the exceptions first: {'; '.join(said)}."


def _outside(ids: Sequence[str], verdicts: Mapping[str, list[Verdict]]) -> str:
    """Conditions outside, with the reason of each if they are few."""
    if len(verdicts) > _EXPLAINED:
        return f"{listed_conditions(ids, dict.fromkeys(verdicts, ''))}; each verdict says why."
    return joined([joined([i, own.reason], ": ") for i, (own, *_) in verdicts.items()])


def _open(certification: Certification, *, known: bool) -> Mapping[str, list[Verdict]]:
    """Open verdicts by condition: with a known probability, or those that a longer record alone can tell."""
    some = {
        i: [verdict for verdict in own if (verdict.probability is not None) is known]
        for i, own in certification.of_word("open").items()
    }
    return {i: own for i, own in some.items() if own}


def _names(verdicts: Sequence[Verdict]) -> str:
    return ", ".join(verdict.criterion.name for verdict in verdicts)
