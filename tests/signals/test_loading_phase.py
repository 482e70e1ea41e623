"""The loading phase and the energy-crush curve, against closed forms."""

import numpy as np
import pytest

from crashfuse.signals.loading_phase import energy_crush, loading_phase
from crashfuse.signals.pulse import DT_S, GRID_S
from crashfuse.units import G
from tests.conftest import not_none
from tests.signals.test_metrics import DELTA_V_MPS, DURATION_S, HALF_SINE


def test_constant_braking_has_the_closed_form_t0_and_crush() -> None:
    """At constant deceleration a the vehicle stops after v0/a, at v0²/2a."""
    phase = loading_phase(np.full(1250, -200.0), 13.37)
    assert phase.t0_s == pytest.approx(13.37 / 200)
    assert phase.end_s == phase.t0_s
    assert phase.crush_m == pytest.approx(13.37**2 / 400)


def test_a_linear_spring_is_linear_over_displacement() -> None:
    """a(t) = -v0 ω sin ωt is a = -ω² s, up to where it stops, v0/ω."""
    omega, speed = 25.0, 10.0
    phase = loading_phase(-speed * omega * np.sin(omega * GRID_S), speed)
    s = np.linspace(0.0, 0.999 * speed / omega, 50)
    np.testing.assert_allclose(phase.accel_at(s), -(omega**2) * s, atol=0.1)
    assert phase.crush_m == pytest.approx(speed / omega, rel=1e-4)


def test_displacement_at_a_share_of_the_speed_follows_energy() -> None:
    """At constant deceleration v/v0 = sqrt(1 - s/crush)."""
    phase = loading_phase(np.full(1250, -200.0), 10.0)
    assert phase.displacement_at_speed(0.25) == pytest.approx((1 - 0.25**2) * phase.crush_m, rel=1e-3)
    assert phase.displacement_at_speed(0.0) == phase.crush_m


@pytest.mark.parametrize("speed", [0.4, 3.0, 10.0, 13.0])
def test_displacement_only_grows(speed: float) -> None:
    phase = loading_phase(-300 * np.sin(np.pi * GRID_S / 0.07), speed)
    assert (np.diff(phase.displacement_m) > 0).all()
    assert phase.velocity_mps[-1] == 0


def test_energy_of_a_half_sine_is_what_its_velocity_has_lost() -> None:
    """With v(t) and s(t) of the half sine in closed form, e at s(t) is (v0² − v(t)²)/2, and all of v0²/2 at its end."""
    speed = 0.9 * DELTA_V_MPS
    found = energy_crush(HALF_SINE, speed)
    time = np.linspace(0, 0.05, 11)
    angle = np.pi * time / DURATION_S
    velocity = speed - DELTA_V_MPS / 2 * (1 - np.cos(angle))
    crush = (speed - DELTA_V_MPS / 2) * time + DELTA_V_MPS * DURATION_S / (2 * np.pi) * np.sin(angle)
    energy = np.interp(crush, found.crush_m, found.energy_jpkg)
    assert (found.lower_jpkg, found.upper_jpkg) == (None, None)
    np.testing.assert_allclose(energy, (speed**2 - velocity**2) / 2, atol=1e-4 * speed**2)
    assert found.energy_jpkg[-1] == pytest.approx(speed**2 / 2)


def test_energy_band_holds_the_middle_of_the_draws() -> None:
    """Constant braking from 22.5 to 27.5 g: at each crush 95 % absorb within 22.625 to 27.375 g, at most v0²/2.

    The pulse itself absorbs a s, up to v0²/2 at the maximum crush v0²/2a.
    """
    braking = np.random.default_rng(0).permutation(np.linspace(22.5, 27.5, 401))[:, None] * G
    found = energy_crush(np.full(GRID_S.size, -25 * G), 15.0, draws_mps2=np.broadcast_to(-braking, (401, GRID_S.size)))
    assert found.crush_m[-1] == pytest.approx(15**2 / (2 * 25 * G), rel=1e-5)
    np.testing.assert_allclose(found.energy_jpkg, 25 * G * found.crush_m, atol=1e-3)
    ends = [22.625 * G * found.crush_m, np.minimum(27.375 * G * found.crush_m, 15**2 / 2)]
    np.testing.assert_allclose(np.array([found.lower_jpkg, found.upper_jpkg]), ends, atol=1e-3)


def test_energy_of_draws_that_do_not_stop_lies_between_what_is_seen_and_all_of_it() -> None:
    """Past the end of its record a draw counts with what it had absorbed below, and with v0²/2 above."""
    draw = np.where(np.arange(GRID_S.size) < 175, -14.0 / (174.5 * DT_S), 0.0)  # from 15 to 1 m/s, then rolls on
    found = energy_crush(np.full(GRID_S.size, -25 * G), 15.0, draws_mps2=draw[None])
    assert [not_none(end)[-1] for end in (found.lower_jpkg, found.upper_jpkg)] == [pytest.approx(112), 112.5]
