"""The shape of a pulse and its rebound against closed forms: square, two steps, half sine, haversine."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from crashfuse.signals import pulse_shape
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Kinematics, kinematics
from crashfuse.units import G
from tests.conftest import SHARED, needs_shared

SPEED_MPS = 15.0
DURATION_S = 0.08


def moved(accel_mps2: FloatArray, speed_mps: float = SPEED_MPS, dt_s: float = DT_S) -> Kinematics:
    """The motion from 15 m/s."""
    return kinematics(accel_mps2, speed_mps, dt_s)


def steps(g1: float, g2: float, step_s: float, dt_s: float = 1e-5) -> Kinematics:
    """From 15 m/s, g1 until the step and g2 after it, over 150 ms."""
    time = np.arange(round(0.15 / dt_s)) * dt_s
    accel = np.where(time < step_s - dt_s / 2, -g1 * G, -g2 * G)
    accel[round(step_s / dt_s)] = -(g1 + g2) / 2 * G  # so that the trapezoidal rule is exact at the step
    return moved(accel, dt_s=dt_s)


def half_sine(share: float) -> FloatArray:
    """A half sine of 80 ms that takes this share of 15 m/s away."""
    peak = share * SPEED_MPS * np.pi / (2 * DURATION_S)
    return np.where(GRID_S < DURATION_S, -peak * np.sin(np.pi * GRID_S / DURATION_S), 0.0)


def haversine(share: float) -> FloatArray:
    """A haversine of 80 ms that takes this share of 15 m/s away."""
    peak = share * SPEED_MPS * 2 / DURATION_S
    return np.where(GRID_S < DURATION_S, -peak * np.sin(np.pi * GRID_S / DURATION_S) ** 2, 0.0)


@pytest.mark.parametrize(("g1", "g2", "step_s"), [(10.0, 30.0, 0.03), (30.0, 10.0, 0.02), (12.0, 18.0, 0.04)])
def test_two_steps_are_their_own_two_step_pulse(g1: float, g2: float, step_s: float) -> None:
    """T = t1 + v1/G2, C = v0 t1 − G1 t1²/2 + v1²/2 G2; ESW, centroid time and halves follow from these."""
    motion = steps(g1, g2, step_s)
    v1 = SPEED_MPS - g1 * G * step_s
    end = step_s + v1 / (g2 * G)
    crush = SPEED_MPS * step_s - g1 * G * step_s**2 / 2 + v1**2 / (2 * g2 * G)
    assert pulse_shape.two_step(motion).g1_mps2 == pytest.approx(g1 * G, rel=2e-4)
    assert pulse_shape.two_step(motion).g2_mps2 == pytest.approx(g2 * G, rel=2e-4)
    assert pulse_shape.two_step(motion).time_s == pytest.approx(step_s, abs=1e-9)
    assert pulse_shape.equivalent_square_wave(motion) == pytest.approx(SPEED_MPS**2 / 2 / crush, rel=1e-5)
    assert pulse_shape.centroid_time(motion) == pytest.approx(crush / SPEED_MPS, rel=1e-5)
    half = end / 2
    lost = (g1 * min(half, step_s) + g2 * max(half - step_s, 0.0)) * G
    assert pulse_shape.loading_ratio(motion) == pytest.approx(lost / (SPEED_MPS - lost), rel=1e-5)
    assert (pulse_shape.loading_ratio(motion) > 1) == (g1 > g2)


def test_centroid_is_that_of_the_area_under_the_pulse() -> None:
    """∫ a t dt / ∫ a dt up to the time of zero velocity, summed sample by sample, for a pulse of random waves."""
    rng = np.random.default_rng(1)
    accel = -25 * G * (1 + 0.3 * sum(rng.normal() * np.sin(2 * np.pi * f * GRID_S) for f in (20, 35, 60, 90)))
    motion = moved(accel)
    until = motion.t0_s >= GRID_S
    expected = (accel * GRID_S)[until].sum() / accel[until].sum()
    assert pulse_shape.centroid_time(motion) == pytest.approx(expected, rel=2e-3)


def test_a_half_sine_has_the_steps_that_a_general_minimiser_finds() -> None:
    """Stopped at its end, v = v0 (1 + cos(π t/T))/2; SciPy minimises the squares left by the means of both parts."""
    motion = moved(half_sine(1.000003))

    def left(x: float) -> float:
        v = (1 + np.cos(np.pi * x)) / 2
        return float(-((1 - v) ** 2 / x + v**2 / (1 - x)))

    best = minimize_scalar(left, bounds=(0.05, 0.5), method="bounded").x
    at = (1 + np.cos(np.pi * best)) / 2
    found = pulse_shape.two_step(motion)
    smaller, larger = (1 - at) / best, at / (1 - best)
    first = found.time_s < DURATION_S / 2  # its mirror image is as near
    expected = (best, smaller, larger) if first else (1 - best, larger, smaller)
    assert found.time_s / DURATION_S == pytest.approx(expected[0], abs=4e-3)
    assert found.g1_mps2 * DURATION_S / SPEED_MPS == pytest.approx(expected[1], rel=5e-3)
    assert found.g2_mps2 * DURATION_S / SPEED_MPS == pytest.approx(expected[2], rel=5e-3)


@pytest.mark.parametrize("pulse", [half_sine, haversine])
@pytest.mark.parametrize("restitution", [0.05, 0.15, 0.3])
def test_rebound_of_a_smooth_pulse_has_its_closed_form(pulse: type, restitution: float) -> None:
    """A pulse symmetric about T/2 that takes (1 + e) v0 away leaves at −e v0, after s(T) = v0 T (1 − e)/2."""
    motion = moved(pulse(1 + restitution))
    assert pulse_shape.restitution(motion) == pytest.approx(restitution, abs=5e-4)
    assert pulse_shape.rebound_velocity(motion) == pytest.approx(restitution * SPEED_MPS, abs=5e-3)
    rest = 3e-3 * restitution * SPEED_MPS  # 0.5 g are reached up to 3 ms before the end
    crush = SPEED_MPS * DURATION_S * (1 - restitution) / 2
    assert crush <= pulse_shape.static_crush(motion) <= crush + rest


def test_rebound_that_the_record_cuts_off_is_not_determined() -> None:
    """Cut between the stop and 2 ms after the deceleration has ended, or padded: larger rebound, less static crush."""
    accel = half_sine(1.15)
    cut = [accel[: round(end_s / DT_S)] for end_s in (0.07, 0.075, 0.0795, 0.081)]
    for motion in map(moved, [*cut, np.where(GRID_S < 0.074, accel, 0.0)]):
        assert np.isfinite(motion.t0_s)
        assert pulse_shape.rebound_velocity(motion) == np.inf
        assert pulse_shape.restitution(motion) == np.inf
        assert pulse_shape.static_crush(motion) == -np.inf
    assert np.isfinite(pulse_shape.static_crush(moved(accel[: round(0.083 / DT_S)])))


def test_vehicle_that_does_not_stop_has_no_shape() -> None:
    """Softer than any square wave, later than any centroid; steps, ratio and rebound are unknown."""
    motion = moved(half_sine(0.5))
    assert pulse_shape.equivalent_square_wave(motion) == -np.inf
    assert pulse_shape.centroid_time(motion) == np.inf
    assert np.isnan(pulse_shape.two_step(motion)).all()
    for unknown in ("loading_ratio", "static_crush", "rebound_velocity"):
        assert np.isnan(getattr(pulse_shape, unknown)(motion)), unknown


def test_many_pulses_have_the_shapes_of_each() -> None:
    """Draws of shape (3, n), one of which does not stop."""
    draws = np.array([half_sine(1.1), haversine(1.2), half_sine(0.5)])
    together = moved(draws)
    steps = [pulse_shape.two_step(moved(draw)) for draw in draws]
    np.testing.assert_array_equal(np.transpose(pulse_shape.two_step(together)), steps)
    names = ("equivalent_square_wave", "centroid_time", "loading_ratio")
    for name in (*names, "static_crush", "rebound_velocity", "restitution", "moves_freely"):
        of = getattr(pulse_shape, name)
        np.testing.assert_array_equal(of(together), [of(moved(draw)) for draw in draws])


@pytest.mark.parametrize(("share_of_limit", "free"), [(0.0, True), (0.99, True), (1.01, False)])
def test_a_vehicle_moves_freely_if_it_loses_less_than_a_twentieth_of_its_loss_in_the_last_10_ms(
    share_of_limit: float, free: bool
) -> None:
    """Stopped at 50 ms, braked by d until 100 ms: 10 ms · d is less than 5 % of v0 + 50 ms · d if d < v0/150 ms."""
    later = share_of_limit * SPEED_MPS / 0.15 + 1e-6  # exact zeros would be no record
    accel = np.where(np.arange(10_001) < 5000, -SPEED_MPS / 0.05, -later)
    accel[5000] = -(SPEED_MPS / 0.05 + later) / 2  # so that the trapezoidal rule is exact at the step
    assert pulse_shape.moves_freely(moved(accel, dt_s=1e-5)) == free


def test_ringing_leaves_a_vehicle_free_and_what_throws_it_off_does_not() -> None:
    """A half sine with ±10 g at 300 Hz, never quiet for 2 ms: free. Cut while it is thrown off, or padded then: not."""
    motion = moved(half_sine(1.15) + 10 * G * np.sin(2 * np.pi * 300 * GRID_S))
    assert pulse_shape.rebound_velocity(motion) == np.inf
    assert pulse_shape.moves_freely(motion)
    assert not pulse_shape.moves_freely(moved(half_sine(1.15)[: round(0.076 / DT_S)]))
    assert not pulse_shape.moves_freely(moved(np.where(GRID_S < 0.074, half_sine(1.15), 0.0)))


@needs_shared
def test_rebound_of_a_real_car_does_not_depend_on_the_length_of_the_record() -> None:
    """NHTSA 10146, all four sensors: the same in 100 as in 200 ms, although the cell goes on oscillating."""
    table = np.genfromtxt(
        SHARED / "real" / "nhtsa_10146_camry2018" / "tidy_10kHz_raw_and_cfc60.csv", delimiter=",", names=True
    )
    for side in "LR":
        for rank in ("primary", "redundant"):
            recorded = table[f"floor_{side}_rear_xmember_X_{rank}_cfc60_g"][table["t_s"] >= 0] * G
            short, whole = (moved(recorded[:n], 57.09 / 3.6, 1e-4) for n in (1000, 2000))
            for name in ("restitution", "static_crush", "rebound_velocity"):
                assert getattr(pulse_shape, name)(short) == getattr(pulse_shape, name)(whole)
            assert 0.15 < pulse_shape.restitution(whole) < 0.175
            assert 0.68 < pulse_shape.static_crush(whole) < 0.72
            assert 0.3 < pulse_shape.loading_ratio(whole) < 0.8  # back-loaded, as most cars are
