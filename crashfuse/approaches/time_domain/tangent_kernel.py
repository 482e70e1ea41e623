"""Derivatives of network outputs with respect to the fine-tuned weights, stored compactly.

Only the first and last block and the head are fine-tuned: the blocks between contribute 3 % of the tangent kernel at
half its cost. For the last block the factors of outer products are stored: gradients at the outputs of convolutions,
and their inputs. An output depends on all of the first block's steps: there the derivatives are, 3 MB per pulse.
"""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self, cast

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn import functional

from crashfuse.approaches.threads import quick_threads, side_by_side
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import CausalConv, ResidualBlock, Tcn
from crashfuse.approaches.time_domain.training import weights_of
from crashfuse.execution.cache import Cache, Code, Entry
from crashfuse.signals.pulse import FloatArray

_KIND = "tangent kernel"  # of cache entry: all pairs that are known for these networks
_MOST = 64  # conditions whose pairs are kept, 33 MB

Vector = tuple[float, ...]
Pair = tuple[Vector, Vector]


class Product(NamedTuple):
    """Derivative with respect to a weight matrix, back ⊗ seen per output, both of shape (n_members, n_outputs, ·)."""

    back: Tensor
    seen: Tensor


@dataclass(frozen=True, eq=False, slots=True)
class Tangent:
    """Derivatives of each network's outputs: at all times of one condition, then of the next."""

    first: Tensor  # by the weights of the first block, shape (n_members, n_outputs, n_weights)
    last: tuple[tuple[Product, ...], ...]  # by head and convolutions of the last block, as sums of products

    @classmethod
    def of(cls, network: Tcn, inputs: Tensor) -> Self:
        """Differentiate all members at inputs of shape (n_times, n_conditions, n_inputs)."""
        inputs = inputs.to(network.device).expand(network.members, *inputs.shape)
        with torch.no_grad():
            return cls(_by_first_block(network, inputs), _by_last_block(network, inputs))

    def part(self, outputs: slice = slice(None), members: slice = slice(None)) -> "Tangent":
        """Derivatives of a part of the outputs, or members."""
        last = (tuple(Product(*(t[members, outputs] for t in product)) for product in sums) for sums in self.last)
        return Tangent(self.first[members, outputs], tuple(last))

    def kernel_with(self, other: "Tangent") -> Tensor:
        """Scalar products, (n_members, n_outputs, n_outputs of the other): to the bit the same either way round."""
        kernel = self.first @ other.first.mT
        for ours, theirs in zip(self.last, other.last, strict=True):
            for number, both in enumerate(zip(ours, theirs, strict=True)):
                kernel += _scalar(*both)
                for before in range(number):
                    kernel += _scalar(ours[number], theirs[before]) + _scalar(ours[before], theirs[number])
        return kernel


class _Passed(NamedTuple):
    """What a residual block makes of sequences, shape (n_members, n_times, n_conditions, ·)."""

    inputs: Tensor
    between: Tensor  # before its second convolution
    second: Tensor  # bool: where the ReLU of the second convolution lets anything pass
    outputs: Tensor

    @classmethod
    def of(cls, block: ResidualBlock, inputs: Tensor) -> Self:
        between = torch.relu(block.first(inputs))
        second = torch.relu(block.second(between))
        return cls(inputs, between, second > 0, torch.relu(second + block.shortcut(inputs)))


class _Back(NamedTuple):
    """Derivatives of every output by a sequence: not zero but at even steps up to the output's."""

    by: Tensor  # by lag before each output, the longest first, shape (n_members, n_lags, n_outputs, n_channels)
    apart: int  # steps between two lags

    def where(self, passed: Tensor) -> "_Back":
        return self._replace(by=self.by * self.before(passed))

    def through(self, convolution: CausalConv) -> "_Back":
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
        every = fewer.apart // self.apart or 1
        self.by[:, self.by.shape[1] - 1 - (fewer.by.shape[1] - 1) * every :: every] += fewer.by
        return self

    def before(self, sequences: Tensor) -> Tensor:
        """What sequences of one condition were at these lags before each output, as ``by``; zero before their start."""
        (_, n_lags, n_outputs, _), apart = self.by.shape, max(self.apart, 1)
        padded = functional.pad(sequences[:, :, 0], (0, 0, apart * (n_lags - 1), 0))
        return padded.unfold(1, n_outputs, apart).movedim(-1, 2)


def _by_first_block(network: Tcn, inputs: Tensor) -> Tensor:
    members, n_times, n_conditions, _ = inputs.shape
    n_weights = sum(weight[0].numel() for weight in network.blocks[0].parameters())
    derivatives = inputs.new_empty((members, n_conditions, n_times, n_weights))
    for number, condition in enumerate(torch.split(inputs, 1, dim=2)):
        products = _products_of_first_block(network, condition)
        for member, rows in enumerate(derivatives[:, number]):
            parts = [back[member].permute(1, 2, 0) @ seen[member].transpose(0, 1) for back, seen in products]
            torch.cat([part.flatten(1) for part in parts], dim=1, out=rows)
    return derivatives.flatten(1, 2)


def _products_of_first_block(network: Tcn, inputs: Tensor) -> list[tuple[Tensor, Tensor]]:
    """What the derivatives at one condition are sums over lags of: (member, lag, output, ·) each."""
    blocks = cast(list[ResidualBlock], list(network.blocks))
    passed = [_Passed.of(blocks[0], inputs)]
    for block in blocks[1:]:
        passed.append(_Passed.of(block, passed[-1].outputs))
    back = _Back(network.head.weight[:, 0, None, None, :, 0].expand(-1, 1, inputs.shape[1], -1), 0)
    for block, sequences in zip(reversed(blocks[1:]), reversed(passed[1:]), strict=True):
        by_sum, _, by_first = _backwards(block, sequences, back)
        back = by_first.through(block.first).plus(by_sum)
    first, sequences = blocks[0], passed[0]
    by_sum, by_second, by_first = _backwards(first, sequences, back)
    products = [(by_first, _seen(first.first, inputs)), (by_second, _seen(first.second, sequences.between))]
    if isinstance(first.shortcut, CausalConv):
        products.append((by_sum, _seen(first.shortcut, inputs)))
    return [(back.by, back.before(seen)) for back, seen in products]


def _backwards(block: ResidualBlock, passed: _Passed, back: _Back) -> tuple[_Back, _Back, _Back]:
    by_sum = back.where(passed.outputs > 0)
    by_second = by_sum.where(passed.second)
    return by_sum, by_second, by_second.through(block.second).where(passed.between > 0)


def _by_last_block(network: Tcn, inputs: Tensor) -> tuple[tuple[Product, ...], ...]:
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
    return Product(*(factor.transpose(1, 2).flatten(1, 2) for factor in (back, seen)))


def _seen(convolution: CausalConv, inputs: Tensor) -> Tensor:
    return torch.cat([*(_lagged(inputs, lag) for lag in convolution.lags), torch.ones_like(inputs[..., :1])], dim=-1)


def _lagged(sequence: Tensor, steps: int) -> Tensor:
    return functional.pad(sequence, (0, 0, 0, 0, steps, 0))[:, : sequence.shape[1]]


class KernelBlocks:
    """J(x) J(x')ᵀ of the mean of an ensemble's members, all weights together, times the number of members.

    A block does not depend on what was measured. ``library`` is the fingerprint of the CAE runs.
    """

    def __init__(
        self, network: Tcn, config: TcnConfig, inputs: Callable[[FloatArray], Tensor], library: str, cache: Cache
    ) -> None:
        self._network, self._inputs, self._cache = network, inputs, cache
        weights = hashlib.sha256(b"".join(weight.tobytes() for weight in weights_of(network).values())).hexdigest()
        settings = {"config": config.lf_settings, "code": Code(__name__)}
        self._key = {"library": library, "weights": weights, **settings}
        self._blocks: dict[Pair, npt.NDArray[np.float32]] = {}
        # for predictions at any number of conditions
        self._at_tests: tuple[list[Vector], Tangent] | None = None

    def among(self, vectors: FloatArray) -> FloatArray:
        """Kernel between all of these conditions, shape (n, n_times, n, n_times)."""
        ours = _tuples(vectors)
        pairs = {_pair(one, two) for one in ours for two in ours}
        if missing := self._missing(pairs):
            self._blocks |= self._computed(missing)
            self._keep(ours)
        return self._joined(ours, ours)

    def between(self, vectors: FloatArray, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Kernel between conditions and another, shape (n, n_times, n_times), and of the latter alone."""
        ours, (new,) = _tuples(vectors), _tuples(vector[None])
        pairs = {_pair(one, new) for one in (*ours, new)}
        if not self._missing(pairs):
            return self._joined(ours, [new])[:, :, 0], self._joined([new], [new])[0, :, 0]
        conditions = sorted(set(ours))
        if self._at_tests is None or self._at_tests[0] != conditions:
            self._at_tests = conditions, self._tangent(conditions)
        tests, here = self._at_tests[1], self._tangent([new])

        def of_member(member: slice) -> npt.NDArray[np.float32]:
            few, many = here.part(members=member), tests.part(members=member)  # in the quicker order of a product
            return torch.cat([few.kernel_with(many), few.kernel_with(few)], dim=2)[0].T.cpu().numpy()

        n_times = here.first.shape[1]
        kernel = self._mean(of_member).astype(np.float64).reshape(-1, n_times, n_times)
        return kernel[[conditions.index(vector) for vector in ours]], kernel[-1]

    def _computed(self, pairs: set[Pair]) -> dict[Pair, npt.NDArray[np.float32]]:
        conditions = sorted({vector for pair in pairs for vector in pair})
        partners = [[n for n, two in enumerate(conditions) if (one, two) in pairs] for one in conditions]
        tangent = self._tangent(conditions)
        n_times = tangent.first.shape[1] // len(conditions)

        def of_member(member: slice) -> list[npt.NDArray[np.float32]]:
            at, blocks = tangent.part(members=member), []
            for number, others in enumerate(partners):
                if others:
                    first, last = others[0], others[-1] + 1
                    here = at.part(slice(number * n_times, (number + 1) * n_times))
                    beyond = at.part(slice(first * n_times, last * n_times))
                    rows = here.kernel_with(beyond)[0].cpu().numpy().reshape(n_times, -1, n_times)
                    blocks += [rows[:, other - first] for other in others]
            return blocks

        order = [(conditions[one], conditions[two]) for one, others in enumerate(partners) for two in others]
        return dict(zip(order, self._mean(of_member), strict=True))

    def _tangent(self, conditions: Sequence[Vector]) -> Tangent:
        with quick_threads(self._network.size):
            return Tangent.of(self._network, self._inputs(np.array(conditions)))

    def _mean(self, work: Callable[[slice], npt.ArrayLike]) -> npt.NDArray[np.float32]:
        members = [slice(number, number + 1) for number in range(self._network.members)]
        with quick_threads(self._network.size):
            by_member = side_by_side(work, members)
        return np.asarray(np.array(by_member).mean(axis=0, dtype=np.float64), dtype=np.float32)

    def _joined(self, ours: Sequence[Vector], theirs: Sequence[Vector]) -> FloatArray:
        blocks = np.array([[self._block(one, two) for two in theirs] for one in ours], dtype=np.float64)
        return np.ascontiguousarray(blocks.transpose(0, 2, 1, 3))

    def _block(self, one: Vector, two: Vector) -> npt.NDArray[np.float32]:
        return self._blocks[one, two] if one <= two else self._blocks[two, one].T

    def _missing(self, pairs: set[Pair]) -> set[Pair]:
        if not self._blocks:
            self._blocks = self._cache.find(_KIND, self._key, _unpacked) or {}
        return pairs - self._blocks.keys()

    def _keep(self, latest: Sequence[Vector]) -> None:
        conditions = sorted({vector for pair in self._blocks for vector in pair})
        if len(conditions) > _MOST:
            conditions = sorted(set(latest))
        if len(conditions) <= _MOST:
            chosen = set(conditions)
            blocks = {pair: block for pair, block in self._blocks.items() if chosen >= set(pair)}
            entry = {"pairs": np.array(list(blocks)), "blocks": np.array(list(blocks.values()))}
            self._cache.put(_KIND, self._key, entry)


def _tuples(vectors: FloatArray) -> list[Vector]:
    return [tuple(vector) for vector in vectors.tolist()]


def _pair(one: Vector, two: Vector) -> Pair:
    return (one, two) if one <= two else (two, one)


def _unpacked(entry: Entry) -> dict[Pair, npt.NDArray[np.float32]]:
    pairs = [(tuple(one), tuple(two)) for one, two in entry["pairs"].tolist()]
    return dict(zip(pairs, entry["blocks"], strict=True))
