"""A physical test, and the tests at about its speed."""

import hashlib
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crashfuse.condition import About, Condition
from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.signals.sensor_faults import SensorFault
from crashfuse.signals.wall import Wall
from crashfuse.units import MPH

SPEED_STEP_MPS = 2 * MPH
"""Tests nearer to a condition than this are near it in speed."""
SAME = 0.02  # relative difference up to which two speeds, or two masses, are the same
_APART, _WIDEST = 3.0, 0.1  # times the widest group; of the speed
_ROUNDED_UP = 1 + 1e-9  # so that groups are the same in any unit
TUNED = {True: "yes", False: "no", None: ""}
"""Cells of the column ``cae_tuned``."""


@dataclass(frozen=True, eq=False)
class CrashTest:
    """A physical test.

    ``pulse`` is on the study grid, padded with zeros beyond ``recorded_s``, the end of the record; ``faults`` are what
    its sensor did wrong. ``cae_tuned`` says whether the CAE model was tuned to it, None if nobody says; ``about``
    where it comes from: laboratory, date; ``wall`` the force of the barrier, if it was recorded.
    """

    id: str
    condition: Condition
    pulse: Pulse
    recorded_s: float = math.inf
    faults: tuple[SensorFault, ...] = ()
    cae_tuned: bool | None = None
    about: About = ()
    wall: Wall | None = None

    def __repr__(self) -> str:
        return f"<CrashTest {self.id!r} at {self.condition}>"

    @property
    def statements(self) -> tuple[tuple[str, str], ...]:
        """What the table says of it that is no part of its condition, by column."""
        return *((("cae_tuned", TUNED[self.cae_tuned]),) if self.cae_tuned is not None else ()), *self.about

    @property
    def digest(self) -> str:
        """SHA-256 of its condition and pulse, to the digits that survive other units: the same by any id."""
        where = [*self.condition.vector.round(6).tolist(), *sorted(pair for pair in self.condition.factors if pair[1])]
        return hashlib.sha256(repr(where).encode() + self.pulse.accel_mps2.astype("<f4").tobytes()).hexdigest()


def speed_groups(speeds_mps: FloatArray) -> npt.NDArray[np.intp]:
    """Group numbers of speeds, shape (n,): the finest single-linkage clusters with gaps three times the widest of them.

    Clusters are at most 10 % wide. Speeds within 2 % never part. If no gaps are so wide, all others do.
    """
    speeds, places = np.unique(speeds_mps, return_inverse=True)
    gaps, same = np.diff(speeds) * _ROUNDED_UP, SAME * speeds[1:]
    steps = np.where(gaps > same, gaps, 0.0)
    for parted in (*(steps >= least for least in np.unique(steps[steps > 0])), steps > 0):
        groups = np.r_[0, np.cumsum(parted)]
        low, high = np.array([speeds[groups == group][[0, -1]] for group in groups]).T
        is_far = gaps >= _APART * np.maximum(np.max(high - low, initial=0.0), same)
        if is_far[parted].all() and (high - low <= _WIDEST * high).all():
            break
    return np.asarray(groups[places])
