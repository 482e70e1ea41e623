"""How tests scatter: the deviations of each test as a model, and repeats of a test drawn with it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from crashfuse.approaches.base import MOST_TESTS, draw
from crashfuse.approaches.displacement_domain.approach import FINER, CaeView, DisplacementConfig
from crashfuse.approaches.displacement_domain.bias import BiasPoints, CaeForce, uniform_points
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
from crashfuse.execution.cache import Cache
from crashfuse.execution.process import one_thread
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray

_STEPS = 200  # of the displacement grid on which a difference is drawn
_SHARES = np.linspace(0.0, 1.0, 101)
_BEYOND = 1.5  # times the test's crush; nothing is known of scatter farther on


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
        """Draw differences between two tests at a condition over displacement, shape (n, displacement_m.size)."""
        none = np.zeros_like(displacement_m)
        rows = self._rows(BiasPoints(condition, displacement_m, np.ones_like(none), CaeForce(none, none)))
        prior = self.process_.prior_of({"even", "growing"}, rows)
        return draw(np.zeros(displacement_m.size), 2 * prior, n, rng)


class Scatter:
    """The scatter of tests, learned from all of a campaign; it draws pulses of repeats of a measured test.

    A repeat differs from a test by twice the variance of one. It learns from the test judged: no part of a prediction.
    """

    def __init__(self, config: DisplacementConfig | None = None, *, cache: Cache | None = None) -> None:
        self.config = DisplacementConfig() if config is None else config
        self.cache = cache

    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Learn from the tests of a campaign, two at least."""
        campaign = campaign.evenly_over_speed(MOST_TESTS)
        model = CaeModel(cache=self.cache).fit(campaign.cae, watch)
        views = [CaeView.of(model, test.condition) for test in campaign.tests]
        pairs = list(zip(campaign.tests, views, strict=True))
        with one_thread():
            self.bias_ = _ScatterBias().fit([self._points(test, view, len(pairs)) for test, view in pairs], watch)
            self.rebound_ = Rebound().fit([view.unloading(test) for test, view in pairs])
        return self

    def _points(self, test: CrashTest, view: CaeView, n_tests: int) -> BiasPoints:
        """The bias of a test before it stops: the scatter is one over displacement."""
        speed, end_share = test.condition.speed_mps, _ScatterBias.end_share
        phase = loading_phase(test.pulse.accel_mps2, speed)
        most = self.config.points_each(n_tests)
        points = uniform_points(test.condition, phase, view.curve, self.config.step_s, end_share, most)
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
