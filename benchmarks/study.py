"""Cost of a study, as ratios to the paper's own method, all measured in one run: ``python benchmarks/study.py``.

The Gaussian process of Table 4 is fitted in full; the network of Table 2 takes a few optimiser steps, from which its
1000 epochs are extrapolated. The study runs in its own process tree with an empty cache, monitored from outside.

With ``--beside CHECKOUT`` (a worktree of another commit) the study with speed groups, and the way in the dashboard from
the click on the sample to a rated comparison (needs Chromium), are measured there and here instead, one after the
other, in one table.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import psutil
from dashboard import ROOT
from first_run import STAGES, first_minutes
from threadpoolctl import threadpool_limits

from crashfuse.approaches.displacement_domain.approach import DisplacementConfig, DisplacementDomain
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.lf_tcn import LfTcn
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run

_STEPS = 4


@dataclass(frozen=True)
class Cost:
    """Cost of a whole study with speed groups."""

    NAMES: ClassVar[tuple[str, ...]] = (
        "Whole study with speed groups",
        "… processor time of all its processes",
        "… peak memory of all its processes",
    )

    wall_s: float
    cpu_s: float
    peak_bytes: float

    @property
    def cells(self) -> tuple[str, ...]:
        """As text, in the order of the names."""
        return f"{self.wall_s:.0f} s", f"{self.cpu_s:.0f} CPU-s", f"{self.peak_bytes / 2**30:.2f} GiB"


def main() -> None:
    """Measure and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaign", type=Path, nargs="?", default=ROOT / "sample_data")
    parser.add_argument("--beside", type=Path, metavar="CHECKOUT")
    arguments = parser.parse_args()
    if arguments.beside:
        _print_beside(arguments.beside.resolve(), arguments.campaign.resolve())
    else:
        _print_ratios(arguments.campaign)


def _print_beside(other: Path, folder: Path) -> None:
    """Wall time, processor time and memory of a study, and times to rated comparisons, of two checkouts."""
    columns = []
    for root in (other, ROOT):
        with tempfile.TemporaryDirectory() as scratch:
            study = _study(folder, Path(scratch), root)
        columns.append([*study.cells, *(f"{seconds:.1f} s" for seconds in first_minutes(root).values())])
    names = [*Cost.NAMES, "First page", *(f"From the click on the sample on: {stage}" for stage in STAGES[1:])]
    print(f"| {folder.name}, nothing computed before, {os.cpu_count()} cores | {other.name} | {ROOT.name} |")
    print("|---|---:|---:|")
    for row in zip(names, *columns, strict=True):
        print(f"| {' | '.join(row)} |")


def _print_ratios(folder: Path) -> None:
    """Ratios to the paper's own method."""
    campaign = load_campaign(folder)
    nine_tenths = campaign.without(campaign.test_ids[-1:])
    with tempfile.TemporaryDirectory() as scratch:
        cache = Cache(Path(scratch) / "cache")
        domain = DisplacementDomain().fit(nine_tenths, Run(cache))  # with the emulator, which both presets share
        alike = [replace(points, condition=replace(points.condition, factors=())) for points in domain.points_]
        with threadpool_limits(1):  # as the approach fits it
            one_fit = _cpu_seconds(lambda: HierarchicalBias().fit(alike))
        fast_gp = _cpu_seconds(lambda: DisplacementDomain().fit(nine_tenths, Run(cache)))
        paper_gp = _cpu_seconds(lambda: DisplacementDomain(DisplacementConfig.paper()).fit(nine_tenths, Run(cache)))
        fast_lf = _cpu_seconds(lambda: LfTcn().fit(campaign, Run(Cache(Path(scratch) / "lf"))))
        paper_lf = _paper_training_cpu_seconds(campaign)
        study = _study(folder, Path(scratch), ROOT)
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
    told = (f"{name[0].lower()}{name[1:]} {cell}" for name, cell in zip(Cost.NAMES, study.cells, strict=True))
    print(f"\nAll approaches, empty cache: {'; '.join(told)}.")


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
    cpu = _cpu_seconds(lambda: LfTcn(short).fit(replace(campaign, cae=library)))
    return cpu * paper.epochs * len(campaign.cae) / few


def _study(folder: Path, scratch: Path, root: Path) -> Cost:
    """Run a whole study with speed groups by the code of a checkout."""
    environment = {**os.environ, "CRASHFUSE_CACHE": str(scratch / "study"), "PYTHONPATH": str(root)}
    command = [sys.executable, "-m", "crashfuse", "study", str(folder), "--out", str(scratch / "out")]
    command += ["--leave-out", "both"]
    before, start = _ended_cpu_s(), time.perf_counter()
    with subprocess.Popen(
        command, cwd=scratch, env=environment, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    ) as process:
        own, peak = psutil.Process(process.pid), 0.0
        while process.poll() is None:
            peak = max(peak, _resident(own))
            time.sleep(0.25)
    if process.returncode:
        raise SystemExit(f"the study by {root} failed")
    return Cost(time.perf_counter() - start, _ended_cpu_s() - before, peak)


def _ended_cpu_s() -> float:
    """Processor seconds of all ended child processes and theirs."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


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
