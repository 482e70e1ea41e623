"""The CAE model's force over displacement, and what of it is trend and what are its humps."""

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np
from scipy.ndimage import gaussian_filter1d

from crashfuse.signals.pulse import FloatArray

_STEP_M = 0.005
_SMOOTH_M = 0.08  # standard deviation: folds, 0.05 to 0.15 m long, are smoothed away; a stiffer engine bay is not
_REACH = 4.0  # in standard deviations; farther points have no weight


class CaeForce(NamedTuple):
    """Acceleration of the CAE vehicle at displacements, force over mass.

    A CAE model is often right about the level of the force and wrong about where the folds are. The trend can be
    trusted where no test has crushed, whatever the tests say about the humps.

    Attributes
    ----------
    accel_mps2, trend_mps2 : ndarray, shape (n,)
        The acceleration, and its mean over about 0.2 m.
    """

    accel_mps2: FloatArray
    trend_mps2: FloatArray

    @classmethod
    def at(cls, displacement_m: FloatArray, accel_at: Callable[[FloatArray], FloatArray]) -> Self:
        """Evaluate a function of the displacement and its trend; before contact nothing is averaged."""
        farthest = float(displacement_m.max()) + _REACH * _SMOOTH_M
        grid = np.arange(0.0, farthest + _STEP_M, _STEP_M)
        width = _SMOOTH_M / _STEP_M
        smooth, share = (
            gaussian_filter1d(values, width, mode="constant", truncate=_REACH)
            for values in (accel_at(grid), np.ones_like(grid))
        )
        return cls(accel_at(displacement_m), np.interp(displacement_m, grid, smooth / share))


class CaeStop(NamedTuple):
    """What the CAE vehicle's acceleration does besides while it stops: a hump too, of which tests may show nothing.

    Attributes
    ----------
    speed_share, accel_mps2 : ndarray, shape (n,)
        Velocity as a share of the impact speed, and what is added there to the acceleration over displacement.
    crush_m : float
        Displacement at which that vehicle stops.
    """

    speed_share: FloatArray
    accel_mps2: FloatArray
    crush_m: float
