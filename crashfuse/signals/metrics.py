"""Metrics of a crash pulse: positive numbers in display units, with intervals.

Each metric is a small function of a :class:`~crashfuse.signals.pulse.Kinematics`, in SI, and a line of ``_READINGS``.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from crashfuse.errors import require_a
from crashfuse.signals import pulse_shape
from crashfuse.signals.occupant import USUAL_OCCUPANT, OccupantModel, occupant_load_criterion, vehicle_pulse_index
from crashfuse.signals.pulse import DT_S, TAIL, FloatArray, Kinematics, checked_pulse, kinematics, with_late_stops
from crashfuse.units import KPH, MS, G, Sentence, interval_texts, joined

_WINDOW_S = 0.025  # of SM25


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric of a pulse; ``value`` is None if the record is too short for it.

    ``lower`` and ``upper`` are the central 95 %, None without draws (``drawn``) or if too many are too short. Of a
    prediction ``value`` is the median of single tests, ``of_pulse`` that of the averaged pulse, whose peaks are lower.
    """

    name: str
    value: float | None
    lower: float | None
    upper: float | None
    unit: str
    drawn: bool = False
    of_pulse: float | None = None
    folds: Mapping[str, "Metric"] = field(default_factory=dict, hash=False)  # by the tests that fold so, if in two ways

    def holds(self, value: float | None) -> bool | None:
        """Whether the interval holds a value; None if either is not known."""
        if value is None or (self.lower is None and self.upper is None):
            return None
        return (self.lower is None or self.lower <= value) and (self.upper is None or value <= self.upper)

    @property
    def interval(self) -> tuple[float | None, float | None, float | None]:
        """The value and both ends, infinite where open."""
        ends = (self.lower, -math.inf), (self.upper, math.inf)
        is_open = self.drawn or self.lower is not None or self.upper is not None
        lower, upper = (far if end is None and is_open else end for end, far in ends)
        return self.value, lower, upper

    @property
    def digits(self) -> int:
        """Decimals as displayed: ratios have two."""
        return 1 if self.unit else 2

    @property
    def text_with_unit(self) -> str:
        """As displayed: ``25.3 [24.1, 26.0] g``, ``25.3 [open] g``, ``≤ 15.3 g (95 %, record too short)``."""
        numbers, unit = (self.value, self.lower, self.upper), f" {self.unit}" if self.unit else ""
        texts = [None if number is None else f"{number:.{self.digits}f}" for number in numbers]
        value, detail = interval_texts(texts[0], texts[1], texts[2], is_open=self.drawn)
        if self.value is None:
            return f"{value}{unit} {detail}" if detail else value
        return f"{value} {detail}{unit}" if detail else f"{value}{unit}"


def _sm25(motion: Kinematics) -> FloatArray:
    steps = round(_WINDOW_S / motion.dt_s, 6)
    whole, share = int(steps), steps % 1
    velocity = motion.velocity_mps
    if velocity.shape[-1] <= math.ceil(steps):
        return np.full(velocity.shape[:-1], np.nan)
    after = velocity[..., whole:]
    if share:  # at 12.5 kHz 25 ms are 312.5 steps
        after = (1 - share) * after[..., :-1] + share * after[..., 1:]
    return np.asarray((velocity[..., : after.shape[-1]] - after).max(axis=-1) / _WINDOW_S)


def _olc(motion: Kinematics, occupant: OccupantModel) -> FloatArray:
    free = pulse_shape.moves_freely(motion)
    olc = occupant_load_criterion(motion.velocity_mps, motion.displacement_m, motion.dt_s, occupant, free)
    return np.where(np.isnan(olc), -np.inf, olc)


def _vpi(motion: Kinematics, occupant: OccupantModel) -> FloatArray:
    return vehicle_pulse_index(motion.velocity_mps, motion.displacement_m, motion.dt_s, occupant)


def _mean(motion: Kinematics) -> FloatArray:
    return np.nan_to_num(motion.velocity_mps[..., 0] / motion.t0_s, nan=-np.inf)


class _Reading(NamedTuple):
    """``needs`` is what must happen within the record; of ``occupant`` metrics the function takes the model, too."""

    label: str
    function: Callable[..., FloatArray]
    unit: str
    in_si: float
    needs: str = ""
    minor: bool = False
    occupant: str = ""

    def of(self, motion: Kinematics, occupant: OccupantModel) -> FloatArray:
        values = self.function(motion, occupant) if self.occupant else self.function(motion)
        return np.asarray(values / self.in_si)


_STOP, _LEFT = "zero velocity", "the vehicle has left the barrier"
_RESTRAINED = "the OLC's restraint is over, or the vehicle moves freely"
_PEAKED = "the occupant's deceleration has peaked"
_READINGS: Mapping[str, _Reading] = {
    "peak": _Reading("Peak deceleration", lambda m: -m.accel_mps2.min(axis=-1), "g", G),
    "peak_time": _Reading("Time of peak", lambda m: m.accel_mps2.argmin(axis=-1) * m.dt_s, "ms", MS),
    "delta_v": _Reading(
        "ΔV, rebound included", lambda m: (m.velocity_mps[..., :1] - m.velocity_mps).max(axis=-1), "km/h", KPH
    ),
    # infinite beyond the record; the later the stop, the smaller the mean
    "t0": _Reading("Time of zero velocity (TTZV)", lambda m: np.nan_to_num(m.t0_s, nan=np.inf), "ms", MS, _STOP),
    "max_crush": _Reading("Maximum dynamic crush", lambda m: np.nan_to_num(m.crush_m, nan=np.inf), "mm", 1e-3, _STOP),
    "mean": _Reading("Mean deceleration until TTZV", _mean, "g", G, _STOP),
    "sm25": _Reading("SM25, largest mean over 25 ms", _sm25, "g", G, "25 ms are over"),
    "olc": _Reading("OLC, occupant load criterion", _olc, "g", G, _RESTRAINED, occupant="olc_words"),
    "vpi": _Reading("VPI, vehicle pulse index", _vpi, "g", G, _PEAKED, occupant="vpi_words"),
    "esw": _Reading("Equivalent square wave", pulse_shape.equivalent_square_wave, "g", G, _STOP, minor=True),
    "g1": _Reading("Two-step pulse, G1", lambda m: pulse_shape.two_step(m).g1_mps2, "g", G, _STOP, minor=True),
    "g2": _Reading("Two-step pulse, G2", lambda m: pulse_shape.two_step(m).g2_mps2, "g", G, _STOP, minor=True),
    "step_time": _Reading(
        "Two-step pulse, time of the step", lambda m: pulse_shape.two_step(m).time_s, "ms", MS, _STOP, minor=True
    ),
    "centroid_time": _Reading("Centroid time of the pulse", pulse_shape.centroid_time, "ms", MS, _STOP, minor=True),
    "loading_ratio": _Reading("Front-to-back loading ratio", pulse_shape.loading_ratio, "", 1.0, _STOP, minor=True),
    "static_crush": _Reading("Static crush", pulse_shape.static_crush, "mm", 1e-3, _LEFT, minor=True),
    "rebound_velocity": _Reading("Rebound velocity", pulse_shape.rebound_velocity, "km/h", KPH, _LEFT, minor=True),
    "restitution": _Reading("Coefficient of restitution", pulse_shape.restitution, "", 1.0, _LEFT, minor=True),
}

METRIC_LABELS = {name: reading.label for name, reading in _READINGS.items()}
"""Labels of the metrics in tables."""
METRIC_UNITS = {name: reading.unit for name, reading in _READINGS.items()}
"""Units of the metrics in tables; empty for ratios."""
METRIC_NEEDS = {name: reading.needs for name, reading in _READINGS.items()}
"""What must happen within a record before it has the metric; empty if every record has it."""
MAIN_METRICS = tuple(name for name, reading in _READINGS.items() if not reading.minor)
"""The metrics that tables show first; the others are shown on demand, and are in every file."""


def in_sentence(label: str) -> str:
    """A label as within a sentence: its abbreviation, or in small letters."""
    head = label.partition(",")[0]
    short = head.partition("(")[2].rstrip(")") or head
    return short if short[1].isupper() else f"{label[0].lower()}{label[1:]}"


def metric_headings(filter_class: str = "", occupant: OccupantModel = USUAL_OCCUPANT) -> dict[str, str]:
    """Labels of the metrics; those of the occupant with their bases."""
    bases = metric_bases(filter_class, occupant)
    return {
        name: f"{reading.label}, {bases[name]}" if reading.occupant and bases[name] else reading.label
        for name, reading in _READINGS.items()
    }


def metric_bases(filter_class: str, occupant: OccupantModel = USUAL_OCCUPANT) -> dict[str, str]:
    """What each metric rests on: the filter class, and unusual settings of the occupant model."""
    settings = {name: getattr(occupant, read.occupant) if read.occupant else "" for name, read in _READINGS.items()}
    return {name: ", ".join(filter(None, (setting, filter_class))) for name, setting in settings.items()}


def metric_values(
    accel_mps2: FloatArray,
    speed_mps: FloatArray | float,
    *,
    dt_s: float = DT_S,
    occupant: OccupantModel = USUAL_OCCUPANT,
    predicted: bool = False,
    names: Iterable[str] = _READINGS,
) -> dict[str, FloatArray]:
    """Metrics of pulses, shape (..., n), in the units of :func:`pulse_metrics`; each of shape (...).

    Those ``predicted`` stop beyond the record as in :func:`crashfuse.signals.pulse.with_late_stops`. If the record ends
    too early: infinite (t0, max_crush), minus infinity (mean, olc), or NaN, which is either (vpi).
    """
    motion = kinematics(np.asarray(accel_mps2, dtype=np.float64), speed_mps, dt_s)
    if predicted:
        motion = with_late_stops(motion)
    return {name: _READINGS[name].of(motion, occupant) for name in names}


def pulse_metrics(
    accel_mps2: FloatArray,
    speed_mps: float,
    *,
    dt_s: float = DT_S,
    draws_mps2: FloatArray | None = None,
    occupant: OccupantModel = USUAL_OCCUPANT,
) -> tuple[Metric, ...]:
    """Metrics of a pulse; with draws, the central 95 % interval of each.

    Parameters
    ----------
    accel_mps2, speed_mps : ndarray, shape (n,), and float
        Signed acceleration in m/s², the first sample at contact; impact speed.
    dt_s : float
        Time step in s.
    draws_mps2 : ndarray, shape (n_draws, n), optional
        Equally likely whole pulses.
    occupant : OccupantModel
        Distances of the OLC, slack and spring of the VPI.

    Returns
    -------
    tuple of Metric
        peak (g), peak_time (ms), delta_v (km/h), t0 (ms), max_crush (mm), mean (g), sm25 (g), olc (g), vpi (g), esw
        (g), g1 (g), g2 (g), step_time (ms), centroid_time (ms), loading_ratio, static_crush (mm), rebound_velocity
        (km/h), restitution.

    Notes
    -----
    peak is the largest deceleration, delta_v the largest change of velocity, rebound included; t0 the time of zero
    velocity, max_crush the largest displacement, mean v0/t0; sm25 the largest mean over any 25 ms within the record,
    (v(t) − v(t + 25 ms))/25 ms. For olc, the occupant load criterion, and vpi, the vehicle pulse index, see
    :mod:`crashfuse.signals.occupant`; for the others, shape and rebound, :mod:`crashfuse.signals.pulse_shape`.

    The value is that of the pulse itself, the interval that of the draws: a mean curve is smoother than any of them, so
    its peak may lie below the interval. A speed or step that can only be in another unit is a DataError, and so is a
    pulse that is over before it stops the vehicle.

    If the record ends too early the value is None. A draw that ends too early still counts. One that has lost three
    quarters of its impact speed goes on with half of its mean deceleration so far; one that is faster counts as larger
    than any that stops in t0 and max_crush, as smaller in mean. One whose occupant still moves forward counts as
    smaller in olc, unless the vehicle moves freely by then; one whose vpi has yet to peak as smaller at the lower end
    and as larger at the upper. An end is None if more than one draw in forty is missing there.
    """
    accel_mps2, draws_mps2 = checked_pulse(accel_mps2, speed_mps, dt_s, draws_mps2)
    require_a(OccupantModel, occupant, "crashfuse.OccupantModel()")
    return checked_metrics(accel_mps2, speed_mps, dt_s=dt_s, draws_mps2=draws_mps2, occupant=occupant)


def checked_metrics(
    accel_mps2: FloatArray,
    speed_mps: float,
    *,
    dt_s: float = DT_S,
    draws_mps2: FloatArray | None = None,
    occupant: OccupantModel = USUAL_OCCUPANT,
) -> tuple[Metric, ...]:
    """:func:`pulse_metrics` of a pulse whose units were checked."""
    values = metric_values(accel_mps2, speed_mps, dt_s=dt_s, occupant=occupant)
    intervals: dict[str, tuple[float | None, float | None]] = dict.fromkeys(values, (None, None))
    if draws_mps2 is not None:
        drawn = metric_values(draws_mps2, speed_mps, dt_s=dt_s, occupant=occupant, predicted=True)
        intervals = {name: _interval(of_draws) for name, of_draws in drawn.items()}
    return tuple(
        Metric(name, value, *intervals[name], METRIC_UNITS[name], drawn=draws_mps2 is not None, of_pulse=value)
        for name, value in zip(values, map(_finite, values.values()), strict=True)
    )


def _interval(values: FloatArray) -> tuple[float | None, float | None]:
    last = values.size - 1
    lowest, highest = (np.sort(np.where(np.isnan(values), beyond, values)) for beyond in (-np.inf, np.inf))
    return _finite(lowest[math.floor(TAIL * last)]), _finite(highest[math.ceil((1 - TAIL) * last)])


def _finite(value: npt.ArrayLike) -> float | None:
    number = float(np.asarray(value))
    return number if math.isfinite(number) else None


def sprague_geers(reference: FloatArray, comparison: FloatArray) -> dict[str, float]:
    """Errors of magnitude and phase, each blind to the other, and both together (Geers 1984; Sprague and Geers 2003).

    The magnitude's is relative, positive where the comparison is the stronger; that of the phase is 0 to 1, as a share
    of half a period, NaN of a comparison that is zero throughout. 0 is a perfect match; neither is a grade.
    """
    products = reference**2, comparison**2, reference * comparison
    of_reference, of_comparison, of_both = (float(np.trapezoid(product)) for product in products)
    magnitude, phase = float(np.sqrt(of_comparison / of_reference)) - 1, math.nan
    if of_comparison:
        phase = float(np.arccos(np.clip(of_both / np.sqrt(of_reference * of_comparison), -1, 1)) / np.pi)
    return {"sg_magnitude": magnitude, "sg_phase": phase, "sg_comprehensive": float(np.hypot(magnitude, phase))}


def residual_anova(reference: FloatArray, comparison: FloatArray) -> dict[str, float]:
    """Mean and standard deviation of the differences, as shares of the largest value of the reference (Ray 1996)."""
    residuals = (comparison - reference) / np.abs(reference).max()
    return {"anova_mean": float(residuals.mean()), "anova_deviation": float(residuals.std(ddof=1))}


FURTHER_METRICS: Mapping[str, Callable[[FloatArray, FloatArray], dict[str, float]]] = {
    "sprague-geers": sprague_geers,
    "anova": residual_anova,
}
"""Of two curves as they are, by the names that ``--also`` knows; each gives columns."""


def further_metrics(curves: tuple[FloatArray, FloatArray], names: Iterable[str]) -> dict[str, float]:
    """The columns of these :data:`FURTHER_METRICS`, of a reference and a comparison."""
    return {column: value for name in names for column, value in FURTHER_METRICS[name](*curves).items()}


def missing_sentences(metrics: Iterable[tuple[str, Sequence[Metric]]]) -> list[str]:
    """Sentences on which metrics and interval ends of named pulses are missing, one per reason and set of metrics."""
    names: dict[str, list[str]] = {}
    for name, of_pulse in metrics:
        values, ends = defaultdict[str, list[str]](list), defaultdict[str, list[str]](list)
        for metric in of_pulse:
            needs, label = METRIC_NEEDS[metric.name], METRIC_LABELS[metric.name]
            if metric.value is None:
                values[needs].append(label)
            missing = [end for end in ("lower", "upper") if getattr(metric, end) is None]
            if metric.drawn and missing:
                ends[needs].append(f"{label} ({' and '.join(missing)} end)")
        no_value = "The record ends before {}, which leaves no value of: {}."
        open_end = "More than one draw in forty ends before {}, which leaves open: {}."
        for sentence, lacking in ((no_value, values), (open_end, ends)):
            for needs, labels in lacking.items():
                names.setdefault(sentence.format(needs, "; ".join(labels)), []).append(name)
    return [Sentence("{}: {}", joined(of_sentence, ", "), sentence) for sentence, of_sentence in names.items()]
