"""Repeatability: what a repeat of each test would rate against it. Nothing of this is used to predict.

Repeats in the campaign decide; without any, the scatter of tests at other conditions gives an estimate.
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
from crashfuse.crash_test import SAME, CrashTest
from crashfuse.execution.cache import Code, Entry, numbers
from crashfuse.execution.run import Run, one_thread
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray
from crashfuse.signals.rating import rate_many
from crashfuse.units import read_out

REPEATABILITY = "Repeatability"  # name of this step in progress reports

_KIND = "repeatability"  # of cache entry
_N_DRAWS = 100
_LEAST_LACK = 1e-4  # of a rating to 1: identical pulses lack nothing, and have no logarithm
_LEAST_SPREAD, _USUAL = 0.1, 4  # of draws; as many repeats as say that others scatter like these
_REACH = 1.96  # standard deviations on each side of a central 95 % interval
_ANYWHERE, _AT_A_CONDITION, _SPREAD_OF_A_TEST, _UNREPEATED = 0.5, 0.5, 2.0, 1.0  # of the log of what ratings lack
_STEPS = 200  # of the displacement grid on which a difference is drawn
_SHARES = np.linspace(0.0, 1.0, 101)
_BEYOND = 1.5  # times the test's crush; nothing is known of scatter farther on


@dataclass(frozen=True, slots=True)
class Repeatability:
    """What a repeat of a test would rate against it over one window: expectation and central 95 %."""

    value: float
    lower: float
    upper: float
    repeats: tuple[str, ...] = ()  # ids of the tests at about the same condition whose rating counted

    @property
    def text(self) -> str:
        """The value with its interval."""
        return f"{self.value:.3f} [{self.lower:.2f}, {self.upper:.2f}]"

    def sentence(self, rating: float, label: str) -> str:
        """How the rating of a prediction compares with those of repeats, if any was run."""
        if not self.repeats:
            return f"No repeat of this test was run. By the scatter of other tests one would rate {self.text} (95 %)."
        place = "below" if rating < self.lower else "above" if rating > self.upper else "within"
        repeat = f"By {read_out(self.repeats)}, a repeat of this test rates {self.text} (95 %)"
        return f"{repeat}. The prediction's {rating:.3f} ({label}) is {place} what repeats reach."


def repeatability(
    campaign: Campaign, windows_ms: Sequence[float], tests: Sequence[str] = (), *, seed: int = 0, run: Run | None = None
) -> dict[str, dict[float, Repeatability]]:
    """How a repeat would rate against each test, by window [0, w) that its record fills; empty of one test; cached."""
    if len(campaign.tests) < 2:
        return {}
    windows = tuple(float(window) for window in windows_ms)
    run, repeats = run or Run.of(campaign), {test.id: repeats_of(test, campaign) for test in campaign.tests}
    shared = {"campaign": campaign.fingerprint, "windows": windows, "seed": seed, "code": Code(__name__)}
    wanted = [test_id for test_id, others in repeats.items() if others or not tests or test_id in tests]

    @once
    def scatter() -> Scatter:
        return Scatter().fit(campaign, run)

    def compute(test_id: str) -> tuple[FloatArray, Entry]:
        rng, test = np.random.default_rng([seed, campaign.test_ids.index(test_id)]), campaign.test(test_id)
        measured = [other.pulse.accel_mps2 for other in repeats[test_id]]
        lacks = _lacks(test, np.vstack([scatter().repeats(test, _N_DRAWS, rng), *measured]), windows)
        return lacks, {"lacks": lacks}

    lacks = {}
    for done, test_id in enumerate(wanted):
        run.watch.report(REPEATABILITY, done, len(wanted))
        key, work = {**shared, "test": test_id}, partial(compute, test_id)
        lacks[test_id] = run.get_or_compute(_KIND, key, work, lambda entry: numbers(entry, "lacks", len(windows), None))
    run.watch.report(REPEATABILITY, len(wanted), len(wanted))

    def estimate(test_id: str, row: int) -> Repeatability:
        ids = tuple(other.id for other in repeats[test_id])
        pairs = {
            n: (own[row, :_N_DRAWS], own[row, _N_DRAWS:]) for n, own in lacks.items() if not np.isnan(own[row]).any()
        }
        elsewhere = [pair for name, pair in pairs.items() if name not in (test_id, *ids) and pair[1].size]
        return Repeatability(*combined(*pairs[test_id], elsewhere, len(repeats)), ids)

    return {
        test_id: {w: estimate(test_id, row) for row, w in enumerate(windows) if not np.isnan(lacks[test_id][row]).any()}
        for test_id in tests or campaign.test_ids
    }


def _lacks(test: CrashTest, pulses_mps2: FloatArray, windows_ms: Sequence[float]) -> FloatArray:
    lacks = np.full((len(windows_ms), len(pulses_mps2)), np.nan)
    for row, window in zip(lacks, windows_ms, strict=True):
        n = round(window / 1e3 / DT_S)
        if window / 1e3 <= test.recorded_s + 1e-3 and np.ptp(test.pulse.accel_mps2[:n]) > 0:
            rated = rate_many(test.pulse.accel_mps2[:n], pulses_mps2[:, :n], dt_s=DT_S)
            row[:] = [max(1 - rating.overall, _LEAST_LACK) for rating in rated]
    return lacks


def repeats_of(test: CrashTest, campaign: Campaign) -> tuple[CrashTest, ...]:
    """The other tests with the same factors, and speed and mass within 2 %."""
    mine = test.condition
    return tuple(
        other
        for other in campaign.tests
        if other.id != test.id
        and abs(other.condition.speed_mps - mine.speed_mps) <= SAME * mine.speed_mps
        and abs(other.condition.mass_kg - mine.mass_kg) <= SAME * mine.mass_kg
        and other.condition.factors == mine.factors
    )


def combined(
    drawn: FloatArray, measured: FloatArray, elsewhere: Sequence[tuple[FloatArray, FloatArray]], n_tests: int
) -> tuple[float, float, float]:
    """Value, lower and upper end of a rating, from what ratings of drawn pulses and of real repeats lack to 1.

    That is log-normal. Draws may be off in the whole campaign, and further at a condition, or scatter
    otherwise: learned from repeats, here and ``elsewhere`` (drawn, measured). Without any, repeats may lack far less.
    """
    logs = [(np.log(of_draws), np.log(of_repeats)) for of_draws, of_repeats in ((drawn, measured), *elsewhere)]
    spreads = np.array([max(float(of_draws.std()), _LEAST_SPREAD) for of_draws, _ in logs])
    squares = sum(y.size * y.var() / s**2 for (_, y), s in zip(logs, spreads, strict=True) if y.size)
    spreads *= np.sqrt((_USUAL + squares) / (_USUAL + sum(max(y.size - 1, 0) for _, y in logs)))
    few = (_SPREAD_OF_A_TEST / n_tests) ** 2
    shift, unknown = 0.0, _ANYWHERE**2 + few
    for (of_draws, y), spread in zip(logs[1:], spreads[1:], strict=True):
        share = unknown / (unknown + (y.size + 1) * (_AT_A_CONDITION**2 + spread**2 / y.size))  # n + 1 tests say it
        shift, unknown = shift + share * (y.mean() - of_draws.mean() - shift), (1 - share) * unknown
    unknown, spread, (of_draws, y) = unknown + _AT_A_CONDITION**2, spreads[0], logs[0]
    if y.size:
        share = unknown / (unknown + spread**2 / y.size)
        shift, unknown = shift + share * (y.mean() - of_draws.mean() - shift), (1 - share) * unknown
    is_known = measured.size or elsewhere
    more, less = (unknown, unknown) if is_known else (unknown - _ANYWHERE**2, unknown + _UNREPEATED**2)
    middle = float(of_draws.mean()) + shift
    value = 1 - float(drawn.mean() * np.exp(shift))
    lower = 1 - np.exp(middle + _REACH * np.sqrt(spread**2 + more))
    upper = 1 - np.exp(middle - _REACH * np.sqrt(spread**2 + less))
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
