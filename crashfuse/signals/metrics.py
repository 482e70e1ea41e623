"""Metrics of a crash pulse: positive numbers in display units, with intervals.

Each metric is a small function of a :class:`~crashfuse.signals.pulse.Kinematics`, in SI, and a line of ``_READINGS``.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from crashfuse.signals.occupant import occupant_load_criterion, vehicle_pulse_index
from crashfuse.signals.pulse import DT_S, FloatArray, Kinematics, kinematics
from crashfuse.units import KPH, MS, G

TAIL = 0.025  # share on either side of the central 95 %
_WINDOW_S = 0.025  # of SM25


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric of a pulse.

    Parameters
    ----------
    value : float or None
        None if the record is too short for the metric; :func:`missing_metrics` states the reason.
    lower, upper : float or None
        Central 95 % interval; None without draws, or if too many of them are too short to determine that end.
    """

    name: str
    value: float | None
    lower: float | None
    upper: float | None
    unit: str

    @property
    def text(self) -> str:
        """Value and interval as displayed: ``25.3 [24.1, 26.0]``."""
        value = "–" if self.value is None else f"{self.value:.1f}"
        if self.lower is None and self.upper is None:
            return value
        lower = "open" if self.lower is None else f"{self.lower:.1f}"
        upper = "beyond the record" if self.upper is None else f"{self.upper:.1f}"
        return f"{value} [{lower}, {upper}]"


def _peak(motion: Kinematics) -> FloatArray:
    """Largest deceleration."""
    return np.asarray(-motion.accel_mps2.min(axis=-1))


def _peak_time(motion: Kinematics) -> FloatArray:
    """Time of the largest deceleration."""
    return np.asarray(motion.accel_mps2.argmin(axis=-1) * motion.dt_s)


def _delta_v(motion: Kinematics) -> FloatArray:
    """Largest change of velocity over the record, rebound included."""
    return np.asarray((motion.velocity_mps[..., :1] - motion.velocity_mps).max(axis=-1))


def _t0(motion: Kinematics) -> FloatArray:
    """Time of zero velocity; infinite, meaning beyond the record, if there is none."""
    return np.where(np.isnan(motion.t0_s), np.inf, motion.t0_s)


def _max_crush(motion: Kinematics) -> FloatArray:
    """Maximum dynamic crush, the largest displacement; infinite if the vehicle does not stop."""
    return np.where(np.isnan(motion.t0_s), np.inf, motion.displacement_m.max(axis=-1))


def _mean(motion: Kinematics) -> FloatArray:
    """Mean deceleration from contact to zero velocity, v0/t0: the later the stop, the smaller."""
    return np.where(np.isnan(motion.t0_s), -np.inf, motion.velocity_mps[..., 0] / motion.t0_s)


def _sm25(motion: Kinematics) -> FloatArray:
    """Sliding mean over 25 ms: the largest loss of velocity within 25 ms of the record, over 25 ms."""
    steps = round(_WINDOW_S / motion.dt_s, 6)
    whole, share = int(steps), steps % 1
    velocity = motion.velocity_mps
    if velocity.shape[-1] <= math.ceil(steps):
        return np.full(velocity.shape[:-1], np.nan)
    after = velocity[..., whole:]
    if share:  # at 12.5 kHz 25 ms are 312.5 steps
        after = (1 - share) * after[..., :-1] + share * after[..., 1:]
    return np.asarray((velocity[..., : after.shape[-1]] - after).max(axis=-1) / _WINDOW_S)


def _olc(motion: Kinematics) -> FloatArray:
    """Occupant load criterion; counts as smaller if it takes longer than the record."""
    olc = occupant_load_criterion(motion.velocity_mps, motion.displacement_m, motion.dt_s)
    return np.where(np.isnan(olc), -np.inf, olc)


def _vpi(motion: Kinematics) -> FloatArray:
    """Vehicle pulse index; NaN, neither smaller nor larger, if its peak is yet to come."""
    return vehicle_pulse_index(motion.velocity_mps, motion.displacement_m, motion.dt_s)


class _Reading(NamedTuple):
    """How a metric is computed and displayed; ``needs`` is what must happen within the record."""

    label: str
    function: Callable[[Kinematics], FloatArray]
    unit: str
    in_si: float
    needs: str = ""


_STOP = "zero velocity"
_READINGS: Mapping[str, _Reading] = {
    "peak": _Reading("Peak deceleration", _peak, "g", G),
    "peak_time": _Reading("Time of peak", _peak_time, "ms", MS),
    "delta_v": _Reading("ΔV, rebound included", _delta_v, "km/h", KPH),
    "t0": _Reading("Time of zero velocity (TTZV)", _t0, "ms", MS, _STOP),
    "max_crush": _Reading("Maximum dynamic crush", _max_crush, "mm", 1e-3, _STOP),
    "mean": _Reading("Mean deceleration until TTZV", _mean, "g", G, _STOP),
    "sm25": _Reading("SM25, largest mean over 25 ms", _sm25, "g", G, "25 ms are over"),
    "olc": _Reading("OLC, occupant load criterion", _olc, "g", G, "the occupant has moved 300 mm within the vehicle"),
    "vpi": _Reading("VPI, vehicle pulse index", _vpi, "g", G, "the occupant's deceleration has peaked"),
}

METRIC_LABELS = {name: reading.label for name, reading in _READINGS.items()}
"""Labels of the metrics in tables."""


def metric_values(
    accel_mps2: FloatArray, speed_mps: FloatArray | float, *, dt_s: float = DT_S
) -> dict[str, FloatArray]:
    """All metrics of pulses, shape (..., n), in the units of :func:`pulse_metrics`; each of shape (...).

    The impact speed may be one for all, or one for each pulse.

    If the record ends too early: infinite (t0, max_crush), minus infinity (mean, olc), or NaN, which is either (vpi).
    """
    motion = kinematics(np.asarray(accel_mps2, dtype=np.float64), speed_mps, dt_s)
    return {name: reading.function(motion) / reading.in_si for name, reading in _READINGS.items()}


METRIC_UNITS = {name: reading.unit for name, reading in _READINGS.items()}
"""Units of the metrics in tables."""


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
        peak (g), peak_time (ms), delta_v (km/h), t0 (ms), max_crush (mm), mean (g), sm25 (g), olc (g), vpi (g).

    Notes
    -----
    peak is the largest deceleration, delta_v the largest change of velocity, rebound included; t0 the time of zero
    velocity, max_crush the largest displacement, mean v0/t0; sm25 the largest mean over any 25 ms within the record,
    (v(t) − v(t + 25 ms))/25 ms; olc the occupant load criterion (65 mm of free flight, 235 mm of restraint) and vpi the
    vehicle pulse index (ISO/TR 12353-3), with formulas in :mod:`crashfuse.signals.occupant`.

    The value is that of the pulse itself, so it can be checked against its curve. The interval is that of the draws.
    The pulse, a mean curve, is smoother than any draw, so its peak may lie below the interval.

    If the record ends too early the value is None. A draw that ends too early is not left out, as that would overstate
    certainty. One that does not stop counts as larger than any that does in t0 and max_crush, and as smaller in mean.
    One whose occupant is still moving forward counts as smaller in olc, as the same loss of speed takes longer.
    One whose vpi has yet to peak counts as smaller at the lower end and as larger at the upper. An end is thus None if
    more than one draw in forty is missing there. Interval ends are draws themselves, rounded outward.
    """
    values = metric_values(accel_mps2, speed_mps, dt_s=dt_s)
    drawn = None if draws_mps2 is None else metric_values(draws_mps2, speed_mps, dt_s=dt_s)
    intervals = {name: (None, None) if drawn is None else _interval(drawn[name]) for name in values}
    return tuple(Metric(n, _finite(value), *intervals[n], METRIC_UNITS[n]) for n, value in values.items())


def missing_metrics(metrics: Sequence[Metric]) -> tuple[str, ...]:
    """Sentences on which metrics and interval ends of a pulse are missing, one per reason; empty if none is."""
    drawn = any(metric.lower is not None for metric in metrics)
    values, ends = defaultdict[str, list[str]](list), defaultdict[str, list[str]](list)
    for metric in metrics:
        reading = _READINGS[metric.name]
        if metric.value is None:
            values[reading.needs].append(reading.label)
        missing = [name for name, end in (("lower", metric.lower), ("upper", metric.upper)) if drawn and end is None]
        if missing:
            ends[reading.needs].append(f"{reading.label} ({' and '.join(missing)} end)")
    return (
        *(f"The record ends before {needs}, so there is no: {'; '.join(who)}." for needs, who in values.items()),
        *(
            f"More than one draw in forty ends before {needs}, which leaves open: {'; '.join(who)}."
            for needs, who in ends.items()
        ),
    )


def missing_sentences(metrics: Iterable[tuple[str, Sequence[Metric]]]) -> list[str]:
    """Sentences of :func:`missing_metrics` for named pulses, each once with the names that it applies to."""
    said: dict[str, list[str]] = {}
    for name, own in metrics:
        for sentence in missing_metrics(own):
            said.setdefault(sentence, []).append(name)
    return [f"{', '.join(names)}: {sentence}" for sentence, names in said.items()]


def _interval(values: FloatArray) -> tuple[float | None, float | None]:
    """Ends of the central 95 %; NaN counts as beyond either end."""
    last = values.size - 1
    lowest, highest = (np.sort(np.where(np.isnan(values), beyond, values)) for beyond in (-np.inf, np.inf))
    return _finite(lowest[math.floor(TAIL * last)]), _finite(highest[math.ceil((1 - TAIL) * last)])


def _finite(value: npt.ArrayLike) -> float | None:
    number = float(np.asarray(value))
    return number if math.isfinite(number) else None
