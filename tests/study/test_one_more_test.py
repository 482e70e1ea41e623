"""What one more test would buy: gains on the same tests, a law that is known, and the cost as people write it."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest

from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.results.planning import gains_table
from crashfuse.study.config import StudyConfig
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost, enough, gains, one_more, summary
from tests.conftest import not_none

CONFIG = StudyConfig(approaches=("cae", "fused"), windows_ms=(60.0,))
N = 9


@pytest.mark.parametrize(
    ("text", "amount", "currency"),
    [
        ("60000", 60000.0, ""),
        ("60,000 EUR", 60000.0, "EUR"),
        ("€ 60000", 60000.0, "€"),
        (" 1,250,000.50 USD ", 1250000.5, "USD"),
        ("0.500", 0.5, ""),
        ("1,234.567", 1234.567, ""),
    ],
)
def test_a_cost_is_an_amount_with_or_without_a_currency(text: str, amount: float, currency: str) -> None:
    assert Cost.of(text) == Cost(amount, currency)


@pytest.mark.parametrize(
    "text",
    ["-5", "0", "", "many", "1e400", "60,00 EUR", "5 6", "nan", "inf", "1'000", "1.200.000 EUR", "60.000,50", "a 5 b"],
)
def test_what_is_no_cost_is_a_sentence(text: str) -> None:
    with pytest.raises(UsageError, match="number above 0, with or without a currency"):
        Cost.of(text)


@pytest.mark.parametrize("text", ["60.000 EUR", "€60.000"])
def test_a_point_before_three_digits_is_asked_about(text: str) -> None:
    """It parts thousands in one language, decimals in another; the sentence has both as they can be written."""
    with pytest.raises(UsageError, match=r"60\.000 may be 60000 or 60: "):
        Cost.of(text)


def test_a_multiple_is_rounded_to_two_digits() -> None:
    assert Cost(60000.0, "EUR").times(4 / 3) == "80,000 EUR"
    assert Cost(60000.0).times(0.0713) == "4,300"
    assert Cost(0.5).times(0.25) == "0.12"


def curve_of(campaign: Campaign, rating: Callable[[int, int], float], sizes: tuple[int, ...]) -> LearningCurve:
    """A curve on nine tests: the rating of each from a number of others."""
    tests = tuple(replace(campaign.tests[0], id=f"T{i}") for i in range(N))
    rows = []
    for size, choice, (number, test) in product(sizes, ("even", "random"), enumerate(tests)):
        row = {"n_tests": size, "chosen": "", "choice": choice, "held_out": test.id, "window_ms": 60.0}
        rows.append({**row, "approach": "cae", "overall": 0.6})
        fused = {"overall": rating(size, number), "inside": 0.95, "half_width_g": 9.0 / size}
        rows.append({**row, "approach": "fused", **fused})
    return LearningCurve(replace(campaign, tests=tests), CONFIG, 1, pd.DataFrame(rows), (), 1.0)


def law(size: int, test: int) -> float:
    return 0.95 - 0.1 / size + 0.01 * (test - 4)


@pytest.fixture
def lawful(campaign: Campaign) -> LearningCurve:
    return curve_of(campaign, law, (1, 2, 3, 4, 6, 8))


def test_a_gain_is_the_mean_difference_on_the_same_tests(campaign: Campaign) -> None:
    curve = curve_of(campaign, lambda size, test: 0.5 + 0.05 * test + 0.01 * size * (1 + (test % 2)), (1, 2, 4))
    first, second = gains(curve)
    own = 0.01 * (1 + np.arange(N) % 2)
    assert (first.before, first.after) == (1, 2)
    assert first.gain == pytest.approx(own.mean())
    assert first.error == pytest.approx(own.std(ddof=1) / 3)
    assert second.per_test == pytest.approx(own.mean())


def test_one_more_test_continues_the_law(lawful: LearningCurve) -> None:
    """A curve that follows the law is continued exactly, and the interval spans what other exponents would say."""
    more = not_none(one_more(lawful))
    assert more.n_tests == N
    assert more.gain == pytest.approx(0.1 / 9 - 0.1 / 10)
    assert more.rating == pytest.approx(0.95 - 0.1 / 10)
    assert more.lower < 0.6 * more.gain < 1.3 * more.gain < more.upper


def test_a_curve_that_scatters_tells_less(campaign: Campaign) -> None:
    """The interval grows with the scatter of the means about the law, and with that between the tests."""
    rng = np.random.default_rng(0)
    jumps = dict(zip((1, 2, 3, 4, 6, 8), rng.normal(0, 0.06, 6), strict=True))
    tests = rng.normal(0, 0.2, N)
    widths = []
    for rating in (law, lambda s, t: law(s, t) + jumps[s], lambda s, t: law(s, t) - tests[t] / s):
        more = not_none(one_more(curve_of(campaign, rating, (1, 2, 3, 4, 6, 8))))
        widths.append(more.upper - more.lower)
    assert widths[1] > 1.5 * widths[0]
    assert widths[2] > 1.5 * widths[0]


def test_the_fewest_tests_that_do_as_well_are_found(campaign: Campaign) -> None:
    level = curve_of(campaign, lambda s, t: min(s, 4) * 0.1 + 0.001 * ((s * 7 + t) % 3), (1, 2, 3, 4, 6, 8))
    assert not_none(enough(level)).before == 4
    assert enough(curve_of(campaign, lambda s, t: 0.05 * s + 0.001 * t, (1, 2, 3, 4, 6, 8))) is None


def test_an_approach_that_learns_from_no_test_gains_nothing(lawful: LearningCurve) -> None:
    alone = replace(lawful, config=replace(CONFIG, approaches=("cae",)))
    assert gains(alone) == ()
    assert gains_table(alone).empty


def test_the_summary_counts_every_test_once(lawful: LearningCurve) -> None:
    row = summary(lawful).query("approach == 'fused' and choice == 'even' and n_tests == 4").iloc[0]
    ratings = np.array([law(4, test) for test in range(N)])
    assert row["rating"] == pytest.approx(ratings.mean())
    assert row["error"] == pytest.approx(ratings.std(ddof=1) / 3)
    assert (row["low"], row["high"]) == pytest.approx(tuple(np.quantile(ratings, [0.1, 0.9])))
    assert row["half_width_g"] == pytest.approx(9 / 4)


def test_the_steps_show_a_price_only_where_there_is_a_gain(campaign: Campaign) -> None:
    curve = curve_of(campaign, lambda s, t: min(s, 2) * 0.1 + (0.001 * (t % 2) if s > 2 else 0) - 0.001 * s, (1, 2, 3))
    table = gains_table(curve, Cost(1000.0)).texts()
    assert table["Tests"].tolist() == ["1 → 2", "2 → 3"]
    assert table["Cost of 0.01"].tolist() == ["100", "–"]
    assert "Cost of 0.01" not in gains_table(curve).texts()
