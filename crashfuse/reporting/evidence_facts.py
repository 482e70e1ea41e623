"""What the record of left-out tests, the validated domain and tests run since say of a certification, as facts."""

from collections.abc import Iterator, Mapping, Sequence

from crashfuse.approaches.base import WHOLE_SHARE
from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.earlier import LaterTests
from crashfuse.certification.track_record import (
    MOST_OF_A_TEST,
    TrackRecord,
    Trial,
    WrongShare,
    at_most,
    counted_wrong,
    largest_share,
    strictest_per_metric,
    trial_bounds,
)
from crashfuse.crash_test import SPEED_STEP_MPS
from crashfuse.reporting.figures import how_left_out
from crashfuse.reporting.fit_explanations import whole_sentence
from crashfuse.study.facts import Fact
from crashfuse.units import Quantity, Sentence, counted, joined, probability_text, speed, weight

_NAMED = 20  # in a sentence
_DIGEST = 12  # characters of it in a sentence


def fact(code: str, sentence: str, **values: object) -> Fact:
    """A fact whose subject the catalogue of a certification has."""
    return Fact(code, sentence, "", values)


def record_facts(certification: Certification) -> Iterator[Fact]:
    """How often verdicts on left-out tests were wrong, intervals too narrow, and probabilities contradicted."""
    record, criteria = certification.record, certification.criteria
    if not record.trials:
        why = "the CAE model was tuned to every test" if record.tuned else "with a single test, none can be left out"
        yield fact("record.none", f"There is no record: {why}.")
        return
    (n, wrong), bounds, near = record.decided, record.bounds(), record.near_limit
    once = len({(trial.held_out, trial.verdict.criterion) for trial in record.counted if trial.verdict.decided})
    (near_n, missed), (met, not_met) = near.decided, (near.counts()[word][0] for word in ("met", "not met"))
    yield fact(
        "record.decided",
        f"Record of left-out tests: {counted(n, 'verdict')} met or not met, {bounds_text(bounds)}. Near the limits, "
        f"where it matters: {near_n}, {counted_wrong(missed)} ({at_most(missed, near_n)}; one a metric and test: {met} "
        f"met, {not_met} not met). {len(record.counted) - n} more are open or outside. No bound holds for another "
        "vehicle.",
        n=n, once=once, wrong=wrong, near=near_n, near_wrong=missed,
        bounds={unit: share.at_most for unit, share in bounds.items()},
    )  # fmt: skip
    tests, saved, missed = record.waived(criteria)
    bound = f"{at_most(missed, saved)} of such answers are wrong, exact one-sided 95 % bound"
    outcome = f"; {missed or 'none'} of these missed one ({bound})" if saved else ""
    yield fact(
        "record.waived",
        f"Each of {counted(tests, 'test')} was left out, alone and with its speed group, and judged like a planned "
        f"one. By the criteria {saved or 'none'} would have been skipped{outcome}.",
        tests=tests, n=saved, wrong=missed,
    )  # fmt: skip
    if (with_runs := certification.record_with_runs) is not None:
        (n, wrong), (_, saved_too, _) = with_runs.decided, with_runs.waived(criteria)
        counts = f"{counted(n, 'verdict')} would be met or not met, {wrong or 'none'} wrong"
        told = f"With them {counts}; {saved_too or 'no'} tests would have been skipped."
        without = "Left-out tests are predicted without their CAE runs, as planned conditions have none."
        yield fact("record.with_runs", f"{without} {told}", n=n, wrong=wrong, saved=saved_too)
    yield from _intervals(record)
    if whole := record.whole_pulses:
        narrow = any(largest_share(*own) < WHOLE_SHARE for own in whole.values())
        told = f"{whole_sentence({how_left_out(way): own for way, own in whole.items()})} No verdict rests on this band"
        yield fact("record.whole", f"{told}{', which is too narrow' * narrow}.", narrow=narrow, **whole)
    if record.brier is not None and record.brier[0] >= record.brier[1]:
        ours, cae = (f"{score:.4f}" if score >= 5e-5 else "below 0.0001" for score in record.brier)
        told = "Brier score of the probabilities of metrics, ratings aside (0 is perfect)"
        yield fact("record.no_gain", f"{told}: {ours}; {cae} for the raw CAE with its own error as band.")
    for trial in record.counted:
        if trial.wrong:
            yield _wrong("record.wrong", trial, how_left_out(trial.left_out), criteria.confidence)
    for own in record.reliability:
        if not own.holds:
            told = f"{own.low:g} to {own.high:g}, {own.probability:.3f} on average: {round(own.met * own.n)} of {own.n}"
            ends = f"(exact 95 % bounds {own.lower:.3f} to {own.upper:.3f})"
            yield fact("record.bin", f"{told} met it {ends}.", low=own.low, n=own.n, met=own.met)


def bounds_text(bounds: Mapping[str, WrongShare]) -> str:
    """How many verdicts were wrong, with both exact bounds."""
    verdicts, tests = bounds["verdicts"], bounds["tests"]
    return (
        f"{counted_wrong(verdicts.wrong)} ({at_most(*verdicts)}, exact one-sided 95 % bound; {at_most(*tests)} if the "
        f"verdicts on one test count as one)"
    )


def criterion_facts(certification: Certification) -> Iterator[Fact]:
    """Criteria whose record says too little, each sentence once, and those by the campaign's own occupant model."""
    record, occupant = certification.record, certification.campaign.occupant
    confidence = certification.criteria.confidence
    names: dict[tuple[str, str], list[str]] = {}
    for criterion in certification.criteria.items:
        support = record.support(criterion)
        if shortfall := support.shortfall(confidence):
            names.setdefault(("criterion.unsupported", shortfall), []).append(criterion.name)
        if record.trials and (reservation := support.reservation(confidence)) and not (support.near and shortfall):
            code = "criterion.few" if support.near else "criterion.untouched"
            names.setdefault((code, reservation), []).append(criterion.name)
        if words := {"olc": occupant.olc_words, "vpi": occupant.vpi_words}.get(criterion.metric):
            told = f"{criterion.name}: by {words} of campaign.toml, no number to compare with others'."
            yield fact("criterion.occupant", told, criterion=criterion.name)
    for (code, sentence), some in names.items():
        yield fact(code, f"{', '.join(some)}: {sentence}", criteria=some)


def support_text(record: TrackRecord, criterion: Criterion, confidence: float) -> str:
    """What the record says of a criterion at this confidence."""
    support = record.support(criterion)
    return (
        support.shortfall(confidence)
        or support.reservation(confidence)
        or f"It supports the confidence: {counted(support.own_decided, 'verdict')}, one a test, "
        f"{counted_wrong(support.own_wrong)}; with other criteria {support.decided}, at most {MOST_OF_A_TEST} a test, "
        f"{counted_wrong(support.wrong)}."
    )


def domain_facts(domain: Domain) -> Iterator[Fact]:
    """Where the tests, left out with all others at about their speed, check predictions."""
    if not domain.speed_ranges_mps:
        nothing = "Nothing is checked: no test lies within the speeds of the CAE runs."
        yield from (fact("domain.checked", sentence) for sentence in domain.too_few_tests or (nothing,))
        return
    speeds = joined([Sentence("{}", speed(*ends, between=" to ")) for ends in domain.speed_ranges_mps], " and ")
    factors = "".join(f"; {name} {', '.join(values)}" for name, values in domain.factors.items())
    yield fact(
        "domain.checked",
        Sentence(
            "Validated domain: {}, front and rear weight together {}{}; within the range of the CAE runs. By rule it "
            f"goes beyond {domain.n_tests} tests at {{}} and {{}}: up to {{}}, over gaps below {{}}, and in weight. "
            f"Left out with their speed group, {len(domain.inside)} lay inside that of the others: {{}}.",
            speeds, weight(*domain.checked_masses_kg, between=" to "), factors,
            speed(domain.speeds_mps[0], domain.speeds_mps[-1], between=" to "),
            weight(*domain.tested_kg, between=" to "), speed(domain.reach_mps), speed(SPEED_STEP_MPS),
            listed(domain.inside) or "none",
        ),
        tests=domain.n_tests, inside=domain.inside,
    )  # fmt: skip


def since_facts(since: LaterTests) -> Iterator[Fact]:
    """What an earlier certification had said of tests that were run since, and whether it was right."""
    earlier = since.earlier
    repeats = [test for test, condition in since.made_for.items() if condition in earlier.run]
    tests = [
        f"{told}: {listed(some)}"
        for told, some in (
            ("tests that it did not know", since.new),
            ("of these repeats, which do not count", repeats),
        )
        if some
    ]
    of = f"{counted(len(earlier.matrix.ids), 'condition')} from {counted(len(earlier.tests), 'test')}"
    yield fact(
        "since.beside",
        f"Beside the earlier certification of {of}, by its own account of {earlier.date} (SHA-256 "
        f"{earlier.digest[:_DIGEST]}…); {'; '.join(tests) or 'it knew every test'}.",
        new=since.new,
    )  # fmt: skip
    bounds = outcomes(since)
    (wrong, n), (_, n_tests) = bounds["verdicts"], bounds["tests"]
    if n:
        of = f"verdicts met or not met on {counted(n, 'metric')} of {counted(n_tests, 'test')}"
        told = f"Tests run since, ratings aside: {of}, {bounds_text(bounds)}."
        yield fact("since.outcomes", told, n=n, wrong=wrong, tests=n_tests)
    for trial in since.trials:
        if trial.wrong:
            yield _wrong("since.wrong", trial, "before it was run", earlier.criteria.confidence)


def outcomes(since: LaterTests) -> dict[str, WrongShare]:
    """:func:`trial_bounds` of the verdicts on tests run since, each metric once."""
    return trial_bounds(strictest_per_metric(since.counted))


def _wrong(code: str, trial: Trial, how: str, confidence: float) -> Fact:
    verdict, criterion = trial.verdict, trial.verdict.criterion
    probability = probability_text(verdict.probability, confidence)
    sentence = Sentence(
        "{}, {}: {} ({}) at {} was said to be {} (probability {}); measured {}.",
        trial.held_out, how, criterion.name, criterion.limits, verdict.condition, verdict.word, probability,
        measured_text(criterion, trial.measured, trial.shift),
    )  # fmt: skip
    return fact(code, sentence, test=trial.held_out, criterion=criterion.name, said=verdict.word)


def _intervals(record: TrackRecord) -> Iterator[Fact]:
    (inside, n), (inside_outside, n_outside) = record.intervals, record.intervals_outside
    missed = [
        Sentence("{} {} {}, not {}", t.held_out, limit.name, limit.shown(t.measured), limit.interval(v.lower, v.upper))
        for t in record.missed_intervals
        for v, limit in [(t.verdict, t.verdict.criterion)]
    ]
    if n:
        also = f", and {inside_outside} of {n_outside} outside the validated domain," * bool(n_outside)
        which = Sentence("; missed: {}", listed(missed)) if missed else ""
        held = f"{inside} of {counted(n, 'interval')}{also} held what the left-out test measured, made to hold 95 %"
        code = "record.too_narrow" if record.too_narrow else "record.intervals"
        yield fact(code, Sentence(f"{held}{{}}.", which), inside=inside, n=n)


def measured_text(criterion: Criterion, value: float | None, shift: float) -> Quantity | Sentence:
    """What a test measured where it was run and, if that was off its condition, there by the CAE model."""
    if value is None or not shift:
        return criterion.shown(value)
    told = "{} ({} at its condition, by the CAE model)"
    return Sentence(told, criterion.shown(value + shift), criterion.shown(value))


def listed(names: Sequence[str]) -> str:
    """The first names, and how many there are more."""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return Sentence("{}{}", joined(names[:_NAMED], ", "), more)
