"""The axis along which a vehicle travels: found from how the nodes of a run set out, or given by the user."""

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.readers.axes import AXES, Travel
from crashfuse.signals.pulse import FloatArray

_SLOWEST_MPS = 1.0
_LEAST_OF_FASTEST = 0.2  # a vehicle is at its fastest when it sets out; what is accelerated first is none
_OBLIQUE = 0.25  # 14°: the component along the axis is 3 % short


def axis_of_travel(start: FloatArray, travel: Travel | None = None) -> int:
    """The number of the axis: the one given, else that along which the nodes set out fastest on average.

    Parameters
    ----------
    start : ndarray, shape (3, n_nodes)
        Velocities along x, y and z when the run begins; nodes at rest (a barrier's) do not matter.
    """
    if travel is not None:
        return AXES.index(travel[-1])
    return int(np.abs(_known(start)).mean(axis=1).argmax())


def checked_travel(
    start: FloatArray,
    speeds: tuple[float, float],
    fastest: FloatArray,
    per_mps: float | None,
    travel: Travel | None,
    source: str,
) -> tuple[str, bool]:
    """The sentence on the direction of travel, and whether the nodes set out with the speed of the impact.

    Parameters
    ----------
    start : ndarray, shape (3, n_nodes)
        Velocities of all nodes when the run begins.
    speeds : (float, float)
        Speed of the nodes of the pulse along the axis when the run begins, and the largest of theirs in the run.
    fastest : ndarray, shape (3,)
        Largest speed of any node along each axis.
    per_mps : float, optional
        Factor from the file's velocities to m/s; None if its unit of length is unknown.

    Raises
    ------
    DataError
        If nothing sets out as a vehicle does, or in another direction than the user says.
    """
    axis, start = axis_of_travel(start, travel), _known(start)
    found = f"{'-' if start[axis].sum() < 0 else ''}{AXES[axis]}"
    own, largest = speeds
    moves = own > 0 and own >= _LEAST_OF_FASTEST * largest and (per_mps is None or own * per_mps >= _SLOWEST_MPS)
    at_start, at_most = _by_axis(np.abs(start).max(axis=1), per_mps), _by_axis(fastest, per_mps)
    if travel is not None:
        if not largest * (per_mps or 1.0) > (_SLOWEST_MPS if per_mps else 0.0):
            expected, advice = f"nodes that move along {travel}, as given", "check the direction (--travel)"
            raise DataError(Problem(source, expected, f"at most {at_most}", advice))
        if moves and found != travel:
            expected = f"nodes that set out along {travel}, as given"
            raise DataError(Problem(source, expected, f"along {found}", f"check the direction (--travel {found})"))
        if _aslant(start, axis):
            return f"Careful: travel along {travel}, given by the user, but nodes set out at {at_start} at most.", moves
        return f"Travel along {travel}, given by the user.", moves
    if not moves:
        expected = "nodes that travel like a vehicle's, fastest when they set out"
        advice = "choose the run of a vehicle; if it is struck at rest, give axis and speed (--travel, --speed-kph)"
        raise DataError(Problem(source, expected, f"{at_start} at the start, at most {at_most}", advice))
    if _aslant(start, axis):
        expected = "a vehicle that travels along one axis"
        advice = "write the nodes in axes of the vehicle, or give the axis to be read (--travel)"
        raise DataError(Problem(source, expected, f"nodes that set out at {at_start}", advice))
    return f"Travel along {found}, as the nodes set out.", moves


def _aslant(start: FloatArray, axis: int) -> bool:
    """Whether half of the nodes set out along another axis, too; of a wheel's, not all do."""
    middle = np.median(np.abs(start), axis=1)
    return bool(middle[axis] > 0 and (middle > _OBLIQUE * middle[axis]).sum() > 1)


def _known(start: FloatArray) -> FloatArray:
    return np.nan_to_num(start, nan=0.0, posinf=0.0, neginf=0.0)


def _by_axis(speeds: FloatArray, per_mps: float | None) -> str:
    """The speeds along each axis in m/s, or in the unit of the file."""
    scaled = (speeds * (per_mps or 1.0)).tolist()
    told = ", ".join(f"{axis} {speed:.3g}" for axis, speed in zip(AXES, scaled, strict=True))
    return f"{told} {'in the unit of the file' if per_mps is None else 'm/s'}"
