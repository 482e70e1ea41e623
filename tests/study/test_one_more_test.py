"""What one more test would buy: gains on the same tests, a law that is known, and the cost as people write it."""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest

from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.reporting.result_tables import curve_table, gains_table
from crashfuse.study.config import StudyConfig
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost, enough, gains, one_more, sentences, summary

CONFIG = StudyConfig(approaches=("cae", "fused"), windows_ms=(60.0,))
N = 9


@pytest.mark.parametrize(
    ("text", "amount", "currency"),
    [
        ("60000", 60000.0, ""),
        ("60,000 EUR", 60000.0, "EUR"),
        ("€ 60000", 60000.0, "€"),
        (" 1,250,000.50 USD ", 1250000.5, "USD"),
    ],
)
def test_a_cost_is_an_amount_with_or_without_a_currency(text: str, amount: float, currency: str) -> None:
    """As people write it."""
    assert Cost.of(text) == Cost(amount, currency)


@pytest.mark.parametrize("text", ["-5", "0", "", "many", "1e400", "60,00 EUR", "5 6", "nan", "inf"])
def test_what_is_no_cost_is_a_sentence(text: str) -> None:
    """Nothing is guessed."""
    with pytest.raises(UsageError, match="number above 0, with a currency or without"):
        Cost.of(text)


def test_a_multiple_is_rounded_to_two_digits() -> None:
    """With its currency; small amounts are not rounded away."""
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
    """The law, with tests of different difficulty."""
    return 0.95 - 0.1 / size + 0.01 * (test - 4)


@pytest.fixture
def lawful(campaign: Campaign) -> LearningCurve:
    """A curve that follows the law exactly."""
    return curve_of(campaign, law, (1, 2, 3, 4, 6, 8))


def test_a_gain_is_the_mean_difference_on_the_same_tests(campaign: Campaign) -> None:
    """How difficult tests are does not count, how differently they gain does."""
    curve = curve_of(campaign, lambda size, test: 0.5 + 0.05 * test + 0.01 * size * (1 + (test % 2)), (1, 2, 4))
    first, second = gains(curve)
    own = 0.01 * (1 + np.arange(N) % 2)
    assert (first.before, first.after) == (1, 2)
    assert first.gain == pytest.approx(own.mean())
    assert first.error == pytest.approx(own.std(ddof=1) / 3)
    assert second.per_test == pytest.approx(own.mean())


def test_one_more_test_continues_the_law(lawful: LearningCurve) -> None:
    """A curve that follows the law is continued exactly, and the interval spans what other exponents would say."""
    more = one_more(lawful)
    assert more is not None
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
        more = one_more(curve_of(campaign, rating, (1, 2, 3, 4, 6, 8)))
        assert more is not None
        widths.append(more.upper - more.lower)
    assert widths[1] > 1.5 * widths[0]
    assert widths[2] > 1.5 * widths[0]


def test_the_fewest_tests_that_do_as_well_are_found(campaign: Campaign) -> None:
    """From four tests on nothing is gained beyond the scatter; where each step gains, none are enough."""
    level = curve_of(campaign, lambda s, t: min(s, 4) * 0.1 + 0.001 * ((s * 7 + t) % 3), (1, 2, 3, 4, 6, 8))
    found = enough(level)
    assert found is not None
    assert found.before == 4
    assert "4 of these tests, chosen evenly over speed, may rate as well: with 8 it rates" in " ".join(sentences(level))
    steep = curve_of(campaign, lambda s, t: 0.05 * s + 0.001 * t, (1, 2, 3, 4, 6, 8))
    assert enough(steep) is None
    assert "No fewer tests, chosen evenly over speed, rate as well as 8." in sentences(steep)


def test_sentences_tell_where_the_campaign_stands_and_what_a_test_buys(campaign: Campaign) -> None:
    """Rating, last gain, its price, and the outlook."""
    curve = curve_of(campaign, lambda s, t: 0.95 - 0.5 / s + 0.01 * (t - 4), (1, 2, 3, 4, 6, 8))
    standing, last, _, outlook = sentences(curve, Cost(60000.0, "EUR"))
    rating = 0.95 - 0.5 / 8
    assert standing == (
        f"With 8 of 9 tests the fused prediction rates {rating:.3f} ± 0.009 over 0–60 ms (mean of 9 held-out tests ± "
        "standard error); the raw CAE model, without any test, 0.600. Its 95 % band is ± 1.1 g wide on "
        "average and holds 95 % of a(t)."
    )
    assert last == (
        "From 6 to 8 tests it gained 0.021 ± 0.000 (0.0104 a test, at 60,000 EUR each: 58,000 EUR for one hundredth of "
        "rating)."
    )
    assert outlook.startswith("One more test, after these 9, should add about 0.006, 0.001 to 0.0")
    assert "EUR" not in " ".join(sentences(curve))


def test_what_cannot_be_told_is_said(campaign: Campaign) -> None:
    """A level curve, a falling one, and one of three points."""
    wild = {1: 0.9, 2: 0.93, 3: 0.89, 4: 0.95, 6: 0.91, 8: 0.91}
    level = sentences(curve_of(campaign, lambda s, t: wild[s] + 0.001 * ((s + t) % 3), tuple(wild)), Cost(100.0))
    assert "no gain that can be told from scatter" in level[1]
    assert "cannot be told from nothing: about 0.00" in level[-1]
    assert re.search(r"at 100 each, one hundredth costs \d+ or more\.", level[-1])
    falling = sentences(curve_of(campaign, lambda s, t: 0.9 + 0.1 / s + 0.001 * t, (1, 2, 3, 4, 6, 8)), Cost(100.0))
    assert "it lost" in falling[1]
    assert falling[-1] == "What one more test would add to these 9 cannot be told from nothing."
    assert "it takes at least 5" in sentences(curve_of(campaign, law, (1, 2, 3)))[-1]


def test_an_approach_that_learns_from_no_test_gains_nothing(lawful: LearningCurve) -> None:
    """Asked for the raw CAE model alone, it says so."""
    alone = replace(lawful, config=replace(CONFIG, approaches=("cae",)))
    assert sentences(alone)[-1] == "The raw CAE model learns from no test, so further tests change nothing."
    assert gains(alone) == ()
    assert gains_table(alone).empty


def test_the_summary_counts_every_test_once(lawful: LearningCurve) -> None:
    """Means and standard errors over the tests, quantiles of the single predictions."""
    row = summary(lawful).query("approach == 'fused' and choice == 'even' and n_tests == 4").iloc[0]
    ratings = np.array([law(4, test) for test in range(N)])
    assert row["rating"] == pytest.approx(ratings.mean())
    assert row["error"] == pytest.approx(ratings.std(ddof=1) / 3)
    assert (row["low"], row["high"]) == pytest.approx(tuple(np.quantile(ratings, [0.1, 0.9])))
    assert row["half_width_g"] == pytest.approx(9 / 4)
    assert set(curve_table(lawful)["Approach"]) == {"Fused"}


def test_the_steps_show_a_price_only_where_there_is_a_gain(campaign: Campaign) -> None:
    """Another column with a cost, a dash where the gain is not above its error."""
    curve = curve_of(campaign, lambda s, t: min(s, 2) * 0.1 + (0.001 * (t % 2) if s > 2 else 0) - 0.001 * s, (1, 2, 3))
    table = gains_table(curve, Cost(1000.0))
    assert table["Tests"].tolist() == ["1 → 2", "2 → 3"]
    assert table["Cost of 0.01"].tolist() == ["100", "–"]
    assert "Cost of 0.01" not in gains_table(curve)
