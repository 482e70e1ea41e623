"""What follows t0, on pulses whose rebound is known."""

import numpy as np
import pytest

from crashfuse.approaches.displacement_domain.rebound import Rebound, Unloading, follow_unloading
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Kinematics, kinematics
from tests.conftest import not_none

SPEED = 12.0


def bouncing(duration_s: float, factor: float = 1.2) -> FloatArray:
    peak = factor * SPEED * np.pi / (2 * duration_s)
    return np.where(duration_s > GRID_S, -peak * np.sin(np.pi * GRID_S / duration_s), 0.0)


def test_the_branch_is_shifted_to_t0_and_scaled() -> None:
    """A pulse twice as fast and twice as hard unloads along the CAE branch, shifted, at twice its height."""
    cae, pulse = bouncing(0.08), bouncing(0.04)
    loading, own = loading_phase(cae, SPEED), loading_phase(pulse, SPEED)
    continued = follow_unloading(pulse[None], SPEED, cae, loading)[0]
    after = np.array([0.002, 0.005, 0.008])
    ratio = own.accel_mps2[-1] / loading.accel_mps2[-1]
    expected = ratio * np.interp(loading.t0_s + after, GRID_S, cae)
    np.testing.assert_allclose(np.interp(own.t0_s + after, GRID_S, continued), expected, rtol=0.02)
    assert ratio == pytest.approx(2.0, rel=0.01)


def test_a_vehicle_that_never_stops_is_left_as_it_is() -> None:
    pulse = np.full((1, 1250), -50.0)
    cae = bouncing(0.07)
    np.testing.assert_array_equal(follow_unloading(pulse, SPEED, cae, loading_phase(cae, SPEED)), pulse)


def test_a_cae_pulse_that_never_stops_has_no_branch() -> None:
    cae = np.full(1250, -50.0)
    continued = follow_unloading(np.full((1, 1250), -200.0), SPEED, cae, loading_phase(cae, SPEED))[0]
    t0 = SPEED / 200
    np.testing.assert_array_equal(continued[t0 > GRID_S], -200.0)
    later = t0 + 0.001 < GRID_S
    np.testing.assert_allclose(continued[later], -200 * np.exp(-(GRID_S[later] - t0) / 0.005), rtol=1e-3)


def unloading(extra: FloatArray, speed_mps: float) -> Unloading:
    """A test that goes on after t0 as the CAE pulse and ``extra``, which is told over the time since then."""
    cae = bouncing(0.06) * speed_mps / SPEED
    loading = loading_phase(cae, speed_mps)
    after = np.maximum(GRID_S - loading.t0_s, 0.0)
    accel = cae + np.where(after > 0, np.interp(after, GRID_S, extra), 0.0) * speed_mps / SPEED
    return Unloading(speed_mps, accel, cae, loading)


def moving(pulses_mps2: FloatArray, stride: int = 1) -> Kinematics:
    """The motion at 12 m/s of pulses on every n-th sample."""
    return kinematics(pulses_mps2, 12.0, stride * DT_S)


@pytest.fixture(scope="module")
def model() -> Rebound:
    """Learned from three tests that let go in their own ways."""
    return Rebound().fit([unloading(k * EXTRA, 10.0 + k) for k in (-2.0, 1.0, 3.0)])


EXTRA = -80 * (GRID_S / 0.01) * np.exp(1 - GRID_S / 0.01)  # lets go later than the CAE model


@pytest.mark.slow
def test_what_tests_add_to_the_unloading_is_learned() -> None:
    """In proportion to the braking at t0, at a speed that no test had; the mean is near the truth."""
    model = Rebound().fit([unloading(EXTRA, speed) for speed in (9.0, 11.0, 13.0, 15.0)])
    new = unloading(EXTRA, 12.0)
    rng = np.random.default_rng(0)
    expected, *draws = model.follow(moving(np.tile(new.cae_mps2, (201, 1))), new.cae_mps2, new.cae_loading, 12.0, rng)
    after = new.cae_loading.t0_s < GRID_S
    assert np.abs(expected - new.accel_mps2)[after].max() < 0.15 * np.abs(EXTRA).max()
    np.testing.assert_array_equal(expected[~after], new.cae_mps2[~after])
    width = np.std(draws, axis=0)
    assert width[~after].max() < 1e-9 < width[after].max()


@pytest.mark.slow
def test_the_rebound_is_the_same_in_coarser_steps(model: Rebound) -> None:
    """Equal draws on every fifth sample differ by less than 1 % of what was learned."""
    new = unloading(EXTRA, 12.0)
    fine, coarse = (
        model.follow(moving(np.tile(new.cae_mps2[::k], (11, 1)), k), new.cae_mps2, new.cae_loading, 12.0, rng)
        for k, rng in ((1, np.random.default_rng(0)), (5, np.random.default_rng(0)))
    )
    assert np.abs(fine[:, ::5] - coarse).max() < 0.01 * np.abs(fine - new.cae_mps2).max()


def test_draws_start_at_t0_without_a_step(model: Rebound) -> None:
    new = unloading(EXTRA, 12.0)
    rng = np.random.default_rng(0)
    pulses = model.follow(moving(np.tile(new.cae_mps2, (51, 1))), new.cae_mps2, new.cae_loading, 12.0, rng)
    at = int(new.cae_loading.t0_s / GRID_S[1])
    assert np.abs(np.diff(pulses[:, at - 1 : at + 3], axis=1)).max() < 15.0
    assert np.std(pulses[:, at + 100]) > 20.0


def test_a_test_left_out_is_forgotten_and_none_left_means_the_cae_branch() -> None:
    tests = [unloading(EXTRA, 10.0), unloading(2 * EXTRA, 13.0)]
    model = Rebound().fit(tests)
    assert model.process_ is not None
    assert set(not_none(model.without(0).process_).x_[:, -1]) == {1.0}
    pulses, branch = tests[0].cae_mps2[None], (tests[0].cae_mps2, tests[0].cae_loading)
    motion = kinematics(pulses, 10.0, DT_S)
    alone = Rebound().fit(tests[:1]).without(0).follow(motion, *branch, 10.0, np.random.default_rng(0))
    np.testing.assert_array_equal(alone, follow_unloading(pulses, 10.0, *branch))
    never = Unloading(SPEED, np.full(1250, -50.0), tests[0].cae_mps2, tests[0].cae_loading)
    assert Rebound().fit([never]).process_ is None
