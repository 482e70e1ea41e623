"""Training a TCN: the LF network on CAE runs (Eq. 5), its fine-tuning on tests (Eq. 6)."""

import copy
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

from crashfuse.approaches.tcn import Tcn, TcnConfig
from crashfuse.progress import Watch
from crashfuse.pulse import GRID_S, FloatArray

_VALIDATED = 0.1  # share of the CAE runs (Sect. 4.1: 90 % for training, 10 % for validation)
_WARM_UP = 0.1  # share of the steps
_SMALL = 1_000_000  # weights: below it, a second thread costs more than it gives


@dataclass(frozen=True, slots=True)
class Scaling:
    """How conditions and accelerations become numbers near 1; learned from the CAE runs alone.

    Parameters
    ----------
    centre, spread : tuple of float
        Mean and standard deviation of v0 (m/s), front and rear weight (kg).
    lowest, highest : tuple of float
        Ends of the library: beyond them the network gets what it would get there.
    accel_mps2 : float
        Root mean square of the accelerations, each divided by what its speed makes of it.
    """

    centre: tuple[float, ...]
    spread: tuple[float, ...]
    lowest: tuple[float, ...]
    highest: tuple[float, ...]
    accel_mps2: float

    @classmethod
    def of(cls, vectors: FloatArray, accel_mps2: FloatArray, config: TcnConfig) -> "Scaling":
        """Learn the scaling from conditions, shape (n, 3), and their pulses, shape (n, 1250)."""
        spread = np.maximum(vectors.std(axis=0), 1e-6 * np.abs(vectors).max(axis=0))
        centre, lowest, highest = vectors.mean(axis=0), vectors.min(axis=0), vectors.max(axis=0)
        unit = cls(tuple(centre.tolist()), tuple(spread.tolist()), tuple(lowest.tolist()), tuple(highest.tolist()), 1.0)
        sequences = accel_mps2[:, :: config.stride] / unit.outputs(vectors, config)[:, None]
        return replace(unit, accel_mps2=float(np.sqrt(np.mean(sequences**2))))

    def outputs(self, vectors: FloatArray, config: TcnConfig) -> FloatArray:
        """Acceleration that an output of 1 means for each condition, m/s², shape (n,)."""
        floor = config.scale_floor
        scale: FloatArray = self.accel_mps2 * (floor + (1 - floor) * vectors[:, 0] / self.highest[0])
        return scale

    def inputs(self, vectors: FloatArray, config: TcnConfig) -> Tensor:
        """Input sequences for conditions of shape (n, 3): shape (n_times, n, n_inputs), float32."""
        vectors = np.clip(vectors, self.lowest, self.highest)
        time = GRID_S[:: config.stride, None] / GRID_S[-1]
        travel = time * vectors[None, :, 0] / self.highest[0]
        columns = [2 * time - 1, *((vectors - self.centre) / self.spread).T[:, None]]
        columns += [wave(np.pi * k * time) for k in range(1, config.time_waves + 1) for wave in (np.sin, np.cos)]
        if config.travel_waves:
            columns.append(2 * travel - 1)
        columns += [wave(np.pi * k * travel) for k in range(1, config.travel_waves + 1) for wave in (np.sin, np.cos)]
        shape = (len(time), len(vectors))
        return torch.from_numpy(np.stack([np.broadcast_to(c, shape) for c in columns], axis=-1).astype(np.float32))

    def pulses(self, outputs: FloatArray, vectors: FloatArray, config: TcnConfig) -> FloatArray:
        """Pulses on the study grid, shape (n, 1250), that outputs of shape (n, n_times) at these conditions mean."""
        sequences: FloatArray = outputs * self.outputs(vectors, config)[:, None]
        if config.stride == 1:
            return sequences
        spline: FloatArray = CubicSpline(GRID_S[:: config.stride], sequences, axis=1)(GRID_S)
        return spline

    def targets(self, vectors: FloatArray, accel_mps2: FloatArray, config: TcnConfig) -> Tensor:
        """What the network should put out for pulses of shape (n, 1250): shape (n_times, n), float32."""
        scaled = accel_mps2[:, :: config.stride] / self.outputs(vectors, config)[:, None]
        return torch.from_numpy(np.ascontiguousarray(scaled.T, dtype=np.float32))


def predict(networks: Sequence[Tcn], scaling: Scaling, vectors: FloatArray, config: TcnConfig) -> FloatArray:
    """Mean pulses of networks at conditions of shape (n, 3), on the study grid: shape (n, 1250), m/s²."""
    outputs = mean_outputs(networks, scaling.inputs(vectors, config))
    return scaling.pulses(outputs, vectors, config)


def mean_outputs(networks: Sequence[Tcn], inputs: Tensor) -> FloatArray:
    """Mean outputs of networks, shape (n, n_times), for inputs of shape (n_times, n, n_inputs)."""
    outputs = []
    for network in networks:
        network.eval()
        with torch.no_grad(), one_thread_if_small(network):
            outputs.append(network(inputs.to(network.device)).cpu().numpy().T.astype(np.float64))
    mean: FloatArray = np.mean(outputs, axis=0)
    return mean


def train(
    vectors: FloatArray,
    accel_mps2: FloatArray,
    scaling: Scaling,
    config: TcnConfig,
    seed: int,
    device: torch.device,
    watch: Watch,
    step_name: str = "Training LF TCN",
) -> tuple[Tcn, FloatArray]:
    """Train the LF network on CAE runs (Eq. 5, mean square error).

    Parameters
    ----------
    vectors : ndarray, shape (n_runs, 3)
    accel_mps2 : ndarray, shape (n_runs, 1250)
    scaling : Scaling
    config : TcnConfig
    seed : int
        Of the weights, the validation runs and the order of the batches.
    device : torch.device
    watch : Watch
    step_name : str
        What the training is called in its reports.

    Returns
    -------
    Tcn
    losses : ndarray, shape (n_epochs, 2)
        Training and validation loss after each epoch.
    """
    generator = torch.Generator().manual_seed(seed)
    order = torch.randperm(len(vectors), generator=generator)
    n_validated = max(1, round(_VALIDATED * len(vectors)))
    validated, trained = order[:n_validated], order[n_validated:]
    inputs = scaling.inputs(vectors, config).to(device)
    targets = scaling.targets(vectors, accel_mps2, config).to(device)
    network = Tcn(config, generator).to(device)
    steps = max(1, len(trained) // config.batch)  # an incomplete batch waits for the next epoch's order
    epochs = max(config.epochs, math.ceil(config.min_steps / steps))
    optimiser = torch.optim.Adam(network.parameters(), lr=config.learning_rate, betas=(0.9, 0.95), fused=True)
    losses = np.zeros((epochs, 2))
    with one_thread_if_small(network):
        watch.report(step_name, 0, epochs)
        for epoch in range(epochs):
            network.train()
            shuffled = trained[torch.randperm(len(trained), generator=generator)]
            for step in range(steps):
                _set_rate(optimiser, config, epoch * steps + step, epochs * steps, steps)
                chosen = shuffled[step * config.batch : (step + 1) * config.batch].to(device)
                loss = (network(inputs[:, chosen]) - targets[:, chosen]).square().mean()
                optimiser.zero_grad(set_to_none=True)
                loss.backward()
                optimiser.step()
                losses[epoch, 0] += loss.item() / steps
            network.eval()
            with torch.no_grad():
                losses[epoch, 1] = (network(inputs[:, validated]) - targets[:, validated]).square().mean().item()
            watch.report(step_name, epoch + 1, epochs, train_loss=losses[epoch, 0], validation_loss=losses[epoch, 1])
    return network, losses


def fine_tune(
    network: Tcn, scaling: Scaling, vectors: FloatArray, accel_mps2: FloatArray, config: TcnConfig, watch: Watch
) -> tuple[Tcn, FloatArray]:
    """Fine-tune a copy of the LF network on tests (Eq. 6): θ_MF = θ_LF + θ_HF with the penalty λ‖θ_HF‖².

    The increments θ_HF start at zero, so θ_LF is both frozen and the initial value, as the paper has it.

    Parameters
    ----------
    network : Tcn
    scaling : Scaling
        The LF network's own.
    vectors : ndarray, shape (n_tests, 3)
    accel_mps2 : ndarray, shape (n_tests, 1250)
    config : TcnConfig
    watch : Watch

    Returns
    -------
    Tcn
    losses : ndarray, shape (n_steps,)
        Mean square error on the tests before each step, penalty not included.
    """
    device = network.device
    inputs = scaling.inputs(vectors, config).to(device)
    targets = scaling.targets(vectors, accel_mps2, config).to(device)
    tuned = copy.deepcopy(network).eval()  # no dropout: a handful of tests is noise enough
    start = [weight.detach().clone() for weight in tuned.parameters()]
    optimiser = torch.optim.Adam(tuned.parameters(), lr=config.tuning_rate, betas=(0.9, 0.95), fused=True)
    losses = np.zeros(config.tuning_steps)
    with one_thread_if_small(network):
        for step in range(config.tuning_steps):
            optimiser.param_groups[0]["lr"] = config.tuning_rate * _cosine(step / config.tuning_steps)
            loss = (tuned(inputs) - targets).square().mean()
            moved = torch.stack([(w - w0).square().sum() for w, w0 in zip(tuned.parameters(), start, strict=True)])
            optimiser.zero_grad(set_to_none=True)
            (loss + config.penalty * moved.sum()).backward()
            optimiser.step()
            losses[step] = loss.item()
            if step % 20 == 0:
                watch.report("Fine-tuning on tests", step, config.tuning_steps, train_loss=losses[step])
        watch.report("Fine-tuning on tests", config.tuning_steps, config.tuning_steps)
    return tuned, losses


def _set_rate(optimiser: torch.optim.Adam, config: TcnConfig, step: int, n_steps: int, steps_an_epoch: int) -> None:
    if config.annealing_epochs:
        share = _cosine(step // steps_an_epoch / config.annealing_epochs)
    else:
        warm = max(1, round(_WARM_UP * n_steps))
        share = (step + 1) / warm if step < warm else _cosine((step - warm) / (n_steps - warm))
    optimiser.param_groups[0]["lr"] = config.learning_rate * share


def _cosine(done: float) -> float:
    return 0.5 * (1 + math.cos(math.pi * done))


@contextmanager
def one_thread_if_small(network: Tcn) -> Iterator[None]:
    """Use one thread for a small network: faster, and the same numbers whatever else the machine does."""
    before = torch.get_num_threads()
    if sum(weight.numel() for weight in network.parameters()) < _SMALL:
        torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
