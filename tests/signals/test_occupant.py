"""The two occupant models against closed forms, against an independent integrator, and at the record's end."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from crashfuse.errors import UsageError
from crashfuse.signals.occupant import OccupantModel, occupant_load_criterion, vehicle_pulse_index
from crashfuse.signals.pulse import DT_S, FloatArray, kinematics
from crashfuse.units import G

SPEED_MPS = 15.0

Measure = Callable[..., FloatArray]


def time_of(duration_s: float, dt_s: float = DT_S) -> FloatArray:
    """Times from 0 to a duration."""
    return np.arange(round(duration_s / dt_s) + 1) * dt_s


def olc(accel_mps2: FloatArray, dt_s: float = DT_S) -> FloatArray:
    """OLC of acceleration from 15 m/s."""
    motion = kinematics(accel_mps2, SPEED_MPS, dt_s)
    return occupant_load_criterion(motion.velocity_mps, motion.displacement_m, dt_s)


def vpi(accel_mps2: FloatArray, dt_s: float = DT_S) -> FloatArray:
    """VPI of acceleration from 15 m/s."""
    motion = kinematics(accel_mps2, SPEED_MPS, dt_s)
    return vehicle_pulse_index(motion.velocity_mps, motion.displacement_m, dt_s)


def half_sine(time_s: FloatArray, duration_s: float = 0.08) -> FloatArray:
    """A half sine that takes 16.5 m/s away."""
    peak = 1.1 * SPEED_MPS * np.pi / (2 * duration_s)
    return np.where(time_s < duration_s, -peak * np.sin(np.pi * time_s / duration_s), 0.0)


@pytest.mark.parametrize(
    "occupant", [OccupantModel(), OccupantModel(50, 200, vpi_slack_mm=0), OccupantModel(50, 150, 50, 4000)]
)
def test_constant_braking_has_the_closed_forms_of_its_occupant(occupant: OccupantModel) -> None:
    """At a constant a, OLC = a (flight + restraint)/restraint, and VPI = a (1 + √(1 + 2·slack·k/(m·a)))."""
    motion = kinematics(np.full(time_of(0.15).size, -25 * G), SPEED_MPS, DT_S)
    restraint, slack_m = occupant.olc_restraint_mm, occupant.vpi_slack_mm / 1e3
    moved = motion.velocity_mps, motion.displacement_m, DT_S, occupant
    olc, vpi = occupant_load_criterion(*moved), vehicle_pulse_index(*moved)
    assert olc == pytest.approx(25 * G * (occupant.olc_free_flight_mm + restraint) / restraint, rel=1e-5)
    assert vpi == pytest.approx(
        25 * G * (1 + np.sqrt(1 + 2 * slack_m * occupant.vpi_stiffness_npm / (25 * G))), rel=1e-5
    )


def test_vpi_of_a_half_sine_is_that_of_an_adaptive_integrator() -> None:
    """SciPy's Runge-Kutta at 1e-10 on the closed-form motion of the vehicle finds the same peak."""
    rate, peak = np.pi / 0.08, 1.1 * SPEED_MPS * np.pi / 0.16

    def vehicle(t: float) -> float:
        loaded = min(t, 0.08)
        displacement = SPEED_MPS * loaded - peak / rate * (loaded - np.sin(rate * loaded) / rate)
        return float(displacement - 0.1 * SPEED_MPS * (t - loaded))

    def motion(t: float, state: FloatArray) -> list[float]:
        return [state[1], -2500 * max(state[0] - vehicle(t) - 0.03, 0.0)]

    solution = solve_ivp(motion, (0, 0.12), [0.0, SPEED_MPS], rtol=1e-10, atol=1e-12, max_step=1e-4)
    expected = max(-motion(t, y)[1] for t, y in zip(solution.t, solution.y.T, strict=True))
    assert vpi(half_sine(time_of(0.12))) == pytest.approx(expected, rel=1e-5)


def test_olc_of_a_half_sine_brings_the_occupant_to_the_vehicle_after_300_mm() -> None:
    """Simulated on its own with the OLC as brake after 65 mm, the occupant has the vehicle's velocity at 300 mm."""
    dt_s = 1e-5
    time = time_of(0.15, dt_s)
    accel = half_sine(time)
    vehicle = kinematics(accel, SPEED_MPS, dt_s)
    free = SPEED_MPS * time - vehicle.displacement_m < 0.065
    occupant = kinematics(np.where(free, 0.0, -float(olc(accel, dt_s))), SPEED_MPS, dt_s)
    met = int(np.argmax(~free & (occupant.velocity_mps <= vehicle.velocity_mps)))
    assert occupant.displacement_m[met] - vehicle.displacement_m[met] == pytest.approx(0.3, abs=2e-4)


@pytest.mark.parametrize("measure", [olc, vpi])
def test_many_pulses_at_once_are_as_one_by_one(measure: Measure) -> None:
    """Leading axes are kept, and each pulse has its own number."""
    pulses = np.array([half_sine(time_of(0.14), duration) for duration in np.linspace(0.05, 0.1, 6)])
    together = measure(pulses.reshape(2, 3, -1))
    assert together.shape == (2, 3)
    np.testing.assert_allclose(together.ravel(), [measure(pulse) for pulse in pulses], rtol=1e-12)


@pytest.mark.parametrize("end_s", [0.081, 0.09, 0.099])
def test_a_vehicle_that_has_left_the_barrier_has_the_olc_of_the_whole_record(end_s: float) -> None:
    """From 80 ms on nothing moves a half sine's vehicle any more; slower than 15 m/s, its OLC takes until 102 ms."""
    whole, cut = (kinematics(0.6 * half_sine(time_of(end)), 0.6 * SPEED_MPS, DT_S) for end in (0.15, end_s))
    expected = occupant_load_criterion(whole.velocity_mps, whole.displacement_m, DT_S)
    assert np.isnan(occupant_load_criterion(cut.velocity_mps, cut.displacement_m, DT_S))
    found = occupant_load_criterion(cut.velocity_mps, cut.displacement_m, DT_S, free=True)
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("measure", [olc, vpi])
def test_record_that_ends_too_early_has_no_number(measure: Measure) -> None:
    """Cut ever later, a pulse has no number at first, and from some time on always the same."""
    pulse = half_sine(time_of(0.15))
    found = np.array([measure(pulse[:n]) for n in range(100, pulse.size, 50)])
    known = np.isfinite(found)
    first = int(known.argmax())
    assert first > 0
    assert known[first:].all()
    np.testing.assert_allclose(found[first:], measure(pulse), rtol=1e-12)


def test_an_occupant_whom_a_free_vehicle_outruns_has_no_olc() -> None:
    """A draw of a slow crash may leave faster than it came, or as fast: nothing ever stops the occupant there."""
    dip = 0.8 * (1 - np.linspace(-1, 1, 1250) ** 2)
    velocity = np.array([0.9 - dip + gain for gain in (np.linspace(0, 0.3, 1250), np.zeros(1250))])
    displacement = np.cumsum(velocity, axis=-1) * DT_S
    free = np.ones(2, dtype=bool)
    occupant = OccupantModel(olc_free_flight_mm=20, olc_restraint_mm=235)
    assert np.isnan(occupant_load_criterion(velocity, displacement, DT_S, occupant, free)).all()


@pytest.mark.parametrize(("length", "said"), [(0.065, "write 65"), (1000.1, "between 0 and 1000"), (-1, "between")])
def test_a_length_in_m_is_refused_with_the_likely_one(length: float, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        OccupantModel(olc_free_flight_mm=length)
    assert [OccupantModel(olc_free_flight_mm=mm).olc_free_flight_mm for mm in (0, 1, 1000)] == [0, 1, 1000]


def test_unusual_settings_are_told() -> None:
    assert OccupantModel(olc_restraint_mm=200).olc_words == "65 + 200 mm"
    assert OccupantModel(vpi_slack_mm=20).vpi_words == "20 mm, 2500 N/m"
    assert [OccupantModel(olc_restraint_mm=mm).vpi_words for mm in (200, 235)] == ["", ""]
    assert OccupantModel().words == "the usual one"
