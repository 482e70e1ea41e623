"""What a repeat would rate: on repeats whose ratings are known."""

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import Cancelled
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import DT_S, GRID_S, Pulse
from crashfuse.signals.rating import rate_many
from crashfuse.study.repeatability import combined, repeatability, repeats_of
from crashfuse.synthetic.sample import TABLE_1
from crashfuse.synthetic.specimens import CAE_MODEL, TRUTH, cae_pulses, measured_pulses
from crashfuse.units import LB, MPH

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
    """What was padded was not measured."""
    short = replace(campaign.tests[0], recorded_s=0.05)
    found = repeatability(replace(campaign, tests=(short, *campaign.tests[1:])), WINDOWS)
    assert set(found["T1"]) == {20.0}
    assert set(found["T2"]) == set(WINDOWS)


@pytest.mark.slow
def test_it_is_computed_once_and_can_be_cancelled(campaign: Campaign, tmp_path: Path) -> None:
    """A second call reads the same numbers from the cache."""
    stop = threading.Event()
    stop.set()
    with pytest.raises(Cancelled):
        repeatability(campaign, WINDOWS, cache=Cache(tmp_path), watch=Watch(lambda _: None, stop))
    first = repeatability(campaign, WINDOWS, cache=Cache(tmp_path))
    cache = Cache(tmp_path)
    assert repeatability(campaign, WINDOWS, cache=cache) == first
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
