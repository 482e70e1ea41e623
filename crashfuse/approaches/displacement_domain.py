"""The displacement-domain approach: correct the CAE model over displacement, then let the vehicle move (Sect. 3.2)."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from threadpoolctl import threadpool_limits

from crashfuse.approaches.base import Approach, Prediction
from crashfuse.approaches.bias import BiasPart, BiasPoints, bijective_projection, uniform_points
from crashfuse.approaches.dynamics import integrate
from crashfuse.approaches.hierarchy import HierarchicalBias
from crashfuse.approaches.rebound import Rebound, Unloading
from crashfuse.approaches.table4 import Table4Bias
from crashfuse.cache import Cache
from crashfuse.cae_model import CaeModel, LoadingCurve
from crashfuse.calibration import Calibration, Coverage, calibrate
from crashfuse.campaign import Campaign, CrashTest
from crashfuse.errors import NotFittedError, UsageError
from crashfuse.loading import loading_phase
from crashfuse.progress import SILENT, Watch
from crashfuse.pulse import DT_S, GRID_S, N_SAMPLES, Condition, FloatArray

_GRID = 200  # steps of the displacement grid on which the bias is drawn
_SHARES = np.linspace(0.0, 1.0, 101)  # of the impact speed, at which what depends on velocity is drawn
_LEAST_POINTS = 8  # of a test, however many there are
_CHECK_DRAWS = 200  # for each test that the band is checked on
_LEAST_CHECKED = 3  # tests: with fewer there is nothing left to learn from
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
    rebound_ : Rebound
    calibration_ : Calibration
        Of the band, on each of these tests predicted from the others.
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
        self._views = tuple(self._view(test.condition) for test in campaign.tests)
        self._paired = float(np.mean([view.paired for view in self._views]))
        most = max(self.config.max_points // len(campaign.tests), _LEAST_POINTS)
        with threadpool_limits(1):  # two contended threads cost many times the work of one
            if self.config.bias == "table 4":
                self.bias_: HierarchicalBias | Table4Bias = Table4Bias(self.config.restarts, seed=self.seed)
                self.rebound_ = Rebound().fit(())
            else:
                self.bias_ = HierarchicalBias(seed=self.seed)
                both = zip(campaign.tests, self._views, strict=True)
                self.rebound_ = Rebound().fit([view.beside(test) for test, view in both])
            both = zip(campaign.tests, self._views, strict=True)
            self.points_ = tuple(self._points(test, view.curve, most) for test, view in both)
            self.bias_.fit(self.points_, watch)
            self.calibration_ = self._calibrate(campaign.tests, watch)
        self._seconds = time.perf_counter() - start
        return self

    def _points(self, test: CrashTest, curve: LoadingCurve, most: int) -> BiasPoints:
        condition = test.condition
        phase = loading_phase(test.pulse.accel_mps2, condition.speed_mps)
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
        rng = np.random.default_rng(self.seed)
        view = self._view(condition)
        with threadpool_limits(1):
            pulses = self._simulate(
                view, self.bias_, self.rebound_, self.config.n_draws, rng, self.calibration_.widening
            )
        notes = (*self.model_.notes(condition), *self.bias_.notes)
        if len(self.points_) == 1:
            notes += ("Only one test: how much tests differ from each other is assumed, not learned.",)
        if self.calibration_.tests and not self.calibration_.holds:
            notes += ("The band holds less than it should on left-out tests, although it was widened.",)
        return Prediction(condition, pulses[0], pulses[1:], notes)

    def _view(self, condition: Condition) -> "_CaeView":
        paired = self.model_.cae_.paired_run(condition) is not None
        pulse = self.model_.pulse(condition).accel_mps2
        return _CaeView(condition, pulse, self.model_.loading_curve(condition), paired)

    def _simulate(
        self,
        cae: "_CaeView",
        bias_model: HierarchicalBias | Table4Bias,
        rebound: Rebound,
        n_draws: int,
        rng: np.random.Generator,
        widening: float = 1.0,
    ) -> FloatArray:
        """The expected pulse in row 0, then pulses drawn, shape (1 + n_draws, 1250)."""
        condition, curve = cae.condition, cae.curve
        speed, end_share = condition.speed_mps, bias_model.end_share
        fine = np.linspace(0.0, speed * DT_S * N_SAMPLES, _GRID * _FINER + 1)  # no vehicle gets further in the record
        grid = fine[::_FINER]
        force = curve.accel_at(fine, end_share)
        bias = bias_model.sample(condition, grid, force[::_FINER], _SHARES, n_draws, rng).widened(widening)
        over_displacement = force + [np.interp(fine, grid, function) for function in bias.over_displacement_mps2]
        over_displacement[1:] += self._emulator_errors(cae, fine, n_draws, rng)
        over_speed = curve.stopping_accel(_SHARES, end_share) + bias.over_speed_mps2
        motion = integrate(over_displacement, fine[1], over_speed, speed)
        return rebound.follow(motion.accel_mps2, speed, cae.accel_mps2, curve.own, rng, widening)

    def _emulator_errors(
        self, cae: "_CaeView", displacement_m: FloatArray, n_draws: int, rng: np.random.Generator
    ) -> FloatArray | float:
        """What the CAE model may be wrong in itself where no run was made.

        The bias of tests without a paired run has the emulator's error in it already: it counts as what each test
        has of its own. So only the share that the tests had paired runs for comes on top.
        """
        if cae.paired or not self._paired:
            return 0.0
        own = cae.curve.own
        time = np.interp(displacement_m, own.displacement_m, own.time_s)
        errors = self.model_.errors(cae.condition, n_draws, rng)
        return float(np.sqrt(self._paired)) * np.array([np.interp(time, GRID_S, error) for error in errors])

    def _calibrate(self, tests: Sequence[CrashTest], watch: Watch) -> Calibration:
        """Check the band on each test, predicted from the others with the same hyperparameters; widen it if needed."""
        if isinstance(self.bias_, Table4Bias) or len(tests) < _LEAST_CHECKED:
            return Calibration(1.0, ())
        left_out = [(self.bias_.without(number), self.rebound_.without(number)) for number in range(len(tests))]

        def check(widening: float) -> list[Coverage]:
            found = []
            for number, (test, view, models) in enumerate(zip(tests, self._views, left_out, strict=True)):
                watch.report("Check of the band", number, len(tests))
                rng = np.random.default_rng([self.seed, number])
                found.append(Coverage.of(test, self._simulate(view, *models, _CHECK_DRAWS, rng, widening)[1:]))
            watch.report("Check of the band", len(tests), len(tests))
            return found

        return calibrate(check)

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
        if not hasattr(self, "bias_"):
            return {}
        checked = {"band_check": self.calibration_.state} if self.calibration_.tests else {}
        return {"seconds": round(self._seconds, 2), **checked, **self.bias_.state}


@dataclass(frozen=True, eq=False, slots=True)
class _CaeView:
    """The CAE model at one condition, over time and over displacement; paired if a run was made there."""

    condition: Condition
    accel_mps2: FloatArray
    curve: LoadingCurve
    paired: bool

    def beside(self, test: CrashTest) -> Unloading:
        """A test beside it."""
        return Unloading(self.condition.speed_mps, test.pulse.accel_mps2, self.accel_mps2, self.curve.own)
