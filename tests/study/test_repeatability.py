"""Repeatability: what repeats of a test would rate, and the scatter that they are drawn with."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

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


def lacking(middle: float, spread: float = 0.3) -> FloatArray:
    """What a thousand drawn ratings lack to 1: exactly log-normal."""
    return np.asarray(middle * np.exp(spread * norm.ppf((np.arange(1000) + 0.5) / 1000)))


def test_without_any_repeat_real_ones_may_lack_far_less_than_drawn_ones() -> None:
    """The value is one minus the mean lack; up the interval is that of all that is unknown, down of scatter alone."""
    few = (2 / 11) ** 2
    value, lower, upper = combined(lacking(0.08), np.empty(0), (), 11)
    assert value == pytest.approx(1 - 0.08 * np.exp(0.3**2 / 2), abs=1e-4)
    assert lower == pytest.approx(1 - 0.08 * np.exp(1.96 * np.sqrt(0.3**2 + 0.25 + few)), abs=1e-3)
    assert upper == pytest.approx(1 - 0.08 * np.exp(-1.96 * np.sqrt(0.3**2 + 0.5 + few + 1)), abs=1e-3)


def test_repeats_decide_of_the_test_and_elsewhere_as_far_as_conditions_are_alike() -> None:
    """Many here: their mean and scatter. Many at another condition: the same, uncertain by what conditions differ."""
    drawn, measured = lacking(0.08, 0.2), lacking(0.02).repeat(1000)
    here = combined(drawn, measured, (), 10**9)
    assert here == pytest.approx([1 - 0.02 * np.exp(e) for e in (0.02, 1.96 * 0.3, -1.96 * 0.3)], abs=1e-3)
    there = combined(drawn, np.empty(0), [(2 * drawn, 0.04 * np.exp([-0.3 / 2**0.5, 0.3 / 2**0.5]))] * 10**5, 10**9)
    reach = 1.96 * np.sqrt(0.3**2 + 0.5**2)
    assert there == pytest.approx([1 - 0.02 * np.exp(e) for e in (0.02, reach, -reach)], abs=1e-3)
    assert combined(drawn, measured, [(drawn, drawn[:9])] * 9, 11) == pytest.approx(here, abs=1e-3)


def test_the_estimate_is_the_joint_gaussian_posterior() -> None:
    """By NumPy's linear algebra: a shift of all, one of each condition, the mean of each condition's ratings."""
    drawn, few, scatter = lacking(0.08), (2 / 6) ** 2, 0.3**2 * 4 / 7  # 4 that scatter as drawn, 3 that do not
    offsets, counts = np.array([-0.9, -0.2, 0.4]), np.array([2, 1, 3])  # the last is the condition's own
    noise = scatter / counts + np.array([*counts[:2] * 0.5**2 + scatter, 0.0])  # a pair's tests say the same
    latent = np.full((3, 3), 0.5**2 + few) + 0.5**2 * np.eye(3)
    gain = np.linalg.solve(latent + np.diag(noise), latent[:, 2])
    unknown, shift = latent[2, 2] - gain @ latent[:, 2], gain @ offsets
    pairs = [(drawn, np.full(n, 0.08 * np.exp(offset))) for n, offset in zip(counts, offsets, strict=True)]
    found = combined(drawn, pairs[2][1], pairs[:2], 6)
    ends = (0.3**2 / 2, *(side * 1.96 * np.sqrt(scatter + unknown) for side in (1, -1)))
    assert found == pytest.approx([1 - 0.08 * np.exp(shift + end) for end in ends], abs=1e-3)


def test_a_repeat_is_a_test_at_about_the_same_condition_of_the_same_kind(campaign: Campaign) -> None:
    """Speed and mass within 2 %, and equal factors; a test is no repeat of itself."""
    first, drive = campaign.tests[3], (("drive", "AWD"),)
    mine = first.condition
    cases = {"same": (1.0, 1.0), "near": (1.019, 0.981), "faster": (1.021, 1.0), "heavier": (1.0, 1.021)}
    moved = {name: Condition.of_vector(mine.vector * [v, m, m], mine.factors) for name, (v, m) in cases.items()}
    moved["other"] = replace(mine, factors=drive)
    tests = (first, *(replace(first, id=name, condition=condition) for name, condition in moved.items()))
    assert [test.id for test in repeats_of(first, replace(campaign, tests=tests))] == ["same", "near"]


@pytest.mark.slow
def test_one_test_says_nothing_about_repeats(campaign: Campaign) -> None:
    """Neither does a campaign of none; two give a value with a wide interval."""
    assert repeatability(replace(campaign, tests=campaign.tests[:1]), WINDOWS) == {}
    two = repeatability(replace(campaign, tests=campaign.tests[2:]), WINDOWS)["T3"][60.0]
    four = repeatability(campaign, WINDOWS)["T3"][60.0]
    assert np.log((1 - two.lower) / (1 - two.upper)) > 1.1 * np.log((1 - four.lower) / (1 - four.upper))


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
    ids, runs = tuple(f"T{i}" for i in range(11)), cae_pulses(conditions).astype(np.float32)
    library = replace(campaign.cae, ids=ids, conditions=tuple(conditions), accel_mps2=runs)
    assert CAE_MODEL != TRUTH
    tests = tuple(map(CrashTest, ids, conditions, (Pulse(GRID_S, accel) for accel in measured_pulses(conditions, 5))))
    found = repeatability(Campaign("Lumped", library, tests), (60.0,))
    n, errors, inside = round(0.06 / DT_S), [], []
    again = np.array([measured_pulses(conditions, seed)[:, :n] for seed in range(20, 28)])
    for number, test in enumerate(tests):
        ratings = rate_many(test.pulse.accel_mps2[:n], again[:, number], dt_s=DT_S)
        rated, own = np.array([rating.overall for rating in ratings]), found[test.id][60.0]
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
        shift = {length: rng.uniform(0, 2 * np.pi) for length in (0.25, 0.35, 0.5)}
        waves = sum(rng.normal() * np.sin(2 * np.pi * crush / length + by) for length, by in shift.items())
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
    at = np.array([0.1, 0.2, 0.3])
    for growing, (own, scatter) in fitted.items():
        test = own.tests[0]
        drawn = over_displacement(test, scatter.repeats(test, 300, np.random.default_rng(0)), at)
        measured = loading_phase(test.pulse.accel_mps2, test.condition.speed_mps).accel_at(at)
        spread = np.sqrt(np.mean((drawn - measured) ** 2, axis=0)) / G
        np.testing.assert_allclose(spread, np.sqrt(2) * growing * at / 0.5, rtol=0.45, atol=0.0 if growing else 0.4)
        assert not growing or spread[0] < spread[1] < spread[2]


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
