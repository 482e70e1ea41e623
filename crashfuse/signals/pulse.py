"""The crash pulse and its kinematics: acceleration, velocity and displacement.

Signs follow SAE J1733: braking is negative, so velocity is ``v0`` plus the integral of the acceleration.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from crashfuse.errors import printable, refusal, refuse_if, require_number
from crashfuse.units import KPH, MPH, G

FloatArray = npt.NDArray[np.floating[Any]]

SAMPLE_RATE_HZ = 12_500
N_SAMPLES = 1250
DT_S = 1 / SAMPLE_RATE_HZ
GRID_S: FloatArray = np.arange(N_SAMPLES) * DT_S
"""The time grid of every pulse in a campaign and every prediction: 12.5 kHz over 0–100 ms, shape (1250,), in s."""
GRID_S.flags.writeable = False
TAIL = 0.025  # share on either side of the central 95 % of draws

_LONGEST_STEP_S, _LONGEST_S = 0.02, 10.0  # beyond any record of a crash: what is meant is in ms
_FASTEST_MPS = 100.0
_OVER = 0.4  # share of the mean deceleration that is left in the last tenth of a record when the crash is over
_GAINED = 0.1  # share of the impact speed; a pulse before contact may add some hundredths
_CHANGE, _USUAL_CHANGE = (0.9, 1.6), 1.15  # of velocity over impact speed, rebound included
_NEARLY_STOPPED = 0.25  # share of the impact speed
_LEAST_BRAKING = 0.5  # share of the mean deceleration so far: cut anywhere, no crash of 70 random vehicles braked less


@dataclass(frozen=True, eq=False)
class Pulse:
    """Vehicle X acceleration, signed, in m/s², against time in s, in even steps; shape (n,).

    A DataError if lengths differ, there are fewer than two samples or a NaN, or the time can only be in ms.
    """

    time_s: FloatArray
    accel_mps2: FloatArray

    def __post_init__(self) -> None:
        time, accel = numbers("time_s", self.time_s), numbers("accel_mps2", self.accel_mps2)
        found = _trouble(time, accel)
        refuse_if(found, "pulse", "evenly sampled, finite numbers", found, "mend the record")
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

    def kinematics(self, speed_mps: float) -> "Kinematics":
        """Velocity, displacement and time of zero velocity; the pulse's first sample is taken as contact."""
        return kinematics(self.accel_mps2, speed_mps, self.dt_s)


def numbers(name: str, values: object) -> FloatArray:
    """Values as float64; a DataError if they are another object."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        found = printable(repr(values), 60)
        raise refusal(name, "an array of numbers", found, "pass the values of the curve") from None


def require_step(dt_s: float, n: int) -> None:
    """Raise a DataError if a time step of a record of n samples is none, or can only be in ms."""
    require_number("dt_s", dt_s)
    stated, is_long = f"{dt_s:g}", dt_s > _LONGEST_STEP_S or n * dt_s > _LONGEST_S
    refuse_if(not 0 < dt_s < np.inf, "dt_s", "a time step above 0, in s", stated, "state the step of the record")
    found, advice = f"{stated}, a record of {n * dt_s:g} s", f"state times in s: {stated} ms are {dt_s * 1e-3:g} s"
    refuse_if(is_long, "dt_s", "the time step of a crash, in s", found, advice)


def _trouble(time: FloatArray, accel: FloatArray) -> str:
    if time.ndim != 1 or time.shape != accel.shape or time.size < 2:
        return f"time of shape {time.shape} and acceleration of shape {accel.shape}"
    if not (np.isfinite(time).all() and np.isfinite(accel).all()):
        return "a value that is not finite"
    steps = np.diff(time)
    if steps.min() <= 0 or np.ptp(steps) > 0.01 * steps.mean():
        return f"time steps from {steps.min():g} to {steps.max():g} s"
    return ""


@dataclass(frozen=True, eq=False, slots=True)
class Kinematics:
    """Acceleration, and the motion that follows from it and the impact speed, shape (..., n); leading axes are draws.

    ``t0_s``, shape (...), is the time of zero velocity, linearly interpolated; NaN where the vehicle does not stop
    within the record. It lies beyond the record only in :func:`with_late_stops`.
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

    The rule conserves energy exactly. Time is the last axis; the impact speed may differ along the others.
    """
    velocity, displacement = motion(accel_mps2, speed_mps, dt_s)
    return Kinematics(accel_mps2, velocity, displacement, zero_velocity_time(velocity, dt_s), dt_s)


def motion(accel_mps2: FloatArray, speed_mps: FloatArray | float, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Velocity and displacement alone, as :func:`kinematics` has them."""
    velocity = _integral(accel_mps2, dt_s)
    velocity += np.asarray(speed_mps)[..., None]
    return velocity, _integral(velocity, dt_s)


def _integral(values: FloatArray, dt_s: float) -> FloatArray:
    """The trapezoidal rule from 0 (importing SciPy's costs most of a second)."""
    integral = np.empty(values.shape)
    integral[..., 0] = 0.0
    steps = integral[..., 1:]
    np.add(values[..., 1:], values[..., :-1], out=steps)
    steps *= dt_s / 2
    np.cumsum(steps, axis=-1, out=steps)
    return integral


def with_late_stops(motion: Kinematics) -> Kinematics:
    """The same motions; vehicles that have lost three quarters of their speed stop by half of their mean deceleration.

    What they crush then is an upper bound, as crushed structure resists more, not less.
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


def checked_pulse(
    accel_mps2: FloatArray, speed_mps: float, dt_s: float, draws_mps2: FloatArray | None
) -> tuple[FloatArray, FloatArray | None]:
    """A pulse from contact on and its draws as float64; a DataError if a unit or the sign must be another."""
    expected, accel_mps2 = "the impact speed in m/s", numbers("accel_mps2", accel_mps2)
    require_step(dt_s, accel_mps2.size)
    accel_mps2 = Pulse(np.arange(accel_mps2.size) * dt_s, accel_mps2).accel_mps2
    require_number("speed_mps", speed_mps)
    stated = f"{speed_mps:g}"
    refuse_if(not 0 < speed_mps < np.inf, "speed_mps", expected, stated, "state a number above 0")
    motion = kinematics(accel_mps2, speed_mps, dt_s)
    if (lost := float(speed_mps - motion.velocity_mps.min())) > _FASTEST_MPS:
        expected, found = "times in s and acceleration in m/s²", f"a pulse that takes away {lost / KPH:,.0f} km/h"
        raise refusal("accel_mps2", expected, found, "correct the unit, of dt_s or of the acceleration")
    gained = float(motion.velocity_mps.max()) / speed_mps - 1
    is_turned = gained > max(_GAINED, lost / speed_mps)
    found = f"a pulse that adds {100 * gained:.0f} % to the impact speed"
    refuse_if(is_turned, "accel_mps2", "acceleration, negative while braking", found, "change its sign")
    likely, change = {"km/h": KPH} if speed_mps > _FASTEST_MPS else {}, lost / speed_mps
    braking_mps2 = -float(motion.accel_mps2[-max(accel_mps2.size // 10, 1) :].mean())
    is_over = braking_mps2 < _OVER * lost / (accel_mps2.size * dt_s)
    if is_unstopped := is_over and motion.velocity_mps[-1] > 0 and change < _CHANGE[0]:
        found = f"a pulse that is over and took away {100 * change:.0f} % of the impact speed"
        is_in_g, advice = not likely and _CHANGE[0] < change * G < _CHANGE[1], f"multiply it by {G:g} if it is in g"
        refuse_if(is_in_g, "accel_mps2", "acceleration in m/s²", found, advice)
        stated += f", of which the pulse takes away {100 * change:.0f} %"
        sizes = {"mph": MPH, "km/h": KPH}
        likely |= {unit: size for unit, size in sizes.items() if _CHANGE[0] < change / size < _CHANGE[1]}
    if likely:
        unit, size = min(likely.items(), key=lambda item: abs(change / item[1] - _USUAL_CHANGE))
        advice = f"convert it: {speed_mps:g} {unit} are {speed_mps * size:.4g} m/s"
        raise refusal("speed_mps", expected, stated, advice)
    if is_unstopped:
        raise refusal("accel_mps2", "one that stops the vehicle", found, "check its unit and the speed's")
    if draws_mps2 is None:
        return accel_mps2, None
    draws_mps2 = numbers("draws_mps2", draws_mps2)
    differ = draws_mps2.ndim != 2 or draws_mps2.shape[-1] != accel_mps2.size or not draws_mps2.size
    expected, shape = f"whole pulses, shape (n_draws, {accel_mps2.size})", f"shape {draws_mps2.shape}"
    refuse_if(differ, "draws_mps2", expected, shape, "give draws the samples of the pulse")
    return accel_mps2, draws_mps2


def in_full(thinned: FloatArray, stride: int) -> FloatArray:
    """Interpolate every n-th sample back to the study grid by a cubic spline, shape (..., 1250)."""
    return thinned if stride == 1 else np.asarray(thinned @ _spline(stride))


@cache
def _spline(stride: int) -> FloatArray:
    """The spline of each thinned sample alone, one a row: interpolation is linear in the samples."""
    from scipy.interpolate import CubicSpline  # a rating needs none

    time = GRID_S[::stride]
    spline: FloatArray = CubicSpline(time, np.eye(time.size), axis=1)(GRID_S)
    return spline
