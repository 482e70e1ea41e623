"""Faults of a sensor in a crash are found with their time and size, raw and filtered; sound records have none."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.sensor_faults import SensorFault, confirmed, sensor_faults
from crashfuse.units import MS, G
from tests.conftest import SHARED, needs_shared

RATES = [10_000, 12_500, 20_000]
Break = Callable[[FloatArray, FloatArray], FloatArray]


def crash(time_s: FloatArray, *, noise_g: float = 0.3) -> FloatArray:
    """A pulse with three humps, of 26 g at most, in m/s²."""
    t = time_s / MS
    humps = np.zeros_like(t)
    for size_g, at_ms, width_ms in ((14, 12, 9), (26, 42, 14), (16, 68, 10)):
        humps += size_g * np.exp(-(((t - at_ms) / width_ms) ** 2))
    accel: FloatArray = G * (np.random.default_rng(3).normal(0, noise_g, t.size) - humps)
    return accel


def held(time_s: FloatArray, accel: FloatArray) -> FloatArray:
    """The value at 50 ms stays for 5 ms."""
    within = (time_s >= 50 * MS) & (time_s < 55 * MS)
    return np.where(within, accel[within.argmax()], accel)


def spiked(time_s: FloatArray, accel: FloatArray) -> FloatArray:
    """60 g within one millisecond."""
    height: FloatArray = 60 * G * np.maximum(1 - np.abs(time_s / MS - 52) / 0.5, 0.0)
    return accel + height


def noisy(time_s: FloatArray, accel: FloatArray) -> FloatArray:
    """A cable that breaks at 40 ms."""
    return accel + (time_s >= 40 * MS) * np.random.default_rng(7).normal(0, 25 * G, time_s.size)


def found(change: Break | None, rate: int, *, filtered: bool, sign: int = 1) -> list[SensorFault]:
    """What a record shows alone, once it was broken and, perhaps, filtered with CFC 60 and rounded."""
    time_s = np.arange(-0.02, 0.15, 1 / rate)
    accel = crash(time_s) if change is None else change(time_s, crash(time_s))
    accel = np.round(cfc_filter(accel, cfc=60, dt_s=1 / rate), 3) if filtered else accel
    return [fault for fault in sensor_faults(time_s, sign * accel) if fault.strength >= 1]


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize(
    ("change", "kind", "start_ms", "end_ms", "size_g"),
    [
        (lambda _, accel: np.maximum(accel, -18 * G), "saturated", 33.5, 51.4, -18.0),
        (lambda time_s, accel: np.where(abs(time_s - 0.0525) < 0.0025, 0.0, accel), "lost", 50.0, 55.0, -18.0),
        (spiked, "spike", 52.0, 52.0, 57.0),
        (noisy, "noise", 40.0, 150.0, 25.0),
    ],
)
def test_a_fault_is_named_with_its_time_and_size(
    change: Break, kind: str, start_ms: float, end_ms: float, size_g: float, rate: int, *, filtered: bool
) -> None:
    """One fault, the right one; filtered, edges are known to 2 ms, and what CFC 60 took of spikes and noise is gone."""
    for sign in (1, -1):  # a file may write deceleration as positive numbers
        (fault,) = found(change, rate, filtered=filtered, sign=sign)
        assert fault.kind == kind
        assert fault.start_s / MS == pytest.approx(start_ms, abs=3.5 if kind == "noise" else 2.5)
        assert fault.end_s / MS == pytest.approx(end_ms, abs=2.5)
        if not (filtered and kind in ("spike", "noise")):
            assert abs(fault.size_mps2 / G) == pytest.approx(abs(size_g), rel=0.25)


@pytest.mark.parametrize("rate", RATES)
def test_a_value_that_is_held_or_lost_is_found_to_the_sample(rate: int) -> None:
    """Also where the gap itself ends the crash, between 15 % and 3 % of the peak."""
    time_s = np.arange(0, 0.1, 1 / rate)
    (fault,) = found(held, rate, filtered=False)
    (gap,) = sensor_faults(time_s, np.where((time_s >= 0.08) & (time_s < 0.085), 0.0, crash(time_s)))
    assert (fault.kind, gap.kind) == ("held", "lost")
    assert (fault.start_s, fault.end_s) == pytest.approx((0.05, 0.055), abs=2 / rate)
    assert (gap.start_s, gap.end_s) == pytest.approx((0.08, 0.085), abs=2 / rate)


@pytest.mark.parametrize("cfc", [60, 180])
def test_a_filtered_flat_top_is_saturated_where_rounding_makes_it_equal(cfc: int) -> None:
    """What the filter makes of its corners goes beyond it."""
    time_s = np.arange(-0.02, 0.15, 8e-5)
    accel = np.maximum(crash(time_s, noise_g=0.0), -20 * G)
    accel = np.round(cfc_filter(accel, cfc=cfc, dt_s=8e-5) / G, 3) * G
    (fault,) = sensor_faults(time_s, accel)
    assert (fault.kind, fault.strength > 1) == ("saturated", True)
    assert (fault.start_s, fault.end_s) == pytest.approx((0.0348, 0.0492), abs=2e-3)
    assert fault.size_mps2 == pytest.approx(-20 * G, rel=0.01)


@pytest.mark.parametrize(("rate", "cfc"), [(1_600, None), (12_500, 180)])
def test_noise_is_found_in_slow_records_and_after_a_wider_filter(rate: int, cfc: int | None) -> None:
    """What lies above CFC 60 counts, as far as the record goes."""
    time_s = np.arange(-0.02, 0.15, 1 / rate)
    accel = noisy(time_s, crash(time_s))
    accel = accel if cfc is None else cfc_filter(accel, cfc=cfc, dt_s=1 / rate)
    (fault,) = sensor_faults(time_s, accel)
    assert [fault.kind, fault.start_s] == ["noise", pytest.approx(0.04, abs=5e-3)]


@pytest.mark.parametrize("rate", [1_000, 1_600, *RATES])
@pytest.mark.parametrize("filtered", [False, True])
def test_a_sound_record_has_no_fault(rate: int, *, filtered: bool) -> None:
    """Noise, rounding and smooth humps are none, nor are a crash of nothing, and 1 kHz written at 12 kHz."""
    assert not found(None, rate, filtered=filtered)
    still, steps = np.zeros(rate // 10), np.repeat(crash(np.arange(-0.02, 0.15, 1e-3)), 12)
    assert not sensor_faults(np.arange(still.size) / rate, still)
    assert not any(fault.strength >= 1 for fault in sensor_faults(np.arange(steps.size) / 12_000, steps))


@pytest.mark.parametrize("cfc", [None, 60, 180])
@pytest.mark.parametrize("width_ms", [1.2, 2.0, 4.0])
def test_a_short_hump_of_the_structure_is_no_spike(width_ms: float, cfc: int | None) -> None:
    """What meets water or a stop brakes for 2 to 7 ms (at half height) and may do nothing else."""
    time_s = np.arange(0, 0.1, 1e-4)
    t = time_s / MS
    accel = -G * (8 * (1 - np.exp(-t / 3)) + 25 * np.exp(-(((t - 6) / width_ms) ** 2)))
    accel = accel if cfc is None else cfc_filter(accel, cfc=cfc, dt_s=1e-4)
    assert not any(fault.strength >= 1 for fault in sensor_faults(time_s, accel))


def test_a_spike_that_repeats_show_is_the_structure() -> None:
    """Most of them, whether a little earlier or not."""
    time_s = np.arange(0, 0.1, 1e-4)
    whole = crash(time_s)
    record, early = spiked(time_s, whole), spiked(time_s + 2e-3, whole)
    fault = SensorFault("spike", 0.052, 0.052, 57 * G, 2.0)
    assert confirmed([fault], time_s, record, record, [early, early, whole]) == ()
    assert confirmed([fault], time_s, record, whole, [early, whole, whole]) == (fault,)
    hump, fault = whole - 30 * G * np.exp(-(((time_s / MS - 52) / 2) ** 2)), replace(fault, size_mps2=-57 * G)
    assert confirmed([fault], time_s, hump + whole - record, hump, [hump] * 3) == (fault,)  # all show the hump alone


def test_noise_from_the_first_on_is_one_if_records_alike_are_quieter() -> None:
    """A raw record of a stiff car may be as noisy throughout; after some milliseconds of quiet, none is."""
    time_s, rng = np.arange(0, 0.1, 1e-4), np.random.default_rng(5)
    whole, (loud, other) = crash(time_s), crash(time_s) + rng.normal(0, 5 * G, (2, time_s.size))
    likely = sensor_faults(time_s, loud)
    assert [(fault.kind, fault.strength < 1) for fault in likely] == [("noise", True)]
    assert [fault.strength for fault in confirmed(likely, time_s, loud, whole, [whole, whole, other])] == [1]
    assert confirmed(likely, time_s, loud, whole, [other]) == confirmed(likely, time_s, loud, whole) == ()
    (late,) = sensor_faults(time_s, np.where(time_s < 7 * MS, whole, loud))
    assert (late.kind, late.strength > 1) == ("noise", True)


def test_noise_that_a_filter_left_is_seen_where_records_alike_are_calm() -> None:
    """From 30 ms on, 20 g at 1,667 samples a second, after CFC 60; what rings in all records, or once, is none."""
    time_s, rng = np.arange(0, 0.12, 6e-4), np.random.default_rng(11)

    def record(noise_g: float) -> FloatArray:
        broken = crash(time_s) + (time_s > 30 * MS) * rng.normal(0, noise_g * G, time_s.size)
        return cfc_filter(broken, cfc=60, dt_s=6e-4)

    noisy, calm, loud, event = record(20), [record(0.5), record(0.5)], [record(20), record(20)], record(0.5)
    event += 8 * G * np.exp(-(((time_s / MS - 87) / 3) ** 2))
    for accel, alike, kinds in ((noisy, calm, ["noise"]), (noisy, loud, []), (noisy, calm[:1], []), (event, calm, [])):
        faults = confirmed(sensor_faults(time_s, accel), time_s, accel, accel, alike)
        assert [fault.kind for fault in faults] == kinds


def test_a_likely_fault_is_one_if_other_records_do_not_show_it() -> None:
    """A flat top that all tests have is the structure; one that hides a peak of the others is the sensor."""
    time_s = np.arange(0, 0.1, 1e-4)
    whole = crash(time_s, noise_g=0.0)
    cut = np.maximum(whole, -18 * G)
    likely = SensorFault("saturated", 0.034, 0.05, -18 * G, 0.6)
    assert confirmed([likely], time_s, cut, whole)[0].strength == 1
    assert confirmed([likely], time_s, cut, cut) == ()
    sure = SensorFault("saturated", 0.034, 0.05, -18 * G, 2.0)
    assert confirmed([sure], time_s, cut, cut) == (sure,)


@needs_shared
def test_measured_and_simulated_records_are_sound() -> None:
    """A real car, raw and at CFC 60, and measured impacts."""
    table = pd.read_csv(SHARED / "real" / "nhtsa_10146_camry2018" / "tidy_10kHz_raw_and_cfc60.csv")
    records = [(table["t_s"], table[name]) for name in table.columns[1:]]
    impacts = map(pd.read_csv, (SHARED / "real" / "impacts").glob("*/tests/*.csv"))
    records += [(record["time_ms"] * MS, record["acceleration_g"]) for record in impacts]
    assert len(records) > 50
    assert not any(
        fault.strength >= 1 for time, accel in records for fault in sensor_faults(time.to_numpy(), accel.to_numpy() * G)
    )
