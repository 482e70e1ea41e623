"""Cost of a study, as ratios to the paper's own method, all measured in one run: ``python benchmarks/study.py``.

The Gaussian process of Table 4 is fitted in full; the network of Table 2 takes a few optimiser steps, from which its
1000 epochs are extrapolated. The study runs in its own process tree with an empty cache, monitored from outside.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import psutil
from threadpoolctl import threadpool_limits

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.config import DisplacementConfig
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.lf_tcn import LfTcn
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.folder import load_campaign
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import Watch

_STEPS = 4


def main() -> None:
    """Measure and print a Markdown table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("campaign", type=Path, nargs="?", default=Path("sample_data"))
    folder: Path = arguments.parse_args().campaign
    campaign = load_campaign(folder)
    nine_tenths = campaign.without(campaign.test_ids[-1:])
    with tempfile.TemporaryDirectory() as scratch:
        cache = Cache(Path(scratch) / "cache")
        domain = DisplacementDomain(cache=cache).fit(nine_tenths)  # with the emulator, which both presets share
        alike = [replace(points, condition=replace(points.condition, factors=())) for points in domain.points_]
        with threadpool_limits(1):  # as the approach fits it
            one_fit = _cpu_seconds(lambda: HierarchicalBias().fit(alike))
        fast_gp = _cpu_seconds(lambda: DisplacementDomain(cache=cache).fit(nine_tenths))
        paper_gp = _cpu_seconds(lambda: DisplacementDomain(DisplacementConfig.paper(), cache=cache).fit(nine_tenths))
        fast_lf = _cpu_seconds(lambda: LfTcn(cache=Cache(Path(scratch) / "lf")).fit(campaign))
        paper_lf = _paper_training_cpu_seconds(campaign)
        wall, memory = _study(folder, Path(scratch))
    folds = len(campaign.tests)
    ours, papers = fast_lf + folds * fast_gp, paper_lf + folds * paper_gp
    print(f"{campaign.name}: {folds} tests, {len(campaign.cae)} CAE runs, {os.cpu_count()} cores\n")
    print("| | the paper's way | crashfuse, fast preset | ratio |\n|---|---:|---:|---:|")
    print(
        f"| Gaussian process, one fit | {paper_gp:.0f} CPU-s | {one_fit:.2f} CPU-s | {paper_gp / one_fit:.0f} |\n"
        f"| … with factors, rebound and check of the band | {paper_gp:.0f} CPU-s | {fast_gp:.2f} CPU-s "
        f"| {paper_gp / fast_gp:.0f} |"
    )
    print(
        f"| LF network, 1000 epochs (the paper's extrapolated) | {paper_lf / 3600:.0f} CPU-h | {fast_lf:.0f} CPU-s "
        f"| {paper_lf / fast_lf:.0f} |"
    )
    print(f"| Training of a whole study | {papers / 3600:.0f} CPU-h | {ours:.0f} CPU-s | {papers / ours:.0f} |")
    print(f"\nWhole study, all approaches, empty cache: {wall:.0f} s, peak memory {memory / 2**30:.2f} GiB.")


def _cpu_seconds(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def _paper_training_cpu_seconds(campaign: Campaign) -> float:
    """CPU seconds of the 1000 epochs of Table 2, extrapolated from one epoch on a few batches of CAE runs."""
    paper = TcnConfig.paper()
    few = _STEPS * paper.batch
    library = replace(
        campaign.cae,
        ids=campaign.cae.ids[:few],
        conditions=campaign.cae.conditions[:few],
        accel_mps2=campaign.cae.accel_mps2[:few],
    )
    short = replace(paper, epochs=1)
    cpu = _cpu_seconds(lambda: LfTcn(short).fit(replace(campaign, cae=library), Watch()))
    return cpu * paper.epochs * len(campaign.cae) / few


def _study(folder: Path, scratch: Path) -> tuple[float, float]:
    """Wall seconds and peak resident bytes of the whole process tree of a study."""
    environment = {**os.environ, "CRASHFUSE_CACHE": str(scratch / "study")}
    command = [sys.executable, "-m", "crashfuse", "study", str(folder), "--out", str(scratch / "out")]
    start = time.perf_counter()
    with subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
        root, peak = psutil.Process(process.pid), 0.0
        while process.poll() is None:
            peak = max(peak, _resident(root))
            time.sleep(0.25)
    if process.returncode:
        raise SystemExit("the study failed")
    return time.perf_counter() - start, peak


def _resident(root: psutil.Process) -> float:
    """Proportional memory of a process and its children: shared memory counts once."""
    total = 0.0
    for process in [root, *root.children(recursive=True)]:
        try:
            full = process.memory_full_info()
        except psutil.Error:  # it has ended meanwhile
            continue
        total += getattr(full, "pss", full.rss)
    return total


if __name__ == "__main__":
    main()
