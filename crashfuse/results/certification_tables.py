"""Every table of a certification: those of its files, and those that pages and reports show."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd

from crashfuse.approaches.registry import BASELINE
from crashfuse.cae.model import cae_pulses
from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Answer, Certification, Variant
from crashfuse.certification.criteria import RATING, Criterion
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord, Trial, WrongShare
from crashfuse.certification.verdict import WORDS, Verdict, all_met
from crashfuse.condition import Condition
from crashfuse.execution.cache import remembered
from crashfuse.execution.run import Run
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.certification_facts import new_together, unused_at
from crashfuse.results.figures import LEFT_OUT, WITH_GROUP
from crashfuse.results.table import CONDITION, Column, Table, frame_of, of_condition
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import WEIGHTS, rate_iso18571
from crashfuse.study.outliers import departures_near
from crashfuse.units import MASS, SPEED, Sentence, UnitSystem, joined, probability_text, read_out, unbroken

_NUMBERS = ("window_ms", "at_least", "at_most", "value", "lower", "upper", "probability", "measured")
_TRIAL_COLUMNS = (
    *("held_out", "left_out", "criterion", "probability", "verdict", "measured", "met"),
    *("value", "lower", "upper", "basis", "metric", "at_least", "at_most", "unit", "counted", "shift"),
    *("bounds.verdicts", "bounds.tests", "tuned"),
)
_OF_LIMITS = ("metric", "window_ms", "at_least", "at_most", "unit")
_JUDGED = ("met", "not met", "decided")


def certification_table(certification: Certification, units: UnitSystem | None = None) -> pd.DataFrame:
    """All verdicts, one row a condition and criterion, with the tests run there; reasons in these units."""
    system = certification.campaign.units if units is None else units
    columns, basis = condition_columns(certification.matrix), _bases(certification.campaign)
    answers, at_once = certification.answers, {i: all_met(row) for i, row in certification.rows.items()}
    though_met = {i: Sentence("{}.", at_once_text(certification, i)) for i in certification.uncertain}
    return _numbers_of(
        {
            **columns[i],
            "criterion": verdict.criterion.name,
            **{name: getattr(verdict.criterion, name) for name in _OF_LIMITS},
            **{name: getattr(verdict, name) for name in ("value", "lower", "upper", "probability")},
            "verdict": verdict.word,
            "reason": joined([verdict.reason, *([though_met[i]] if i in though_met else [])]).in_units(system),
            "basis": basis[verdict.criterion.metric],
            "need_not_be_run": answers[i] == "skip",
            "all_met_at_least": at_once[i].at_least,
            "answer": answers[i],
            "all_met": at_once[i].probability,
            "spot_check": certification.spot_checks.get(i, float("nan")),
            **{"probability_lower": least, "probability_upper": most},
            **({"test": " ".join(verdict.run)} if certification.run else {}),
        }
        for i, verdict in certification.cells
        for least, most in [verdict.probability_interval or (float("nan"), float("nan"))]
    )


def track_record_table(certification: Certification) -> pd.DataFrame:
    """Verdicts on tests left out or not yet run, one row a test, way and criterion."""
    basis, record = _bases(certification.campaign), certification.record
    bounds = [share.at_most for share in record.bounds().values()]
    tuned = {test.id: test.cae_tuned for test in certification.campaign.tests}  # None where nobody says
    rows = [
        (
            t.held_out, t.left_out, v.criterion.name, v.probability, v.word, t.measured, t.met, v.value, v.lower,
            v.upper, basis[v.criterion.metric], v.criterion.metric, v.criterion.at_least, v.criterion.at_most,
            v.criterion.unit, is_counted and not record.repeats(t), t.shift, *bounds, tuned.get(t.held_out),
        )
        for is_counted, trials in ((True, (*record.trials, *record.since)), (False, record.tuned))
        for t in trials
        for v in [t.verdict]
    ]  # fmt: skip
    return _numbers_of(rows, _TRIAL_COLUMNS)


def matrix_table(matrix: Matrix) -> pd.DataFrame:
    """The conditions, in the form of ``matrix.csv``."""
    return pd.DataFrame([*condition_columns(matrix).values()])


def condition_columns(matrix: Matrix) -> dict[str, dict[str, object]]:
    """By id each condition in the columns of ``matrix.csv``, in the units of the first."""
    factors = dict.fromkeys(name for condition in matrix.conditions for name, _ in condition.factors)
    return {
        i: {"id": i, **replace(own, units=matrix.conditions[0].units).columns}
        | {name: dict(own.factors).get(name, "") for name in factors}
        for i, own in matrix.items
    }


_AS_GIVEN = {f"speed_{unit}" for unit in SPEED} | {f"{end}_weight_{unit}" for end in ("front", "rear") for unit in MASS}


def csv_as_given(table: pd.DataFrame) -> bytes:
    """A table with :func:`condition_columns` as CSV, with all digits that were given."""
    given = _AS_GIVEN.intersection(table)
    return csv_bytes(table.assign(**{name: table[name].map("{:.12g}".format) for name in given}))


def _numbers_of(rows: Iterable[object], columns: Sequence[str] | None = None) -> pd.DataFrame:
    table = pd.DataFrame(list(rows), columns=columns)
    return table.astype({name: float for name in table if name in _NUMBERS})


def _bases(campaign: Campaign) -> dict[str, str]:
    return {**campaign.metric_bases, RATING: campaign.rating_basis}


def record_counts(record: TrackRecord, criterion: Criterion | None = None) -> dict[str, dict[str, float | None]]:
    """Left-out verdicts of each kind, wrong ones and their 95 % bound; *decided* is both."""
    counts = {word: WrongShare(wrong, n) for word, (n, wrong) in record.counts(criterion).items()}
    counts["decided"] = record.bounds(criterion)["verdicts"]
    return {word: share_columns(share) if word in _JUDGED else {"n": share.n} for word, share in counts.items()}


def share_columns(share: WrongShare) -> dict[str, float | None]:
    """A share of wrong ones with its bound, as in JSON."""
    return {"n": share.n, "wrong": share.wrong, "wrong_at_most": share.at_most}


def counts_frame(certification: Certification) -> pd.DataFrame:
    """Number of verdicts of each kind by criterion, with its limits."""
    columns = [[verdict.word for verdict in column] for column in zip(*certification.verdicts, strict=True)]
    return frame_of(
        {"criterion": criterion.name, "limit": criterion.limits, **{word: words.count(word) for word in WORDS}}
        for criterion, words in zip(certification.criteria.items, columns, strict=True)
    )


def changed_text(variant: Variant) -> str:
    """Which answers a variant changes, in words; empty if none."""
    return "; ".join(f"{i}: {then} → {now}" for i, (then, now) in variant.changed.items())


def turned_texts(usual: Certification, other: Certification) -> list[Sentence]:
    """Which answers another certification changes, each with its reason."""
    texts, confidence = [], other.criteria.confidence
    for i, (then, now) in Variant.of("", usual, other).changed.items():
        before, after = usual.rows[i], other.rows[i]
        place = min(range(len(after)), key=lambda place: after[place].probability or 0.0)
        name, chances = after[place].criterion.title, [row[place].probability for row in (before, after)]
        if all(verdict.word == "met" for verdict in (*before, *after)):
            name, chances = "all at once", [all_met(row).probability for row in (before, after)]
        was, is_now = (probability_text(chance, confidence) for chance in chances)
        than = f"was {was}" if was != is_now else f"{confidence:g} asked for"
        why = after[place].reason if after[place].word == "outside" else f"{name}: {is_now}, {than}"
        texts.append(Sentence("{}: {} → {} ({})", i, then, now, why))
    return texts


def at_once_text(certification: Certification, condition: str) -> str:
    """The probability that a test meets all criteria, and whether skipping pays."""
    only, but = ("", ", but skipping does not pay") if condition in certification.sure else ("only ", "")
    but *= condition in certification.uncertain
    probability = all_met(certification.rows[condition]).probability
    return f"meets all: {only}{probability_text(probability, certification.criteria.confidence)}{but}"


def _cells(verdict: Verdict) -> dict[str, object]:
    criterion = verdict.criterion
    return {
        "Criterion": criterion.name,
        "Limit": criterion.limits,
        "Expected": criterion.shown(verdict.value),
        "95 % of tests": criterion.interval(verdict.lower, verdict.upper),
        "Probability": verdict.probability,
        "Probability, 95 %": "{:.2f}–{:.2f}".format(*verdict.probability_interval or (0.0, 1.0)),
        "Verdict": verdict.word,
        "Reason": verdict.reason,
    }


def _probability(certification: Certification) -> Column:
    return Column("Probability", "probability", confidence=certification.criteria.confidence)


def _verdicts(certification: Certification) -> Table:
    rows = ({"Condition": i, **_cells(verdict)} for i, verdict in certification.cells)
    return Table.of("verdicts", rows, _probability(certification))


def _trials(name: str, certification: Certification, trials: Sequence[Trial]) -> Table:
    rows = (
        {
            "Test": trial.held_out,
            "Left out": {"test": "alone", "planned": "before it was run"}.get(trial.left_out, trial.left_out),
            **_cells(trial.verdict),
            "Measured": trial.measured_text,
            "The test": ("met it" if trial.met else "missed it") + ", wrong" * trial.wrong,
        }
        for trial in trials
    )
    return Table.of(name, rows, _probability(certification)).without("Limit", "Probability, 95 %", "Reason")


def _record(certification: Certification) -> Table:
    record, confidence = certification.record, certification.criteria.confidence
    bounds = {unit: unbroken(f"Wrong at most (95 %), by {unit[:-1]}") for unit in record.bounds()}
    of_all = {"Near a limit": record.near_limit, "All": record}
    if (with_runs := certification.record_with_runs) is not None:
        of_all["All, with CAE runs"] = with_runs
    near, *others = ((name, own, None) for name, own in of_all.items())
    rows = (
        {
            "Criterion": name,
            "Limit": "" if criterion is None else criterion.limits,
            **{
                word.capitalize(): Sentence("{}, {} wrong", n, wrong) if wrong else n
                for word, (n, wrong) in own.counts(criterion).items()
            },
            **{bounds[unit]: share.at_most for unit, share in own.bounds(criterion).items()},
            "What this record supports": "" if criterion is None else record.support(criterion).text(confidence),
        }
        for name, own, criterion in (near, *((c.name, record, c) for c in certification.criteria.items), *others)
    )
    return Table.of("counts", rows, *(Column(title, "share") for title in bounds.values()))


@remembered
def left_out_pulses(certification: Certification) -> dict[str, dict[str, FloatArray]]:
    """By left-out test the CAE pulse and, by what was left out, those predicted, each (n_seeds, n_samples)."""
    campaign, predicted = certification.campaign, certification.record.predicted_mps2
    tests = list(dict.fromkeys(test for test, _ in predicted))
    of_cae = cae_pulses(campaign.cae, [campaign.test(test).condition for test in tests], Run.of(campaign))
    found = {test: {BASELINE: accel_mps2[np.newaxis]} for test, accel_mps2 in zip(tests, of_cae, strict=True)}
    for (test, way), accel_mps2 in predicted.items():
        if way == "test" or not np.array_equal(accel_mps2, predicted.get((test, "test"), ())):
            found[test][way] = accel_mps2
    return found


PULSE_OF = {BASELINE: "CAE", "test": LEFT_OUT["test"], "speed group": WITH_GROUP}


@remembered
def left_out_ratings(certification: Certification) -> Table:
    """Ratings of these pulses with their parts, means over the seeds."""
    campaign, window = certification.campaign, certification.config.windows_ms[-1]
    rows = [
        {
            "Test": test,
            "speed_mph": of_condition(campaign.test(test).condition)["speed_mph"],
            "Pulse": PULSE_OF[name],
            **{part: np.mean([getattr(rating, part) for rating in ratings]) for part in ("overall", *WEIGHTS)},
        }
        for test, pulses in left_out_pulses(certification).items()
        for name, accel_mps2 in pulses.items()
        for ratings in [[rate_iso18571(campaign.test(test).pulse, Pulse(GRID_S, own), window) for own in accel_mps2]]
    ]
    parts = (Column(part.capitalize(), "number", form=".3f", source=part) for part in WEIGHTS)
    overall = Column(f"Rating, 0–{window:g} ms", "grade", source="overall")
    return Table.of("ratings of left-out tests", rows, CONDITION[0], overall, *parts)


def _criteria(certification: Certification) -> Table:
    rows = (
        {"Criterion": own.name, "Quantity": own.label, "Limit": own.limits, "As declared": str(own.limits)}
        for own in certification.criteria.items
    )
    return Table.of("criteria", rows)


def _counts(certification: Certification) -> Table:
    counts = counts_frame(certification).rename(columns=str.capitalize)
    return Table.of("counts", counts, *(Column(word.capitalize(), "number", form=".0f") for word in WORDS))


def makers_of_tables(certification: Certification) -> dict[str, Callable[[], Table]]:
    """What makes each table for readers, by name."""
    makers = {"planned": _planned, "counts": _counts, "criteria": _criteria, "verdicts": _verdicts, "record": _record}
    since = certification.since
    trials = {"trials": certification.record.counted} | ({} if since is None else {"since": since.trials})
    return {
        **{name: partial(make, certification) for name, make in makers.items()},
        "left_out": partial(left_out_ratings, certification),
        **{name: partial(_trials, name, certification, rows) for name, rows in trials.items()},
    }


class Planned(NamedTuple):
    """A planned test: the answer, what decides it, the same in a few words, and what else matters."""

    id: str
    condition: Condition
    word: Answer
    why: Sentence
    brief: Sentence
    further: tuple[str, ...] = ()


@remembered
def planned(certification: Certification) -> tuple[Planned, ...]:
    """The answer at every planned test, in the order of speed."""
    domain, unused, together = certification.domain, unused_at(certification), new_together(certification)
    rows = []
    for i, condition in sorted(certification.matrix.items, key=lambda item: item[1].speed_mps):
        given = {name for name, value in condition.factors if value}
        further = [f"{name} not given" for name in domain.factors if name not in given]
        if i in together:
            further.append(f"{together[i]} in no test together")
        if apart := [departure.test for departure in departures_near(certification.campaign, condition)]:
            further.append(f"{read_out(apart)} stands apart there")
        if i in unused:
            further.append(f"run as {read_out(unused[i])}, not used")
        if i in certification.counted_once:
            further.append(f"counts as {certification.counted_once[i]}")
        why, brief = _why(certification, i), _why(certification, i, most=1)
        rows.append(Planned(i, condition, certification.answers[i], why, brief, tuple(further)))
    return tuple(rows)


def _planned(certification: Certification) -> Table:
    rows = (
        {
            **{"Planned test": own.id, **of_condition(own.condition), "Answer": own.word},
            **{"spot_check": certification.spot_checks.get(own.id), "Why": joined([own.why, *own.further], "; ")},
        }
        for own in planned(certification)
    )
    rated = Column(f"Rates {certification.criteria.spot_check.at_least:.2f}", "probability", source="spot_check")
    return Table.of("planned tests", rows, *CONDITION, rated)


def _why(certification: Certification, i: str, most: int = 100) -> Sentence:
    answer, row = certification.answers[i], certification.rows[i]
    if answer == "was run":
        return _tests_there(certification, row, most)
    if answer == "skip" or i in certification.uncertain:
        loses = answer == "run" and i in certification.sure
        return Sentence("skipping does not pay" if loses and most == 1 else at_once_text(certification, i))
    if answer == "cannot say" and any(verdict.word == "outside" for verdict in row):
        return Sentence("not covered by tests")
    template = {"would miss": "misses {}", "run": "open: {}", "cannot say": "records end early: {}"}[answer]
    word, unknown = "not met" if answer == "would miss" else "open", answer == "cannot say"
    names = [v.criterion.title for v in row if v.word == word and (v.probability is None) is unknown]
    return Sentence(template, _listed(names, row, most))


def _listed(names: Sequence[str], row: Sequence[Verdict], most: int) -> str:
    return ", ".join(names) if len(names) <= most else f"{len(names)} of {len(row)}"


def _tests_there(certification: Certification, row: Sequence[Verdict], most: int) -> Sentence:
    tests, missing = [], 0
    for test_id in row[0].run:
        known = [(own.criterion, value) for own in row if (value := own.run[test_id]) is not None]
        missed = _listed([limit.title for limit, value in known if not limit.is_met_by(value)], row, most)
        missing += bool(missed)
        shown = f"missed {missed}" if missed else "met all" if len(known) == len(row) else "missed none"
        faults = joined([fault.text for fault in certification.campaign.test(test_id).faults], "; ")
        doubt = Sentence(", in doubt as {}", faults) if faults and most > 1 else ", in doubt" * bool(faults)
        tests.append(Sentence("{} {}{}", test_id, shown, doubt))
    if len(tests) > most:
        return Sentence("{} of {} tests missed a limit", missing or "none", len(tests))
    return joined(tests, "; ")
