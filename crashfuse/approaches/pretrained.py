"""A network trained once on simulated vehicles: it reads tests with their CAE pulses, and predicts another test.

A transformer neural process (Nguyen and Grover 2022): each pulse is cut into steps of 4 ms, every step attends to all
steps of the known tests and to those of its own pulse. Nothing is trained on a campaign.
"""

import functools
import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt
import torch
from safetensors.torch import load
from scipy.ndimage import gaussian_filter1d
from torch import Tensor, nn
from torch.nn import functional

from crashfuse.approaches import calibration as bands
from crashfuse.approaches.base import FittedState, Prediction, Settings
from crashfuse.approaches.calibration import BandedApproach, Calibration, HeldOutPredictor, LeftOut
from crashfuse.approaches.neighbours import nearness
from crashfuse.approaches.threads import single_thread
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError
from crashfuse.execution.run import UNKEPT, Run
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray, in_full
from crashfuse.vehicle_archive import Prior

N_TIMES = N_SAMPLES // bands.STRIDE
FACTORS = 8  # functions of time along which a test's errors hang together

_DT_S = bands.STRIDE * DT_S
_STEP = 5  # samples of one step of the sequence
_STEPS = N_TIMES // _STEP
_RATE = 15.0  # 1/s: an acceleration of 1 is 15 times the impact speed per second, about a vehicle's mean
_SPEED_MPS, _CRUSH_M, _WEIGHT_SHARE = 15.0, 0.5, 0.1  # what counts as 1
_SLOWEST_MPS = 0.1  # a parked vehicle has no pulse
_WAVELENGTH_M = 1.6  # longest wave of displacement; steps at the same crush find each other by these
_WAVES = 5
_MOTION = 3 * _STEP + 2 * _WAVES  # inputs: acceleration, velocity, displacement of each sample, waves of the middle
_LOG_DEVIATION, _FACTOR = -3.0, 0.5  # where training starts

_WEIGHTS = Path(__file__).with_name("pretrained.safetensors")
_SHA256 = "fbbd5f352006fd82b8f189da49080dbef33ca111a39d4c224ebc290f6d6379d3"
"""Of the weights: a change of them is a change of the code, and cached fits are made anew."""

_N_DRAWS = 200
_SMOOTH = 1.5  # samples of 0.8 ms: a CFC 60 pulse holds no errors that change faster
_UNCHECKED = 1.5  # widening that fewer tests than are checked cannot tell


class Forecast(NamedTuple):
    """What the network predicts for each pulse, shape (n_campaigns, n_pulses, 125), its errors in :func:`unit`."""

    first_mps2: Tensor  # expected after half of the layers; by its motion the others look for the same crush
    mean_mps2: Tensor  # expected
    log_deviation: Tensor  # of the error of each sample alone
    factors: Tensor  # of the error common to samples, times standard normal numbers: shape (…, 125, 8)


def unit(speeds_mps: Tensor) -> Tensor:
    """The acceleration in m/s² that counts as 1 at an impact speed."""
    return _RATE * speeds_mps


Pair = tuple[Tensor, Tensor]
Memory = tuple[Pair, ...]
"""Keys and values of steps at each layer, which steps of other pulses attend to."""


class KnownTests(NamedTuple):
    """What the network makes of tests, whatever is asked: their mean weights, shape (n_campaigns, 1, 2), and memory."""

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
        """Predict every pulse that is not known from those that are, at least one of each campaign.

        Pulses are every tenth sample, shape (n_campaigns, n_pulses, 125); conditions are impact speed in m/s, front and
        rear weight in kg.
        """
        weight = known[..., None].to(conditions.dtype)
        mean_kg = (conditions[..., 1:] * weight).sum(1, keepdim=True) / weight.sum(1, keepdim=True)
        pulse = torch.arange(known.shape[1], device=known.device).repeat_interleave(_STEPS)
        seen = known.repeat_interleave(_STEPS, 1)[:, None] | (pulse[:, None] == pulse)
        return self._forecast(measured_mps2, cae_mps2, conditions, known, mean_kg, seen[:, None])[0]

    def read(self, measured_mps2: Tensor, cae_mps2: Tensor, conditions: Tensor) -> KnownTests:
        """Read tests once, to predict any number of pulses with :meth:`predict`; shapes as in :meth:`forward`."""
        mean_kg = conditions[..., 1:].mean(1, keepdim=True)
        known = cae_mps2.new_ones(cae_mps2.shape[:2], dtype=torch.bool)
        return KnownTests(mean_kg, self._forecast(measured_mps2, cae_mps2, conditions, known, mean_kg)[1])

    def predict(self, tests: KnownTests, cae_mps2: Tensor, conditions: Tensor) -> Forecast:
        """Predict a pulse of each campaign as :meth:`forward` does, from tests that were read."""
        known = cae_mps2.new_zeros(cae_mps2.shape[:2], dtype=torch.bool)
        return self._forecast(cae_mps2, cae_mps2, conditions, known, tests.mean_kg, memory=tests.memory)[0]

    def _forecast(
        self,
        measured_mps2: Tensor,
        cae_mps2: Tensor,
        conditions: Tensor,
        known: Tensor,
        mean_kg: Tensor,
        seen: Tensor | None = None,  # pulses that each step attends to
        memory: Memory = (),  # of other pulses
    ) -> tuple[Forecast, Memory]:
        shape, speeds = cae_mps2.shape, conditions[..., :1].clamp(min=_SLOWEST_MPS)
        weights = torch.log(conditions[..., 1:] / mean_kg) / _WEIGHT_SHARE
        at = torch.cat([speeds / _SPEED_MPS, weights], -1)[:, :, None].expand(*shape[:2], _STEPS, 3)
        measured = self.measured(_steps(measured_mps2, cae_mps2, speeds)) + self.known[0]
        hidden = self.cae(torch.cat([_motion(cae_mps2, speeds), at], -1)) + self.place
        hidden = (hidden + torch.where(known[..., None, None], measured, self.known[1])).flatten(1, 2)
        kept, others = [], iter(memory)
        for layer in self.early:
            hidden, pair = layer(hidden, seen, next(others, None))
            kept.append(pair)
        first_mps2 = cae_mps2 + unit(speeds) * self.first(self.first_norm(hidden)).float().view(shape)
        moves = torch.where(known[..., None], measured_mps2, first_mps2)
        hidden = hidden + self.moved(_steps(moves, cae_mps2, speeds)).flatten(1, 2)
        for layer in self.late:
            hidden, pair = layer(hidden, seen, next(others, None))
            kept.append(pair)
        last = self.last(self.last_norm(hidden)).float().view(*shape, 2 + FACTORS)
        mean_mps2 = first_mps2 + unit(speeds) * last[..., 0]
        return Forecast(first_mps2, mean_mps2, last[..., 1] + _LOG_DEVIATION, _FACTOR * last[..., 2:]), tuple(kept)


class _Layer(nn.Module):
    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.projected, self.joined = nn.Linear(width, 3 * width), nn.Linear(width, width)
        linear = nn.Linear(width, 3 * width), nn.GELU(), nn.Linear(3 * width, width)
        self.perceptron = nn.Sequential(nn.LayerNorm(width), *linear)
        self._heads = heads

    def forward(self, hidden: Tensor, seen: Tensor | None, others: Pair | None) -> tuple[Tensor, Pair]:
        query, *pair = self.projected(self.norm(hidden)).unflatten(-1, (3, self._heads, -1)).permute(2, 0, 3, 1, 4)
        key, value = pair if others is None else (torch.cat(both, -2) for both in zip(others, pair, strict=True))
        attended = functional.scaled_dot_product_attention(query, key, value, attn_mask=seen)
        hidden = hidden + self.joined(attended.transpose(1, 2).flatten(2))
        return hidden + self.perceptron(hidden), (key, value)


def _steps(accel_mps2: Tensor, cae_mps2: Tensor, speeds_mps: Tensor) -> Tensor:
    beyond = ((accel_mps2 - cae_mps2) / unit(speeds_mps)).view(*accel_mps2.shape[:2], _STEPS, _STEP)
    return torch.cat([_motion(accel_mps2, speeds_mps), beyond], -1)


def _motion(accel_mps2: Tensor, speeds_mps: Tensor) -> Tensor:
    """Acceleration, velocity and displacement (Eqs. 11 and 13), and waves of displacement, by steps."""
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


class Pretrained(BandedApproach):
    """A transformer that ``benchmarks/pretraining.py`` trained on simulated vehicles of many kinds.

    It reads each test beside the CAE pulse at its condition. No weight of it depends on the campaign: to fit is to
    check the band on left-out tests.
    """

    name = "pretrained"
    label = "Pre-trained network"
    in_words = "the pre-trained network"
    description = "a network, trained once on simulated vehicles, that reads the tests of this one."
    colour = "#8C564B"
    preference = 35

    def __init__(self, *, seed: int = 0) -> None:
        self.seed = seed

    @classmethod
    def taught_by(cls, prior: Prior | None) -> Prior | None:
        """It learns the weights of its inputs and outputs."""
        return prior

    @classmethod
    def create(cls, settings: Settings) -> Self:
        """Create it with its seed."""
        return cls(seed=settings.seed)

    def fit(self, campaign: Campaign, run: Run = UNKEPT) -> Self:
        """Take up the tests, and check the band on each, predicted from the others."""
        self._require_tests(campaign)
        campaign = self._begin(campaign, run)
        # what is forecast of left-out tests, the same by every seed
        self._of_left_out: dict[object, list[FloatArray]] = run.once((self.name, campaign.fingerprint), dict)
        self.prior_ = self._choose(campaign.prior)
        self._all_tests = self._read()
        if len(campaign.tests) < bands.LEAST_CHECKED:
            self.left_out_ = self.left_out_groups_ = LeftOut.of({})
            self.calibration_ = Calibration(_UNCHECKED, ())
            return self
        near = bands.check_band(campaign, self._without, run.watch)
        self.calibration_, self.left_out_, self.left_out_groups_ = bands.check_band_far(campaign, *near)
        return self

    def _begin(self, campaign: Campaign, run: Run) -> Campaign:
        campaign = self._thinned(campaign)
        self.model_ = CaeModel().fit(campaign.cae, run)
        self._vectors = np.array([test.condition.vector for test in campaign.tests])
        self._measured = np.array([test.pulse.accel_mps2[:: bands.STRIDE] for test in campaign.tests])
        self._cae = np.array([self.model_.pulse(test.condition).accel_mps2[:: bands.STRIDE] for test in campaign.tests])
        return campaign

    def _choose(self, prior: Prior | None) -> Prior | None:
        self.archive_ = ""
        if prior is None or len(self._vectors) < bands.LEAST_CHECKED:
            return prior
        if self._left_out_error(prior) <= self._left_out_error(None):
            return prior
        self.archive_ = "The archive's network is not used: with it left-out tests are predicted worse."
        return None

    def _left_out_error(self, prior: Prior | None) -> float:
        self.prior_ = prior
        means = np.array([self._without(number, [number])(1.0)[0] for number in range(len(self._vectors))])
        off = np.abs(means - self._measured) / self._vectors[:, :1]
        return float(off[:, bands.JUDGED].mean())

    def _without(self, number: int, out: Sequence[int]) -> HeldOutPredictor:
        key = number, tuple(out), self.prior_
        if key not in self._of_left_out:
            others = self._read(np.delete(np.arange(len(self._vectors)), out))
            self._of_left_out[key] = self._forecast(others, self._vectors[number], self._cae[number])
        pulses = _drawn(self._of_left_out[key], self._vectors[number], [self.seed, number])
        return functools.partial(_widened, pulses)

    def _read(self, tests: npt.NDArray[np.intp] | slice = slice(None)) -> KnownTests:
        with single_thread(), torch.inference_mode():
            rows = self._measured[tests], self._cae[tests], self._vectors[tests]
            return _network(self.prior_).read(*map(_batch, rows))

    def _forecast(self, tests: KnownTests, vector: FloatArray, cae: FloatArray) -> list[FloatArray]:
        with single_thread(), torch.inference_mode():
            forecast = _network(self.prior_).predict(tests, _batch(cae[None]), _batch(vector[None]))
            tensors = forecast.mean_mps2, forecast.log_deviation.exp(), forecast.factors
        return [tensor[0, 0].double().numpy() for tensor in tensors]

    def predict(self, condition: Condition) -> Prediction:
        """Predict the pulse at a condition."""
        self._require("calibration_")
        cae = self.model_.pulse(condition).accel_mps2
        near = nearness(condition.speed_mps, self._vectors[:, 0])
        widening = self.calibration_.widening * self.calibration_.further(near)
        forecast = self._forecast(self._all_tests, condition.vector, cae[:: bands.STRIDE])
        pulses = in_full(_widened(_drawn(forecast, condition.vector, [self.seed]), widening), bands.STRIDE)
        notes = (self.archive_, *self._thinning, *self.model_.notes(condition))
        return Prediction(condition, pulses[0], pulses[1:], tuple(filter(None, notes)))

    def learned(self) -> FittedState:
        """The check of the band."""
        self._require("calibration_")
        return FittedState.of({"taught": self.prior_ is not None, "archive": self.archive_}, {}, **self._learned_band())

    def restore(self, campaign: Campaign, learned: FittedState, run: Run = UNKEPT) -> Self:
        """Take up the tests again."""
        self._begin(campaign, run)
        self.archive_ = str(learned.values["archive"])
        self.prior_ = campaign.prior if learned.values["taught"] else None
        self._all_tests = self._read()
        self._restore_band(learned)
        return self

    @property
    def state(self) -> dict[str, object]:
        """Coverage of left-out tests by the band."""
        is_checked = hasattr(self, "calibration_") and self.calibration_.tests
        return {"band_check": self.calibration_.state} if is_checked else {}


def _drawn(forecast: Sequence[FloatArray], vector: FloatArray, seed: Sequence[int]) -> FloatArray:
    mean, deviation, factors = forecast
    rng = np.random.default_rng(seed)
    alone = gaussian_filter1d(rng.standard_normal((_N_DRAWS, mean.size)), _SMOOTH, axis=1)
    alone *= np.sqrt(2 * np.sqrt(np.pi) * _SMOOTH)  # smoothing keeps the deviation
    errors = deviation * alone + rng.standard_normal((_N_DRAWS, factors.shape[1])) @ factors.T
    one = float(unit(torch.tensor(vector[0])))
    return np.asarray(mean + one * np.vstack([np.zeros_like(mean), errors]))


def _batch(rows: FloatArray) -> Tensor:
    return torch.tensor(rows, dtype=torch.float32)[None]


def _widened(pulses: FloatArray, factor: float) -> FloatArray:
    return np.asarray(pulses[0] + factor * (pulses - pulses[0]))


@functools.lru_cache(maxsize=8)
def _network(prior: Prior | None) -> PretrainedNetwork:
    network = shipped_network()
    if prior is not None:
        usual = network.state_dict()
        tuned = {name: torch.from_numpy(np.array(weight, np.float32)) for name, weight in prior.network.items()}
        try:  # in between the weights lie in between, too (Wortsman et al. 2022)
            network.load_state_dict(usual | {name: usual[name].lerp(own, prior.share) for name, own in tuned.items()})
        except (KeyError, RuntimeError) as error:
            raise CrashfuseError("The archive was learned with another network; learn it again.") from error
    return network.eval()


def shipped_network() -> PretrainedNetwork:
    """The network as it was trained on simulated vehicles."""
    content = _WEIGHTS.read_bytes()
    if hashlib.sha256(content).hexdigest() != _SHA256:
        raise CrashfuseError(f"{_WEIGHTS.name} is not the file that belongs to this version; install crashfuse again.")
    network = PretrainedNetwork()
    network.load_state_dict({name: weight.float() for name, weight in load(content).items()})
    return network
