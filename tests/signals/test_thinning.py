"""Pulses thinned out and back."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from crashfuse.signals.pulse import GRID_S
from crashfuse.signals.thinning import in_full


@pytest.mark.parametrize("stride", [10, 20])
def test_it_is_the_cubic_spline_through_the_samples(stride: int) -> None:
    """For one pulse and for many."""
    sequences = np.random.default_rng(0).normal(size=(3, len(GRID_S[::stride])))
    expected = CubicSpline(GRID_S[::stride], sequences, axis=1)(GRID_S)
    np.testing.assert_allclose(in_full(sequences, stride), expected, atol=1e-12)
    np.testing.assert_allclose(in_full(sequences[0], stride), expected[0], atol=1e-12)


def test_a_cfc_60_pulse_comes_back_from_every_tenth_sample() -> None:
    """A sine of 100 Hz, the corner of the filter, to two thousandths of its peak."""
    pulse = np.sin(2 * np.pi * 100 * GRID_S)
    np.testing.assert_allclose(in_full(pulse[::10], 10)[:1240], pulse[:1240], atol=2e-3)
