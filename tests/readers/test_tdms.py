"""TDMS: NHTSA's properties lead to the pulse; files come from nptdms' writer, an independent one, or byte by byte."""

import struct
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

from crashfuse.errors import DataError
from crashfuse.importing import Choices, format_of, settle
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.tdms import read_tdms
from crashfuse.readers.tdms_container import parse_tdms
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import KPH, MPH
from tests.importing.crash_files import sentence
from tests.importing.crashes import CRUSH_M, PEAK_MPS2, STOP_S, clock, half_sine_g, ringing_g

WEIGHTS = Choices(condition=PartialCondition(front_weight_kg=950.0, rear_weight_kg=750.0))
SENSORS: Mapping[str, tuple[int, str, str, str, str, str, str]] = {
    "11HEAD0000H3ACXA": (1, "AC", "01", "HDCG", "XL", "P", "DRIVER HEAD X"),
    "10FORALERE00AC1P": (93, "AC", "NA", "FLLR", "XG", "P", "LEFT REAR SEAT CROSSMEMBER X"),
    "10FORARIRE00AC1P": (94, "AC", "NA", "FLRR", "XG", "P", "RIGHT REAR SEAT CROSSMEMBER X"),
    "10ENGN000000AC1P": (95, "AC", "NA", "ENGN", "XG", "P", "TOP OF ENGINE X"),
    "10FORALERE00AC3P": (97, "AC", "NA", "FLLR", "ZG", "P", "LEFT REAR SEAT CROSSMEMBER Z"),
    "10FORARIRE01AC1P": (100, "AC", "NA", "FLRR", "XG", "R", "RIGHT REAR SEAT CROSSMEMBER XR"),
}
SCALES = {93: 1.02, 94: 0.98, 95: 3.0, 97: 0.1, 100: 0.1}


def said(number: int, kind: str, seat: str, place: str, axis: str, rank: str, comment: str) -> dict[str, Any]:
    sensor = {"Axis": axis, "ChStat": rank, "CurNo": np.int32(number), "InsCom": comment, "PreFil": np.int32(1650)}
    sensor |= {"DaStat": "CF" if number == 100 else "AM", "SenAtt": place, "SenLoc": seat, "SenTyp": kind}
    test = {"ClsSpd": 56.0, "ImpAng": 0.0, "TstCfn": "VTB", "TstNo": np.int32(9999)}
    vehicle = {"MakeD": "NOVA", "ModelD": "ONE", "VehNo": np.int32(1), "VehSpd": 56.0, "VehTWt": 1700.0}
    vehicle |= {"Year": np.int32(2099)}
    wave = {"increment": 1e-4, "start_offset": -0.05, "xname": "Time", "xunit_string": "s"}
    wave |= {"start_time": datetime(2026, 11, 21, tzinfo=UTC).replace(tzinfo=None)}
    groups = {"Inst": sensor, "Test": test, "Veh": vehicle, "wf": wave}
    properties = {f"{group}_{name}": value for group, of in groups.items() for name, value in of.items()}
    description = f"v09999_{number:03d}aa0.uds; Sensor: type={kind}, Attach={place}"
    return {"description": description, "unit_string": "gn", **properties}


def pulse(number: int) -> FloatArray:
    """A sensor's record in g: the car's pulse, harder or softer, and ringing."""
    return SCALES.get(number, 0.5) * (half_sine_g(clock()) + ringing_g(clock()))


def written(*segments: list[Any]) -> bytes:
    content = BytesIO()
    with TdmsWriter(content) as writer:
        for segment in segments:
            writer.write_segment(segment)
    return content.getvalue()


def nhtsa_test(**changed: Any) -> bytes:
    channels = [
        ChannelObject("v09999_Veh1", name, pulse(sensor[0]), properties={**said(*sensor), **changed})
        for name, sensor in SENSORS.items()
    ]
    return written([RootObject(properties={"SourceName": "NHTSA R&D Database"}), GroupObject("v09999_Veh1"), *channels])


def saved(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def problem(path: Path) -> str:
    return sentence(lambda: read_tdms(path))


def test_an_nhtsa_test_gives_condition_and_pulse(tmp_path: Path) -> None:
    path = saved(tmp_path / "v09999.tdms", nhtsa_test())
    assert format_of(path) == "tdms"
    (record,) = read_tdms(path)
    assert record.id == "09999"
    assert [channel.name for channel in record.channels] == ["93", "94", "95", "100"]
    assert record.proposed == ("93", "94")
    assert record.condition.speed_mps == pytest.approx(56 / 3.6)
    assert record.condition.mass_kg == 1700
    settled = settle(record, WEIGHTS)
    assert (settled.unit, settled.time_zero_s, settled.channel_filter_class) == ("g", 0.0, 60)
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=5e-3)
    motion = settled.pulse.kinematics(settled.condition.speed_mps)
    assert motion.t0_s == pytest.approx(STOP_S, abs=2e-4)
    assert motion.displacement_m.max() == pytest.approx(CRUSH_M, rel=2e-3)


def test_other_setups_are_told_and_a_test_without_the_vehicle_is_refused(tmp_path: Path) -> None:
    (record,) = read_tdms(saved(tmp_path / "a.tdms", nhtsa_test(Test_TstCfn="VTV", Test_ImpAng=15.0)))
    assert record.other_setup == "vehicle into vehicle (VTV) at 15°"
    (record,) = read_tdms(saved(tmp_path / "b.tdms", nhtsa_test(Veh_VehSpd=0.0, Test_ClsSpd=0.0)))
    assert record.condition.speed_mps is None
    assert "X accelerations of the vehicle" in problem(saved(tmp_path / "c.tdms", nhtsa_test(Inst_SenLoc="02")))


def test_any_tdms_file_offers_its_accelerations(tmp_path: Path) -> None:
    wave = {"wf_increment": 0.1, "wf_start_offset": -50.0, "wf_xunit_string": "ms"}
    tunnel = ChannelObject("Car", "Tunnel X", pulse(93), properties={"unit_string": "m/s^2", **wave})
    force = ChannelObject("Car", "Force", pulse(93), properties={"unit_string": "N", **wave})
    (record,) = read_tdms(saved(tmp_path / "sled.tdms", written([force, tunnel])))
    assert (record.proposed, record.channels[0].unit) == (("Tunnel X",), "m/s²")
    assert record.channels[0].time_s == pytest.approx(clock())
    again = ChannelObject("Other", "Tunnel X", pulse(93), properties={"unit_string": "m/s^2", **wave})
    (record,) = read_tdms(saved(tmp_path / "two.tdms", written([tunnel, again])))
    assert ([channel.name for channel in record.channels], record.proposed) == (["Car/Tunnel X", "Other/Tunnel X"], ())
    assert "unit_string" in problem(saved(tmp_path / "force.tdms", written([force])))


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e3), (None, 1e3)])
def test_a_channel_of_time_beside_the_values_is_their_clock(tmp_path: Path, unit: str | None, scale: float) -> None:
    said = {} if unit is None else {"unit_string": unit}
    time_s = ChannelObject("Car", "Zeit", scale * clock(), properties=said)
    accel = ChannelObject("Car", "AX", half_sine_g(clock()), properties={"unit_string": "g"})
    (record,) = read_tdms(saved(tmp_path / "car.tdms", written([time_s, accel])))
    assert record.proposed == ("AX",)
    assert record.channels[0].time_s == pytest.approx(clock())
    assert "add a channel of time" in problem(saved(tmp_path / "alone.tdms", written([accel])))


def test_a_damaged_channel_that_nobody_proposed_is_left_out(tmp_path: Path) -> None:
    channels = [
        ChannelObject("v1", name, pulse(sensor[0]) if sensor[0] != 95 else np.zeros(1), properties=said(*sensor))
        for name, sensor in SENSORS.items()
    ]
    (record,) = read_tdms(saved(tmp_path / "v1.tdms", written(channels)))
    assert record.proposed == ("93", "94")
    assert "Left out as damaged or empty: 95 (TOP OF ENGINE X)." in record.steps
    with pytest.raises(DataError, match="expected samples and their time"):
        settle(record, replace(WEIGHTS, channels=("95",)))


@pytest.mark.parametrize("kind", ["f8", "f4", "i2", "u1", "i8"])
def test_values_are_those_that_were_written_whatever_their_type(kind: str) -> None:
    values = np.arange(100).astype(kind)
    parts = [
        [ChannelObject("it's", "a", values[:40]), ChannelObject("it's", "text", ["x", "yy"])],
        [ChannelObject("it's", "a", values[40:90], properties={"late": 1.5})],
        [ChannelObject("it's", "b", values), ChannelObject("it's", "a", values[90:])],
    ]
    file = parse_tdms(written(*parts), "it")
    by_name = {channel.name: channel for channel in file.channels}
    assert (by_name["a"].group, by_name["a"].properties) == ("it's", {"late": 1.5})
    for name in ("a", "b"):
        assert np.array_equal(file.values(by_name[name]), values.astype(float))


def by_hand(contents: int, data: bytes, count: int = 3, to_next: int | None = None, order: str = "<") -> bytes:
    """A segment with two channels of doubles, byte by byte from NI's description."""
    meta = struct.pack(f"{order}I", 2)
    for name in ("/'g'/'a'", "/'g'/'b'"):
        meta += struct.pack(f"{order}I", len(name)) + name.encode()
        meta += struct.pack(f"{order}IIIQI", 20, 10, 1, count, 0)
    to_next = len(meta) + len(data) if to_next is None else to_next
    return b"TDSm" + struct.pack("<I", contents) + struct.pack(f"{order}IQQ", 4713, to_next, len(meta)) + meta + data


@pytest.mark.parametrize(("bit", "order"), [(0, "<"), (0, ">"), (1 << 5, "<"), (1 << 5, ">")])
def test_interleaved_big_endian_and_repeated_chunks_are_read(bit: int, order: str) -> None:
    a, b = np.arange(6.0), 10 + np.arange(6.0)
    rows = [np.column_stack([a[k : k + 3], b[k : k + 3]]) for k in (0, 3)]
    data = b"".join((row if bit else row.T).astype(f"{order}f8").tobytes() for row in rows)
    contents = 0b1110 | bit | ((order == ">") << 6)
    file = parse_tdms(by_hand(contents, data, order=order), "it")
    assert [file.values(channel).tolist() for channel in file.channels] == [a.tolist(), b.tolist()]
    unfinished = parse_tdms(by_hand(contents, data, to_next=0xFFFFFFFFFFFFFFFF, order=order), "it")
    assert unfinished.values(unfinished.channels[1]).tolist() == b.tolist()


def test_what_is_not_read_or_makes_no_sense_is_refused(tmp_path: Path) -> None:
    wave = {"unit_string": "g", "wf_increment": 1e-4, "NI_Number_Of_Scales": np.uint32(4_000_000_000)}
    scaled = written([ChannelObject("g", "a", np.zeros(9, "i2"), properties=wave)])
    for content, told in (
        (by_hand(0b10001110, bytes(48)), "DAQmx"),
        (scaled, "scale 3999999999 of the kind none"),
        (b"TDSm" + struct.pack("<IIQQI", 0b1110, 4713, 4, 4, 0xFFFFFFFF), "cut short"),
        (nhtsa_test()[:-1000], "cut short"),
        (b"TDSh" + bytes(60), "another kind of file"),
    ):
        assert told in problem(saved(tmp_path / "x.tdms", content))
    claims = by_hand(0b1110, bytes(48), count=1 << 60)
    assert parse_tdms(claims, "it").values(parse_tdms(claims, "it").channels[0]).size == 0
    assert "no such folder or file" in problem(tmp_path / "nothing")


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
    properties = {**WAVE, "wf_increment": 5e-4}
    channels = [(group, name, values[::5]) for group, name, values in [*DUMMIES[:6], *VEHICLE]]
    objects = [ChannelObject(group, name, values, properties=properties) for group, name, values in channels]
    return written([RootObject(properties={"Impact_velocity": "56.0"}), *objects])


def test_the_iihs_vehicle_is_found_among_the_dummies(tmp_path: Path) -> None:
    record = read(tmp_path, DUMMIES + VEHICLE, Impact_velocity="56.0")
    assert [channel.name for channel in record.channels] == ["11VEHC0000__ACX_", "11VEHC0000__ACXD"]
    assert record.proposed == ("11VEHC0000__ACX_",)
    assert record.condition.speed_mps == pytest.approx(56 * KPH)
    assert [channel.cutoff_hz for channel in record.channels] == [None, 100.0]
    settled = settle(record, WEIGHTS)
    assert settled.channel_filter_class == 60
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=5e-3)
    assert settled.pulse.kinematics(settled.condition.speed_mps).t0_s == pytest.approx(STOP_S, abs=2e-4)
    assert settle(record, Choices(("11VEHC0000__ACXD",), condition=WEIGHTS.condition)).channel_filter_class is None


def test_the_speed_is_a_property(tmp_path: Path) -> None:
    mph: dict[str, Any] = {"impact velocity (mph)": 35.0}
    assert read(tmp_path, VEHICLE, **mph).condition.speed_mps == pytest.approx(35 * MPH)
    for text, speed_mps in {"55,8 km/h": 55.8 * KPH, "n/a": None, "-3": None, "4 furlongs": None}.items():
        found = read(tmp_path, VEHICLE, Impact_velocity=text).condition.speed_mps
        assert found == (None if speed_mps is None else pytest.approx(speed_mps))


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


def test_another_crash_is_named_as_that(tmp_path: Path) -> None:
    kind: dict[str, Any] = {"Impact_velocity": "56", "Test_type": "Small overlap frontal: driver side"}
    careful = f"Careful: not a full-frontal barrier crash, by its own account: {kind['Test_type']}."
    assert careful in settle(read(tmp_path, VEHICLE, **kind), WEIGHTS).steps
    slower = [(group, name, 0.6 * values) for group, name, values in VEHICLE]
    with pytest.raises(DataError, match=f"the file calls it '{kind['Test_type']}'"):
        settle(read(tmp_path, slower, **kind), WEIGHTS)


@pytest.mark.parametrize(("unit", "factor", "offset_s"), [("s", 1.0, 0.0), ("ms", 1e3, 0.0), ("s", 1.0, -0.05)])
@pytest.mark.parametrize("late_us", [4000, -12000, 2530])
def test_sensors_are_aligned_by_the_times_at_which_recording_began(
    tmp_path: Path, late_us: int, unit: str, factor: float, offset_s: float
) -> None:
    began = datetime(2026, 3, 2, 9, 15)
    time_s = np.arange(4000) * 1e-4 - 0.08  # of the first logger, whose record begins 80 ms before contact
    pulses = {"10SEATLERE00ACXP": (0, time_s), "10SEATRIRE00ACXP": (late_us, time_s + late_us * 1e-6)}
    wave = {"unit_string": "g", "wf_increment": 1e-4 * factor, "wf_xunit_string": unit}
    wave |= {"wf_start_offset": offset_s * factor}
    objects: list[Any] = [RootObject({"Impact_velocity": "56.0"})]
    for name, (late, since_contact_s) in pulses.items():
        properties = {**wave, "wf_start_time": began + timedelta(microseconds=late)}
        objects.append(ChannelObject("Vehicle", name, half_sine_g(since_contact_s), properties=properties))
    (record,) = read_tdms(saved(tmp_path / "two.tdms", written(objects)))
    settled = settle(record, WEIGHTS)
    assert settled.channels == tuple(pulses)
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=2e-3)
    assert settled.time_zero_s == pytest.approx(0.08 - min(late_us, 0) * 1e-6, abs=1.5e-3)
    later, by = (tuple(pulses)[late_us > 0], abs(late_us) / 1000)
    assert any(f"{later} by {by:g} ms later." in step for step in record.steps)
    assert not any(step.startswith("Careful") for step in settled.steps)


@pytest.mark.parametrize(
    ("channels", "proposed", "told"),
    [
        ("Test_041/11TUNN000000ACXP Test_042/11TUNN000000ACXP", 0, "in several groups, Test_041, Test_042: choose"),
        ("A/11TUNN000000ACXP B/11TUNN000000ACXD", 0, "in several groups, A, B: choose"),
        ("Raw/11TUNN000000ACXP Filtered/11TUNN000000ACXD", 1, "accelerations of other groups: Filtered."),
        ("Car/11TUNN000000ACXP Car/21TUNN000000ACXP", 1, "Those of test object 2 are left out."),
        ("DAS1/10SEATLERE00ACXP DAS2/10SEATRIRE00ACXP DAS3/10BPILLE0000ACXP", 2, "of other groups: DAS3."),
    ],
)
def test_what_is_not_taken_is_named(tmp_path: Path, channels: str, proposed: int, told: str) -> None:
    names = [name.split("/") for name in channels.split()]
    record = read(tmp_path, [(group, name, RAW_G) for group, name in names], Impact_velocity="56")
    assert record.proposed == tuple(name for _, name in names)[:proposed]
    assert any(told in step for step in record.steps)
    if not proposed:
        with pytest.raises(DataError, match=f"group {names[0][0]}.*group {names[1][0]}.*choose one"):
            settle(record, WEIGHTS)


def test_what_is_kept_of_isomme_descriptors_counts(tmp_path: Path) -> None:
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
    simulated = ChannelObject(group, name, RAW_G, properties=WAVE)
    (alone,) = read_tdms(saved(tmp_path / "alone.tdms", written([simulated])))
    assert alone.is_simulated
    measured = ChannelObject("Vehicle", "10VEHC000000ACXP", RAW_G, properties=WAVE)
    (both,) = read_tdms(saved(tmp_path / "both.tdms", written([simulated, measured])))
    assert both.proposed == ("10VEHC000000ACXP",)
