"""TDMS of laboratories such as the IIHS: the vehicle's channels among a hundred dummies', units and times by name."""

from collections.abc import Mapping
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nptdms import ChannelObject, RootObject

from crashfuse.errors import DataError, UsageError
from crashfuse.importing import Choices, settle
from crashfuse.readers import tdms_laboratory
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.tdms import read_tdms
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import KPH
from tests.importing.crashes import PEAK_MPS2, STOP_S, clock, half_sine_g, ringing_g
from tests.readers.test_tdms import saved, written

WEIGHTS = Choices(condition=PartialCondition(front_weight_kg=950.0, rear_weight_kg=750.0))
WAVE: Mapping[str, Any] = {"wf_increment": 1e-4, "wf_start_offset": -0.05, "unit_string": "g"}
TIME_S = clock()
RAW_G = half_sine_g(TIME_S) + ringing_g(TIME_S)
DUMMIES = [
    ("Raw Data", f"11{place}{number:04d}H3AC{axis}_", 2 * RAW_G)
    for place in ("HEAD", "CHST", "PELV", "FEMR", "LOAD")
    for number in range(15)
    for axis in "XYZ"
]
VEHICLE = [
    ("Raw Data", "11VEHC0000__ACX_", RAW_G),
    ("Raw Data", "11VEHC0000__ACY_", 0.3 * RAW_G),
    ("Filtered Data", "11VEHC0000__ACXD", half_sine_g(TIME_S)),
    ("Calculated Channels", "11VEHC0000__VEX_", RAW_G),
]


def read(
    path: Path, channels: list[tuple[str, str, FloatArray]], each: Mapping[str, Any] = WAVE, **of_file: Any
) -> Record:
    """The record of a file with these channels, all with the same properties."""
    objects = [ChannelObject(group, name, values, properties=dict(each)) for group, name, values in channels]
    (record,) = read_tdms(saved(path / "CEN1908.tdms", written([RootObject(properties=of_file), *objects])))
    return record


def iihs_test() -> bytes:
    """A small file as the IIHS writes them."""
    properties = {**WAVE, "wf_increment": 5e-4}
    channels = [(group, name, values[::5]) for group, name, values in [*DUMMIES[:6], *VEHICLE]]
    objects = [ChannelObject(group, name, values, properties=properties) for group, name, values in channels]
    return written([RootObject(properties={"Impact_velocity": "56.0"}), *objects])


def test_the_iihs_vehicle_is_found_among_the_dummies(tmp_path: Path) -> None:
    """Of 229 channels the raw one of the vehicle's along X is the pulse; the speed is the file's, a text in km/h."""
    record = read(tmp_path, DUMMIES + VEHICLE, Impact_velocity="56.0")
    assert [channel.name for channel in record.channels] == ["11VEHC0000__ACX_", "11VEHC0000__ACXD"]
    assert record.proposed == ("11VEHC0000__ACX_",)
    assert record.condition.speed_mps == pytest.approx(56 * KPH)
    assert [channel.cutoff_hz for channel in record.channels] == [None, 100.0]
    settled = settle(record, WEIGHTS)
    assert settled.channel_filter_class == 60
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=5e-3)
    assert settled.pulse.kinematics(settled.condition.speed_mps).t0_s == pytest.approx(STOP_S, abs=2e-4)
    filtered = settle(record, Choices(("11VEHC0000__ACXD",), condition=WEIGHTS.condition))
    assert filtered.channel_filter_class is None


@pytest.mark.parametrize(
    ("properties", "speed_kph"),
    [
        ({"Impact_velocity": "55.8"}, 55.8),
        ({"Impact_velocity": "55,8 km/h"}, 55.8),
        ({"impact velocity (mph)": 35.0}, 35 * 1.609344),
        ({"Impact_velocity": 55.8}, 55.8),
        ({"Impact_velocity": "n/a"}, None),
        ({"Impact_velocity": "-3"}, None),
        ({"Impact_velocity": "4 furlongs"}, None),
        ({"Velocity": "55.8"}, None),
    ],
)
def test_the_speed_is_a_property_of_the_file(
    tmp_path: Path, properties: dict[str, Any], speed_kph: float | None
) -> None:
    """In km/h unless it says otherwise; what is no speed is none."""
    speed = read(tmp_path, VEHICLE, **properties).condition.speed_mps
    assert speed == (None if speed_kph is None else pytest.approx(speed_kph * KPH))


def test_units_and_time_are_in_the_names(tmp_path: Path) -> None:
    """``(g)`` is the unit, and of several times the one of equal length whose name begins alike is the clock."""
    other = TIME_S + 0.01
    channels = [
        ("Calc", "Time (sec)", np.arange(500.0)),
        ("Calc", "Head Time (sec)", other),
        ("Calc", "IIWPG Time (sec)", TIME_S),
        ("Calc", "IIWPG Acceleration (g)", half_sine_g(TIME_S)),
        ("Calc", "IIWPG Velocity (km/h)", RAW_G),
    ]
    record = read(tmp_path, channels, {})
    (channel,) = record.channels
    assert (channel.name, channel.unit, record.proposed) == ("IIWPG Acceleration (g)", "g", ("IIWPG Acceleration (g)",))
    np.testing.assert_array_equal(channel.time_s, TIME_S)
    assert not any("Left out" in step for step in record.steps)  # a time is not damaged, and no acceleration


def test_a_time_in_another_group_is_better_than_none(tmp_path: Path) -> None:
    """In ms, as its name says."""
    record = read(tmp_path, [("Time", "Time [ms]", 1e3 * TIME_S), ("Car", "AX", half_sine_g(TIME_S))], {})
    np.testing.assert_allclose(record.channels[0].time_s, TIME_S, atol=1e-12)


def test_a_channel_is_chosen_as_it_is_printed(tmp_path: Path) -> None:
    """Runs of blanks in its name or not; the likeliest is the first that is listed, and the option names it."""
    names = ["Sled Accel  (g)", "Barrier  Accel (g)", "Vehicle  CG   Accel Long (g)", "Vehicle CG Accel Lat (g)"]
    record = read(tmp_path, [("Car", name, half_sine_g(TIME_S)) for name in names], Impact_velocity="56")
    assert record.proposed == ()
    with pytest.raises(DataError) as caught:
        settle(record, WEIGHTS)
    (problem,) = caught.value.problems
    assert problem.found == "Vehicle  CG   Accel Long (g), Sled Accel  (g), Barrier  Accel (g)"
    assert "(--channel 'Vehicle  CG   Accel Long (g)')" in problem.advice
    for spelling in (problem.found.split(", ")[0], "Vehicle CG Accel Long (g)"):
        chosen = settle(record, Choices((spelling,), condition=WEIGHTS.condition))
        assert chosen.channels == ("Vehicle  CG   Accel Long (g)",)
    with pytest.raises(UsageError, match=r"no channel Lat .* it has Vehicle  CG"):
        settle(record, Choices(("Lat",), condition=WEIGHTS.condition))


def test_many_candidates_are_never_cut_before_the_vehicles(tmp_path: Path) -> None:
    """Three hundred that could be anything, and the vehicle's at the end of the file: it is read, and listed first."""
    others = [("Car", f"Accel {number} (g)", half_sine_g(TIME_S)[::10]) for number in range(300)]
    wave = {**WAVE, "wf_increment": 1e-3}
    record = read(tmp_path, [*others, ("Car", "Tunnel accel (g)", half_sine_g(TIME_S)[::10])], wave)
    assert record.channels[0].name == "Tunnel accel (g)"
    assert record.listed.startswith("Tunnel accel (g), Accel 0 (g)")
    assert record.listed.endswith(" more")


def test_another_crash_is_named_as_that(tmp_path: Path) -> None:
    """A small overlap test is read with a warning; where it does not stop the vehicle, it is refused as what it is."""
    record = read(tmp_path, VEHICLE, Impact_velocity="56", Test_type="Small overlap frontal: driver side")
    careful = "Careful: not a full-frontal barrier crash, by its own account: Small overlap frontal: driver side."
    assert careful in settle(record, WEIGHTS).steps
    slower = [(group, name, 0.6 * values) for group, name, values in VEHICLE]
    record = read(tmp_path, slower, Impact_velocity="56", Test_type="Small overlap frontal: driver side")
    with pytest.raises(DataError, match="calls the test 'Small overlap frontal: driver side', and only full-frontal"):
        settle(record, WEIGHTS)
    with pytest.raises(DataError, match=r"if it is no full-frontal barrier crash \(but car to car, or small overlap\)"):
        settle(read(tmp_path, slower, Impact_velocity="56"), WEIGHTS)


def test_memory_is_bounded_over_all_channels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each may be long, but not all of them."""
    monkeypatch.setattr(tdms_laboratory, "_MOST_VALUES", 5 * TIME_S.size)
    with pytest.raises(DataError, match="accelerations of at most 17,505 values in all, found more"):
        read(tmp_path, [("Car", f"AX {number}", RAW_G) for number in range(6)])


def test_a_time_beyond_all_numbers_is_refused_without_a_warning(tmp_path: Path) -> None:
    """A step of 1e305 s, as damage makes it, overflows; it is a sentence all the same."""
    record = read(tmp_path, VEHICLE, {**WAVE, "wf_increment": 1e305}, Impact_velocity="56")
    with pytest.raises(DataError, match="expected a number in each sample"):
        settle(record, WEIGHTS)


@pytest.mark.parametrize(("unit", "factor", "offset_s"), [("s", 1.0, 0.0), ("ms", 1e3, 0.0), ("s", 1.0, -0.05)])
@pytest.mark.parametrize("late_us", [4000, -12000, 2530])
def test_sensors_are_aligned_by_the_times_at_which_recording_began(
    tmp_path: Path, late_us: int, unit: str, factor: float, offset_s: float
) -> None:
    """A second logger that was triggered at another time sees the same crash, whatever its zero and unit of time."""
    began = datetime(2026, 3, 2, 9, 15)
    time_s = np.arange(4000) * 1e-4 - 0.08  # of the first logger, whose record begins 80 ms before contact
    pulses = {"10SEATLERE00ACXP": (0, time_s), "10SEATRIRE00ACXP": (late_us, time_s + late_us * 1e-6)}
    objects = [
        ChannelObject(
            "Vehicle",
            name,
            half_sine_g(since_contact_s),
            properties={
                "unit_string": "g",
                "wf_increment": 1e-4 * factor,
                "wf_start_offset": offset_s * factor,
                "wf_xunit_string": unit,
                "wf_start_time": began + timedelta(microseconds=late),
            },
        )
        for name, (late, since_contact_s) in pulses.items()
    ]
    (record,) = read_tdms(saved(tmp_path / "two.tdms", written([RootObject({"Impact_velocity": "56.0"}), *objects])))
    settled = settle(record, WEIGHTS)
    assert settled.channels == tuple(pulses)
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=2e-3)
    assert settled.time_zero_s == pytest.approx(0.08 - min(late_us, 0) * 1e-6, abs=1.5e-3)
    later, by = (tuple(pulses)[late_us > 0], abs(late_us) / 1000)
    assert any(f"wf_start_time): {later} by {by:g} ms later;" in step for step in record.steps)
    assert not any(step.startswith("Careful") for step in settled.steps)


def test_what_is_kept_of_isomme_descriptors_counts(tmp_path: Path) -> None:
    """A failed or simulated channel beside a sound one, as converters of ISO-MME write it, is not averaged."""
    said: list[tuple[str, dict[str, Any]]] = [
        ("10SEATLERE00ACXP", {"Data_status": "channel failed"}),
        ("10SEATRIRE00ACXP", {"Data status": "ok"}),
        ("10SEATMIRE00ACXP", {"Data source": "simulation"}),
    ]
    objects = [ChannelObject("g", name, RAW_G, properties={**WAVE, **own}) for name, own in said]
    (record,) = read_tdms(saved(tmp_path / "converted.tdms", written(objects)))
    assert record.proposed == ("10SEATRIRE00ACXP",)


@pytest.mark.parametrize(("group", "name"), [("Simulation", "Vehicle Acc X"), ("Vehicle", "CAE Acc X")])
def test_a_group_or_name_of_a_simulation_is_heard(tmp_path: Path, group: str, name: str) -> None:
    """As that of a table's column is; beside a measured channel it is left out."""
    simulated = ChannelObject(group, name, RAW_G, properties=WAVE)
    (alone,) = read_tdms(saved(tmp_path / "alone.tdms", written([simulated])))
    assert alone.is_simulated
    measured = ChannelObject("Vehicle", "10VEHC000000ACXP", RAW_G, properties=WAVE)
    (both,) = read_tdms(saved(tmp_path / "both.tdms", written([simulated, measured])))
    assert both.proposed == ("10VEHC000000ACXP",)
