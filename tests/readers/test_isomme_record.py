"""ISO-MME as a record: which channels could be the pulse, and what the test says of its condition."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.errors import DataError
from crashfuse.importing import Choices, settle
from crashfuse.readers.isomme_channels import Channel, IsommeTest
from crashfuse.readers.isomme_record import read_isomme_record, record_of
from crashfuse.readers.nhtsa import read_nhtsa
from crashfuse.readers.record import PartialCondition
from crashfuse.reporting.isomme_writer import isomme_files
from crashfuse.units import KPH, G
from tests.conftest import SHARED, needs_shared
from tests.importing.crashes import SPEED_MPS, STOP_S, clock, half_sine_g

REAL = SHARED / "real"
DESCRIPTORS = [
    ("Title", "Front impact"),
    ("Velocity test object 1", f"{SPEED_MPS:.9g}"),
    ("Mass test object 1", "1700"),
]


def channel(code: str, scale: float = G, unit: str = "m/(s*s)") -> Channel:
    """A channel of 10 kHz that begins 50 ms before contact."""
    return Channel(code, f"Sensor {code}", unit, scale * half_sine_g(clock()), 1e-4, -0.05)


def isomme(*codes: str, **changed: str) -> IsommeTest:
    """A test with channels of these codes."""
    descriptors = [(name, changed.get(name.split()[0].lower(), value)) for name, value in DESCRIPTORS]
    return IsommeTest("T1", descriptors, tuple(map(channel, codes)))


@pytest.mark.parametrize(
    ("codes", "proposed"),
    [
        (("11HEAD0000H3ACXP", "10VEHC000000ACXP", "10BPILLE0000ACXP"), ("10VEHC000000ACXP",)),
        (("10CVEHCG0000ACXD", "10CVEHCG0000ACYD"), ("10CVEHCG0000ACXD",)),
        (("10SIMELE00INACXD", "10SIMERI00INACXD", "10ENGN000000ACXP"), ("10SIMELE00INACXD", "10SIMERI00INACXD")),
        (("10VEHC000000ACXD", "10VEHC000000ACXP"), ("10VEHC000000ACXP",)),  # the raw one of two
        (("10SEATLERE00ACXP", "10VEHC000000ACXP", "10SEATRIRE00ACXP"), ("10SEATLERE00ACXP", "10SEATRIRE00ACXP")),
        (("10ENGN000000ACXP",), ()),  # alone, but no place that moves as the vehicle does
        (("11SEATLE0000ACXA", "11HEAD0000H3ACXA"), ()),
        (("10ENGN000000ACXP", "10ENGN000001ACXP"), ()),
    ],
)
def test_channels_are_proposed_by_where_they_sit(codes: tuple[str, ...], proposed: tuple[str, ...]) -> None:
    """The rear seat's first, then the vehicle's own, then sills; never a dummy; of two filter classes the raw one."""
    record = record_of(isomme(*codes), "T1")
    assert record.proposed == proposed
    assert not any("HEAD" in one.name or "ACY" in one.name for one in record.channels)


@pytest.mark.parametrize(
    ("codes", "proposed", "vehicle"),
    [
        (("10SILLLE0000ACXD", "10SILLRI0000ACXD", "20SILLLE0000ACXA"), ("10SILLLE0000ACXD", "10SILLRI0000ACXD"), "1"),
        (("10SILLLE0000ACXA", "20SILLRI0000ACXA"), ("10SILLLE0000ACXA",), "1"),
        (("10SILLLE0000ACXA", "20TUNN000000ACXA"), ("10SILLLE0000ACXA",), "1"),
        (("10SEATLE0000ACXA", "20TUNN000000ACXA"), ("20TUNN000000ACXA",), "2"),
        (("20TUNN000000ACXA",), ("20TUNN000000ACXA",), "2"),
    ],
)
def test_channels_speed_and_weights_are_of_one_vehicle(
    codes: tuple[str, ...], proposed: tuple[str, ...], vehicle: str
) -> None:
    """Of two cars in a test, the first whose acceleration is there is taken, with its own speed and mass, and told."""
    second = [("Velocity test object 2", "10"), ("Mass test object 2", "1200")]
    record = record_of(IsommeTest("T1", [*DESCRIPTORS, *second], tuple(map(channel, codes))), "T1")
    assert record.proposed == proposed
    assert {one.name[0] for one in record.channels} == {vehicle}
    expected = {"1": (pytest.approx(SPEED_MPS), 1700.0), "2": (10.0, 1200.0)}[vehicle]
    assert (record.condition.speed_mps, record.condition.mass_kg) == expected
    assert any(f"are those of test object {vehicle}" in step for step in record.steps)


def test_without_a_time_of_the_first_sample_time_zero_is_looked_for() -> None:
    """The format's 0 is none if nobody says when recording began: contact is where braking begins."""
    test = IsommeTest("T1", DESCRIPTORS, (replace(channel("10VEHC000000ACXP"), start_s=None),))
    record = record_of(test, "T1")
    assert record.own_time_zero == ""
    assert any("time zero has to be found" in step for step in record.steps)
    settled = settle(record, Choices(front_share=0.56))
    assert settled.time_zero_s == pytest.approx(0.05, abs=1.5e-3)
    assert settled.pulse.kinematics(settled.condition.speed_mps).t0_s == pytest.approx(STOP_S, abs=1.5e-3)


def test_a_channel_without_an_even_time_is_said_to_be_one() -> None:
    """It is left out beside others and refused if it is chosen or alone, but never said to be missing."""
    untimed = replace(channel("10VEHC000000ACXP"), interval_s=None)
    with pytest.raises(DataError, match="T1, 10VEHC000000ACXP: expected an even time"):
        record_of(IsommeTest("T1", DESCRIPTORS, (untimed,)), "T1")
    record = record_of(IsommeTest("T1", DESCRIPTORS, (untimed, channel("10TUNN000000ACXP"))), "T1")
    assert record.proposed == ("10TUNN000000ACXP",)
    assert any("Left out for lack of an even time: 10VEHC000000ACXP" in step for step in record.steps)
    with pytest.raises(DataError, match="expected an even time"):
        settle(record, Choices(channels=("10VEHC000000ACXP",), front_share=0.56))


def test_a_test_becomes_a_pulse(tmp_path: Path) -> None:
    """From the folder to t0 in closed form, with the mass shared as the user says."""
    for name, content in isomme_files(isomme("10VEHC000000ACXP")).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    (record,) = read_isomme_record(tmp_path / "T1")
    with pytest.raises(DataError, match="the weights on both axles of T1"):
        settle(record)
    settled = settle(record, Choices(front_share=0.56))
    assert (settled.unit, settled.deceleration_sign, settled.time_zero_s) == ("m/s²", "negative", 0.0)
    assert settled.condition.front_weight_kg == pytest.approx(952)
    assert settled.pulse.kinematics(settled.condition.speed_mps).t0_s == pytest.approx(STOP_S, abs=1e-5)


@pytest.mark.parametrize(
    ("text", "speed_mps"), [("15.6", 15.6), ("56.3 km/h", 56.3 * KPH), ("56,3 km/h", 56.3 * KPH), ("-", None)]
)
def test_speeds_are_in_metres_a_second_unless_they_say_otherwise(text: str, speed_mps: float | None) -> None:
    """The format's unit is m/s; laboratories write their own beside the number."""
    found = record_of(isomme("10VEHC000000ACXP", velocity=text), "T1").condition.speed_mps
    assert found == (None if speed_mps is None else pytest.approx(speed_mps))


def test_filter_classes_and_repeated_codes_are_told_apart() -> None:
    """CFC 60 is a low pass at 100 Hz, CFC 180 at 300; two channels of one code can both be chosen."""
    record = record_of(isomme("10VEHC000000ACXD", "10TUNN000000ACXC", "10SILL000000ACXP", "10SILL000000ACXP"), "T1")
    cutoffs = {one.name: one.cutoff_hz for one in record.channels}
    assert cutoffs == {
        "10VEHC000000ACXD": 100.0,
        "10TUNN000000ACXC": 300.0,
        "10SILL000000ACXP#1": None,
        "10SILL000000ACXP#2": None,
    }


def test_redundant_sensors_of_one_code_are_averaged() -> None:
    """As NHTSA's downloads have them: left and right, each twice under one code."""
    seats = ("10SEATLERE00ACXP", "10SEATRIRE00ACXP")
    record = record_of(isomme("11HEADCG0000ACXP", *seats, "10ENGN000000ACXP", *seats), "T1")
    assert record.proposed == tuple(f"{seat}#{number}" for number in (1, 2) for seat in seats)
    assert [channel.name for channel in record.channels] == [*record.proposed, "10ENGN000000ACXP"]
    assert settle(record, Choices(front_share=0.56)).channels == record.proposed


@pytest.mark.parametrize(
    ("descriptor", "named"),
    [
        (("Type of the test", "VEHICLE INTO VEHICLE"), "VEHICLE INTO VEHICLE"),
        (("Subtype of the test", "40 % overlap"), "40 % overlap"),
        (("Impact side test object 1", "LE"), "impact side LE"),
        (("Impact side test object 1", "FR"), ""),
        (("Type of the test", "VEHICLE INTO BARRIER"), ""),
    ],
)
def test_another_crash_is_named(descriptor: tuple[str, str], named: str) -> None:
    """By the type of the test or the side of the impact."""
    record = record_of(IsommeTest("T1", [*DESCRIPTORS, descriptor], (channel("10VEHC000000ACXP"),)), "T1")
    assert record.other_setup == named


@needs_shared
def test_nhtsas_download_is_the_pulse_of_its_ascii_form() -> None:
    """A test written by pyisomme with NHTSA's codes: speed to its two digits, pulse to the bit."""
    (own,) = read_nhtsa(REAL / "nhtsa_10146_camry2018")
    (record,) = read_isomme_record(REAL / "formats/isomme_seat/nh_g.zip")
    assert record.condition.speed_mps == pytest.approx(own.condition.speed_mps, abs=5e-3)
    speed = PartialCondition(own.condition.speed_mps)
    pulses = [settle(one, Choices(condition=speed, front_share=0.56)).pulse for one in (own, record)]
    np.testing.assert_array_equal(pulses[0].accel_mps2, pulses[1].accel_mps2)


def test_a_test_without_such_a_channel_is_refused() -> None:
    """Dummies alone make no pulse."""
    with pytest.raises(DataError, match="an X acceleration of the vehicle"):
        record_of(isomme("11HEAD0000H3ACXP"), "T1")


def test_axle_weights_of_our_own_exports_are_read() -> None:
    """What crashfuse itself writes comes back with its weights."""
    own = [(".Front weight test object 1", "900"), (".Rear weight test object 1", "700")]
    record = record_of(IsommeTest("T1", [*DESCRIPTORS, *own], (channel("10VEHC000100ACXD"),)), "T1")
    assert (record.condition.front_weight_kg, record.condition.rear_weight_kg) == (900, 700)
