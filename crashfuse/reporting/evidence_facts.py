"""What the record of left-out tests, the validated domain and tests run since say of a certification, as facts."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby

from crashfuse.approaches.base import WHOLE_SHARE
from crashfuse.certification.certify import Certification
from crashfuse.certification.changes import Changes, saved_and_missed
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.track_record import MOST_OF_A_TEST, TrackRecord, Trial, WrongShare, at_most, largest_share
from crashfuse.crash_test import SPEED_STEP_MPS
from crashfuse.reporting.figures import how_left_out
from crashfuse.reporting.fit_explanations import whole_sentence
from crashfuse.reporting.provenance import certification_settings
from crashfuse.study.facts import Fact
from crashfuse.wording import Quantity, Sentence, counted, joined, probability_text, speed, weight

_NAMED = 20  # in a sentence
_ONE_BY_ONE = 6  # conditions, or fewer
_RANGES = 8
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
        f"Record of left-out tests: {counted(n, 'verdict')} met or not met, {bounds_text(bounds)}; "
        f"{len(record.counted) - n} open or outside. No bound holds for another vehicle. With each test once {once} "
        f"of the {n} remain. On tests within an interval's width of the limit, or wrong, one a metric and test: "
        f"{met} met, {not_met} not met, {missed} wrong ({at_most(missed, near_n)}).",
        n=n, once=once, wrong=wrong, near=near_n, near_wrong=missed,
        bounds={unit: share.at_most for unit, share in bounds.items()},
    )  # fmt: skip
    tests, saved, missed = record.waived(criteria)
    by_way = dict[str, list[str]]()
    for test, ways in record.saved(criteria).items():
        by_way.setdefault(" and ".join(map(how_left_out, ways)), []).append(test)
    which = "".join(f" They are, {way}: {listed(some)}." for way, some in by_way.items())
    yield fact(
        "record.waived",
        f"Of {counted(tests, 'test')}, left out alone and with the speed group, {saved} need not have been run; "
        f"{missed} of these missed a criterion ({at_most(missed, saved)}, exact 95 % bound).{which}",
        tests=tests, n=saved, wrong=missed,
    )  # fmt: skip
    if (with_runs := certification.record_with_runs) is not None:
        (n, wrong), (_, saved_too, _) = with_runs.decided, with_runs.waived(criteria)
        told = f"With them {counted(n, 'verdict')} would be met or not met, {wrong} wrong; {saved_too} tests not run."
        without = "Left-out tests are predicted without their CAE runs, as planned conditions have none."
        yield fact("record.with_runs", f"{without} {told}", n=n, wrong=wrong, saved=saved_too)
    n, missed = saved_and_missed(certification)
    if n > saved:
        told = "With tests run since that earlier certifications waived"
        yield fact("since.waived", f"{told}: {missed} of {n} missed one ({at_most(missed, n)}).", n=n, wrong=missed)
    yield from _intervals("record", record, "the left-out test measured, made to hold 95 %", record.too_narrow)
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
    by_test = f"{at_most(*tests)} as if tests were, {tests.wrong} of {tests.n} with a wrong one"
    return f"{verdicts.wrong} wrong ({at_most(*verdicts)}, exact 95 % bound as if verdicts were independent; {by_test})"


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
    right = f"{probability_text(support.confidence, confidence)} are expected to be right; only the bounds are proven"
    return (
        support.shortfall(confidence)
        or support.reservation(confidence)
        or f"It supports the confidence: {support.own_wrong} of {support.own_decided} wrong, one verdict a test; "
        f"{support.wrong} of {support.decided} with other criteria, at most {MOST_OF_A_TEST} a test; {right}."
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


def change_facts(changes: Changes) -> Iterator[Fact]:
    """Whether what an earlier certification said came true, and what is said otherwise today."""
    earlier, later, since = changes.earlier, changes.later, changes.since
    tests = [
        f"{told}: {listed(some)}"
        for told, some in (
            ("tests that it did not know", since.new),
            ("tests whose record or filter class is another since", since.changed),
            ("no longer used", since.gone),
        )
        if some
    ]
    of = f"{counted(len(earlier.matrix.ids), 'condition')} from {counted(len(earlier.tests), 'test')}"
    yield fact(
        "since.beside",
        f"Beside the earlier certification of {of}, by its own account of {earlier.date} (SHA-256 "
        f"{earlier.digest[:_DIGEST]}…); {'; '.join(tests) or 'it knew every test'}.",
        new=since.new, changed=since.changed, gone=since.gone,
    )  # fmt: skip
    now = certification_settings(later.campaign, later.config, later.criteria.confidence)
    pairs = [(name, value, earlier.settings.get(name, "unknown")) for name, value in now.items()]
    pairs.append(("costs", str(later.criteria.costs or "none"), str(earlier.criteria.costs or "none")))
    if differ := [f"{name} {value} (then {then})" for name, value, then in pairs if value != then]:
        yield fact("since.settings", f"Made otherwise: {'; '.join(differ)}.")
    yield from _tested(changes)
    for told, bounds in (
        ("Tests run since, ratings aside", changes.outcomes),
        ("Certifications before it", changes.outcomes_before),
    ):
        (wrong, n), (_, n_tests) = bounds["verdicts"], bounds["tests"]
        if n:
            of = f"verdicts met or not met on {counted(n, 'metric')} of {counted(n_tests, 'test')}"
            yield fact("since.outcomes", f"{told}: {of}, {bounds_text(bounds)}.", n=n, wrong=wrong, tests=n_tests)
    narrow = ": they were too narrow" * changes.too_narrow
    told = f"tests run since measured, made to hold 95 %{narrow}"
    yield from _intervals("since", changes.record, told, changes.too_narrow)
    for name, outcomes in changes.waived_outcomes.items():
        for test, (missed, unknown) in outcomes.items():
            told = f"missed {', '.join(missed) or 'none'}, unknown {', '.join(unknown) or 'none'}"
            sentence = f"{name} needed no test by an earlier certification; {test} {told}."
            yield fact("since.waived_outcome", sentence, condition=name, test=test, missed=missed, unknown=unknown)
    for trial in since.all_trials:
        if trial.wrong:
            yield _wrong("since.wrong", trial, "before it was run", earlier.criteria.confidence)
    yield from _compared(changes)


def _tested(changes: Changes) -> Iterator[Fact]:
    since, campaign = changes.since, changes.since.campaign
    there = {test: campaign.test(test).condition for test in since.made_for}
    off = {test: Sentence(", at {}", there[test]) if since.is_off(test) else "" for test in there}
    tested = [(name, test) for name, tests in changes.tested.items() for test in tests]
    for told, some in (
        ("Tested since", [Sentence("{} (test {}{})", name, test, off[test]) for name, test in tested]),
        ("Repeats, which are not counted", [f"{i} (test {t})" for t, i in since.repeats.items()]),
        ("Run at none of its conditions", since.elsewhere),
    ):
        if some:
            yield fact("since.tested", Sentence("{}: {}.", told, listed(some)), tests=[str(own) for own in some])
    given = {trial.held_out: trial.given for trial in since.all_trials}
    ages = {True: "dated before their test", False: "not dated before it", None: "on tests without a date (about_date)"}
    for is_older, told in ages.items():
        if tests := [test for test, older in since.is_older.items() if older is is_older]:
            stated = [f"{t} ({given[t][0]}{', sealed' if given[t][1] else ''})" if given[t][0] else t for t in tests]
            yield fact("since.dated", f"Verdicts {told}: {listed(stated)}.", tests=tests, older=is_older)
    for trial in since.all_trials:
        criterion = trial.verdict.criterion
        if trial.verdict.decided and criterion.is_met_by(trial.measured + trial.shift) is not trial.met:
            told = "Where {} was run decides whether its verdict came true: {} ({}), said to be {}, {}, counts as {}."
            measured = measured_text(criterion, trial.measured, trial.shift)
            said = (trial.verdict.word, measured, "wrong" if trial.wrong else "right")
            names = (trial.held_out, criterion.name, criterion.limits, *said)
            yield fact("since.moved", Sentence(told, *names), test=trial.held_out, wrong=trial.wrong, shift=trial.shift)


def _compared(changes: Changes) -> Iterator[Fact]:
    pairs = changes.compared
    same = sum(before.word == now.word for _, before, now in pairs)
    gained = sum(now.decided and not before.decided for _, before, now in pairs)
    lost = sum(before.decided and not now.decided for _, before, now in pairs)
    gone, added = sum(cell.now is None for cell in changes.cells), sum(cell.before is None for cell in changes.cells)
    yield fact(
        "since.compared",
        f"Of {counted(len(pairs), 'verdict')} that both have, as they were: {same}; decided since: {gained}; no longer "
        f"decided: {lost}. Not compared (other condition or limit): {gone} of then, {added} of now.",
        both=len(pairs), same=same, gained=gained, lost=lost, gone=gone, added=added,
    )  # fmt: skip
    turned = {
        f"{cell.name} ({cell.criterion.name})": ""
        for cell, before, now in pairs
        if before.decided and now.decided and before.word != now.word
    }
    withdrawn = {
        i: ", ".join(f"{verdict.criterion.name} {verdict.word}" for verdict in rest)
        or "each met, all at once uncertain"
        for i, rest in changes.withdrawn.items()
    }
    for code, told, answers in (
        ("since.turned", "Turned round", turned),
        ("since.newly_waived", "Need not be run any more", dict.fromkeys(changes.newly_waived, "")),
        ("since.withdrawn", "Said then to need no test, and not now", withdrawn),
    ):
        if answers:
            listing = listed_conditions([*changes.later.matrix.ids, *turned], answers, "changes.csv")
            yield fact(code, f"{told}: {listing}.", conditions=answers)


def _wrong(code: str, trial: Trial, how: str, confidence: float) -> Fact:
    verdict, criterion = trial.verdict, trial.verdict.criterion
    probability = probability_text(verdict.probability, confidence)
    sentence = Sentence(
        "{}, {}: {} ({}) at {} was said to be {} (probability {}); measured {}.",
        trial.held_out, how, criterion.name, criterion.limits, verdict.condition, verdict.word, probability,
        measured_text(criterion, trial.measured, trial.shift),
    )  # fmt: skip
    return fact(code, sentence, test=trial.held_out, criterion=criterion.name, said=verdict.word)


def _intervals(kind: str, record: TrackRecord, what: str, too_narrow: bool) -> Iterator[Fact]:
    (inside, n), (inside_outside, n_outside) = record.intervals, record.intervals_outside
    missed = [
        Sentence("{} {} {}, not {}", trial.held_out, limit.name, measured, limit.interval(v.lower, v.upper))
        for trial in record.missed_intervals
        for v, limit in [(trial.verdict, trial.verdict.criterion)]
        for measured in [measured_text(limit, trial.measured, trial.shift)]
    ]
    if n:
        also = f", and {inside_outside} of {n_outside} outside the validated domain," * bool(n_outside)
        which = Sentence("; missed: {}", listed(missed)) if missed else ""
        sentence = Sentence(f"{inside} of {counted(n, 'interval')}{also} held what {what}{{}}.", which)
        yield fact(f"{kind}.{'too_narrow' if too_narrow else 'intervals'}", sentence, inside=inside, n=n)


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


def listed_conditions(rows: Iterable[str], answers: Mapping[str, str], file: str = "certification.csv") -> Sentence:
    """Conditions, each with its answer in brackets if there is one: ``M01 to M08, M11 (crush); M09 (peak)``.

    ``rows`` are all ids in the order of the matrix. Of many, the answer that most share comes first; ``file`` has all.
    """
    if len(answers) <= _ONE_BY_ONE:
        return joined([_with_answer(i, answer) for i, answer in answers.items()], ", ")
    ranges: dict[str, list[list[str]]] = {}
    for answer, ids in groupby(rows, answers.get):
        if answer is not None:
            ranges.setdefault(answer, []).append(list(ids))
    told, left, room = [], len(answers), _RANGES
    for answer, some in sorted(ranges.items(), key=lambda item: -sum(map(len, item[1]))):
        if shown := some[:room]:
            texts = [", ".join(ids) if len(ids) < 3 else f"{ids[0]} to {ids[-1]}" for ids in shown]
            told.append(_with_answer(", ".join(texts), answer))
        room -= len(shown)
        left -= sum(map(len, shown))
    listing = joined(told, "; ")
    return (
        Sentence("{} conditions, {} and {} more, all in {}", f"{len(answers):,}", listing, f"{left:,}", file)
        if left
        else listing
    )


def _with_answer(conditions: str, answer: str) -> Sentence:
    return Sentence("{} ({})", conditions, answer) if answer else Sentence("{}", conditions)
