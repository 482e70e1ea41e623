"""Writes files that would fill the memory and reads each: run by a test in a process of its own, to measure it."""

import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.errors import DataError
from crashfuse.formats.pulses import PulseSource, read_pulse
from crashfuse.formats.tables import read_candidates

MIB = 1 << 20
HEADER = "time_ms,acceleration_g\n"
PLACE = Path(sys.argv[1])


def text(head: str, part: str) -> None:
    """A head and 31 MiB of a part again and again: just short of what a table of conditions may have."""
    with (PLACE / "pulse.csv").open("w") as stream:
        stream.write(head)
        for _ in range(31):
            stream.write(part * (MIB // len(part)))


def table(**columns: Any) -> None:
    """A tidy table of CAE pulses."""
    pq.write_table(pa.table(columns), PLACE / "cae_pulses.parquet")


def one_run() -> None:
    """20 million samples of one run: a few kilobytes."""
    table(id=coded("A", 20 * 10**6), time_ms=np.zeros(20 * 10**6), acceleration_g=np.zeros(20 * 10**6))


def coded(value: str, times: int) -> pa.DictionaryArray:
    """One text many times over."""
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(times, np.int32)), pa.array([value]))


def pulse() -> None:
    """Read a pulse."""
    read_pulse(PLACE / "pulse.csv")


def conditions() -> None:
    """Read candidates."""
    read_candidates(PLACE / "pulse.csv")


def tidy() -> None:
    """Read a table of pulses."""
    source = PulseSource(PLACE, "cae", None)
    source.read(["A"])
    raise DataError(source.problems) if source.problems else SystemExit("taken for a table")


CASES: dict[str, tuple[Callable[[], None], tuple[Callable[[], None], ...]]] = {
    "a line without an end": (lambda: text("", "7"), (pulse, conditions)),
    "millions of columns": (lambda: text("", ",a"), (pulse, conditions)),
    "a giant cell": (lambda: text(HEADER + "0,", "7"), (pulse, conditions)),
    "a quote that never closes": (lambda: text(HEADER + '0,"', "7\n"), (pulse, conditions)),
    "a giant quoted cell": (lambda: text(HEADER + '0,"', "7"), (pulse, conditions)),
    "commas": (lambda: text(HEADER, ",\n"), (pulse, conditions)),
    "a wide table of nothing": (lambda: text(",".join(map(str, range(400))) + "\n", "," * 399 + "\n"), (conditions,)),
    "a wide table of ones": (lambda: text(",".join(map(str, range(400))) + "\n", "1," * 399 + "1\n"), (conditions,)),
    "a long record": (lambda: text(HEADER, "0,0\n"), (pulse,)),
    "a long record in a table": (one_run, (tidy,)),
    "a giant cell a million times": (
        lambda: table(id=coded("A", 10**6), time_ms=coded("7" * MIB, 10**6), acceleration_g=np.zeros(10**6)),
        (tidy,),
    ),
    "a giant id a million times": (
        lambda: table(id=coded("A" * MIB, 10**6), time_ms=np.zeros(10**6), acceleration_g=np.zeros(10**6)),
        (tidy,),
    ),
}

for name, (write, reads) in CASES.items():
    write()
    for read in reads:
        before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
        try:
            read()
            raise SystemExit(f"{name}, {read.__name__}: taken for a table")
        except DataError as error:
            sentences = str(error)
        seconds = time.perf_counter() - start
        more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
        sys.stdout.write(f"{name}, {read.__name__}: {seconds:.2f} s, {more:.0f} MiB more; {sentences[:150]}\n")
        if seconds > 5 or more > 1024 or len(sentences) > 20_000:
            raise SystemExit(f"{name}, {read.__name__}: too much")
