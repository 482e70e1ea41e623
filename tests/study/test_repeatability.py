"""Repeatability: what repeats of a test would rate, and the scatter that they are drawn with."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import Cancelled
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse, kinematics
from crashfuse.signals.rating import rate_many
from crashfuse.study.repeatability import Scatter, combined, repeatability, repeats_of
from crashfuse.synthetic.sample import TABLE_1
from crashfuse.synthetic.vehicle import CAE_MODEL, TRUTH, cae_pulses, measured_pulses
from crashfuse.units import LB, MPH, G
from tests.conftest import cancelled_after

WINDOWS = (20.0, 60.0)


@pytest.fixture(autouse=True)
def few_draws() -> None:
    """None here: what is drawn is tested."""


def test_drawn_repeats_alone_rate_as_drawn() -> None:
    """Without real repeats the value is one minus the mean lack, and the interval is that of a log-normal."""
    drawn = np.exp(np.random.default_rng(0).normal(np.log(0.08), 0.3, 4000))
    value, lower, upper = combined(drawn, np.empty(0), unknown=0.4**2)
    assert value == pytest.approx(1 - 0.08 * np.exp(0.3**2 / 2), abs=1e-3)
    assert lower == pytest.approx(1 - 0.08 * np.exp(1.96 * 0.5), abs=5e-3)
    assert upper == pytest.approx(1 - 0.08 * np.exp(-1.96 * 0.5), abs=5e-3)


def test_real_repeats_count_the_more_the_more_there_are() -> None:
    """With none the draws decide, with very many the repeats; between, the value moves and the interval narrows."""
    drawn = np.exp(np.random.default_rng(0).normal(np.log(0.08), 0.3, 1000))
    found = [combined(drawn, np.full(n, 0.2), unknown=0.3**2) for n in (0, 1, 3, 1000)]
    values, widths = [value for value, _, _ in found], [np.log((1 - low) / (1 - high)) for _, low, high in found]
    assert values == sorted(values, reverse=True)
    assert widths == sorted(widths, reverse=True)
    assert values[1] == pytest.approx(1 - np.exp(0.5 * np.log(0.08 * 0.2) + 0.3**2 / 2), abs=3e-3)  # half and half
    assert values[3] == pytest.approx(1 - 0.2 * np.exp(0.3**2 / 2), abs=3e-3)
    assert widths[3] == pytest.approx(2 * 1.96 * 0.3, rel=0.05)


def test_fewer_tests_say_less() -> None:
    """The more is unknown the wider, and never outside 0 to 1."""
    drawn = np.exp(np.random.default_rng(0).normal(np.log(0.3), 0.3, 1000))
    _, lower, upper = combined(drawn, np.empty(0), unknown=1.0)
    assert 0.0 == lower < upper < 1.0


def test_a_repeat_is_a_test_at_about_the_same_condition_of_the_same_kind(campaign: Campaign) -> None:
    """Speed and mass within 2 %, and equal factors; a test is no repeat of itself."""
    first = campaign.tests[3]

    def another(
        name: str, speed: float = 1.0, weight: float = 1.0, factors: tuple[tuple[str, str], ...] | None = None
    ) -> CrashTest:
        v, front, rear = first.condition.vector.tolist()
        own = first.condition.factors if factors is None else factors
        return CrashTest(name, Condition.of_vector([speed * v, weight * front, weight * rear], own), first.pulse)

    tests = (
        first,
        another("same"),
        another("near", 1.019, 0.981),
        another("faster", 1.021),
        another("heavier", 1.0, 1.021),
        another("other", factors=(("drive", "AWD"),)),
    )
    assert [test.id for test in repeats_of(first, replace(campaign, tests=tests))] == ["same", "near"]


@pytest.mark.slow
def test_one_test_says_nothing_about_repeats(campaign: Campaign) -> None:
    """Neither does a campaign of none; two give a value with a wide interval."""
    assert repeatability(replace(campaign, tests=campaign.tests[:1]), WINDOWS) == {}
    two = repeatability(replace(campaign, tests=campaign.tests[2:]), WINDOWS)["T3"][60.0]
    four = repeatability(campaign, WINDOWS)["T3"][60.0]
    assert np.log((1 - two.lower) / (1 - two.upper)) > 1.2 * np.log((1 - four.lower) / (1 - four.upper))


def test_a_window_beyond_the_record_has_no_value(campaign: Campaign) -> None:
    short = replace(campaign.tests[0], recorded_s=0.05)
    found = repeatability(replace(campaign, tests=(short, *campaign.tests[1:])), WINDOWS)
    assert set(found["T1"]) == {20.0}
    assert set(found["T2"]) == set(WINDOWS)


@pytest.mark.slow
def test_it_is_computed_once_and_can_be_cancelled(campaign: Campaign, tmp_path: Path) -> None:
    with pytest.raises(Cancelled):
        repeatability(campaign, WINDOWS, run=Run(Cache(tmp_path), cancelled_after(lambda _: True)))
    first = repeatability(campaign, WINDOWS, run=Run(Cache(tmp_path)))
    cache = Cache(tmp_path)
    assert repeatability(campaign, WINDOWS, run=Run(cache)) == first
    assert {name.split("/")[0] for name in cache.used} == {"repeatability"}


@pytest.mark.slow
def test_simulated_vehicles_repeat_as_estimated(campaign: Campaign) -> None:
    """Eleven tests of the sample's vehicle: the mean within 0.02 of real repeats, most of which lie inside."""
    conditions = [Condition.of_vector([v * MPH, front * LB, rear * LB]) for v, front, rear, *_ in TABLE_1]
    runs = cae_pulses(conditions).astype(np.float32)
    library = replace(
        campaign.cae, ids=tuple(f"C{i}" for i in range(len(runs))), conditions=tuple(conditions), accel_mps2=runs
    )
    assert CAE_MODEL != TRUTH
    tests = [
        CrashTest(f"T{i}", condition, Pulse(GRID_S, accel))
        for i, (condition, accel) in enumerate(zip(conditions, measured_pulses(conditions, 5), strict=True))
    ]
    found = repeatability(Campaign("Lumped", library, tuple(tests)), (60.0,))
    n = round(0.06 / DT_S)
    again = [measured_pulses(conditions, seed) for seed in range(20, 28)]
    errors, inside = [], []
    for number, test in enumerate(tests):
        repeats = np.array([pulses[number, :n] for pulses in again])
        rated = np.array([rating.overall for rating in rate_many(test.pulse.accel_mps2[:n], repeats, dt_s=DT_S)])
        own = found[test.id][60.0]
        errors.append(own.value - rated.mean())
        inside.append(np.mean((rated >= own.lower) & (rated <= own.upper)))
    assert abs(np.mean(errors)) < 0.02
    assert np.mean(inside) > 0.85


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
    campaigns = {growing: scattered(campaign, growing) for growing in (0.0, 1.5, 3.0)}
    return {growing: (own, Scatter().fit(own, Run())) for growing, own in campaigns.items()}


def over_displacement(test: CrashTest, pulses: FloatArray, at_m: FloatArray) -> FloatArray:
    return np.array([loading_phase(pulse, test.condition.speed_mps).accel_at(at_m) for pulse in pulses])


def test_repeats_differ_as_much_as_two_tests_do(fitted: dict[float, tuple[Campaign, Scatter]]) -> None:
    """The difference of two tests has twice the variance of one test's deviation, and it grows with crush."""
    own, scatter = fitted[3.0]
    test = own.tests[0]
    at = np.array([0.1, 0.2, 0.3])
    drawn = over_displacement(test, scatter.repeats(test, 300, np.random.default_rng(0)), at)
    spread = np.sqrt(np.mean((drawn - accel_at(test, at)) ** 2, axis=0)) / G
    np.testing.assert_allclose(spread, np.sqrt(2) * 3.0 * at / 0.5, rtol=0.45)
    assert spread[0] < spread[1] < spread[2]


def accel_at(test: CrashTest, at_m: FloatArray) -> FloatArray:
    return loading_phase(test.pulse.accel_mps2, test.condition.speed_mps).accel_at(at_m)


def test_more_scatter_among_tests_is_more_scatter_of_repeats(fitted: dict[float, tuple[Campaign, Scatter]]) -> None:
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
