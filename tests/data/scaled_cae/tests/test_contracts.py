"""The package is held to the contracts of crashfuse."""

from typing import ClassVar

import numpy as np
from scaled_cae import ScaledCae

from crashfuse.testing import ApproachContract, ReaderContract

TIME_S = np.arange(-500, 1500) * 1e-4
ACCEL_G = np.where((TIME_S > 0) & (TIME_S < 0.07), -36 * np.sin(np.pi * TIME_S / 0.07), 0.0)


class TestScaledCae(ApproachContract):
    """One factor on the CAE pulse."""

    approach = ScaledCae


class TestPolar(ReaderContract):
    """Pairs of float64."""

    format = "polar"
    files: ClassVar = {"P1.polar": np.column_stack([TIME_S, ACCEL_G]).astype("<f8").tobytes()}
