"""Pulses on every n-th sample of the study grid, and back: a CFC 60 pulse holds no finer detail than ten samples."""

from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from crashfuse.signals.pulse import GRID_S, FloatArray


def in_full(thinned: FloatArray, stride: int) -> FloatArray:
    """Interpolate every n-th sample back to the study grid by a cubic spline, shape (..., 1250)."""
    if stride == 1:
        return thinned
    full: FloatArray = thinned @ _spline(stride)
    return full


@cache
def _spline(stride: int) -> FloatArray:
    """The spline of each thinned sample alone, one a row: interpolation is linear in the samples."""
    time = GRID_S[::stride]
    spline: FloatArray = CubicSpline(time, np.eye(time.size), axis=1)(GRID_S)
    return spline
