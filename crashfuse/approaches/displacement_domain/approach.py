"""The displacement-domain approach: correct the CAE over displacement, then integrate the motion (Sect. 3.2)."""

import copy
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Literal, NamedTuple, Self, cast

import numpy as np
from numpy.random import Generator
from scipy.special import expit

from crashfuse.approaches import calibration as bands
from crashfuse.approaches.base import WHOLE_S, FittedState, Prediction, Settings, StudentT
from crashfuse.approaches.calibration import BandedApproach, Calibration, LeftOut
from crashfuse.approaches.displacement_domain.bias import BiasDraws, BiasPart, BiasPoints, CaeStop
from crashfuse.approaches.displacement_domain.dynamics import integrate
from crashfuse.approaches.displacement_domain.hierarchical_bias import PAST_CRUSH_M, PAST_SPEEDS_MPS, HierarchicalBias
from crashfuse.approaches.displacement_domain.rebound import Rebound, Unloading
from crashfuse.approaches.displacement_domain.table4_bias import Table4Bias
from crashfuse.approaches.neighbours import nearness
from crashfuse.cae.model import CaeModel, LoadingCurve
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.run import UNKEPT, Run, one_thread
from crashfuse.signals.loading_phase import LoadingPhase, loading_phase
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray
from crashfuse.vehicle_archive import Prior

_LEAST_POINTS = 8  # bias points of a test, however many tests there are
FINER = 8  # refinement of the CAE grid over that of a bias: the CAE curve may turn sharply where the vehicle stops
_GRID = 200  # steps of the displacement grid on which a bias is drawn
_SHARES = np.linspace(0.0, 1.0, 101)  # shares of the impact speed at which velocity-dependent parts are drawn
_CHECK_DRAWS = 200  # for each test used to check the band
_CARRIED = np.linspace(0.0, 1.0, 5)  # shares of the mean bias that left-out speeds are predicted with
_JUDGED = slice(round(WHOLE_S / (bands.CHECK_STRIDE * DT_S)))  # the rated time, as the check of the band samples it
_OF_ANY_SEED = ("model_", "_views", "_paired", "_speeds_mps", "_most_points", "points_", "bias_", "rebound_")
_CERTAIN = np.log(1000.0)  # log odds; higher ones are not stated
_AGAINST, _BY_ERRORS = -2.0, 0.4  # logit of the probability of being alike, and its slope over the log odds by errors
_LIKE, _ANY = (1.25, 0.25), (0.34, 0.42)  # median difference of CAE models, and deviation of its logarithm
_CRUSHED = 0.04 * PAST_SPEEDS_MPS[:, None] >= PAST_CRUSH_M  # 40 ms at the impact speed: most vehicles crush as far
_NEGLIGIBLE = 0.02  # probability of being alike
_NEARLY_ALL = 0.95  # of a correction; less is stated


@dataclass(frozen=True, slots=True)
class DisplacementConfig:
    """Hyperparameters of the displacement-domain approach: by default a hierarchical Gaussian process.

    Bias points are as far apart as the vehicle comes at impact speed in ``step_s``, and while it stops this time: a CFC
    60 pulse contains little finer detail, and closer points would count as evidence.
    """

    bias: Literal["hierarchical", "table 4"] = "hierarchical"
    n_draws: int = 500  # whole pulses drawn for the band
    step_s: float = 0.002
    max_points: int = 400  # about, of all tests together: the fit's time grows with the cube of their number
    projected_points: int = 75  # Table 4: in each of a test's two projections
    restarts: int = 10  # Table 4: further starts of the optimiser

    @classmethod
    def fast(cls) -> Self:
        """About one second per fit."""
        return cls()

    @classmethod
    def paper(cls) -> Self:
        """Table 4 as published: minutes per fit."""
        return cls(bias="table 4")

    def points_each(self, n_tests: int) -> int:
        """About how many bias points each of so many tests may have."""
        return max(self.max_points // n_tests, _LEAST_POINTS)


@dataclass(frozen=True, eq=False, slots=True)
class CaeView:
    """The CAE model at one condition, over time and over displacement."""

    condition: Condition
    accel_mps2: FloatArray  # shape (1250,)
    curve: LoadingCurve
    paired: bool  # there is a run at exactly this condition

    @classmethod
    def of(cls, model: CaeModel, condition: Condition) -> Self:
        """Evaluate a model at a condition."""
        paired = model.cae_.paired_run(condition) is not None
        return cls(condition, model.pulse(condition).accel_mps2, model.loading_curve(condition), paired)

    @property
    def grid_m(self) -> FloatArray:
        """Displacements beyond the reach of any vehicle; a bias is drawn at every ``FINER``-th."""
        return np.linspace(0.0, self.condition.speed_mps * DT_S * N_SAMPLES, _GRID * FINER + 1)

    def at_displacement(self, curves: FloatArray, displacement_m: FloatArray) -> FloatArray:
        """Curves over time, (n_curves, 1250), at the times the CAE vehicle reaches displacements, (n_curves, n)."""
        phase = self.curve.phase
        place = np.interp(displacement_m, phase.displacement_m, phase.time_s) / DT_S
        before = np.minimum(place.astype(np.intp), N_SAMPLES - 2)
        first = curves[:, before]
        return np.asarray(first + (place - before) * (curves[:, before + 1] - first))

    def unloading(self, test: CrashTest) -> Unloading:
        """Pair a test at this condition with the CAE pulse, for the rebound."""
        return Unloading(self.condition.speed_mps, test.pulse.accel_mps2, self.accel_mps2, self.curve.phase)


class _LeftOutTest(NamedTuple):
    bias: StudentT  # without the test, and those left out with it
    rebound: Rebound


_LeftOutTests = dict[tuple[int, tuple[int, ...]], _LeftOutTest]
"""By the test's number and those left out with it."""


def measured_bias(test: CrashTest, model: CaeModel, step_m: float = 0.002) -> BiasPoints:
    """The CAE model's error in a test over displacement, at finer steps."""
    condition, speed = test.condition, test.condition.speed_mps
    phase = loading_phase(test.pulse.accel_mps2, speed)
    return BiasPoints.even(condition, phase, model.loading_curve(condition), step_m / speed, HierarchicalBias.end_share)


class DisplacementDomain(BandedApproach):
    """Bias of the CAE model over displacement, learned from the tests and integrated by Eq. 29.

    The seed is that of the draws and the optimiser's starts.
    """

    name = "displacement_domain"
    label = "Displacement domain"
    in_words = "the displacement domain"
    description = (
        "a Gaussian process on what the CAE model gets wrong over displacement (Eqs. 7–28), and the vehicle's motion "
        "integrated with it (Eq. 29)."
    )
    colour = "#D55E00"
    preference = 20

    bias_: HierarchicalBias | Table4Bias
    points_: tuple[BiasPoints, ...]

    def __init__(self, config: DisplacementConfig | None = None, *, seed: int = 0) -> None:
        self.config = DisplacementConfig.fast() if config is None else config
        self.seed = seed

    @classmethod
    def create(cls, settings: Settings) -> Self:
        """Table 4 under the paper's preset, else the hierarchical bias."""
        return cls(DisplacementConfig.paper() if settings.preset == "paper" else None, seed=settings.seed)

    def prepare(self, campaign: Campaign, conditions: Sequence[Condition], run: Run = UNKEPT) -> None:  # noqa: ARG002
        """Train the emulator of the CAE model."""
        CaeModel().fit(campaign.cae, run)

    def fit(self, campaign: Campaign, run: Run = UNKEPT) -> Self:
        """Learn the bias from the campaign's tests."""
        self._require_tests(campaign)
        campaign = self._seen(campaign)
        start = time.perf_counter()
        with one_thread():
            first = run.once((self.name, self.config, campaign.fingerprint), lambda: self)
            if first is self or first.is_of_seed:
                self.rebound_ = Rebound().fit(self._begin(campaign, run))
                self.bias_.fit(self.points_, run.watch)
            else:
                vars(self).update({name: getattr(first, name) for name in _OF_ANY_SEED})
                self.bias_ = copy.copy(self.bias_)
                self.bias_.seed = self.seed
            self.taught_, self.archive_ = self.alikeness(campaign.prior, run.watch)
            if self.taught_ and campaign.prior is not None:
                self.bias_ = self._with_mean(campaign.prior, self.taught_).fit(self.points_, run.watch)
            known = _LeftOutTests() if self.is_of_seed else run.once((first, "left out"), _LeftOutTests)
            self.calibration_ = self._calibrate(campaign, known, run.watch)
        self._seconds = time.perf_counter() - start
        return self

    @property
    def is_of_seed(self) -> bool:
        """Whether another seed gives another bias."""
        return not isinstance(self.bias_, HierarchicalBias) or self.taught_ > 0 or self.bias_.retried_

    def alikeness(self, prior: Prior | None, watch: Watch = SILENT) -> tuple[float, str]:
        """The probability that this vehicle is like the past ones, by which they count (0 if negligible); in words.

        Its CAE model's force over crush and errors are more probable among theirs, or among those of any kind: by
        logistic regression on random vehicles, with prior odds of one to five.
        """
        self._require("points_")
        if prior is None or not isinstance(self.bias_, HierarchicalBias):
            return 0.0, ""
        if not prior.helps:
            return 0.0, prior.sentence
        with one_thread():
            odds = self._with_mean(prior).fit(self.points_, watch).log_evidence - self.bias_.log_evidence
        curves = self.to_teach()[1] - prior.cae[0], *prior.cae
        by_cae = _alike_by_cae(*(float(np.sqrt(np.mean(own[_CRUSHED] ** 2))) for own in curves))
        share = round(float(expit(_AGAINST + _BY_ERRORS * odds + by_cae)), 3)
        times = f"{np.exp(abs(odds)):.3g} times" if abs(odds) < _CERTAIN else "over 1000 times"
        errors, cae = "with" if odds > 0 else "without", "like" if by_cae > 0 else "unlike"
        tests = f"its tests are {times} as probable {errors} the mean error of theirs over crush"
        vehicles, alike = f"{len(prior.vehicles)} past vehicles", f"its CAE model is {cae} theirs, and {tests}"
        if share < _NEGLIGIBLE:
            return 0.0, f"The archive of {vehicles} is not used, as this one is of another kind: {alike}."
        return share, f"Taught by an archive of {vehicles}, which counts {share:.0%}: {alike}."

    def _with_mean(self, prior: Prior, share: float = 1.0) -> HierarchicalBias:
        return HierarchicalBias(seed=self.seed, taught=share * prior.bias)

    @classmethod
    def taught_by(cls, prior: Prior | None) -> Prior | None:
        """It learns the bias from past vehicles."""
        return None if prior is None else prior.of_bias

    def to_teach(self) -> tuple[FloatArray, FloatArray]:
        """What this vehicle teaches: its bias, see :class:`HierarchicalBias`, and CAE accelerations, (5, 60)."""
        self._require("bias_")
        weights = np.mean([view.condition.vector[1:] for view in self._views], axis=0)
        conditions = [Condition.of_vector([float(speed), *weights.tolist()]) for speed in PAST_SPEEDS_MPS]
        points = [self._crushing(condition, PAST_CRUSH_M) for condition in conditions]
        return cast(HierarchicalBias, self.bias_).to_teach(points), np.array([at.cae.accel_mps2 for at in points])

    def _seen(self, campaign: Campaign) -> Campaign:
        return campaign if self.config.bias == "table 4" else self._thinned(campaign)

    def _begin(self, campaign: Campaign, run: Run) -> list[Unloading]:
        self.model_ = CaeModel().fit(campaign.cae, run)
        self._views = tuple(CaeView.of(self.model_, test.condition) for test in campaign.tests)
        self._paired = float(np.mean([view.paired for view in self._views]))
        self._speeds_mps = np.array([test.condition.speed_mps for test in campaign.tests])
        by_table_4 = self.config.bias == "table 4"
        bias = partial(Table4Bias, self.config.restarts) if by_table_4 else HierarchicalBias
        self.bias_, self._most_points = bias(seed=self.seed), self.config.points_each(len(campaign.tests))
        phases = [loading_phase(test.pulse.accel_mps2, test.condition.speed_mps) for test in campaign.tests]
        own = zip(phases, self._views, strict=True)
        self.points_ = tuple(self._points(phase, view.condition, view.curve) for phase, view in own)
        return [] if by_table_4 else list(map(CaeView.unloading, self._views, campaign.tests))

    def learned(self) -> FittedState:
        """Hyperparameters of bias and rebound, and the check of the band."""
        self._require("calibration_")
        parts = {"bias": self.bias_.learned(), "rebound": self.rebound_.learned(), **self._learned_band()}
        values = {"seconds": self._seconds, "decay": self.decay_, "archive": self.archive_, "taught": self.taught_}
        return FittedState.of(values, {}, **parts)

    def restore(self, campaign: Campaign, learned: FittedState, run: Run = UNKEPT) -> Self:
        """Restore the hyperparameters, and condition on the tests again."""
        unloadings = self._begin(self._seen(campaign), run)
        with one_thread():
            self.rebound_ = Rebound().fit(unloadings, learned.part("rebound"))
            self.archive_, self.taught_ = str(learned.values["archive"]), float(learned.values["taught"])
            if self.taught_ and campaign.prior is not None:
                self.bias_ = self._with_mean(campaign.prior, self.taught_)
            self.bias_.restore(self.points_, learned.part("bias"))
        self._restore_band(learned)
        self._seconds, self.decay_ = learned.values["seconds"], learned.values["decay"]
        return self

    def _points(self, phase: LoadingPhase, condition: Condition, curve: LoadingCurve) -> BiasPoints:
        if self.config.bias == "table 4":
            return BiasPoints.projected(condition, phase, curve, self.config.projected_points)
        return BiasPoints.even(condition, phase, curve, self.config.step_s, self.bias_.end_share, self._most_points)

    def expected_points(self, condition: Condition) -> BiasPoints:
        """Where a test would show the bias if it crushed like the CAE model."""
        self._require("bias_")
        phase = loading_phase(self.model_.pulse(condition).accel_mps2, condition.speed_mps)
        return self._points(phase, condition, LoadingCurve(phase))

    def predict(self, condition: Condition) -> Prediction:
        """Eq. 29 with the mean bias, and with whole bias functions drawn."""
        self._require("bias_")
        rng, n_draws = np.random.default_rng(self.seed), self.config.n_draws
        view, widening = CaeView.of(self.model_, condition), self.calibration_.widening
        share = nearness(condition.speed_mps, self._speeds_mps) ** self.decay_
        with one_thread():
            bias = self.bias_.sample(*self._to_predict(view), n_draws, rng)
            bias = self._with_emulator_errors(view, bias, n_draws, rng).widened(widening, share)
            pulses = self._simulate(view, bias, self.rebound_, rng, widening)
        notes = (*filter(None, [self.archive_]), *self.model_.notes(condition), *self._thinning, *self.bias_.notes)
        if share < _NEARLY_ALL:
            part = f"{100 * share:.0f} % of its correction"
            notes += (f"The displacement domain makes {part}: the whole was worse at speeds without tests.",)
        if isinstance(self.bias_, HierarchicalBias) and (unknown := self.bias_.unknown_factors(condition)):
            notes += (f"{' and '.join(unknown).capitalize()} not given: the band covers every value.",)
        if len(self.points_) == 1:
            notes += ("Only one test: how much tests differ is assumed, not learned.",)
        if self.calibration_.tests and not self.calibration_.holds:
            notes += ("The band holds less of the left-out tests than it should, although it was widened.",)
        return Prediction(condition, pulses[0], pulses[1:], notes)

    def _with_emulator_errors(self, cae: CaeView, bias: BiasDraws, n_draws: int, rng: Generator) -> BiasDraws:
        if not cae.paired and self._paired:
            # The bias of tests without a paired run already includes the emulator's error, in each test's own part.
            # Only the share of tests with paired runs has to be added.
            errors = np.sqrt(self._paired) * self.model_.errors(cae.condition, n_draws, rng)
            bias.over_displacement_mps2[1:] += cae.at_displacement(errors, cae.grid_m[::FINER])
        return bias

    def _to_predict(self, cae: CaeView) -> tuple[BiasPoints, CaeStop]:
        end_share = self.bias_.end_share
        moving = BiasPoints.moving(cae.condition, cae.grid_m[::FINER], cae.curve, end_share)
        return moving, CaeStop(_SHARES, cae.curve.stopping_accel(_SHARES, end_share), cae.curve.phase.crush_m)

    def _simulate(
        self, cae: CaeView, bias: BiasDraws, rebound: Rebound, rng: Generator, widening: float, stride: int = 1
    ) -> FloatArray:
        """Shape (1 + n_draws, 1250 / stride), the expected pulse first."""
        speed, curve, end_share, fine = cae.condition.speed_mps, cae.curve, self.bias_.end_share, cae.grid_m
        stopping, common = curve.stopping_accel(_SHARES, end_share), curve.accel_at(fine, end_share)
        functions = bias.over_displacement_mps2, fine[FINER], stopping + bias.over_speed_mps2
        motion = integrate(*functions, speed, common_mps2=common, dt_s=stride * DT_S, n_times=N_SAMPLES // stride)
        return rebound.follow(motion, cae.accel_mps2, curve.phase, speed, rng, widening)

    def _calibrate(self, campaign: Campaign, known: _LeftOutTests, watch: Watch) -> Calibration:
        self.decay_ = 0.0
        if isinstance(self.bias_, Table4Bias) or len(campaign.tests) < bands.LEAST_CHECKED:
            self.left_out_ = self.left_out_groups_ = LeftOut.of({})
            return Calibration(1.0, ())
        without, groups = cache(partial(self._without, known)), bands.speed_groups(campaign)
        log_errors = defaultdict[tuple[int, ...], list[FloatArray]](list)
        for number in bands.checked(campaign):
            if len(group := groups[number]) < len(campaign.tests):
                watch.report("Check of the band", 0, 1)  # makes it cancellable
                measured = campaign.tests[number].pulse.accel_mps2[:: bands.CHECK_STRIDE]
                errors = np.abs(without(number, group)(0.0, _CARRIED) - measured)[:, _JUDGED].mean(axis=1)
                shares = nearness(self._speeds_mps[number], self._speeds_mps, group) ** bands.DECAYS
                log_errors[group].append(np.log(1e-9 + np.interp(shares, _CARRIED, errors)))
        self.decay_ = bands.decay_over_speed(log_errors)
        calibration, self.left_out_, self.left_out_groups_ = bands.check_band(campaign, without, watch)
        return calibration

    def _without(self, known: _LeftOutTests, number: int, left_out: tuple[int, ...]) -> Callable[..., FloatArray]:
        view, rng = self._views[number], np.random.default_rng([self.seed, number])
        if (key := (number, left_out)) not in known:
            model = cast(HierarchicalBias, self.bias_).without(*left_out)  # Table 4 is not checked
            known[key] = _LeftOutTest(model.distribution(*self._to_predict(view)), self.rebound_.without(*left_out))
        distribution, rebound = known[key]
        drawn = BiasDraws.of(distribution, view.grid_m[::FINER].size, _CHECK_DRAWS, rng)
        bias = self._with_emulator_errors(view, drawn, _CHECK_DRAWS, rng)
        near = nearness(self._speeds_mps[number], self._speeds_mps, left_out)

        def pulses(widening: float, shares: FloatArray | None = None) -> FloatArray:  # expected ones if given shares
            again = np.random.default_rng([self.seed, number, 1])
            drawn = bias.widened(widening, near**self.decay_) if shares is None else bias.expected(shares)
            return self._simulate(view, drawn, rebound, again, widening, bands.CHECK_STRIDE)

        return pulses

    def bias_parts(self, condition: Condition, displacement_m: FloatArray) -> tuple[BiasPart, ...]:
        """The expected bias at a condition by its parts; none for Table 4."""
        self._require("bias_")
        if isinstance(self.bias_, Table4Bias):
            return ()
        return self.bias_.parts(self._crushing(condition, displacement_m))

    def common_bias(self, tests: Sequence[CrashTest], displacement_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of the bias at the tests' conditions, one after the other, without specific parts."""
        bias = cast(HierarchicalBias, self.bias_)  # Table 4 has no parts
        return bias.common([self._crushing(test.condition, displacement_m) for test in tests])

    def _crushing(self, condition: Condition, displacement_m: FloatArray) -> BiasPoints:
        return BiasPoints.moving(condition, displacement_m, self.model_.loading_curve(condition), self.bias_.end_share)

    def mended(self, condition: Condition, added: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """CAE pulses at a condition with functions of displacement, shape (n, n_displacements), added: (n, 1250)."""
        view = CaeView.of(self.model_, condition)
        functions = added(view.grid_m[::FINER])
        draws = BiasDraws(functions, np.zeros((len(functions), _SHARES.size)))
        return self._simulate(view, draws, Rebound().fit([]), np.random.default_rng(0), 1.0)

    @property
    def state(self) -> dict[str, object]:
        """Hyperparameters, likelihood, bounds reached, number of points, duration in s."""
        if not hasattr(self, "bias_"):
            return {}
        check = {"band_check": self.calibration_.state} if self.calibration_.tests else {}
        return {"seconds": round(self._seconds, 2), "decay_over_speed": self.decay_, **check, **self.bias_.state}


def _alike_by_cae(difference: float, size: float, spread: float) -> float:
    # log odds that a CAE model is of the kind whose mean it differs from, not of any: by log-normal differences
    kind = float(np.clip(_LIKE[0] * spread / size, 0.02, _ANY[0]))
    like, of_any = np.log(max(difference / size, kind) / np.array([kind, _ANY[0]])) / (_LIKE[1], _ANY[1])
    return float(np.log(_ANY[1] / _LIKE[1]) + 0.5 * (of_any**2 - like**2))
