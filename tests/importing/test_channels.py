"""Which channels are averaged: those that agree in time, shape and change of velocity, and that the file speaks for."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from crashfuse.errors import DataError
from crashfuse.importing import Choices, Settled, import_source, read_records, settle
from crashfuse.importing.campaign_import import Label, parts_of
from crashfuse.importing.ratings import rate_channels
from crashfuse.importing.sources import Reading
from crashfuse.readers.isomme import Channel, IsommeTest, record_of
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel
from crashfuse.results.export.isomme import isomme_files
from crashfuse.testing.readers import written
from crashfuse.units import MS, G
from tests.conftest import SHARED, needs_shared
from tests.importing.crash_files import sentence
from tests.importing.crashes import CRUSH_M, SPEED_MPS, clock, half_sine_g, record, ringing_g, scatter_g

FORMATS = SHARED / "real" / "formats"
LEFT, RIGHT, THIRD = "10SEATLERE00ACXP", "10SEATRIRE00ACXP", "10SEATMIRE00ACXP"


def sensor(name: str, late_s: float = 0.0, scale: float = 1.0, **of_clock: float) -> RecordedChannel:
    """A ringing sensor that sees the crash late, by a clock of its own."""
    time_s = clock(**of_clock)
    return RecordedChannel(name, name, time_s, scale * (half_sine_g(time_s - late_s) + ringing_g(time_s)), "g")


def crush_of(settled: Settled) -> float:
    return float(settled.pulse.kinematics(settled.condition.speed_mps).displacement_m.max())


def problem(record: Record) -> str:
    return sentence(lambda: settle(record))


def careful(settled: Settled) -> str:
    return " ".join(step for step in settled.steps if step.startswith("Careful"))


@pytest.mark.parametrize("late_ms", [-30.0, -4.0, 3.0, 12.0])
def test_a_late_sensor_of_two_is_named_and_nothing_averaged(late_ms: float) -> None:
    """Time zero of the file tells which of the two is likely right; of three, the two others are the pulse."""
    text = problem(record(sensor("A", late_ms * MS), sensor("B")))
    word = "later" if late_ms > 0 else "earlier"
    assert f"A: −61.6 km/h (−38.3 mph), {abs(late_ms):g} ms {word} than B; B: −61.6 km/h (−38.3 mph)" in text
    assert "(--channel B)" in text
    settled = settle(record(sensor("A"), sensor("B", late_ms * MS), sensor("C", scale=0.98)))
    assert settled.channels == ("A", "C")
    assert crush_of(settled) == pytest.approx(CRUSH_M, rel=0.01)
    assert "left out, unlike the others: B: " in careful(settled)
    assert f"{abs(late_ms):g} ms {word} than A" in careful(settled)


def test_a_sensor_of_the_other_sign_or_shape_is_not_averaged() -> None:
    """Inverted, or with a wave of 20 g; sensors in two units are, in that of the first, but not without a unit."""
    assert "B: 61.6 km/h (38.3 mph), of the other sign" in problem(record(sensor("A"), sensor("B", scale=-1.0)))
    waving = RecordedChannel("B", "B", clock(), half_sine_g(clock()) + scatter_g(clock(), 20.0), "g")
    assert "% off the shape of " in problem(record(sensor("A"), waving))
    both = settle(record(sensor("A"), waving), Choices(channels=("A", "B")))
    assert both.channels == ("A", "B")
    assert "% off the shape of " in careful(both)
    one, other = sensor("A"), sensor("B")
    settled = settle(record(one, replace(other, values=other.values * G, unit="m/s²")))
    assert (settled.channels, settled.unit) == (("A", "B"), "g")
    assert crush_of(settled) == pytest.approx(CRUSH_M, rel=1e-3)
    late = sensor("B", 12 * MS)
    assert "12 ms later" in problem(record(one, replace(late, values=late.values * G, unit="m/s²")))
    assert "choose one (--channel A)" in problem(record(one, replace(other, unit=None)))


@settings(max_examples=8, deadline=None)
@example(300, 99)
@example(-300, -50)
@given(st.integers(-300, 300), st.integers(-99, 99))
def test_channels_are_averaged_over_the_time_that_they_share(steps: int, hundredths: int) -> None:
    """Of other pre-trigger times and of clocks that tick between each other's samples, the pulse is the same."""
    settled = settle(record(sensor("A"), sensor("B", start_s=-0.05 + (steps + hundredths / 100) * 1e-4)))
    assert crush_of(settled) == pytest.approx(CRUSH_M, rel=2e-3)


def test_a_channel_that_cannot_be_read_costs_no_test() -> None:
    sound = half_sine_g(clock())
    broken = replace(sensor("B"), values=np.concatenate([sound[:900], np.full(50, np.nan), sound[950:]]))
    settled = settle(record(sensor("A"), broken))
    assert settled.channels == ("A",)
    assert "left out as unusable: B (samples without one)" in careful(settled)
    assert "samples without one" in problem(record(broken))


def isomme(*channels: tuple[str, str, str], **descriptors: str) -> IsommeTest:
    """A test with channels of these codes, sources and status; each stronger than the one before it."""
    pairs = [("Velocity test object 1", f"{SPEED_MPS:.9g}"), ("Mass test object 1", "1700")]
    pairs += [(".Front weight test object 1", "950"), (".Rear weight test object 1", "750")]
    pairs += [(name.replace("_", " "), value) for name, value in descriptors.items()]
    signals = (
        Channel(code, code, "g", half_sine_g(clock()) * (1 + n / 100), 1e-4, -0.05, (), origin, "", status)
        for n, (code, origin, status) in enumerate(channels)
    )
    return IsommeTest("T1", pairs, tuple(signals))


@pytest.mark.parametrize(
    ("channels", "taken", "told"),
    [
        ([(LEFT, "transducer", "ok"), (LEFT, "simulation", "ok")], (f"{LEFT}#1",), "#2 (simulation)"),
        ([(LEFT, "parameter", "ok"), (LEFT, "hardware", "")], (f"{LEFT}#2",), "#1 (parameter)"),
        ([(LEFT, "", "ok"), (RIGHT, "CAE", "")], (LEFT,), f"{RIGHT} (CAE)"),
        ([(LEFT, "transducer", "ok"), (RIGHT, "calculation", "ok")], (LEFT,), f"{RIGHT} (calculation)"),
        ([(LEFT, "", "ok"), (RIGHT, "", "channel failed")], (LEFT,), f"{RIGHT} (channel failed)"),
        ([(LEFT, "", "Meaningless Data"), (RIGHT, "", "ok")], (RIGHT,), f"{LEFT} (Meaningless Data)"),
        ([(LEFT, "", "no data"), (RIGHT, "", "")], (RIGHT,), f"{LEFT} (no data)"),
        ([(LEFT, "", "no data"), (RIGHT, "", "unknown")], (RIGHT,), f"{LEFT} (no data)"),
        ([(LEFT, "", "ok"), (RIGHT, "", "scaling factor changed")], (LEFT,), f"{RIGHT} (scaling factor changed)"),
        ([(LEFT, "", "channel failed"), ("10VEHC000000ACXP", "", "ok")], ("10VEHC000000ACXP",), f"{LEFT} (channel"),
        ([(LEFT, "", "channel failed"), (RIGHT, "", "system noise")], (RIGHT,), f"for want of better: {RIGHT} (sys"),
    ],
)
def test_what_the_file_speaks_against_is_not_averaged(
    channels: Sequence[tuple[str, str, str]], taken: tuple[str, ...], told: str
) -> None:
    settled = settle(record_of(isomme(*channels), "T1"))
    assert settled.channels == taken
    assert any(all(part in step for part in told.split(" .* ")) for step in settled.steps)


def test_where_all_have_failed_it_is_refused_and_one_may_be_chosen() -> None:
    beside = problem(record_of(isomme((LEFT, "", "channel failed"), (RIGHT, "simulation", "ok")), "T1"))
    assert f"expected a sound channel of T1, found {LEFT} (channel failed), {RIGHT} (simulation)" in beside
    failed = record_of(isomme((LEFT, "", "channel failed"), (RIGHT, "", "no data")), "T1")
    text = problem(failed)
    assert f"expected a sound channel of T1, found {LEFT} (channel failed), {RIGHT} (no data)" in text
    assert f"{LEFT} (channel failed)" in careful(settle(failed, Choices(channels=(LEFT,))))


@pytest.mark.parametrize("samples", [b"", b"NOVALUE\r\n" * 3501, b"0.5\r\n" * 7, b"no signal\r\n"])
def test_a_failed_channel_may_hold_anything(tmp_path: Path, samples: bytes) -> None:
    files = isomme_files(isomme((LEFT, "", "ok"), (RIGHT, "", "channel failed")))
    name = "T1/Channel/T1.002"
    begin = files[name].index(b"Time of first sample")
    files[name] = files[name][:begin] + b"Time of first sample :-0.05\r\n"
    (found,) = read_records(Reading(written(tmp_path, files | {name: files[name] + samples}) / "T1"))
    settled = settle(found)
    assert settled.channels == (LEFT,)
    assert any("Left out" in step and RIGHT in step for step in settled.steps)


SUBTYPE = {"Subtype_of_the_test": "Prediction, no vehicle was crashed"}


@pytest.mark.parametrize(
    ("source", "descriptors"), [("simulation", {}), ("Parameter", {}), ("", SUBTYPE), ("", {"Title": "CAE run 12"})]
)
def test_what_says_that_it_is_simulated_is_no_test(tmp_path: Path, source: str, descriptors: dict[str, str]) -> None:
    test = isomme((LEFT, source, "ok"), **descriptors)
    folder = written(tmp_path, isomme_files(test)) / "T1"
    for role in (None, "tests"):
        with pytest.raises(DataError, match=r"expected measured channels of T1, found by its own account .*\(--as cae"):
            import_source(folder, tmp_path / "out", role=role)
    assert not (tmp_path / "out").exists()
    (run,) = import_source(folder, tmp_path / "out", role="cae")
    assert run.role == "cae"
    (read,) = read_records(Reading(folder))
    assert read.is_simulated
    assert parts_of([Label.of(read)]) == {read.source: True}


def test_channels_that_failed_are_not_rated_and_questionable_ones_noted(tmp_path: Path) -> None:
    for name, status in (("A", "channel failed"), ("B", "ok")):
        test = replace(isomme((LEFT, "", status), (RIGHT, "", "questionable data"), (THIRD, "", "ok")), name=name)
        written(tmp_path, isomme_files(test))
    table = rate_channels(tmp_path / "A", tmp_path / "B", [60]).set_index("channel")
    assert np.isnan(table.loc[LEFT, "overall"])
    assert table.loc[LEFT, "note"] == "the reference marks it 'channel failed'"
    assert table.loc[RIGHT, "overall"] == 1
    assert table.loc[RIGHT, "note"].count("'questionable data'") == 2
    assert (table.loc[THIRD, "overall"], table.loc[THIRD, "note"]) == (1, "")


@needs_shared
@pytest.mark.parametrize(
    ("name", "crush_mm"),
    [
        ("isomme_source/cae_beside_test", 611),
        ("isomme_status/failed_channel_beside_ok", 611),
        ("isomme_status/failed_all_novalue", 611),
        ("tdms/tdms_start.tdms", 611),
        ("tdms/scale_of_group.tdms", 612),
        ("tdms/scale_applied.tdms", 612),
    ],
)
def test_files_of_others_give_the_crush_of_their_crash(name: str, crush_mm: float) -> None:
    weights = Choices(condition=PartialCondition(front_weight_kg=870.0, rear_weight_kg=630.0))
    (found,) = read_records(Reading(FORMATS / name))
    settled = settle(found, weights)
    assert crush_of(settled) == pytest.approx(crush_mm * MS, rel=6e-3)
    assert settled.pulse.accel_mps2.min() == pytest.approx(-40.2 * G, rel=0.015)


@needs_shared
def test_a_late_logger_and_an_exported_prediction_are_refused() -> None:
    told = {
        "isomme_late_sensor": f"12 ms later than {LEFT}",
        "isomme_source/own_prediction": "expected measured channels",
    }
    for name, text in told.items():
        assert text in problem(*read_records(Reading(FORMATS / name)))
