"""A certification in words: what came of the matrix, what the record says, and every exception to it."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.track_record import TrackRecord, largest_share
from crashfuse.certification.verdict import WORDS, Verdict
from crashfuse.reporting.certification_tables import verdict_counts
from crashfuse.wording import Sentence, joined, speed, weight

_NAMED = 20  # conditions in a sentence
_UNSUPPORTED = "Criteria whose record does not support the confidence"
_UNTOUCHED = "Criteria whose limit no left-out test came near"
_FEW = "Criteria whose own record does not support the confidence alone"


def summary(certification: Certification) -> tuple[str, ...]:
    """What came of the matrix, where a test is needed, and what the record says, in a few sentences."""
    record = certification.record
    said = (matrix_sentence(certification), *to_test(certification), record_sentence(record), *brier_sentence(record))
    against = exceptions(certification)
    return (*said, *(told for subject in (_UNSUPPORTED, _UNTOUCHED, _FEW) for told in against.get(subject, ())))


def beside_matrix(certification: Certification) -> tuple[str, ...]:
    """What stands beside the matrix: what came of it, and why criteria are open whatever their probability."""
    return (*to_test(certification), *exceptions(certification).get(_UNSUPPORTED, ()))


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
        there = [f"{i} (test {' and '.join(tests)})" for i, tests in run.items()]
        yield f"Run already: {listed(there)}."
    if waived := certification.waived:
        least = [f"{i} ({least_text(bounds)})" for i, bounds in waived.items()]
        yield (
            "Need not be run, as every criterion is met (in brackets the probability that all are, at least): "
            f"{listed(least)}."
        )
        yield from waived_sentence(certification.record, certification.criteria.items)
    known = _open(certification, known=True)
    to_run = {i: own for i, own in known.items() if i not in run and i not in rows["not met"]}
    for told, some in (
        ("A test would miss", rows["not met"]),
        ("To be tested, or redesigned", to_run),
        ("Run, yet open for another test", {i: own for i, own in known.items() if i in run}),
        ("The record is too short to tell", _open(certification, known=False)),
    ):
        if some:
            yield f"{told}: {listed([f'{i} ({_names(own)})' for i, own in some.items()])}."
    if first := certification.run_first:
        yield f"Run {first} first, the fastest that a test can settle, and certify again: others may then need none."
    if certification.domain.too_few_tests:
        yield from certification.domain.too_few_tests
    elif rows["outside"]:
        yield f"Outside what the tests check: {listed(list(rows['outside']))}."
    if not (rows["open"].keys() | rows["outside"].keys()) - run.keys() - rows["not met"].keys():
        yield "No condition of the matrix needs a test."


def at_most(wrong: int, n: int) -> str:
    """The exact 95 % bound of the share of wrong ones: ``at most 4.5 %``."""
    return f"at most {100 * largest_share(wrong, n):.1f} %"


def least_text(all_met: tuple[float, float]) -> str:
    """The least probability that a test meets all criteria, rounded down."""
    return f"{np.floor(1000 * all_met[0] + 1e-9) / 1000:.3f}"


def record_sentence(record: TrackRecord) -> str:
    """How often the verdicts on left-out tests were wrong, with the exact bound."""
    if not record.trials:
        return "There is no record: with a single test, none can be left out."
    decided, wrong = record.decided
    if not decided:
        return f"None of the {counted(len(record.counted), 'verdict')} on left-out tests was met or not met: no record."
    undecided = len(record.counted) - decided
    said = (
        f"Record of left-out tests: {counted(decided, 'verdict')} met or not met, {wrong} wrong "
        f"({at_most(wrong, decided)}, exact 95 % bound); {undecided} open or outside."
    )
    telling, missed = record.telling.decided
    if telling == decided:
        return said
    rest = f"without them, {missed} of {telling} wrong ({at_most(missed, telling)})" if telling else "none is left"
    rest_of = f"{decided - telling} of the {decided} show nothing more, on a metric a second time or on limits that no"
    return f"{said} {rest_of} left-out test came near: {rest}."


def waived_sentence(record: TrackRecord, criteria: Sequence[Criterion]) -> Iterator[str]:
    """How often a left-out test need not have been run, and missed a criterion all the same, with the exact bound."""
    left_out, saved, wrong = record.waived(criteria)
    if not left_out:
        return
    tests = counted(len({trial.held_out for trial in record.trials}), "test")
    times = f"{tests}, left out {counted(left_out, 'time')}, alone or with the speed group:"
    if saved:
        yield (
            f"{times} {counted(saved, 'time')} the test need not have been run, as every criterion was met; in {wrong} "
            f"of these it missed one all the same ({at_most(wrong, saved)}, exact 95 % bound)."
        )
    else:
        yield (
            f"{times} at no time was every criterion met. How often a test that need not be run would miss one, this "
            "record cannot say."
        )


def interval_sentence(record: TrackRecord) -> Iterator[str]:
    """How many intervals held what left-out tests measured, if there are any."""
    inside, n = record.intervals
    if n:
        yield (
            f"{inside} of {counted(n, 'interval')} held what the left-out test measured ({100 * inside / n:.0f} %; "
            "made to hold 95 % of single tests), of left-out tests inside what the others check."
        )


def brier_sentence(record: TrackRecord) -> Iterator[str]:
    """The Brier score of the left-out probabilities beside that of the raw CAE, if there is one."""
    if record.brier is not None:
        ours, cae = (f"{score:.4f}" if score >= 5e-5 else "below 0.0001" for score in record.brier)
        yield (
            f"Brier score of the probabilities of metrics, ratings aside (0 is perfect): {ours}; {cae} for the raw CAE "
            "with its own error as band."
        )


def support_sentence(record: TrackRecord, criterion: Criterion, confidence: float) -> str:
    """What the record says of a criterion at this confidence."""
    support = record.support(criterion)
    if (shortfall := support.shortfall(confidence)) is not None:
        return shortfall
    if (reservation := support.reservation(confidence)) is not None:
        return reservation
    own = f"{support.own_wrong} of {counted(support.own_decided, 'left-out verdict')} of its own wrong"
    others = f", {support.wrong} of {support.decided} with those on other criteria"
    return f"It supports the confidence: {own}{others if support.decided > support.own_decided else ''}."


def domain_sentences(domain: Domain) -> tuple[str, ...]:
    """Where the tests, left out with all others at about their speed, check predictions."""
    if not domain.speed_ranges_mps:
        return domain.too_few_tests or ("Nothing is checked: no test lies within the speeds of the CAE runs.",)
    speeds = joined([Sentence("{}", speed(*ends, between=" to ")) for ends in domain.speed_ranges_mps], " and ")
    masses = weight(*domain.checked_masses_kg, between=" to ")
    factors = "; ".join(f"{name} {', '.join(values)}" for name, values in domain.factors.items())
    return (
        Sentence(
            f"Checked by the {domain.n_tests} tests, each left out with all others at about its speed: {{}}, front "
            "and rear weight together {}{}; and within the range of the CAE runs.",
            speeds,
            masses,
            f"; {factors}" if factors else "",
        ),
        Sentence(
            "A condition is at most {} from the nearest test, as far as any left-out test was from the others, {} "
            "below the slowest and {} above the fastest.",
            *map(speed, (domain.reach_mps, domain.below_mps, domain.above_mps)),
        ),
    )


def exceptions(certification: Certification) -> dict[str, tuple[str, ...]]:
    """Everything that a reviewer has to know against the verdicts, by subject; subjects without any are left out."""
    confidence, record = certification.criteria.confidence, certification.record
    supports = {criterion.name: record.support(criterion) for criterion in certification.criteria.items}
    short = {name: s for name, own in supports.items() if (s := own.shortfall(confidence)) is not None}
    weak = {name: s for name, own in supports.items() if (s := own.reservation(confidence)) is not None}
    outside = dict.fromkeys(joined([i, own.reason], ": ") for i, own in certification.cells if own.word == "outside")
    found = {
        "Warnings about the campaign": certification.campaign.remarks,
        "Conditions outside the validated domain": certification.domain.too_few_tests or tuple(outside),
        "Open, because the record is too short to predict": tuple(
            f"{i}: {_names(unknown)}." for i, unknown in _open(certification, known=False).items()
        ),
        "Tests outside the range of the CAE runs": tuple(
            joined([test.id, joined(notes)], ": ")
            for test in certification.campaign.tests
            if (notes := certification.campaign.cae.extrapolation(test.condition))
        ),
        "Wrong verdicts on left-out tests": tuple(_wrong(record)),
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


def _grouped(sentences: Mapping[str, str]) -> tuple[str, ...]:
    """Each sentence once, after the names that it is about."""
    names: dict[str, list[str]] = {}
    for name, sentence in sentences.items():
        names.setdefault(sentence, []).append(name)
    return tuple(joined([", ".join(own), sentence], ": ") for sentence, own in names.items())


def _no_gain(record: TrackRecord) -> bool:
    return record.brier is not None and record.brier[0] >= record.brier[1]


def _wrong(record: TrackRecord) -> Iterator[str]:
    for trial in record.counted:
        if trial.wrong:
            verdict = trial.verdict
            measured = verdict.criterion.shown(trial.measured)
            way = "alone" if trial.left_out == "test" else "with its speed group"
            yield Sentence(
                "{}, left out {}: {} ({}) was said to be {}; measured {}.",
                trial.held_out, way, verdict.criterion.name, verdict.criterion.limits, verdict.word, measured,
            )  # fmt: skip


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


def counted(n: int, noun: str) -> str:
    """A number with its noun: ``3 criteria``."""
    plural = "criteria" if noun == "criterion" else f"{noun}s"
    return f"{n:,} {noun if n == 1 else plural}"
