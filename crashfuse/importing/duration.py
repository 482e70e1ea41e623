"""Whether a record lasts as long as the crash: one that ends before is refused, or its end is told."""

import numpy as np

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.campaign_folder.plausibility import CREEP_MPS, MOVING
from crashfuse.campaign_folder.recorded_pulse import SHORTEST_S, advice_if_short, rate_trouble
from crashfuse.errors import DataError, Problem
from crashfuse.importing.choices import Choices
from crashfuse.importing.detection import delta_v, own_zero, step_of
from crashfuse.readers.quantities import speed
from crashfuse.readers.record import Record
from crashfuse.readers.unit_spelling import ACCELERATION_UNITS
from crashfuse.signals.pulse import GRID_S, FloatArray, Kinematics
from crashfuse.units import MS, G
from crashfuse.wording import Sentence, number, time_text

_LONGER = {
    "tests": "export the whole record; or check time zero",
    "cae": "let the run go on to 100 ms, and copy all of its files; or check time zero",
}


def refuse_slow(record: Record, time_s: FloatArray) -> None:
    """Raise a DataError if a record is sampled too slowly."""
    if slow := rate_trouble(step_of(time_s), float(time_s[-1] - time_s[0])):
        raise DataError(Problem(record.source, *slow))


def refuse_short(
    record: Record,
    time_s: FloatArray,
    values: FloatArray,
    choices: Choices,
    unit: str | None,
    speed_mps: float,
    role: Role,
) -> None:
    """Raise a DataError if a record is too short whatever its unit and speed, by the earliest contact that may be."""
    earliest = 0.0 if own_zero(record, time_s) else float(time_s[0])
    end_s = float(time_s[-1]) - (earliest if choices.time_zero_s is None else choices.time_zero_s)
    if 0 < end_s < SHORTEST_S - step_of(time_s):
        factor = ACCELERATION_UNITS.get(choices.unit or unit or "", np.nan)
        advice = advice_if_short(float(time_s[-1] - time_s[0]), _LONGER[role])
        _refuse(record, end_s, speed_mps - abs(delta_v(time_s, values)) * factor, advice)


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
    first, last, end = float(motion.velocity_mps[0]), float(motion.velocity_mps[-1]), time_text(end_s)
    told: list[str] = []
    if end_s < SHORTEST_S - motion.dt_s:
        _refuse(record, end_s, last, _LONGER[role])
    if end_s < GRID_S[-1] - motion.dt_s:
        if first > CREEP_MPS and last > MOVING * first:
            expected = "a record that lasts until the vehicle has stopped, or 100 ms"
            found = Sentence(f"{{}} left at its end, {end}", speed(last))
            raise DataError(Problem(record.source, expected, found, _LONGER[role]))
        careful = (
            f"Careful: the record ends {end} after contact{{}} and {number(motion.accel_mps2[-1] / G, '+.2g')} g; it "
            f"goes on with no acceleration, which nobody measured. Better {_LONGER[role].partition(';')[0]}."
        )
        told.append(Sentence(careful, _left(last)))
    if motion.t0_s <= GRID_S[-1]:
        crush = f"{motion.displacement_m.max() / MS:.0f} mm"
        return [*told, f"Zero velocity (TTZV) at {motion.t0_s / MS:.1f} ms, after {crush}."]
    by = min(motion.displacement_m.size - 1, round(GRID_S[-1] / motion.dt_s))
    within, moved = f"{min(end_s, GRID_S[-1]) / MS:.0f} ms", f"{motion.displacement_m[by] / MS:.0f} mm"
    later = Sentence(f"has {{}} left at {end}", speed(last))
    if np.isfinite(motion.t0_s):
        later = Sentence(f"stops at {motion.t0_s / MS:.1f} ms")
    careful = f"Careful: the vehicle does not stop within {within}; it has moved {moved} by then and {{}}."
    return [*told, Sentence(careful, later)]


def _left(speed_mps: float) -> str:
    return "" if np.isnan(speed_mps) else Sentence(" with {} left at its end", speed(speed_mps))


def _refuse(record: Record, end_s: float, left_mps: float, advice: str) -> None:
    expected = "a record of at least 60 ms from contact (100 ms is best)"
    raise DataError(Problem(record.source, expected, Sentence(f"{time_text(end_s)}{{}}", _left(left_mps)), advice))
