"""The shape of a pulse in a few numbers: equivalent square and two-step pulses, centroid time, loading ratio, rebound.

All up to the time of zero velocity T, at which the crush C is largest, but for the rebound, which begins there. Each
function takes one motion or many (leading dimensions) and returns SI. Where the vehicle does not stop within the
record, the result is infinite on the side where it would lie, or NaN if that is not known.
"""

from typing import NamedTuple

import numpy as np

from crashfuse.signals.occupant import value_at
from crashfuse.signals.pulse import FloatArray, Kinematics
from crashfuse.units import G

_BROKEN_OFF_MPS2 = 1.0 * G  # a pulse that falls from more than this to exact zeros was cut and padded
_INSTANT_S = 1e-9
_BEYOND_S = 2e-3  # a record has to go on for so long after the largest rebound velocity


class TwoStep(NamedTuple):
    """Decelerations before and after the step, in m/s², and its time in s; each of shape (...)."""

    g1_mps2: FloatArray
    g2_mps2: FloatArray
    time_s: FloatArray


def equivalent_square_wave(motion: Kinematics) -> FloatArray:
    """The constant deceleration that stops the vehicle within the same crush, v0²/(2 C).

    References
    ----------
    M. Huang: Vehicle Crash Mechanics. CRC Press 2002, chapter 2 (ESW).
    """
    speed = motion.velocity_mps[..., 0]
    return np.where(np.isnan(motion.t0_s), -np.inf, speed**2 / 2 / motion.displacement_m.max(axis=-1))


def centroid_time(motion: Kinematics) -> FloatArray:
    """The time of the centroid of the pulse up to T, ∫ a t dt / ∫ a dt, which is C/v0.

    References
    ----------
    M. Huang: Vehicle Crash Mechanics. CRC Press 2002, chapter 2.
    """
    speed = motion.velocity_mps[..., 0]
    return np.where(np.isnan(motion.t0_s), np.inf, motion.displacement_m.max(axis=-1) / speed)


def two_step(motion: Kinematics) -> TwoStep:
    """The two constant decelerations, one after the other, that come nearest to the pulse up to T by least squares.

    Each is then the mean of the pulse over its part, G1 = (v0 − v(t1))/t1 and G2 = v(t1)/(T − t1), so the equivalent
    pulse has the vehicle's velocity at contact, at the step and at T. Of all samples t1, the step is at the one with
    the largest t1·G1² + (T − t1)·G2², as that leaves the least squares. Steps of one size before and after T/2, as of
    a symmetric pulse, tell the same; the earlier is taken.

    References
    ----------
    The idea: S. R. Wu, X. Zhang, P. Lenk: Step function, a measure for frontal crash pulse and its applications.
    International Journal of Vehicle Design 26 (2001) 385–394; they choose the steps for equal occupant response.
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


def first_step(motion: Kinematics) -> FloatArray:
    """G1 of :func:`two_step`, the deceleration before the step."""
    return two_step(motion).g1_mps2


def second_step(motion: Kinematics) -> FloatArray:
    """G2 of :func:`two_step`, the deceleration after the step."""
    return two_step(motion).g2_mps2


def step_time(motion: Kinematics) -> FloatArray:
    """Time of the step of :func:`two_step`."""
    return two_step(motion).time_s


def loading_ratio(motion: Kinematics) -> FloatArray:
    """Front-to-back loading ratio: mean deceleration over the first half of T, over that of the second half.

    As the vehicle stands at T, it is (v0 − v(T/2))/v(T/2): 1 for a pulse that is symmetric about T/2, more for a
    front-loaded pulse, less for a back-loaded one.

    References
    ----------
    The terms: T. P. Hutchinson, Full frontal car crash tests: empirical evidence about shape of deceleration pulses,
    2021, whose own measure, the crush over v0·T/2, is twice the centroid time over T.
    """
    half = value_at(motion.velocity_mps, motion.t0_s / 2 / motion.dt_s)
    lost = motion.velocity_mps[..., 0] - half
    return np.divide(lost, half, out=np.full(np.shape(half), np.nan), where=half > 0)


def rebound_velocity(motion: Kinematics) -> FloatArray:
    """The largest velocity away from the barrier; infinite if the record ends, or was cut off, before it.

    From then on nothing accelerates the vehicle backwards any more: it has left the barrier. The record has to go on
    for 2 ms after it. A pulse that falls from more than 1 g to exact zeros was cut there and padded.
    """
    left, _ = _separation(motion)
    stopped = np.isfinite(motion.t0_s)
    return np.where(left, -motion.velocity_mps.min(axis=-1), np.where(stopped, np.inf, np.nan))


def restitution(motion: Kinematics) -> FloatArray:
    """Coefficient of restitution: rebound velocity over impact velocity."""
    return np.asarray(rebound_velocity(motion) / motion.velocity_mps[..., 0])


def static_crush(motion: Kinematics) -> FloatArray:
    """Displacement at the time of the largest rebound velocity: the crush that remains when the vehicle has left.

    Minus infinity if the record ends before, as the vehicle still moves back then.

    References
    ----------
    M. Huang: Vehicle Crash Mechanics. CRC Press 2002, chapter 2 (static crush at the time of separation).
    """
    left, at = _separation(motion)
    crush = np.take_along_axis(motion.displacement_m, at[..., None], axis=-1)[..., 0]
    return np.where(left, crush, np.where(np.isfinite(motion.t0_s), -np.inf, np.nan))


def _separation(motion: Kinematics) -> tuple[FloatArray, FloatArray]:
    """Whether the vehicle leaves the barrier within the record, and the sample of its largest rebound velocity."""
    at = motion.velocity_mps.argmin(axis=-1)
    size = motion.velocity_mps.shape[-1]
    last = size - 1 - (motion.accel_mps2[..., ::-1] != 0).argmax(axis=-1)
    before = np.take_along_axis(motion.accel_mps2, last[..., None], axis=-1)[..., 0]
    cut_off = (last < size - 1) & (np.abs(before) > _BROKEN_OFF_MPS2)
    end = np.where(cut_off, last, size - 1)
    left = np.isfinite(motion.t0_s) & (at <= end - _BEYOND_S / motion.dt_s)
    return left, at
