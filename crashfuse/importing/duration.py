"""Whether a record lasts as long as the crash: one that ends before is refused, or its end is told."""

import numpy as np

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.campaign_folder.plausibility import CREEP_MPS, MOVING
from crashfuse.campaign_folder.recorded_pulse import SHORTEST_S
from crashfuse.errors import DataError, Problem
from crashfuse.importing.detection import delta_v, speed_text, step_of
from crashfuse.readers.record import ACCELERATION_UNITS, Record
from crashfuse.signals.pulse import GRID_S, FloatArray, Kinematics
from crashfuse.units import MS, G
from crashfuse.wording import number, time_text

_LONGER = {
    "tests": "export the whole record; or check time zero",
    "cae": "let the run go on to 100 ms, and copy all of its files; or check time zero",
}


def refuse_short(
    record: Record, time_s: FloatArray, values: FloatArray, unit: str | None, speed_mps: float, role: Role
) -> None:
    """Raise a DataError if a record is too short wherever contact lies, before its change of velocity is judged."""
    lasts = float(time_s[-1] - time_s[0])
    if lasts >= SHORTEST_S - step_of(time_s):
        return
    left = "" if unit is None else _left(speed_mps - abs(delta_v(time_s, values)) * ACCELERATION_UNITS[unit])
    _refuse(record, f"{time_text(lasts)}{left}", role)


def end_told(record: Record, end_s: float, motion: Kinematics, role: Role) -> list[str]:
    """The sentences on the end of the record, if it comes early, and on when the vehicle stops.

    Parameters
    ----------
    end_s : float
        Time of the last sample after contact.
    motion : Kinematics
        From contact on.

    Raises
    ------
    DataError
        If the record ends before 60 ms, or before 100 ms while the vehicle still moves.
    """
    speed, last, end = float(motion.velocity_mps[0]), float(motion.velocity_mps[-1]), time_text(end_s)
    told = []
    if end_s < SHORTEST_S - motion.dt_s:
        _refuse(record, f"{end}{_left(last)}", role)
    if end_s < GRID_S[-1] - motion.dt_s:
        if speed > CREEP_MPS and last > MOVING * speed:
            expected = "a record that lasts until the vehicle has stopped, or 100 ms"
            found = f"{speed_text(last)} left at its end, {end}"
            raise DataError(Problem(record.source, expected, found, _LONGER[role]))
        told.append(
            f"Careful: the record ends {end} after contact{_left(last)} and "
            f"{number(motion.accel_mps2[-1] / G, '+.2g')} g; it goes on with no acceleration, which nobody measured. "
            f"Better {_LONGER[role].partition(';')[0]}."
        )
    if motion.t0_s <= GRID_S[-1]:
        crush = f"{motion.displacement_m.max() / MS:.0f} mm"
        return [*told, f"Zero velocity (TTZV) at {motion.t0_s / MS:.1f} ms, after {crush}."]
    by = min(motion.displacement_m.size - 1, round(GRID_S[-1] / motion.dt_s))
    within, moved = f"{min(end_s, GRID_S[-1]) / MS:.0f} ms", f"{motion.displacement_m[by] / MS:.0f} mm"
    later = f"has {speed_text(last)} left at {end}"
    if np.isfinite(motion.t0_s):
        later = f"stops at {motion.t0_s / MS:.1f} ms"
    return [*told, f"Careful: the vehicle does not stop within {within}; it has moved {moved} by then and {later}."]


def _left(speed_mps: float) -> str:
    return f" with {speed_text(speed_mps)} left at its end"


def _refuse(record: Record, found: str, role: Role) -> None:
    expected = "a record of at least 60 ms from contact (100 ms is best)"
    raise DataError(Problem(record.source, expected, found, _LONGER[role]))
