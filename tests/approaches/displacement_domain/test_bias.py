"""The CAE model's force and its trend on curves whose mean is known, and bias points on hand-made pulses."""

import numpy as np
import pytest

from crashfuse.approaches.displacement_domain.bias import BiasDraws, BiasPoints, CaeForce
from crashfuse.cae.model import LoadingCurve
from crashfuse.condition import Condition
from crashfuse.signals.loading_phase import LoadingPhase, loading_phase
from crashfuse.signals.pulse import GRID_S, FloatArray

S = np.linspace(0, 0.6, 121)

SPEED = 10.0
CONDITION = Condition.of_vector([SPEED, 950.0, 700.0])


def linear(s: FloatArray) -> FloatArray:
    return np.asarray(-80.0 - 200.0 * s)


def test_the_trend_of_a_curve_without_humps_is_the_curve() -> None:
    """A mean over both sides of a straight line is the line, but for the side missing before contact."""
    force = CaeForce.at(S, linear)
    np.testing.assert_array_equal(force.accel_mps2, linear(S))
    np.testing.assert_allclose(force.trend_mps2[S > 0.3], linear(S)[S > 0.3], atol=0.1)
    np.testing.assert_allclose(CaeForce.at(S, lambda s: np.full_like(s, -120.0)).trend_mps2, -120.0, rtol=1e-12)


def test_the_trend_at_a_displacement_does_not_depend_on_the_others_asked_for() -> None:
    def dented(s: FloatArray) -> FloatArray:
        return np.asarray(linear(s) - 60 * np.exp(-(((s - 0.3) / 0.05) ** 2)))

    all_along = CaeForce.at(S, dented).trend_mps2
    np.testing.assert_allclose(CaeForce.at(S[:50], dented).trend_mps2, all_along[:50], rtol=0.003)
    assert CaeForce.at(np.array([0.3]), dented).trend_mps2[0] == pytest.approx(all_along[60], rel=0.003)


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_what_a_mean_bias_loses_its_draws_have_as_an_error(share: float) -> None:
    """The mean square of the draws stays, mean² + variance, while the mean is multiplied by the share."""
    draws = 30.0 * np.sin(S / 0.1) + 4.0 * np.random.default_rng(0).standard_normal((20_000, S.size))
    functions = np.vstack([30.0 * np.sin(S / 0.1), draws])
    carried = BiasDraws(functions, functions[:, :3]).widened(1.0, share).over_displacement_mps2
    np.testing.assert_allclose(carried[0], share * functions[0])
    np.testing.assert_allclose(carried[1:].mean(axis=0), share * functions[0], atol=1.0)
    np.testing.assert_allclose((carried[1:] ** 2).mean(axis=0), functions[0] ** 2 + 16, rtol=0.04)


def constant(accel_mps2: float) -> LoadingPhase:
    """Constant braking: stops after v0²/2a."""
    return loading_phase(np.full(1250, accel_mps2), SPEED)


def spring(omega: float) -> LoadingPhase:
    """A linear spring, a = -ω² s: stops after v0/ω."""
    return loading_phase(-SPEED * omega * np.sin(omega * GRID_S), SPEED)


def test_projection_has_both_directions_evenly_spaced_in_time() -> None:
    """CAE brakes with 125, the test with 200 m/s²: s = v0 t - a t²/2 at even times up to each one's end (Eqs. 16-22).

    The test stops first, after 0.25 m; the CAE pulse is projected only as far, where its vehicle has
    v = sqrt(v0² - 2·125·0.25) left.
    """
    points = BiasPoints.projected(CONDITION, constant(-200.0), LoadingCurve(constant(-125.0)), 5)
    test_s = np.linspace(0, 10 / 200, 5)
    cae_s = np.linspace(0, (10 - np.sqrt(100 - 2 * 125 * 0.25)) / 125, 5)
    expected = np.concatenate([10 * test_s - 100 * test_s**2, 10 * cae_s - 62.5 * cae_s**2])
    np.testing.assert_allclose(points.displacement_m, expected, atol=1e-5)
    np.testing.assert_allclose(points.bias_mps2, -75.0)
    np.testing.assert_allclose(points.cae.accel_mps2, -125.0)


def test_projection_interpolates_the_one_at_the_others_displacement() -> None:
    """A test at constant braking against a spring: δ = a + ω² s at the test's and at the CAE's displacements."""
    points = BiasPoints.projected(CONDITION, constant(-200.0), LoadingCurve(spring(20.0)), 40)
    np.testing.assert_allclose(points.bias_mps2, -200.0 + 400.0 * points.displacement_m, atol=0.5)
    assert points.displacement_m.size == 80


def test_points_are_even_in_displacement_and_while_the_vehicle_stops_in_time() -> None:
    """At 10 m/s and 200 m/s² it is at a quarter of its speed after 37.5 ms and 234 mm, and stops at 50 ms and 250 mm.

    With 2.5 ms asked for, points lie at most 25 mm apart up to there, and then 2.5 ms, at v = 2.5, 2, … 0 m/s.
    """
    test = constant(-200.0)
    points = BiasPoints.even(CONDITION, test, LoadingCurve(spring(20.0)), 0.0025, 0.25)
    np.testing.assert_allclose(points.displacement_m[:10], np.linspace(0, 0.234375, 11)[:10], atol=1e-6)
    np.testing.assert_allclose(points.speed_share[10:], [0.25, 0.2, 0.15, 0.1, 0.05, 0], atol=1e-3)
    assert points.displacement_m[-1] == test.crush_m


def test_there_are_about_as_many_points_as_are_allowed() -> None:
    """With ten allowed instead of 16, the 36 ms lie 4 ms apart at most: six steps up to the stop, four in it."""
    points = BiasPoints.even(CONDITION, constant(-200.0), LoadingCurve(spring(20.0)), 0.0025, 0.25, most=10)
    np.testing.assert_allclose(np.diff(points.displacement_m[:7]), 0.234375 / 6, atol=1e-6)
    np.testing.assert_allclose(points.speed_share[6:], np.linspace(0.25, 0, 5), atol=1e-3)


def test_what_a_vehicle_does_while_it_stops_moves_to_where_the_test_stops() -> None:
    """Both let go to half in their last moments, one after 0.25 and one after 0.5 m: half of the bias is left there."""

    def letting_go(accel: float) -> LoadingPhase:
        velocity, pulse = SPEED, []
        for _ in range(1250):
            pulse.append(accel if velocity > 0.2 * SPEED else 0.5 * accel)
            velocity += pulse[-1] / 12_500
        return loading_phase(np.array(pulse), SPEED)

    points = BiasPoints.even(CONDITION, letting_go(-200.0), LoadingCurve(letting_go(-100.0)), 0.001, 0.25)
    np.testing.assert_allclose(points.bias_mps2[points.speed_share > 0.2], -100.0, atol=3.0)
    np.testing.assert_allclose(points.bias_mps2[points.speed_share < 0.2], -50.0, atol=3.0)
