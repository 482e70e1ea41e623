"""Derivatives of network outputs with respect to the fine-tuned weights, stored compactly.

Only the first and last block and the head are fine-tuned: the blocks between contribute 3 % of the tangent kernel at
half its cost. For the last block, an output's derivative is a sum of a few outer products of the gradient at the
output of a convolution and the input of that convolution. Only these factors are stored, and scalar products are
computed from them. An output depends on all of the first block's steps, so there the derivatives themselves are
stored: 3 MB per pulse and member.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import CausalConv, ResidualBlock, Tcn
from crashfuse.approaches.time_domain.threads import Crew, quick_threads
from crashfuse.signals.pulse import FloatArray


class Product(NamedTuple):
    """Derivative with respect to a weight matrix, back ⊗ seen per output, both of shape (n · n_times, ·)."""

    back: Tensor
    seen: Tensor


@dataclass(frozen=True, eq=False, slots=True)
class Tangent:
    """Derivatives of a single network's outputs at n conditions; the times of a condition are contiguous.

    Attributes
    ----------
    first : Tensor, shape (n · n_times, n_weights)
        With respect to the weights of the first block.
    last : tuple of tuple of Product
        For the head and each convolution of the last block, the products whose sum is the derivative.
    """

    n_times: int
    first: Tensor
    last: tuple[tuple[Product, ...], ...]

    @classmethod
    def of(cls, network: Tcn, inputs: Tensor) -> "Tangent":
        """Differentiate a single network at inputs of shape (n_times, n, n_inputs)."""
        inputs = inputs.to(network.device)
        with torch.no_grad():
            return cls(len(inputs), _by_first_block(network, inputs), _by_last_block(network, inputs))

    def kernel_with(self, other: "Tangent") -> FloatArray:
        """Scalar products of derivatives at these and at other conditions, shape (n, n_times, n_others, n_times)."""
        kernel = self.first @ other.first.T
        for ours, theirs in zip(self.last, other.last, strict=True):
            for one in ours:
                for two in theirs:
                    kernel += (one.back @ two.back.T) * (one.seen @ two.seen.T)
        n, n_others = (len(tangent.first) // self.n_times for tangent in (self, other))
        return kernel.cpu().numpy().astype(np.float64).reshape(n, self.n_times, n_others, self.n_times)


def tangents(network: Tcn, config: TcnConfig, inputs: Tensor) -> list[Tangent]:
    """Differentiate each member of an ensemble at inputs of shape (n_times, n, n_inputs)."""
    with quick_threads(network), Crew(network.members) as crew:
        return crew.map(lambda member: Tangent.of(network.alone(member, config), inputs), range(network.members))


def tangent_kernel(network: Tcn, ours: Sequence[Tangent], theirs: Sequence[Tangent]) -> FloatArray:
    """J(x) J(x')ᵀ of the mean of the members, all weights together, times the number of members.

    From the tangents of each member at n and at n' conditions: shape (n, n_times, n', n_times).
    """
    with quick_threads(network), Crew(network.members) as crew:
        kernels = crew.map(lambda pair: pair[0].kernel_with(pair[1]), zip(ours, theirs, strict=True))
    kernel: FloatArray = np.mean(kernels, axis=0)
    return kernel


def _by_first_block(network: Tcn, inputs: Tensor) -> Tensor:
    """Derivatives with respect to the first block's weights, one condition after the other."""
    weights = {name: weight.detach() for name, weight in network.named_parameters() if name.startswith("blocks.0.")}
    n_times, n, _ = inputs.shape
    rows = torch.empty(n, n_times, sum(weight.numel() for weight in weights.values()), device=inputs.device)
    for pulse, own in zip(torch.split(inputs, 1, dim=1), rows, strict=True):

        def outputs(weights: dict[str, Tensor], pulse: Tensor = pulse) -> Tensor:
            result: Tensor = torch.func.functional_call(network, weights, (pulse[None],))
            return result[0, :, 0]

        pullback = torch.func.vjp(outputs, weights)[1]
        (gradients,) = torch.func.vmap(pullback)(torch.eye(n_times, device=inputs.device))
        torch.cat([gradient.flatten(1) for gradient in gradients.values()], dim=1, out=own)
    return rows.flatten(0, 1)


def _by_last_block(network: Tcn, inputs: Tensor) -> tuple[tuple[Product, ...], ...]:
    """Derivatives for the weights of the head, and of the last block unless that is the first."""
    *before, last = cast(list[ResidualBlock], list(network.blocks))
    hidden = inputs[None]
    for block in before:
        hidden = block(hidden)
    outputs = last(hidden)
    ones = torch.ones_like(outputs[..., :1])
    by_head = (_product(ones, torch.cat([outputs, ones], dim=-1)),)
    if not before:
        return (by_head,)
    between = torch.relu(last.first(hidden))
    back = network.head.weight[0, 0, :, 0] * (outputs > 0) * (last.second(between) > 0)
    by_second = (_product(back, _seen(last.second, between)),)
    # An output depends on the first convolution's output at as many steps as the second one has taps.
    by_first = tuple(
        _product(back @ tap.T * _lagged(between > 0, lag), _lagged(_seen(last.first, hidden), lag))
        for tap, lag in zip(last.second.weight[0], last.second.lags, strict=True)
    )
    return by_head, by_second, by_first


def _product(back: Tensor, seen: Tensor) -> Product:
    """Create a product from sequences of a single member, shape (1, n_times, n, ·)."""
    return Product(*(sequence[0].movedim(1, 0).flatten(0, 1) for sequence in (back, seen)))


def _seen(convolution: CausalConv, inputs: Tensor) -> Tensor:
    """Factors of the weights and the bias of a convolution at each step."""
    return torch.cat([*(_lagged(inputs, lag) for lag in convolution.lags), torch.ones_like(inputs[..., :1])], dim=-1)


def _lagged(sequence: Tensor, steps: int) -> Tensor:
    """The sequence delayed by this many steps; zero before its start."""
    return functional.pad(sequence, (0, 0, 0, 0, steps, 0))[:, : sequence.shape[1]]
