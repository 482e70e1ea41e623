"""Unit system of a run: LS-DYNA records none, so it is inferred from the run's duration and speed.

Crash models are built in mm, s, t; in mm, ms, kg; or in m, s, kg.
"""

from collections.abc import Sequence

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.readers.lsdyna.histories import History
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MS

LONGEST_S, _LONGEST_MS = 2.0, 2000.0  # longest duration of a run in either unit
_SLOWEST_S = 5e-3  # time step of a run in s; a longer one is in ms, of a run that ended at once
FASTEST_MPS, _SLOWEST_MMPS = 100.0, 3000.0  # in between, the unit could be inch or cm


def units_of(nodes: Sequence[History], source: str) -> tuple[float, str | None, str]:
    """The unit of time in s, the unit of acceleration, and a sentence."""
    end, fastest = float(nodes[0].time[-1]), max(float(np.abs(node.velocity).max()) for node in nodes)
    if not 0 < end <= _LONGEST_MS:
        expected = "a crash in seconds or milliseconds"
        raise DataError(Problem(source, expected, f"a run that ends at {end:g}", "choose a run in mm, ms, kg or SI"))
    step = end / max(nodes[0].time.size - 1, 1)
    seconds = end <= LONGEST_S and (step <= _SLOWEST_S or fastest >= _SLOWEST_MMPS)
    lasts = f"the run ends at {end:.4g} and its nodes move at up to {fastest:.4g}"
    if not seconds:
        return MS, "mm/ms²", f"Units mm and ms: {lasts}."
    if not fastest > 0:  # at rest, or no velocities
        return 1.0, None, f"Unit of length unknown: the run ends at {end:.4g} s, and its velocities do not tell."
    if fastest <= FASTEST_MPS:
        return 1.0, "m/s²", f"SI units: {lasts}."
    if fastest < _SLOWEST_MMPS:
        return 1.0, None, f"Unit of length unknown: {lasts}, too fast for m and too slow for mm."
    return 1.0, "mm/s²", f"Units mm and s: {lasts}."


def mass_kg(energy: float | None, nodes: Sequence[History]) -> float | None:
    """The mass that follows from the kinetic energy at the nodes' speed; its size tells whether it is in t, kg or g."""
    speed = float(np.median([abs(node.velocity[0]) for node in nodes]))
    if energy is None or not energy > 0 or not speed > 0:
        return None
    return of_a_vehicle(np.array([2 * energy / speed**2]))


def of_a_vehicle(mass: FloatArray | None) -> float | None:
    """The first mass in kg if it is that of a vehicle in t, kg or g."""
    if mass is None or not mass.size:
        return None
    return next((kg for unit in (1.0, 1e3, 1e-3) if 300 <= (kg := float(mass[0]) * unit) <= 60_000), None)
