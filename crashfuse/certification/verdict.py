"""The verdict on one criterion at one condition, with its reason."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, Self, get_args

import numpy as np

from crashfuse.approaches.metric_calibration import Distribution
from crashfuse.certification.criteria import RATING, Criteria, Criterion
from crashfuse.certification.forecasts import Forecast, quantity
from crashfuse.condition import Condition
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.wording import Sentence, joined, probability_text


@dataclass(frozen=True, eq=False)
class RemovedTest:
    """Such a test.

    Attributes
    ----------
    test, digest : str
        Its id then, and :attr:`crashfuse.crash_test.CrashTest.digest`.
    condition : Condition
        That of the matrix, at which it was run.
    measured : mapping of str to float or None
        By :func:`quantity`, in the units of criteria; None if its record is too short. A rating is that of the
        prediction of then.
    """

    test: str
    digest: str
    condition: Condition
    measured: Mapping[str, float | None]

    def without(self, metrics: Set[str]) -> Self:
        """The same but for what it showed of these metrics."""
        return replace(self, measured={name: value for name, value in self.measured.items() if name not in metrics})

    def missed(self, criteria: Sequence[Criterion]) -> tuple[str, ...]:
        """The criteria that it missed."""
        each = ((own, self.measured.get(quantity(own))) for own in criteria)
        return tuple(own.name for own, value in each if value is not None and not own.is_met_by(value))

    def not_asked(self, criteria: Sequence[Criterion]) -> tuple[str, ...]:
        """The criteria on what no certification had asked of it."""
        return tuple(own.name for own in criteria if quantity(own) not in self.measured)

    def cannot_tell(self, criteria: Sequence[Criterion]) -> tuple[str, ...]:
        """The criteria for which its record is too short."""
        return tuple(own.name for own in criteria if self.measured.get(quantity(own), 0.0) is None)


_Found = tuple[float | None, float | None, float | None]  # value, lower and upper end
Word = Literal["met", "not met", "open", "outside"]
WORDS: tuple[Word, ...] = get_args(Word)
"""A test there would meet the criterion, or not, with the confidence asked for; neither, so only a test
or another design can tell; the condition is beyond what the campaign's tests check."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on a criterion at a condition.

    Attributes
    ----------
    value : float or None
        Of the predicted pulse, or the expected rating, in the criterion's unit.
    lower, upper : float or None
        Central 95 % interval for a single test there.
    probability : float or None
        That a test there meets the criterion; None if the record is too short to tell.
    reason : str
        In a sentence or two.
    run : mapping of str to float or None
        What each test that was run at this condition measured, by its id: its metric, or the rating of the prediction
        that was made without it; None if its record is too short.
    """

    condition: Condition
    criterion: Criterion
    value: float | None
    lower: float | None
    upper: float | None
    probability: float | None
    word: Word
    reason: str
    run: Mapping[str, float | None] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Verdict {self.word}: {self.criterion.name} {self.criterion.limits} at {self.condition}>"

    @property
    def expected(self) -> Sentence:
        """What is expected, and the limit, in words."""
        return self.criterion.compared(self.value, self.lower, self.upper)

    @property
    def decided(self) -> bool:
        """Whether no test is needed to tell."""
        return self.word in ("met", "not met")


class Judged(Protocol):
    """What a verdict says of a criterion."""

    @property
    def word(self) -> str:
        """One of :data:`WORDS`."""

    @property
    def probability(self) -> float | None:
        """That a test would meet it; None if it is not known."""


def all_met(verdicts: Sequence[Judged]) -> tuple[float, float]:
    """Least and greatest probability that a test meets all these criteria at once, by that of each.

    It is 1 minus the sum of the risks where never two are missed together (Boole's inequality), and that of the least
    probable one where it is missed with any other.
    """
    each = [verdict.probability or 0.0 for verdict in verdicts]
    return max(1 - sum(1 - own for own in each), 0.0), min(each)


def reaches(probability: float, confidence: float) -> bool:
    """Whether a probability is a confidence or more, whatever the last digits of sums are."""
    return probability >= confidence - 1e-12


def needs_no_test(verdicts: Sequence[Judged], confidence: float) -> bool:
    """Whether every criterion is met at a condition, and all of them at once (:func:`all_met`) with the confidence."""
    return all(verdict.word == "met" for verdict in verdicts) and reaches(all_met(verdicts)[0], confidence)


def beside_tests(verdict: Verdict, run: Mapping[str, float | None], off: Mapping[str, Condition] = {}) -> Verdict:
    """The verdict beside what tests at its condition measured; open if one of them contradicts it.

    ``off`` are the conditions of those that were not quite there.
    """
    criterion = verdict.criterion
    did = "and measured" if criterion.window_ms is None else "and, predicted without it, rated"
    met = {test: value is not None and criterion.is_met_by(value) for test, value in run.items()}
    told = [
        Sentence("Test {} was run {} {} {}, which {} it.", test, where, did, criterion.shown(value), does)
        for test, value in run.items()
        if value is not None
        for where in [Sentence("for it, at {},", off[test]) if test in off else "there"]
        for does in ["meets" if met[test] else "misses"]
    ]
    against = [test for test, value in run.items() if value is not None and met[test] is not (verdict.word == "met")]
    word: Word = "open" if verdict.decided and against else verdict.word
    return replace(verdict, word=word, reason=joined([verdict.reason, *told]), run=run)


def beside_removed_tests(verdict: Verdict, tests: Sequence[RemovedTest]) -> Verdict:
    """The verdict beside what tests that are not used any more had shown there; open if one of them contradicts it.

    A rating had been that of another prediction, and says nothing of this one.
    """
    of = quantity(verdict.criterion)
    shown = {own.test: value for own in tests if (value := own.measured.get(of)) is not None}
    if not shown or verdict.criterion.window_ms is not None:
        return verdict
    met = {test: verdict.criterion.is_met_by(value) for test, value in shown.items()}
    told = [
        Sentence(f"Test {{}}, whose record of then is not used any more, {did} it there with {{}}.", test, own)
        for test, value in shown.items()
        for did in ["met" if met[test] else "missed"]
        for own in [verdict.criterion.shown(value)]
    ]
    against = verdict.decided and any(own is not (verdict.word == "met") for own in met.values())
    return replace(verdict, word="open" if against else verdict.word, reason=joined([verdict.reason, *told]))


def judge(
    forecast: Forecast,
    condition: Condition,
    criteria: Criteria,
    outside: tuple[str, ...] = (),
    *,
    was_run: bool = False,
) -> tuple[Verdict, ...]:
    """Verdicts on all criteria at a condition by its forecast; ``outside`` says why it is beyond what was checked.

    Where a test ``was_run``, an open verdict is on another test, and does not advise to test.
    """
    confidence = criteria.confidence
    return tuple(_verdict(forecast, condition, own, confidence, outside, was_run) for own in criteria.items)


def _verdict(
    forecast: Forecast,
    condition: Condition,
    criterion: Criterion,
    confidence: float,
    outside: tuple[str, ...],
    was_run: bool,
) -> Verdict:
    value, own = forecast.values[quantity(criterion)], forecast.distributions[quantity(criterion)]
    lower, upper = (None, None) if own is None else own.interval(value)
    probability = None if own is None else own.probability(criterion.at_least, criterion.at_most)
    word, reason = _word(criterion, probability, confidence, (value, lower, upper), was_run)
    if outside:
        word, reason = "outside", joined(outside)
    return Verdict(condition, criterion, value, lower, upper, probability, word, reason)


def _word(
    criterion: Criterion,
    probability: float | None,
    confidence: float,
    found: _Found,
    was_run: bool,
) -> tuple[Word, str]:
    if probability is None:
        if found[0] is None:
            return "open", f"The record is too short to predict the {criterion.label} here; only a longer one can tell."
        short = f"In more than one of ten draws the record is too short for the {criterion.label}"
        return "open", f"{short}, so its interval is unknown here; only a longer one can tell."
    word: Word = "open"
    who, advice = (" by another test", "") if was_run else ("", ": test it, or redesign")
    met, missed = (probability_text(p, confidence).replace(">", "over ") for p in (probability, 1 - probability))
    came = f"met{who} with probability {met} only{advice}."
    if probability >= confidence:
        word, came = "met", f"met with probability {met}."
    elif probability <= 1 - confidence:
        word, came = "not met", f"missed with probability {missed}."
    return word, joined([criterion.compared(*found), came], ", ")


def with_decided(curve: LearningCurve, criteria: Criteria) -> LearningCurve:
    """Add the column ``decided``: the share of criteria on metrics that each prediction decides for its held-out test.

    A criterion is decided if its probability, or the complement, reaches the confidence; one that the record is too
    short for is not. What a rating would be is not part of a learning curve, so criteria on ratings do not count;
    without any other the column is NaN.
    """
    limits = [criterion for criterion in criteria.items if criterion.metric != RATING]

    def decides(own: Distribution | None, criterion: Criterion) -> bool:
        if own is None:
            return False
        probability = own.probability(criterion.at_least, criterion.at_most)
        return not 1 - criteria.confidence < probability < criteria.confidence

    def share(forecast: dict[str, Distribution | None]) -> float:
        decided = [decides(forecast[criterion.metric], criterion) for criterion in limits]
        return float(np.mean(decided)) if decided else float("nan")

    return replace(curve, table=curve.table.assign(decided=[share(own) for own in curve.forecasts]))
