"""The temporal convolutional network (TCN; Figs. 3 and 4, Eq. 4; after Bai et al. 2018).

Sequences are time-major, shape (n_members, n_times, n_pulses, n_channels): a tap of a short causal convolution is then
a matrix product with a view of them. There is no weight normalisation, as it costs 15 % on a CPU.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Generator, Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn import functional

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, in_full, kinematics

_MOST_TAPS = 8  # with more, torch's own convolution is as quick on a CPU, and has a GPU's matrix units

_POWERS = np.arange(1, 5)[:, None]  # of the speed in the expansion of the typical motion, which vanishes at speed 0
_CHUNK = 100  # runs integrated at once
_MOST_RUNS = 2000  # more would not change the typical motion


class Tcn(nn.Module):
    """Ensemble of networks: residual blocks of two causal convolutions each, and a linear output."""

    def __init__(self, config: TcnConfig, generator: Generator, members: int | None = None) -> None:
        super().__init__()
        members = config.members if members is None else members
        widths = [config.n_inputs] + [config.channels] * (len(config.dilations) - 1)
        sizes = zip(widths, config.dilations, strict=True)
        self.blocks = nn.ModuleList(ResidualBlock(config, members, n_in, apart, generator) for n_in, apart in sizes)
        self.head = CausalConv(members, config.channels, 1, 1, 1, generator)

    @property
    def device(self) -> torch.device:
        """Device of the weights."""
        return self.head.weight.device

    @classmethod
    def joined(cls, networks: "Sequence[Tcn]", config: TcnConfig) -> "Tcn":
        """The members of several networks in one."""
        states, whole = [network.state_dict() for network in networks], cls(config, Generator(), 1)
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
        """Map inputs, without the first axis if members share them, to outputs (n_members, n_times, n_pulses)."""
        hidden = inputs if inputs.ndim == 4 else inputs.expand(self.members, *inputs.shape)
        for block in self.blocks:
            hidden = block(hidden)
        outputs: Tensor = self.head(hidden)[..., 0]
        return outputs


class ResidualBlock(nn.Module):
    """Fig. 4: convolution, ReLU and spatial dropout, twice, beside a shortcut that matches the channels."""

    def __init__(self, config: TcnConfig, members: int, n_in: int, dilation: int, generator: Generator) -> None:
        super().__init__()
        n_out, kernel = config.channels, config.kernel
        self.first = CausalConv(members, n_in, n_out, kernel, dilation, generator)
        self.second = CausalConv(members, n_out, n_out, kernel, dilation, generator)
        self.shortcut = nn.Identity() if n_in == n_out else CausalConv(members, n_in, n_out, 1, 1, generator)
        self._dropout, self._generator = config.dropout, generator

    def forward(self, inputs: Tensor) -> Tensor:
        """Map sequences of shape (n_members, n_times, n_pulses, n_in) to as many of n_out channels."""
        hidden = self._drop(torch.relu_(self.first(inputs)))
        hidden = self._drop(torch.relu_(self.second(hidden)))
        return torch.relu_(hidden + self.shortcut(inputs))

    def _drop(self, hidden: Tensor) -> Tensor:
        if not (self.training and self._dropout):
            return hidden
        members, _, n_pulses, channels = hidden.shape
        kept = torch.rand((members, 1, n_pulses, channels), generator=self._generator) >= self._dropout
        return hidden * kept.to(hidden.device) / (1 - self._dropout)


class CausalConv(nn.Module):
    """Eq. 4: a dilated convolution over the present and past steps, zero-padded before the sequence."""

    def __init__(self, members: int, n_in: int, n_out: int, kernel: int, dilation: int, generator: Generator) -> None:
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
        padded, biases = functional.pad(sequences, (self.lags[0], 0)), self.bias.flatten()
        convolved = functional.conv1d(padded, weights, biases, dilation=self._dilation, groups=members)
        return convolved.view(n_pulses, members, n_out, n_times).permute(1, 3, 0, 2)


class _TapByTap(torch.autograd.Function):
    """One product per tap with views, not copies: a quarter quicker."""

    @staticmethod
    def forward(ctx: Any, inputs: Tensor, weight: Tensor, bias: Tensor, lags: tuple[int, ...]) -> Tensor:  # noqa: ANN401
        members, n_times, n_pulses, _ = inputs.shape
        rows, outputs = inputs.flatten(1, 2), inputs.new_empty((members, n_times, n_pulses, weight.shape[-1]))
        flat = torch.baddbmm(bias[:, None], rows, weight[:, -1], out=outputs.view(members, n_times * n_pulses, -1))
        for tap, blind in _earlier(lags, n_times, n_pulses):
            flat[:, blind:].baddbmm_(rows[:, : n_times * n_pulses - blind], weight[:, tap])
        ctx.save_for_backward(rows, weight)
        ctx.lags, ctx.shape = lags, inputs.shape
        return outputs

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
    return ((tap, lag * n_pulses) for tap, lag in enumerate(lags[:-1]) if lag < n_times)


@dataclass(frozen=True, eq=False, slots=True)
class TypicalMotion:
    """Typical motion of the vehicles of CAE runs: polynomials of the impact speed, by least squares."""

    top_mps: float  # the library's highest speed
    displacement_m: FloatArray  # coefficients of the powers 1 to 4 of v0 / top_mps, shape (4, n_times)
    velocity_mps: FloatArray
    crush_m: float  # the library's highest maximum crush

    @classmethod
    def of(cls, speed_mps: FloatArray, accel_mps2: FloatArray, stride: int) -> "TypicalMotion":
        """Fit to runs: speeds of shape (n,), pulses of shape (n, 1250)."""
        top = float(speed_mps.max())
        rows = np.linspace(0, len(speed_mps) - 1, min(len(speed_mps), _MOST_RUNS)).astype(int)
        powers = (speed_mps[rows] / top) ** _POWERS
        displacements, velocities, crush = [], [], 0.0
        for chunk in np.array_split(rows, -(-rows.size // _CHUNK)):
            motion = kinematics(accel_mps2[chunk].astype(np.float64), speed_mps[chunk], DT_S)
            displacements.append(motion.displacement_m[:, ::stride])
            velocities.append(motion.velocity_mps[:, ::stride])
            crush = max(crush, float(motion.displacement_m.max()))
        curves = map(np.concatenate, (displacements, velocities))
        displacement, velocity = (np.linalg.lstsq(powers.T, rows, rcond=None)[0] for rows in curves)
        return cls(top, displacement, velocity, crush)

    def at(self, speed_mps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Share of the highest crush, and of the impact speed, over time: shape (n_times, n) each."""
        powers = (speed_mps / self.top_mps) ** _POWERS
        velocity_share = self.velocity_mps.T @ powers / np.maximum(speed_mps, 1e-2 * self.top_mps)
        return self.displacement_m.T @ powers / self.crush_m, velocity_share


@dataclass(frozen=True, eq=False, slots=True)
class Scaling:
    """Scaling of conditions (v0, weights) and accelerations to numbers near 1, learned from the CAE runs."""

    config: TcnConfig
    centre: tuple[float, ...]
    spread: tuple[float, ...]
    lowest: tuple[float, ...]  # conditions beyond the library's limits are clipped to them
    highest: tuple[float, ...]
    accel_mps2: float  # root mean square, each acceleration divided by the factor for its speed
    motion: TypicalMotion

    @classmethod
    def of(cls, vectors: FloatArray, accel_mps2: FloatArray, config: TcnConfig) -> "Scaling":
        """Learn the scaling from conditions, shape (n, 3), and their pulses, shape (n, 1250)."""
        spread = np.maximum(vectors.std(axis=0), 1e-6 * np.abs(vectors).max(axis=0))
        centre, lowest, highest = vectors.mean(axis=0), vectors.min(axis=0), vectors.max(axis=0)
        motion = TypicalMotion.of(vectors[:, 0], accel_mps2, config.stride)
        ends = tuple(lowest.tolist()), tuple(highest.tolist())
        unit = cls(config, tuple(centre.tolist()), tuple(spread.tolist()), *ends, accel_mps2=1.0, motion=motion)
        sequences = accel_mps2[:, :: config.stride] / unit.outputs(vectors)[:, None]
        return replace(unit, accel_mps2=float(np.sqrt(np.mean(sequences**2))))

    def outputs(self, vectors: FloatArray) -> FloatArray:
        """Acceleration in m/s² that an output of 1 represents at each condition, shape (n,)."""
        floor = self.config.scale_floor
        scale: FloatArray = self.accel_mps2 * (floor + (1 - floor) * vectors[:, 0] / self.highest[0])
        return scale

    def inputs(self, vectors: FloatArray) -> Tensor:
        """Input sequences for conditions of shape (n, 3): shape (n_times, n, n_inputs), float32."""
        config, vectors = self.config, np.clip(vectors, self.lowest, self.highest)
        time = GRID_S[:: config.stride, None] / GRID_S[-1]
        columns = [2 * time - 1, *((vectors - self.centre) / self.spread).T[:, None], *_waves(time, config.time_waves)]
        if config.travel_waves:
            travel, velocity = self.motion.at(vectors[:, 0])
            columns += [2 * travel - 1, *_waves(travel, config.travel_waves)]
            columns += [velocity, *_waves(velocity, config.velocity_waves)]
        shape = (len(time), len(vectors))
        return torch.from_numpy(np.stack([np.broadcast_to(c, shape) for c in columns], axis=-1).astype(np.float32))

    def pulses(self, outputs: FloatArray, vectors: FloatArray) -> FloatArray:
        """Pulses on the study grid, shape (n, 1250), from outputs of shape (n, n_times) at these conditions."""
        sequences: FloatArray = outputs * self.outputs(vectors)[:, None]
        return in_full(sequences, self.config.stride)

    def targets(self, vectors: FloatArray, accel_mps2: FloatArray) -> Tensor:
        """Target outputs of the network for pulses of shape (n, 1250): shape (n_times, n), float32."""
        scaled = accel_mps2[:, :: self.config.stride] / self.outputs(vectors)[:, None]
        return torch.from_numpy(np.ascontiguousarray(scaled.T, dtype=np.float32))


def _waves(x: FloatArray, n: int) -> list[FloatArray]:
    return [wave(np.pi * k * x) for k in range(1, n + 1) for wave in (np.sin, np.cos)]
