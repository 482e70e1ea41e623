"""What one more test would buy: gains along a learning curve, and the law that carries it one test further.

Gains compare the same held-out tests. Beyond the campaign, the mean rating with n tests is taken to be

    rating(n) = limit - a n^-b,  b = 1,

fitted to the curve by least squares. One more test after N then adds a (N^-b - (N + 1)^-b). The interval runs from the
lowest to the highest gain with b = 0.5, 1 and 2, for what happens beyond a curve depends on b more than on anything in
it, and beyond both by the 95 % of Student's t, from the scatter about the law and between the tests.
"""

import math
from dataclasses import dataclass
from itertools import pairwise, takewhile

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from crashfuse.approaches.registry import CLASSES
from crashfuse.study.cost import Cost
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.wording import Quantity, Sentence, signed

EXPONENTS = (0.5, 1.0, 2.0)
"""Of the law: the middle one for what is expected, all for its interval."""

_LEAST_SIZES = 4
_NOTHING = 0.0005  # a gain that is rounded to nothing


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
    """Gains of the judged approach from each number of tests to the next; none if it learns from no test."""
    if not CLASSES[curve.judged].learns_from_tests:
        return ()
    ratings = curve.by_test(curve.judged)
    sizes = ratings.columns.tolist()
    return tuple(_gain(ratings, *pair) for pair in pairwise(sizes))


def enough(curve: LearningCurve) -> Gain | None:
    """The gain from the fewest tests from which all but one of them gain no more than twice the standard error.

    None if the gain over any fewer tests is larger.
    """
    ratings = curve.by_test(curve.judged)
    *fewer, most = ratings.columns.tolist()
    steps = [_gain(ratings, size, most) for size in fewer]
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
    """The law's a by least squares, and its standard error: scatter about the law, and between the tests."""
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
    """One row for each approach, choice and number of tests, over the longest window.

    Columns: approach, choice, n_tests, predictions (their number), rating and error (mean over the held-out tests, each
    counted once, and its standard error), low and high (the central 80 % of the single predictions), inside and
    half_width_g (means); decided too, if the curve has it.
    """
    shares = [name for name in ("inside", "half_width_g", "decided") if name in curve.table]
    own = curve.table[curve.table["window_ms"] == curve.window_ms]
    rows = []
    for (approach, choice, n_tests), part in own.groupby(["approach", "choice", "n_tests"], sort=False):
        by_test = part.groupby("held_out")[["overall", *shares]].mean()
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
                **{name: by_test[name].mean() for name in shares},
            }
        )
    return pd.DataFrame(rows)


def sentences(curve: LearningCurve, cost: Cost | None = None) -> tuple[str, ...]:
    """Where the campaign stands, and what one more test would buy."""
    name, n = curve.judged, len(curve.campaign.tests)
    said = [_standing(curve, name, n)]
    if not CLASSES[name].learns_from_tests:
        return (*said, f"{_capital(CLASSES[name].in_words)} learns from no test, so further tests change nothing.")
    if found := gains(curve):
        last = found[-1]
        change = "gained" if last.gain >= 0 else "lost"
        said.append(
            f"From {last.before} to {_count(last.after)} it {change} {abs(last.gain):.3f}{plus_minus(last.error)}"
            f"{_price(last.per_test, cost) if last.told else ': no gain that can be told from scatter'}."
        )
        said.append(_enough(curve))
    said.append(_outlook(one_more(curve), n, cost))
    return tuple(said)


def _standing(curve: LearningCurve, name: str, n: int) -> str:
    ratings, last = curve.by_test(name).iloc[:, -1], summary(curve).query("approach == @name").iloc[-1]
    said = (
        f"With {n - 1} of {n} tests {CLASSES[name].in_words} rates {ratings.mean():.3f}{plus_minus(_error(ratings))}"
        f" over 0–{curve.window_ms:g} ms (mean of {len(ratings)} held-out tests ± standard error)"
    )
    if "cae" in curve.config.approaches and name != "cae":
        said += f"; the raw CAE model, without any test, {curve.by_test('cae').iloc[:, -1].mean():.3f}"
    if not math.isnan(last.get("decided", math.nan)):
        said += f". It decides {100 * last['decided']:.0f} % of the verdicts on metrics, counted over these tests"
    if math.isnan(last["half_width_g"]):
        return f"{said}."
    band, inside = Quantity((last["half_width_g"],), "g"), f"{100 * last['inside']:.0f} %"
    return Sentence("{}. Its 95 % band is ± {} wide on average and holds {} of a(t).", said, band, inside)


def _enough(curve: LearningCurve) -> str:
    most = len(curve.campaign.tests) - 1
    found = enough(curve)
    if found is None:
        return f"No fewer tests, chosen evenly over speed, rate as well as {most}."
    return (
        f"{found.before} of these tests, chosen evenly over speed, may rate as well: with {most} it rates "
        f"{signed(found.gain, 3)}{plus_minus(found.error)}, within twice the standard error."
    )


def _outlook(more: OneMore | None, n: int, cost: Cost | None) -> str:
    if more is None:
        return f"What one more test would add cannot be told from {_count(n)}; it takes at least 5."
    what = f"What one more test would add to these {n} cannot be told from nothing"
    if more.upper < _NOTHING:
        return f"{what}."
    if more.lower < _NOTHING:
        price = "" if cost is None else f"; at {cost} each, one hundredth costs {cost.times(0.01 / more.upper)} or more"
        return f"{what}: about {max(more.gain, 0):.3f}, at most {more.upper:.3f} (95 %){price}."
    interval = f"{more.lower:.3f} to {more.upper:.3f} (95 %)"
    return f"One more test, after these {n}, should add about {more.gain:.3f}, {interval}{_price(more.gain, cost)}."


def _price(per_test: float, cost: Cost | None) -> str:
    rate = f"{per_test:.4f} a test"
    if cost is None:
        return f" ({rate})"
    return f" ({rate}, at {cost} each: {cost.times(0.01 / per_test)} for one hundredth of rating)"


def _gain(ratings: pd.DataFrame, before: int, after: int) -> Gain:
    difference = ratings[after] - ratings[before]
    return Gain(before, after, float(difference.mean()), _error(difference))


def _error(values: "pd.Series[float]") -> float:
    return float(values.std() / math.sqrt(len(values))) if len(values) > 1 else math.nan


def plus_minus(error: float) -> str:
    """A standard error as text to follow a value; empty if it is unknown."""
    return "" if math.isnan(error) else f" ± {error:.3f}"


def _count(n: int) -> str:
    return f"{n} test{'s' * (n != 1)}"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
