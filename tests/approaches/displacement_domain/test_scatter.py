"""Repeats drawn from the scatter of tests: as far apart as tests are, and later in the crash farther."""

from dataclasses import replace

import numpy as np
import pytest

from crashfuse.approaches.displacement_domain.scatter import Scatter
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse, kinematics
from crashfuse.units import G


def scattered(campaign: Campaign, growing_g: float, seed: int = 0) -> Campaign:
    """Eight tests at two speeds, each with a deviation of its own that grows with crush to this many g at 0.5 m."""
    rng = np.random.default_rng(seed)
    tests = []
    for number in range(8):
        first = campaign.tests[1 if number % 2 else 3]
        crush = np.maximum.accumulate(first.pulse.kinematics(first.condition.speed_mps).displacement_m)
        waves = sum(
            rng.normal() * np.sin(2 * np.pi * crush / length + rng.uniform(0, 2 * np.pi))
            for length in (0.25, 0.35, 0.5)
        )
        own = growing_g * G * crush / 0.5 * np.sqrt(2 / 3) * waves
        accel = np.where(first.pulse.accel_mps2 < 0, first.pulse.accel_mps2 + own, 0.0)
        tests.append(CrashTest(f"R{number}", first.condition, Pulse(GRID_S, accel)))
    return replace(campaign, tests=tuple(tests))


@pytest.fixture(scope="module")
def fitted(campaign: Campaign) -> dict[float, tuple[Campaign, Scatter]]:
    """Three campaigns of known scatter."""
    campaigns = {growing: scattered(campaign, growing) for growing in (0.0, 1.5, 3.0)}
    return {growing: (own, Scatter().fit(own)) for growing, own in campaigns.items()}


def over_displacement(test: CrashTest, pulses: FloatArray, at_m: FloatArray) -> FloatArray:
    """Accelerations over displacement, shape (n_pulses, n)."""
    return np.array([loading_phase(pulse, test.condition.speed_mps).accel_at(at_m) for pulse in pulses])


def test_repeats_differ_as_much_as_two_tests_do(fitted: dict[float, tuple[Campaign, Scatter]]) -> None:
    """The difference of two tests has twice the variance of one test's deviation, and it grows with crush."""
    own, scatter = fitted[3.0]
    test = own.tests[0]
    at = np.array([0.1, 0.2, 0.3])
    drawn = over_displacement(test, scatter.repeats(test, 300, np.random.default_rng(0)), at)
    spread = np.sqrt(np.mean((drawn - test_at(test, at)) ** 2, axis=0)) / G
    np.testing.assert_allclose(spread, np.sqrt(2) * 3.0 * at / 0.5, rtol=0.45)
    assert spread[0] < spread[1] < spread[2]


def test_at(test: CrashTest, at_m: FloatArray) -> FloatArray:
    """The test's own acceleration over displacement."""
    return loading_phase(test.pulse.accel_mps2, test.condition.speed_mps).accel_at(at_m)


test_at.__test__ = False  # type: ignore[attr-defined] # a name that pytest would collect


def test_more_scatter_among_tests_is_more_scatter_of_repeats(fitted: dict[float, tuple[Campaign, Scatter]]) -> None:
    """Tests that agree draw repeats that agree; the estimate follows the scatter rather than the prior."""
    spreads = []
    for own, scatter in fitted.values():
        test = own.tests[0]
        drawn = scatter.repeats(test, 100, np.random.default_rng(0))
        spreads.append(float(np.sqrt(np.mean((drawn - test.pulse.accel_mps2) ** 2))) / G)
    assert spreads[0] < 0.4
    assert spreads[1] > 2 * spreads[0]
    assert spreads[2] == pytest.approx(2 * spreads[1], rel=0.35)


def test_a_repeat_takes_up_the_same_energy(fitted: dict[float, tuple[Campaign, Scatter]]) -> None:
    """Each is a motion from the test's impact speed to rest: the area over displacement is half the speed squared."""
    own, scatter = fitted[3.0]
    test = own.tests[0]
    speed = test.condition.speed_mps
    motion = kinematics(scatter.repeats(test, 20, np.random.default_rng(1)), speed, DT_S)
    assert np.isfinite(motion.t0_s).all()
    assert float(np.std(motion.displacement_m.max(axis=1))) > 1e-3
    for accel, t0 in zip(motion.accel_mps2, motion.t0_s, strict=True):
        phase = loading_phase(accel, speed)
        assert phase.end_s == pytest.approx(t0)
        area = -np.trapezoid(phase.accel_mps2, phase.displacement_m)
        assert area == pytest.approx(0.5 * speed**2, rel=5e-3)
