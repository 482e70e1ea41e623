"""The pre-trained network as an approach: what it expects of a test beside those that it is shown."""

import hashlib
from collections.abc import Sequence
from functools import cache as kept
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt
import torch
from safetensors.torch import load
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from crashfuse.approaches.band_check import LEAST_CHECKED, Unseen, checked, checked_far
from crashfuse.approaches.base import MOST_TESTS, Approach, FittedState, Prediction
from crashfuse.approaches.calibration import Calibration
from crashfuse.approaches.left_out import STRIDE, LeftOut
from crashfuse.approaches.nearness import nearness
from crashfuse.approaches.pretrained.network import PretrainedNetwork, Told, unit
from crashfuse.approaches.settings import Settings
from crashfuse.approaches.threads import single_thread
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError, UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.thinning import in_full

_WEIGHTS = Path(__file__).with_name("weights.safetensors")
_SHA256 = "150f17b2b59769a06b7e62e26fab0d9dd96fc11e2c282f709bbb085beed8856f"
"""What the weights have to be: a change of them is a change of the code, and cached fits are made anew."""

_N_DRAWS = 200
_SMOOTH = 1.5  # samples of 0.8 ms: a CFC 60 pulse holds no errors that change faster
_UNCHECKED = 1.5  # widening that fewer tests than are checked cannot tell


class Pretrained(Approach):
    """A transformer that ``benchmarks/pretraining.py`` trained on simulated vehicles of many kinds.

    It reads each test beside the CAE pulse at its condition, and says what a test beside another CAE pulse would show.
    No weight of it depends on the campaign: to fit is to check the band on left-out tests.

    Parameters
    ----------
    cache : Cache, optional
        Storage for the CAE emulator.

    Attributes
    ----------
    calibration_ : Calibration
        Calibration of the band on tests left out one by one.
    left_out_, left_out_groups_ : LeftOut
        Predictions of these tests, and of each test from those at other speeds.
    """

    name = "pretrained"
    label = "Pre-trained network"
    in_words = "the pre-trained network"
    description = "a network that was trained once on simulated vehicles of many kinds and reads the tests of this one."
    colour = "#8C564B"
    preference = 35

    def __init__(self, *, seed: int = 0, cache: Cache | None = None) -> None:
        self.seed = seed
        self.cache = cache

    @classmethod
    def create(cls, settings: Settings) -> Self:
        """Create it with seed and cache."""
        return cls(seed=settings.seed, cache=settings.cache)

    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Take up the tests, and check the band on each, predicted from the others."""
        if not campaign.tests:
            raise UsageError("The pre-trained network learns from tests; this campaign has none.")
        campaign = self._begin(campaign, watch)
        if len(campaign.tests) < LEAST_CHECKED:
            self.left_out_ = self.left_out_groups_ = LeftOut.of({})
            self.calibration_ = Calibration(_UNCHECKED, ())
            return self
        near_and_left_out = checked(campaign, self._unseen, watch)
        self.calibration_, self.left_out_, self.left_out_groups_ = checked_far(campaign, *near_and_left_out)
        return self

    def _begin(self, campaign: Campaign, watch: Watch = SILENT) -> Campaign:
        campaign = self._thinned(campaign)
        self.model_ = CaeModel(cache=self.cache).fit(campaign.cae, watch)
        self._vectors = np.array([test.condition.vector for test in campaign.tests])
        self._measured = np.array([test.pulse.accel_mps2[::STRIDE] for test in campaign.tests])
        self._cae = np.array([self.model_.pulse(test.condition).accel_mps2[::STRIDE] for test in campaign.tests])
        self._all_told = self._told()
        return campaign

    def _unseen(self, number: int, out: Sequence[int]) -> Unseen:
        """A test's pulses from all but these, as a function of the band's widening."""
        told = self._told(np.delete(np.arange(len(self._vectors)), out))
        pulses = self._pulses(told, self._vectors[number], self._cae[number], [self.seed, number])
        return partial(_widened, pulses)

    def _told(self, tests: npt.NDArray[np.intp] | slice = slice(None)) -> Told:
        """What the network makes of some tests."""
        with single_thread(), torch.inference_mode():
            return _network().read(*map(_batch, (self._measured[tests], self._cae[tests], self._vectors[tests])))

    def _pulses(self, told: Told, vector: FloatArray, cae: FloatArray, seed: Sequence[int]) -> FloatArray:
        """Expected pulse and draws on every tenth sample, at a condition with this CAE pulse."""
        with single_thread(), torch.inference_mode():
            forecast = _network().beside(told, _batch(cae[None]), _batch(vector[None]))
            said = forecast.mean_mps2, forecast.log_deviation.exp(), forecast.factors
        mean, deviation, factors = (each[0, 0].double().numpy() for each in said)
        rng = np.random.default_rng(seed)
        alone = gaussian_filter1d(rng.standard_normal((_N_DRAWS, mean.size)), _SMOOTH, axis=1)
        alone *= np.sqrt(2 * np.sqrt(np.pi) * _SMOOTH)  # smoothing keeps the deviation
        errors = deviation * alone + rng.standard_normal((_N_DRAWS, factors.shape[1])) @ factors.T
        one = float(unit(torch.tensor(vector[0])))
        return np.asarray(mean + one * np.vstack([np.zeros_like(mean), errors]))

    def predict(self, condition: Condition) -> Prediction:
        """Predict the pulse at a condition."""
        self._require("calibration_")
        cae = self.model_.pulse(condition).accel_mps2
        near = nearness(condition.speed_mps, self._vectors[:, 0])
        widening = self.calibration_.widening * self.calibration_.further(near)
        pulses = self._pulses(self._all_told, condition.vector, cae[::STRIDE], [self.seed])
        pulses = in_full(_widened(pulses, widening), STRIDE)
        return Prediction(condition, pulses[0], pulses[1:], (*self._thinning, *self.model_.notes(condition)))

    def left_out(self, campaign: Campaign) -> dict[str, Prediction]:
        """Predictions of the tests from the check of the band."""
        self._require("calibration_")
        return self.left_out_.predictions(campaign.evenly_over_speed(MOST_TESTS))

    def learned(self) -> FittedState:
        """Fitted state: the check of the band."""
        self._require("calibration_")
        check = self.calibration_
        left_out = {"left_out": self.left_out_.learned(), "left_out_groups": self.left_out_groups_.learned()}
        return FittedState.of({"widening": check.widening, "far": check.far}, {"inside": check.inside}, **left_out)

    def restore(self, campaign: Campaign, learned: FittedState) -> Self:
        """Take up the tests again."""
        self._begin(campaign)
        self.calibration_ = Calibration.of(
            learned.values["widening"], learned.arrays["inside"], far=learned.values["far"]
        )
        self.left_out_ = LeftOut.restored(learned.part("left_out"))
        self.left_out_groups_ = LeftOut.restored(learned.part("left_out_groups"))
        return self

    @property
    def state(self) -> dict[str, object]:
        """Coverage of left-out tests by the band."""
        checked = hasattr(self, "calibration_") and self.calibration_.tests
        return {"band_check": self.calibration_.state} if checked else {}


def _batch(rows: FloatArray) -> Tensor:
    """A batch of one campaign."""
    return torch.tensor(rows, dtype=torch.float32)[None]


def _widened(pulses: FloatArray, factor: float) -> FloatArray:
    """Draws moved away from the expected pulse in row 0."""
    return np.asarray(pulses[0] + factor * (pulses - pulses[0]))


@kept
def _network() -> PretrainedNetwork:
    """The network with its weights, which have to be those that this code was shipped with."""
    content = _WEIGHTS.read_bytes()
    if hashlib.sha256(content).hexdigest() != _SHA256:
        raise CrashfuseError(f"{_WEIGHTS.name} is not the file that belongs to this version; install crashfuse again.")
    network = PretrainedNetwork()
    network.load_state_dict({name: weight.float() for name, weight in load(content).items()})
    return network.eval()
