"""Kinematics of a pulse against the closed forms of a half sine and the conservation of energy."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from crashfuse.campaign import Campaign
from crashfuse.errors import DataError
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, FloatArray, Pulse, in_full, kinematics, with_late_stops

DURATION_S = 0.08
PEAK_MPS2 = 400.0


def half_sine(time_s: FloatArray = GRID_S, peak_mps2: float = PEAK_MPS2) -> FloatArray:
    """A braking half sine of 80 ms, zero after it."""
    return np.where(time_s < DURATION_S, -peak_mps2 * np.sin(np.pi * time_s / DURATION_S), 0.0)


DELTA_V_MPS = 2 * PEAK_MPS2 * DURATION_S / np.pi


def test_half_sine_has_the_motion_of_its_closed_form() -> None:
    """s(t) = v0 t − A T/π (t − T/π sin(π t/T)) while it lasts, to the second order of the rule; then v0 − 2 A T/π."""
    motion, inside = kinematics(half_sine(), 15.0, DT_S), GRID_S < DURATION_S
    np.testing.assert_allclose(motion.velocity_mps[~inside], 15.0 - DELTA_V_MPS, atol=1e-4)
    t = GRID_S[inside]
    exact = 15.0 * t - PEAK_MPS2 * DURATION_S / np.pi * (t - DURATION_S / np.pi * np.sin(np.pi * t / DURATION_S))
    np.testing.assert_allclose(motion.displacement_m[inside], exact, atol=1e-6)


@pytest.mark.parametrize("speed_mps", [1.0, DELTA_V_MPS / 2, 15.0])
def test_half_sine_stops_the_vehicle_at_its_closed_form_time(speed_mps: float) -> None:
    """v(t0) = 0 at cos(π t0/T) = 1 − 2 v0/ΔV, found between samples."""
    exact = DURATION_S / np.pi * np.arccos(1 - 2 * speed_mps / DELTA_V_MPS)
    assert Pulse(GRID_S, half_sine()).kinematics(speed_mps).t0_s == pytest.approx(exact, abs=2e-7)


def test_crush_energy_equals_kinetic_energy() -> None:
    """Whatever the pulse, ½ v0² − ½ v² is the area of −a over s, at every sample and to rounding."""
    accel = np.random.default_rng(0).normal(-200, 300, N_SAMPLES)
    motion = kinematics(accel, 15.0, DT_S)
    work = np.cumsum(-(accel[1:] + accel[:-1]) / 2 * np.diff(motion.displacement_m))
    np.testing.assert_allclose(work, (15.0**2 - motion.velocity_mps[1:] ** 2) / 2, atol=1e-9)


def test_draws_are_integrated_as_if_alone() -> None:
    """Leading axes are kept: velocity and displacement (…, n), t0 (…), each row by itself."""
    draws = half_sine() * np.linspace(0.7, 1.3, 6).reshape(2, 3, 1)
    motion = kinematics(draws, 12.0, DT_S)
    assert motion.velocity_mps.shape == motion.displacement_m.shape == (2, 3, N_SAMPLES)
    assert motion.t0_s.shape == (2, 3)
    alone = kinematics(draws[1, 2], 12.0, DT_S)
    np.testing.assert_array_equal(motion.displacement_m[1, 2], alone.displacement_m)
    assert motion.t0_s[1, 2] == alone.t0_s


def test_vehicle_that_never_stops_has_no_t0() -> None:
    """t0 is NaN where the pulse takes less than the speed, beside draws that do stop."""
    t0_s = kinematics(half_sine() * np.array([[0.5], [1.0]]), 0.9 * DELTA_V_MPS, DT_S).t0_s
    assert np.isnan(t0_s[0])
    assert 0 < t0_s[1] < DURATION_S


def test_pulse_keeps_its_own_read_only_copy() -> None:
    accel = half_sine()
    pulse = Pulse(GRID_S, accel)
    accel[100] = 7
    assert pulse.accel_mps2[100] == half_sine()[100]
    with pytest.raises(ValueError, match="read-only"):
        pulse.accel_mps2[0] = 1
    with pytest.raises(FrozenInstanceError):
        pulse.accel_mps2 = accel  # type: ignore[misc]


@pytest.mark.parametrize(
    ("time_s", "accel", "found"),
    [
        ([0, 1, 2], [0, 1], r"time of shape \(3,\) and acceleration of shape \(2,\)"),
        ([0], [1], r"time of shape \(1,\)"),
        ([[0, 1]], [[0, 1]], r"shape \(1, 2\)"),
        ([0, 1, 2], [0, np.nan, 1], "not finite"),
        ([0, np.inf, 2], [0, 1, 1], "not finite"),
        ([0, 2, 1], [0, 1, 1], "time steps from -1 to 2 s"),
        ([0, 1, 1], [0, 1, 1], "time steps from 0 to 1 s"),
        ([0, 1, 3], [0, 1, 1], "time steps from 1 to 2 s"),
    ],
)
def test_what_is_no_pulse_is_refused(time_s: list[float], accel: list[float], found: str) -> None:
    """Unequal lengths, a single sample, holes, time that stands still, runs back or is uneven say so."""
    with pytest.raises(DataError, match=found):
        Pulse(np.array(time_s), np.array(accel))


def test_constant_braking_cut_before_the_stop_goes_on_at_half_its_rate() -> None:
    """From a speed v left at the end: a stop 2 v/a later and v²/a further, where a crash at a takes v/a and v²/2a."""
    rates, end = np.array([135.0, 149.0]), GRID_S[-1]
    motion = with_late_stops(kinematics(np.outer(-rates, np.ones(N_SAMPLES)), 15.0, DT_S))
    left = 15.0 - rates * end
    np.testing.assert_allclose(motion.t0_s, end + 2 * left / rates)
    np.testing.assert_allclose(motion.crush_m, 15.0**2 / (2 * rates) + left**2 / (2 * rates))


def test_a_vehicle_with_a_quarter_of_its_speed_left_is_not_known_to_stop() -> None:
    """At a constant rate from 15 m/s: with 3.7 m/s left it stops beyond the record, with 3.8 m/s nobody can tell."""
    left = np.array([3.7, 3.8])
    motion = kinematics(np.outer((left - 15.0) / GRID_S[-1], np.ones(N_SAMPLES)), 15.0, DT_S)
    assert np.isnan(motion.t0_s).all()
    late = with_late_stops(motion)
    assert np.isfinite(late.t0_s).tolist() == np.isfinite(late.crush_m).tolist() == [True, False]


def test_crashes_cut_anywhere_stop_within_what_they_are_given(campaign: Campaign) -> None:
    """Each test of the sample, cut at a share of its speed, stops no later and crushes no more than the rule says."""
    for test in campaign.tests:
        whole = test.pulse.kinematics(test.condition.speed_mps)
        for share in (0.24, 0.1, 0.02):
            by = int((whole.velocity_mps < share * test.condition.speed_mps).argmax()) + 1
            cut = with_late_stops(kinematics(test.pulse.accel_mps2[:by], test.condition.speed_mps, DT_S))
            assert whole.t0_s < cut.t0_s < 2 * whole.t0_s
            assert whole.crush_m < cut.crush_m < 1.15 * whole.crush_m


@pytest.mark.parametrize("stride", [10, 20])
def test_it_is_the_cubic_spline_through_the_samples(stride: int) -> None:
    sequences = np.random.default_rng(0).normal(size=(3, len(GRID_S[::stride])))
    expected = CubicSpline(GRID_S[::stride], sequences, axis=1)(GRID_S)
    np.testing.assert_allclose(in_full(sequences, stride), expected, atol=1e-12)
    np.testing.assert_allclose(in_full(sequences[0], stride), expected[0], atol=1e-12)
