"""A sweep over speed is what each approach says at each speed; its range is one in which that makes sense."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import Cancelled, UsageError
from crashfuse.execution.progress import Progress, Watch
from crashfuse.signals.metrics import pulse_metrics
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.study.estimate import Fit
from crashfuse.study.sweep import Sweep, missing_over_speed, sweep_speed, uncovered_speeds, usual_speeds
from crashfuse.units import KPH, MPH, G

SPEEDS_MPS = np.array([15.0, 20.0, 30.0]) * MPH


@pytest.fixture(scope="module")
def fits(campaign: Campaign) -> list[Fit]:
    """The raw CAE, and an approach with a band."""
    return [Fit.of(campaign, name) for name in ("cae", "displacement_domain")]


@pytest.fixture(scope="module")
def sweeps(campaign: Campaign, fits: list[Fit]) -> tuple[Sweep, ...]:
    """At the weights of T2."""
    return sweep_speed(fits, campaign.test("T2").condition, SPEEDS_MPS)


def test_each_speed_is_what_approaches_say(campaign: Campaign, fits: list[Fit], sweeps: tuple[Sweep, ...]) -> None:
    """Value, interval and unit of every metric, at the weights and factors that were asked for."""
    for fit, sweep in zip(fits, sweeps, strict=True):
        assert sweep.approach == fit.approach.name
        for speed, metrics in zip(SPEEDS_MPS.tolist(), sweep.metrics, strict=True):
            assert metrics == fit.estimate(replace(campaign.test("T2").condition, speed_mps=speed)).metrics


def test_the_cae_sweep_is_the_closed_form(campaign: Campaign, sweeps: tuple[Sweep, ...]) -> None:
    """A half sine that throws the vehicle back at a tenth of v0: ΔV is 1.1 v0, the peak grows in proportion to v0."""
    cae = sweeps[0]
    delta_v = np.array([metric.value for metric in cae.over_speed("delta_v")], dtype=float)
    np.testing.assert_allclose(delta_v, 1.1 * SPEEDS_MPS / KPH, rtol=0.01)
    duration = 80e-3 * campaign.test("T2").condition.mass_kg / 1700
    peaks = np.array([metric.value for metric in cae.over_speed("peak")], dtype=float)
    # runs at these speeds have other weights, so their duration is the emulator's
    np.testing.assert_allclose(peaks, 1.1 * SPEEDS_MPS * np.pi / (2 * duration) / G, rtol=0.05)


def test_a_speed_that_is_none_is_refused(campaign: Campaign, fits: list[Fit]) -> None:
    """As anywhere else."""
    with pytest.raises(UsageError, match="speed and weights above 0"):
        sweep_speed(fits[:1], campaign.tests[0].condition, np.array([0.0, 9.0]))


def test_a_sweep_tells_how_far_it_is_and_can_be_cancelled(campaign: Campaign, fits: list[Fit]) -> None:
    """It ends before the next speed."""
    reports: list[Progress] = []
    sweep_speed(fits[:1], campaign.tests[0].condition, SPEEDS_MPS, Watch(reports.append))
    assert [report.done for report in reports] == [0, 1, 2, 3]
    cancel, seen = threading.Event(), []

    def stop(progress: Progress) -> None:
        seen.append(progress.done)
        if progress.done == 1:
            cancel.set()

    with pytest.raises(Cancelled, match="Sweep over speed"):
        sweep_speed(fits[:1], campaign.tests[0].condition, SPEEDS_MPS, Watch(stop, cancel))
    assert seen == [0, 1]


def test_measured_metrics_are_those_of_the_tests_pulse(campaign: Campaign) -> None:
    """A half sine of duration T peaks at T/2."""
    test = campaign.tests[0]
    times = {metric.name: metric.value for metric in campaign.metrics_of(test)}
    assert times["peak_time"] == pytest.approx(35 * test.condition.mass_kg / 1700, abs=0.1)


def test_the_usual_speeds_are_those_of_runs_and_tests_that_stop(campaign: Campaign) -> None:
    """Full mph between; ends where the data end; a crawl and a run that goes on and on are left out."""
    pulse = np.full(GRID_S.size, -400.0, dtype=np.float32)  # takes 40 m/s off in its 100 ms
    speeds = np.array([1.0, 7.3, 12.0, 28.4, 120.0])  # mph; the last is too fast to be stopped
    library = CaeLibrary(
        tuple("abcde"),
        tuple(Condition.of_vector([v * MPH, 900.0, 700.0]) for v in speeds.tolist()),
        np.tile(pulse, (5, 1)),
    )
    without = replace(campaign, cae=library, tests=())
    np.testing.assert_allclose(usual_speeds(without) / MPH, [7.3, *range(8, 29), 28.4])
    test = CrashTest("fast", Condition.of_vector([31 * MPH, 900.0, 700.0]), Pulse(GRID_S, pulse.astype(float)))
    assert usual_speeds(replace(without, tests=(test,)))[-1] == pytest.approx(31 * MPH)


def test_speeds_without_runs_are_found(campaign: Campaign) -> None:
    """Below, above, and between runs that are far apart; only within the range that is asked for."""
    speeds = [10.0, 12.0, 14.0, 20.0, 21.0]
    conditions = tuple(Condition.of_vector([v * MPH, 900.0, 700.0]) for v in speeds)
    library = CaeLibrary(tuple("abcde"), conditions, campaign.cae.accel_mps2[:5])
    found = np.array(uncovered_speeds(library, 8 * MPH, 30 * MPH)) / MPH
    np.testing.assert_allclose(found, [[8, 10], [14, 20], [21, 30]])
    np.testing.assert_allclose(np.array(uncovered_speeds(library, 15 * MPH, 20.5 * MPH)) / MPH, [[15, 20]])
    assert uncovered_speeds(library, 10 * MPH, 14 * MPH) == ()


def test_a_sentence_tells_where_numbers_are_missing_and_why(campaign: Campaign, sweeps: tuple[Sweep, ...]) -> None:
    """At 10 mph an occupant needs 0.535 m / v0 = 120 ms for the OLC's way, even if the vehicle stops dead."""
    condition, crawl = campaign.tests[0].condition, 10 * MPH
    late = pulse_metrics(np.where(GRID_S < 0.001, -crawl / 0.001, 0.0), crawl)
    sweep = Sweep("fused", condition, np.array([crawl, SPEEDS_MPS[2]]), (late, sweeps[0].metrics[2]))
    (sentence,) = missing_over_speed([sweep], "olc")
    assert sentence.startswith("Fused (1 of 2 speeds, from 10.0 to 10.0 mph): The record ends before the OLC's")
    assert missing_over_speed([sweep], "peak") == []
