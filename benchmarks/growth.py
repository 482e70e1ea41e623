"""Time and memory as a campaign grows: ``python benchmarks/growth.py [--runs N …] [--tests N …]``.

A random lumped-parameter vehicle with more and more CAE runs, and with more and more tests. Every row is measured in a
process of its own, on one core.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from vehicles import World, recorded

from crashfuse.approaches.registry import LABELS
from crashfuse.cae.model import Emulator
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.writer import write_campaign
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit, estimates_at

T = TypeVar("T")

_AT_ONCE = 5000  # simulations
_LEARNING = ("displacement_domain", "time_domain", "fused")  # fused: what is left of it once both are known
_SEED = 1


def main() -> None:
    """Measure and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--runs", type=int, nargs="*", default=[1_000, 10_000, 100_000])
    parser.add_argument("--tests", type=int, nargs="*", default=[10, 30, 100, 300])
    parser.add_argument("--row", nargs=2, metavar=("KIND", "FOLDER"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.row:
        {"runs": _runs_row, "tests": _tests_row}[given.row[0]](Path(given.row[1]))
        return
    with tempfile.TemporaryDirectory() as scratch:
        print("| CAE runs | file | check and load | emulator fit | peak memory |\n|---:|---:|---:|---:|---:|")
        for n in given.runs:
            _measured("runs", _with_runs(n, Path(scratch)))
        heads = " | ".join(f"{LABELS[name]}, fit" for name in _LEARNING)
        print(f"\n| tests | check and load | {heads} | prediction by all | peak memory |\n|---:|{'---:|' * 6}")
        for n in given.tests:
            _measured("tests", _with_tests(n, Path(scratch)))


def _measured(kind: str, folder: Path) -> None:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment["CRASHFUSE_CACHE"] = str(folder / "cache")
    subprocess.run([sys.executable, __file__, "--row", kind, str(folder)], check=True, env=environment)


def _with_runs(n: int, scratch: Path) -> Path:
    """A campaign with this many CAE runs at random conditions."""
    world = World.of(_SEED)
    conditions = world.conditions(np.random.default_rng(_SEED), n)
    parts = (conditions[at : at + _AT_ONCE] for at in range(0, n, _AT_ONCE))
    pulses = np.concatenate([recorded([world.model], part, None).astype(np.float32) for part in parts])
    cae = CaeLibrary(tuple(f"C{i:06d}" for i in range(n)), tuple(conditions), pulses)
    write_campaign(replace(world.campaign(3), cae=cae), folder := scratch / f"runs-{n}")
    return folder


def _with_tests(n: int, scratch: Path) -> Path:
    write_campaign(World.of(_SEED).campaign(n), folder := scratch / f"tests-{n}")
    return folder


def _runs_row(folder: Path) -> None:
    campaign, load_s = _timed(lambda: load_campaign(folder))
    _, fit_s = _timed(lambda: Emulator().fit(campaign.cae))
    size = sum(path.stat().st_size for path in folder.rglob("*.parquet")) / 1e6
    told = f"{size:.0f} MB | {load_s:.1f} CPU-s | {fit_s:.1f} CPU-s | {_peak()}"
    print(f"| {len(campaign.cae):,} | {told} |", flush=True)


def _tests_row(folder: Path) -> None:
    campaign, load_s = _timed(lambda: load_campaign(folder))
    config, cache = StudyConfig(), Cache()
    Fit.of(campaign, "lf_tcn", config, Run(cache))  # depends on no test
    learned = [_timed(partial(Fit.of, campaign, name, config, Run(cache))) for name in _LEARNING]
    fits = [fit for fit, _ in learned]
    first, condition = (replace(campaign.tests[0].condition, speed_mps=speed) for speed in (9.0, 10.0))
    estimates_at(fits, first)  # what is needed once
    _, predict_s = _timed(lambda: estimates_at(fits, condition))
    told = " | ".join(f"{each:.1f} CPU-s" for each in (load_s, *(fit_s for _, fit_s in learned)))
    print(f"| {len(campaign.tests)} | {told} | {predict_s:.2f} CPU-s | {_peak()} |", flush=True)


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """What some work returns, and the CPU seconds that it took."""
    start = time.process_time()
    return work(), time.process_time() - start


def _peak() -> str:
    """Peak memory of this program: what ``getrusage`` tells includes what started it."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return f"{int(status.partition('VmHWM:')[2].split()[0]) / 2**20:.2f} GiB"


if __name__ == "__main__":
    main()
