"""Tables of a certification: ``certification.csv``, ``track_record.csv``, and the counts of ``certification.json``."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import pandas as pd

from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Certification, answers
from crashfuse.certification.criteria import RATING, Criterion
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord, largest_share
from crashfuse.certification.verdict import WORDS, Verdict, all_met
from crashfuse.condition import Condition
from crashfuse.files.csv_text import csv_bytes
from crashfuse.reporting.evidence_sentences import support_sentence
from crashfuse.reporting.plots.display import Display
from crashfuse.wording import MPH_LB, UnitSystem, probability_text, said, unbroken

ANSWER = "A test there"
"""Heading of :func:`answer_texts`."""
_NUMBERS = ("window_ms", "at_least", "at_most", "value", "lower", "upper", "probability")
_TRIAL_COLUMNS = (
    *("held_out", "left_out", "criterion", "probability", "verdict", "measured", "met"),
    *("value", "lower", "upper", "basis", "metric", "at_least", "at_most", "unit", "counted", "shift"),
)
_JUDGED = ("met", "not met", "decided")


def certification_table(certification: Certification) -> pd.DataFrame:
    """All verdicts, one row a condition and criterion; with the tests that were run there, if any was."""
    factors, basis, run = factors_of(certification.matrix), _bases(certification.campaign), certification.run
    given, all_at_once = answers(certification), {i: all_met(row)[0] for i, row in certification.rows.items()}
    return pd.DataFrame(
        {
            **condition_columns(cell, verdict.condition, factors, certification.matrix.conditions[0]),
            "criterion": verdict.criterion.name,
            "metric": verdict.criterion.metric,
            "window_ms": verdict.criterion.window_ms,
            "at_least": verdict.criterion.at_least,
            "at_most": verdict.criterion.at_most,
            "unit": verdict.criterion.unit,
            "value": verdict.value,
            "lower": verdict.lower,
            "upper": verdict.upper,
            "probability": verdict.probability,
            "verdict": verdict.word,
            "reason": verdict.reason,
            "basis": basis[verdict.criterion.metric],
            "need_not_be_run": given[cell] == "need not be run",
            "all_met_at_least": all_at_once[cell],
            "answer": given[cell],
            **({"test": " ".join(verdict.run)} if run else {}),
        }
        for cell, verdict in certification.cells
    ).astype(dict.fromkeys(_NUMBERS, float))  # also where all are unknown


def answer_texts(certification: Certification, name: Callable[[str], str] = str) -> dict[str, str]:
    """The answer at each condition in words: if run, by which tests; if counted as another condition, as which.

    ``name`` says how tests and conditions are called.
    """
    run, same = certification.run, certification.counted_once
    texts = {**answers(certification), **{i: f"run: {', '.join(map(name, tests))}" for i, tests in run.items()}}
    return {i: f"{text}, as {name(same[i])}" if i in same else text for i, text in texts.items()}


def _bases(campaign: Campaign) -> dict[str, str]:
    """What each metric, and the rating, rests on."""
    return {**campaign.metric_bases, RATING: campaign.rating_basis}


def matrix_table(matrix: Matrix) -> pd.DataFrame:
    """The conditions, in the form of ``matrix.csv``."""
    factors = factors_of(matrix)
    return pd.DataFrame(condition_columns(i, c, factors, matrix.conditions[0]) for i, c in matrix.items)


def factors_of(matrix: Matrix) -> tuple[str, ...]:
    """Names of the factors that conditions of a matrix have."""
    return tuple(dict.fromkeys(name for condition in matrix.conditions for name, _ in condition.factors))


def condition_columns(
    condition_id: str, condition: Condition, factors: Sequence[str], like: Condition
) -> dict[str, object]:
    """A condition in the columns of ``matrix.csv``, in the units that another one, the table's first, was given in."""
    return {
        "id": condition_id,
        **replace(condition, units=like.units).columns,
        **{name: dict(condition.factors).get(name, "") for name in factors},
    }


def csv_as_given(table: pd.DataFrame) -> bytes:
    """A table with :func:`condition_columns` as CSV: speeds and weights with all digits that were given."""
    given = [name for name in table if re.fullmatch(r"(speed|front_weight|rear_weight)_[a-z]+", str(name))]
    return csv_bytes(table.assign(**{name: table[name].map("{:.12g}".format) for name in given}))


def track_record_table(certification: Certification) -> pd.DataFrame:
    """All verdicts on left-out tests, and on tests before they were run, one row a test, way and criterion.

    ``counted`` is false where a speed group is the test alone, whose verdict counts once.
    """
    basis, record = _bases(certification.campaign), certification.record
    rows = [
        (
            t.held_out, t.left_out, v.criterion.name, v.probability, v.word, t.measured, t.met, v.value, v.lower,
            v.upper, basis[v.criterion.metric], v.criterion.metric, v.criterion.at_least, v.criterion.at_most,
            v.criterion.unit, not record.repeats(t), t.shift,
        )
        for t in (*record.trials, *record.since)
        for v in [t.verdict]
    ]  # fmt: skip
    table = pd.DataFrame(rows, columns=list(_TRIAL_COLUMNS))
    return table.astype(dict.fromkeys(("measured", *({*_NUMBERS} & {*_TRIAL_COLUMNS})), float))


def verdict_counts(certification: Certification) -> dict[str, int]:
    """Number of verdicts of each kind over the matrix."""
    words = [verdict.word for _, verdict in certification.cells]
    return {word: words.count(word) for word in WORDS}


def counts_table(certification: Certification, units: UnitSystem = MPH_LB) -> pd.DataFrame:
    """Number of verdicts of each kind by criterion, with its limits."""
    rows = [[row[column].word for row in certification.verdicts] for column in range(len(certification.criteria.items))]
    return pd.DataFrame(
        {
            "criterion": criterion.name,
            "limit": said(criterion.limits, units),
            **{word: words.count(word) for word in WORDS},
        }
        for criterion, words in zip(certification.criteria.items, rows, strict=True)
    )


def record_counts(record: TrackRecord, criterion: Criterion | None = None) -> dict[str, dict[str, object]]:
    """Left-out verdicts of each kind, wrong ones and the exact 95 % upper bound of their share; *decided* is both."""
    counts = record.counts(criterion)
    (met, wrongly_met), (missed, wrongly_missed) = counts["met"], counts["not met"]
    pairs: dict[str, tuple[int, int]] = {**counts, "decided": (met + missed, wrongly_met + wrongly_missed)}
    return {
        word: {"n": n, **({"wrong": wrong, "wrong_at_most": bound(wrong, n)} if word in _JUDGED else {})}
        for word, (n, wrong) in pairs.items()
    }


def bound(wrong: int, n: int) -> float | None:
    """Exact one-sided 95 % upper bound of the share of wrong verdicts; None without any."""
    return round(largest_share(wrong, n), 4) if n else None


def verdicts_shown(certification: Certification, display: Display) -> pd.DataFrame:
    """All verdicts for readers, one row a condition and criterion."""
    confidence = certification.criteria.confidence
    return pd.DataFrame(
        {
            "Condition": i,
            "Criterion": verdict.criterion.name,
            "Limit": display.words(verdict.criterion.limits),
            **_predicted(verdict, confidence, display),
            "Verdict": verdict.word,
            "Reason": display.words(verdict.reason),
        }
        for i, verdict in certification.cells
    )


def trials_shown(record: TrackRecord, confidence: float, display: Display) -> pd.DataFrame:
    """All verdicts on left-out tests beside what was measured, for readers; what counts once stands once."""
    return pd.DataFrame(
        {
            "Test": trial.held_out,
            "Left out": "alone" if trial.left_out == "test" else "speed group",
            "Criterion": trial.verdict.criterion.name,
            **_predicted(trial.verdict, confidence, display),
            "Verdict": trial.verdict.word,
            "Measured": unbroken(display.words(trial.verdict.criterion.shown(trial.measured))),
            "The test": ("met it" if trial.met else "missed it") + ", wrong" * trial.wrong,
        }
        for trial in record.counted
    )


def _predicted(verdict: Verdict, confidence: float, display: Display) -> dict[str, str]:
    """What is expected, its interval and the probability to meet the criterion, as cells."""
    return {
        "Expected": unbroken(display.words(verdict.criterion.shown(verdict.value))),
        "95 % of tests": unbroken(display.words(verdict.criterion.interval(verdict.lower, verdict.upper))),
        "Probability": probability_text(verdict.probability, confidence),
    }


def record_shown(certification: Certification, display: Display) -> pd.DataFrame:
    """How many verdicts on left-out tests were wrong, and what the record supports, one row a criterion; then all."""
    record, rows = certification.record, []
    for criterion in (*certification.criteria.items, None):
        counts = record_counts(record, criterion)
        most = counts["decided"]["wrong_at_most"]
        rows.append(
            {
                "Criterion": "All" if criterion is None else criterion.name,
                "Limit": "" if criterion is None else display.words(criterion.limits),
                **{word.capitalize(): _counted(counts[word]) for word in WORDS},
                unbroken("Wrong at most (95 %)"): "–" if most is None else f"{100 * float(str(most)):.1f} %",
                "What this record supports": ""
                if criterion is None
                else support_sentence(record, criterion, certification.criteria.confidence),
            }
        )
    return pd.DataFrame(rows)


def _counted(counts: dict[str, object]) -> str:
    wrong = counts.get("wrong")
    return f"{counts['n']}, {wrong} wrong" if wrong else f"{counts['n']}"
