"""The CAE model at one condition, as the displacement domain needs it."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from crashfuse.approaches.displacement_domain.rebound import Unloading
from crashfuse.cae.model import CaeModel, LoadingCurve
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray

FINER = 8
"""Refinement of the CAE grid over that of a bias: the CAE curve may turn sharply where the vehicle stops."""

_GRID = 200  # steps of the displacement grid on which a bias is drawn


@dataclass(frozen=True, eq=False, slots=True)
class CaeView:
    """The CAE model at one condition, over time and over displacement.

    Attributes
    ----------
    accel_mps2 : ndarray, shape (1250,)
    paired : bool
        Whether there is a run at exactly this condition.
    """

    condition: Condition
    accel_mps2: FloatArray
    curve: LoadingCurve
    paired: bool

    @classmethod
    def of(cls, model: CaeModel, condition: Condition) -> Self:
        """Create the view of a model at a condition."""
        paired = model.cae_.paired_run(condition) is not None
        return cls(condition, model.pulse(condition).accel_mps2, model.loading_curve(condition), paired)

    @property
    def grid_m(self) -> FloatArray:
        """Displacements from 0 to beyond the reach of any vehicle in m; a bias is drawn at every ``FINER``-th."""
        return np.linspace(0.0, self.condition.speed_mps * DT_S * N_SAMPLES, _GRID * FINER + 1)

    def at_displacement(self, curves: FloatArray, displacement_m: FloatArray) -> FloatArray:
        """Curves over time, (n_curves, 1250), at the times the CAE vehicle reaches displacements, (n_curves, n)."""
        own = self.curve.own
        place = np.interp(displacement_m, own.displacement_m, own.time_s) / DT_S
        before = np.minimum(place.astype(np.intp), N_SAMPLES - 2)
        first = curves[:, before]
        return np.asarray(first + (place - before) * (curves[:, before + 1] - first))

    def beside(self, test: CrashTest) -> Unloading:
        """Pair a test at this condition with the CAE pulse, for the rebound."""
        return Unloading(self.condition.speed_mps, test.pulse.accel_mps2, self.accel_mps2, self.curve.own)
