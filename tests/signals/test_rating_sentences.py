"""A rating in words: each sentence follows from pulses of known fault, in the reader's units."""

import numpy as np

from crashfuse.signals.rating_explanation import explain_rating
from crashfuse.signals.rating_sentences import rating_sentences
from crashfuse.units import G
from crashfuse.wording import UnitSystem
from tests.golden import assert_golden
from tests.signals.test_rating_explanation import TEST, TIME_S, bump, pulse

CASES = {
    "3 ms late": np.interp(TIME_S - 0.003, TIME_S, TEST),
    "the second of three humps 4 ms early, the third not at all": bump(15, 200) + bump(29, 250),
    "10 g too weak from 20 to 25 ms": TEST + np.where((TIME_S > 0.01995) & (TIME_S < 0.02495), 10 * G, 0.0),
    "equal": TEST,
}


def test_each_fault_is_told() -> None:
    """With what it costs, its time and its size."""
    told = {name: rating_sentences(explain_rating(pulse(TEST), pulse(own), 70.0)) for name, own in CASES.items()}
    assert_golden(
        "rating_sentences", (f"{name}: {part}: {said}" for name, of in told.items() for part, said in of.items())
    )
    text = told["10 g too weak from 20 to 25 ms"]["corridor"]
    assert text.in_units(UnitSystem(acceleration="m/s²")).endswith("where it is up to 98.1 m/s² too weak.")
