"""Tuning of the pre-trained network to past vehicles, and the loss that it is trained by."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from crashfuse.approaches.calibration import JUDGED
from crashfuse.approaches.pretrained import FACTORS, N_TIMES, Forecast, PretrainedNetwork, shipped_network, unit
from crashfuse.approaches.threads import single_thread
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.files.tensors import Arrays
from crashfuse.signals.pulse import FloatArray

# What comes in and goes out: tuned as a whole, the network forgets other vehicles and predicts none better.
_TUNED = ("cae.", "measured.", "place", "known", "moved.", "first.", "last.")
_STEPS, _RATE, _WARM_UP, _LEAST = 80, 5e-4, 10, 0.05
_KNOWN, _OFTEN = (1, 2, 3, 4, 6, 8), (0.3, 0.22, 0.18, 0.12, 0.12, 0.06)  # known tests of a step, and how often
_LATE = 0.3  # weight of the errors after the rated 60 ms
_MEAN, _BAND = 20.0, 0.3  # weights of the errors of the expected pulse, and of the band's likelihood


class Vehicle(NamedTuple):
    """Tests of a vehicle and the CAE pulses there, shape (n, 125), m/s², and conditions, shape (n, 3): m/s and kg."""

    measured: FloatArray
    cae: FloatArray
    conditions: FloatArray


class Losses(NamedTuple):
    """Means over the tests that are not known: absolute errors, and the band's negative log likelihood."""

    first: Tensor
    mean: Tensor
    band: Tensor
    cae: Tensor

    @property
    def total(self) -> Tensor:
        """What training minimises."""
        return _MEAN * (0.5 * self.first + self.mean) + _BAND * self.band


def losses(network: PretrainedNetwork, vehicles: Sequence[Tensor], known: Tensor) -> Losses:
    """Losses of the network for the tests of many vehicles: measured and CAE pulses, conditions, and which are known.

    The shapes are those of :meth:`crashfuse.approaches.pretrained.PretrainedNetwork.forward`.
    """
    measured, cae, conditions = vehicles
    with torch.autocast(cae.device.type, torch.bfloat16, enabled=cae.device.type == "cuda"):
        forecast = network(measured, cae, conditions, known)
    one = unit(conditions[..., :1])
    weights = torch.ones(N_TIMES, device=cae.device)
    weights[JUDGED.stop :] = _LATE
    weights /= weights.mean()
    unknown = (~known).float() / (~known).sum()

    def error(pulse: Tensor) -> Tensor:
        return (((measured - pulse) / one).abs() * weights).mean(-1).mul(unknown).sum()

    band = (_surprise((measured - forecast.mean_mps2) / one, forecast) * unknown).sum()
    return Losses(error(forecast.first_mps2), error(forecast.mean_mps2), band, error(cae))


def _surprise(off: Tensor, forecast: Forecast) -> Tensor:
    """Negative log likelihood of errors per sample, up to a constant (Woodbury's identity)."""
    precision, factors = torch.exp(-2 * forecast.log_deviation), forecast.factors
    scaled = factors * precision[..., None]
    root = torch.linalg.cholesky(factors.mT @ scaled + torch.eye(FACTORS, device=off.device))
    explained = torch.linalg.solve_triangular(root, (scaled * off[..., None]).sum(-2)[..., None], upper=False)
    squares = (off.square() * precision).sum(-1) - explained.square().sum((-2, -1))
    size = 2 * forecast.log_deviation.sum(-1) + 2 * torch.diagonal(root, dim1=-2, dim2=-1).log().sum(-1)
    surprise: Tensor = 0.5 * (squares + size) / N_TIMES
    return surprise


def tuned(vehicles: Sequence[Vehicle], seed: int = 0, watch: Watch = SILENT) -> Arrays:
    """Weights of the pre-trained network that were tuned to vehicles, by name, as float16.

    In each step some tests of each vehicle are known, most often few, and its others are predicted.
    """
    with single_thread(), torch.random.fork_rng(devices=[]):
        network = shipped_network()
        weights = {name: weight for name, weight in network.named_parameters() if name.startswith(_TUNED)}
        network.requires_grad_(requires_grad=False)
        for weight in weights.values():
            weight.requires_grad_()
        optimiser = torch.optim.AdamW(weights.values(), lr=_RATE, weight_decay=0.0)
        data = [[torch.tensor(rows, dtype=torch.float32)[None] for rows in vehicle] for vehicle in vehicles]
        generator, rng = torch.Generator().manual_seed(seed), np.random.default_rng(seed)
        for step in range(_STEPS):
            watch.report("Tuning of the pre-trained network", step, _STEPS)
            share = _LEAST + (1 - _LEAST) * 0.5 * (1 + math.cos(math.pi * step / _STEPS))
            optimiser.param_groups[0]["lr"] = _RATE * min(1, (step + 1) / _WARM_UP) * share
            n = int(rng.choice(_KNOWN, p=_OFTEN))
            optimiser.zero_grad()
            for arrays in data:
                tests = arrays[0].shape[1]
                known = torch.rand(1, tests, generator=generator).argsort(1) < min(n, tests - 1)
                loss = losses(network, arrays, known).total / len(data)
                loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(weights.values(), 1.0)
            optimiser.step()
        return {name: weight.detach().half().numpy() for name, weight in weights.items()}
