"""Integration of the vehicle's motion from its acceleration over displacement (Eq. 29), all draws at once."""

from collections.abc import Sequence

import numpy as np

from crashfuse.signals.loading_phase import LoadingPhase
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray, Kinematics, zero_velocity_time

_LOOK_STEPS = 10  # between two looks whether any draw is still moving
_REPLAY_STEPS = 1600  # about the resolution at which the displacement domain reads the CAE model


def integrate(
    over_displacement_mps2: FloatArray,
    step_m: float,
    over_speed_mps2: FloatArray,
    speed_mps: float,
    *,
    common_mps2: FloatArray | None = None,
    dt_s: float = DT_S,
    n_times: int = N_SAMPLES,
) -> Kinematics:
    """Integrate the motion for each draw of the acceleration, the sum of a function of s and one of v / v0.

    This is the velocity Verlet scheme, second order in the step (Eq. 29: first) at the same cost; its velocity is the
    trapezoidal integral of the acceleration. Each motion is valid up to its time of zero velocity.

    Parameters
    ----------
    over_displacement_mps2 : ndarray, shape (n_draws, n_grid)
        G_a(s, x) + δ(s, x) of Eq. 10 at s = 0, step_m, 2 step_m, …; linear in between, constant beyond.
    over_speed_mps2 : ndarray, shape (n_draws, n_shares)
        Added to it, at even steps of v / v0 from 0 to 1.
    common_mps2 : ndarray, shape (n_fine,), optional
        Added to every draw's: a function of s from 0 to the end of the grid, at steps of its own.
    """
    # In units of the grid and of the time step: the first samples are then the places in the tables, and the scheme is
    # s += v + a / 2, then v += (a + a') / 2. Halves of accelerations are kept; the overhead of each call dominates.
    half, start = 0.5 * dt_s**2 / step_m, speed_mps * dt_s / step_m
    over_displacement = [(half * over_displacement_mps2, 1.0)]
    if common_mps2 is not None:
        length = over_displacement_mps2.shape[1] - 1
        over_displacement.append((half * common_mps2[None], length / (common_mps2.size - 1)))
    over_speed = half * over_speed_mps2, start / (over_speed_mps2.shape[1] - 1)
    adding = np.flatnonzero(over_speed_mps2.any(axis=0))  # usually near the stop only
    slow = over_speed[1] * (adding[-1] + 1) if adding.size else -np.inf

    n_draws = len(over_displacement_mps2)
    accel_at = _Sum([*over_displacement, over_speed], n_draws)
    accel, velocity, displacement = (np.empty((n_times, n_draws)) for _ in range(3))
    state = np.zeros((len(over_displacement) + 1, n_draws))  # s for each of its tables, then v
    s, v_ahead, stopping = state[:-1], state[-1], adding.size and start < slow
    v_ahead += start
    v, a = v_ahead.copy(), accel_at(state if stopping else s)
    for i in range(n_times):
        accel[i], velocity[i], displacement[i] = a, v, s[0]
        if i % _LOOK_STEPS == 0 and v.max() < 0:  # all have stopped
            accel[i:], velocity[i:], displacement[i:] = a, v, s[0]
            break
        v += a
        s += v
        np.add(v, a, out=v_ahead)
        stopping = stopping or v_ahead.min() < slow
        a = accel_at(state if stopping else s)
        v += a
    accel *= 2 * step_m / dt_s**2
    velocity *= step_m / dt_s
    displacement *= step_m
    return Kinematics(accel.T.copy(), velocity.T, displacement.T, zero_velocity_time(velocity.T, dt_s), dt_s)


def replay(phase: LoadingPhase) -> FloatArray:
    """Displacement in m from Eq. 29 for a pulse known over displacement only, at the times of its phase."""
    grid = np.linspace(0.0, phase.crush_m, _REPLAY_STEPS + 1)
    n_times = int(np.ceil(phase.end_s / DT_S)) + 1
    speed = float(phase.velocity_mps[0])
    motion = integrate(phase.accel_at(grid)[None], grid[1], np.zeros((1, 2)), speed, n_times=n_times)
    return np.asarray(np.interp(phase.time_s, np.arange(n_times) * DT_S, motion.displacement_m[0]))


class _Sum:
    """Sum of functions at even steps from 0: linear between, constant beyond."""

    def __init__(self, tables: Sequence[tuple[FloatArray, float]], n_draws: int) -> None:
        slopes = [np.diff(values, axis=1, append=values[:, -1:]) for values, _ in tables]
        # each line between two samples, by its slope and by its value at 0
        at_0 = [values - slope * np.arange(slope.shape[1]) for (values, _), slope in zip(tables, slopes, strict=True)]
        self.slopes, self.values = (np.concatenate([part.ravel() for part in parts]) for parts in (slopes, at_0))
        starts = np.cumsum([0, *(slope.size for slope in slopes[:-1])])
        rows = [np.arange(n_draws) * slope.shape[1] * (len(slope) > 1) for slope in slopes]
        self.first = np.array(rows) + starts[:, None]
        self.last = np.array([[slope.shape[1] - 1.0] for slope in slopes])
        self.steps = np.array([[step] for _, step in tables])

    def __call__(self, x: FloatArray) -> FloatArray:
        n = len(x)
        place = x / self.steps[:n]
        np.maximum(place, 0.0, out=place)
        np.minimum(place, self.last[:n], out=place)
        line = place.astype(np.intp)
        line += self.first[:n]
        place *= self.slopes.take(line)
        place += self.values.take(line)
        return np.asarray(np.add.reduce(place))
