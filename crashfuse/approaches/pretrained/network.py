"""The network: it reads tests beside the CAE pulses at their conditions, and predicts a test beside another CAE pulse.

A transformer neural process (Nguyen and Grover 2022): each pulse is cut into steps of 4 ms, every step attends to all
steps of the known tests and to those of its own pulse. Nothing is trained on a campaign.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from crashfuse.approaches.left_out import STRIDE
from crashfuse.signals.pulse import DT_S, N_SAMPLES

N_TIMES = N_SAMPLES // STRIDE
FACTORS = 8
"""Number of functions of time along which a test's errors hang together."""

_DT_S = STRIDE * DT_S
_STEP = 5  # samples of one step of the sequence
_STEPS = N_TIMES // _STEP
_RATE = 15.0  # 1/s: an acceleration of 1 is 15 times the impact speed per second, about a vehicle's mean
_SPEED_MPS, _CRUSH_M, _WEIGHT_SHARE = 15.0, 0.5, 0.1  # what counts as 1
_SLOWEST_MPS = 0.1  # a parked vehicle has no pulse
_WAVELENGTH_M = 1.6  # longest wave of displacement; steps at the same crush find each other by these
_WAVES = 5
_MOTION = 3 * _STEP + 2 * _WAVES  # inputs: acceleration, velocity, displacement of each sample, waves of the middle
_LOG_DEVIATION, _FACTOR = -3.0, 0.5  # where training starts


class Forecast(NamedTuple):
    """What the network says of each pulse, shape (n_campaigns, n_pulses, 125), accelerations in m/s².

    Attributes
    ----------
    first_mps2, mean_mps2 : Tensor
        The expected pulse after half of the layers, by whose motion the others look for the same crush, and at the end.
    log_deviation, factors : Tensor
        Of the error in units of :func:`unit`: the logarithm of the deviation of each sample alone, and what is common
        to samples, shape (…, 125, 8), times independent standard normal numbers.
    """

    first_mps2: Tensor
    mean_mps2: Tensor
    log_deviation: Tensor
    factors: Tensor


def unit(speeds_mps: Tensor) -> Tensor:
    """The acceleration in m/s² that counts as 1 at an impact speed."""
    return _RATE * speeds_mps


Memory = tuple[tuple[Tensor, Tensor], ...]
"""Keys and values of steps at each layer, which steps of other pulses attend to."""


class Told(NamedTuple):
    """What the network makes of the tests that it is told: it is the same whatever is asked.

    Attributes
    ----------
    mean_kg : Tensor, shape (n_campaigns, 1, 2)
        Their mean weights.
    memory : Memory
    """

    mean_kg: Tensor
    memory: Memory


class PretrainedNetwork(nn.Module):
    """Six layers of attention, the second half of which knows how the vehicle would move by the first half's pulse."""

    def __init__(self, width: int = 160, heads: int = 5, layers: int = 3) -> None:
        super().__init__()
        self.cae = nn.Linear(_MOTION + 3, width)
        self.measured = nn.Linear(_MOTION + _STEP, width)
        self.known = nn.Parameter(torch.randn(2, width) * 0.02)
        self.place = nn.Parameter(torch.randn(_STEPS, width) * 0.02)
        self.moved = nn.Linear(_MOTION + _STEP, width)
        self.early = nn.ModuleList(_Layer(width, heads) for _ in range(layers))
        self.late = nn.ModuleList(_Layer(width, heads) for _ in range(layers))
        self.first_norm, self.last_norm = nn.LayerNorm(width), nn.LayerNorm(width)
        self.first, self.last = nn.Linear(width, _STEP), nn.Linear(width, _STEP * (2 + FACTORS))
        for head in (self.first, self.last):  # the CAE pulse is what is predicted before anything is learned
            nn.init.normal_(head.weight, std=0.002)
            nn.init.zeros_(head.bias)

    def forward(self, measured_mps2: Tensor, cae_mps2: Tensor, conditions: Tensor, known: Tensor) -> Forecast:
        """Predict every pulse that is not known from those that are.

        Parameters
        ----------
        measured_mps2, cae_mps2 : Tensor, shape (n_campaigns, n_pulses, 125)
            Tests, and the CAE model at their conditions, every tenth sample of the study grid. What is not known is
            not read.
        conditions : Tensor, shape (n_campaigns, n_pulses, 3)
            Impact speed in m/s, front and rear weight in kg.
        known : bool Tensor, shape (n_campaigns, n_pulses)
            Which tests are learned from, at least one of each campaign.
        """
        told = known[..., None].to(conditions.dtype)
        mean_kg = (conditions[..., 1:] * told).sum(1, keepdim=True) / told.sum(1, keepdim=True)
        pulse = torch.arange(known.shape[1], device=known.device).repeat_interleave(_STEPS)
        seen = known.repeat_interleave(_STEPS, 1)[:, None] | (pulse[:, None] == pulse)
        return self._forecast(measured_mps2, cae_mps2, conditions, known, mean_kg, seen[:, None])[0]

    def read(self, measured_mps2: Tensor, cae_mps2: Tensor, conditions: Tensor) -> Told:
        """Read tests once, to predict any number of pulses with :meth:`beside`; shapes as in :meth:`forward`."""
        mean_kg = conditions[..., 1:].mean(1, keepdim=True)
        known = cae_mps2.new_ones(cae_mps2.shape[:2], dtype=torch.bool)
        return Told(mean_kg, self._forecast(measured_mps2, cae_mps2, conditions, known, mean_kg)[1])

    def beside(self, told: Told, cae_mps2: Tensor, conditions: Tensor) -> Forecast:
        """Predict a pulse of each campaign as :meth:`forward` does, from tests that were read."""
        known = cae_mps2.new_zeros(cae_mps2.shape[:2], dtype=torch.bool)
        return self._forecast(cae_mps2, cae_mps2, conditions, known, told.mean_kg, told=told.memory)[0]

    def _forecast(
        self,
        measured_mps2: Tensor,
        cae_mps2: Tensor,
        conditions: Tensor,
        known: Tensor,
        mean_kg: Tensor,
        seen: Tensor | None = None,
        told: Memory = (),
    ) -> tuple[Forecast, Memory]:
        """Predict pulses from the known ones among them, ``seen`` by each step, and from those ``told`` before."""
        shape, speeds = cae_mps2.shape, conditions[..., :1].clamp(min=_SLOWEST_MPS)
        weights = torch.log(conditions[..., 1:] / mean_kg) / _WEIGHT_SHARE
        at = torch.cat([speeds / _SPEED_MPS, weights], -1)[:, :, None].expand(*shape[:2], _STEPS, 3)
        own = self.measured(_steps(measured_mps2, cae_mps2, speeds)) + self.known[0]
        hidden = self.cae(torch.cat([_motion(cae_mps2, speeds), at], -1)) + self.place
        hidden = (hidden + torch.where(known[..., None, None], own, self.known[1])).flatten(1, 2)
        memory, before = [], iter(told)
        for layer in self.early:
            hidden, kept = layer(hidden, seen, next(before, None))
            memory.append(kept)
        first = self.first(self.first_norm(hidden)).float().view(shape)
        first_mps2 = cae_mps2 + unit(speeds) * first
        moves = torch.where(known[..., None], measured_mps2, first_mps2)
        hidden = hidden + self.moved(_steps(moves, cae_mps2, speeds)).flatten(1, 2)
        for layer in self.late:
            hidden, kept = layer(hidden, seen, next(before, None))
            memory.append(kept)
        last = self.last(self.last_norm(hidden)).float().view(*shape, 2 + FACTORS)
        mean_mps2 = first_mps2 + unit(speeds) * last[..., 0]
        return Forecast(first_mps2, mean_mps2, last[..., 1] + _LOG_DEVIATION, _FACTOR * last[..., 2:]), tuple(memory)


class _Layer(nn.Module):
    """Attention to what may be seen, then a perceptron for each step, both beside a shortcut."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm, self.projected, self.joined = (
            nn.LayerNorm(width),
            nn.Linear(width, 3 * width),
            nn.Linear(width, width),
        )
        self.perceptron = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 3 * width), nn.GELU(), nn.Linear(3 * width, width)
        )
        self._heads = heads

    def forward(
        self, hidden: Tensor, seen: Tensor | None, told: tuple[Tensor, Tensor] | None
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        projected = self.projected(self.norm(hidden)).unflatten(-1, (3, self._heads, -1)).permute(2, 0, 3, 1, 4)
        query, *own = projected
        key, value = own if told is None else (torch.cat(both, -2) for both in zip(told, own, strict=True))
        attended = functional.scaled_dot_product_attention(query, key, value, attn_mask=seen)
        hidden = hidden + self.joined(attended.transpose(1, 2).flatten(2))
        return hidden + self.perceptron(hidden), (key, value)


def _steps(accel_mps2: Tensor, cae_mps2: Tensor, speeds_mps: Tensor) -> Tensor:
    """Motion under a pulse, and its difference from the CAE pulse, by steps."""
    beyond = ((accel_mps2 - cae_mps2) / unit(speeds_mps)).view(*accel_mps2.shape[:2], _STEPS, _STEP)
    return torch.cat([_motion(accel_mps2, speeds_mps), beyond], -1)


def _motion(accel_mps2: Tensor, speeds_mps: Tensor) -> Tensor:
    """Acceleration, velocity and displacement of each sample (Eqs. 11 and 13), and waves of displacement, by steps."""
    velocity = speeds_mps + _integral(accel_mps2)
    displacement = _integral(velocity)
    scaled = torch.stack([accel_mps2 / unit(speeds_mps), velocity / speeds_mps, displacement / _CRUSH_M], -2)
    middle = displacement[..., _STEP // 2 :: _STEP, None]
    phase = middle * (2 * math.pi / _WAVELENGTH_M) * 2.0 ** torch.arange(_WAVES, device=middle.device)
    by_step = scaled.view(*scaled.shape[:-1], _STEPS, _STEP).transpose(-3, -2).flatten(-2)
    return torch.cat([by_step, phase.sin(), phase.cos()], -1)


def _integral(values: Tensor) -> Tensor:
    means = 0.5 * _DT_S * (values[..., 1:] + values[..., :-1])
    return functional.pad(means.cumsum(-1), (1, 0))
