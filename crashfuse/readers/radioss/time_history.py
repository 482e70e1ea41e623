"""A time history of Radioss, whichever form it comes in: what the solver wrote at each state."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.readers.energies import Energies
from crashfuse.signals.pulse import FloatArray

GLOBAL = (
    "INTERNAL ENERGY", "KINETIC ENERGY", "X-MOMENTUM", "Y-MOMENTUM", "Z-MOMENTUM", "MASS", "TIME STEP",
    "ROTATION ENERGY", "EXTERNAL WORK", "SPRING ENERGY", "CONTACT ENERGY", "HOURGLASS ENERGY",
    "ELASTIC CONTACT ENERGY", "FRICTIONAL CONTACT ENERGY", "DAMPING CONTACT ENERGY", "PLASTIC WORK", "ADDED MASS",
    "PERCENTAGE ADDED MASS", "INLET MASS", "OUTLET MASS", "INLET ENERGY", "OUTLET ENERGY",
)  # fmt: skip
"""The global histories in the order of their codes, 1 first, as the solver's converter calls them."""

MOST_VALUES = 40_000_000
"""Limit of states times values kept of a file."""

ACCELEROMETER = "accelerometer "
"""What the names of accelerometers begin with; those of nodes are numbers."""

LEAST_CHANGE, MOST_CHANGE = 0.8, 1.6
"""ΔV of a vehicle that stops, as a multiple of its initial velocity."""

_STEPS = 5.5  # of output: a longer gap between two parts of a run is one
_LARGEST_SHARE = 1e-3  # of a momentum, below which a direction counts as none


@dataclass(frozen=True, eq=False, slots=True)
class Watched:
    """What was written of one node or accelerometer.

    Parameters
    ----------
    name : str
        Its number; ``accelerometer 9`` for an accelerometer.
    title : str
        What the user called it; may be empty.
    time : ndarray, shape (n,)
    curves : mapping of str to ndarray, shape (n,)
        By Radioss's names: displacement ``DX``, velocity ``VX``, acceleration ``AX``, and of an accelerometer the
        integral ``WX`` of its acceleration; other axes likewise. ``var 33`` where the file does not name them.
    """

    name: str
    title: str
    time: FloatArray
    curves: Mapping[str, FloatArray]

    @property
    def is_accelerometer(self) -> bool:
        """Whether it measures in a skew of its own."""
        return self.name.startswith(ACCELEROMETER)


@dataclass(frozen=True, eq=False, slots=True)
class TimeHistory:
    """The part of a time history that tells of a crash, in the units of the run.

    Parameters
    ----------
    time : ndarray, shape (n,)
    model : mapping of str to ndarray, shape (n,)
        The global histories by the names in :data:`GLOBAL`; those that were written.
    watched : tuple of Watched
        Nodes and accelerometers.
    unread : tuple of str
        What the file holds beside them, for display: rigid walls, sections …
    unit_factors : tuple of float, optional
        Factors to SI of the run's mass, length and time; None if the file states none.
    notes : tuple of str
        What was joined, aligned or left out.
    """

    title: str
    time: FloatArray
    model: Mapping[str, FloatArray]
    watched: tuple[Watched, ...]
    unread: tuple[str, ...] = ()
    unit_factors: tuple[float, float, float] | None = None
    notes: tuple[str, ...] = ()

    @property
    def energies(self) -> Energies:
        """The global histories that tell the quality of the run; Radioss always computes hourglass energy."""
        internal, kinetic = self.model.get("INTERNAL ENERGY"), self.model.get("KINETIC ENERGY")
        total = None
        if internal is not None and kinetic is not None:
            others = ("ROTATION ENERGY", "CONTACT ENERGY", "HOURGLASS ENERGY")
            total = sum((self.model[name] for name in others if name in self.model), internal + kinetic)
        added = self.model.get("PERCENTAGE ADDED MASS")
        hourglass, work = self.model.get("HOURGLASS ENERGY"), self.model.get("EXTERNAL WORK")
        return Energies(total, work, internal, hourglass, None if added is None else added / 100)

    @property
    def initial_velocity(self) -> FloatArray | None:
        """Velocity along X, Y, Z of all that moves at the first state, shape (3,); None if that is not told.

        Twice the kinetic energy over the momentum: what is at rest, as a barrier is, counts in neither.
        """
        needed = ("KINETIC ENERGY", *(f"{axis}-MOMENTUM" for axis in "XYZ"))
        if any(name not in self.model or not self.model[name].size for name in needed):
            return None
        kinetic, *momentum = (float(self.model[name][0]) for name in needed)
        size = float(np.linalg.norm(momentum))
        if kinetic == 0:
            return np.zeros(3)
        if not (np.isfinite([kinetic, size]).all() and size > 0 and kinetic > 0):
            return None
        velocity = 2 * kinetic * np.array(momentum) / size**2
        return np.where(np.abs(velocity) > _LARGEST_SHARE * np.abs(velocity).max(), velocity, 0.0)

    def before(self, end: float) -> "TimeHistory":
        """The states before a time."""
        kept = self.time < end
        watched = []
        for one in self.watched:
            early = one.time < end
            watched.append(
                replace(one, time=one.time[early], curves={name: of[early] for name, of in one.curves.items()})
            )
        model = {name: values[kept] for name, values in self.model.items()}
        return replace(self, time=self.time[kept], model=model, watched=tuple(watched))


def joined(parts: Sequence[TimeHistory], names: Sequence[str]) -> TimeHistory:
    """One time history of a run that was stopped and restarted; a later part replaces what it computed anew.

    Raises
    ------
    DataError
        If the run does not begin with the first part, time is missing between two, or they watch different things.
    """
    whole = parts[0]
    for part, name in zip(parts[1:], names[1:], strict=True):
        if _what(part) != _what(whole):
            expected = f"the nodes and accelerometers of {names[0]}"
            raise DataError(
                Problem(name, expected, "others", "import the parts one by one, each in a folder of its own")
            )
        start = float(part.time[0])
        whole = whole.before(start)
        steps = np.diff(whole.time[-3:])
        if not whole.time.size or (steps.size and start - whole.time[-1] > _STEPS * steps.max()):
            expected = f"states from {whole.time[-1]:g} on" if whole.time.size else "states after those before it"
            raise DataError(Problem(name, expected, f"the first at {start:g}", "add the file that lies between"))
        watched = tuple(
            replace(
                early,
                time=np.concatenate([early.time, late.time]),
                curves={name: np.concatenate([of, late.curves[name]]) for name, of in early.curves.items()},
            )
            for early, late in zip(whole.watched, part.watched, strict=True)
        )
        model = {key: np.concatenate([of, part.model[key]]) for key, of in whole.model.items() if key in part.model}
        notes = tuple(dict.fromkeys((*whole.notes, *part.notes)))
        whole = replace(whole, time=np.concatenate([whole.time, part.time]), model=model, watched=watched, notes=notes)
    if len(parts) > 1:
        whole = replace(whole, notes=(f"Joined from {', '.join(names)}.", *whole.notes))
    return whole


def _what(history: TimeHistory) -> list[tuple[str, list[str]]]:
    return [(one.name, [*one.curves]) for one in history.watched]


def together(histories: Sequence[TimeHistory]) -> TimeHistory:
    """The main file of a run with the nodes of its additional ones (``T01a`` …), which repeat no global histories."""
    main = histories[0]
    return replace(
        main,
        model=next((each.model for each in histories if each.model), {}),
        watched=tuple({one.name: one for each in reversed(histories) for one in each.watched}.values()),
        unread=tuple(dict.fromkeys(name for each in histories for name in each.unread)),
        unit_factors=next((each.unit_factors for each in histories if each.unit_factors), None),
        notes=tuple(dict.fromkeys(note for each in histories for note in each.notes)),
    )
