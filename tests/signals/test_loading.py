"""The loading phase, against closed forms."""

import numpy as np
import pytest

from crashfuse.signals.loading import loading_phase
from crashfuse.signals.pulse import GRID_S


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
    """Displacement is strictly increasing, so acceleration is a function of it."""
    phase = loading_phase(-300 * np.sin(np.pi * GRID_S / 0.07), speed)
    assert (np.diff(phase.displacement_m) > 0).all()
    assert phase.velocity_mps[-1] == 0


def test_a_vehicle_that_never_stops_is_loading_to_the_end_of_the_record() -> None:
    """There is no t0; the phase is the whole record."""
    phase = loading_phase(np.full(1250, -50.0), 15.0)
    assert np.isnan(phase.t0_s)
    assert phase.time_s.size == 1250
    assert phase.end_s == pytest.approx(GRID_S[-1])
