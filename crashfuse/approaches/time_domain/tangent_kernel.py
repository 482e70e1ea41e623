"""Derivatives of network outputs with respect to the fine-tuned weights, stored compactly.

Only the first and last block and the head are fine-tuned: the blocks between contribute 3 % of the tangent kernel at
half its cost. For the last block, an output's derivative is a sum of a few outer products of the gradient at the
output of a convolution and the input of that convolution. Only these factors are stored, and scalar products are
computed from them. An output depends on all of the first block's steps, so there the derivatives themselves are
stored: 3 MB per pulse and member.

All members are differentiated at once, as each step is little work: the calls would cost more than what they compute.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self, cast

import torch
from torch import Tensor
from torch.nn import functional

from crashfuse.approaches.time_domain.network import CausalConv, ResidualBlock, Tcn


class Product(NamedTuple):
    """Derivative with respect to a weight matrix, back ⊗ seen per output, both of shape (n_members, n_outputs, ·)."""

    back: Tensor
    seen: Tensor


@dataclass(frozen=True, eq=False, slots=True)
class Tangent:
    """Derivatives of each network's outputs: at all times of one condition, then of the next.

    Attributes
    ----------
    first : Tensor, shape (n_members, n_outputs, n_weights)
        With respect to the weights of the first block.
    last : tuple of tuple of Product
        For the head and each convolution of the last block, the products whose sum is the derivative.
    """

    first: Tensor
    last: tuple[tuple[Product, ...], ...]

    @classmethod
    def of(cls, network: Tcn, inputs: Tensor) -> Self:
        """Differentiate all members at inputs of shape (n_times, n_conditions, n_inputs)."""
        inputs = inputs.to(network.device).expand(network.members, *inputs.shape)
        with torch.no_grad():
            return cls(_by_first_block(network, inputs), _by_last_block(network, inputs))

    def part(self, outputs: slice = slice(None), members: slice = slice(None)) -> "Tangent":
        """Derivatives of some of the outputs, or members."""
        last = (tuple(Product(*(each[members, outputs] for each in one)) for one in own) for own in self.last)
        return Tangent(self.first[members, outputs], tuple(last))

    def kernel_with(self, other: "Tangent") -> Tensor:
        """Scalar products of derivatives here and elsewhere, shape (n_members, n_outputs, n_outputs of the other).

        To the bit what the other has with these: sums are taken in an order that is the same for both.
        """
        kernel = self.first @ other.first.mT
        for ours, theirs in zip(self.last, other.last, strict=True):
            for number, both in enumerate(zip(ours, theirs, strict=True)):
                kernel += _scalar(*both)
                for before in range(number):
                    kernel += _scalar(ours[number], theirs[before]) + _scalar(ours[before], theirs[number])
        return kernel


class _Passed(NamedTuple):
    """What a residual block makes of sequences, shape (n_members, n_times, n_conditions, ·).

    Attributes
    ----------
    inputs, between, outputs : Tensor
        Before its first convolution, before its second one, and after its last ReLU.
    second : Tensor of bool
        Where the ReLU of the second convolution lets anything pass.
    """

    inputs: Tensor
    between: Tensor
    second: Tensor
    outputs: Tensor

    @classmethod
    def of(cls, block: ResidualBlock, inputs: Tensor) -> Self:
        between = torch.relu(block.first(inputs))
        second = torch.relu(block.second(between))
        return cls(inputs, between, second > 0, torch.relu(second + block.shortcut(inputs)))


class _Back(NamedTuple):
    """Derivatives of every output by a sequence: not zero but at even steps up to the output's own.

    Attributes
    ----------
    by : Tensor, shape (n_members, n_lags, n_outputs, n_channels)
        By what the sequence was so long before each output; the longest lag comes first, none last.
    apart : int
        Steps between two lags.
    """

    by: Tensor
    apart: int

    def where(self, passed: Tensor) -> "_Back":
        """Derivatives before a ReLU from those after it, which passed sequences of one condition at some steps."""
        return self._replace(by=self.by * self.before(passed))

    def through(self, convolution: CausalConv) -> "_Back":
        """Derivatives by the input of a convolution, from these by its output."""
        members, n_lags, n_outputs, _ = self.by.shape
        lags, n_in = convolution.lags, convolution.weight.shape[2]
        apart = math.gcd(self.apart, *lags) or 1
        every, longest = self.apart // apart or 1, lags[0] // apart
        by_input = self.by.new_zeros((members, (n_lags - 1) * every + longest + 1, n_outputs, n_in))
        taps = convolution.weight.permute(0, 3, 1, 2).flatten(2)
        by_tap = (self.by.flatten(1, 2) @ taps).view(members, n_lags, n_outputs, len(lags), n_in)
        for tap, lag in enumerate(lags):
            first = longest - lag // apart
            by_input[:, first : first + (n_lags - 1) * every + 1 : every] += by_tap[..., tap, :]
        return _Back(by_input, apart)

    def plus(self, fewer: "_Back") -> "_Back":
        """The sum with derivatives at some of these lags."""
        every = fewer.apart // self.apart or 1
        self.by[:, self.by.shape[1] - 1 - (fewer.by.shape[1] - 1) * every :: every] += fewer.by
        return self

    def before(self, sequences: Tensor) -> Tensor:
        """What sequences of one condition were at these lags before each output, as ``by``; zero before their start."""
        (_, n_lags, n_outputs, _), apart = self.by.shape, max(self.apart, 1)
        padded = functional.pad(sequences[:, :, 0], (0, 0, apart * (n_lags - 1), 0))
        return padded.unfold(1, n_outputs, apart).movedim(-1, 2)


def _by_first_block(network: Tcn, inputs: Tensor) -> Tensor:
    """Derivatives with respect to the first block's weights, shape (n_members, n_outputs, n_weights)."""
    members, n_times, n_conditions, _ = inputs.shape
    n_weights = sum(weight[0].numel() for weight in network.blocks[0].parameters())
    derivatives = inputs.new_empty((members, n_conditions, n_times, n_weights))
    for number, condition in enumerate(torch.split(inputs, 1, dim=2)):
        products = _products_of_first_block(network, condition)
        for member, own in enumerate(derivatives[:, number]):
            parts = [back[member].permute(1, 2, 0) @ seen[member].transpose(0, 1) for back, seen in products]
            torch.cat([part.flatten(1) for part in parts], dim=1, out=own)
    return derivatives.flatten(1, 2)


def _products_of_first_block(network: Tcn, inputs: Tensor) -> list[tuple[Tensor, Tensor]]:
    """What the first block's derivatives at one condition are sums over lags of: (member, lag, output, ·) each."""
    blocks = cast(list[ResidualBlock], list(network.blocks))
    passed = [_Passed.of(blocks[0], inputs)]
    for block in blocks[1:]:
        passed.append(_Passed.of(block, passed[-1].outputs))
    back = _Back(network.head.weight[:, 0, None, None, :, 0].expand(-1, 1, inputs.shape[1], -1), 0)
    for block, own in zip(reversed(blocks[1:]), reversed(passed[1:]), strict=True):
        by_sum, _, by_first = _backwards(block, own, back)
        back = by_first.through(block.first).plus(by_sum)
    first, own = blocks[0], passed[0]
    by_sum, by_second, by_first = _backwards(first, own, back)
    products = [(by_first, _seen(first.first, inputs)), (by_second, _seen(first.second, own.between))]
    if isinstance(first.shortcut, CausalConv):
        products.append((by_sum, _seen(first.shortcut, inputs)))
    return [(back.by, back.before(seen)) for back, seen in products]


def _backwards(block: ResidualBlock, passed: _Passed, back: _Back) -> tuple[_Back, _Back, _Back]:
    """Derivatives by the sum before a block's last ReLU, and by the outputs of its second and first convolution."""
    by_sum = back.where(passed.outputs > 0)
    by_second = by_sum.where(passed.second)
    return by_sum, by_second, by_second.through(block.second).where(passed.between > 0)


def _by_last_block(network: Tcn, inputs: Tensor) -> tuple[tuple[Product, ...], ...]:
    """Derivatives for the weights of the head, and of the last block unless that is the first."""
    *before, last = cast(list[ResidualBlock], list(network.blocks))
    hidden = inputs
    for block in before:
        hidden = block(hidden)
    passed = _Passed.of(last, hidden)
    ones = torch.ones_like(passed.outputs[..., :1])
    by_head = (_product(ones, torch.cat([passed.outputs, ones], dim=-1)),)
    if not before:
        return (by_head,)
    back = network.head.weight[:, 0, None, None, :, 0] * (passed.outputs > 0) * passed.second
    by_second = (_product(back, _seen(last.second, passed.between)),)
    # An output depends on the first convolution's output at as many steps as the second one has taps.
    seen, passes = _seen(last.first, hidden), passed.between > 0
    by_first = tuple(
        _product(back @ last.second.weight[:, tap, None].mT * _lagged(passes, lag), _lagged(seen, lag))
        for tap, lag in enumerate(last.second.lags)
    )
    return by_head, by_second, by_first


def _scalar(one: Product, two: Product) -> Tensor:
    return (one.back @ two.back.mT) * (one.seen @ two.seen.mT)


def _product(back: Tensor, seen: Tensor) -> Product:
    """Create a product from sequences of shape (n_members, n_times, n_conditions, ·)."""
    return Product(*(factor.transpose(1, 2).flatten(1, 2) for factor in (back, seen)))


def _seen(convolution: CausalConv, inputs: Tensor) -> Tensor:
    """Factors of the weights and the bias of a convolution at each step."""
    return torch.cat([*(_lagged(inputs, lag) for lag in convolution.lags), torch.ones_like(inputs[..., :1])], dim=-1)


def _lagged(sequence: Tensor, steps: int) -> Tensor:
    """The sequence delayed by this many steps; zero before its start."""
    return functional.pad(sequence, (0, 0, 0, 0, steps, 0))[:, : sequence.shape[1]]
