"""What engineers read off a crash pulse: positive numbers in the units of their tables, with intervals.

A metric is one small function of a :class:`Motion`, in SI, and one line of ``_METRICS``.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crashfuse.pulse import DT_S, FloatArray, kinematics
from crashfuse.units import KPH, MS, G

METRIC_LABELS = {
    "peak": "Peak deceleration",
    "peak_time": "Time of peak",
    "delta_v": "ΔV, rebound included",
    "t0": "Time of zero velocity t0",
    "max_crush": "Maximum dynamic crush",
}
"""What tables call the metrics."""

_TAIL = 0.025  # on either side of the central 95 %


@dataclass(frozen=True, slots=True)
class Metric:
    """One number of a pulse.

    Parameters
    ----------
    name : str
    value : float or None
        None if the vehicle does not stop within the record and the metric needs that.
    lower, upper : float or None
        The central 95 % interval; None where there are no draws, or where that end lies beyond the record.
    unit : str
    """

    name: str
    value: float | None
    lower: float | None
    upper: float | None
    unit: str


@dataclass(frozen=True, eq=False, slots=True)
class Motion:
    """A pulse, or many, with what follows from them; arrays of shape (..., n) in SI, ``t0_s`` of shape (...)."""

    accel_mps2: FloatArray
    velocity_mps: FloatArray
    displacement_m: FloatArray
    t0_s: FloatArray
    dt_s: float

    @classmethod
    def of(cls, accel_mps2: FloatArray, speed_mps: float, dt_s: float) -> "Motion":
        """Integrate acceleration from an impact speed."""
        accel_mps2 = np.asarray(accel_mps2, dtype=np.float64)
        motion = kinematics(accel_mps2, speed_mps, dt_s)
        return cls(accel_mps2, motion.velocity_mps, motion.displacement_m, motion.t0_s, dt_s)


def _peak(motion: Motion) -> FloatArray:
    """Largest deceleration."""
    return np.asarray(-motion.accel_mps2.min(axis=-1))


def _peak_time(motion: Motion) -> FloatArray:
    """Time of the largest deceleration."""
    return np.asarray(motion.accel_mps2.argmin(axis=-1) * motion.dt_s)


def _delta_v(motion: Motion) -> FloatArray:
    """Largest change of velocity over the record, rebound included."""
    return np.asarray((motion.velocity_mps[..., :1] - motion.velocity_mps).max(axis=-1))


def _t0(motion: Motion) -> FloatArray:
    """Time of zero velocity; infinite, that is beyond the record, if there is none."""
    return np.where(np.isnan(motion.t0_s), np.inf, motion.t0_s)


def _max_crush(motion: Motion) -> FloatArray:
    """Maximum dynamic crush, the largest displacement; infinite if the vehicle does not stop."""
    return np.where(np.isnan(motion.t0_s), np.inf, motion.displacement_m.max(axis=-1))


_METRICS: Mapping[str, tuple[Callable[[Motion], FloatArray], str, float]] = {
    "peak": (_peak, "g", G),
    "peak_time": (_peak_time, "ms", MS),
    "delta_v": (_delta_v, "km/h", KPH),
    "t0": (_t0, "ms", MS),
    "max_crush": (_max_crush, "mm", 1e-3),
}
"""Function, unit, and the unit in SI, by the metric's name."""


def pulse_metrics(
    accel_mps2: FloatArray, speed_mps: float, *, dt_s: float = DT_S, draws_mps2: FloatArray | None = None
) -> tuple[Metric, ...]:
    """Metrics of a pulse; with draws, the central 95 % interval of each.

    Parameters
    ----------
    accel_mps2 : ndarray, shape (n,)
        Signed acceleration in m/s², the first sample at contact.
    speed_mps : float
        Impact speed in m/s.
    dt_s : float
        Time step in s.
    draws_mps2 : ndarray, shape (n_draws, n), optional
        Equally likely whole pulses.

    Returns
    -------
    tuple of Metric
        peak (g), peak_time (ms), delta_v (km/h), t0 (ms), max_crush (mm).

    Notes
    -----
    The value is that of the pulse itself, so it can be checked against its curve. The interval is that of the draws,
    and a single curve through their middle is smoother than any of them: its peak may lie below the interval.

    A pulse that does not bring the vehicle to a stop has no t0 and no max_crush (None). A draw that does not stop counts
    as larger than any that does: leaving it out would feign certainty. The upper end is thus None as soon as more
    than one in forty do not stop. Interval ends are draws themselves, rounded outward.
    """  # noqa: E501
    pulse = Motion.of(accel_mps2, speed_mps, dt_s)
    draws = None if draws_mps2 is None else Motion.of(draws_mps2, speed_mps, dt_s)
    metrics = []
    for name, (function, unit, in_si) in _METRICS.items():
        value = _finite(function(pulse) / in_si)
        lower, upper = (None, None) if draws is None else _interval(function(draws) / in_si)
        metrics.append(Metric(name, value, lower, upper, unit))
    return tuple(metrics)


def _interval(values: FloatArray) -> tuple[float | None, float | None]:
    ordered = np.sort(values)
    last = ordered.size - 1
    return _finite(ordered[math.floor(_TAIL * last)]), _finite(ordered[math.ceil((1 - _TAIL) * last)])


def _finite(value: npt.ArrayLike) -> float | None:
    number = float(np.asarray(value))
    return number if math.isfinite(number) else None
