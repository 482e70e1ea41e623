"""The temporal convolutional network (Figs. 3 and 4, Eq. 4; after Bai et al. 2018) and what it is fed with.

Sequences are time-major, shape (n_members, n_times, n_pulses, n_channels): a short causal convolution is then one
matrix product a tap, and the members of an ensemble, which know nothing of each other, share each product in a batch,
which saves a fifth of the time that they take one by one.
There is no weight normalisation: on a CPU it costs 15 %.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal, Self

import torch
from torch import Tensor, nn
from torch.nn import functional

_AFTER_LF = ("tuning", "tuning_steps", "tuning_rate", "penalty", "n_draws")
_MOST_PRODUCTS = 8  # taps: each product keeps a copy of its input for the gradient, gigabytes of them for 20 taps


@dataclass(frozen=True, slots=True)
class TcnConfig:
    """Network, LF training (Eq. 5) and fine-tuning (Eq. 6); the constructors are :meth:`fast` and :meth:`paper`.

    Parameters
    ----------
    channels, kernel, dilations, dropout
        One residual block for each dilation.
    stride : int
        Every how manieth sample of the study grid is a step of the sequence; a cubic spline leads back.
    time_waves, travel_waves, velocity_waves : int
        How many sines and cosines of time, and of the displacement and velocity that CAE runs at this speed typically
        have by then, are inputs beside the paper's four. What tests teach then carries over to where a vehicle at
        another speed is as far crushed, or is about to stop. No travel waves: neither of the two.
    scale_floor : float
        An output of 1 means an acceleration that grows with v0, from this share of its highest value at 0; 1 for one
        acceleration at all speeds.
    batch, epochs, min_steps : int
        Pulses a step; epochs, or as many more as make that many steps in a small library.
    max_runs : int
        Most CAE runs to learn from, taken evenly from the library: more teach the networks no more; 0 for all.
    learning_rate, annealing_epochs : float, int
        Adam's rate and the half period of its cosine; 0 for one warm-up and one cosine over the whole training.
    members : int
        LF networks from different seeds, whose mean predicts.
    tuning : {"posterior", "gradient"}
        Fine-tuning in closed form with a band, or by Adam without.
    n_draws : int
        For the posterior: whole pulses drawn for the band.
    tuning_steps, tuning_rate, penalty : int, float, float
        For Adam: steps and rate, and λ of the penalty λ‖θ_HF‖² that keeps θ_MF near θ_LF.
    """

    channels: int = 48
    kernel: int = 3
    dilations: tuple[int, ...] = (1, 2, 4, 8)
    dropout: float = 0.0
    stride: int = 20
    time_waves: int = 2
    travel_waves: int = 10
    velocity_waves: int = 1
    scale_floor: float = 0.3
    batch: int = 16
    epochs: int = 20
    min_steps: int = 1000
    max_runs: int = 3000
    learning_rate: float = 4e-3
    annealing_epochs: int = 0
    members: int = 4
    tuning: Literal["posterior", "gradient"] = "posterior"
    n_draws: int = 200
    tuning_steps: int = 1000
    tuning_rate: float = 3e-4
    penalty: float = 1e-3

    @classmethod
    def fast(cls) -> Self:
        """Ours: some ten seconds for the LF training of each member on one core."""
        return cls()

    @classmethod
    def paper(cls) -> Self:
        """Table 2 as it stands, 1000 epochs; one residual block, so one dilation, 1. For a GPU."""
        return cls(
            channels=600,
            kernel=20,
            dilations=(1,),
            dropout=0.05,
            stride=1,
            time_waves=0,
            travel_waves=0,
            velocity_waves=0,
            scale_floor=1.0,
            batch=32,
            epochs=1000,
            min_steps=0,
            max_runs=0,
            learning_rate=3e-4,
            annealing_epochs=100,
            members=1,
            tuning="gradient",
        )

    @property
    def lf_settings(self) -> dict[str, object]:
        """What the LF training depends on."""
        return {name: value for name, value in asdict(self).items() if name not in _AFTER_LF}

    @property
    def n_inputs(self) -> int:
        """Time, v0, front and rear weight; typical displacement and velocity, if they have waves; and the waves."""
        motion = 2 + 2 * self.travel_waves + 2 * self.velocity_waves if self.travel_waves else 0
        return 4 + 2 * self.time_waves + motion

    @property
    def receptive_field(self) -> int:
        """How many steps of the sequence an output looks at, itself included."""
        return 1 + 2 * (self.kernel - 1) * sum(self.dilations)


class Tcn(nn.Module):
    """Residual blocks of two causal convolutions each, and a linear output; an ensemble of them, side by side.

    Parameters
    ----------
    config : TcnConfig
    generator : torch.Generator
        Of the initial weights and the dropout.
    members : int, optional
        Number of networks; default: that of the configuration.
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
        """Where the weights are."""
        return self.head.weight.device

    @classmethod
    def joined(cls, networks: "Sequence[Tcn]", config: TcnConfig) -> "Tcn":
        """All members of several networks in one."""
        states = [network.state_dict() for network in networks]
        return cls._of(config, {name: torch.cat([state[name] for state in states]) for name in states[0]})

    def alone(self, member: int, config: TcnConfig) -> "Tcn":
        """One of the networks, without the others."""
        return self._of(config, {name: weight[member : member + 1] for name, weight in self.state_dict().items()})

    @classmethod
    def _of(cls, config: TcnConfig, weights: dict[str, Tensor]) -> "Tcn":
        whole = cls(config, torch.Generator(), 1)
        for name, weight in whole.named_parameters():
            weight.data = weights[name]
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

        Parameters
        ----------
        inputs : Tensor, shape (n_members, n_times, n_pulses, n_inputs), or without the first for all members alike
        """
        hidden = inputs if inputs.ndim == 4 else inputs.expand(self.members, *inputs.shape)
        for block in self.blocks:
            hidden = block(hidden)
        outputs: Tensor = self.head(hidden)[..., 0]
        return outputs


class ResidualBlock(nn.Module):
    """Fig. 4: two times convolution, ReLU and spatial dropout, beside a shortcut that matches the channels."""

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
        """Silence whole channels of a pulse, from our own generator: the caller's random state is not touched."""
        if not (self.training and self._dropout):
            return hidden
        members, _, n_pulses, channels = hidden.shape
        kept = torch.rand((members, 1, n_pulses, channels), generator=self._generator) >= self._dropout
        return hidden * kept.to(hidden.device) / (1 - self._dropout)


class CausalConv(nn.Module):
    """Eq. 4: a dilated convolution over now and the past; what came before the sequence is zero."""

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
        """How many steps ago each tap looks; the last one is the present."""
        return tuple(self._dilation * tap for tap in reversed(range(self.weight.shape[1])))

    def forward(self, inputs: Tensor) -> Tensor:
        """Map sequences of shape (n_members, n_times, n_pulses, n_in) to as many of n_out channels."""
        members, kernel, n_in, n_out = self.weight.shape
        n_times, n_pulses = inputs.shape[1:3]
        past = (kernel - 1) * self._dilation
        if kernel > _MOST_PRODUCTS:
            sequences = inputs.permute(2, 0, 3, 1).reshape(n_pulses, members * n_in, n_times)
            weights = self.weight.permute(0, 3, 2, 1).reshape(members * n_out, n_in, kernel)
            outputs = functional.conv1d(
                functional.pad(sequences, (past, 0)), weights, self.bias.flatten(), dilation=self._dilation,
                groups=members,
            )  # fmt: skip
            return outputs.view(n_pulses, members, n_out, n_times).permute(1, 3, 0, 2)
        padded = functional.pad(inputs, (0, 0, 0, 0, past, 0)) if past else inputs
        outputs = self.bias[:, None].expand(members, n_times * n_pulses, n_out)
        for tap in range(kernel):
            shifted = padded[:, tap * self._dilation : tap * self._dilation + n_times]
            outputs = torch.baddbmm(outputs, shifted.reshape(members, -1, n_in), self.weight[:, tap])
        return outputs.view(members, n_times, n_pulses, n_out)
