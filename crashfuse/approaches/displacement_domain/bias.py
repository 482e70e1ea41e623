"""The bias of the CAE model over displacement: the CAE force, points to learn the bias from, and draws of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import ceil, inf
from typing import NamedTuple, Self

import numpy as np
from scipy.ndimage import gaussian_filter1d

from crashfuse.approaches.base import StudentT
from crashfuse.cae.model import LoadingCurve
from crashfuse.condition import Condition
from crashfuse.signals.loading_phase import LoadingPhase
from crashfuse.signals.pulse import FloatArray

_STEP_M = 0.005
_SMOOTH_M = 0.08  # standard deviation: folds, 0.05 to 0.15 m long, are smoothed away; a stiffer engine bay is not
_REACH = 4.0  # in standard deviations; farther points have no weight
_ERRORS = 17_290  # seed: apart from the draws of the bias


class CaeForce(NamedTuple):
    """Acceleration of the CAE vehicle at displacements (force over mass), and its trend; shape (n,) each.

    A CAE model is often right about the level of the force and wrong about where the folds are.
    """

    accel_mps2: FloatArray
    trend_mps2: FloatArray  # mean over about 0.2 m

    @classmethod
    def at(cls, displacement_m: FloatArray, accel_at: Callable[[FloatArray], FloatArray]) -> Self:
        """Evaluate a function of the displacement and its trend; before contact nothing is averaged."""
        farthest = float(displacement_m.max()) + _REACH * _SMOOTH_M
        grid = np.arange(0.0, farthest + _STEP_M, _STEP_M)
        averaged = partial(gaussian_filter1d, sigma=_SMOOTH_M / _STEP_M, mode="constant", truncate=_REACH)
        smooth, share = averaged(accel_at(grid)), averaged(np.ones_like(grid))
        return cls(accel_at(displacement_m), np.interp(displacement_m, grid, smooth / share))


class CaeStop(NamedTuple):
    """What is added to the CAE vehicle's acceleration while it stops."""

    speed_share: FloatArray  # velocity over impact speed, shape (n,)
    accel_mps2: FloatArray  # shape (n,)
    crush_m: float  # where it stops


@dataclass(frozen=True, eq=False, slots=True)
class BiasPoints:
    """The bias δ = test - CAE at n moments of one test's loading phase; arrays of shape (n,)."""

    condition: Condition
    displacement_m: FloatArray
    speed_share: FloatArray  # velocity over impact speed
    cae: CaeForce
    bias_mps2: FloatArray = field(default_factory=lambda: np.empty(0))  # not needed where it is to be predicted

    @classmethod
    def moving(cls, condition: Condition, displacement_m: FloatArray, curve: LoadingCurve, end_share: float) -> Self:
        """Where a crash at a condition shows the bias before it stops."""
        cae = CaeForce.at(displacement_m, partial(curve.accel_at, end_share=end_share))
        return cls(condition, displacement_m, np.ones_like(displacement_m), cae)

    @classmethod
    def projected(cls, condition: Condition, test: LoadingPhase, curve: LoadingCurve, n_points: int) -> Self:
        """Bijective projection of the CAE pulse on the test and the test on the CAE pulse (Eqs. 16 to 22).

        There are ``n_points`` at the test's displacements (Eq. 18), then as many at the CAE's (Eq. 21), at even times.
        """
        cae = curve.phase
        test_s = np.linspace(0.0, test.end_s, n_points)
        cae_s = np.linspace(0.0, np.interp(test.crush_m, cae.displacement_m, cae.time_s), n_points)
        at_test = np.interp(test_s, test.time_s, test.displacement_m)
        at_cae = np.interp(cae_s, cae.time_s, cae.displacement_m)
        displacement = np.concatenate([at_test, at_cae])  # Eq. 22
        force = CaeForce.at(displacement, curve.accel_at)  # Eq. 16
        return cls._of_test(condition, test, displacement, force)  # Eqs. 17, 19, 20

    @classmethod
    def even(
        cls, condition: Condition, test: LoadingPhase, curve: LoadingCurve, step_s: float, end: float, most: float = inf
    ) -> Self:
        """Points from contact to the test's maximum crush, even in displacement and, while it stops, in time.

        They are as far apart as the vehicle comes at impact speed in ``step_s``, or farther, for about ``most`` in all.
        It stops below the share ``end`` of its impact speed; there the phases of CAE vehicle and test are aligned.
        """
        slow_m = test.displacement_at_speed(end)
        slow_s, fast_s = float(np.interp(slow_m, test.displacement_m, test.time_s)), slow_m / condition.speed_mps
        step_s = max(step_s, (fast_s + test.end_s - slow_s) / (most - 1))
        fast = _evenly(0.0, slow_m, step_s * condition.speed_mps)
        slow = np.interp(_evenly(slow_s, test.end_s, step_s), test.time_s, test.displacement_m)
        displacement = np.unique(np.concatenate([fast, slow]))
        shares = np.interp(displacement, test.displacement_m, test.speed_share)
        cae = CaeForce.at(displacement, partial(curve.accel_at, end_share=end))
        stopping = cae._replace(accel_mps2=cae.accel_mps2 + curve.stopping_accel(shares, end))
        return cls._of_test(condition, test, displacement, stopping)

    @classmethod
    def _of_test(cls, condition: Condition, test: LoadingPhase, displacement_m: FloatArray, cae: CaeForce) -> Self:
        shares = np.interp(displacement_m, test.displacement_m, test.speed_share)
        return cls(condition, displacement_m, shares, cae, test.accel_at(displacement_m) - cae.accel_mps2)


@dataclass(frozen=True, eq=False, slots=True)
class BiasDraws:
    """Predicted bias of a crash: the mean function in row 0, then draws of whole functions."""

    over_displacement_mps2: FloatArray  # shape (1 + n_draws, n_displacements)
    over_speed_mps2: FloatArray  # shape (1 + n_draws, n_shares): added while the vehicle stops, over v / v0

    @classmethod
    def of(cls, bias: StudentT, n_displacements: int, n_draws: int, rng: np.random.Generator) -> Self:
        """Draw from a distribution of the bias over so many displacements, then over velocity."""
        functions = np.vstack([bias.mean, bias.draw(n_draws, rng)])
        return cls(*np.split(functions, [n_displacements], axis=1))

    def widened(self, factor: float, share: float = 1.0) -> "BiasDraws":
        """Draws with their deviations from the mean multiplied by a factor, of the mean a share that carries over.

        What the mean loses is an error of either sign, so that the mean square of draws stays, but for the factor.
        """
        both = self.over_displacement_mps2, self.over_speed_mps2
        lost = np.sqrt(1 - share**2) * np.random.default_rng(_ERRORS).standard_normal((len(both[0]) - 1, 1))
        kept = share + factor * np.vstack([[0.0], lost])
        return BiasDraws(*(kept * functions[:1] + factor * (functions - functions[:1]) for functions in both))

    def expected(self, shares: FloatArray) -> "BiasDraws":
        """The mean times these shares."""
        return BiasDraws(*(shares[:, None] * mean[:1] for mean in (self.over_displacement_mps2, self.over_speed_mps2)))


@dataclass(frozen=True, eq=False, slots=True)
class BiasPart:
    """A part of the expected bias over displacement, or their sum, with its central 95 % interval; shape (n,)."""

    name: str
    mean_mps2: FloatArray
    lower_mps2: FloatArray
    upper_mps2: FloatArray


def _evenly(first: float, last: float, step: float) -> FloatArray:
    return np.linspace(first, last, ceil((last - first) / step) + 1)
