"""Pulses as curves of LS-DYNA and Radioss: include files for an occupant or sled model.

Both solvers continue a curve beyond its ends by the slope there, so it begins before a contact later than time zero,
and ends with two points at zero. LS-DYNA samples it anew at ``LCINT`` even steps: as many points, evenly spaced.

Sources: LS-DYNA Keyword User's Manual, Vol. I, ``*DEFINE_CURVE``; OpenRadioss, ``hm_cfg_files``, ``CURVE/funct.cfg``.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from textwrap import wrap
from typing import Literal

import numpy as np

from crashfuse.errors import UsageError, one_of, require_number
from crashfuse.signals.pulse import DT_S, FloatArray
from crashfuse.units import MS

_WIDTH = 78  # of a comment; a line of either solver has 80 characters
LATEST_S = 10.0
MOST_ID = 99_999_999  # eight digits, which every solver's fields hold


@dataclass(frozen=True, slots=True)
class UnitSystem:
    """Units of a solver's model: their names, and the factors to them from s and m/s²."""

    time: str
    acceleration: str
    per_s: float
    per_mps2: float


UNIT_SYSTEMS: Mapping[str, UnitSystem] = {
    "mm-ms-kg": UnitSystem("ms", "mm/ms²", 1 / MS, 1e-3),
    "mm-s-t": UnitSystem("s", "mm/s²", 1.0, 1e3),
    "m-s-kg": UnitSystem("s", "m/s²", 1.0, 1.0),
}
"""The unit systems that crash models are built in, by their units of length, time and mass."""


@dataclass(frozen=True, slots=True)
class SolverCurve:
    """How a pulse becomes a curve; a UsageError if a choice or a number makes no sense.

    Parameters
    ----------
    unit_system : str
        One of :data:`UNIT_SYSTEMS`.
    deceleration_sign : {"negative", "positive"}
        Sign of braking; negative as everywhere else.
    start_s : float
        Time of contact in the solver's model.
    scale : float
        Factor on the accelerations.
    number : int
        Id of the curve.
    """

    unit_system: str
    deceleration_sign: Literal["negative", "positive"] = "negative"
    start_s: float = 0.0
    scale: float = 1.0
    number: int = 1

    def __post_init__(self) -> None:
        one_of("unit system", self.unit_system, UNIT_SYSTEMS)
        one_of("sign of a deceleration", self.deceleration_sign, dict.fromkeys(("negative", "positive")))
        require_number("start_s", self.start_s)
        require_number("scale", self.scale)
        if not 0 <= self.start_s <= LATEST_S:
            raise UsageError(f"A curve starts between 0 and {LATEST_S / MS:g} ms, not at {self.start_s / MS:g} ms.")
        if not 0 < self.scale < np.inf:
            raise UsageError(f"A curve is scaled by a number above 0, not by {self.scale:g}; the sign is set apart.")
        if not (isinstance(self.number, Integral) and 1 <= self.number <= MOST_ID):
            raise UsageError(f"The id of a curve is between 1 and {MOST_ID}, not {self.number}.")

    def points(self, accel_mps2: FloatArray) -> FloatArray:
        """Time and acceleration in the units of the model, shape (n, 2), evenly spaced; zero before and after."""
        before = int(self.start_s / DT_S + 1e-9)
        units = UNIT_SYSTEMS[self.unit_system]
        sign = -1.0 if self.deceleration_sign == "positive" else 1.0
        values = np.concatenate([np.zeros(before), accel_mps2, np.zeros(2)])
        time_s = self.start_s + (np.arange(values.size) - before) * DT_S
        time_s[np.abs(time_s) < 1e-9] = 0.0  # s; a rest of the subtraction
        return np.column_stack([time_s * units.per_s, values * (sign * self.scale * units.per_mps2) + 0.0])  # no -0.0

    def comments(self) -> tuple[str, ...]:
        """What a reader of the file has to know about its numbers."""
        units = UNIT_SYSTEMS[self.unit_system]
        comments = (
            f"Units {self.unit_system}: time in {units.time}, acceleration in {units.acceleration}.",
            f"Braking is {self.deceleration_sign}.",
            f"Contact is at {self.start_s * units.per_s:g} {units.time}; the curve ends at zero.",
        )
        return comments if self.scale == 1 else (*comments, f"Accelerations are scaled by {self.scale:g}.")


@dataclass(frozen=True, slots=True)
class Solver:
    """A solver: its name, the ending of its include files, and what writes one."""

    label: str
    suffix: str
    include: Callable[[int, str, Sequence[str], FloatArray], Iterable[str]]


def solver_include(
    solver: str, title: str, comments: Sequence[str], accel_mps2: FloatArray, curve: SolverCurve
) -> bytes:
    """An include file for a solver of :data:`SOLVERS` that holds one pulse, in m/s², as a curve."""
    said = [line for text in (*comments, *curve.comments()) for line in wrap(_plain(text), _WIDTH)]
    lines = SOLVERS[solver].include(curve.number, _plain(title)[:_WIDTH], said, curve.points(accel_mps2))
    return "".join(f"{line}\n" for line in lines).encode("ascii")


def _plain(text: str) -> str:
    readable = text.replace("²", "^2").replace("–", "-").replace("·", "*")
    return " ".join(readable.encode("ascii", "replace").decode().split())  # a line break would write keywords


def _lsdyna(number: int, title: str, comments: Sequence[str], points: FloatArray) -> Iterator[str]:
    yield "*KEYWORD"
    yield from (f"$ {comment}" for comment in comments)
    yield from ("*DEFINE_CURVE_TITLE", title)
    yield "$#    lcid      sidr       sfa       sfo      offa      offo    dattyp     lcint"
    yield f"{number:>10}{0:>10}{1.0:>10}{1.0:>10}{0.0:>10}{0.0:>10}{0:>10}{len(points):>10}"
    yield "$#                a1                  o1"
    yield from _pairs(points)
    yield "*END"


def _radioss(number: int, title: str, comments: Sequence[str], points: FloatArray) -> Iterator[str]:
    yield from (f"# {comment}" for comment in comments)
    yield from (f"/FUNCT/{number}", title, "#                  X                   Y")
    yield from _pairs(points)


def _pairs(points: FloatArray) -> Iterator[str]:
    return (f"{x:20.12E}{y:20.12E}" for x, y in points.tolist())


SOLVERS: Mapping[str, Solver] = {
    "lsdyna": Solver("LS-DYNA", ".k", _lsdyna),
    "radioss": Solver("Radioss", ".inc", _radioss),
}
"""The solvers that a pulse can be written for."""
