"""Derivatives of network outputs with respect to the fine-tuned weights, stored compactly.

Only the first and last block and the head are fine-tuned: the blocks between contribute 3 % of the tangent kernel at
half its cost. For the last block, an output's derivative is a sum of a few outer products of the gradient at the
output of a convolution and the input of that convolution. Only these factors are stored, and scalar products are
computed from them. An output depends on all of the first block's steps, so there the derivatives themselves are
stored: 3 MB per pulse and member.
"""

from dataclasses import dataclass
from typing import NamedTuple, cast

import torch
from torch import Tensor
from torch.nn import functional

from crashfuse.approaches.time_domain.network import CausalConv, ResidualBlock, Tcn


class Product(NamedTuple):
    """Derivative with respect to a weight matrix, back ⊗ seen per output, both of shape (n_outputs, ·)."""

    back: Tensor
    seen: Tensor


@dataclass(frozen=True, eq=False, slots=True)
class Tangent:
    """Derivatives of a single network's outputs: at all times of one condition, then of the next.

    Attributes
    ----------
    first : Tensor, shape (n_outputs, n_weights)
        With respect to the weights of the first block.
    last : tuple of tuple of Product
        For the head and each convolution of the last block, the products whose sum is the derivative.
    """

    first: Tensor
    last: tuple[tuple[Product, ...], ...]

    @classmethod
    def of(cls, network: Tcn, inputs: Tensor) -> "Tangent":
        """Differentiate a single network at inputs of shape (n_times, n_conditions, n_inputs)."""
        inputs = inputs.to(network.device)
        with torch.no_grad():
            return cls(_by_first_block(network, inputs), _by_last_block(network, inputs))

    def part(self, outputs: slice) -> "Tangent":
        """Derivatives of some of the outputs."""
        last = (tuple(Product(one.back[outputs], one.seen[outputs]) for one in own) for own in self.last)
        return Tangent(self.first[outputs], tuple(last))

    def kernel_with(self, other: "Tangent") -> Tensor:
        """Scalar products of derivatives here and elsewhere, shape (n_outputs, n_outputs of the other)."""
        kernel = self.first @ other.first.T
        for ours, theirs in zip(self.last, other.last, strict=True):
            for one in ours:
                for two in theirs:
                    kernel += (one.back @ two.back.T) * (one.seen @ two.seen.T)
        return kernel


def _by_first_block(network: Tcn, inputs: Tensor) -> Tensor:
    """Derivatives with respect to the first block's weights, shape (n_outputs, n_weights)."""
    n_times, n_conditions, _ = inputs.shape
    n_weights = sum(weight[0].numel() for weight in network.blocks[0].parameters())
    derivatives = inputs.new_empty((n_conditions, n_times, n_weights))
    for condition, own in zip(torch.split(inputs, 1, dim=1), derivatives, strict=True):
        products = _products_of_first_block(network, condition)
        torch.cat([(back[0].flatten(1).T @ seen[0, :, 0]).view(n_times, -1) for back, seen in products], dim=1, out=own)
    return derivatives.flatten(0, 1)


def _products_of_first_block(network: Tcn, inputs: Tensor) -> list[tuple[Tensor, Tensor]]:
    """What the first block's derivatives at one condition are sums over the steps of: (step, output, ·), (step, ·)."""
    first, *later = cast(list[ResidualBlock], list(network.blocks))
    hidden = [inputs[None]]
    for block in (first, *later):
        hidden.append(block(hidden[-1]))
    # Derivatives by what a block puts out are sequences, with one "pulse" for each output of the network.
    back = torch.eye(len(inputs), device=inputs.device)[None, ..., None] * network.head.weight[0, 0, :, 0]
    for block, seen in zip(reversed(later), reversed(hidden[1:-1]), strict=True):
        by_sum, _, by_first = _backwards(block, seen, back)
        back = by_sum + _transposed(block.first, by_first)
    by_sum, by_second, by_first = _backwards(first, hidden[0], back)
    products = [
        (by_first, _seen(first.first, hidden[0])),
        (by_second, _seen(first.second, torch.relu(first.first(hidden[0])))),
    ]
    if isinstance(first.shortcut, CausalConv):
        products.append((by_sum, _seen(first.shortcut, hidden[0])))
    return products


def _backwards(block: ResidualBlock, inputs: Tensor, back: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Derivatives by the sum before a block's last ReLU, and by the outputs of its second and first convolution."""
    between = torch.relu(block.first(inputs))
    second = block.second(between)
    by_sum = back * (torch.relu(second) + block.shortcut(inputs) > 0)
    by_second = by_sum * (second > 0)
    return by_sum, by_second, _transposed(block.second, by_second) * (between > 0)


def _transposed(convolution: CausalConv, back: Tensor) -> Tensor:
    """Derivatives by the input of a convolution, from those by its output."""
    by_input = back.new_zeros((*back.shape[:-1], convolution.weight.shape[2]))
    for tap, lag in zip(convolution.weight[0], convolution.lags, strict=True):
        by_input[:, : max(back.shape[1] - lag, 0)] += back[:, lag:] @ tap.T
    return by_input


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
    """Create a product from sequences of a single member, shape (1, n_times, n_conditions, ·)."""
    return Product(*(factor[0].transpose(0, 1).flatten(0, 1) for factor in (back, seen)))


def _seen(convolution: CausalConv, inputs: Tensor) -> Tensor:
    """Factors of the weights and the bias of a convolution at each step."""
    return torch.cat([*(_lagged(inputs, lag) for lag in convolution.lags), torch.ones_like(inputs[..., :1])], dim=-1)


def _lagged(sequence: Tensor, steps: int) -> Tensor:
    """The sequence delayed by this many steps; zero before its start."""
    return functional.pad(sequence, (0, 0, 0, 0, steps, 0))[:, : sequence.shape[1]]
