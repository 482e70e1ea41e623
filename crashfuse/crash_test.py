"""A physical test, and the tests at about its speed."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crashfuse.condition import About, Condition
from crashfuse.signals.pulse import Pulse
from crashfuse.signals.sensor_faults import SensorFault
from crashfuse.signals.wall import Wall
from crashfuse.units import MPH

SPEED_STEP_MPS = 2 * MPH
"""Tests nearer to each other than this are at about one speed."""
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


def at_the_speed_of(test: CrashTest, tests: Sequence[CrashTest]) -> tuple[CrashTest, ...]:
    """The tests at about the speed of one of them, itself included: sorted, neighbours under 2 mph apart."""
    speeds = np.array([other.condition.speed_mps for other in tests])
    ordered = np.sort(speeds)
    groups = np.r_[0, np.cumsum(np.diff(ordered) >= SPEED_STEP_MPS)]
    group_of, wanted = (groups[np.searchsorted(ordered, speed)] for speed in (speeds, test.condition.speed_mps))
    return tuple(other for other, group in zip(tests, group_of, strict=True) if group == wanted)
