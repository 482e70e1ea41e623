"""What the record of left-out tests says of verdicts, in words."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby

from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.track_record import MOST_OF_A_TEST, TrackRecord, Trial, largest_share
from crashfuse.wording import Quantity, Sentence, joined, probability_text, speed, weight

INTERVAL = 0.95
"""Share of tests that intervals are made to hold."""
_NAMED = 20  # in a sentence


def at_most(wrong: int, n: int) -> str:
    """The exact 95 % bound of the share of wrong ones: ``at most 4.5 %``."""
    return f"at most {100 * largest_share(wrong, n):.1f} %"


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
        f"({at_most(wrong, decided)}, exact 95 % bound if they did not hang together); {undecided} open or outside."
    )
    telling, missed = record.telling.decided
    if telling == decided:
        return said
    rest = f"without them, {missed} of {telling} wrong ({at_most(missed, telling)})" if telling else "none is left"
    rest_of = f"{decided - telling} of the {decided} show nothing more, on a metric a second time or on limits that no"
    return f"{said} {rest_of} left-out test came near: {rest}."


def waived_sentence(record: TrackRecord, criteria: Criteria) -> Iterator[str]:
    """How many left-out tests need not have been run, and how many of them missed a criterion, with the exact bound."""
    left_out, saved, wrong = record.waived(criteria)
    if not left_out:
        return
    times = f"Of {counted(left_out, 'test')}, left out alone and with the speed group,"
    if saved:
        yield (
            f"{times} {saved} need not have been run, as every criterion was met; {wrong} of these missed one all the "
            f"same ({at_most(wrong, saved)}, exact 95 % bound)."
        )
    else:
        yield (
            f"{times} none met every criterion by its verdicts. How often a test that need not be run would miss one, "
            "this record cannot say."
        )


def interval_sentence(record: TrackRecord) -> Iterator[str]:
    """How many intervals held what left-out tests measured, if there are any, and which did not."""
    inside, n = record.intervals
    if n:
        said = (
            f"{inside} of {counted(n, 'interval')} held what the left-out test measured ({100 * inside / n:.0f} %; "
            "made to hold 95 % of single tests), of left-out tests inside what the others check{}."
        )
        yield Sentence(said, missed_intervals(record.missed_intervals))


def missed_intervals(trials: Sequence[Trial]) -> str:
    """What was measured outside its interval, and where that was."""
    if not trials:
        return ""
    each = [
        Sentence("{} {} {}, not {}", trial.held_out, of.name, found, of.interval(own.lower, own.upper))
        for trial in trials
        for own, of in [(trial.verdict, trial.verdict.criterion)]
        for found in [measured_words(of, trial.measured, trial.shift)]
    ]
    return Sentence("; outside: {}", listed(each))


def measured_words(criterion: Criterion, value: float | None, shift: float) -> Quantity | Sentence:
    """What a test measured; if it was off its condition, with the value there as the CAE model says."""
    if value is None or not shift:
        return criterion.shown(value)
    return Sentence(
        "{} ({} at its condition, by the CAE model)", criterion.shown(value + shift), criterion.shown(value)
    )


def is_too_narrow(inside: int, n: int) -> bool:
    """Whether so few intervals held what was measured that they cannot hold 95 % (exact 95 % bound)."""
    return n > 0 and largest_share(inside, n) < INTERVAL


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
    own = f"With one verdict a test, {support.own_wrong} of {support.own_decided} are wrong"
    others = f"; with those on other criteria, at most {MOST_OF_A_TEST} a test, {support.wrong} of {support.decided}"
    right = f"{probability_text(support.confidence, confidence)} are expected to be right, as if they were independent"
    return f"It supports the confidence. {own}{others if support.decided > support.own_decided else ''}: {right}."


def wrong_sentences(record: TrackRecord) -> Iterator[str]:
    """Each verdict on a left-out test that it contradicted."""
    for trial in record.counted:
        if trial.wrong:
            verdict = trial.verdict
            measured = verdict.criterion.shown(trial.measured)
            way = "alone" if trial.left_out == "test" else "with its speed group"
            yield Sentence(
                "{}, left out {}: {} ({}) was said to be {}; measured {}.",
                trial.held_out, way, verdict.criterion.name, verdict.criterion.limits, verdict.word, measured,
            )  # fmt: skip


def counted(n: int, noun: str) -> str:
    """A number with its noun: ``3 criteria``."""
    plural = "criteria" if noun == "criterion" else f"{noun}s"
    return f"{n:,} {noun if n == 1 else plural}"


def listed(names: Sequence[str]) -> str:
    """The first names, and how many there are more."""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return Sentence("{}{}", joined(names[:_NAMED], ", "), more)


_ENDS = ", where the CAE runs end,"


def domain_sentences(domain: Domain) -> tuple[str, ...]:
    """Where the tests, left out with all others at about their speed, check predictions."""
    if not domain.speed_ranges_mps:
        return domain.too_few_tests or ("Nothing is checked: no test lies within the speeds of the CAE runs.",)
    speeds = joined([Sentence("{}", speed(*ends, between=" to ")) for ends in domain.speed_ranges_mps], " and ")
    masses = weight(*domain.checked_masses_kg, between=" to ")
    factors = "; ".join(f"{name} {', '.join(values)}" for name, values in domain.factors.items())
    slowest, fastest = (float(end[0]) for end in domain.cae.range)
    below, above = domain.speeds_mps[0] - slowest, fastest - domain.speeds_mps[-1]
    return (
        Sentence(
            f"Checked by the {domain.n_tests} tests, each left out with all others at about its speed: {{}}, front "
            "and rear weight together {}{}; and within the range of the CAE runs.",
            speeds,
            masses,
            f"; {factors}" if factors else "",
        ),
        Sentence(
            "A condition is at most {} from the nearest test, as far as left-out tests were from those that gave them "
            "a verdict; {} below the slowest{} and {} above the fastest{}.",
            speed(domain.reach_mps),
            speed(max(min(below, domain.below_mps), 0.0)),
            _ENDS * (below < domain.below_mps),
            speed(max(min(above, domain.above_mps), 0.0)),
            _ENDS.rstrip(",") * (above < domain.above_mps),
        ),
    )


ONE_BY_ONE = 6  # conditions, or fewer
_RANGES = 8


def listed_conditions(rows: Iterable[str], answers: Mapping[str, str], file: str = "certification.csv") -> str:
    """Conditions, each with its answer in brackets if there is one: ``M01 to M08, M11 (crush); M09 (peak)``.

    Parameters
    ----------
    rows : iterable of str
        Ids of the conditions in the order of the matrix.
    answers : mapping of str to str
        By the id of each condition that is told; of many, the answer that most of them share is told first.
    file : str
        Which file has those that are left out.
    """
    if len(answers) <= ONE_BY_ONE:
        return ", ".join(_with_answer(i, own) for i, own in answers.items())
    ranges: dict[str, list[list[str]]] = {}
    for answer, ids in groupby(rows, answers.get):
        if answer is not None:
            ranges.setdefault(answer, []).append(list(ids))
    told, left, room = [], len(answers), _RANGES
    for answer, own in sorted(ranges.items(), key=lambda item: -sum(map(len, item[1]))):
        if shown := own[:room]:
            told.append(_with_answer(", ".join(map(_range, shown)), answer))
        room -= len(shown)
        left -= sum(map(len, shown))
    listed = "; ".join(told)
    return f"{len(answers):,} conditions, {listed} and {left:,} more, all in {file}" if left else listed


def _range(ids: list[str]) -> str:
    return ", ".join(ids) if len(ids) < 3 else f"{ids[0]} to {ids[-1]}"


def _with_answer(conditions: str, answer: str) -> str:
    return f"{conditions} ({answer})" if answer else conditions
