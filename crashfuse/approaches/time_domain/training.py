"""Adam training with checkpoints: interrupted at any step, it resumes with bit-identical results."""

import time
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Protocol

import numpy as np
import torch
from torch import Tensor

from crashfuse.approaches.time_domain.adam import Adam
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.threads import quick_threads, side_by_side
from crashfuse.errors import Cancelled
from crashfuse.execution.cache import Cache, Entry
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import FloatArray

_REPORT_S = 0.2  # between reports, the points at which a training can be cancelled
_CHECKPOINT_S = 10.0
_SHARE = 0.05  # largest share of the time spent on checkpoints
_KIND = "checkpoints"  # kind of cache entry


class TrainingObjective(Protocol):
    """Objective of a training: loss, number of steps and learning rate."""

    columns: ClassVar[tuple[str, ...]]
    """Columns of the learning curve for each epoch; the first is the mean loss of its steps."""
    n_steps: int
    steps_an_epoch: int

    def rate(self, step: int) -> float:
        """Adam's learning rate."""

    def loss(self, network: Tcn, step: int) -> tuple[Tensor, Tensor]:
        """Loss to differentiate, and that of each member for the curve; random numbers depend only on the step."""

    def validate(self, network: Tcn) -> tuple[Tensor, ...]:
        """The other columns of the curve after an epoch, shape (n_members,) each."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Storage of an unfinished training: everything that its next step depends on."""

    cache: Cache | None
    key: Mapping[str, object]

    def load(self) -> Entry | None:
        """The last saved state, if any."""
        return self.cache.get(_KIND, self.key) if self.cache else None

    def save(self, state: Entry) -> None:
        """Save a state, replacing the previous one."""
        if self.cache:
            self.cache.put(_KIND, self.key, state)

    def discard(self, error: Exception) -> None:
        """Delete a checkpoint that cannot be used."""
        if self.cache:
            self.cache.discard(_KIND, self.key, error)

    def drop(self) -> None:
        """Delete the checkpoint when training has ended."""
        if self.cache:
            self.cache.drop(_KIND, self.key)


def minimise(
    networks: Sequence[Tcn], objectives: Sequence[TrainingObjective], checkpoint: Checkpoint, watch: Watch, name: str
) -> FloatArray:
    """Train networks in place, side by side, from their checkpoint if there is one.

    The objectives, one for each network, have equal numbers of steps; ``name`` labels the progress reports. Returns the
    learning curves of all members of all networks, shape (n_members, n_epochs, n_columns).

    Raises
    ------
    Cancelled
        If the watch was told to stop; the state is in the checkpoint.
    """
    n_steps, columns = objectives[0].n_steps, objectives[0].columns
    runs = [_Run(network, objective) for network, objective in zip(networks, objectives, strict=True)]
    start = _resume(runs, checkpoint, n_steps)
    saved = reported = time.monotonic()
    pause = _CHECKPOINT_S
    with quick_threads(networks[0]):
        watch.report(name, start, n_steps)
        for step in range(start, n_steps):
            ended = all(side_by_side(partial(_Run.step, number=step), runs))
            now, done = time.monotonic(), step + 1
            if checkpoint.cache and now - saved > pause and done < n_steps:
                checkpoint.save(_state(runs, done))
                saved = time.monotonic()
                pause = max(_CHECKPOINT_S, (saved - now) / _SHARE)
            if ended or now - reported > _REPORT_S:
                reported = now
                values = np.mean([run.last_epoch() for run in runs], axis=0).tolist() if ended else ()
                try:
                    watch.report(name, done, n_steps, **dict(zip(columns, values, strict=bool(ended))))
                except Cancelled:
                    checkpoint.save(_state(runs, done))
                    raise
    checkpoint.drop()
    return np.concatenate([run.curve.cpu().numpy() for run in runs])


class _Run:
    """The training of one network."""

    def __init__(self, network: Tcn, objective: TrainingObjective) -> None:
        self.network, self._objective, self._epoch = network, objective, 0
        self.optimiser = Adam(network.parameters())
        shape = (network.members, objective.n_steps // objective.steps_an_epoch, len(objective.columns))
        self.curve = torch.zeros(shape, dtype=torch.float64, device=network.device)

    def step(self, number: int) -> bool:
        """Take a step; returns True if it ends an epoch."""
        network, objective = self.network, self._objective
        network.train()
        total, losses = objective.loss(network, number)
        self.optimiser.step(torch.autograd.grad(total, self.optimiser.weights), objective.rate(number))
        self._epoch = number // objective.steps_an_epoch
        self.curve[:, self._epoch, 0] += losses.detach() / objective.steps_an_epoch
        network.eval()
        if (number + 1) % objective.steps_an_epoch:
            return False
        with torch.no_grad():
            for column, losses in enumerate(objective.validate(network), start=1):
                self.curve[:, self._epoch, column] = losses
        return True

    def last_epoch(self) -> FloatArray:
        """Each column of the curve for the last epoch, averaged over the members."""
        return np.asarray(self.curve[:, self._epoch].mean(dim=0).cpu())


def _state(runs: Sequence[_Run], done: int) -> Entry:
    state: Entry = {"done": np.array(done)}
    for number, run in enumerate(runs):
        state[f"{number} curve"] = run.curve.cpu().numpy()
        state |= {f"{number} weight {name}": value for name, value in weights_of(run.network).items()}
        state |= {f"{number} moment {place}": each.cpu().numpy() for place, each in enumerate(run.optimiser.moments)}
    return state


def _resume(runs: Sequence[_Run], checkpoint: Checkpoint, n_steps: int) -> int:
    """Restore a checkpoint; returns the number of steps done. One that cannot be of this training is dropped."""
    state = checkpoint.load()
    if state is None:
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
        checkpoint.discard(error)
        return 0
    return done


def _restore(runs: Sequence[_Run], state: Entry) -> int:
    """Restore the state of each run; raises if it is not one."""
    for number, run in enumerate(runs):
        own = {key.removeprefix(f"{number} "): value for key, value in state.items() if key.startswith(f"{number} ")}
        run.curve.copy_(torch.from_numpy(own["curve"]))
        load_weights(run.network, {k.removeprefix("weight "): v for k, v in own.items() if k.startswith("weight ")})
        for place, moment in enumerate(run.optimiser.moments):
            moment[:] = torch.from_numpy(own[f"moment {place}"]).view_as(moment)
        run.optimiser.taken = int(state["done"])
    return int(state["done"])


def weights_of(network: Tcn) -> Entry:
    """Weights as arrays, by name."""
    return {name: weight.cpu().numpy() for name, weight in network.state_dict().items()}


def load_weights(network: Tcn, weights: Entry) -> None:
    """Load weights that :func:`weights_of` took from a network of the same shape."""
    network.load_state_dict({name: torch.from_numpy(weight) for name, weight in weights.items()})
