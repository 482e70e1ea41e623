"""The verdict on one criterion at one condition, with its reason."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.forecast import Forecast, quantity
from crashfuse.condition import Condition
from crashfuse.wording import Sentence, joined

_Found = tuple[float | None, float | None, float | None]  # value, lower and upper end
Word = Literal["met", "not met", "open", "outside"]
WORDS: tuple[Word, ...] = get_args(Word)
"""A test there would meet the criterion, or not, with the confidence asked for; the interval straddles the limit, so
only a test or another design can tell; the condition is beyond what the campaign's tests check."""


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
    """

    condition: Condition
    criterion: Criterion
    value: float | None
    lower: float | None
    upper: float | None
    probability: float | None
    word: Word
    reason: str

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


def all_met(verdicts: Sequence[Verdict]) -> tuple[float, float]:
    """Least and greatest probability that a test meets all these criteria at once, by that of each.

    It is 1 minus the sum of the risks where never two are missed together (Boole's inequality), and that of the least
    probable one where it is missed with any other.
    """
    each = [verdict.probability or 0.0 for verdict in verdicts]
    return max(1 - sum(1 - own for own in each), 0.0), min(each)


def judge(
    forecast: Forecast, condition: Condition, criteria: Criteria, outside: tuple[str, ...] = ()
) -> tuple[Verdict, ...]:
    """Verdicts on all criteria at a condition by its forecast; ``outside`` says why it is beyond what was checked."""
    return tuple(_verdict(forecast, condition, criterion, criteria.confidence, outside) for criterion in criteria.items)


def _verdict(
    forecast: Forecast, condition: Condition, criterion: Criterion, confidence: float, outside: tuple[str, ...]
) -> Verdict:
    value, own = forecast.values[quantity(criterion)], forecast.distributions[quantity(criterion)]
    lower, upper = (None, None) if own is None else own.interval()
    probability = None if own is None else own.probability(criterion.at_least, criterion.at_most)
    word, reason = _word(criterion, probability, confidence, (value, lower, upper))
    if outside:
        word, reason = "outside", joined(outside)
    return Verdict(condition, criterion, value, lower, upper, probability, word, reason)


def _word(
    criterion: Criterion,
    probability: float | None,
    confidence: float,
    found: _Found,
) -> tuple[Word, str]:
    if probability is None:
        return "open", f"The record is too short to predict the {criterion.label} here; only a longer one can tell."
    word: Word = "open"
    came = f"met with probability {_share(probability)} only: test it, or redesign."
    if probability >= confidence:
        word, came = "met", f"met with probability {_share(probability)}."
    elif probability <= 1 - confidence:
        word, came = "not met", f"missed with probability {_share(1 - probability)}."
    return word, joined([criterion.compared(*found), came], ", ")


def _share(probability: float) -> str:
    return "over 0.999" if probability > 0.999 else f"{probability:.3f}"
