"""How near tests are to a condition, in speed: what was checked beside a test need not hold far from all of them."""

import numpy as np

from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MPH

_REACH_MPS = 3 * MPH  # speed difference at which a test is neither near nor far


def nearness(speed_mps: float, tests_mps: FloatArray) -> float:
    """Nearness in speed to the nearest of these tests: 0 far from all of them, 1 beside one."""
    return float(np.exp(-np.abs(tests_mps - speed_mps).min() / _REACH_MPS)) if tests_mps.size else 0.0
