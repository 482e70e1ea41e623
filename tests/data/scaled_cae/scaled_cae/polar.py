"""A reader of files ``.polar``: float64 pairs of time in s and acceleration in g."""

from pathlib import Path

import numpy as np

from crashfuse.readers.formats import Format
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel

POLAR = Format("Polar", ".polar", r".*\.polar", "scaled_cae.polar:read_polar")


def read_polar(path: Path) -> tuple[Record, ...]:
    """Read one file, or all in a folder."""
    files = [path] if path.is_file() else sorted(path.rglob("*.polar"))
    records = []
    for file in files:
        time_s, accel_g = np.frombuffer(file.read_bytes()).reshape(-1, 2).T
        channel = RecordedChannel("1", "acceleration", time_s, accel_g, "g")
        records.append(Record(file.stem, file.name, PartialCondition(), (channel,), ("1",)))
    return tuple(records)
