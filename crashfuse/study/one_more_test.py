"""What one more test would buy, and cost: gains along a learning curve, and the law that carries it one test further.

Gains compare the same held-out tests. Beyond the campaign, the mean rating with n tests is taken to be

    rating(n) = limit - a n^-b,  b = 1,

fitted by least squares. One more test after N then adds a (N^-b - (N + 1)^-b). The interval runs from the lowest to
the highest gain with b = 0.5, 1 and 2, and beyond both by the 95 % of Student's t.
"""

import math
from dataclasses import dataclass
from itertools import pairwise, takewhile
from typing import Self

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from crashfuse.approaches.registry import CLASSES
from crashfuse.errors import UsageError
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.units import counted, signed, statements

EXPONENTS = (0.5, 1.0, 2.0)
"""Of the law: the middle one for what is expected, all for its interval."""

_GROUP = 3  # digits between commas
_LEAST_SIZES = 4
_NOTHING = 0.0005  # a gain that is rounded to nothing


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one test: an amount that the user enters, and its currency or an empty string."""

    amount: float
    currency: str = ""

    @classmethod
    def of(cls, text: str) -> Self:
        """Read an amount such as ``60000``, ``60,000 EUR`` or ``$60000``; a UsageError if it is not one above 0."""
        places = [place for place, letter in enumerate(text) if letter.isdecimal()] or [0]
        before, number, after = text[: places[0]], text[places[0] : places[-1] + 1], text[places[-1] + 1 :]
        whole, point, decimals = number.partition(".")
        first, *groups = whole.split(",")
        if point and len(decimals) == _GROUP and decimals.isdecimal() and whole.isdecimal() and whole != "0":
            raise UsageError(f"{number} may be {whole}{decimals} or {float(number):g}: write the one that is meant.")
        parts = [first, *groups, decimals or "0"]
        is_number = all(map(str.isdecimal, parts)) and all(len(group) == _GROUP for group in groups)
        amount = float("".join([first, *groups, ".", decimals])) if is_number else 0.0
        if not 0 < amount < math.inf or {*before, *after} & {*"+-.,"} or (before.strip() and after.strip()):
            found = f"a number above 0, with or without a currency (60,000 EUR), not {text!r}"
            raise UsageError(f"The cost of a test is {found}.")
        return cls(amount, (before + after).strip())

    def times(self, factor: float) -> str:
        """A multiple of it, to two digits."""
        value = self.amount * factor
        digits = 1 - math.floor(math.log10(value))
        return f"{round(value, digits):,.0f} {self.currency}".rstrip() if value >= 10 else f"{value:.2g}"

    def __str__(self) -> str:
        return f"{self.amount:,.10g} {self.currency}".rstrip()


@dataclass(frozen=True, slots=True)
class Gain:
    """Gain of mean rating over the held-out tests from one number of tests to a higher one."""

    before: int
    after: int
    gain: float
    error: float  # standard error; NaN for fewer than two held-out tests

    @classmethod
    def between(cls, ratings: pd.DataFrame, before: int, after: int) -> Self:
        """From the columns of :meth:`LearningCurve.by_test`."""
        difference = ratings[after] - ratings[before]
        return cls(before, after, float(difference.mean()), _error(difference))

    @property
    def per_test(self) -> float:
        """Gain divided by the number of further tests."""
        return self.gain / (self.after - self.before)

    @property
    def is_clear(self) -> bool:
        """Whether the gain is above its standard error."""
        return self.gain > self.error


@dataclass(frozen=True, slots=True)
class OneMore:
    """Gain of mean rating expected of one test beyond the campaign, with its 95 % interval."""

    n_tests: int  # of the campaign
    gain: float
    lower: float
    upper: float
    rating: float  # mean rating expected with one test more


def gains(curve: LearningCurve) -> tuple[Gain, ...]:
    """Gains of the judged approach from each number of tests to the next; none if it learns from no test."""
    if not CLASSES[curve.judged].learns_from_tests:
        return ()
    ratings = curve.by_test(curve.judged)
    return tuple(Gain.between(ratings, *pair) for pair in pairwise(ratings.columns.tolist()))


def enough(curve: LearningCurve) -> Gain | None:
    """The gain from the fewest tests beyond which all but one gain at most twice the standard error; None if more."""
    ratings = curve.by_test(curve.judged)
    *fewer, most = ratings.columns.tolist()
    steps = [Gain.between(ratings, size, most) for size in fewer]
    small = takewhile(lambda step: step.gain <= 2 * step.error, reversed(steps))
    return min(small, key=lambda step: step.before, default=None)


def one_more(curve: LearningCurve) -> OneMore | None:
    """Gain expected of one more test; None if the curve has fewer than four points."""
    ratings = curve.by_test(curve.judged)
    if ratings.shape[1] < _LEAST_SIZES:
        return None
    n = len(ratings)
    laws = [(*_law(ratings, exponent), n**-exponent - (n + 1.0) ** -exponent) for exponent in EXPONENTS]
    ahead = [slope * step for slope, _, step in laws]
    slope, error, step = laws[1]
    reach = float(stdtrit(ratings.shape[1] - 2, 0.975)) * error * step
    before = (n - 1.0) ** -EXPONENTS[1] - n ** -EXPONENTS[1]
    rating = float(ratings.iloc[:, -1].mean()) + slope * (before + step)
    return OneMore(n, ahead[1], min(ahead) - reach, max(ahead) + reach, rating)


def _law(ratings: pd.DataFrame, exponent: float) -> tuple[float, float]:
    means = ratings.mean().to_numpy()
    x = -(ratings.columns.to_numpy(dtype=np.float64) ** -exponent)
    x = x - x.mean()
    by_test = ratings.to_numpy() @ x / (x @ x)
    slope = float(by_test.mean())
    left = means - means.mean() - slope * x
    about_the_law = left @ left / (len(x) - 2) / (x @ x)
    between_tests = by_test.var(ddof=1) / len(by_test)
    return slope, float(np.sqrt(about_the_law + between_tests))


def summary(curve: LearningCurve) -> pd.DataFrame:
    """Means over the held-out tests, over the longest window, a row for each approach, choice and number of tests.

    ``error`` is the standard error of the mean rating, ``low`` to ``high`` the central 80 % of single predictions.
    """
    shares = [name for name in ("inside", "half_width_g", "decided") if name in curve.table]
    table, keys = curve.table[curve.table["window_ms"] == curve.window_ms], ["approach", "choice", "n_tests"]
    rows = []
    for group, part in table.groupby(keys, sort=False):
        by_test = part.groupby("held_out")[["overall", *shares]].mean()
        low, high = part["overall"].quantile([0.1, 0.9])
        rating, error = by_test["overall"].mean(), _error(by_test["overall"])
        means = {name: by_test[name].mean() for name in shares}
        row = {"predictions": len(part), "rating": rating, "error": error, "low": low, "high": high, **means}
        rows.append(dict(zip(keys, group, strict=True)) | row)
    return pd.DataFrame(rows)


def sentences(curve: LearningCurve, cost: Cost | None = None) -> tuple[str, ...]:
    """Where the campaign stands, and what one more test would buy."""
    name, n = curve.judged, len(curve.campaign.tests)
    told = [_standing(curve, name, n)]
    if not CLASSES[name].learns_from_tests:
        return (*told, f"{CLASSES[name].label} learns from no test: further tests change nothing.")
    if steps := gains(curve):
        last = steps[-1]
        price = _price(last.per_test, cost) if last.is_clear else ": no clear gain"
        more = f"{signed(last.gain, 3)}{plus_minus(last.error)}{price}"
        told.append(f"From {last.before} to {last.after} tests it gains {more}.")
        if (gain := enough(curve)) is not None:
            less = f"{signed(gain.gain, 3)}{plus_minus(gain.error)}"
            told.append(f"{counted(gain.before, 'test')} may do as well as {n - 1}: the gain is {less}.")
    return (*told, _outlook(one_more(curve), n, cost))


def _standing(curve: LearningCurve, name: str, n: int) -> str:
    ratings, last = curve.by_test(name).iloc[:, -1], summary(curve).query("approach == @name").iloc[-1]
    values: dict[str, object] = {
        "tests": f"{n - 1} of {n} tests",
        "method": CLASSES[name].in_words,
        "rating": f"{ratings.mean():.3f}{plus_minus(_error(ratings))}",
        "window_ms": curve.window_ms,
        "width_g": None if math.isnan(last["half_width_g"]) else last["half_width_g"],
        "inside": last.get("inside"),
    }
    if "cae" in curve.config.approaches and name != "cae":
        values["raw"] = curve.by_test("cae").iloc[:, -1].mean()
    if not math.isnan(last.get("decided", math.nan)):
        values["decided"] = last["decided"]
    return statements(_STANDING, values)


_STANDING = (
    "With {tests} {method} rates {rating} over 0–{window_ms:g} ms (mean ± standard error).",
    "It decides {decided:.0%} of the verdicts on metrics.",
    "The raw CAE model: {raw:.3f}.",
    "The 95 % band is ± {width_g} wide on average and holds {inside:.0%} of a(t).",
)


def _outlook(more: OneMore | None, n: int, cost: Cost | None) -> str:
    if more is None:
        return "It takes 5 tests to say what one more would add."
    if more.lower >= _NOTHING:
        interval = f"{more.lower:.3f} to {more.upper:.3f} (95 %)"
        return f"One more test should add about {more.gain:.3f}, {interval}{_price(more.gain, cost)}."
    if more.upper < _NOTHING:
        return f"One more test after these {n} should add nothing noticeable."
    price = "" if cost is None else f"; at {cost} each, 0.01 costs {cost.times(0.01 / more.upper)} or more"
    return f"One more test may add nothing: about {max(more.gain, 0):.3f}, at most {more.upper:.3f} (95 %){price}."


def _price(per_test: float, cost: Cost | None) -> str:
    rate = f"{per_test:.4f} a test"
    if cost is None:
        return f" ({rate})"
    return f" ({rate}, at {cost} each: {cost.times(0.01 / per_test)} for 0.01 of rating)"


def _error(values: "pd.Series[float]") -> float:
    return float(values.std() / math.sqrt(len(values))) if len(values) > 1 else math.nan


def plus_minus(error: float) -> str:
    """A standard error as text to follow a value; empty if it is unknown."""
    return "" if math.isnan(error) else f" ± {error:.3f}"
