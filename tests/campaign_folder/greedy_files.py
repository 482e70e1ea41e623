"""Writes files that would fill the memory and reads each: run by a test in a process of its own, to measure it."""

import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.campaign_folder.condition_tables import ConditionTable, read_candidates
from crashfuse.campaign_folder.pulse_files import PulseFiles, read_pulse
from crashfuse.condition import Condition
from crashfuse.errors import DataError

MIB = 1 << 20
HEADER = "time_ms,acceleration_g\n"
PLACE = Path(sys.argv[1])


def text(head: str, part: str) -> None:
    """A head and 20 MiB of a part again and again: less than a table of conditions may have."""
    with (PLACE / "pulse.csv").open("w") as stream:
        stream.write(head)
        for _ in range(20):
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
    source = PulseFiles(PLACE, "cae")
    source.read(ConditionTable("cae", ("A",), (Condition.of_vector([15.0, 1000.0, 700.0]),), (2,)))
    if source.problems:
        raise DataError(source.problems)


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


def watched(read: Callable[[], None]) -> tuple[float, float, str]:
    """CPU seconds, MiB beyond those before, and what was said against the file."""
    own, done = psutil.Process(), threading.Event()
    before = peak = own.memory_info().rss

    def watch() -> None:
        nonlocal peak
        while not done.wait(0.005):
            peak = max(peak, own.memory_info().rss)

    watcher = threading.Thread(target=watch)
    watcher.start()
    start = time.process_time()
    try:
        read()
        said = ""
    except DataError as error:
        said = str(error)
    seconds = time.process_time() - start
    done.set()
    watcher.join()
    return seconds, (peak - before) / MIB, said


for name, (write, reads) in CASES.items():
    write()
    for read in reads:
        seconds, more, said = watched(read)
        sys.stdout.write(f"{name}, {read.__name__}: {seconds:.2f} s, {more:.0f} MiB more; {said[:150]}\n")
        if not said or seconds > 5 or more > 1024 or len(said) > 20_000:
            raise SystemExit(f"{name}, {read.__name__}: too much, or taken for a table")
