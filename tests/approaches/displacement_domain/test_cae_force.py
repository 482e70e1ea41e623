"""The CAE model's force and its trend, on curves whose mean is known."""

import numpy as np
import pytest

from crashfuse.approaches.displacement_domain.cae_force import CaeForce
from crashfuse.signals.pulse import FloatArray

S = np.linspace(0, 0.6, 121)


def linear(s: FloatArray) -> FloatArray:
    """A force that grows with crush."""
    return np.asarray(-80.0 - 200.0 * s)


def test_the_trend_of_a_curve_without_humps_is_the_curve() -> None:
    """A mean over both sides of a straight line is the line, but for the side missing before contact."""
    force = CaeForce.at(S, linear)
    np.testing.assert_array_equal(force.accel_mps2, linear(S))
    np.testing.assert_allclose(force.trend_mps2[S > 0.3], linear(S)[S > 0.3], atol=0.1)
    constant = CaeForce.at(S, lambda s: np.full_like(s, -120.0))
    np.testing.assert_allclose(constant.trend_mps2, -120.0, rtol=1e-12)


def test_humps_are_not_in_the_trend() -> None:
    """Of folds 0.1 m long hardly anything is left: exp(-(2π 0.08/0.1)²/2), three millionths."""
    force = CaeForce.at(S, lambda s: linear(s) + 50 * np.sin(2 * np.pi * s / 0.1))
    np.testing.assert_allclose(force.trend_mps2[S > 0.3], linear(S)[S > 0.3], atol=0.3)


def test_the_trend_at_a_displacement_does_not_depend_on_the_others_asked_for() -> None:
    """Points of a test that stopped early have the trend of a curve that goes on."""

    def dented(s: FloatArray) -> FloatArray:
        return np.asarray(linear(s) - 60 * np.exp(-(((s - 0.3) / 0.05) ** 2)))

    all_along = CaeForce.at(S, dented).trend_mps2
    np.testing.assert_allclose(CaeForce.at(S[:50], dented).trend_mps2, all_along[:50], rtol=0.003)
    assert CaeForce.at(np.array([0.3]), dented).trend_mps2[0] == pytest.approx(all_along[60], rel=0.003)
