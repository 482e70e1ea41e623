"""What one more test would buy: gains along a learning curve, and the law that carries it one test further.

Gains compare the same held-out tests. Beyond the campaign, the mean rating with n tests is taken to be

    rating(n) = limit - a n^-b,  b = 0.7,

fitted to the curve by least squares. One more test after N then adds a (N^-b - (N + 1)^-b). Its interval is that of a
regression's slope (Student's t), from the lowest to the highest end with b = 0.4, 0.7 and 1.2: how far the curve
scatters about the law, and how little is known of the law itself.
"""

import math
import re
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
import pandas as pd
from scipy.stats import t as student

from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.errors import UsageError
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.learning_curve import LearningCurve

EXPONENTS = (0.4, 0.7, 1.2)
"""Of the law: the middle one for what is expected, all for its interval."""

_LEAST_SIZES = 4
_AMOUNT = re.compile(
    r"(?P<before>[^\d\s.,+-]*)\s*(?P<number>\d{1,3}(,\d{3})+(\.\d+)?|\d+(\.\d+)?)\s*(?P<after>[^\d.,+-]*)"
)


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one test: an amount, and its currency or an empty string."""

    amount: float
    currency: str = ""

    @classmethod
    def of(cls, text: str) -> Self:
        """Read an amount such as ``60000``, ``60,000 EUR`` or ``$60000``.

        Raises
        ------
        UsageError
            If it is no number above 0.
        """
        found = _AMOUNT.fullmatch(text.strip())
        amount = float(found["number"].replace(",", "")) if found else 0.0
        if found is None or not 0 < amount < math.inf:
            raise UsageError(
                f"The cost of a test is a number above 0, with a currency or without (60000, 60,000 EUR), not {text!r}."
            )
        return cls(amount, (found["before"] or found["after"]).strip())

    def times(self, factor: float) -> str:
        """A multiple of it, to two digits."""
        value = self.amount * factor
        digits = 1 - math.floor(math.log10(value))
        return f"{round(value, digits):,.0f} {self.currency}".rstrip() if value >= 10 else f"{value:.2g}"

    def __str__(self) -> str:
        return f"{self.amount:,.10g} {self.currency}".rstrip()


@dataclass(frozen=True, slots=True)
class Gain:
    """Gain of mean rating from one number of tests to a higher one.

    Attributes
    ----------
    gain, error : float
        Mean and standard error of the difference over the held-out tests; the error is NaN for fewer than two.
    """

    before: int
    after: int
    gain: float
    error: float

    @property
    def per_test(self) -> float:
        """Gain divided by the number of further tests."""
        return self.gain / (self.after - self.before)

    @property
    def told(self) -> bool:
        """Whether the gain is above its standard error."""
        return self.gain > self.error


@dataclass(frozen=True, slots=True)
class OneMore:
    """Gain of mean rating expected of one test beyond the campaign, with its 95 % interval.

    Attributes
    ----------
    n_tests : int
        Number of tests of the campaign.
    rating : float
        Mean rating expected with one test more.
    """

    n_tests: int
    gain: float
    lower: float
    upper: float
    rating: float


def gains(curve: LearningCurve) -> tuple[Gain, ...]:
    """Gains of the judged approach from each number of tests to the next, chosen evenly over speed."""
    ratings = curve.by_test(curve.judged)
    sizes = ratings.columns.tolist()
    found = []
    for before, after in pairwise(sizes):
        difference = (ratings[after] - ratings[before]).dropna()
        found.append(Gain(before, after, float(difference.mean()), _error(difference)))
    return tuple(found)


def one_more(curve: LearningCurve) -> OneMore | None:
    """Gain expected of one more test; None if the curve has fewer than four points."""
    ratings = curve.by_test(curve.judged).mean()
    if len(ratings) < _LEAST_SIZES:
        return None
    sizes, n = ratings.index.to_numpy(dtype=np.float64), len(curve.campaign.tests)
    fits = [_ahead(sizes, ratings.to_numpy(), exponent, n) for exponent in EXPONENTS]
    gain, since = fits[len(fits) // 2][0]
    lower, upper = min(low for _, low, _ in fits), max(high for *_, high in fits)
    return OneMore(n, gain, lower, upper, float(ratings.iloc[-1]) + since)


def _ahead(sizes: FloatArray, ratings: FloatArray, exponent: float, n: int) -> tuple[tuple[float, float], float, float]:
    """Gains with test n + 1, over n and over n - 1 tests, and the interval of the former, by least squares."""
    x = -(sizes**-exponent)
    x = x - x.mean()
    slope = float(x @ ratings / (x @ x))
    left = ratings - ratings.mean() - slope * x
    error = float(np.sqrt(left @ left / (len(sizes) - 2) / (x @ x)))
    reach = float(student.ppf(0.975, len(sizes) - 2)) * error
    step, since = (before**-exponent - (n + 1.0) ** -exponent for before in (float(n), n - 1.0))
    return (slope * step, slope * since), (slope - reach) * step, (slope + reach) * step


def summary(curve: LearningCurve) -> pd.DataFrame:
    """One row for each approach, choice and number of tests, over the longest window.

    Columns: approach, choice, n_tests, predictions (their number), rating and error (mean over the held-out tests, each
    counted once, and its standard error), low and high (the central 80 % of the single predictions), inside and
    half_width_g (means).
    """
    own = curve.table[curve.table["window_ms"] == curve.window_ms]
    rows = []
    for (approach, choice, n_tests), part in own.groupby(["approach", "choice", "n_tests"], sort=False):
        by_test = part.groupby("held_out")[["overall", "inside", "half_width_g"]].mean()
        low, high = part["overall"].quantile([0.1, 0.9])
        rows.append(
            {
                "approach": approach,
                "choice": choice,
                "n_tests": n_tests,
                "predictions": len(part),
                "rating": by_test["overall"].mean(),
                "error": _error(by_test["overall"]),
                "low": low,
                "high": high,
                "inside": by_test["inside"].mean(),
                "half_width_g": by_test["half_width_g"].mean(),
            }
        )
    return pd.DataFrame(rows)


def sentences(curve: LearningCurve, cost: Cost | None = None) -> tuple[str, ...]:
    """Where the campaign stands, and what one more test would buy."""
    name, n = curve.judged, len(curve.campaign.tests)
    said = [_standing(curve, name, n)]
    if not CLASSES[name].learns_from_tests:
        return (*said, f"{_capital(CLASSES[name].in_words)} learns from no test, so further tests change nothing.")
    found = gains(curve)
    if found:
        last = found[-1]
        change = "gained" if last.gain >= 0 else "lost"
        said.append(
            f"From {last.before} to {_count(last.after)} it {change} {abs(last.gain):.3f}{_plus_minus(last.error)}"
            f"{_price(last.per_test, cost) if last.told else ': no gain that can be told from scatter'}."
        )
    said.append(_outlook(one_more(curve), n, cost))
    return tuple(said)


def steps_table(curve: LearningCurve, cost: Cost | None = None) -> pd.DataFrame:
    """Gains of the judged approach as a readable table, one row for each step, with the cost of a hundredth."""
    return pd.DataFrame(
        {
            "tests": f"{step.before} → {step.after}",
            "gain of rating": f"{step.gain:+.3f}{_plus_minus(step.error)}",
            "a test": f"{step.per_test:+.4f}",
            **({} if cost is None else {"cost of 0.01": cost.times(0.01 / step.per_test) if step.told else "not told"}),
        }
        for step in gains(curve)
    )


def summary_table(curve: LearningCurve) -> pd.DataFrame:
    """The summary as a readable table."""
    table = summary(curve)
    known = table["half_width_g"].notna()
    return pd.DataFrame(
        {
            "approach": table["approach"].map(LABELS),
            "chosen": table["choice"].map({"even": "evenly over speed", "random": "at random"}),
            "tests": table["n_tests"],
            "predictions": table["predictions"],
            "rating": [f"{r:.3f}{_plus_minus(e)}" for r, e in zip(table["rating"], table["error"], strict=True)],
            "80 % of them": [f"{low:.2f}–{high:.2f}" for low, high in zip(table["low"], table["high"], strict=True)],
            "a(t) inside the band (%)": (100 * table["inside"]).map("{:.0f}".format).where(known, "–"),
            "half width (g)": table["half_width_g"].map("{:.1f}".format).where(known, "–"),
        }
    )


def _standing(curve: LearningCurve, name: str, n: int) -> str:
    ratings = curve.by_test(name).iloc[:, -1]
    raw = curve.by_test("cae").iloc[:, -1].mean() if "cae" in curve.config.approaches and name != "cae" else None
    return (
        f"With {n - 1} of {n} tests {CLASSES[name].in_words} rates {ratings.mean():.3f}{_plus_minus(_error(ratings))}"
        f" over 0–{curve.window_ms:g} ms (mean of {len(ratings)} held-out tests ± standard error)"
        + (f"; the raw CAE model, without any test, {raw:.3f}." if raw is not None else ".")
    )


def _outlook(more: OneMore | None, n: int, cost: Cost | None) -> str:
    if more is None:
        return f"What one more test would add cannot be told from {_count(n)}; it takes at least 5."
    interval = f"95 %: {more.lower:+.3f} to {more.upper:+.3f}"
    if more.lower <= 0:
        most = f": at most {more.upper:.3f}" if more.upper > 0 else ""
        return f"What one more test would add to these {n} cannot be told from nothing ({interval}){most}."
    return f"One more test, after these {n}, should add {more.gain:.3f} ({interval}){_price(more.gain, cost)}."


def _price(per_test: float, cost: Cost | None) -> str:
    rate = f"{per_test:.4f} a test"
    return (
        f" ({rate})" if cost is None else f" ({rate}; at {cost} each, {cost.times(0.01 / per_test)} for one hundredth)"
    )


def _error(values: "pd.Series[float]") -> float:
    return float(values.std() / math.sqrt(len(values))) if len(values) > 1 else math.nan


def _plus_minus(error: float) -> str:
    return "" if math.isnan(error) else f" ± {error:.3f}"


def _count(n: int) -> str:
    return f"{n} test{'s' * (n != 1)}"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
