"""ISO-MME: what is written is read again to the bit, and so is what laboratories write."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crashfuse.errors import DataError
from crashfuse.files.archive import Limits, zipped
from crashfuse.importing import Choices, settle
from crashfuse.readers.isomme import Channel, IsommeTest, read_isomme, read_isomme_record, record_of
from crashfuse.readers.nhtsa import read_nhtsa
from crashfuse.readers.record import PartialCondition
from crashfuse.results.export.isomme import isomme_files
from crashfuse.testing.readers import written
from crashfuse.units import KPH, G
from tests.conftest import SHARED, needs_shared
from tests.importing.crashes import PEAK_MPS2, SPEED_MPS, STOP_S, clock, half_sine_g

# Written by hand after a channel of a federal laboratory's side-impact test: NOVALUE, 10 kHz from -0.1 s.
IMPLICIT = """Channel code                :M0MBARLEMIUPACXP
Reference channel           :implicit
Reference channel name      :NOVALUE
Data source                 :transducer
Test object number          :1
Name of the channel         :Wagen links: Beschleunigung in Längsrichtung
Comments                    :drift … within 2 %
Channel frequency class     :NOVALUE
Sampling interval           :0.0001
Unit                        :m/(s*s)
Time of first sample        :-0.1
Number of samples           :4
Data status                 :ok
1.470835E+3
-3.005184E+2
NOVALUE
 0
"""
CLOCK = """Channel code                :11TIRS000000TIRP
Unit                        :s
Number of samples           :4
-1.0E-03
-0.5E-03
0.0E-03
0.5E-03
"""
EXPLICIT = """Channel code                :11HEADCG0000ACXP
Reference channel           :explicit
Reference channel name      :11TIRS000000TIRP
Unit\t\t:g
42
41
40
39
"""
MME = (
    "Data format edition number  :1.6\nTitle :Wall: 40 % Überdeckung\nCustomer name :NOVALUE\nComments:a\nComments:b\n"
)
CHN = "Number of channels :3\nName of channel 003         :10VEHC000000ACXD / Vehicle X\n"


def laboratory(encoding: str = "cp1252", newline: str = "\r\n", **changed: str) -> dict[str, bytes]:
    """Files of a test as a laboratory writes them, capitals and all."""
    texts = {"T1.MME": MME, "CHANNEL/t1.chn": CHN, "CHANNEL/T1.001": IMPLICIT, "CHANNEL/T1.002": CLOCK}
    texts |= {"CHANNEL/T1.003": "Unit :g\n1\n2\n", "CHANNEL/T1.010": EXPLICIT} | changed
    return {name: text.replace("\n", newline).encode(encoding) for name, text in texts.items()}


def as_zip(files: dict[str, bytes], path: Path) -> Path:
    """Write the files as a zip, a film among them."""
    path.write_bytes(zipped({**files, "T1/Movie/T1.avi": b"film"}))
    return path


@pytest.fixture
def test_with_numbers() -> IsommeTest:
    rng = np.random.default_rng(0)
    values = rng.standard_normal(300) * 10.0 ** rng.integers(-300, 300, 300)
    values[7] = np.nan
    first = Channel("10VEHC000000ACXD", "Vehicle X", "m/(s*s)", values, 8e-5, -0.01, ("a", "b"), "simulation")
    first = replace(first, status="channel failed")
    second = Channel("10VEHC000000EVXX", "Überschlag", "1", np.arange(3.0), None, status="ok")
    return IsommeTest("T 1", (("Title", "A: b"), ("Comments", "one"), ("Comments", "two")), (first, second))


@pytest.mark.parametrize("packed", [True, False])
def test_what_is_written_is_read_again_to_the_bit(test_with_numbers: IsommeTest, tmp_path: Path, packed: bool) -> None:
    files = isomme_files(test_with_numbers)
    again = read_isomme(as_zip(files, tmp_path / "t.zip") if packed else written(tmp_path, files) / "T 1")
    assert (again.name, again.descriptors) == (test_with_numbers.name, test_with_numbers.descriptors)
    for found, expected in zip(again.channels, test_with_numbers.channels, strict=True):
        np.testing.assert_array_equal(found.values, expected.values)
        assert {**vars(found), "values": 0} == {**vars(expected), "values": 0}


def test_files_keep_to_the_form_of_the_standard(test_with_numbers: IsommeTest) -> None:
    """Descriptor names fill 28 characters, lines end in CR LF and have at most 80 characters, samples one a line."""
    long = replace(test_with_numbers.channels[0], comments=("a long-winded comment " * 20,))
    files = isomme_files(replace(test_with_numbers, channels=(long,)))
    assert list(files) == ["T 1/T 1.mme", "T 1/Channel/T 1.chn", "T 1/Channel/T 1.001"]
    for content in files.values():
        assert content.endswith(b"\r\n")
        assert content.count(b"\n") == content.count(b"\r\n")
        lines = content.decode().split("\r\n")[:-1]
        assert max(map(len, lines)) <= 80
        assert {line[28] for line in lines if ":" in line} == {":"}
    lines = files["T 1/Channel/T 1.001"].decode().split("\r\n")[:-1]
    assert [float(line) for line in lines[-300:] if line != "NOVALUE"] == [v for v in long.values if not np.isnan(v)]
    assert "Number of samples           :300" in lines
    assert "Sampling interval           :8e-05" in lines
    assert "Customer channel code       :NOVALUE" in lines


def test_a_line_break_in_a_name_writes_no_second_descriptor(test_with_numbers: IsommeTest, tmp_path: Path) -> None:
    title = ("Title", "x\r\nDate of the test :2024-01-01\x85Regulation :R94")
    forged = replace(test_with_numbers, descriptors=(title,))
    again = read_isomme(written(tmp_path, isomme_files(forged)) / "T 1")
    assert len(again.descriptors) == 1
    assert again.descriptor("Date of the test") == ""


@pytest.mark.parametrize(("encoding", "newline"), [("cp1252", "\r\n"), ("utf-8", "\n"), ("utf-8-sig", "\r")])
@pytest.mark.parametrize("packed", [True, False])
def test_what_laboratories_write_is_read(tmp_path: Path, encoding: str, newline: str, packed: bool) -> None:
    files = laboratory(encoding, newline)
    inside = {f"T1/{name}": content for name, content in files.items()}
    test = read_isomme(as_zip(inside, tmp_path / "v1.ZIP") if packed else written(tmp_path / "T1", files))
    assert (test.name, test.descriptor("title")) == ("T1", "Wall: 40 % Überdeckung")
    assert test.descriptor("Customer name") == ""
    assert [value for name, value in test.descriptors if name == "Comments"] == ["a", "b"]
    implicit, clock, bare, explicit = test.channels
    assert (implicit.code, implicit.unit, implicit.source) == ("M0MBARLEMIUPACXP", "m/(s*s)", "transducer")
    named = ("Wagen links: Beschleunigung in Längsrichtung", ("drift … within 2 %",), 1e-4, -0.1)
    assert (implicit.name, implicit.comments, implicit.interval_s, implicit.start_s) == named
    np.testing.assert_array_equal(implicit.values, [1470.835, -300.5184, np.nan, 0.0])
    assert clock.interval_s is None
    assert (bare.code, bare.name, bare.interval_s) == ("10VEHC000000ACXD", "Vehicle X", None)
    assert (explicit.unit, explicit.start_s) == ("g", -1e-3)
    assert explicit.interval_s == pytest.approx(5e-4)


def test_times_are_in_the_unit_that_they_name(tmp_path: Path) -> None:
    """0.1 ms is not 0.1 s, in a header as in a channel of time, which may be named by its code, name or number."""
    in_ms = IMPLICIT.replace(":0.0001", ":0.1 ms").replace(":-0.1", ":-100\tms")
    clock = CLOCK.replace("Unit                        :s", "Name of the channel :Zeit\nUnit :ms")
    for reference in ("11TIRS000000TIRP", "Zeit", "002"):
        explicit = EXPLICIT.replace(":11TIRS000000TIRP", f":{reference}")
        changed = {"CHANNEL/T1.001": in_ms, "CHANNEL/T1.002": clock, "CHANNEL/T1.010": explicit}
        test = read_isomme(written(tmp_path / reference, laboratory(**changed)))
        by_code = {channel.code: channel for channel in test.channels}
        implicit, timed = by_code["M0MBARLEMIUPACXP"], by_code["11HEADCG0000ACXP"]
        assert [implicit.interval_s, implicit.start_s] == pytest.approx([1e-4, -0.1])
        assert [timed.interval_s, timed.start_s] == pytest.approx([5e-7, -1e-6])


def test_a_start_that_nobody_tells_is_none(tmp_path: Path) -> None:
    """Neither its absence nor NOVALUE means that recording began at 0, and so it is written again."""
    for line in ("", "Time of first sample        :NOVALUE\n"):
        changed = IMPLICIT.replace("Time of first sample        :-0.1\n", line)
        test = read_isomme(written(tmp_path / "lab", laboratory(**{"CHANNEL/T1.001": changed})))
        assert test.channels[0].start_s is None
        again = read_isomme(written(tmp_path / "again", isomme_files(test)) / "T1")
        assert (again.channels[0].start_s, again.channels[0].interval_s) == (None, 1e-4)


def test_the_header_file_chooses_among_tests_in_one_folder(tmp_path: Path) -> None:
    for name in "AB":
        written(tmp_path / name, laboratory())
    with pytest.raises(DataError, match=r"one \.mme file, found 2 of them"):
        read_isomme(tmp_path)
    assert len(read_isomme(tmp_path / "B" / "T1.MME").channels) == 4


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"CHANNEL/T1.001": IMPLICIT.replace(":4\n", ":5\n")}, r"T1.001: expected 5 samples.*found 4"),
        ({"CHANNEL/T1.001": IMPLICIT.replace("-3.005184E+2", "-3,005184E+2")}, r"one number a line.*'-3,005184E\+2'"),
        ({"CHANNEL/T1.001": IMPLICIT.replace("NOVALUE\n 0", "inf\n 0")}, "one number a line.* an infinite one"),
        ({"CHANNEL/T1.001": IMPLICIT.replace(":0.0001", ":0")}, "column Sampling interval: expected a number above 0"),
        ({"CHANNEL/T1.001": IMPLICIT.replace(":0.0001", ":fast")}, "Sampling interval: expected a number, found fast"),
        ({"CHANNEL/T1.001": IMPLICIT.replace(":0.0001", ":10 kHz")}, "expected a time in s or ms, found kHz"),
        ({"CHANNEL/T1.001": "\x00\x01\x02"}, "lines of the form Name :value"),
        ({"T1.MME": ""}, "T1.MME: expected lines of the form"),
        ({"T1.MME": "a:b\n" * 20_000}, "at most 10000 descriptors"),
        ({"CHANNEL/T1.001": IMPLICIT + "\n" * 2_000_001}, "at most 2000000 lines"),
    ],
)
def test_a_wrong_file_is_named_with_what_is_wrong(tmp_path: Path, changed: dict[str, str], expected: str) -> None:
    with pytest.raises(DataError, match=expected):
        read_isomme(written(tmp_path, laboratory("utf-8", **changed)))


def test_a_test_without_its_parts_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    written(tmp_path / "alone", {"T1.mme": MME.encode()})
    told = {"nowhere": "no such folder", "empty": r"one \.mme file, found none", "alone": "channel files"}
    for name, sentence in told.items():
        with pytest.raises(DataError, match=sentence):
            read_isomme(tmp_path / name)
    written(tmp_path / "T1", laboratory())
    for limits in (Limits(members=3), Limits(total_bytes=500), Limits(member_bytes=200)):
        with pytest.raises(DataError, match="at most"):
            read_isomme(tmp_path / "T1", limits)


REAL = SHARED / "real"
DESCRIPTORS = [("Title", "Front"), ("Velocity test object 1", f"{SPEED_MPS:.9g}"), ("Mass test object 1", "1700")]


def channel(code: str, scale: float = G, unit: str = "m/(s*s)") -> Channel:
    """A channel of 10 kHz that begins 50 ms before contact."""
    return Channel(code, f"Sensor {code}", unit, scale * half_sine_g(clock()), 1e-4, -0.05)


def isomme(*codes: str, **changed: str) -> IsommeTest:
    descriptors = [(name, changed.get(name.split()[0].lower(), value)) for name, value in DESCRIPTORS]
    return IsommeTest("T1", descriptors, tuple(map(channel, codes)))


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        ("10SILLLE0000ACXD 10SILLRI0000ACXD 20SILLLE0000ACXA", slice(0, 2)),
        ("10SILLLE0000ACXA 20SILLRI0000ACXA", slice(0, 1)),
        ("10SILLLE0000ACXA 20TUNN000000ACXA", slice(0, 1)),
        ("10SEATLE0000ACXA 20TUNN000000ACXA", slice(1, 2)),
        ("20TUNN000000ACXA", slice(0, 1)),
    ],
)
def test_channels_speed_and_weights_are_of_one_vehicle(names: str, chosen: slice) -> None:
    codes = names.split()
    proposed, vehicle = tuple(codes[chosen]), codes[chosen][0][0]
    second = [("Velocity test object 2", "10"), ("Mass test object 2", "1200")]
    record = record_of(IsommeTest("T1", [*DESCRIPTORS, *second], tuple(map(channel, codes))), "T1")
    assert record.proposed == proposed
    assert {one.name[0] for one in record.channels} == {vehicle}
    expected = {"1": (pytest.approx(SPEED_MPS), 1700.0), "2": (10.0, 1200.0)}[vehicle]
    assert (record.condition.speed_mps, record.condition.mass_kg) == expected
    assert any(f"weights of test object {vehicle}" in step for step in record.steps)


def test_without_a_time_of_the_first_sample_time_zero_is_looked_for() -> None:
    """The format's 0 is none if nobody says when recording began: contact is where braking begins."""
    test = IsommeTest("T1", DESCRIPTORS, (replace(channel("10VEHC000000ACXP"), start_s=None),))
    record = record_of(test, "T1")
    assert record.own_time_zero == ""
    assert any("find time zero" in step for step in record.steps)
    settled = settle(record, Choices(front_share=0.56))
    found = settled.time_zero_s, settled.pulse.kinematics(settled.condition.speed_mps).t0_s
    assert found == pytest.approx((0.05, STOP_S), abs=1.5e-3)


def test_a_channel_without_an_even_time_is_said_to_be_one() -> None:
    untimed = replace(channel("10VEHC000000ACXP"), interval_s=None)
    with pytest.raises(DataError, match="T1, 10VEHC000000ACXP: expected an even time"):
        record_of(IsommeTest("T1", DESCRIPTORS, (untimed,)), "T1")
    record = record_of(IsommeTest("T1", DESCRIPTORS, (untimed, channel("10TUNN000000ACXP"))), "T1")
    assert record.proposed == ("10TUNN000000ACXP",)
    assert any("Left out for lack of an even time: 10VEHC000000ACXP" in step for step in record.steps)
    with pytest.raises(DataError, match="expected an even time"):
        settle(record, Choices(channels=("10VEHC000000ACXP",), front_share=0.56))


@pytest.mark.parametrize(
    ("text", "speed_mps"), [("15.6", 15.6), ("56.3 km/h", 56.3 * KPH), ("56,3 km/h", 56.3 * KPH), ("-", None)]
)
def test_speeds_are_in_metres_a_second_unless_they_say_otherwise(text: str, speed_mps: float | None) -> None:
    found = record_of(isomme("10VEHC000000ACXP", velocity=text), "T1").condition.speed_mps
    assert found == (None if speed_mps is None else pytest.approx(speed_mps))


@pytest.mark.parametrize(
    ("name", "value", "named"),
    [
        ("Type of the test", "VEHICLE INTO VEHICLE", "VEHICLE INTO VEHICLE"),
        ("Subtype of the test", "40 % overlap", "40 % overlap"),
        ("Impact side test object 1", "LE", "impact side LE"),
        ("Impact side test object 1", "FR", ""),
        ("Type of the test", "VEHICLE INTO BARRIER", ""),
    ],
)
def test_another_crash_is_named(name: str, value: str, named: str) -> None:
    test = IsommeTest("T1", [*DESCRIPTORS, (name, value)], (channel("10VEHC000000ACXP"),))
    assert record_of(test, "T1").other_setup == named


def load_cell(code: str, share: float = 0.25, status: str = "ok", unit: str = "N") -> Channel:
    return replace(channel(code, share * 1700 * G / (1000 if unit == "kN" else 1), unit), status=status)


CELLS = [f"B0LOMA0{row}0{column}00FOXP" for row in (1, 2) for column in (1, 2)]
WHOLE = load_cell("B0LOMASU0000FOXP", 1.0)
ROWS = [load_cell(f"B0LOMA0{row}SU00FOXP", 0.5) for row in (1, 2)]
BLOCKS = [load_cell("B0FBARLE0000FOXP", 0.4), load_cell("B0FBARRI0000FOXP", 0.6)]
FAILED = load_cell(CELLS[0], status="channel failed")


@pytest.mark.parametrize(
    ("cells", "told"),
    [
        ([*map(load_cell, CELLS)], "4 load cells summed."),
        ([*map(load_cell, CELLS), WHOLE], "4 load cells summed."),
        ([*(load_cell(code, unit="kN") for code in CELLS), *ROWS, WHOLE], "4 load cells summed."),
        ([*BLOCKS, load_cell("B0FBAR000000FOXP", 1)], "2 load cells summed."),
        (BLOCKS, "2 load cells summed."),
        ([WHOLE, replace(WHOLE, code="B0LOMASU0000FOXD")], "the sum in the file."),
        ([*ROWS, WHOLE], "the sum in the file."),
        ([*map(load_cell, CELLS[1:]), FAILED, WHOLE], "the sum in the file. Cells f"),
        ([*map(load_cell, CELLS[1:]), WHOLE], "the sum in the file. The 3 load cells add up to less."),
    ],
)
def test_the_force_of_the_barrier_is_counted_once(cells: list[Channel], told: str) -> None:
    record = record_of(IsommeTest("T1", DESCRIPTORS, (channel("10TUNN000000ACXP"), *cells)), "T1")
    assert any(f"Force of the barrier: {told}" in step for step in record.steps)
    assert record.wall is not None
    assert np.abs(record.wall.force_n).max() == pytest.approx(1700 * PEAK_MPS2, rel=1e-6)


OWN_ACCOUNT = "Left out by the file's own account: 10SEATLERE00ACXP"
DOUBTED: list[tuple[dict[str, Any], str]] = [
    ({"comments": ("on the plate", "channel failed at 40 ms")}, OWN_ACCOUNT),
    ({"name": "Seat left, questionable"}, OWN_ACCOUNT),
    ({"code": "10SEATLERE00ACXV"}, "10SEATLERE00ACXV (film analysis)"),
]


@pytest.mark.parametrize(("changed", "told"), DOUBTED)
def test_a_channel_that_the_file_doubts_is_not_averaged(changed: dict[str, Any], told: str) -> None:
    doubtful, sound = replace(channel("10SEATLERE00ACXP"), **changed), channel("10SEATRIRE00ACXP")
    record = record_of(IsommeTest("T1", DESCRIPTORS, (doubtful, sound)), "T1")
    assert record.proposed == (sound.code,)
    assert any(told in step for step in record.steps)
    alone = record_of(IsommeTest("T1", DESCRIPTORS, (doubtful,)), "T1")
    assert not alone.proposed or any(step.startswith("Careful: taken for want of better") for step in alone.steps)


@needs_shared
def test_nhtsas_download_is_the_pulse_of_its_ascii_form() -> None:
    """A test written by pyisomme with NHTSA's codes: speed to its two digits, pulse to the bit."""
    (own,) = read_nhtsa(REAL / "nhtsa_10146_camry2018")
    (record,) = read_isomme_record(REAL / "formats/isomme_seat/nh_g.zip")
    assert record.condition.speed_mps == pytest.approx(own.condition.speed_mps, abs=5e-3)
    speed = PartialCondition(own.condition.speed_mps)
    pulses = [settle(one, Choices(condition=speed, front_share=0.56)).pulse for one in (own, record)]
    np.testing.assert_array_equal(pulses[0].accel_mps2, pulses[1].accel_mps2)


def test_a_test_of_dummies_alone_is_refused() -> None:
    with pytest.raises(DataError, match="an X acceleration of the vehicle"):
        record_of(isomme("11HEAD0000H3ACXP"), "T1")


def test_axle_weights_of_our_own_exports_are_read() -> None:
    own = [(".Front weight test object 1", "900"), (".Rear weight test object 1", "700")]
    record = record_of(IsommeTest("T1", [*DESCRIPTORS, *own], (channel("10VEHC000100ACXD"),)), "T1")
    assert (record.condition.front_weight_kg, record.condition.rear_weight_kg) == (900, 700)
