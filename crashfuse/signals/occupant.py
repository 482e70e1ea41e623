"""Occupant criteria of a crash pulse: two models with one degree of freedom that need no restraint data.

The occupant keeps the impact speed v0 until the restraint takes hold; its motion relative to the vehicle is the
difference of the two displacements.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crashfuse.errors import UsageError, require_number
from crashfuse.signals.pulse import FloatArray


@dataclass(frozen=True, slots=True)
class OccupantModel:
    """Distances of the OLC, slack and spring of the VPI; those of their definitions unless given.

    Parameters
    ----------
    olc_free_flight_mm, olc_restraint_mm : float
        How far the occupant moves within the vehicle before the restraint takes hold, and while it slows him down.
    vpi_slack_mm, vpi_stiffness_npm : float
        Slack of the spring, and its stiffness in N/m for a mass of 1 kg.
    """

    olc_free_flight_mm: float = 65.0
    olc_restraint_mm: float = 235.0
    vpi_slack_mm: float = 30.0
    vpi_stiffness_npm: float = 2500.0

    def __post_init__(self) -> None:
        for name, (low, high) in OCCUPANT_RANGES.items():
            require_number(name, value := getattr(self, name))
            if not low <= value <= high:
                raise UsageError(f"{name} is between {low} and {high}, not {value!r}.")
            if advice := likely_m(name, value):
                raise UsageError(f"{name} is in mm: {advice}.")

    @property
    def olc_words(self) -> str:
        """The distances of the OLC, such as ``100 + 200 mm``; empty if they are the usual ones."""
        return self._unless_usual("{0.olc_free_flight_mm:g} + {0.olc_restraint_mm:g} mm")

    @property
    def vpi_words(self) -> str:
        """The slack and spring of the VPI, such as ``20 mm, 3000 N/m``; empty if they are the usual ones."""
        return self._unless_usual("{0.vpi_slack_mm:g} mm, {0.vpi_stiffness_npm:g} N/m")

    @property
    def words(self) -> str:
        """What is not as usual, of both."""
        return " and ".join(filter(None, (self.olc_words, self.vpi_words))) or "the usual one"

    def _unless_usual(self, words: str) -> str:
        text = words.format(self)
        return "" if text == words.format(USUAL_OCCUPANT) else text


def likely_m(name: str, value: float) -> str:
    """What to write if a length in mm must have been given in m; empty if it need not."""
    return f"if {value:g} m is meant, write {1e3 * value:g}" if name.endswith("_mm") and 0 < value < 1 else ""


# a slack or free flight of nothing is a choice; without a restraint or a spring there is no metric
OCCUPANT_RANGES = {
    "olc_free_flight_mm": (0, 1000),
    "olc_restraint_mm": (1, 1000),
    "vpi_slack_mm": (0, 1000),
    "vpi_stiffness_npm": (1, 1_000_000),
}
USUAL_OCCUPANT = OccupantModel()
_MM_PER_M = 1e3


def occupant_load_criterion(
    velocity_mps: FloatArray,
    displacement_m: FloatArray,
    dt_s: float,
    occupant: OccupantModel = USUAL_OCCUPANT,
    free: npt.NDArray[np.bool_] | bool = False,
) -> FloatArray:
    """The constant deceleration that brings the occupant to the vehicle's velocity after 300 mm (OLC).

    With the vehicle's v and s, the free flight ends at t1 and the restraint at t2, the first times at which

    - v0·t1 − s(t1) = 65 mm,
    - (v0 + v(t2))/2·(t2 − t1) − (s(t2) − s(t1)) = 235 mm, as the occupant slows evenly from v0 to v(t2),

    and OLC = (v0 − v(t2))/(t2 − t1) in m/s²: a·300/235 at a constant rate a. A vehicle that moves freely (``free``)
    when the record ends goes on at its last velocity. NaN where the record ends before t1, or before t2 of one that
    does not, and where a free vehicle leaves no slower than it came.

    L. Kübler, S. Gargallo, K. Elsäßer: Characterization and evaluation of frontal crash pulses with respect to occupant
    safety. Airbag 2008. Euro NCAP, Technical Bulletin TB 027, applies it to a barrier trolley.
    """
    speed = velocity_mps[..., :1]
    time = np.arange(velocity_mps.shape[-1]) * dt_s
    flown = speed * time - displacement_m
    free_flight_m, restraint_m = occupant.olc_free_flight_mm / _MM_PER_M, occupant.olc_restraint_mm / _MM_PER_M
    t1 = first_reached(flown, free_flight_m)[..., None] * dt_s
    way = (speed + velocity_mps) / 2 * (time - t1) - (displacement_m - (speed * t1 - free_flight_m))
    end, last = first_reached(way, restraint_m), velocity_mps.shape[-1] - 1
    closing, left = (speed[..., 0] - velocity_mps[..., -1]) / 2 * dt_s, restraint_m - way[..., -1]
    later = np.divide(left, closing, out=np.full_like(left, np.nan), where=closing > 0)
    end = np.where(free & np.isnan(end), last + later, end)
    return np.asarray((speed[..., 0] - value_at(velocity_mps, np.minimum(end, last))) / (end * dt_s - t1[..., 0]))


def vehicle_pulse_index(
    velocity_mps: FloatArray, displacement_m: FloatArray, dt_s: float, occupant: OccupantModel = USUAL_OCCUPANT
) -> FloatArray:
    """Peak deceleration of 1 kg behind 30 mm of slack on a spring of 2500 N/m in the vehicle (VPI, ISO/TR 12353-3).

    The mass follows m·y'' = −k·max(0, y − s − slack), with y(0) = 0 and y'(0) = v0; the spring only pulls, undamped. It
    is integrated by y(t + Δt) − y(t) = y(t) − y(t − Δt) + Δt²·y''(t). At a constant rate a, VPI is
    a (1 + √(1 + 2·slack·k/(m·a))). NaN where the spring is longest at the end of the record or never taut.
    """
    n = displacement_m.shape[-1]
    slack_m, stiffness = occupant.vpi_slack_mm / _MM_PER_M, occupant.vpi_stiffness_npm  # of 1 kg
    taut = np.ascontiguousarray(displacement_m.reshape(-1, n).T) + slack_m
    step: FloatArray = velocity_mps[..., 0].ravel() * dt_s
    stretch = _stretched(taut, step, stiffness * dt_s**2)
    longest = stretch.argmax(axis=0)
    index: FloatArray = np.where((longest > 0) & (longest < n - 1), stiffness * stretch.max(axis=0), np.nan)
    return index.reshape(displacement_m.shape[:-1])


def _stretched(taut: FloatArray, step: FloatArray, pull: float) -> FloatArray:
    stretch = np.zeros_like(taut)
    now, pulled = step.copy(), np.empty_like(step)
    for at, row in zip(taut[1:], stretch[1:], strict=True):
        np.subtract(now, at, out=row)
        np.maximum(row, 0.0, out=row)
        np.multiply(row, pull, out=pulled)
        step -= pulled
        now += step
    return stretch


def first_reached(values: FloatArray, level: float) -> FloatArray:
    """Fractional sample along the last axis at which a level is first reached; NaN if it is not."""
    reached = values >= level
    after = np.maximum(reached.argmax(axis=-1), 1)[..., None]
    high, low = np.take_along_axis(values, after, axis=-1), np.take_along_axis(values, after - 1, axis=-1)
    share = np.divide(level - low, high - low, out=np.zeros_like(low), where=high > low)
    return np.where(reached.any(axis=-1), (after - 1 + share)[..., 0], np.nan)


def value_at(values: FloatArray, sample: FloatArray) -> FloatArray:
    """Values at fractional samples of the last axis, linearly interpolated; NaN at NaN."""
    before = np.minimum(np.nan_to_num(sample).astype(int), values.shape[-1] - 2)[..., None]
    low, high = np.take_along_axis(values, before, axis=-1), np.take_along_axis(values, before + 1, axis=-1)
    return np.asarray((low + (sample[..., None] - before) * (high - low))[..., 0])
