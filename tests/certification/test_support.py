"""What confidence a number of verdicts supports: exact bounds, the expected share, and how it is told."""

import pytest
from scipy.stats import binom

from crashfuse.certification.support import Support, largest_share, share_bounds


@pytest.mark.parametrize(("count", "n"), [(0, 11), (1, 11), (5, 20), (11, 11)])
def test_bounds_of_a_share_are_exact(count: int, n: int) -> None:
    """At the bounds, what was seen or something more extreme has just the probability of the tail."""
    lower, upper = share_bounds(count, n)
    if count:
        assert binom.sf(count - 1, n, lower) == pytest.approx(0.025)
    if count < n:
        assert binom.cdf(count, n, upper) == pytest.approx(0.025)
        assert binom.cdf(count, n, largest_share(count, n)) == pytest.approx(0.05)
    assert (lower == 0) == (count == 0)
    assert (upper == 1) == (count == n)


def test_none_wrong_of_59_bounds_the_share_at_five_per_cent() -> None:
    """The rule of three, exactly."""
    assert largest_share(0, 59) < 0.05 < largest_share(0, 58)


@pytest.mark.parametrize(("decided", "wrong", "supports"), [(9, 0, True), (8, 0, False), (29, 1, True), (28, 1, False)])
def test_a_record_supports_the_confidence_that_it_makes_likely(decided: int, wrong: int, supports: bool) -> None:
    """Jeffreys' mean of the share of right verdicts reaches 0.95 with nine of nine, or 28 of 29."""
    support = Support(decided, wrong, decided, wrong, near=True)
    assert support.confidence == pytest.approx(1 - (wrong + 0.5) / (decided + 1))
    said = support.shortfall(0.95)
    assert (said is None) is supports
    if said is not None:
        needed = 9 if wrong == 0 else 29
        assert f"take {needed} verdicts with no more than {wrong} wrong" in said
        assert f"({wrong} of {decided} verdicts wrong, at most 5 a test)" in said


@pytest.mark.parametrize(("decided", "wrong", "confidence"), [(47, 0, 0.99), (8, 0, 0.95), (28, 1, 0.95)])
def test_the_confidence_that_falls_short_is_never_shown_as_the_one_asked_for(
    decided: int, wrong: int, confidence: float
) -> None:
    """47 verdicts without a wrong one support 0.9896, which rounds to the 0.99 that they do not support."""
    said = Support(decided, wrong, decided, wrong, near=True).shortfall(confidence)
    assert said is not None
    shown = float(said.partition("supports a confidence of ")[2].partition(", not")[0])
    assert shown < confidence
    assert shown == pytest.approx(1 - (wrong + 0.5) / (decided + 1), abs=5e-4)


def test_few_verdicts_of_its_own_are_told_with_what_they_can_show() -> None:
    """Two right ones do not support 0.95, though with fifty on other criteria they do; nine do, alone."""
    said = Support(52, 0, own_decided=2, own_wrong=0, near=True).reservation(0.95)
    assert said is not None
    assert said.startswith(
        "Only 2 verdicts on this metric, one a test, 0 wrong (at most 78 %): too few to support the confidence"
    )
    assert said.endswith("; with those on other criteria, at most 5 a test, 0 of 52 wrong.")
    none = Support(50, 0, own_decided=0, own_wrong=0, near=True).reservation(0.95)
    assert none is not None
    assert none.startswith("No verdict on this metric was held against a test; with those on other criteria, at most 5")
    assert Support(50, 0, own_decided=9, own_wrong=0, near=True).reservation(0.95) is None
    many = Support(200, 3, own_decided=30, own_wrong=3, near=True).reservation(0.95)
    assert many is not None
    assert many.startswith(
        "3 of 30 verdicts on this metric, one a test, wrong (at most 24 %): too many to support the confidence alone;"
    )


@pytest.mark.parametrize(
    ("wrong", "n", "refuted"), [(1, 2, False), (2, 8, False), (2, 7, True), (3, 12, True), (0, 9, False)]
)
def test_right_verdicts_on_others_do_not_make_up_for_its_own_wrong_ones(wrong: int, n: int, refuted: bool) -> None:
    """Two of seven are too many for 0.95, as fewer than one in twenty of such records would have as many."""
    support = Support(500, wrong, n, wrong, near=True)
    assert bool(binom.sf(wrong - 1, n, 0.05) < 0.05) is refuted
    said = support.shortfall(0.95)
    assert (said is not None) is refuted
    if said is not None:
        assert said.startswith(f"{wrong} of {n} verdicts on this metric, one a test, were wrong: that refutes")
    before = Support(500, wrong, 0, 0, near=True, before=n, wrong_before=wrong).shortfall(0.95)
    assert (before is not None) is refuted
