"""Acceptance criteria: limits of pulse metrics, or of the rating, and the confidence they have to be met with."""

from dataclasses import dataclass

from crashfuse.signals.metrics import METRIC_LABELS, METRIC_UNITS
from crashfuse.signals.rating import STANDARD
from crashfuse.wording import Quantity, Sentence, joined

RATING = "rating"
CONFIDENCE = 0.95
WINDOW_MS = 60.0
"""Window of a rating if none is named."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """One limit, or two, on a pulse metric or on the rating of the prediction against a test.

    Parameters
    ----------
    metric : str
        A metric of :func:`crashfuse.signals.metrics.pulse_metrics`, or ``rating``.
    at_least, at_most : float or None
        In the metric's unit; at least one of them.
    window_ms : float or None
        Of the rating, over [0, window_ms); None for a metric.
    """

    name: str
    metric: str
    at_least: float | None = None
    at_most: float | None = None
    window_ms: float | None = None

    @property
    def unit(self) -> str:
        """The metric's unit; empty for the rating."""
        return METRIC_UNITS.get(self.metric, "")

    @property
    def label(self) -> str:
        """The metric in words."""
        rating = "" if self.window_ms is None else f"{STANDARD} rating over 0–{self.window_ms:g} ms"
        return METRIC_LABELS.get(self.metric, rating)

    @property
    def limits(self) -> str:
        """The limits in words, such as ``at most 650 mm``, with all the digits that were declared."""
        ends = (("at least", self.at_least), ("at most", self.at_most))
        known = [
            Sentence("{} {}", word, Quantity((end,), self.unit, self._form(f"{end:.10g}")))
            for word, end in ends
            if end is not None
        ]
        return joined(known, " and ")

    def _form(self, declared: str) -> str:
        """Format of a limit: four digits, of one without a unit two behind the point, or as many as it has."""
        if self.unit:
            return f".{max(len(declared.replace('.', '').lstrip('0')), 4)}g"
        return f".{max(len(declared.partition('.')[2]), 2)}f"

    def shown(self, *values: float | None) -> Quantity:
        """Values of the metric as displayed, with its unit; several are the ends of a range.

        They have as many digits as it takes not to be carried over a limit by rounding: 0.7997 misses 0.80.
        """
        for more in range(9):
            form = f"#.{4 + more}g" if self.unit else f".{3 + more}f"
            known = [value for value in values if value is not None]
            if all(self.is_met_by(float(format(value, form))) == self.is_met_by(value) for value in known):
                break
        return Quantity(values, self.unit, form, " to ")

    def interval(self, lower: float | None, upper: float | None) -> Quantity | Sentence:
        """The interval of a value as displayed; of one that the record is too short for, the end that is known."""
        if (lower is None) is (upper is None):
            return self.shown(lower) if lower is None else self.shown(lower, upper)
        return Sentence("≤ {}", self.shown(upper)) if lower is None else Sentence("≥ {}", self.shown(lower))

    def compared(self, value: float | None, lower: float | None, upper: float | None) -> Sentence:
        """An expected value with its interval, and the limits, in words."""
        interval = self.interval(lower, upper)
        if value is None:
            found = "{} in 95 % of tests, no single value expected (record too short); the limit is {}"
            return Sentence(found, interval, self.limits)
        return Sentence("{} expected, {} in 95 % of tests; the limit is {}", self.shown(value), interval, self.limits)

    def is_met_by(self, value: float) -> bool:
        """Whether a value lies within the limits."""
        return (self.at_least is None or value >= self.at_least) and (self.at_most is None or value <= self.at_most)

    def margin(self, value: float) -> float:
        """Distance of a value from the nearest limit."""
        return min(abs(value - end) for end in (self.at_least, self.at_most) if end is not None)


@dataclass(frozen=True, slots=True)
class Criteria:
    """Criteria with unique names, and the probability from which one counts as met, or as not met by its complement."""

    items: tuple[Criterion, ...]
    confidence: float = CONFIDENCE

    def __repr__(self) -> str:
        return f"<Criteria at {self.confidence:g}: {', '.join(f'{own.name} {own.limits}' for own in self.items)}>"

    @property
    def windows_ms(self) -> tuple[float, ...]:
        """All windows of ratings, ascending."""
        return tuple(sorted({c.window_ms for c in self.items if c.window_ms is not None}))
