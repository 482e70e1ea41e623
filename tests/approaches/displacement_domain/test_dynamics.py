"""Integration of the motion, against closed forms and Eq. 29 written out."""

import numpy as np

from crashfuse.approaches.displacement_domain.dynamics import integrate, replay
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, kinematics

NOTHING = np.zeros((1, 2))


def random_functions(n: int, seed: int = 0) -> FloatArray:
    """Smooth random accelerations over 1 m of displacement, about -200 m/s²."""
    s = np.linspace(0, 1, 401)
    rng = np.random.default_rng(seed)
    waves = sum(
        rng.normal(scale=30, size=(n, 1)) * np.sin(2 * np.pi * k * s + rng.uniform(0, 6, (n, 1))) for k in (1, 3, 7)
    )
    return np.asarray(-200 * (1 - np.exp(-s / 0.05)) + waves)


def test_a_spring_swings_as_it_should() -> None:
    """A = -ω² s gives s = v0/ω sin ωt, until the vehicle stops."""
    omega, speed = 22.0, 13.0
    s = np.linspace(0, 1, 401)
    motion = integrate(-(omega**2) * s[None], s[1], NOTHING, speed)
    loading = omega * GRID_S < np.pi / 2
    np.testing.assert_allclose(
        motion.displacement_m[0, loading], speed / omega * np.sin(omega * GRID_S[loading]), atol=1e-6
    )
    np.testing.assert_allclose(motion.velocity_mps[0, loading], speed * np.cos(omega * GRID_S[loading]), atol=2e-5)


def test_braking_in_proportion_to_velocity_decays_exponentially() -> None:
    """A = -c v, given over v / v0, gives v = v0 exp(-ct)."""
    rate, speed = 15.0, 12.0
    motion = integrate(np.zeros((1, 2)), 1.0, -rate * speed * np.linspace(0, 1, 11)[None], speed)
    np.testing.assert_allclose(motion.velocity_mps[0], speed * np.exp(-rate * GRID_S), rtol=1e-6)


def test_beyond_its_grid_a_function_stays_as_it_ends() -> None:
    """Braked at 200 and at 300 m/s², which is known over 0.1 m alone, the crush is v0² / 2a."""
    motion = integrate(np.repeat([[-200.0], [-300.0]], 2, axis=1), 0.1, NOTHING, 12.0)
    np.testing.assert_allclose(motion.displacement_m.max(axis=1), [144 / 400, 144 / 600], atol=1e-5)


def test_eq_29_written_out_converges_to_it() -> None:
    """The paper's first-order scheme comes ten times closer with a tenth of the step, and ends at the same motion."""
    function, speed = random_functions(1)[0], 12.0
    grid = np.linspace(0, 1, 401)
    ours = integrate(function[None], grid[1], NOTHING, speed)
    errors = []
    for finer in (1, 10):
        s, v, velocities = 0.0, speed, [speed]
        for _ in range(600 * finer):
            s += v * DT_S / finer
            v += np.interp(s, grid, function) * DT_S / finer
            velocities.append(v)
        errors.append(np.abs(np.array(velocities[::finer]) - ours.velocity_mps[0, :601]).max())
    assert errors[0] < 0.02
    assert errors[1] < 0.12 * errors[0]


def test_the_motion_is_the_integral_of_the_acceleration_that_is_reported() -> None:
    """Until it stops, velocity and displacement agree with those of the pulse itself; all stop at the same time."""
    motion = integrate(random_functions(5), 1 / 400, NOTHING, 12.0)
    of_pulse = kinematics(motion.accel_mps2, 12.0, DT_S)
    loading = of_pulse.velocity_mps > 0
    np.testing.assert_array_equal(loading, motion.velocity_mps > 0)
    np.testing.assert_allclose(motion.velocity_mps[loading], of_pulse.velocity_mps[loading], atol=1e-3)
    np.testing.assert_allclose(motion.displacement_m[loading], of_pulse.displacement_m[loading], atol=1e-4)


def test_what_acts_near_the_stop_only_acts_from_there_on() -> None:
    """A function of v/v0 that is zero above 1/4 changes nothing before that velocity, and something after it."""
    stop = np.array([40.0, 0.0, 0.0, 0.0, 0.0])[None] * np.ones((5, 1))
    without, with_stop = (integrate(random_functions(5), 1 / 400, extra, 12.0) for extra in (NOTHING, stop))
    before = without.velocity_mps > 3.0
    np.testing.assert_array_equal(with_stop.accel_mps2[before], without.accel_mps2[before])
    after = (without.velocity_mps < 2.9) & (without.velocity_mps > 0)
    assert (with_stop.accel_mps2[after] > without.accel_mps2[after]).all()


def test_the_band_does_not_depend_on_the_time_step() -> None:
    """Quantiles of velocity and crush over whole-function draws stay, to 1 %, at half and a fifth of the step."""
    functions, speed = random_functions(200), 12.0

    def widths(finer: int) -> FloatArray:
        motion = integrate(functions, 1 / 400, NOTHING, speed, dt_s=DT_S / finer, n_times=1250 * finer)
        crush = motion.displacement_m.max(axis=1)
        velocity = motion.velocity_mps[:, 500 * finer]
        return np.array([np.ptp(np.quantile(x, [0.025, 0.975])) for x in (crush, velocity)])

    for finer in (2, 5):
        np.testing.assert_allclose(widths(finer), widths(1), rtol=0.01)


def test_what_all_draws_have_in_common_may_be_told_once_at_finer_steps() -> None:
    common, draws = random_functions(1)[0], random_functions(4, seed=1)[:, ::100] / 5
    coarse, fine = np.linspace(0, 1, 5), np.linspace(0, 1, 401)
    sums = common + np.array([np.interp(fine, coarse, draw) for draw in draws])
    once = integrate(draws, coarse[1], NOTHING, 12.0, common_mps2=common)
    each = integrate(sums, fine[1], NOTHING, 12.0)
    loading = each.velocity_mps > 0
    np.testing.assert_allclose(once.accel_mps2[loading], each.accel_mps2[loading], atol=1e-9)
    np.testing.assert_allclose(once.t0_s, each.t0_s, atol=1e-12)


def test_a_pulse_known_over_displacement_only_gives_its_own_motion_back() -> None:
    """A half sine that throws the vehicle back: s(t) = v0 (0.45 t + 0.55 T/π sin(π t / T)), until it stops."""
    speed, duration = 15.0, 0.07
    accel = -0.55 * speed * np.pi / duration * np.sin(np.pi * np.minimum(GRID_S / duration, 1.0))
    phase = loading_phase(accel, speed)
    expected = speed * (0.45 * phase.time_s + 0.55 * duration / np.pi * np.sin(np.pi * phase.time_s / duration))
    np.testing.assert_allclose(replay(phase), expected, atol=1e-4)
