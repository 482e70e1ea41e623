"""Pulse metrics against closed forms, and against a real car."""

import numpy as np
import pytest

from crashfuse.campaign_folder.load import load_campaign
from crashfuse.errors import DataError
from crashfuse.signals.metrics import (
    MAIN_METRICS,
    METRIC_LABELS,
    METRIC_NEEDS,
    Metric,
    checked_metrics,
    metric_values,
    missing_sentences,
    pulse_metrics,
)
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, checked_pulse
from crashfuse.units import KPH, MPH, G
from tests.golden import assert_golden

NAMES = ["peak", "peak_time", "delta_v", "t0", "max_crush", "mean", "sm25", "olc", "vpi"]
STOPPED = ("zero velocity", "the vehicle has left the barrier")
REBOUND = ["static_crush", "rebound_velocity", "restitution"]
DURATION_S = 0.08
PEAK_MPS2 = 40 * G
DELTA_V_MPS = 2 * PEAK_MPS2 * DURATION_S / np.pi
HALF_SINE = np.where(GRID_S < DURATION_S, -PEAK_MPS2 * np.sin(np.pi * GRID_S / DURATION_S), 0.0)


def by_name(metrics: tuple[Metric, ...]) -> dict[str, Metric]:
    return {metric.name: metric for metric in metrics}


def test_half_sine_has_its_closed_form_metrics() -> None:
    """Peak A at T/2; ΔV 2 A T/π with rebound; t0 and crush from v(t) = v0 − ΔV/2 (1 − cos(π t/T)); SM25 around T/2."""
    speed = 0.9 * DELTA_V_MPS
    angle = np.arccos(1 - 2 * speed / DELTA_V_MPS)
    t0_s = DURATION_S / np.pi * angle
    crush_m = (speed - DELTA_V_MPS / 2) * t0_s + DELTA_V_MPS * DURATION_S / (2 * np.pi) * np.sin(angle)
    found = by_name(pulse_metrics(HALF_SINE, speed))
    expected = {
        "peak": (40, 1e-9, "g"),
        "peak_time": (40, 0.04, "ms"),
        "delta_v": (DELTA_V_MPS / KPH, 1e-3, "km/h"),
        "t0": (t0_s * 1e3, 1e-3, "ms"),
        "max_crush": (crush_m * 1e3, 1e-2, "mm"),
        "mean": (speed / t0_s / G, 1e-3, "g"),
        "sm25": (DELTA_V_MPS * np.sin(np.pi * 0.0125 / DURATION_S) / 0.025 / G, 1e-3, "g"),
    }
    assert list(found) == list(METRIC_LABELS)
    assert list(found)[: len(NAMES)] == NAMES
    assert list(MAIN_METRICS) == NAMES
    for name, (value, tolerance, unit) in expected.items():
        assert found[name].value == pytest.approx(value, abs=tolerance)
        assert (found[name].lower, found[name].upper, found[name].unit) == (None, None, unit)


def test_step_of_time_does_not_matter() -> None:
    """At other rates, where 25 ms are an even or odd number of steps or end between two, the metrics are the same."""
    reference = by_name(pulse_metrics(HALF_SINE, 15.0))
    for rate_hz in (10_000, 50_000, 50_040, 50_060):
        time = np.arange(rate_hz // 10) / rate_hz
        pulse = np.where(time < DURATION_S, -PEAK_MPS2 * np.sin(np.pi * time / DURATION_S), 0.0)
        for metric in pulse_metrics(pulse, 15.0, dt_s=1 / rate_hz):
            at_a_sample = dict.fromkeys(("g1", "g2", "step_time"), 1e-2) | dict.fromkeys(REBOUND, 1e-3)
            tolerance = at_a_sample.get(metric.name, 2e-4)
            assert metric.value == pytest.approx(reference[metric.name].value, rel=tolerance), metric.name


def test_vehicle_that_does_not_stop_has_no_t0_and_no_crush() -> None:
    """Too little braking: peak and ΔV are there; t0, maximum crush and mean are None, and nothing is NaN."""
    found = by_name(checked_metrics(HALF_SINE, 1.5 * DELTA_V_MPS))
    missing = [name for name in METRIC_LABELS if found[name].value is None]
    assert missing == [name for name, needs in METRIC_NEEDS.items() if needs in STOPPED]
    assert {"t0", "max_crush", "mean", *REBOUND} < set(missing)
    assert found["delta_v"].value == pytest.approx(DELTA_V_MPS / KPH, abs=1e-3)


@pytest.mark.parametrize(
    ("speed", "dt_s", "meant"),
    [
        (0.95 * DELTA_V_MPS / MPH, DT_S, "mph are"),
        (0.95 * DELTA_V_MPS / KPH, DT_S, "km/h are"),
        (0.8 * DELTA_V_MPS / MPH, DT_S, "mph are"),  # rebounds
        (0.8 * DELTA_V_MPS / KPH, DT_S, "km/h are"),
        (1.3 * DELTA_V_MPS, DT_S, "took away 77 % of the impact speed"),
        (130.0, DT_S, "130 km/h are 36.11 m/s"),
        (15.0, 0.08, "0.08 ms are 8e-05 s"),
        (-15.0, DT_S, "a number above 0"),
        (15.0, 0.0, "a time step above 0"),
    ],
)
def test_a_speed_or_step_in_another_unit_is_refused_with_the_likely_one(speed: float, dt_s: float, meant: str) -> None:
    """A vehicle that goes on at half its speed once the crash is over was not in a barrier test."""
    with pytest.raises(DataError, match=meant):
        pulse_metrics(HALF_SINE, speed, dt_s=dt_s)


def test_a_unit_is_told_by_any_test_of_the_sample() -> None:
    """A record that goes on when the crash is over, noise and rebound included."""
    for test in load_campaign("sample_data").tests:
        accel, speed = test.pulse.accel_mps2, test.condition.speed_mps
        checked_pulse(accel, speed, DT_S, None)
        for pulse, v0, meant in (
            (accel, speed / MPH, "mph are"),
            (accel, speed / KPH, "km/h are"),
            (accel / G, speed, "in g"),
        ):
            with pytest.raises(DataError, match=meant):
                checked_pulse(pulse, v0, DT_S, None)


def scaled_draws(low: float, high: float, n: int = 1001) -> FloatArray:
    """Half sines with evenly spread factors, shuffled, shape (n, 1250)."""
    return np.asarray(np.multiply.outer(np.random.default_rng(0).permutation(np.linspace(low, high, n)), HALF_SINE))


def test_interval_is_the_central_95_percent_of_the_draws() -> None:
    """Draws whose peaks are even from 36 to 44 g have 95 % of them from 36.2 to 43.8 g; the value is the pulse's."""
    found = by_name(pulse_metrics(HALF_SINE, 15.0, draws_mps2=scaled_draws(0.9, 1.1)))
    assert (found["peak"].value, found["peak"].lower, found["peak"].upper) == pytest.approx((40, 36.2, 43.8))
    assert found["delta_v"].lower == pytest.approx(0.905 * DELTA_V_MPS / KPH, abs=1e-3)
    stiff, soft = (by_name(pulse_metrics(f * HALF_SINE, 15.0))["max_crush"].value for f in (1.095, 0.905))
    assert (found["max_crush"].lower, found["max_crush"].upper) == pytest.approx((stiff, soft))  # runs against it


@pytest.mark.parametrize(("share", "known"), [(0.02, True), (0.05, False), (1.0, False)])
def test_draws_that_do_not_stop_count_as_beyond_the_record(share: float, known: bool) -> None:
    """Up to one draw in forty may run on; with more, the upper end of t0 and crush is unknown, not smaller."""
    n = 1000
    factors = np.where(np.arange(n) < share * n, 0.1, 1.0)
    found = by_name(pulse_metrics(HALF_SINE, 15.0, draws_mps2=np.multiply.outer(factors, HALF_SINE)))
    for name in ("t0", "max_crush"):
        assert found[name].value is not None
        assert (found[name].upper is not None) == known
        assert (found[name].lower is not None) == (share < 1)
    assert (found["mean"].lower is not None) == known
    assert (found["mean"].upper is not None) == (share < 1)


def test_draws_nearly_at_rest_at_the_end_of_the_record_leave_no_end_open() -> None:
    """Constant braking at 135 to 145 m/s² from 15 m/s: no pulse stops, yet both ends follow from what is left."""
    rates = np.linspace(135.0, 145.0, 41)
    draws = np.outer(-rates, np.ones(GRID_S.size))
    found = by_name(pulse_metrics(draws[20], 15.0, draws_mps2=draws))
    crush = 15.0**2 / (2 * rates) + (15.0 - rates * GRID_S[-1]) ** 2 / (2 * rates)
    assert found["max_crush"].value is None
    assert (found["max_crush"].lower, found["max_crush"].upper) == pytest.approx((1e3 * crush[39], 1e3 * crush[1]))
    assert all(None not in (found[n].lower, found[n].upper) for n in ("t0", "mean", "esw", "centroid_time", "g2"))
    assert all((found[n].lower, found[n].upper) == (None, None) for n in REBOUND)


def slow_draws(duration_s: float) -> FloatArray:
    """Half sines that take 1.1 times 9 m/s away in 50 to 90 ms, shape (401, n), over a record of some duration."""
    time = np.arange(round(duration_s / DT_S)) * DT_S
    duration = np.random.default_rng(0).permutation(np.linspace(0.05, 0.09, 401))[:, None]
    peak = 1.1 * 9 * np.pi / (2 * duration)
    draws: FloatArray = np.where(time < duration, -peak * np.sin(np.pi * time / duration), 0.0)
    return draws


def test_draws_that_are_too_short_for_the_olc_leave_only_its_lower_end_open() -> None:
    """Within 100 ms all move freely, within 85 ms the soft ones do not yet, and count as smaller."""
    whole, left, cut = (
        by_name(pulse_metrics(draws[0], 9.0, draws_mps2=draws))["olc"] for draws in map(slow_draws, (0.2, 0.1, 0.085))
    )
    assert whole.lower is not None
    assert (left.lower, left.upper) == pytest.approx((whole.lower, whole.upper), rel=1e-6)
    assert cut.lower is None
    assert cut.upper == pytest.approx(whole.upper, rel=1e-6)


def test_a_vehicle_that_rings_when_the_record_ends_has_the_olc_of_its_mean_velocity() -> None:
    """Ringing −A exp(−t/τ) sin ωt takes A ω/(ω² + 1/τ²) in all, 5 cm/s here; at 6 m/s the OLC takes until 114 ms."""
    size, omega, tau = 10 * G, 2 * np.pi * 300, 0.04
    time = np.arange(2 * GRID_S.size) * DT_S
    since = np.maximum(time - 0.055, 0.0)
    ringing = -size * np.exp(-since / tau) * np.sin(omega * since)
    half_sine = np.where(time < 0.06, -np.pi / 0.12 * np.sin(np.pi * time / 0.06), 0.0)  # takes 1 m/s
    found = metric_values((6.6 * half_sine + ringing)[: GRID_S.size], 6.0)
    expected = metric_values((6.6 + size * omega / (omega**2 + 1 / tau**2)) * half_sine, 6.0)
    assert found["rebound_velocity"] == np.inf
    assert found["olc"] == pytest.approx(float(expected["olc"]), rel=5e-3)


def test_what_is_missing_is_said_with_its_reason() -> None:
    """One sentence for each thing that records or draws are too short for, with the pulses that lack it."""
    whole, short = (pulse_metrics(HALF_SINE[:n], 15.0) for n in (1250, 300))
    draws = slow_draws(0.085)
    drawn = pulse_metrics(draws[draws.min(axis=1).argmin()], 9.0, draws_mps2=draws)
    assert_golden("missing_metrics", missing_sentences([("Test", short), ("CAE", whole), ("LF", short), ("MF", drawn)]))


@pytest.mark.parametrize(
    ("metric", "text"),
    [
        (Metric("t0", 70.04, 68.0, 72.0, "ms"), "70.0 [68.0, 72.0] ms"),
        (Metric("olc", 3.41, None, None, "g"), "3.4 g"),
        (Metric("olc", 3.41, None, None, "g", drawn=True), "3.4 [open] g"),
        (Metric("t0", 70.0, 68.0, None, "ms"), "70.0 [≥ 68.0] ms"),
        (Metric("olc", 30.0, None, 31.2, ""), "30.00 [≤ 31.20]"),
        (Metric("olc", None, None, 31.2, "g"), "≤ 31.2 g (95 %, record too short)"),
        (Metric("max_crush", None, 200.0, 260.0, "mm"), "200.0–260.0 mm (95 %, record too short)"),
        (Metric("olc", None, None, None, "g"), "–"),
    ],
)
def test_a_metric_reads_as_value_and_interval(metric: Metric, text: str) -> None:
    """Where there is no value, what is known of the interval stands with its level; without draws, no brackets do."""
    assert metric.text_with_unit == text


def test_an_interval_of_which_one_end_is_known_holds_what_is_on_its_side() -> None:
    ends = ((1.0, 2.0), (None, 2.0), (None, None))
    known, half, unknown = (Metric("peak", None, lower, upper, "g") for lower, upper in ends)
    assert [known.holds(value) for value in (0.9, 1.0, 2.1)] == [False, True, False]
    assert half.holds(-1.0)
    assert unknown.holds(1.0) is None
    assert known.holds(None) is None
