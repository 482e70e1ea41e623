"""Down a loss by Adam, step after step; stopped at any step, and continued from there to the same bits."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Protocol

import numpy as np
import torch
from torch import Tensor

from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.threads import Crew, quick_threads
from crashfuse.errors import Cancelled
from crashfuse.execution.cache import Cache, Entry
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import FloatArray

_REPORT_S = 0.2  # between reports, at which a training can be cancelled
_CHECKPOINT_S = 10.0
_SHARE = 0.05  # of the time, at most, goes into checkpoints
_KIND = "checkpoints"  # of entries in the cache


class Problem(Protocol):
    """What is to be minimised, and how fast."""

    columns: ClassVar[tuple[str, ...]]
    """What the learning curve tells of an epoch; the first is the mean loss of its steps."""
    n_steps: int
    steps_an_epoch: int

    def rate(self, step: int) -> float:
        """Adam's learning rate."""

    def loss(self, network: Tcn, step: int) -> tuple[Tensor, Tensor]:
        """What is differentiated, and each member's loss for the curve; random numbers come from the step alone."""

    def validate(self, network: Tcn) -> tuple[Tensor, ...]:
        """The other columns, after an epoch: shape (n_members,) each."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where a training that has not come to its end is kept: everything that its next step depends on."""

    cache: Cache | None
    key: Mapping[str, object]

    def load(self) -> Entry | None:
        """What was saved last."""
        return self.cache.get(_KIND, self.key) if self.cache else None

    def save(self, state: Entry) -> None:
        """Replace what was saved before."""
        if self.cache:
            self.cache.put(_KIND, self.key, state)

    def drop(self) -> None:
        """Forget it: the training has come to its end."""
        if self.cache:
            self.cache.drop(_KIND, self.key)


def descend(
    networks: Sequence[Tcn], problems: Sequence[Problem], checkpoint: Checkpoint, watch: Watch, name: str
) -> FloatArray:
    """Train networks in place, side by side, from their checkpoint if there is one.

    Parameters
    ----------
    networks : sequence of Tcn
    problems : sequence of Problem
        One for each, all of one length.
    checkpoint : Checkpoint
    watch : Watch
    name : str
        What the training is called in its reports.

    Returns
    -------
    ndarray, shape (n_members, n_epochs, n_columns)
        The learning curves of all members of all networks.

    Raises
    ------
    Cancelled
        If the watch was told to stop; what has been learned is in the checkpoint.
    """
    n_steps, columns = problems[0].n_steps, problems[0].columns
    runs = [_Run(network, problem) for network, problem in zip(networks, problems, strict=True)]
    start = _resume(runs, checkpoint.load())
    saved = reported = time.monotonic()
    pause = _CHECKPOINT_S
    with quick_threads(networks[0]), Crew(len(runs)) as crew:
        watch.report(name, start, n_steps)
        for step in range(start, n_steps):
            ended = all(crew.map(partial(_Run.step, number=step), runs))
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
    """One network on its way down."""

    def __init__(self, network: Tcn, problem: Problem) -> None:
        self.network, self._problem, self._epoch = network, problem, 0
        self.optimiser = torch.optim.Adam(network.parameters(), betas=(0.9, 0.95), fused=True)
        shape = (network.members, problem.n_steps // problem.steps_an_epoch, len(problem.columns))
        self.curve = torch.zeros(shape, dtype=torch.float64, device=network.device)

    def step(self, number: int) -> bool:
        """Take a step; returns whether an epoch ends with it."""
        network, problem = self.network, self._problem
        network.train()
        self.optimiser.param_groups[0]["lr"] = problem.rate(number)
        objective, losses = problem.loss(network, number)
        self.optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(objective)
        self.optimiser.step()
        self._epoch = number // problem.steps_an_epoch
        self.curve[:, self._epoch, 0] += losses.detach() / problem.steps_an_epoch
        network.eval()
        if (number + 1) % problem.steps_an_epoch:
            return False
        with torch.no_grad():
            for column, losses in enumerate(problem.validate(network), start=1):
                self.curve[:, self._epoch, column] = losses
        return True

    def last_epoch(self) -> FloatArray:
        """Mean over the members of each column of the curve."""
        return np.asarray(self.curve[:, self._epoch].mean(dim=0).cpu())


def _state(runs: Sequence[_Run], done: int) -> Entry:
    state: Entry = {"done": np.array(done)}
    for number, run in enumerate(runs):
        state[f"{number} curve"] = run.curve.cpu().numpy()
        state |= {f"{number} weight {name}": value for name, value in weights_of(run.network).items()}
        for place, moments in run.optimiser.state_dict()["state"].items():
            state |= {f"{number} moment {place} {name}": value.cpu().numpy() for name, value in moments.items()}
    return state


def _resume(runs: Sequence[_Run], state: Entry | None) -> int:
    """Go back to where a checkpoint was made; returns how many steps that was."""
    if state is None:
        return 0
    for number, run in enumerate(runs):
        own = {key.removeprefix(f"{number} "): value for key, value in state.items() if key.startswith(f"{number} ")}
        run.curve.copy_(torch.from_numpy(own["curve"]))
        load_weights(run.network, {k.removeprefix("weight "): v for k, v in own.items() if k.startswith("weight ")})
        moments: dict[int, dict[str, Tensor]] = {}
        for key, value in own.items():
            if key.startswith("moment "):
                _, place, name = key.split(" ")
                moments.setdefault(int(place), {})[name] = torch.from_numpy(value)
        run.optimiser.load_state_dict({**run.optimiser.state_dict(), "state": moments})
    return int(state["done"])


def weights_of(network: Tcn) -> Entry:
    """Weights as arrays, by name."""
    return {name: weight.cpu().numpy() for name, weight in network.state_dict().items()}


def load_weights(network: Tcn, weights: Entry) -> None:
    """Give a network the weights that :func:`weights_of` took from one like it."""
    network.load_state_dict({name: torch.from_numpy(weight) for name, weight in weights.items()})
