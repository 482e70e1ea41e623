"""The crash pulse and its kinematics: acceleration, velocity and displacement.

Signs follow SAE J1733: braking is negative, so velocity is ``v0`` plus the integral of the acceleration.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from crashfuse.errors import DataError, Problem, printable, require_number

FloatArray = npt.NDArray[np.floating[Any]]

SAMPLE_RATE_HZ = 12_500
N_SAMPLES = 1250
DT_S = 1 / SAMPLE_RATE_HZ
GRID_S: FloatArray = np.arange(N_SAMPLES) * DT_S
"""The time grid of every pulse in a campaign and every prediction: 12.5 kHz over 0–100 ms, shape (1250,), in s."""
GRID_S.flags.writeable = False

_LONGEST_STEP_S, _LONGEST_S = 0.02, 10.0  # beyond any record of a crash: what is meant is in ms
_NEARLY_STOPPED = 0.25  # share of the impact speed
_LEAST_BRAKING = 0.5  # share of the mean deceleration so far: cut anywhere, no crash of 70 random vehicles braked less


@dataclass(frozen=True, eq=False)
class Pulse:
    """Vehicle X acceleration against time, evenly sampled.

    Parameters
    ----------
    time_s, accel_mps2 : ndarray, shape (n,)
        Time in s, strictly increasing in even steps, and signed acceleration in m/s².

    Raises
    ------
    DataError
        If the two differ in length, have fewer than two samples or a NaN, time steps are not even, or the time can only
        be in ms.
    """

    time_s: FloatArray
    accel_mps2: FloatArray

    def __post_init__(self) -> None:
        time, accel = numbers("time_s", self.time_s), numbers("accel_mps2", self.accel_mps2)
        found = _trouble(time, accel)
        if found:
            raise DataError(Problem("pulse", "evenly sampled, finite numbers", found, "mend the record"))
        require_step(float(time[1] - time[0]), time.size)
        for name, values in (("time_s", time), ("accel_mps2", accel)):
            values = values.copy() if values.flags.writeable else values
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def __repr__(self) -> str:
        start, end = (1e3 * self.time_s[[0, -1]]).tolist()
        largest = self.accel_mps2[np.abs(self.accel_mps2).argmax()]
        return f"<Pulse of {self.time_s.size:,} samples from {start:.4g} to {end:.4g} ms, at most {largest:.4g} m/s²>"

    @property
    def dt_s(self) -> float:
        """Time step in s."""
        return float((self.time_s[-1] - self.time_s[0]) / (self.time_s.size - 1))

    def resampled(self, time_s: FloatArray) -> "Pulse":
        """The pulse on another time grid, by linear interpolation; zero before and after the record."""
        return Pulse(time_s, np.interp(time_s, self.time_s, self.accel_mps2, left=0.0, right=0.0))

    def kinematics(self, speed_mps: float) -> "Kinematics":
        """Velocity, displacement and time of zero velocity; the pulse's first sample is taken as contact."""
        return kinematics(self.accel_mps2, speed_mps, self.dt_s)


def numbers(name: str, values: object) -> FloatArray:
    """Values as float64; a DataError if they are a path, text or another object."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        found = printable(repr(values), 60)
        raise DataError(Problem(name, "an array of numbers", found, "pass the values of the curve")) from None


def require_step(dt_s: float, n: int) -> None:
    """Raise a DataError if a time step in s of a record of n samples is none, or is in ms rather."""
    require_number("dt_s", dt_s)
    if not 0 < dt_s < np.inf:
        raise DataError(Problem("dt_s", "a time step above 0, in s", f"{dt_s:g}", "state the step of the record"))
    if dt_s > _LONGEST_STEP_S or n * dt_s > _LONGEST_S:
        found = f"{dt_s:g}, a record of {n * dt_s:g} s"
        advice = f"state times in s: {dt_s:g} ms are {dt_s * 1e-3:g} s"
        raise DataError(Problem("dt_s", "the time step of a crash, in s", found, advice))


def _trouble(time: FloatArray, accel: FloatArray) -> str | None:
    """Describe what makes the two arrays invalid as a pulse, if anything."""
    if time.ndim != 1 or time.shape != accel.shape or time.size < 2:
        return f"time of shape {time.shape} and acceleration of shape {accel.shape}"
    if not (np.isfinite(time).all() and np.isfinite(accel).all()):
        return "a value that is not finite"
    steps = np.diff(time)
    if steps.min() <= 0 or np.ptp(steps) > 0.01 * steps.mean():
        return f"time steps from {steps.min():g} to {steps.max():g} s"
    return None


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class Kinematics:
    """Acceleration, and the motion that follows from it and the impact speed; leading axes are draws.

    Attributes
    ----------
    accel_mps2, velocity_mps, displacement_m : ndarray, shape (..., n)
    t0_s : ndarray, shape (...)
        Time of zero velocity, linearly interpolated; NaN where the vehicle does not stop within the record. It lies
        beyond the record only in :func:`with_late_stops`.
    dt_s : float
        Time step in s.
    """

    accel_mps2: FloatArray
    velocity_mps: FloatArray
    displacement_m: FloatArray
    t0_s: FloatArray
    dt_s: float

    @property
    def end_s(self) -> float:
        """Time of the last sample."""
        return float((self.velocity_mps.shape[-1] - 1) * self.dt_s)

    @property
    def crush_m(self) -> FloatArray:
        """Maximum dynamic crush, shape (...): the largest displacement; NaN where the vehicle does not stop."""
        late = self.velocity_mps[..., -1] * np.maximum(self.t0_s - self.end_s, 0.0) / 2
        return np.asarray(np.maximum(self.displacement_m.max(axis=-1), self.displacement_m[..., -1] + late))


def kinematics(accel_mps2: FloatArray, speed_mps: FloatArray | float, dt_s: float) -> Kinematics:
    """Integrate acceleration twice by the trapezoidal rule (Eqs. 11 and 13, second order instead of first).

    The rule conserves energy exactly: the sum of mean acceleration times step in displacement is the change of v²/2.
    Time is the last axis; the impact speed may differ along the others.
    """
    velocity, displacement = motion(accel_mps2, speed_mps, dt_s)
    return Kinematics(accel_mps2, velocity, displacement, zero_velocity_time(velocity, dt_s), dt_s)


def motion(accel_mps2: FloatArray, speed_mps: FloatArray | float, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Velocity and displacement alone, as :func:`kinematics` has them."""
    velocity = _integral(accel_mps2, dt_s)
    velocity += np.asarray(speed_mps)[..., None]
    return velocity, _integral(velocity, dt_s)


def _integral(values: FloatArray, dt_s: float) -> FloatArray:
    """Integrate along the last axis by the trapezoidal rule, from 0 (importing SciPy's costs most of a second)."""
    integral = np.empty(values.shape)
    integral[..., 0] = 0.0
    steps = integral[..., 1:]
    np.add(values[..., 1:], values[..., :-1], out=steps)
    steps *= dt_s / 2
    np.cumsum(steps, axis=-1, out=steps)
    return integral


def with_late_stops(motion: Kinematics) -> Kinematics:
    """The same motions, with the stops of vehicles that are nearly at rest when the record ends.

    One that has lost three quarters of its impact speed, more than nine tenths of its energy, goes on with half of its
    mean deceleration so far. What it crushes then is an upper bound, as crushed structure resists more, not less.
    """
    first, last = motion.velocity_mps[..., 0], motion.velocity_mps[..., -1]
    slow = np.isnan(motion.t0_s) & (last < _NEARLY_STOPPED * first)
    braking = np.where(slow, _LEAST_BRAKING * (first - last) / motion.end_s, np.inf)
    return replace(motion, t0_s=np.where(slow, motion.end_s + last / braking, motion.t0_s))


def zero_velocity_time(velocity: FloatArray, dt_s: float) -> FloatArray:
    """Time at which velocities, time being the last axis, reach zero; NaN where they do not."""
    stopped = velocity <= 0.0
    after = stopped.argmax(axis=-1)
    before = np.maximum(after - 1, 0)
    v_after = np.take_along_axis(velocity, after[..., None], axis=-1)[..., 0]
    v_before = np.take_along_axis(velocity, before[..., None], axis=-1)[..., 0]
    drop = v_before - v_after
    share = np.divide(v_before, drop, out=np.zeros_like(v_before), where=drop > 0)
    return np.where(stopped.any(axis=-1), (before + share) * dt_s, np.nan)
