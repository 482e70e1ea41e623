"""Colours can be told apart and read, by the colour-blind too."""

import numpy as np

from crashfuse.approaches import APPROACHES
from crashfuse.plots import palette


def luminance(colour: str) -> float:
    """Relative luminance (WCAG 2.1)."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


def test_every_approach_has_a_colour_of_its_own_that_shows_on_white() -> None:
    """WCAG 2.1 asks for a contrast of 3 for lines."""
    colours = [palette.COLOURS[name] for name in APPROACHES]
    assert len(set(colours)) == len(colours)
    assert min(1.05 / (luminance(colour) + 0.05) for colour in colours) >= 3


def test_black_text_reads_on_every_grade() -> None:
    """WCAG 2.1 asks for a contrast of 4.5 for text."""
    assert min((luminance(colour) + 0.05) / 0.05 for colour in palette.GRADE_COLOURS.values()) >= 4.5
