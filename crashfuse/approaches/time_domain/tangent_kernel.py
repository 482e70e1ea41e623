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
    """Derivative with respect to a weight matrix, back ⊗ seen per output, both of shape (n_times, ·)."""

    back: Tensor
    seen: Tensor


@dataclass(frozen=True, eq=False, slots=True)
class Tangent:
    """Derivatives of a single network's outputs at one condition.

    Attributes
    ----------
    first : Tensor, shape (n_times, n_weights)
        With respect to the weights of the first block.
    last : tuple of tuple of Product
        For the head and each convolution of the last block, the products whose sum is the derivative.
    """

    first: Tensor
    last: tuple[tuple[Product, ...], ...]

    @classmethod
    def of(cls, network: Tcn, inputs: Tensor) -> "Tangent":
        """Differentiate a single network at inputs of shape (n_times, 1, n_inputs)."""
        inputs = inputs.to(network.device)
        with torch.no_grad():
            return cls(_by_first_block(network, inputs), _by_last_block(network, inputs))

    def kernel_with(self, other: "Tangent") -> Tensor:
        """Scalar products of derivatives here and at another condition, shape (n_times, n_times)."""
        kernel = self.first @ other.first.T
        for ours, theirs in zip(self.last, other.last, strict=True):
            for one in ours:
                for two in theirs:
                    kernel += (one.back @ two.back.T) * (one.seen @ two.seen.T)
        return kernel


def _by_first_block(network: Tcn, inputs: Tensor) -> Tensor:
    """Derivatives with respect to the first block's weights, shape (n_times, n_weights)."""
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
    return torch.cat([torch.einsum("stc,sk->tck", b[0], s[0, :, 0]).flatten(1) for b, s in products], dim=1)


def _backwards(block: ResidualBlock, inputs: Tensor, back: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Derivatives by the sum before a block's last ReLU, and by the outputs of its second and first convolution."""
    between = torch.relu(block.first(inputs))
    second = block.second(between)
    by_sum = back * (torch.relu(second) + block.shortcut(inputs) > 0)
    by_second = by_sum * (second > 0)
    return by_sum, by_second, _transposed(block.second, by_second) * (between > 0)


def _transposed(convolution: CausalConv, back: Tensor) -> Tensor:
    """Derivatives by the input of a convolution, from those by its output."""
    taps = zip(convolution.weight[0], convolution.lags, strict=True)
    return torch.stack([functional.pad(back[:, lag:], (0, 0, 0, 0, 0, lag)) @ tap.T for tap, lag in taps]).sum(dim=0)


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
    """Create a product from sequences of a single member and condition, shape (1, n_times, 1, ·)."""
    return Product(back[0, :, 0], seen[0, :, 0])


def _seen(convolution: CausalConv, inputs: Tensor) -> Tensor:
    """Factors of the weights and the bias of a convolution at each step."""
    return torch.cat([*(_lagged(inputs, lag) for lag in convolution.lags), torch.ones_like(inputs[..., :1])], dim=-1)


def _lagged(sequence: Tensor, steps: int) -> Tensor:
    """The sequence delayed by this many steps; zero before its start."""
    return functional.pad(sequence, (0, 0, 0, 0, steps, 0))[:, : sequence.shape[1]]
