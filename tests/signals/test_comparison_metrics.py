"""Measures beside the rating: a published example, closed forms, and properties."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.signals.metrics import residual_anova, sprague_geers
from crashfuse.signals.pulse import FloatArray

TIME_S = np.linspace(0.0, 2.0, 20001)
SINE = np.sin(2 * np.pi * 3 * np.linspace(0.0, 1.0, 3001))


def arriving(at_s: float, strength: float = 1.0) -> FloatArray:
    """The decaying sine of Geers (1984) and Schwer (2007) that arrives at a time."""
    t = TIME_S - at_s
    return np.where(t >= 0, strength * np.exp(-t) * np.sin(2 * np.pi * t), 0.0)


@pytest.mark.parametrize(
    ("late", "strength", "magnitude", "phase"),
    [(0.14, 1.2, 0.2, 0.0), (0.04, 1.0, 0.0, 0.195), (0.24, 1.0, 0.0, 0.195)],
)
def test_sprague_and_geers_is_that_of_the_published_example(
    late: float, strength: float, magnitude: float, phase: float
) -> None:
    """Schwer, Engineering with Computers 23 (2007): 20 % in magnitude, and a tenth of a second early or late."""
    found = sprague_geers(arriving(0.14), arriving(late, strength))
    assert found["sg_magnitude"] == pytest.approx(magnitude, abs=6e-3)
    assert found["sg_phase"] == pytest.approx(phase, abs=5e-4)
    assert found["sg_comprehensive"] == pytest.approx(np.hypot(found["sg_magnitude"], found["sg_phase"]))


@given(strength=st.floats(0.01, 100), degrees=st.floats(0, 180))
def test_magnitude_and_phase_are_blind_to_each_other(strength: float, degrees: float) -> None:
    """Over whole periods a sine that is k times as strong and φ late has M = k − 1 and P = φ/180°."""
    shifted = strength * np.sin(2 * np.pi * 3 * np.linspace(0.0, 1.0, 3001) - np.radians(degrees))
    found = sprague_geers(SINE, shifted)
    assert found["sg_magnitude"] == pytest.approx(strength - 1, abs=1e-6 * strength)
    assert found["sg_phase"] == pytest.approx(degrees / 180, abs=1e-6)


@given(shift=st.floats(-2, 2), spread=st.floats(0, 2))
def test_residuals_have_the_mean_and_spread_that_were_put_in(shift: float, spread: float) -> None:
    """As shares of the largest reference value; of n values ±s the deviation is s √(n/(n − 1))."""
    reference = 30.0 * SINE / np.abs(SINE).max()
    signs = np.where(np.arange(SINE.size - 1) % 2, 1.0, -1.0)
    found = residual_anova(reference[:-1], reference[:-1] + 30 * (shift + spread * signs))
    assert found["anova_mean"] == pytest.approx(shift, abs=1e-9)
    assert found["anova_deviation"] == pytest.approx(spread * np.sqrt(3000 / 2999), abs=1e-9)


def test_equal_curves_differ_by_nothing_and_none_has_no_phase() -> None:
    """Zero throughout is a magnitude of −1; a phase is not known of it."""
    assert set(residual_anova(SINE, SINE).values()) == {0.0}
    assert sprague_geers(SINE, SINE) == pytest.approx(
        dict.fromkeys(("sg_magnitude", "sg_phase", "sg_comprehensive"), 0)
    )
    found = sprague_geers(SINE, np.zeros_like(SINE))
    assert found["sg_magnitude"] == -1
    assert np.isnan(found["sg_phase"])
