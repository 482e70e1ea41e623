"""The bias of the CAE model over displacement: training points of a bias model, and functions drawn from one."""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from crashfuse.approaches.displacement_domain.cae_force import CaeForce
from crashfuse.cae.model import LoadingCurve
from crashfuse.condition import Condition
from crashfuse.signals.loading import LoadingPhase
from crashfuse.signals.pulse import FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class BiasPoints:
    """The bias δ = test - CAE at moments of one test's loading phase.

    Attributes
    ----------
    displacement_m, speed_share, bias_mps2 : ndarray, shape (n,)
        Displacement, velocity over impact speed, and the bias to add to the CAE model's acceleration.
    cae : CaeForce
        That acceleration, and its trend.
    """

    condition: Condition
    displacement_m: FloatArray
    speed_share: FloatArray
    cae: CaeForce
    bias_mps2: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class BiasDraws:
    """Predicted bias of a crash: the mean function in row 0, then draws of whole functions.

    Attributes
    ----------
    over_displacement_mps2 : ndarray, shape (1 + n_draws, n_displacements)
    over_speed_mps2 : ndarray, shape (1 + n_draws, n_shares)
        Added while the vehicle stops, over its velocity as a share of the impact speed.
    """

    over_displacement_mps2: FloatArray
    over_speed_mps2: FloatArray

    def widened(self, factor: float) -> "BiasDraws":
        """The same draws with their deviations from the mean multiplied by this factor."""

        def widen(functions: FloatArray) -> FloatArray:
            wide: FloatArray = functions[:1] + factor * (functions - functions[:1])
            return wide

        return BiasDraws(widen(self.over_displacement_mps2), widen(self.over_speed_mps2))


@dataclass(frozen=True, eq=False, slots=True)
class BiasPart:
    """One part of the expected bias at a condition, or the sum of the parts, with its central 95 % interval.

    Attributes
    ----------
    mean_mps2, lower_mps2, upper_mps2 : ndarray, shape (n,)
        Over displacement.
    """

    name: str
    mean_mps2: FloatArray
    lower_mps2: FloatArray
    upper_mps2: FloatArray


def bijective_projection(condition: Condition, test: LoadingPhase, curve: LoadingCurve, n_points: int) -> BiasPoints:
    """Project the CAE pulse on the test and the test on the CAE pulse (Eqs. 16 to 22).

    Both are sampled at times evenly spaced in their own loading phase, the CAE pulse only up to the crush of the test,
    which has no acceleration beyond. Returns ``n_points`` at the test's displacements (Eq. 18), then as many at the
    CAE's (Eq. 21); the curve continues the CAE pulse where the test crushed further.
    """
    cae = curve.own
    test_s = np.linspace(0.0, test.end_s, n_points)
    cae_s = np.linspace(0.0, np.interp(test.crush_m, cae.displacement_m, cae.time_s), n_points)
    at_test = np.interp(test_s, test.time_s, test.displacement_m)
    at_cae = np.interp(cae_s, cae.time_s, cae.displacement_m)
    displacement = np.concatenate([at_test, at_cae])  # Eq. 22
    shares = np.interp(displacement, test.displacement_m, test.speed_share)
    force = CaeForce.at(displacement, curve.accel_at)  # Eq. 16
    bias = test.accel_at(displacement) - force.accel_mps2  # Eqs. 17, 19, 20
    return BiasPoints(condition, displacement, shares, force, bias)


def uniform_points(
    condition: Condition,
    test: LoadingPhase,
    curve: LoadingCurve,
    step_s: float,
    end_share: float,
    most: float = math.inf,
) -> BiasPoints:
    """Sample the bias from contact to the test's maximum crush: evenly in displacement, while it stops in time.

    Points are as far apart as the vehicle comes at impact speed in ``step_s``, or farther, for about ``most`` in all.
    Evenly in time they would pile up as the vehicle slows down. But below ``end_share`` of its impact speed it counts
    as stopping: there acceleration changes while displacement hardly grows, so points lie as far apart in time; the
    stopping phase of the CAE vehicle is aligned with that of the test.
    """
    slow_m = test.displacement_at_speed(end_share)
    slow_s, fast_s = float(np.interp(slow_m, test.displacement_m, test.time_s)), slow_m / condition.speed_mps
    step_s = max(step_s, (fast_s + test.end_s - slow_s) / (most - 1))
    fast = _evenly(0.0, slow_m, step_s * condition.speed_mps)
    slow = np.interp(_evenly(slow_s, test.end_s, step_s), test.time_s, test.displacement_m)
    displacement = np.unique(np.concatenate([fast, slow]))
    shares = np.interp(displacement, test.displacement_m, test.speed_share)
    cae = CaeForce.at(displacement, partial(curve.accel_at, end_share=end_share))
    cae = cae._replace(accel_mps2=cae.accel_mps2 + curve.stopping_accel(shares, end_share))
    return BiasPoints(condition, displacement, shares, cae, test.accel_at(displacement) - cae.accel_mps2)


def _evenly(first: float, last: float, step: float) -> FloatArray:
    """Both ends, and points between them at most a step apart."""
    return np.linspace(first, last, math.ceil((last - first) / step) + 1)
