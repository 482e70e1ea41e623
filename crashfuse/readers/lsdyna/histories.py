"""Nodal histories of an LS-DYNA run, whichever file they come from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.readers.record import RecordedChannel
from crashfuse.run_quality import RunQuality
from crashfuse.signals.pulse import FloatArray

MOST_NODES = 200_000
"""Limit of the nodes listed in a file."""
MOST_VALUES = 20_000_000
"""Limit of states times nodes kept per run."""
_ALIASED = 0.05  # of the velocity


@dataclass(frozen=True, eq=False, slots=True)
class History:
    """One node or rigid body along the axis of travel, in the units of the run.

    Parameters
    ----------
    name : str
        The node's number; ``body 12`` for a rigid body.
    title : str
        From ``*DATABASE_HISTORY_NODE_ID``; empty if it has none.
    time, acceleration, velocity : ndarray, shape (n,)
        ``velocity`` is all NaN if the file has none.
    """

    name: str
    title: str
    time: FloatArray
    acceleration: FloatArray
    velocity: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Histories:
    """The nodal histories of a run.

    Parameters
    ----------
    total : int
        Number of nodes in the files.
    start : ndarray, shape (3, n_nodes)
        Velocities of all nodes along x, y and z at the first state.
    fastest : ndarray, shape (3,)
        Largest speed of any node along each axis; of the start alone where nodes set out with a speed.
    kinetic_energy : float, optional
        Kinetic energy of the whole model at its first state (``glstat``), in the units of the run.
    notes : tuple of str
        What was joined or left out.
    quality : RunQuality
        What the solver says of the run (``glstat``, ``matsum``).
    """

    title: str
    nodes: tuple[History, ...]
    total: int
    start: FloatArray = field(default_factory=lambda: np.zeros((3, 1)))
    fastest: FloatArray = field(default_factory=lambda: np.zeros(3))
    kinetic_energy: float | None = None
    notes: tuple[str, ...] = ()
    quality: RunQuality = field(default_factory=RunQuality)

    def beside(self, others: "Histories") -> "Histories":
        """These nodes and others of the same run; a node that is among both is taken from the others."""
        known = {node.name for node in others.nodes}
        nodes = (*others.nodes, *(node for node in self.nodes if node.name not in known))
        return replace(others, nodes=nodes, total=max(len(nodes), self.total, others.total))


def kept_of(names: Sequence[str], titles: Mapping[str, str], most: int) -> set[str]:
    """The nodes to keep if there are too many: those with a title first, then in file order."""
    return set(sorted(names, key=lambda name: not titles.get(name))[:most])


def too_much(where: str) -> DataError:
    """The error for more values than are kept per run."""
    expected = f"at most {MOST_VALUES:,} states times nodes"
    return DataError(Problem(where, expected, "more", "write fewer nodes (*DATABASE_HISTORY_NODE) or fewer states"))


def channel_of(node: History, per_second: float, unit: str | None) -> RecordedChannel:
    """The acceleration of a node as a channel; from its velocity if the two don't agree (:func:`is_aliased`)."""
    values = np.gradient(node.velocity, node.time) if is_aliased(node) else node.acceleration
    label = node.title or ("rigid body" if node.name.startswith("body") else "node")
    return RecordedChannel(node.name, label, per_second * node.time, values, unit)


def is_aliased(node: History) -> bool:
    """Whether the accelerations, sampled once per output interval, fail to reproduce the velocity."""
    change = node.velocity - node.velocity[0]
    if not np.isfinite(change).all() or not np.isfinite(node.acceleration).all() or node.time.size < 3:
        return False
    error = np.abs(integral(node.acceleration, node.time) - change).max()
    return bool(error > _ALIASED * np.abs(node.velocity).max()) and bool((np.diff(node.time) > 0).all())


def integral(values: FloatArray, time: FloatArray) -> FloatArray:
    """The integral over time by the trapezoidal rule, 0 at the start."""
    return np.concatenate([[0.0], np.cumsum(np.diff(time) * (values[1:] + values[:-1]) / 2)])
