"""Time to equal validation error, the network of Table 2 against ours: ``python benchmarks/network.py CAMPAIGN``.

Both are trained on the same nine tenths of the CAE runs, with the package's own training, in one process on the CPU.
Table 2's gets a limited CPU time; ours runs to its end. From time to time both predict the held-out runs, which
neither learns from: the error is the root mean square over all of them and 0–100 ms at 12.5 kHz. The clock counts all
of a fit, from the scaling on, with the loss over its own validation runs after each epoch; it is stopped during
our evaluations. A network has reached the other's error at the first evaluation that shows it.
"""

import argparse
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import numpy.typing as npt

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.lf_tcn import LfTcn
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.training import Checkpoint, TrainingObjective, mean_outputs, minimise
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.errors import Cancelled
from crashfuse.execution.progress import Progress, Watch
from crashfuse.execution.run import UNKEPT
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.units import MPH, G

_HELD_OUT = 0.1
_PAUSE = 2  # times the duration of an evaluation, until the next
_PULSES_AT_ONCE = 25  # the hidden layers of Table 2's network for all pulses would take gigabytes
_WINDOW_MS = 60.0
_SLOWEST_RATED_MPS = 3 * MPH  # a parked car has no pulse worth rating
_ROWS = 10


@dataclass(frozen=True, slots=True)
class _Look:
    steps: int
    cpu_s: float
    wall_s: float
    error_g: float


class _Training:
    """An LF training as the package does it, evaluated along the way."""

    def __init__(self, config: TcnConfig, known: CaeLibrary, unseen: CaeLibrary, cpu_s: float = np.inf) -> None:
        self.looks: list[_Look] = []
        self._unseen, self._cpu_s, self._next_cpu_s = unseen, cpu_s, 0.0
        self._approach = LfTcn(config, device="cpu")
        self._start = _clocks()
        with patch("crashfuse.approaches.time_domain.training.minimise", self._descend), suppress(Cancelled):
            self._approach.fit(Campaign("nine tenths", known, ()), replace(UNKEPT, watch=Watch(self._report)))

    def _descend(
        self,
        networks: Sequence[Tcn],
        objectives: Sequence[TrainingObjective],
        checkpoint: Checkpoint,
        name: str,
    ) -> FloatArray:
        self._networks = networks
        return minimise(networks, objectives, checkpoint, name)

    def _report(self, progress: Progress) -> None:
        begin = _clocks()
        cpu_s, wall_s = begin - self._start
        ends = progress.done == progress.total or cpu_s >= self._cpu_s
        if ends or cpu_s >= self._next_cpu_s:
            self.looks.append(_Look(progress.done, cpu_s, wall_s, self._error_g()))
            took = _clocks() - begin
            self._start += took
            self._next_cpu_s = cpu_s + _PAUSE * took[0]
        if ends:
            raise Cancelled("The time is up, or the training at its end.")

    def _error_g(self) -> float:
        config, scaling = self._approach.config, self._approach.scaling_
        network = Tcn.joined(self._networks, config)
        parts = np.array_split(self._unseen.vectors, np.ceil(len(self._unseen) / _PULSES_AT_ONCE))
        self._accel_mps2 = np.concatenate(
            [scaling.pulses(mean_outputs(network, scaling.inputs(own)), own) for own in parts]
        )
        return float(np.sqrt(np.mean((self._accel_mps2 - self._unseen.accel_mps2) ** 2))) / G

    def mean_rating(self) -> float:
        """Mean rating of the unseen runs, as predicted at the last evaluation."""
        rated = self._unseen.vectors[:, 0] >= _SLOWEST_RATED_MPS
        pairs = zip(self._unseen.accel_mps2[rated].astype(np.float64), self._accel_mps2[rated], strict=True)
        ratings = (rate_windows(Pulse(GRID_S, true), Pulse(GRID_S, found), (_WINDOW_MS,)) for true, found in pairs)
        return float(np.mean([rating[_WINDOW_MS].overall for rating in ratings]))


def main() -> None:
    """Train both and print Markdown tables."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("campaign", type=Path, nargs="?", default=Path("sample_data"))
    arguments.add_argument("--seconds", type=float, default=600.0, help="CPU seconds for the network of Table 2")
    arguments.add_argument("--seed", type=int, default=0, help="of the choice of held-out runs")
    options = arguments.parse_args()
    campaign = load_campaign(options.campaign)
    cae = campaign.cae
    order = np.random.default_rng(options.seed).permutation(len(cae))
    held_out, rest = np.split(order, [max(1, round(_HELD_OUT * len(cae)))])
    known, unseen = _part(cae, rest), _part(cae, held_out)
    _Training(TcnConfig.fast(), known, unseen, cpu_s=0.0)  # keeps what torch loads at first use off both clocks
    papers = _Training(TcnConfig.paper(), known, unseen, options.seconds)
    ours = _Training(TcnConfig.fast(), known, unseen)
    print(f"### {campaign.name}: {len(held_out)} of {len(cae)} CAE runs held out, {os.cpu_count()} cores\n")
    _print_times(papers.looks, ours.looks)
    trainings = {"Table 2, broken off": papers, "crashfuse, fast preset": ours}
    print(f"\n| | steps | CPU-s | wall s | error at the end, g | its mean rating 0–{_WINDOW_MS:g} ms |")
    print("|---|---:|---:|---:|---:|---:|")
    for name, training in trainings.items():
        end = training.looks[-1]
        print(
            f"| {name} | {end.steps} | {end.cpu_s:.1f} | {end.wall_s:.1f} | {end.error_g:.3f} "
            f"| {training.mean_rating():.3f} |"
        )
    print("\nOn the way, error in g (after CPU-s):\n")
    for name, training in trainings.items():
        print(f"- {name}: " + ", ".join(f"{look.error_g:.3f} ({look.cpu_s:.1f})" for look in _some(training.looks)))


def _print_times(papers: Sequence[_Look], ours: Sequence[_Look]) -> None:
    """For each error that Table 2's network reached, lower than all before: when each network got there."""
    best = [look for i, look in enumerate(papers) if all(look.error_g < past.error_g for past in papers[:i])]
    print("| error, g | Table 2: CPU-s (wall s) | crashfuse, fast preset: CPU-s (wall s) | ratio (of wall s) |")
    print("|---:|---:|---:|---:|")
    for paper in _some(best[1:]):
        own = next((look for look in ours if look.error_g <= paper.error_g), None)
        times = f"| {paper.error_g:.3f} | {paper.cpu_s:.0f} ({paper.wall_s:.0f})"
        if own is None:
            print(f"{times} | never | – |")
        else:
            ratios = f"{paper.cpu_s / own.cpu_s:.0f} ({paper.wall_s / own.wall_s:.0f})"
            print(f"{times} | {own.cpu_s:.2f} ({own.wall_s:.2f}) | {ratios} |")


def _some(looks: Sequence[_Look]) -> list[_Look]:
    """A few of them, evenly spaced, including the last."""
    return [looks[i] for i in np.unique(np.linspace(0, len(looks) - 1, min(_ROWS, len(looks))).round().astype(int))]


def _part(cae: CaeLibrary, runs: npt.NDArray[np.intp]) -> CaeLibrary:
    ids, conditions = zip(*((cae.ids[i], cae.conditions[i]) for i in runs), strict=True)
    return CaeLibrary(ids, conditions, cae.accel_mps2[runs])


def _clocks() -> FloatArray:
    """CPU seconds of the process, and wall seconds."""
    return np.array([time.process_time(), time.perf_counter()])


if __name__ == "__main__":
    main()
