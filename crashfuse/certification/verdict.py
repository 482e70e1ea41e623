"""The verdict on one criterion at one condition, with its reason."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from crashfuse.approaches.metric_calibration import Distribution
from crashfuse.certification.criteria import RATING, Criteria, CriteriaGiven, Criterion, criteria_given
from crashfuse.certification.domain import REST_ON_PEAK
from crashfuse.certification.forecasts import Forecast
from crashfuse.condition import Condition
from crashfuse.errors import require_a
from crashfuse.signals.metrics import in_sentence
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.units import Sentence, joined, probability_text

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
    chances: tuple[float, ...] = field(default=(), repr=False)  # the probability by each of several seeds
    # which draws of the prediction meet it, by seed; empty where it has none, and of a rating
    drawn: npt.NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=bool), compare=False, repr=False)
    folds: tuple[float, float] | None = None  # the probability if a test folds as most do, and as one that stands apart
    probability_interval: tuple[float, float] | None = None  # central 95 % of the probability, left-out tests being few

    def __repr__(self) -> str:
        return f"<Verdict {self.word}: {self.criterion.name} {self.criterion.limits} at {self.condition}>"

    @property
    def expected(self) -> Sentence:
        """What is expected, and the limit, in words."""
        return self.criterion.compared(self.value, self.lower, self.upper)

    @property
    def error(self) -> float:
        """:func:`monte_carlo_error` of the probability."""
        return monte_carlo_error(self.chances)

    @property
    def decided(self) -> bool:
        """Whether no test is needed to tell."""
        return self.word in ("met", "not met")


class AllMet(NamedTuple):
    """Probability that a test meets several criteria at once, and the ends that those of the single ones leave it."""

    at_least: float  # Boole's inequality
    probability: float
    at_most: float
    error: float = 0.0  # of the probability, by :func:`monte_carlo_error`


_PRIOR_SEEDS, _SPREAD = 4, 0.5  # seeds that scatter by this times p (1 - p), as fused does on finite elements
COUNTED = 2.0  # standard errors, against a verdict


def monte_carlo_error(chances: Sequence[float]) -> float:
    """Standard error of the mean of probabilities by several seeds; 0 of one alone, which no seed changes.

    How these scatter is shrunk as if four more seeds had come out as usual.
    """
    n = len(chances)
    if n < 2:
        return 0.0
    mean = float(np.mean(chances))
    usual = _SPREAD * mean * (1 - mean)
    squares = _PRIOR_SEEDS * usual**2 + float(np.square(np.subtract(chances, mean)).sum())
    return float(np.sqrt(squares / (_PRIOR_SEEDS + n - 1) / n))


_PRIOR_DRAWS = 20  # that meet the criteria independently of each other: few draws say little of how these hang together


def all_met(verdicts: Sequence[Verdict]) -> AllMet:
    """Probability that a test meets all these criteria at once: the share of draws that do.

    Each draw has the calibrated value of its rank in each metric. A criterion without draws is taken to be missed by
    tests that meet all others.
    """
    chances = np.array([verdict.probability or 0.0 for verdict in verdicts])
    least, most = max(1 - float((1 - chances).sum()), 0.0), float(chances.min())
    has_draws = np.array([verdict.drawn.size > 0 for verdict in verdicts])
    own = (v.chances if len(v.chances) > 1 else v.probability or 0.0 for v in verdicts)
    by_seed = np.array(np.broadcast_arrays(*own))
    probability = 1 - (1 - by_seed[~has_draws]).sum(axis=0)
    if has_draws.any():
        met = np.all([verdict.drawn for verdict in verdicts if verdict.drawn.size], axis=0)
        independent, n = by_seed[has_draws].prod(axis=0), met.shape[-1]
        probability = probability - 1 + (met.sum(axis=-1) + _PRIOR_DRAWS * independent) / (n + _PRIOR_DRAWS)
    error = monte_carlo_error(np.atleast_1d(probability).tolist())
    return AllMet(least, min(max(float(np.mean(probability)), least), most), most, error)


def reaches(probability: float, confidence: float) -> bool:
    """Whether a probability is a confidence or more, whatever the last digits of sums are."""
    return probability >= confidence - 1e-12


def needs_no_test(verdicts: Sequence[Verdict], confidence: float) -> bool:
    """Whether every criterion is met at a condition, and all of them at once (:func:`all_met`) with the confidence."""
    if any(verdict.word != "met" for verdict in verdicts):
        return False
    at_once = all_met(verdicts)
    return reaches(at_once.probability - COUNTED * at_once.error, confidence)


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
        chances, folds = forecast.chances(criterion), forecast.by_fold(criterion)
        probability = float(np.mean(chances)) if chances else None
        error = monte_carlo_error(chances)
        why = outside or (unshown if criterion.metric in REST_ON_PEAK else ())
        word: Word = "outside" if why else _word(probability, criteria.confidence, COUNTED * error)
        run, drawn = dict.fromkeys(tests), forecast.drawn(criterion)
        numbers = *forecast.numbers(criterion), probability
        verdict = Verdict(condition, criterion, *numbers, word, joined(why), run, chances, drawn, folds)
        verdicts.append(verdict if why else replace(verdict, reason=_reason(verdict, criteria.confidence)))
    return tuple(verdicts)


def with_probability_interval(verdict: Verdict, forecast: Forecast) -> Verdict:
    """The verdict with what left-out tests, being few, and seeds leave open of its probability."""
    p, interval = verdict.probability, forecast.probability_interval(verdict.criterion)
    if p is None or interval is None:
        return verdict
    away = np.maximum([p - interval[0], interval[1] - p], 0.0)
    below, above = np.hypot(away, COUNTED * verdict.error).tolist()
    return replace(verdict, probability_interval=(max(p - below, 0.0), min(p + above, 1.0)))


def beside_tests(verdict: Verdict, run: Mapping[str, float | None], off: Mapping[str, Condition] = {}) -> Verdict:
    """The verdict beside what tests there (or a little ``off``) measured; open if one contradicts it."""
    criterion, contradicted, told = verdict.criterion, False, []
    did = "it measured" if criterion.window_ms is None else "the prediction made without it rated"
    for test, value in run.items():
        if value is not None:
            met = criterion.is_met_by(value)
            where = Sentence("for it, at {}", off[test]) if test in off else "there"
            does = "meets" if met else "misses"
            shown = criterion.shown(value)
            told.append(Sentence("Test {} was run {}: {} {}, which {} the limit.", test, where, did, shown, does))
            contradicted |= met is not (verdict.word == "met")
    return replace(with_reason(verdict, *told, contradicted=contradicted), run=run)


def with_reason(verdict: Verdict, *sentences: str, contradicted: bool = False) -> Verdict:
    """The verdict with more sentences in its reason; open if these contradict it."""
    word = "open" if verdict.decided and contradicted else verdict.word
    return replace(verdict, word=word, reason=joined([verdict.reason, *sentences]))


def _word(probability: float | None, confidence: float, error: float = 0.0) -> Word:
    if probability is None or 1 - confidence - error < probability < confidence + error:
        return "open"
    return "met" if probability >= confidence else "not met"


def _reason(verdict: Verdict, confidence: float) -> str:
    if verdict.probability is None:
        short = "The records end" if verdict.value is None else "More than one predicted pulse in ten ends"
        return f"{short} too early to tell the {in_sentence(verdict.criterion.label)} here; only longer records can."
    chances = verdict.probability, 1 - verdict.probability
    met, missed = (probability_text(p, confidence).replace(">", "over ") for p in chances)
    came = {"met": f"is met with probability {met}.", "not met": f"is missed with probability {missed}."}
    told = came.get(verdict.word, f"is met{' by another test' * bool(verdict.run)} with probability {met} only.")
    if verdict.word == "open" and _word(verdict.probability, confidence) != "open":
        error, n = COUNTED * verdict.error, len(verdict.chances)
        told = f"is met with probability {met}, known to ± {error:.3f} from {n} seeds."
    return joined([verdict.expected, told])


def with_decided(curve: LearningCurve, criteria: CriteriaGiven) -> LearningCurve:
    """The curve with a column ``decided``: the share of criteria on metrics that each prediction decides, or NaN."""
    require_a(LearningCurve, curve, "crashfuse.learning_curve(campaign)")
    criteria = criteria_given(criteria)
    limits = [criterion for criterion in criteria.items if criterion.metric != RATING]

    def share(forecast: dict[str, Distribution | None]) -> float:
        known = [(own, limit) for limit in limits if (own := forecast[limit.metric]) is not None]
        chances = [own.probability(limit.at_least, limit.at_most) for own, limit in known]
        decided = [_word(p, criteria.confidence) != "open" for p in chances]
        return sum(decided) / len(limits) if limits else float("nan")

    return replace(curve, table=curve.table.assign(decided=[share(own) for own in curve.forecasts]))
