"""The temporal convolutional network (TCN; Figs. 3 and 4, Eq. 4; after Bai et al. 2018).

Sequences are time-major, shape (n_members, n_times, n_pulses, n_channels): a tap of a short causal convolution is then
a matrix product with a view of them, and the independent members of an ensemble share it as a batch, which is a fifth
faster than computing them one by one.
There is no weight normalisation, as it costs 15 % on a CPU.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn import functional

from crashfuse.approaches.time_domain.config import TcnConfig

_MOST_TAPS = 8  # with more, torch's own convolution is as quick on a CPU, and has a GPU's matrix units


class Tcn(nn.Module):
    """Ensemble of networks side by side: residual blocks of two causal convolutions each, and a linear output.

    Parameters
    ----------
    generator : torch.Generator
        Source of the initial weights and the dropout.
    members : int, optional
        Number of networks; default: as configured.
    """

    def __init__(self, config: TcnConfig, generator: torch.Generator, members: int | None = None) -> None:
        super().__init__()
        members = config.members if members is None else members
        widths = [config.n_inputs] + [config.channels] * len(config.dilations)
        self.blocks = nn.ModuleList(
            ResidualBlock(members, widths[i], widths[i + 1], config.kernel, dilation, config.dropout, generator)
            for i, dilation in enumerate(config.dilations)
        )
        self.head = CausalConv(members, config.channels, 1, 1, 1, generator)

    @property
    def device(self) -> torch.device:
        """Device of the weights."""
        return self.head.weight.device

    @classmethod
    def joined(cls, networks: "Sequence[Tcn]", config: TcnConfig) -> "Tcn":
        """Join all members of several networks in one."""
        states, whole = [network.state_dict() for network in networks], cls(config, torch.Generator(), 1)
        for name, weight in whole.named_parameters():
            weight.data = torch.cat([state[name] for state in states])
        return whole.eval()

    @property
    def members(self) -> int:
        """Number of networks."""
        return self.head.weight.shape[0]

    @property
    def size(self) -> int:
        """Number of weights of one member."""
        return sum(weight.numel() for weight in self.parameters()) // self.members

    def forward(self, inputs: Tensor) -> Tensor:
        """Map inputs to outputs of shape (n_members, n_times, n_pulses).

        Inputs are of shape (n_members, n_times, n_pulses, n_inputs), without the first axis if members share them.
        """
        hidden = inputs if inputs.ndim == 4 else inputs.expand(self.members, *inputs.shape)
        for block in self.blocks:
            hidden = block(hidden)
        outputs: Tensor = self.head(hidden)[..., 0]
        return outputs


class ResidualBlock(nn.Module):
    """Fig. 4: convolution, ReLU and spatial dropout, twice, beside a shortcut that matches the channels."""

    def __init__(
        self,
        members: int,
        n_in: int,
        n_out: int,
        kernel: int,
        dilation: int,
        dropout: float,
        generator: torch.Generator,
    ) -> None:
        super().__init__()
        self.first = CausalConv(members, n_in, n_out, kernel, dilation, generator)
        self.second = CausalConv(members, n_out, n_out, kernel, dilation, generator)
        self.shortcut = nn.Identity() if n_in == n_out else CausalConv(members, n_in, n_out, 1, 1, generator)
        self._dropout, self._generator = dropout, generator

    def forward(self, inputs: Tensor) -> Tensor:
        """Map sequences of shape (n_members, n_times, n_pulses, n_in) to as many of n_out channels."""
        hidden = self._drop(torch.relu(self.first(inputs)))
        hidden = self._drop(torch.relu(self.second(hidden)))
        return torch.relu(hidden + self.shortcut(inputs))

    def _drop(self, hidden: Tensor) -> Tensor:
        """Drop whole channels of a pulse, using our own generator so that the caller's random state is unchanged."""
        if not (self.training and self._dropout):
            return hidden
        members, _, n_pulses, channels = hidden.shape
        kept = torch.rand((members, 1, n_pulses, channels), generator=self._generator) >= self._dropout
        return hidden * kept.to(hidden.device) / (1 - self._dropout)


class CausalConv(nn.Module):
    """Eq. 4: a dilated convolution over the present and past steps, zero-padded before the sequence."""

    def __init__(
        self, members: int, n_in: int, n_out: int, kernel: int, dilation: int, generator: torch.Generator
    ) -> None:
        super().__init__()
        bound = 1 / math.sqrt(n_in * kernel)
        self.weight = nn.Parameter((2 * torch.rand(members, kernel, n_in, n_out, generator=generator) - 1) * bound)
        self.bias = nn.Parameter((2 * torch.rand(members, n_out, generator=generator) - 1) * bound)
        self._dilation = dilation

    @property
    def lags(self) -> tuple[int, ...]:
        """Delay of each tap in steps; the last one is the present."""
        return tuple(self._dilation * tap for tap in reversed(range(self.weight.shape[1])))

    def forward(self, inputs: Tensor) -> Tensor:
        """Map sequences of shape (n_members, n_times, n_pulses, n_in) to as many of n_out channels."""
        members, kernel, n_in, n_out = self.weight.shape
        if kernel <= _MOST_TAPS:
            outputs: Tensor = _TapByTap.apply(inputs, self.weight, self.bias, self.lags)  # type: ignore[no-untyped-call]
            return outputs
        n_times, n_pulses = inputs.shape[1:3]
        sequences = inputs.permute(2, 0, 3, 1).reshape(n_pulses, members * n_in, n_times)
        weights = self.weight.permute(0, 3, 2, 1).reshape(members * n_out, n_in, kernel)
        convolved = functional.conv1d(
            functional.pad(sequences, (self.lags[0], 0)), weights, self.bias.flatten(), dilation=self._dilation,
            groups=members,
        )  # fmt: skip
        return convolved.view(n_pulses, members, n_out, n_times).permute(1, 3, 0, 2)


class _TapByTap(torch.autograd.Function):
    """A causal convolution as one product per tap, with views of its input, and its derivatives likewise.

    Without copies of the input for each tap, a step of the training takes a quarter less time.
    """

    @staticmethod
    def forward(  # torch declares no type for what it keeps in between
        ctx: Any,  # noqa: ANN401
        inputs: Tensor,
        weight: Tensor,
        bias: Tensor,
        lags: tuple[int, ...],
    ) -> Tensor:
        members, n_times, n_pulses, _ = inputs.shape
        rows = inputs.flatten(1, 2)
        outputs = torch.baddbmm(bias[:, None], rows, weight[:, -1])
        for tap, blind in _earlier(lags, n_times, n_pulses):
            outputs[:, blind:].baddbmm_(rows[:, : n_times * n_pulses - blind], weight[:, tap])
        ctx.save_for_backward(rows, weight)
        ctx.lags, ctx.shape = lags, inputs.shape
        return outputs.view(members, n_times, n_pulses, -1)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, by_output: Tensor) -> tuple[Tensor | None, Tensor, Tensor, None]:  # noqa: ANN401
        rows, weight = ctx.saved_tensors
        back = by_output.flatten(1, 2)
        by_weight = torch.zeros_like(weight)
        by_weight[:, -1] = rows.mT @ back
        by_input = back @ weight[:, -1].mT if ctx.needs_input_grad[0] else None
        for tap, blind in _earlier(ctx.lags, *ctx.shape[1:3]):
            seen, later = rows[:, : rows.shape[1] - blind], back[:, blind:]
            by_weight[:, tap] = seen.mT @ later
            if by_input is not None:
                by_input[:, : rows.shape[1] - blind].baddbmm_(later, weight[:, tap].mT)
        return by_input if by_input is None else by_input.view(ctx.shape), by_weight, back.sum(dim=1), None


def _earlier(lags: tuple[int, ...], n_times: int, n_pulses: int) -> Iterator[tuple[int, int]]:
    """The taps that see the past within a sequence, and how many of its rows come too early to see any of it."""
    return ((tap, lag * n_pulses) for tap, lag in enumerate(lags[:-1]) if lag < n_times)
