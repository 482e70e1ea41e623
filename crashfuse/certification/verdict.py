"""The verdict on one criterion at one condition, with its reason."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from crashfuse.approaches.metric_calibration import Distribution
from crashfuse.certification.criteria import RATING, Criteria, Criterion
from crashfuse.certification.domain import REST_ON_PEAK
from crashfuse.certification.forecasts import Forecast, quantity
from crashfuse.condition import Condition
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.wording import Sentence, joined, probability_text

Word = Literal["met", "not met", "open", "outside"]
WORDS: tuple[Word, ...] = get_args(Word)
"""A test there would meet the criterion, or not, with the confidence asked for; neither, so only a test
or another design can tell; the condition is beyond what the campaign's tests check."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on a criterion at a condition."""

    condition: Condition
    criterion: Criterion
    value: float | None  # of the predicted pulse, or the expected rating, in the criterion's unit
    lower: float | None  # central 95 % interval for a single test there
    upper: float | None
    probability: float | None  # that a test there meets the criterion; None if the record is too short to tell
    word: Word
    reason: str
    # what tests there measured, by id: the metric, or the rating of the prediction made without the test
    run: Mapping[str, float | None] = field(default_factory=dict)
    # which draws of the prediction meet it; empty where it has none, and of a rating
    drawn: npt.NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=bool), compare=False, repr=False)
    folds: tuple[float, float] | None = None  # the probability if a test folds as most do, and as one that stands apart

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


class EarlierVerdict(NamedTuple):
    """What an earlier certification said of one criterion at one condition; as in :class:`Verdict`."""

    word: Word
    probability: float | None
    lower: float | None
    upper: float | None


class AllMet(NamedTuple):
    """Probability that a test meets several criteria at once, and the ends that those of the single ones leave it."""

    at_least: float  # Boole's inequality
    probability: float
    at_most: float


_PRIOR_DRAWS = 20  # that meet the criteria independently of each other: few draws say little of how these hang together


def all_met(verdicts: Sequence[Verdict]) -> AllMet:
    """Probability that a test meets all these criteria at once: the share of draws that do.

    Each draw has the calibrated value of its rank in each metric. A criterion without draws is taken to be missed by
    tests that meet all others.
    """
    chances = np.array([verdict.probability or 0.0 for verdict in verdicts])
    least, most = max(1 - float((1 - chances).sum()), 0.0), float(chances.min())
    has_draws = np.array([verdict.drawn.size > 0 for verdict in verdicts])
    probability = 1 - float((1 - chances[~has_draws]).sum())
    if has_draws.any():
        met = np.all([verdict.drawn for verdict in verdicts if verdict.drawn.size], axis=0)
        independent = chances[has_draws].prod()
        probability -= 1 - float(met.sum() + _PRIOR_DRAWS * independent) / (met.size + _PRIOR_DRAWS)
    return AllMet(least, min(max(probability, least), most), most)


def reaches(probability: float, confidence: float) -> bool:
    """Whether a probability is a confidence or more, whatever the last digits of sums are."""
    return probability >= confidence - 1e-12


def needs_no_test(verdicts: Sequence[Verdict], confidence: float) -> bool:
    """Whether every criterion is met at a condition, and all of them at once (:func:`all_met`) with the confidence."""
    return all(verdict.word == "met" for verdict in verdicts) and reaches(all_met(verdicts).probability, confidence)


def judge(
    forecast: Forecast,
    condition: Condition,
    criteria: Criteria,
    outside: tuple[str, ...] = (),
    tests: Sequence[str] = (),
    unshown: tuple[str, ...] = (),
) -> tuple[Verdict, ...]:
    """Verdicts on all criteria at a condition by its forecast; ``outside`` says why it is beyond what was checked.

    ``unshown`` says the same of what rests on the peak, see :data:`crashfuse.certification.domain.REST_ON_PEAK`. Where
    ``tests`` were run an open verdict is on another one; what they measured is None.
    """
    verdicts = []
    for criterion in criteria.items:
        value = forecast.values[quantity(criterion)]
        distribution = forecast.distributions[quantity(criterion)]
        lower, upper, probability = None, None, None
        if distribution is not None:
            lower, upper = distribution.interval
            probability = distribution.probability(criterion.at_least, criterion.at_most)
        if folds := forecast.by_fold(criterion):
            probability = float(np.average(folds, weights=(1 - forecast.apart_share, forecast.apart_share)))
        why = outside or (unshown if criterion.metric in REST_ON_PEAK else ())
        word: Word = "outside" if why else _word(probability, criteria.confidence)
        run, drawn = dict.fromkeys(tests), forecast.drawn(criterion)
        numbers = value, lower, upper, probability
        verdict = Verdict(condition, criterion, *numbers, word, joined(why), run, drawn, folds)
        verdicts.append(verdict if why else replace(verdict, reason=_reason(verdict, criteria.confidence)))
    return tuple(verdicts)


def _word(probability: float | None, confidence: float) -> Word:
    if probability is None or 1 - confidence < probability < confidence:
        return "open"
    return "met" if probability >= confidence else "not met"


def _reason(verdict: Verdict, confidence: float) -> str:
    if verdict.probability is None:
        short = "The record" if verdict.value is None else "More than one draw in ten"
        return f"{short} is too short for the {verdict.criterion.label} here; only a longer record can tell."
    chances = verdict.probability, 1 - verdict.probability
    met, missed = (probability_text(p, confidence).replace(">", "over ") for p in chances)
    came = {"met": f"met with probability {met}.", "not met": f"missed with probability {missed}."}
    told = came.get(verdict.word, f"met{' by another test' * bool(verdict.run)} with probability {met} only.")
    return joined([verdict.expected, told], ", ")


def with_decided(curve: LearningCurve, criteria: Criteria) -> LearningCurve:
    """Add the column ``decided``: the share of criteria on metrics that each prediction decides; NaN without any."""
    limits = [criterion for criterion in criteria.items if criterion.metric != RATING]

    def share(forecast: dict[str, Distribution | None]) -> float:
        known = [(own, limit) for limit in limits if (own := forecast[limit.metric]) is not None]
        chances = [own.probability(limit.at_least, limit.at_most) for own, limit in known]
        decided = [_word(p, criteria.confidence) != "open" for p in chances]
        return sum(decided) / len(limits) if limits else float("nan")

    return replace(curve, table=curve.table.assign(decided=[share(own) for own in curve.forecasts]))
