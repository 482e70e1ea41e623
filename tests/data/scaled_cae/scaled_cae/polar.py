"""A reader of files ``.polar``: pairs of float64, time in s and acceleration in g, one test a file."""

from pathlib import Path

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.files.archive import DEFAULT_LIMITS
from crashfuse.readers.formats import Format
from crashfuse.readers.members import opened_members
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel

POLAR = Format("Polar", ".polar", r".*\.polar", "scaled_cae.polar:read_polar")
_KIND = "pairs of time in s, in even steps, and acceleration in g"


def read_polar(path: Path) -> tuple[Record, ...]:
    """Read one file, or all in a folder or zip."""
    with opened_members(path, POLAR.has, _KIND, DEFAULT_LIMITS) as (members, budget):
        records = [
            _record(member.path.name, b"".join(member.chunks(budget)))
            for member in members
            if not POLAR.has(path) or member.path.name == path.name
        ]
    if not records:
        raise DataError(Problem(path.name, _KIND, "no such file", "check the path"))
    return tuple(records)


def _record(name: str, content: bytes) -> Record:
    if len(content) < 32 or len(content) % 16:
        raise DataError(Problem(name, _KIND, f"{len(content)} bytes", "export it again"))
    time_s, accel_g = np.frombuffer(content, "<f8").reshape(-1, 2).T
    with np.errstate(all="ignore"):
        even = np.allclose(np.diff(time_s), (time_s[-1] - time_s[0]) / (time_s.size - 1), rtol=1e-3, atol=0)
    if not (even and np.isfinite(accel_g).all() and 0 < time_s[-1] - time_s[0] < 100 and abs(accel_g).max() < 1e4):
        raise DataError(Problem(name, _KIND, "other numbers", "export it again"))
    channel = RecordedChannel("1", "acceleration", time_s, accel_g, "g")
    return Record(name.partition(".")[0], name, PartialCondition(), (channel,), ("1",), (f"Read from {name}.",))
