"""What is said of a certification: every fact once, with its code and values, and where each of them is shown."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import chain, groupby
from statistics import fmean
from typing import Any, ClassVar, Literal

from crashfuse.approaches.base import WHOLE_SHARE
from crashfuse.certification import track_record as records
from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import likely_unit
from crashfuse.certification.earlier import LaterTests
from crashfuse.certification.verdict import all_met
from crashfuse.execution.cache import remembered
from crashfuse.files.toml_text import package_data
from crashfuse.results.figures import how_left_out
from crashfuse.results.fit_explanations import whole_sentence
from crashfuse.study.config import has_speed_groups
from crashfuse.study.facts import Fact, by_importance, campaign_facts, tuning_fact
from crashfuse.units import KPH, Sentence, counted, joined, probability_text, speed, weight

CATALOGUE: Mapping[str, list[str]] = package_data(__file__)
"""By code, the most important first: a heading of what speaks against verdicts, and sentences if not a campaign's."""
SUBJECTS: Mapping[str, str] = {code: heading for code, (heading, *_) in CATALOGUE.items() if heading}
DECISIVE = tuple(SUBJECTS.values())[: list(SUBJECTS).index("condition.new_together") + 1]
"""The subjects that stand beside the answer itself."""

Place = Literal["answer", "verdicts", "costs", "summary", "record", "domain", "since"]
_COSTS = ("costs.confidence", "costs.saving")
_RECORD = (
    *("record.decided", "record.waived", "record.with_runs", "record.no_gain", "record.none"),
    *("tests.cae_tuned", "since.outcomes"),
)
PLACES: Mapping[Place, tuple[str, ...]] = {
    "answer": (
        *("matrix.saved", "matrix.skipping_loses", "since.outcomes", "record.none", "record.waived", "since.beside"),
        *("costs.saving", "matrix.run_first"),
    ),
    "verdicts": ("matrix.counted_once", "matrix.counts", "matrix.run_first", "spot_check"),
    "costs": _COSTS,
    "summary": (
        *("matrix.saved", "matrix.skipping_loses", "matrix.counted_once", *_COSTS),
        *("matrix.counts", "matrix.run_first", "spot_check", *_RECORD, "record.slower"),
        *("test.not_used", "condition.no_factor", "condition.new_together"),
        *("criterion.unsupported", "criterion.untouched", "criterion.few"),
    ),
    "record": (*_RECORD, "record.intervals", "record.too_narrow", "record.whole"),
    "domain": ("domain.checked",),
    "since": ("since.beside", "since.outcomes", "since.wrong"),
}
"""The codes that each place shows; those that answer by their rank."""
_MOST_ANSWERS = 3


@dataclass(frozen=True, slots=True)
class CertificationFact(Fact):
    """A fact of a certification."""

    catalogue: ClassVar[Mapping[str, list[str]]] = CATALOGUE


def _fact(code: str, *about: str, **values: object) -> Fact:
    return CertificationFact(code, values, about)


@remembered  # asked for by every place
def facts(certification: Certification) -> tuple[Fact, ...]:
    """All facts of a certification, the most important first."""
    kinds = _campaign, _matrix, _costs, _record, _domain, _conditions, _criteria, _since
    return by_importance(chain.from_iterable(kind(certification) for kind in kinds), CATALOGUE)


def sentences(certification: Certification, place: Place) -> tuple[Sentence, ...]:
    """The sentences that a place shows."""
    return tuple(fact.sentence for fact in facts(certification) if fact.code in PLACES[place])


def answer(certification: Certification) -> tuple[Sentence, ...]:
    """What was asked, in three sentences at most."""
    told = {fact.code: fact.sentence for fact in facts(certification)}
    return tuple(told[code] for code in PLACES["answer"] if code in told)[:_MOST_ANSWERS]


def against(certification: Certification) -> dict[str, Sentence]:
    """By decisive subject, its first exception that is not said anyway, and how many more."""
    said = {*answer(certification), *(fact.sentence for fact in campaign_facts(certification.campaign))}
    found = {}
    for subject, told in exceptions(certification).items():
        left = [sentence for sentence in told if sentence not in said]
        if left and subject in DECISIVE:
            found[subject] = joined([left[0], *([f"(and {len(left) - 1} more)"] if left[1:] else [])])
    return found


def exceptions(certification: Certification) -> dict[str, tuple[Sentence, ...]]:
    """What speaks against the verdicts, by subject that has any."""
    against = [fact for fact in facts(certification) if fact.code in SUBJECTS]
    grouped = groupby(against, lambda fact: SUBJECTS[fact.code])
    return {subject: tuple(fact.sentence for fact in group) for subject, group in grouped}


def _campaign(certification: Certification) -> Iterator[Fact]:
    campaign = certification.campaign
    yield from (fact for fact in campaign_facts(campaign) if fact.code in SUBJECTS and fact.code != "tests.cae_tuned")
    if any(test.cae_tuned is not False for test in campaign.tests):
        yield tuning_fact(campaign)
    if (quality := campaign.quality).unpassed:
        yield _fact("cae.unchecked", checks=quality.checks)
    for test in campaign.tests:
        if notes := campaign.cae.extrapolation(test.condition):
            yield _fact("test.extrapolated", test.id, notes=joined(notes))
    for name in dict.fromkeys(chain.from_iterable(unused_at(certification).values())):
        yield _fact("test.not_used", name, condition=dict(campaign.unused)[name], reason=campaign.reason_of(name))


def _matrix(certification: Certification) -> Iterator[Fact]:
    ids, confidence = certification.matrix.ids, certification.criteria.confidence
    size = f"{counted(len(ids), 'condition')} × {counted(len(certification.criteria.items), 'criterion')}"
    counts = ", ".join(f"{n} {word}" for word, n in certification.n_by_word.items())
    yield _fact("matrix.counts", size=size, counts=counts, confidence=confidence, run=[*certification.run])
    n, of = certification.saved
    code = "matrix.skipping_loses" if certification.sure and certification.skipping_loses else "matrix.saved"
    yield _fact(code, n=n, of=of, planned=counted(of, "planned test"))
    if once := [f"{i} as {other}" for i, other in certification.counted_once.items()]:
        yield _fact("matrix.counted_once", alike=once)
    if first := certification.run_first:
        yield _fact("matrix.run_first", first)
    if drawn := spot_check(certification):
        texts = {name: probability_text(drawn[name], 1.0) for name in ("rates", "meets", "least")}
        yield _fact("spot_check", **drawn | texts | {"tests": counted(drawn["tests"], "planned test")})


def spot_check(certification: Certification) -> dict[str, Any]:
    """What to expect of a planned test, not run yet, that is drawn at random and run; empty if none can be told."""
    asked, rows = certification.criteria.spot_check, certification.rows
    rates = {i: p for i, p in certification.spot_checks.items() if i in rows}
    if not rates:
        return {}
    weakest = min(rates, key=rates.__getitem__)
    means = {"rates": fmean(rates.values()), "meets": fmean(all_met(rows[i]).probability for i in rates)}
    limit = {"at_least": asked.at_least, "window_ms": asked.window_ms}
    return {"tests": len(rates), **limit, **means, "weakest": weakest, "least": rates[weakest]}


def _costs(certification: Certification) -> Iterator[Fact]:
    criteria, costs = certification.criteria, certification.criteria.costs
    if costs is None:
        return
    asked = {"confidence": criteria.confidence, "follows": criteria.declared is None}
    yield _fact("costs.confidence", **asdict(costs), pays_from=costs.confidence, **asked)
    sure = [all_met(certification.rows[i]) for i in certification.sure if i not in certification.counted_once]
    if not sure:
        return
    expected, n = sum(costs.saving(1 - met.probability) for met in sure), len(sure)
    most, each = certification.record.bounds()["tests"].at_most, certification.cautious_saving
    savings = {"expected": expected, "cautious": None if each is None else n * each}
    verbs = {name: "loses" if (v or 0.0) < 0 else "saves" for name, v in savings.items()}
    texts = {f"{n}_text": v and f"{verbs[n]} {float(f'{abs(v):.3g}'):,.10g}" for n, v in savings.items()}
    yield _fact("costs.saving", n=n, tests=counted(n, "test"), wrong_at_most=most, **savings, **texts)


def _record(certification: Certification) -> Iterator[Fact]:
    record, criteria, rows = certification.record, certification.criteria, certification.rows
    if not record.trials:
        why = "the CAE model was tuned to every test" if record.tuned else "with a single test, none can be left out"
        yield _fact("record.none", why=why)
        return
    near = record.near_limit.bounds()["verdicts"]
    near_wrong = f"{records.counted_wrong(near.wrong)} (up to {records.percent_at_most(*near)})"
    text = f"{counted(near.n, 'verdict')} on hidden tests, {near_wrong}"
    near_text = text if near.n else "no verdict on a hidden test, so the others prove little"
    yield _fact("record.decided", **_outcome(record.bounds()), near=near.n, near_wrong=near.wrong, near_text=near_text)
    tests, saved, missed = record.waived(criteria)
    way = "also with all at its speed" if has_speed_groups(certification.campaign) else "alone"
    outcome = f"{missed} of these missed a criterion" if missed else f"All {saved} met every criterion"
    values = {"tests": counted(tests, "test"), "way": way, "n": saved, "answered": saved or "none", "wrong": missed}
    bound = records.percent_at_most(missed, saved) if saved else None
    yield _fact("record.waived", **values, outcome=outcome, bound=bound)
    hidden = record.saved(criteria)
    fastest = max((t.verdict.condition.speed_mps for t in record.counted if t.held_out in hidden), default=float("inf"))
    if faster := {i: v for i in certification.waived if (v := rows[i][0].condition.speed_mps) > fastest + KPH}:
        speeds = speed(*sorted({min(faster.values()), max(faster.values())}), between=" to ")
        yield _fact("record.slower", *faster, fastest=speed(fastest), speeds=speeds)
    if (with_runs := certification.record_with_runs) is not None:
        yield _fact("record.with_runs", **_outcome(with_runs.bounds()), skipped=with_runs.waived(criteria)[1])
    yield from _intervals(record)
    if whole := record.whole_pulses:
        narrow = any(records.largest_share(*counts) < WHOLE_SHARE for counts in whole.values())
        sentence = whole_sentence({how_left_out(way): counts for way, counts in whole.items()})
        yield _fact("record.whole", sentence=sentence, narrow=narrow, **whole)
    if record.brier is not None and record.brier[0] >= record.brier[1]:
        yield _fact("record.no_gain", brier=record.brier[0], brier_cae=record.brier[1])
    yield from _wrong("record.wrong", record.counted, criteria.confidence)
    yield from (_fact("record.bin", **asdict(own)) for own in record.reliability if not own.holds)


def _outcome(bounds: Mapping[str, records.WrongShare]) -> dict[str, object]:
    wrong, n = bounds["verdicts"]
    at_most = {"bound": records.percent_at_most(wrong, n), "bound_by_test": records.percent_at_most(*bounds["tests"])}
    return {"n": n, "wrong": wrong, "outcome": records.counted_wrong(wrong), **at_most}


def _criteria(certification: Certification) -> Iterator[Fact]:
    record, occupant = certification.record, certification.campaign.occupant
    confidence = certification.criteria.confidence
    names: dict[tuple[str, str], list[str]] = {}
    for criterion in certification.criteria.items:
        support = record.support(criterion)
        predicted = (v.value for _, v in certification.cells if v.criterion == criterion)
        values = [v for v in (*predicted, *(trial.measured for trial in record.of(criterion))) if v is not None]
        if likely := likely_unit(criterion, values):  # all in the unit of the file
            shown = f"{min(values):.4g} to {max(values):.4g} {criterion.unit}"
            yield _fact("criterion.unit", criterion.name, limits=str(criterion.limits), shown=shown, likely=likely)
        if shortfall := support.shortfall(confidence):
            names.setdefault(("criterion.unsupported", shortfall), []).append(criterion.name)
        if record.trials and (reservation := support.reservation(confidence)) and not (support.near and shortfall):
            code = "criterion.few" if support.near else "criterion.untouched"
            names.setdefault((code, reservation), []).append(criterion.name)
        if model := {"olc": occupant.olc_words, "vpi": occupant.vpi_words}.get(criterion.metric):
            yield _fact("criterion.occupant", criterion.name, model=model)
    for (code, why), criteria in names.items():
        yield _fact(code, *criteria, why=why)


def _domain(certification: Certification) -> Iterator[Fact]:
    domain = certification.domain
    if not domain.speed_ranges_mps:
        nothing = "No test lies within the speeds of the CAE runs."
        yield from (_fact("domain.checked", sentence=text) for text in domain.too_few_tests or (nothing,))
        return
    yield _fact(
        "domain.checked",
        speeds=[speed(*ends, between=" to ") for ends in domain.speed_ranges_mps],
        masses=weight(*domain.checked_masses_kg, between=" to "),
        factors=[f"{name} {', '.join(values)}" for name, values in domain.factors.items()],
        n_tests=domain.n_tests,
        tested_speeds=speed(domain.speeds_mps[0], domain.speeds_mps[-1], between=" to "),
        tested_masses=weight(*domain.tested_kg, between=" to "),
        reach_mps=domain.reach_mps,
        inside=domain.inside,
    )


def _since(certification: Certification) -> Iterator[Fact]:
    if (since := certification.since) is None:
        return
    earlier = since.earlier
    yield _fact(
        "since.beside",
        conditions=counted(len(earlier.matrix.ids), "condition"),
        tests=counted(len(earlier.tests), "test"),
        date=earlier.date,
        digest=earlier.digest[:12],
        new=since.new,
        repeats=[test for test, condition in since.made_for.items() if condition in earlier.run],
    )
    bounds = outcomes(since)
    if bounds["verdicts"].n:
        of = {unit: counted(share.n, unit.removesuffix("s")) for unit, share in bounds.items()}
        yield _fact("since.outcomes", **of, **_outcome(bounds))
    yield from _wrong("since.wrong", since.trials, earlier.criteria.confidence)


def outcomes(since: LaterTests) -> dict[str, records.WrongShare]:
    """:func:`trial_bounds` of the verdicts on tests run since, each metric once."""
    return records.trial_bounds(records.strictest_per_metric(since.counted))


def _wrong(code: str, trials: Iterable[records.Trial], confidence: float) -> Iterator[Fact]:
    for trial in (trial for trial in trials if trial.wrong):
        verdict, criterion = trial.verdict, trial.verdict.criterion
        yield _fact(
            code,
            trial.held_out,
            how="before it was run" if trial.left_out == "planned" else how_left_out(trial.left_out),
            criterion=criterion.title,
            limits=criterion.limits,
            condition=verdict.condition,
            said=verdict.word,
            probability=probability_text(verdict.probability, confidence),
            measured=trial.measured_text,
        )


def _intervals(record: records.TrackRecord) -> Iterator[Fact]:
    (inside, n), (inside_outside, n_outside) = record.intervals, record.intervals_outside
    missed = [
        Sentence("{} {} {}, not {}", trial.held_out, limit.name, trial.measured_text, limit.interval(v.lower, v.upper))
        for trial in record.missed_intervals
        for v, limit in [(trial.verdict, trial.verdict.criterion)]
    ]
    code = "record.too_narrow" if record.too_narrow else "record.intervals"
    if n:
        yield _fact(code, inside=inside, n=n, missed=missed, inside_outside=inside_outside, n_outside=n_outside or None)


def new_together(certification: Certification) -> dict[str, str]:
    """Factors of conditions that no test has together, by the condition's id."""
    tested, known = [dict(t.condition.factors) for t in certification.campaign.tests], certification.domain.factors
    found = {}
    for i, condition in certification.matrix.items:
        given = {name: value for name, value in condition.factors if value and name in known}
        new = not any(given.items() <= factors.items() for factors in tested)
        if new and all(value in known[name] for name, value in given.items()):
            found[i] = ", ".join(f"{name} {value}" for name, value in given.items())
    return found


def unused_at(certification: Certification) -> dict[str, list[str]]:
    """Tests run at a condition and not used, by its id."""
    matrix = certification.matrix
    unused = matrix.run(certification.campaign.unused)
    return {i: list(tests) for i, tests in zip(matrix.ids, unused, strict=True) if tests}


def _conditions(certification: Certification) -> Iterator[Fact]:
    domain, items = certification.domain, certification.matrix.items
    for sentence in domain.too_few_tests:
        yield _fact("condition.outside", *certification.matrix.ids, why=sentence)
    for i, condition in items:
        if not domain.too_few_tests and (why := domain.exceeded_by(condition)):
            yield _fact("condition.outside", i, why=joined(why))
        if short := [v.criterion.name for v in certification.rows[i] if v.word == "open" and v.probability is None]:
            yield _fact("condition.too_short", i, criteria=short)
    together = new_together(certification)
    for factors in dict.fromkeys(together.values()):
        yield _fact("condition.new_together", *(i for i, own in together.items() if own == factors), factors=factors)
    for name in domain.factors:
        if without := [i for i, condition in items if not dict(condition.factors).get(name)]:
            yield _fact("condition.no_factor", *without, factor=name)
