"""The two trainings of a TCN: on CAE runs (LF networks, Eq. 5), then on tests (MF networks, Eq. 6)."""

import copy
import math
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.scaling import Scaling
from crashfuse.approaches.time_domain.threads import quick_threads
from crashfuse.approaches.time_domain.training import Checkpoint, minimise
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import FloatArray

_VALIDATED = 0.1  # share of the CAE runs (Sect. 4.1: 90 % for training, 10 % for validation)
_MOST_VALIDATED = 1000  # more would not make the loss more accurate
_WARM_UP = 0.1  # share of the steps
_SIDE_BY_SIDE = 2  # members per thread: more would leave a core idle, fewer would share no products


def predict(network: Tcn, scaling: Scaling, vectors: FloatArray, config: TcnConfig) -> FloatArray:
    """Mean pulses of the members at conditions of shape (n, 3), on the study grid: shape (n, 1250), m/s²."""
    return scaling.pulses(mean_outputs(network, scaling.inputs(vectors, config)), vectors, config)


def mean_outputs(network: Tcn, inputs: Tensor) -> FloatArray:
    """Mean outputs of the members, shape (n, n_times), for inputs of shape (n_times, n, n_inputs)."""
    network.eval()
    with torch.no_grad(), quick_threads(network):
        outputs = network(inputs.to(network.device)).cpu().numpy()
    mean: FloatArray = outputs.astype(np.float64).mean(axis=0).T
    return mean


def train(
    vectors: FloatArray,
    accel_mps2: FloatArray,
    scaling: Scaling,
    config: TcnConfig,
    seed: int,
    device: torch.device,
    checkpoint: Checkpoint,
    watch: Watch,
) -> tuple[Tcn, FloatArray]:
    """Train the LF networks on CAE runs, conditions of shape (n_runs, 3) and pulses of shape (n_runs, 1250).

    Also returns the mean square error (Eq. 5) of training and validation, shape (n_members, n_epochs, 2). The seed
    determines the weights, and each member's validation runs and order of batches.
    """
    inputs = scaling.inputs(vectors, config).to(device)
    targets = scaling.targets(vectors, accel_mps2, config).to(device)
    together = _SIDE_BY_SIDE if device.type == "cpu" else config.members
    networks, objectives = [], []
    for first in range(0, config.members, together):
        generator = torch.Generator().manual_seed(_mixed(seed, first))
        members = min(together, config.members - first)
        networks.append(Tcn(config, generator, members).to(device))
        objectives.append(LfTraining(inputs, targets, config, _mixed(seed, first), members, generator))
    losses = minimise(networks, objectives, checkpoint, watch, "Training LF TCN")
    return Tcn.joined(networks, config), losses


class LfTraining:
    """The LF training: each member has its own validation runs and its own order of the training runs."""

    columns: ClassVar[tuple[str, ...]] = ("train_loss", "validation_loss")

    def __init__(
        self, inputs: Tensor, targets: Tensor, config: TcnConfig, seed: int, members: int, dropout: torch.Generator
    ) -> None:
        n_runs = inputs.shape[1]
        n_validated = min(max(1, round(_VALIDATED * n_runs)), _MOST_VALIDATED)
        self._inputs, self._targets, self._config = inputs, targets, config
        self._seed, self._dropout = seed, dropout
        shuffled = self._shuffled(n_runs, members, 0)
        self._validated, self._trained = shuffled[:, :n_validated], shuffled[:, n_validated:]
        # an incomplete batch is dropped; the next epoch has a new order
        self.steps_an_epoch = max(1, self._trained.shape[1] // config.batch)
        self.n_steps = self.steps_an_epoch * max(config.epochs, math.ceil(config.min_steps / self.steps_an_epoch))
        self._epoch = -1

    def _shuffled(self, n: int, members: int, *purpose: int) -> Tensor:
        generator = torch.Generator().manual_seed(_mixed(self._seed, *purpose))
        return torch.stack([torch.randperm(n, generator=generator) for _ in range(members)])

    def rate(self, step: int) -> float:
        """Adam's learning rate: one warm-up and one cosine, or repeated cosines."""
        config = self._config
        if config.annealing_epochs:
            share = _cosine(step // self.steps_an_epoch / config.annealing_epochs)
        else:
            warm = max(1, round(_WARM_UP * self.n_steps))
            share = (step + 1) / warm if step < warm else _cosine((step - warm) / (self.n_steps - warm))
        return config.learning_rate * share

    def loss(self, network: Tcn, step: int) -> tuple[Tensor, Tensor]:
        """Mean square error over a batch; summed over members, so that each has its own gradient."""
        epoch, number = divmod(step, self.steps_an_epoch)
        if epoch != self._epoch:
            order = self._shuffled(self._trained.shape[1], len(self._trained), 1, epoch)
            self._order, self._epoch = torch.gather(self._trained, 1, order), epoch
        self._dropout.manual_seed(_mixed(self._seed, 2, step))
        batch = self._order[:, number * self._config.batch : (number + 1) * self._config.batch]
        losses = self._errors(network, batch)
        return losses.sum(), losses

    def validate(self, network: Tcn) -> tuple[Tensor, ...]:
        """Mean square error over the validation runs."""
        parts = torch.split(self._validated, 100, dim=1)
        weights = [part.shape[1] / self._validated.shape[1] for part in parts]
        return (sum((w * self._errors(network, p) for w, p in zip(weights, parts, strict=True)), torch.zeros(())),)

    def _errors(self, network: Tcn, runs: Tensor) -> Tensor:
        """Mean square error of each member on runs of its own, shape (n_members, n)."""
        chosen = runs.to(self._inputs.device)
        inputs, targets = self._inputs[:, chosen].movedim(1, 0), self._targets[:, chosen].movedim(1, 0)
        errors: Tensor = network(inputs) - targets
        return errors.square().mean(dim=(1, 2))


def fine_tune(
    network: Tcn,
    scaling: Scaling,
    vectors: FloatArray,
    accel_mps2: FloatArray,
    config: TcnConfig,
    checkpoint: Checkpoint,
    watch: Watch,
) -> tuple[Tcn, FloatArray]:
    """Fine-tune a copy of the LF networks on tests (Eq. 6): θ_MF = θ_LF + θ_HF with the penalty λ‖θ_HF‖².

    The increments θ_HF start at zero, so θ_LF is both frozen and the initial value, as in the paper. The scaling is
    the LF networks' own; conditions and pulses are of shape (n_tests, 3) and (n_tests, 1250). Also returns the mean
    square error on the tests before each step, penalty not included, shape (n_members, n_steps).
    """
    inputs = scaling.inputs(vectors, config).to(network.device)
    targets = scaling.targets(vectors, accel_mps2, config).to(network.device)
    tuned = copy.deepcopy(network)
    objective = FineTuning(inputs, targets, config, list(network.parameters()))
    return tuned, minimise([tuned], [objective], checkpoint, watch, "Fine-tuning on tests")[..., 0]


class FineTuning:
    """The fine-tuning: all tests at each step."""

    columns: ClassVar[tuple[str, ...]] = ("train_loss",)

    def __init__(self, inputs: Tensor, targets: Tensor, config: TcnConfig, start: list[torch.nn.Parameter]) -> None:
        self.steps_an_epoch = 1
        self._inputs, self._targets, self._config, self._start = inputs, targets, config, start
        self.n_steps = config.tuning_steps

    def rate(self, step: int) -> float:
        """Adam's learning rate: half a cosine."""
        return self._config.tuning_rate * _cosine(step / self.n_steps)

    def loss(self, network: Tcn, step: int) -> tuple[Tensor, Tensor]:  # noqa: ARG002 - every step is alike
        """Mean square error and penalty."""
        network.eval()  # no dropout: a handful of tests is already noisy enough
        losses = (network(self._inputs) - self._targets).square().mean(dim=(1, 2))
        moved = [(w - w0.detach()).square().sum() for w, w0 in zip(network.parameters(), self._start, strict=True)]
        return losses.sum() + self._config.penalty * torch.stack(moved).sum(), losses

    def validate(self, network: Tcn) -> tuple[Tensor, ...]:  # noqa: ARG002 - all tests are learned from
        """No further columns."""
        return ()


def _mixed(*numbers: int) -> int:
    """Combine several numbers into one seed of 32 bits, as torch uses no more."""
    return int(np.random.SeedSequence(numbers).generate_state(1)[0])


def _cosine(done: float) -> float:
    return 0.5 * (1 + math.cos(math.pi * done))
