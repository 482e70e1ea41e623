"""A sweep is what approaches say at each speed; of a candidate is known what it would bring, and which is best."""

from dataclasses import replace

import numpy as np
import pytest

from crashfuse.approaches.displacement_domain.approach import DisplacementConfig, DisplacementDomain
from crashfuse.approaches.displacement_domain.bias import CaeStop
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import Cancelled, NotFittedError, UsageError
from crashfuse.execution.progress import Progress, Watch
from crashfuse.signals.metrics import pulse_metrics
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.study.estimate import Fit
from crashfuse.study.planning import (
    ConditionRange,
    NextTests,
    SpeedSweep,
    rank_next_tests,
    sweep_speed,
    uncovered_speeds,
    usual_speeds,
)
from crashfuse.units import KPH, LB, MPH, G
from tests.conftest import cancelled_after

SPEEDS_MPS = np.array([15.0, 20.0, 30.0]) * MPH


@pytest.fixture(scope="module")
def fits(campaign: Campaign) -> list[Fit]:
    return [Fit.of(campaign, name) for name in ("cae", "displacement_domain")]


@pytest.fixture(scope="module")
def sweep(campaign: Campaign, fits: list[Fit]) -> SpeedSweep:
    """At the weights of T2."""
    return sweep_speed(campaign, fits, campaign.test("T2").condition, SPEEDS_MPS)


def test_each_speed_is_what_approaches_say(campaign: Campaign, fits: list[Fit], sweep: SpeedSweep) -> None:
    for fit, (approach, at_speeds) in zip(fits, sweep.metrics.items(), strict=True):
        assert approach == fit.approach.name
        for speed, metrics in zip(SPEEDS_MPS.tolist(), at_speeds, strict=True):
            assert metrics == fit.estimate(replace(campaign.test("T2").condition, speed_mps=speed)).metrics


def test_the_cae_sweep_is_the_closed_form(campaign: Campaign, sweep: SpeedSweep) -> None:
    """A half sine that throws the vehicle back at a tenth of v0: ΔV is 1.1 v0, the peak grows in proportion to v0."""
    delta_v = np.array([metric.value for metric in sweep.over_speed("cae", "delta_v")], dtype=float)
    np.testing.assert_allclose(delta_v, 1.1 * SPEEDS_MPS / KPH, rtol=0.01)
    duration = 80e-3 * campaign.test("T2").condition.mass_kg / 1700
    peaks = np.array([metric.value for metric in sweep.over_speed("cae", "peak")], dtype=float)
    # runs at these speeds have other weights, so their duration is the emulator's
    np.testing.assert_allclose(peaks, 1.1 * SPEEDS_MPS * np.pi / (2 * duration) / G, rtol=0.05)


def test_a_speed_that_is_none_is_refused(campaign: Campaign, fits: list[Fit]) -> None:
    with pytest.raises(UsageError, match="speed and weights above 0"):
        sweep_speed(campaign, fits[:1], campaign.tests[0].condition, np.array([0.0, 9.0]))


def test_a_sweep_tells_how_far_it_is_and_can_be_cancelled(campaign: Campaign, fits: list[Fit]) -> None:
    reports: list[Progress] = []
    sweep_speed(campaign, fits[:1], campaign.tests[0].condition, SPEEDS_MPS, Watch(reports.append))
    assert [report.done for report in reports] == [0, 1, 2, 3]
    seen: list[Progress] = []
    watch = cancelled_after(lambda progress: progress.done == 1, seen)
    with pytest.raises(Cancelled, match="Sweep over speed"):
        sweep_speed(campaign, fits[:1], campaign.tests[0].condition, SPEEDS_MPS, watch)
    assert [report.done for report in seen] == [0, 1]


def test_the_usual_speeds_are_those_of_runs_and_tests_that_stop(campaign: Campaign) -> None:
    """Full mph between; ends where the data end; a crawl and a run that goes on and on are left out."""
    pulse = np.full(GRID_S.size, -400.0, dtype=np.float32)  # takes 40 m/s off in its 100 ms
    speeds = np.array([1.0, 7.3, 12.0, 28.4, 120.0])  # mph; the last is too fast to be stopped
    conditions = tuple(Condition.of_vector([v * MPH, 900.0, 700.0]) for v in speeds.tolist())
    without = replace(campaign, cae=CaeLibrary(tuple("abcde"), conditions, np.tile(pulse, (5, 1))), tests=())
    np.testing.assert_allclose(usual_speeds(without) / MPH, [7.3, *range(8, 29), 28.4])
    test = CrashTest("fast", Condition.of_vector([31 * MPH, 900.0, 700.0]), Pulse(GRID_S, pulse.astype(float)))
    assert usual_speeds(replace(without, tests=(test,)))[-1] == pytest.approx(31 * MPH)


def test_speeds_without_runs_are_found(campaign: Campaign) -> None:
    conditions = tuple(Condition.of_vector([v * MPH, 900.0, 700.0]) for v in [10.0, 12.0, 14.0, 20.0, 21.0])
    library = CaeLibrary(tuple("abcde"), conditions, campaign.cae.accel_mps2[:5])
    found = np.array(uncovered_speeds(library, 8 * MPH, 30 * MPH)) / MPH
    np.testing.assert_allclose(found, [[8, 10], [14, 20], [21, 30]])
    np.testing.assert_allclose(np.array(uncovered_speeds(library, 15 * MPH, 20.5 * MPH)) / MPH, [[15, 20]])
    assert uncovered_speeds(library, 10 * MPH, 14 * MPH) == ()


def test_a_sentence_tells_where_numbers_are_missing_and_why(sweep: SpeedSweep) -> None:
    """At 10 mph an occupant needs 0.535 m / v0 = 120 ms for the OLC's way, even if the vehicle stops dead."""
    crawl = 10 * MPH
    late = pulse_metrics(np.where(GRID_S < 0.001, -crawl / 0.001, 0.0), crawl)
    metrics = {"fused": (late, sweep.metrics["cae"][2])}
    late_at_first = replace(sweep, speeds_mps=np.array([crawl, SPEEDS_MPS[2]]), metrics=metrics)
    (sentence,) = late_at_first.missing("olc")
    assert sentence.startswith("Fused (1 of 2 speeds, from 10.0 to 10.0 mph): The record ends before the OLC's")
    assert late_at_first.missing("peak") == []


FEW = DisplacementConfig(n_draws=20)
RANGE = ConditionRange(
    Condition.of_vector([8 * MPH, 2000 * LB, 1450 * LB]), Condition.of_vector([36 * MPH, 2120 * LB, 1600 * LB])
)


def at(speed_mph: float) -> Condition:
    """A crash at this speed, with weights in the middle of the range."""
    return Condition.of_vector([speed_mph * MPH, 2060 * LB, 1525 * LB])


def braking(condition: Condition, decel_mps2: float) -> Pulse:
    return Pulse(GRID_S, np.where(condition.speed_mps / decel_mps2 > GRID_S, -decel_mps2, 0.0))


@pytest.fixture(scope="module")
def clustered(campaign: Campaign) -> Campaign:
    """The small campaign without its slow test: 25, 26 and 35 mph are left."""
    return campaign.without(["T1"])


@pytest.fixture(scope="module")
def domain(clustered: Campaign) -> DisplacementDomain:
    return DisplacementDomain(FEW).fit(clustered)


def test_no_test_widens_the_band_and_the_best_comes_first(domain: DisplacementDomain, clustered: Campaign) -> None:
    """Far and near, inside the range and outside: every gain is a share between 0 and 1, in falling order."""
    candidates = (*RANGE.grid(5, 2), at(3.0), at(60.0))
    ranking = rank_next_tests(clustered, domain, RANGE, candidates)
    gains = ranking.gains.tolist()
    assert set(ranking.conditions) == set(candidates)
    assert gains == sorted(gains, reverse=True)
    assert all(0 <= gain < 1 for gain in gains)


def test_a_repeat_gains_less_than_a_speed_that_was_not_tested(domain: DisplacementDomain, clustered: Campaign) -> None:
    """Tests at 25, 26 and 35 mph: none is better repeated than 15 mph tried, and the best of all is slower than 20."""
    repeats = [test.condition for test in clustered.tests]
    assert rank_next_tests(clustered, domain, RANGE, [*repeats, at(15.0)]).conditions[0] == at(15.0)
    assert rank_next_tests(clustered, domain, RANGE).conditions[0].speed_mps < 20 * MPH


def test_the_range_decides(domain: DisplacementDomain, clustered: Campaign) -> None:
    """Who cares for fast crashes only is sent to another speed than who cares for slow ones."""
    candidates = RANGE.grid(8, 1)
    slow, fast = (
        rank_next_tests(clustered, domain, ConditionRange(at(low), at(high)), candidates).conditions[0].speed_mps / MPH
        for low, high in ((8.0, 14.0), (29.0, 32.0))
    )
    assert slow <= 16
    assert 26 < fast < 36


def test_a_planned_test_counts_as_run(domain: DisplacementDomain, clustered: Campaign) -> None:
    """The band with the best one planned is what the best one promised, and the next is another speed."""
    first = rank_next_tests(clustered, domain, RANGE)
    best = first.conditions[0]
    then = rank_next_tests(clustered, domain, RANGE, planned=[best])
    assert then.before_mps2 == pytest.approx(first.after_mps2[0], rel=1e-6)
    assert then.gains[then.conditions.index(best)] < 0.5 * first.gains[0]
    assert then.conditions[0].speed_mps != best.speed_mps


def test_the_band_now_is_that_of_the_predictions(domain: DisplacementDomain, clustered: Campaign) -> None:
    """Half of what lies between the 2.5 % and 97.5 % quantiles of the bias that predictions draw."""
    low, high = at(20.0), replace(at(20.0), speed_mps=20.001 * MPH)
    now = rank_next_tests(clustered, domain, ConditionRange(low, high), [low]).before_mps2
    points = domain.expected_points(low)
    moving = points.speed_share > domain.bias_.end_share
    stopping = np.zeros(1)  # the two are drawn apart; the stop comes on top
    assert domain.calibration_.widening >= 1
    rng = np.random.default_rng(0)
    s, share = points.displacement_m, points.speed_share
    stop = CaeStop(np.append(share, stopping), np.zeros(s.size + 1), s[-1])
    drawn = domain.bias_.sample(replace(points, speed_share=np.ones_like(s)), stop, 6000, rng)
    total = drawn.over_displacement_mps2[1:] + drawn.over_speed_mps2[1:, : s.size]
    lower, upper = np.quantile(total, [0.025, 0.975], axis=0)
    assert moving.any()
    assert now == pytest.approx(domain.calibration_.widening * np.mean((upper - lower) / 2), rel=0.04)


def test_what_the_tests_showed_has_no_influence(domain: DisplacementDomain) -> None:
    assert isinstance(domain.bias_, HierarchicalBias)
    targets = [domain.expected_points(condition) for condition in RANGE.spread(4)]
    further = [domain.expected_points(condition) for condition in RANGE.grid(4, 1)]
    rng, learned = np.random.default_rng(0), domain.bias_.learned()
    others = [replace(p, bias_mps2=rng.normal(size=p.bias_mps2.size)) for p in domain.points_]
    shares = []
    for points in (domain.points_, others):
        now, then = HierarchicalBias().restore(points, learned).half_widths(targets, further)
        shares.append(then / now)
    np.testing.assert_allclose(shares[0], shares[1], rtol=1e-7)


def test_an_expected_test_lies_where_a_real_one_would(domain: DisplacementDomain, clustered: Campaign) -> None:
    """From contact to the CAE pulse's crush, as far apart as the points of a test at that condition, without bias."""
    test = clustered.tests[0]
    points, real = domain.expected_points(test.condition), domain.points_[0]
    run = clustered.cae.paired_run(test.condition)
    crush = Pulse(GRID_S, clustered.cae.accel_mps2[run]).kinematics(test.condition.speed_mps).displacement_m.max()
    assert points.displacement_m[-1] == pytest.approx(crush, rel=1e-3)
    assert np.diff(points.displacement_m)[0] == pytest.approx(np.diff(real.displacement_m)[0], rel=0.1)
    np.testing.assert_allclose(points.bias_mps2, 0, atol=1e-9)


def test_a_candidate_outside_the_cae_runs_is_flagged(domain: DisplacementDomain, clustered: Campaign) -> None:
    ranking = rank_next_tests(clustered, domain, RANGE, [at(20.0), at(50.0)])
    assert dict(zip(ranking.conditions, ranking.extrapolated, strict=True)) == {at(20.0): False, at(50.0): True}


def test_table_4_and_an_unfitted_approach_are_refused(clustered: Campaign) -> None:
    with pytest.raises(NotFittedError, match="fit"):
        rank_next_tests(clustered, DisplacementDomain(), RANGE)
    paper = DisplacementDomain(replace(DisplacementConfig.paper(), projected_points=4, restarts=0, n_draws=4))
    with pytest.raises(UsageError, match="fast"):
        rank_next_tests(clustered, paper.fit(clustered), RANGE)


@pytest.mark.slow
def test_a_factor_that_tells_tests_apart_must_be_given(campaign: Campaign) -> None:
    """Of two powertrains the range says which; a range made of tests takes the kind that was tested most."""
    speeds = (12.0, 18.0, 24.0, 30.0, 35.0)
    conditions = [replace(at(v), factors=(("powertrain", kind),)) for v, kind in zip(speeds, "ABABA", strict=True)]
    decels = [180.0 if condition.factors[0][1] == "A" else 220.0 for condition in conditions]
    tests = [CrashTest("", c, braking(c, decel)) for c, decel in zip(conditions, decels, strict=True)]
    runs = np.array([braking(c, 200.0).accel_mps2 for c in campaign.cae.conditions], np.float32)
    campaign = replace(campaign, cae=replace(campaign.cae, accel_mps2=runs), tests=tuple(tests))
    domain = DisplacementDomain(FEW).fit(campaign)
    over = ConditionRange.of(tests)
    assert over.low == tests[0].condition
    assert over.high == tests[-1].condition
    assert rank_next_tests(campaign, domain, over, over.grid(3, 1)).table["powertrain"].tolist() == ["A"] * 3
    with pytest.raises(UsageError, match="powertrain"):
        rank_next_tests(campaign, domain, RANGE)


def test_a_grid_has_the_limits_and_a_single_value_is_the_middle() -> None:
    """12 speeds by 3 × 3 weights; what is fixed is there once."""
    vectors = np.array([condition.vector for condition in RANGE.grid(4, 2)])
    assert len(vectors) == 16
    np.testing.assert_allclose(vectors.min(axis=0), RANGE.low.vector)
    np.testing.assert_allclose(vectors.max(axis=0), RANGE.high.vector)
    assert {c.front_weight_kg for c in RANGE.grid(4, 1)} == {2060 * LB}
    assert len(ConditionRange(at(10.0), at(20.0)).grid(3, 3)) == 3


def test_conditions_are_spread_evenly_over_the_range() -> None:
    """Every eighth of each axis has its share of 48, and they are always the same."""
    shares = np.array([c.vector for c in RANGE.spread(48)]) - RANGE.low.vector
    shares /= RANGE.high.vector - RANGE.low.vector
    counts = [np.histogram(axis, bins=8, range=(0, 1))[0] for axis in shares.T]
    assert np.min(counts) >= 4
    assert np.max(counts) <= 8
    assert RANGE.spread(5) == RANGE.spread(9)[:5]


def test_a_range_that_makes_no_sense_is_refused() -> None:
    for low, high in ((20.0, 10.0), (0.0, 10.0)):
        with pytest.raises(UsageError, match="range"):
            ConditionRange(at(low), at(high))
    with pytest.raises(UsageError, match="one kind"):
        ConditionRange(at(10.0), replace(at(20.0), factors=(("drive", "AWD"),)))
    with pytest.raises(UsageError, match="test"):
        ConditionRange.of([])


def test_the_figure_shows_the_gain_over_speed(clustered: Campaign) -> None:
    ranking = NextTests(clustered, RANGE, (at(12.0), at(50.0), at(20.0)), 4 * G, np.array([3.0, 3.5, 4.0]) * G)
    candidates, run = ranking.plot().data[:2]
    np.testing.assert_allclose(candidates.x, [12, 20, 50], rtol=1e-6)
    np.testing.assert_allclose(candidates.y, [25, 0, 12.5], atol=1e-5)
    assert candidates.text == ("1", "3", "2")
    assert candidates.marker.symbol == ("circle", "circle", "circle-open")
    assert "lines" in candidates.mode
    np.testing.assert_allclose(run.x, [25, 26, 35], rtol=1e-6)
    others = (at(12.0), at(50.0), replace(at(12.0), rear_weight_kg=700.0))
    assert "lines" not in replace(ranking, conditions=others).plot().data[0].mode
