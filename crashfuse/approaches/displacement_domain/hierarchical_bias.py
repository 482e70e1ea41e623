"""The hierarchical bias model: a sum of parts shared by all tests, by similar tests, and specific to each test."""

import copy
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.special import stdtrit

from crashfuse.approaches.base import FittedState, StudentT, root
from crashfuse.approaches.displacement_domain.bias import BiasDraws, BiasPart, BiasPoints, CaeForce, CaeStop
from crashfuse.approaches.displacement_domain.covariance import LogNormal, Part
from crashfuse.approaches.displacement_domain.gaussian_process import GaussianProcess
from crashfuse.condition import Condition
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import G

_S, _V0, _FRONT, _REAR, _TREND, _HUMPS, _SHARE, _STOPPING, _CRUSHING, FIRST_FACTOR = range(10)
TEST = -1
_OF_AXLES = {_FRONT: "front weight in kg", _REAR: "rear weight in kg"}
LENGTH_UNITS = {_S: "s in m", _V0: "v0 in m/s", **_OF_AXLES, _SHARE: "v/v0"}
FORCE_UNIT = 10 * G  # the ratio enters with its standard deviation where the CAE model decelerates at 10 g

# With one to three tests the priors decide. Their medians are what random vehicles of many kinds taught
# (benchmarks/bias_priors.py), rounded; their spreads are wider than those found there. No campaign took part.
_REACH = (_S, LogNormal(0.1, 0.3))
_SHORT = (_S, LogNormal(0.047, 0.3))
_SPEED = (_V0, LogNormal(9.0, 0.5))
_WEIGHT = LogNormal(300.0, 0.5)
_STOP_REACH = (_SHARE, LogNormal(0.2, 0.4))
_OVER_DISPLACEMENT = (
    Part("shared", LogNormal(0.41, 0.5), ((_REACH,),), times=_CRUSHING),
    Part("by speed", LogNormal(0.55, 0.5), ((_SHORT,), (_SPEED,)), times=_CRUSHING),
    Part("by weight", LogNormal(0.21, 0.7), ((_REACH,), ((_FRONT, _WEIGHT), (_REAR, _WEIGHT))), times=_CRUSHING),
    Part("ratio", LogNormal(0.37, 0.7), (((_S, LogNormal(0.5, 0.3)),),), times=_TREND),
    Part("humps", LogNormal(1.05, 0.5), (((_S, LogNormal(0.43, 0.3)),),), times=_HUMPS),
    Part("own", LogNormal(0.17, 0.6), (((_S, LogNormal(0.027, 0.3)),),), times=_CRUSHING, same=TEST),
)
OVER_VELOCITY = (
    Part("stop by speed", LogNormal(0.74, 0.7), ((_STOP_REACH,), ((_V0, LogNormal(5.5, 0.5)),)), times=_STOPPING),
    Part("own stop", LogNormal(0.53, 0.5), ((_STOP_REACH,),), times=_STOPPING, same=TEST),
)
_FACTOR_SCALE = LogNormal(0.3, 0.7)
NOISE = LogNormal(0.03, 0.7)

_EVEN_G, _GROWING_G, _UNRESOLVED_G = 0.3, 1.5, 0.15
_SCATTER_REACH = (_S, LogNormal(0.05, 0.2))
GROWTH_UNIT_M = 0.5

_LEAST_FREEDOM = 3

PAST_SPEEDS_MPS, PAST_CRUSH_M = np.arange(5.0, 18.0, 3.0), np.arange(60) * 0.02
"""Impact speeds and crush at which past vehicles tell their bias to the next one."""
_TAUGHT = {"shared", "by speed", "ratio"}  # parts of it; a vehicle's humps are its CAE model's, so their share is told


def bias_parts(factor_columns: Iterable[tuple[str, int]]) -> tuple[Part, ...]:
    """All parts of the bias, with one for each of these factors, given by name and column."""
    by_factor = (Part(f"by {name}", _FACTOR_SCALE, ((_REACH,),), times=_CRUSHING, same=n) for name, n in factor_columns)
    return (*_OVER_DISPLACEMENT[:-1], *by_factor, _OVER_DISPLACEMENT[-1], *OVER_VELOCITY)


def scatter_parts(
    factor_columns: Iterable[tuple[str, int]], growth_column: int, unit_mps2: float
) -> tuple[tuple[Part, ...], LogNormal]:
    """Parts of the bias up to the stop, the scatter of tests even and growing with crush, and the noise.

    Scatter has physical units, independent of how wrong the CAE model is; the unit is the RMS of the bias.
    """
    common = [part for part in bias_parts(factor_columns) if part.same != TEST and part not in OVER_VELOCITY]
    unit = unit_mps2 / G
    even = Part("even", LogNormal(_EVEN_G / unit, 0.7), ((_SCATTER_REACH,),), times=_CRUSHING, same=TEST)
    growing = Part("growing", LogNormal(_GROWING_G / unit, 0.4), ((_SCATTER_REACH,),), times=growth_column, same=TEST)
    return (*common, even, growing), LogNormal(_UNRESOLVED_G / unit, 0.5)


class HierarchicalBias:
    """δ(s, x, k) = (f0(s) + f1(s, v0) + f2(s, weights) + r_k(s)) m̄/m + ρ(s) Ḡ(s, x) + η(s) (G_a - Ḡ) + stop + noise.

    f0 is common to all tests, f1 and f2 vary with the condition, ρ multiplies the trend of the CAE model's force, η its
    humps, and r_k is specific to test k. They are forces, so they accelerate a vehicle heavier than the tests' mean m̄
    less. The stop, over velocity, has a part that varies with speed and one specific to test k. Where similar tests
    contradict each other, r_k grows and a prediction shrinks to the CAE model. A new test has specific parts too.

    A factor adds a function of displacement for each of its values, if the tests, each predicted from the others, are
    more probable with it: ``densities_`` are their log densities for every set of factors compared.

    The prior mean is zero, or what past vehicles ``taught``, shape (6, 60): the mean bias without its humps at five
    impact speeds over crush, then the mean η over crush.
    """

    end_share: ClassVar[float] = 0.25
    """Share of the impact speed below which a vehicle counts as stopping: 6 % of its energy is left."""

    def __init__(self, *, seed: int = 0, taught: FloatArray | None = None) -> None:
        self.seed, self.taught = seed, taught

    def fit(self, tests: Sequence[BiasPoints], watch: Watch = SILENT) -> Self:
        """Fit to the bias of each test."""
        rows, y = self._take(tests)
        choices: list[tuple[str, ...]] = [(), *((name,) for name in self._levels)]
        choices += [tuple(self._levels)] * (len(self._levels) > 1)
        self.densities_: dict[str, float] = {}
        best: GaussianProcess | None = None
        self.retried_ = False
        for number, factors in enumerate(choices):
            watch.report("Bias model", number, len(choices))
            process = self._process(factors).fit(rows, y, best)
            self.retried_ |= process.retries_ > 0
            density = float(process.left_out_log_density().sum())
            if not self.densities_ or density > max(self.densities_.values()):
                best, self.process_, self.factors_ = process, process, factors
            self.densities_[" and ".join(factors) or "none"] = density
        watch.report("Bias model", len(choices), len(choices))
        return self

    def learned(self) -> FittedState:
        """Hyperparameters, factors, and the log densities that decided on them."""
        values = {"factors": list(self.factors_), "densities": self.densities_}
        return FittedState.of(values, {}, process=self.process_.learned())

    def restore(self, tests: Sequence[BiasPoints], learned: FittedState) -> Self:
        """Restore what was learned from the bias of these tests."""
        rows, y = self._take(tests)
        self.factors_, self.densities_ = tuple(learned.values["factors"]), dict(learned.values["densities"])
        self.process_ = self._process(self.factors_).restore(rows, y, learned.part("process"))
        return self

    def _process(self, factors: Sequence[str]) -> GaussianProcess:
        columns = [(name, FIRST_FACTOR + list(self._levels).index(name)) for name in factors]
        return GaussianProcess(bias_parts(columns), NOISE, seed=self.seed)

    def _take(self, tests: Sequence[BiasPoints]) -> tuple[FloatArray, FloatArray]:
        self.mass_kg_ = float(np.mean([test.condition.mass_kg for test in tests]))
        self._levels = _levels([test.condition for test in tests])
        self.tests_ = len(tests)
        rows = np.concatenate([self._rows(test, number) for number, test in enumerate(tests)])
        return rows, np.concatenate([test.bias_mps2 for test in tests]) - self._expected(rows)

    def _expected(self, rows: FloatArray) -> FloatArray:
        if self.taught is None:
            return np.zeros(len(rows))
        *bias, humps = self.taught
        over_crush = RectBivariateSpline(PAST_SPEEDS_MPS, PAST_CRUSH_M, np.array(bias), kx=1, ky=1)
        by_humps = rows[:, _HUMPS] * np.interp(rows[:, _S], PAST_CRUSH_M, humps)
        return np.asarray(rows[:, _CRUSHING] * over_crush.ev(rows[:, _V0], rows[:, _S]) + by_humps)

    @property
    def log_evidence(self) -> float:
        """Log density of the tests' bias in m/s²."""
        process = self.process_
        return process.log_marginal_likelihood_ - len(process.x_) * float(np.log(process.output_scale_))

    def to_teach(self, points: Sequence[BiasPoints]) -> FloatArray:
        """What this vehicle teaches the next one, shape (6, 60), given points at the speeds and crush it is told at."""
        bias = [np.sum([part.mean_mps2 for part in self.parts(at) if part.name in _TAUGHT], axis=0) for at in points]
        a_hump = CaeForce(np.full_like(PAST_CRUSH_M, FORCE_UNIT), np.zeros_like(PAST_CRUSH_M))
        shares = [part.mean_mps2 for part in self.parts(replace(points[0], cae=a_hump)) if part.name == "humps"]
        return np.array([*bias, *shares])

    def without(self, *numbers: int) -> Self:
        """The same as if the tests with these numbers had not been run."""
        other = copy.copy(self)
        other.process_ = self.process_.without(*numbers)
        other.tests_ = self.tests_ - len(numbers)
        return other

    def also(self, tests: Sequence[BiasPoints]) -> Self:
        """The same as if these tests, whose bias is ignored, had been run with the expected result."""
        other = copy.copy(self)
        for number, test in enumerate(tests, start=self._next_number):
            other.process_ = other.process_.also_at(self._rows(test, number))
        other.tests_ = self.tests_ + len(tests)
        return other

    def half_widths(
        self, targets: Sequence[BiasPoints], further: Sequence[BiasPoints]
    ) -> tuple[FloatArray, FloatArray]:
        """Half the width of the 95 % band of the targets' bias, now and after each of the further tests."""
        at = np.concatenate([self._rows(target) for target in targets])
        now, then = self.process_.std_given(at, [self._rows(test, self._next_number) for test in further])
        return _reach(self.freedom_) * now, _reach(_freedom(self.tests_ + 1)) * then

    @property
    def freedom_(self) -> int:
        """Degrees of freedom of the draws: few tests show how much tests differ."""
        return _freedom(self.tests_)

    @property
    def _next_number(self) -> int:
        return int(self.process_.x_[:, TEST].max()) + 1

    def _rows(self, points: BiasPoints, test: int = -1, *, crushing: bool = True) -> FloatArray:
        """Columns as numbered above, factor values, the test number."""
        condition, cae, share = points.condition, points.cae, points.speed_share
        n, mass, values = share.size, self.mass_kg_ / condition.mass_kg, dict(condition.factors)
        stopping = mass * np.maximum(1 - share / self.end_share, 0.0)
        factors = (levels.get(values.get(name, ""), -1) for name, levels in self._levels.items())
        x, alike = np.tile(condition.vector, (n, 1)), np.tile([mass * crushing, *factors, test], (n, 1))
        trend, humps = cae.trend_mps2 / FORCE_UNIT, (cae.accel_mps2 - cae.trend_mps2) / FORCE_UNIT
        return np.column_stack([points.displacement_m, x, trend, humps, share, stopping, alike])

    def sample(self, moving: BiasPoints, stop: CaeStop, n_draws: int, rng: np.random.Generator) -> BiasDraws:
        """Mean and draws of a new test's bias by its :meth:`distribution`."""
        return BiasDraws.of(self.distribution(moving, stop), moving.displacement_m.size, n_draws, rng)

    def distribution(self, moving: BiasPoints, stop: CaeStop) -> StudentT:
        """A new test's bias with its specific deviation and stop, without noise; no seed changes it."""
        crush, hump = np.full_like(stop.speed_share, stop.crush_m), CaeForce(stop.accel_mps2, 0 * stop.accel_mps2)
        stopping = BiasPoints(moving.condition, crush, stop.speed_share, hump)
        rows = np.vstack([self._rows(moving), self._rows(stopping, crushing=False)])
        mean, covariance = self.process_.posterior(rows)
        mean += self._expected(rows)
        return StudentT(mean, root(covariance), self.freedom_)

    def common(self, tests: Sequence[BiasPoints]) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of new tests' bias before their stop, one after the other, without specific parts."""
        x = np.concatenate([self._rows(test) for test in tests])
        mean, covariance = self.process_.posterior(x)
        return mean + self._expected(x), covariance - self.process_.prior_of({"own"}, x)

    def parts(self, test: BiasPoints) -> tuple[BiasPart, ...]:
        """The bias of a new test before its stop by parts, then their total."""
        x = self._rows(test)
        over_displacement = self.process_.parts[: -len(OVER_VELOCITY)]
        moments = self.process_.predict_parts(x)[: len(over_displacement)]
        mean, covariance = self.process_.posterior(x)
        expected, names = self._expected(x), [part.name for part in over_displacement]
        if self.taught is not None:
            names.append("past vehicles")
            moments.append((expected, np.zeros(len(x))))
        moments.append((mean + expected, np.sqrt(np.maximum(np.diag(covariance), 0.0))))
        reach, named = _reach(self.freedom_), zip([*names, "total"], moments, strict=True)
        return tuple(BiasPart(name, mean, mean - reach * std, mean + reach * std) for name, (mean, std) in named)

    @property
    def state(self) -> dict[str, object]:
        """Hyperparameters (standard deviations relative to the bias, lengths in SI) and diagnostics."""
        process, names = self.process_, []
        for part in process.parts:
            columns = [column for group in part.groups for column, _ in group]
            names.append(f"{part.name}, standard deviation")
            names += [f"{part.name}, length in {LENGTH_UNITS[column]}" for column in columns]
        names.append("noise, standard deviation")

        def by_name(values: FloatArray) -> dict[str, float]:
            return dict(zip(names, values.round(4).tolist(), strict=True))

        return {
            "points": len(process.x_),
            "bias_rms_g": round(process.output_scale_ / G, 3),
            "hyperparameters": by_name(np.exp(process.theta_)),
            "spread_factors": by_name(np.exp(process.spread())),
            "touched_bounds": [name for name, touched in zip(names, process.touched_, strict=True) if touched],
            "log_marginal_likelihood": round(process.log_marginal_likelihood_, 2),
            "dead": process.dead_,
            "retries": process.retries_,
            "factors": list(self.factors_),
            "left_out_log_density": {name: round(value, 1) for name, value in self.densities_.items()},
        }

    def unknown_factors(self, condition: Condition) -> tuple[str, ...]:
        """Factors in use whose value at a condition is missing or occurs in no test."""
        values = dict(condition.factors)
        return tuple(name for name in self.factors_ if values.get(name, "") not in self._levels[name])

    @property
    def notes(self) -> tuple[str, ...]:
        """The choice of factors, and a warning if the fit explains nothing."""
        notes = ("The bias model found nothing but noise in the tests.",) * self.process_.dead_
        if self._levels:
            on = f"depends on {' and '.join(self.factors_)}" if self.factors_ else "does not depend on that"
            differ = f"Tests differ in {' and '.join(self._levels)}; by what left-out tests say"
            notes += (f"{differ}, what the CAE model gets wrong {on}.",)
        return notes


def _freedom(n_tests: int) -> int:
    return max(n_tests - 1, _LEAST_FREEDOM)


def _reach(freedom: int) -> float:
    return float(stdtrit(freedom, 0.975))


def _levels(conditions: Sequence[Condition]) -> dict[str, dict[str, int]]:
    """Numbered values of factors that all tests have, two of them in two tests each."""
    levels = {}
    for name, _ in conditions[0].factors:
        counts = Counter(dict(condition.factors).get(name, "") for condition in conditions)
        if counts[""] == 0 and sum(count > 1 for count in counts.values()) > 1:
            levels[name] = {value: number for number, value in enumerate(sorted(counts))}
    return levels
