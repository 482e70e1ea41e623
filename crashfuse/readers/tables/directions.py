"""Directions of the columns of a table: which one is that of travel, told by the changes of velocity."""

import re
from collections.abc import Callable, Mapping

import numpy as np

from crashfuse.readers.axes import AXES
from crashfuse.signals.pulse import FloatArray

_LETTER = re.compile(r"(?<![^\W\d_])(a|acc|accel)?([ _.-]?)([xyz])(?![^\W\d_])", re.IGNORECASE)
_CODE = re.compile(r"(?<![^\W_])([0-9?_][0-9A-Z?_]{11}AC)([XYZ123])([0-9A-Z?_])(?![^\W_])", re.IGNORECASE)
_NUMBERS = "123"  # of the directions in some codes
_MANY_TIMES = 2.0
_BEGINNING = 100  # that part of the record tells its zero
_SMALL = 0.1  # of the peak


def turned(header: str, axis: str) -> str:
    """A header with the names of an axis and of x exchanged: ``ay`` along y is what ``ax`` is along x."""
    if axis == "x":
        return header
    other = {axis: "x", "x": axis}

    def letter(match: re.Match[str]) -> str:
        found = match.group(3)
        new = other.get(found.lower(), found)
        return f"{match.group(1) or ''}{match.group(2)}{new.upper() if found.isupper() else new}"

    def code(match: re.Match[str]) -> str:
        found = match.group(2)
        named = AXES[_NUMBERS.index(found)] if found in _NUMBERS else found.lower()
        return f"{match.group(1)}{other.get(named, named).upper()}{match.group(3)}"

    return _CODE.sub(code, header) if _CODE.search(header) else _LETTER.sub(letter, header)


def axis_by_motion(
    accelerations: Mapping[str, tuple[str, ...]], values: Callable[[str], FloatArray]
) -> tuple[str, str]:
    """The axis of travel, and a sentence if it is not plainly x.

    Parameters
    ----------
    accelerations : mapping of str to tuple of str
        Columns by the axis that their headers name; only axes that have some.
    values : callable
        Numbers of a column.
    """
    if set(accelerations) <= {"x"}:
        return "x", ""
    gains = {
        axis: float(np.median([_gain(values(column)) for column in columns])) for axis, columns in accelerations.items()
    }
    best = max(gains, key=gains.__getitem__)
    if "x" not in gains:
        return best, f"Careful: travel along {best}; no column is along x. Give --travel if that is wrong."
    if best == "x" or not gains[best] > _MANY_TIMES * gains["x"]:
        return "x", ""
    times = f"{gains[best] / gains['x']:.3g} times that along x" if gains["x"] > 0 else "while it is none along x"
    return best, f"Careful: travel along {best}, by its change of velocity, {times}. Give --travel if that is wrong."


def _gain(values: FloatArray) -> float:
    """The largest change of velocity in either direction, of samples at even times.

    Gravity or an offset that is there from the beginning is no motion, and neither is what is small beside the peak.
    """
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0
    known = known - known[: max(known.size // _BEGINNING, 1)].mean()
    size = np.abs(known)
    return float(np.abs(np.cumsum(np.where(size > _SMALL * size.max(), known, 0.0))).max())
