"""The two trainings of a TCN: on CAE runs (LF networks, Eq. 5), then on tests (MF networks, Eq. 6), both by Adam.

Interrupted at any step, a training resumes from its checkpoint with bit-identical results.
"""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, TypeAlias

import numpy as np
import torch
from torch import Tensor

from crashfuse.approaches.threads import quick_threads, side_by_side
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import Scaling, Tcn
from crashfuse.errors import Cancelled
from crashfuse.execution.cache import Entry
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import FloatArray

_FADING = (0.9, 0.95)  # β1, β2: what is kept of both means from step to step
_EPSILON = 1e-8

_REPORT_S = 0.2  # between reports, the points at which a training can be cancelled
_CHECKPOINT_S = 10.0
_SHARE = 0.05  # largest share of the time spent on checkpoints
_KIND = "checkpoints"  # kind of cache entry

_VALIDATED = 0.1  # share of the CAE runs (Sect. 4.1: 90 % for training, 10 % for validation)
_MOST_VALIDATED = 1000  # more would not make the loss more accurate
_WARM_UP = 0.1  # share of the steps
_SIDE_BY_SIDE = 2  # members per thread: more would leave a core idle, fewer would share no products

TrainingObjective: TypeAlias = "LfTraining | FineTuning"
"""Losses to differentiate and of each member; the first column of the curve is the mean loss of an epoch's steps."""


class Adam:
    """The optimiser Adam (Kingma and Ba, 2015, algorithm 1).

    torch's own gives the same steps, but loads torch's compiler, 1.6 CPU-seconds and 70 MB in every process.
    """

    def __init__(self, weights: Iterable[Tensor]) -> None:
        self.weights = tuple(weights)
        self.taken = 0
        self.moments = tuple(torch.zeros_like(weight) for weight in 2 * self.weights)  # means, then squares' means

    @torch.no_grad()
    def step(self, gradients: Sequence[Tensor], rate: float) -> None:
        """Move the weights against their gradients."""
        self.taken += 1
        first, second = _FADING
        whole, root = 1 - first**self.taken, (1 - second**self.taken) ** 0.5
        means, squares = self.moments[: len(self.weights)], self.moments[len(self.weights) :]
        for weight, gradient, mean, square in zip(self.weights, gradients, means, squares, strict=True):
            mean.lerp_(gradient, 1 - first)
            square.mul_(second).addcmul_(gradient, gradient, value=1 - second)
            weight.addcdiv_(mean, square.sqrt().div_(root).add_(_EPSILON), value=-rate / whole)


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Storage of an unfinished training: everything that its next step depends on."""

    run: Run
    key: Mapping[str, object]

    def save(self, state: Entry) -> None:
        """Replace the saved state."""
        self.run.cache.put(_KIND, self.key, state)


def minimise(
    networks: Sequence[Tcn], objectives: Sequence[TrainingObjective], checkpoint: Checkpoint, name: str
) -> FloatArray:
    """Train networks in place, side by side, from their checkpoint if there is one.

    Returns the learning curves of all members, shape (n_members, n_epochs, n_columns).
    """
    n_steps, columns = objectives[0].n_steps, objectives[0].columns
    runs = [_Training(network, objective) for network, objective in zip(networks, objectives, strict=True)]
    start = _resume(runs, checkpoint, n_steps)
    saved = reported = time.monotonic()
    watch, pause = checkpoint.run.watch, _CHECKPOINT_S
    with quick_threads(networks[0].size):
        watch.report(name, start, n_steps)
        for step in range(start, n_steps):
            ended = all(side_by_side(partial(_Training.step, number=step), runs))
            now, done = time.monotonic(), step + 1
            if now - saved > pause and done < n_steps:
                checkpoint.save(_state(runs, done))
                saved = time.monotonic()
                pause = max(_CHECKPOINT_S, (saved - now) / _SHARE)
            if ended or now - reported > _REPORT_S:
                reported = now
                curves = [run.curve[:, step // objectives[0].steps_an_epoch].cpu().numpy() for run in runs]
                values = np.concatenate(curves).mean(axis=0).tolist() if ended else ()
                try:
                    watch.report(name, done, n_steps, **dict(zip(columns, values, strict=bool(ended))))
                except Cancelled:
                    checkpoint.save(_state(runs, done))
                    raise
    checkpoint.run.cache.drop(_KIND, checkpoint.key)
    return np.concatenate([run.curve.cpu().numpy() for run in runs])


class _Training:
    def __init__(self, network: Tcn, objective: TrainingObjective) -> None:
        self.network, self._objective = network, objective
        self.optimiser = Adam(network.parameters())
        shape = (network.members, objective.n_steps // objective.steps_an_epoch, len(objective.columns))
        self.curve = torch.zeros(shape, dtype=torch.float64, device=network.device)

    def step(self, number: int) -> bool:
        network, objective = self.network, self._objective
        network.train()
        total, losses = objective.loss(network, number)
        self.optimiser.step(torch.autograd.grad(total, self.optimiser.weights), objective.rate(number))
        epoch = number // objective.steps_an_epoch
        self.curve[:, epoch, 0] += losses.detach() / objective.steps_an_epoch
        network.eval()
        if (number + 1) % objective.steps_an_epoch:
            return False
        with torch.no_grad():
            for column, losses in enumerate(objective.validate(network), start=1):
                self.curve[:, epoch, column] = losses
        return True


def _state(runs: Sequence[_Training], done: int) -> Entry:
    state: Entry = {"done": np.array(done)}
    for number, run in enumerate(runs):
        state[f"{number} curve"] = run.curve.cpu().numpy()
        state |= {f"{number} weight {name}": value for name, value in weights_of(run.network).items()}
        state |= {f"{number} moment {place}": m.cpu().numpy() for place, m in enumerate(run.optimiser.moments)}
    return state


def _resume(runs: Sequence[_Training], checkpoint: Checkpoint, n_steps: int) -> int:
    if (state := checkpoint.run.cache.get(_KIND, checkpoint.key)) is None:
        return 0
    begun = [(deepcopy(weights_of(run.network)), run.curve.clone()) for run in runs]
    try:
        done = _restore(runs, state)
        if not 0 < done < n_steps:
            raise ValueError("more steps than there are")
    except Exception as error:  # whatever is wrong with it, the training begins anew
        for run, (weights, curve) in zip(runs, begun, strict=True):
            load_weights(run.network, weights)
            run.curve.copy_(curve)
            run.optimiser = Adam(run.network.parameters())
        checkpoint.run.cache.discard(_KIND, checkpoint.key, error)
        return 0
    return done


def _restore(runs: Sequence[_Training], state: Entry) -> int:
    for number, run in enumerate(runs):
        arrays = {key.removeprefix(f"{number} "): value for key, value in state.items() if key.startswith(f"{number} ")}
        run.curve.copy_(torch.from_numpy(arrays["curve"]))
        load_weights(run.network, {k.removeprefix("weight "): v for k, v in arrays.items() if k.startswith("weight ")})
        for place, moment in enumerate(run.optimiser.moments):
            moment[:] = torch.from_numpy(arrays[f"moment {place}"]).view_as(moment)
        run.optimiser.taken = int(state["done"])
    return int(state["done"])


def weights_of(network: Tcn) -> Entry:
    """Weights as arrays, by name."""
    return {name: weight.cpu().numpy() for name, weight in network.state_dict().items()}


def load_weights(network: Tcn, weights: Entry) -> None:
    """Load weights that :func:`weights_of` took."""
    network.load_state_dict({name: torch.from_numpy(weight) for name, weight in weights.items()})


def mean_outputs(network: Tcn, inputs: Tensor) -> FloatArray:
    """Mean outputs of the members, shape (n, n_times), for inputs of shape (n_times, n, n_inputs)."""
    network.eval()
    with torch.no_grad(), quick_threads(network.size):
        outputs = network(inputs.to(network.device)).cpu().numpy()
    mean: FloatArray = outputs.astype(np.float64).mean(axis=0).T
    return mean


def train(
    vectors: FloatArray, accel_mps2: FloatArray, scaling: Scaling, seed: int, device: str, checkpoint: Checkpoint
) -> tuple[Tcn, FloatArray]:
    """Train the LF networks on CAE runs, conditions of shape (n_runs, 3) and pulses of shape (n_runs, 1250).

    Also returns the mean square error (Eq. 5) of training and validation, shape (n_members, n_epochs, 2).
    """
    config, inputs = scaling.config, scaling.inputs(vectors).to(device)
    targets = scaling.targets(vectors, accel_mps2).to(device)
    together = _SIDE_BY_SIDE if device == "cpu" else config.members
    networks, objectives = [], []
    for first in range(0, config.members, together):
        generator = torch.Generator().manual_seed(_mixed(seed, first))
        members = min(together, config.members - first)
        networks.append(Tcn(config, generator, members).to(device))
        objectives.append(LfTraining(inputs, targets, config, _mixed(seed, first), members, generator))
    losses = minimise(networks, objectives, checkpoint, "Training LF TCN")
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
        chosen = runs.to(self._inputs.device)
        inputs, targets = self._inputs[:, chosen].movedim(1, 0), self._targets[:, chosen].movedim(1, 0)
        errors: Tensor = network(inputs) - targets
        return errors.square().mean(dim=(1, 2))


def fine_tune(
    network: Tcn, scaling: Scaling, vectors: FloatArray, accel_mps2: FloatArray, checkpoint: Checkpoint
) -> tuple[Tcn, FloatArray]:
    """Fine-tune a copy of the LF networks on tests (Eq. 6): θ_MF = θ_LF + θ_HF with the penalty λ‖θ_HF‖².

    The increments θ_HF start at zero, so θ_LF is both frozen and the initial value, as in the paper. Also returns the
    mean square error on the tests before each step, penalty not included, shape (n_members, n_steps).
    """
    inputs = scaling.inputs(vectors).to(network.device)
    targets = scaling.targets(vectors, accel_mps2).to(network.device)
    tuned = deepcopy(network)
    objective = FineTuning(inputs, targets, scaling.config, list(network.parameters()))
    return tuned, minimise([tuned], [objective], checkpoint, "Fine-tuning on tests")[..., 0]


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
    return int(np.random.SeedSequence(numbers).generate_state(1)[0])


def _cosine(done: float) -> float:
    return 0.5 * (1 + math.cos(math.pi * done))
