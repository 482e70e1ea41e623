"""The displacement-domain approach: correct the CAE model over displacement, then let the vehicle move (Sect. 3.2)."""

import time
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from threadpoolctl import threadpool_limits

from crashfuse.approaches.base import Approach, Prediction
from crashfuse.approaches.bias import BiasPart, BiasPoints, bijective_projection, uniform_points
from crashfuse.approaches.dynamics import integrate
from crashfuse.approaches.hierarchy import HierarchicalBias
from crashfuse.approaches.rebound import follow_unloading
from crashfuse.approaches.table4 import Table4Bias
from crashfuse.cache import Cache
from crashfuse.cae_model import CaeModel
from crashfuse.campaign import Campaign, CrashTest
from crashfuse.errors import NotFittedError, UsageError
from crashfuse.loading import loading_phase
from crashfuse.progress import SILENT, Watch
from crashfuse.pulse import DT_S, N_SAMPLES, Condition, FloatArray

_GRID = 200  # steps of the displacement grid on which the bias is drawn
_SHARES = np.linspace(0.0, 1.0, 101)  # of the impact speed, at which what depends on velocity is drawn
_LEAST_POINTS = 8  # of a test, however many there are
_FINER = 8  # how much finer the CAE model is read: it may turn sharply where its vehicle stops


@dataclass(frozen=True, slots=True)
class DisplacementConfig:
    """Hyperparameters of the displacement-domain approach.

    Parameters
    ----------
    bias : {"hierarchical", "table 4"}
        The bias model.
    n_draws : int
        Whole pulses drawn for the band.
    step_s : float
        Spacing of the bias points of a test: the way the vehicle goes at impact speed in this time. A CFC 60 pulse
        holds little more; closer points would repeat each other, and the fit would count them as evidence.
    max_points : int
        About the most bias points of all tests together; more tests have fewer each. The fit's time grows with the
        cube of their number.
    projected_points : int
        For Table 4: points for each of a test's two projections.
    restarts : int
        For Table 4: starts beside the first.
    """

    bias: Literal["hierarchical", "table 4"] = "hierarchical"
    n_draws: int = 500
    step_s: float = 0.002
    max_points: int = 400
    projected_points: int = 75
    restarts: int = 10

    @classmethod
    def fast(cls) -> Self:
        """The default: a hierarchical Gaussian process, a second a fit."""
        return cls()

    @classmethod
    def paper(cls) -> Self:
        """Table 4 as it stands: minutes a fit."""
        return cls(bias="table 4")


def measured_bias(test: CrashTest, model: CaeModel, step_m: float = 0.002) -> BiasPoints:
    """What the CAE model got wrong in a test, over displacement, as the hierarchical model is told but finer."""
    condition = test.condition
    phase = loading_phase(test.pulse.accel_mps2, condition.speed_mps)
    return uniform_points(condition, phase, model.loading_curve(condition), step_m, HierarchicalBias.end_share)


class DisplacementDomain(Approach):
    """Bias of the CAE model over displacement, learned from the tests, and Eq. 29 with it.

    Parameters
    ----------
    config : DisplacementConfig
    seed : int
        For the draws and the optimiser's starts.
    cache : Cache, optional
        Where the trained emulator of the CAE model is kept.

    Attributes
    ----------
    model_ : CaeModel
    points_ : tuple of BiasPoints
        One for each test.
    bias_ : HierarchicalBias or Table4Bias
    """

    name = "displacement_domain"
    label = "Displacement domain"

    def __init__(
        self, config: DisplacementConfig = DisplacementConfig(), *, seed: int = 0, cache: Cache | None = None
    ) -> None:
        self.config = config
        self.seed = seed
        self.cache = cache

    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Learn the bias from the campaign's tests.

        Raises
        ------
        UsageError
            If the campaign has no test.
        DataError
            If it has no CAE run.
        Cancelled
            If the watch was told to stop.
        """
        if not campaign.tests:
            raise UsageError("The displacement domain learns from tests; this campaign has none.")
        self.model_ = CaeModel(cache=self.cache).fit(campaign.cae, watch)
        start = time.perf_counter()
        table_4 = self.config.bias == "table 4"
        self.bias_: HierarchicalBias | Table4Bias = (
            Table4Bias(self.config.restarts, seed=self.seed) if table_4 else HierarchicalBias(seed=self.seed)
        )
        most = max(self.config.max_points // len(campaign.tests), _LEAST_POINTS)
        self.points_ = tuple(self._points(test, most) for test in campaign.tests)
        with threadpool_limits(1):  # two contended threads cost many times the work of one
            self.bias_.fit(self.points_, watch)
        self._seconds = time.perf_counter() - start
        return self

    def _points(self, test: CrashTest, most: int) -> BiasPoints:
        condition = test.condition
        phase = loading_phase(test.pulse.accel_mps2, condition.speed_mps)
        curve = self.model_.loading_curve(condition)
        if self.config.bias == "table 4":
            return bijective_projection(condition, phase, curve, self.config.projected_points)
        step = max(self.config.step_s * condition.speed_mps, phase.crush_m / most)
        return uniform_points(condition, phase, curve, step, self.bias_.end_share)

    def predict(self, condition: Condition) -> Prediction:
        """Predict the pulse at a condition: Eq. 29 with the mean bias, and with whole functions drawn of it.

        Raises
        ------
        NotFittedError
            If called before :meth:`fit`.
        """
        if not hasattr(self, "bias_"):
            raise NotFittedError("The displacement domain has not been fitted; call fit(campaign) first.")
        speed, end_share = condition.speed_mps, self.bias_.end_share
        fine = np.linspace(0.0, speed * DT_S * N_SAMPLES, _GRID * _FINER + 1)  # no vehicle gets further in the record
        grid = fine[::_FINER]
        curve = self.model_.loading_curve(condition)
        cae = curve.accel_at(fine, end_share)
        with threadpool_limits(1):
            rng = np.random.default_rng(self.seed)
            bias = self.bias_.sample(condition, grid, cae[::_FINER], _SHARES, self.config.n_draws, rng)
            over_displacement = cae + [np.interp(fine, grid, function) for function in bias.over_displacement_mps2]
            over_speed = curve.stopping_accel(_SHARES, end_share) + bias.over_speed_mps2
            motion = integrate(over_displacement, fine[1], over_speed, speed)
        pulse = self.model_.pulse(condition).accel_mps2
        pulses = follow_unloading(motion.accel_mps2, speed, pulse, curve.own)
        notes = (*self.model_.notes(condition), *self.bias_.notes)
        if len(self.points_) == 1:
            notes += ("Only one test: how much tests differ from each other is assumed, not learned.",)
        return Prediction(condition, pulses[0], pulses[1:], notes)

    def bias_parts(self, condition: Condition, displacement_m: FloatArray) -> tuple[BiasPart, ...]:
        """Take the bias that is expected at a condition apart; empty for Table 4, which is all of one piece.

        Parameters
        ----------
        condition : Condition
        displacement_m : ndarray, shape (n,)

        Raises
        ------
        NotFittedError
            If called before :meth:`fit`.
        """
        if not hasattr(self, "bias_"):
            raise NotFittedError("The displacement domain has not been fitted; call fit(campaign) first.")
        if isinstance(self.bias_, Table4Bias):
            return ()
        cae = self.model_.loading_curve(condition).accel_at(displacement_m, self.bias_.end_share)
        return self.bias_.parts(condition, displacement_m, cae)

    @property
    def state(self) -> dict[str, object]:
        """What the fit found: hyperparameters, likelihood, borders touched, points, seconds."""
        return {"seconds": round(self._seconds, 2), **self.bias_.state} if hasattr(self, "bias_") else {}
