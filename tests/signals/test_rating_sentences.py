"""A rating in words: each sentence follows from pulses of known fault, in the reader's units."""

import numpy as np

from crashfuse.signals.rating_explanation import explain_rating
from crashfuse.signals.rating_sentences import rating_sentences
from crashfuse.units import G
from crashfuse.wording import UnitSystem
from tests.signals.test_rating_explanation import TEST, TIME_S, bump, pulse


def test_a_late_pulse_is_told_to_be_moved_earlier() -> None:
    """By 3 ms, at all of its humps; nothing else is wrong once it is moved."""
    late = np.interp(TIME_S - 0.003, TIME_S, TEST)
    said = rating_sentences(explain_rating(pulse(TEST), pulse(late), 70.0))
    assert said["phase"].startswith(
        "Phase 0.79 (costs 0.043): the prediction correlates best with the test when moved 3.0"
    )
    assert "moved 3.0 ms earlier; that gains most at the" in said["phase"]
    assert "which comes 3.0 ms late in the prediction" in said["phase"]
    assert ": shifted and warped, " in said["magnitude"]
    assert ": shifted, the slope" in said["slope"]
    assert said["overall"].startswith("0.7")
    assert ": corridor costs most, " in said["overall"]


def test_a_hump_that_is_missing_and_one_out_of_place_are_named() -> None:
    """The second of three comes about 4 ms early (tails of the others add to it), the third not at all."""
    early = bump(15, 200) + bump(29, 250)
    said = rating_sentences(explain_rating(pulse(TEST), pulse(early), 70.0), "comparison")
    early_ms = 1e3 * (TIME_S[TEST.argmin()] - TIME_S[early.argmin()])
    assert f"second hump of the test (33.0 ms), which comes {early_ms:.1f} ms early in the comparison" in said["phase"]
    assert "third hump" in said["magnitude"]
    assert "too weak" in said["magnitude"]
    assert "the comparison" in said["slope"]


def test_where_most_of_the_corridor_is_lost_is_told_in_the_readers_unit() -> None:
    """20 to 25 ms, where the pulse is 10 g too weak; in m/s² if those are wanted."""
    off = np.where((TIME_S >= 0.0199999) & (TIME_S < 0.0249999), 10 * G, 0.0)
    text = rating_sentences(explain_rating(pulse(TEST), pulse(TEST + off), 70.0))["corridor"]
    assert "for 5.0 ms of 70, never outside the outer" in text
    assert text.endswith("most is lost from 20.0 to 25.0 ms, where it is up to 10.0 g too weak.")
    assert text.in_units(UnitSystem(acceleration="m/s²")).endswith("where it is up to 98.1 m/s² too weak.")


def test_a_perfect_match_loses_nothing() -> None:
    """And no shift is better than none."""
    said = rating_sentences(explain_rating(pulse(TEST), pulse(TEST), 70.0))
    assert said["overall"] == "1.000 (Excellent) over 0–70 ms: nothing is lost."
    assert said["phase"] == "Phase 1.00 (costs 0.000): no shift of the prediction correlates better with the test."
    assert "stays inside the inner corridor" in said["corridor"]
    assert ": warped, " in said["magnitude"]  # where nothing is shifted, nothing is said to be
    assert ": the slope" in said["slope"]
