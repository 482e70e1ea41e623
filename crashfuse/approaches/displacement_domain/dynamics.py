"""Integration of the vehicle's motion from its acceleration over displacement (Eq. 29), all draws at once."""

from dataclasses import dataclass

import numpy as np

from crashfuse.signals.loading import LoadingPhase
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray

_LOOK_STEPS = 10  # between two looks whether any draw is still moving
_REPLAY_STEPS = 1600  # about the resolution at which the displacement domain reads the CAE model


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedMotion:
    """Motions from contact on; each row is one draw, valid up to its time of zero velocity.

    Attributes
    ----------
    accel_mps2, velocity_mps, displacement_m : ndarray, shape (n_draws, n_times)
    """

    accel_mps2: FloatArray
    velocity_mps: FloatArray
    displacement_m: FloatArray


def integrate(
    over_displacement_mps2: FloatArray,
    step_m: float,
    over_speed_mps2: FloatArray,
    speed_mps: float,
    *,
    dt_s: float = DT_S,
    n_times: int = N_SAMPLES,
) -> SimulatedMotion:
    """Integrate the motion for each draw of the acceleration, the sum of a function of s and one of v / v0.

    Whole functions are drawn, not new noise at every step, so the spread does not depend on the time step. Eq. 29 is
    first order in it; this is the velocity Verlet scheme, second order at the same cost, whose velocity is the
    trapezoidal integral of the acceleration.

    Parameters
    ----------
    over_displacement_mps2 : ndarray, shape (n_draws, n_grid)
        G_a(s, x) + δ(s, x) of Eq. 10 at s = 0, step_m, 2 step_m, …; linear in between, constant beyond.
    over_speed_mps2 : ndarray, shape (n_draws, n_shares)
        Added to it, at even steps of v / v0 from 0 to 1.
    speed_mps : float
        Impact speed v0.
    dt_s, n_times : float, int
        Time step and number of times, the first being contact.
    """
    # In units of the grid and of the time step: the first samples are then the places in the tables, and the scheme is
    # s += v + a / 2, then v += (a + a') / 2. Halves of accelerations are kept; the overhead of each call dominates.
    half = 0.5 * dt_s**2 / step_m
    by_displacement = _Table(half * over_displacement_mps2, 1.0)
    start = speed_mps * dt_s / step_m
    by_speed = _Table(half * over_speed_mps2, start / (over_speed_mps2.shape[1] - 1))
    adding = np.flatnonzero(over_speed_mps2.any(axis=0))  # usually near the stop only
    slow = by_speed.step * (adding[-1] + 1) if adding.size else -np.inf

    def accel_at(s: FloatArray, v: FloatArray) -> FloatArray:
        accel = by_displacement(s)
        if v.min() < slow:
            accel += by_speed(v)
        return accel

    n_draws = len(over_displacement_mps2)
    accel, velocity, displacement = (np.empty((n_times, n_draws)) for _ in range(3))
    s, v = np.zeros(n_draws), np.full(n_draws, start)
    a = accel_at(s, v)
    for i in range(n_times):
        accel[i], velocity[i], displacement[i] = a, v, s
        if i % _LOOK_STEPS == 0 and v.max() < 0:  # all have stopped
            accel[i:], velocity[i:], displacement[i:] = a, v, s
            break
        s += v
        s += a
        v += a
        ahead = accel_at(s, v + a)
        v += ahead
        a = ahead
    accel *= 2 * step_m / dt_s**2
    velocity *= step_m / dt_s
    displacement *= step_m
    return SimulatedMotion(accel.T, velocity.T, displacement.T)


def replay(phase: LoadingPhase) -> FloatArray:
    """Displacement in m from Eq. 29 for a pulse known over displacement only, at the times of its phase.

    It should equal the pulse's own displacement, integrated over time; the difference is the round-trip error.
    """
    grid = np.linspace(0.0, phase.crush_m, _REPLAY_STEPS + 1)
    n_times = int(np.ceil(phase.end_s / DT_S)) + 1
    speed = float(phase.velocity_mps[0])
    motion = integrate(phase.accel_at(grid)[None], grid[1], np.zeros((1, 2)), speed, n_times=n_times)
    return np.asarray(np.interp(phase.time_s, np.arange(n_times) * DT_S, motion.displacement_m[0]))


class _Table:
    """One function per row, sampled at even steps from 0: linear in between, constant beyond."""

    def __init__(self, values: FloatArray, step: float) -> None:
        n_rows, self.n = values.shape
        slopes = np.diff(values, axis=1, append=values[:, -1:])
        # each line between two samples, by its slope and by its value at 0
        self.slopes, self.values = slopes.ravel(), (values - slopes * np.arange(self.n)).ravel()
        self.first = np.arange(n_rows) * self.n
        self.step = step

    def __call__(self, x: FloatArray) -> FloatArray:
        """Interpolate one value of each row."""
        place = x / self.step
        np.maximum(place, 0.0, out=place)
        np.minimum(place, self.n - 1.0, out=place)
        line = place.astype(np.intp)
        line += self.first
        place *= self.slopes.take(line)
        place += self.values.take(line)
        return place
