"""Repeatability: the rating that a repeat of each test would get against it. Nothing of this is used to predict.

Pulses of repeats are drawn with the scatter that all tests of a campaign show and rated against the test. Where it has
been repeated, what the repeats rate counts too, by how much it says.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache as once
from functools import partial
from typing import Self

import numpy as np

from crashfuse.approaches.base import MOST_TESTS, draw
from crashfuse.approaches.displacement_domain.approach import FINER, CaeView, DisplacementConfig
from crashfuse.approaches.displacement_domain.bias import BiasPoints, CaeForce
from crashfuse.approaches.displacement_domain.dynamics import integrate
from crashfuse.approaches.displacement_domain.gaussian_process import GaussianProcess
from crashfuse.approaches.displacement_domain.hierarchical_bias import (
    FIRST_FACTOR,
    GROWTH_UNIT_M,
    HierarchicalBias,
    scatter_parts,
)
from crashfuse.approaches.displacement_domain.rebound import Rebound
from crashfuse.cae.model import CaeModel, LoadingCurve
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import Code, Entry, numbers
from crashfuse.execution.run import Run, one_thread
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray
from crashfuse.signals.rating import rate_many

REPEATABILITY = "Repeatability"  # name of this step in progress reports

_KIND = "repeatability"  # of cache entry
_N_DRAWS = 100
_SAME = 0.02  # relative difference in speed and mass up to which a test counts as a repeat
_LEAST_LACK = 1e-4  # of a rating to 1: identical pulses lack nothing, and have no logarithm
_LEAST_SPREAD = 0.1
_REACH = 1.96  # standard deviations on each side of a central 95 % interval
_MODEL_SPREAD, _SPREAD_OF_A_TEST = 0.35, 2.0
_STEPS = 200  # of the displacement grid on which a difference is drawn
_SHARES = np.linspace(0.0, 1.0, 101)
_BEYOND = 1.5  # times the test's crush; nothing is known of scatter farther on


@dataclass(frozen=True, slots=True)
class Repeatability:
    """The overall rating that a repeat of a test would get against it over one window: expectation and central 95 %."""

    value: float
    lower: float
    upper: float
    repeats: tuple[str, ...] = ()  # ids of the tests at about the same condition whose rating counted

    @property
    def text(self) -> str:
        """The value with its interval."""
        return f"{self.value:.3f} [{self.lower:.2f}, {self.upper:.2f}]"

    def sentence(self, rating: float, label: str) -> str:
        """How the rating of an approach's prediction compares with what a repeat would get."""
        place = "below" if rating < self.lower else "above" if rating > self.upper else "within"
        repeat = f"A repeat of this test would rate {self.text} (95 %)"
        return f"{repeat}. The prediction's {rating:.3f} ({label}) is {place} what repeats reach."


def repeatability(
    campaign: Campaign, windows_ms: Sequence[float], tests: Sequence[str] = (), *, seed: int = 0, run: Run | None = None
) -> dict[str, dict[float, Repeatability]]:
    """How a repeat would rate against each test, by window [0, w) that its record fills; empty of one test; cached."""
    if len(campaign.tests) < 2:
        return {}
    windows = tuple(float(window) for window in windows_ms)
    run, chosen = run or Run.of(campaign), tests or campaign.test_ids
    shared = {"campaign": campaign.fingerprint, "windows": windows, "seed": seed, "code": Code(__name__)}
    by_test = {}

    @once
    def scatter() -> Scatter:
        return Scatter().fit(campaign, run)

    def compute(test_id: str, repeats: tuple[CrashTest, ...]) -> tuple[FloatArray, Entry]:
        rng = np.random.default_rng([seed, campaign.test_ids.index(test_id)])
        drawn = scatter().repeats(campaign.test(test_id), _N_DRAWS, rng)
        rated = _rated(campaign.test(test_id), repeats, drawn, windows, len(campaign.tests))
        return rated, {"rated": rated}

    for done, test_id in enumerate(chosen):
        run.watch.report(REPEATABILITY, done, len(chosen))
        repeats, key = repeats_of(campaign.test(test_id), campaign), {**shared, "test": test_id}
        work = partial(compute, test_id, repeats)
        rated = run.get_or_compute(_KIND, key, work, lambda entry: numbers(entry, "rated", len(windows), 3))
        by_test[test_id] = {
            window: Repeatability(value, lower, upper, tuple(other.id for other in repeats))
            for window, (value, lower, upper) in zip(windows, rated.tolist(), strict=True)
            if not np.isnan(value)
        }
    run.watch.report(REPEATABILITY, len(chosen), len(chosen))
    return by_test


def _rated(
    test: CrashTest, repeats: Sequence[CrashTest], drawn: FloatArray, windows_ms: Sequence[float], n_tests: int
) -> FloatArray:
    unknown = _MODEL_SPREAD**2 + (_SPREAD_OF_A_TEST / n_tests) ** 2
    measured = np.array([other.pulse.accel_mps2 for other in repeats])
    rated = np.full((len(windows_ms), 3), np.nan)
    for row, window in zip(rated, windows_ms, strict=True):
        n = round(window / 1e3 / DT_S)
        if window / 1e3 <= test.recorded_s + 1e-3 and np.ptp(test.pulse.accel_mps2[:n]) > 0:
            lack = _lack(test, measured[:, :n]) if len(measured) else np.empty(0)
            row[:] = combined(_lack(test, drawn[:, :n]), lack, unknown)
    return rated


def repeats_of(test: CrashTest, campaign: Campaign) -> tuple[CrashTest, ...]:
    """The other tests with the same factors, and speed and mass within 2 %."""
    mine = test.condition
    return tuple(
        other
        for other in campaign.tests
        if other.id != test.id
        and abs(other.condition.speed_mps - mine.speed_mps) <= _SAME * mine.speed_mps
        and abs(other.condition.mass_kg - mine.mass_kg) <= _SAME * mine.mass_kg
        and other.condition.factors == mine.factors
    )


def _lack(test: CrashTest, pulses_mps2: FloatArray) -> FloatArray:
    rated = rate_many(test.pulse.accel_mps2[: pulses_mps2.shape[1]], pulses_mps2, dt_s=DT_S)
    return np.maximum([1 - rating.overall for rating in rated], _LEAST_LACK)


def combined(drawn: FloatArray, measured: FloatArray, unknown: float) -> tuple[float, float, float]:
    """Value, lower and upper end of a rating from what drawn and real repeats lack to 1, above 0.

    What ratings lack is taken as log-normal. The draws' mean is uncertain by the variance ``unknown`` of its logarithm,
    and each real repeat is one sample with the draws' spread, so the more repeats there are the more they count.
    """
    logs = np.log(drawn)
    spread = max(float(logs.std()), _LEAST_SPREAD)
    share, shift = 0.0, 0.0
    if measured.size:
        share = unknown / (unknown + spread**2 / measured.size)
        shift = share * float(np.log(measured).mean() - logs.mean())
    reach = _REACH * np.sqrt(spread**2 + (1 - share) * unknown)
    middle = float(logs.mean()) + shift
    value = 1 - float(drawn.mean()) * np.exp(shift)
    lower, upper = 1 - np.exp(middle + reach), 1 - np.exp(middle - reach)
    return max(value, 0.0), max(float(lower), 0.0), float(upper)


class _ScatterBias(HierarchicalBias):
    """Up to the stop, where a test's deviation may grow with crush, fold after fold."""

    def _take(self, tests: Sequence[BiasPoints]) -> tuple[FloatArray, FloatArray]:
        rows, y = super()._take(tests)
        self._unit_mps2 = float(np.sqrt(np.mean(np.square(y)))) or 1.0
        return rows, y

    def _process(self, factors: Sequence[str]) -> GaussianProcess:
        columns = [(name, FIRST_FACTOR + list(self._levels).index(name)) for name in factors]
        parts, noise = scatter_parts(columns, FIRST_FACTOR + len(self._levels), self._unit_mps2)
        return GaussianProcess(parts, noise, seed=self.seed)

    def _rows(self, points: BiasPoints, test: int = -1, *, crushing: bool = True) -> FloatArray:
        rows = super()._rows(points, test, crushing=crushing)
        growth = self.mass_kg_ / points.condition.mass_kg * points.displacement_m / GROWTH_UNIT_M
        return np.column_stack([rows[:, :-1], growth, rows[:, -1]])

    def differences(
        self, condition: Condition, displacement_m: FloatArray, n: int, rng: np.random.Generator
    ) -> FloatArray:
        none = np.zeros_like(displacement_m)
        rows = self._rows(BiasPoints(condition, displacement_m, np.ones_like(none), CaeForce(none, none)))
        prior = self.process_.prior_of({"even", "growing"}, rows)
        return draw(np.zeros(displacement_m.size), 2 * prior, n, rng)


class Scatter:
    """The scatter of tests, learned from all of a campaign; it draws repeats of a test, with twice its variance."""

    def fit(self, campaign: Campaign, run: Run) -> Self:
        """Learn from the tests of a campaign, two at least."""
        campaign = campaign.evenly_over_speed(MOST_TESTS)
        model = CaeModel().fit(campaign.cae, run)
        views = [CaeView.of(model, test.condition) for test in campaign.tests]
        pairs = list(zip(campaign.tests, views, strict=True))
        with one_thread():
            self.bias_ = _ScatterBias().fit([self._points(test, view, len(pairs)) for test, view in pairs], run.watch)
            self.rebound_ = Rebound().fit([view.unloading(test) for test, view in pairs])
        return self

    def _points(self, test: CrashTest, view: CaeView, n_tests: int) -> BiasPoints:
        speed, end_share = test.condition.speed_mps, _ScatterBias.end_share
        phase = loading_phase(test.pulse.accel_mps2, speed)
        config = DisplacementConfig()
        most = config.points_each(n_tests)
        points = BiasPoints.even(test.condition, phase, view.curve, config.step_s, end_share, most)
        kept = points.speed_share >= end_share
        names = ("displacement_m", "speed_share", "bias_mps2")
        cae = CaeForce(*(values[kept] for values in points.cae))
        return replace(points, cae=cae, **{name: getattr(points, name)[kept] for name in names})

    def repeats(self, test: CrashTest, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw pulses of repeats of a test, shape (n, 1250)."""
        condition, accel, end_share = test.condition, test.pulse.accel_mps2, self.bias_.end_share
        speed = condition.speed_mps
        phase = loading_phase(accel, speed)
        curve = LoadingCurve(phase)
        fine = np.linspace(0.0, speed * DT_S * N_SAMPLES, _STEPS * FINER + 1)
        grid = np.minimum(fine[::FINER], _BEYOND * phase.crush_m)
        with one_thread():
            differences = self.bias_.differences(condition, grid, n, rng)
            force, stopping = curve.accel_at(fine, end_share), curve.stopping_accel(_SHARES, end_share)
            motion = integrate(differences, fine[FINER], stopping[None], speed, common_mps2=force)
            return self.rebound_.repeat(motion, accel, speed, rng)
