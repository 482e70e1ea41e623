"""The shape of a pulse in a few numbers: equivalent square and two-step pulses, centroid time, loading ratio, rebound.

All up to the time of zero velocity T, at which the crush C is largest, but for the rebound, which begins there. Each
function takes one motion or many (leading dimensions) and returns SI. Where the vehicle is not known to stop, the
result is infinite on the side where it would lie, or NaN if that is not known. Sources: docs/method/metrics.md.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from crashfuse.signals.occupant import value_at
from crashfuse.signals.pulse import FloatArray, Kinematics
from crashfuse.units import G

_BROKEN_OFF_MPS2 = 1.0 * G  # a pulse that falls from more than this to exact zeros was cut and padded
_INSTANT_S = 1e-9
_QUIET_MPS2, _QUIET_S = 0.5 * G, 2e-3  # when nothing throws the vehicle back any more
_FREE_SHARE, _FREE_S = 0.05, 10e-3  # of all speed lost, so little is lost in the last 10 ms by one that is free


class TwoStep(NamedTuple):
    """Decelerations before and after the step, in m/s², and its time in s; each of shape (...)."""

    g1_mps2: FloatArray
    g2_mps2: FloatArray
    time_s: FloatArray


def equivalent_square_wave(motion: Kinematics) -> FloatArray:
    """The constant deceleration that stops the vehicle within the same crush, v0²/(2 C) (ESW)."""
    return np.nan_to_num(motion.velocity_mps[..., 0] ** 2 / 2 / motion.crush_m, nan=-np.inf)


def centroid_time(motion: Kinematics) -> FloatArray:
    """The time of the centroid of the pulse up to T, ∫ a t dt / ∫ a dt, which is C/v0."""
    return np.nan_to_num(motion.crush_m / motion.velocity_mps[..., 0], nan=np.inf)


@lru_cache(maxsize=1)  # several metrics are parts of the result
def two_step(motion: Kinematics) -> TwoStep:
    """The two constant decelerations, one after the other, that come nearest to the pulse up to T by least squares.

    Each is then the mean of the pulse over its part, G1 = (v0 − v(t1))/t1 and G2 = v(t1)/(T − t1). Of all samples t1,
    the step is at the first one with the largest t1·G1² + (T − t1)·G2², as that leaves the least squares.
    """
    speed, velocity, end = motion.velocity_mps[..., :1], motion.velocity_mps[..., 1:-1], motion.t0_s[..., None]
    time = np.arange(1, velocity.shape[-1] + 1) * motion.dt_s
    rest = end - time
    rest[~(rest > _INSTANT_S)] = np.inf  # no step at T or after it
    explained = (speed - velocity) ** 2 / time + velocity**2 / rest
    explained[np.isinf(rest)] = 0.0
    step = explained.argmax(axis=-1)[..., None]
    at, then = np.take_along_axis(velocity, step, axis=-1), time[step]
    found = (speed - at) / then, at / (end - then), then
    return TwoStep(*(np.where(np.isnan(motion.t0_s), np.nan, of[..., 0]) for of in found))


def loading_ratio(motion: Kinematics) -> FloatArray:
    """Front-to-back loading ratio: mean deceleration over the first half of T, over that of the second half.

    As the vehicle stands at T, it is (v0 − v(T/2))/v(T/2): 1 for a pulse that is symmetric about T/2, more for a
    front-loaded pulse, less for a back-loaded one.

    The terms: Full Frontal Car Crash Tests: Empirical Evidence About Shape of Deceleration Pulses (2021), whose own
    measure, the crush over v0·T/2, is twice the centroid time over T.
    """
    half = value_at(motion.velocity_mps, motion.t0_s / 2 / motion.dt_s)
    lost = motion.velocity_mps[..., 0] - half
    return np.asarray(np.divide(lost, half, out=np.full(np.shape(half), np.nan), where=half > 0))


def rebound_velocity(motion: Kinematics) -> FloatArray:
    """Velocity away from the barrier when the vehicle leaves it; infinite if the record ends before.

    It leaves when nothing throws it back any more: after T, when the deceleration stays below 0.5 g for 2 ms. A pulse
    that falls from more than 1 g to exact zeros was cut there and padded; the zeros are no record.
    """
    left, at = _separation(motion)
    rebound = -np.take_along_axis(motion.velocity_mps, at[..., None], axis=-1)[..., 0]
    return np.where(left, rebound, np.where(motion.t0_s <= motion.end_s, np.inf, np.nan))


def restitution(motion: Kinematics) -> FloatArray:
    """Coefficient of restitution: rebound velocity over impact velocity."""
    return np.asarray(rebound_velocity(motion) / motion.velocity_mps[..., 0])


def static_crush(motion: Kinematics) -> FloatArray:
    """Displacement when the vehicle leaves the barrier: the crush that remains; minus infinity beyond the record."""
    left, at = _separation(motion)
    crush = np.take_along_axis(motion.displacement_m, at[..., None], axis=-1)[..., 0]
    return np.where(left, crush, np.where(motion.t0_s <= motion.end_s, -np.inf, np.nan))


def moves_freely(motion: Kinematics) -> npt.NDArray[np.bool_]:
    """Whether the vehicle hardly changes its velocity any more when the record ends, though it may still ring.

    It stopped 10 ms before or earlier, and lost less than 5 % of all the speed that it has lost in the last 10 ms.
    """
    velocity = motion.velocity_mps
    then = _last_sample(motion.accel_mps2) - round(_FREE_S / motion.dt_s)
    lately = value_at(velocity, np.maximum(then, 0)) - velocity[..., -1]
    lost = velocity[..., 0] - velocity[..., -1]
    return np.asarray((motion.t0_s <= then * motion.dt_s) & (lately < _FREE_SHARE * lost))


@lru_cache(maxsize=1)  # several metrics are parts of the result
def _separation(motion: Kinematics) -> tuple[FloatArray, npt.NDArray[np.int_]]:
    accel, size = motion.accel_mps2, motion.accel_mps2.shape[-1]
    length = max(round(_QUIET_S / motion.dt_s), 1)
    if size <= length:
        return np.zeros(accel.shape[:-1], dtype=bool), np.zeros(accel.shape[:-1], dtype=np.int_)
    loud = np.cumsum(accel < -_QUIET_MPS2, axis=-1)
    quiet = loud[..., length:] == loud[..., :-length]  # from the next sample on
    sample = np.arange(1, quiet.shape[-1] + 1)
    stopped = sample * motion.dt_s >= np.where(np.isnan(motion.t0_s), np.inf, motion.t0_s)[..., None]
    free = quiet & stopped & (sample + length - 1 <= _last_sample(accel)[..., None])
    return free.any(axis=-1), sample[free.argmax(axis=-1)]


def _last_sample(accel: FloatArray) -> npt.NDArray[np.int_]:
    size = accel.shape[-1]
    last = size - 1 - (accel[..., ::-1] != 0).argmax(axis=-1)
    broken_off = np.abs(np.take_along_axis(accel, last[..., None], axis=-1)[..., 0]) > _BROKEN_OFF_MPS2
    return np.asarray(np.where(broken_off, last, size - 1))
