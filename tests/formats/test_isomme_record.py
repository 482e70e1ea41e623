"""ISO-MME as a record: which channels could be the pulse, and what the test says of its condition."""

from pathlib import Path

import pytest

from crashfuse.errors import DataError
from crashfuse.formats.isomme import Channel, IsommeTest
from crashfuse.formats.isomme_record import isomme_record, record_of
from crashfuse.formats.isomme_writer import isomme_files
from crashfuse.importing import Choices, settle
from crashfuse.units import KPH, G
from tests.importing.crashes import SPEED_MPS, STOP_S, clock, half_sine_g

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
        (("10ENGN000000ACXP",), ("10ENGN000000ACXP",)),
        (("10ENGN000000ACXP", "10ENGN000001ACXP"), ()),
    ],
)
def test_channels_are_proposed_by_where_they_sit(codes: tuple[str, ...], proposed: tuple[str, ...]) -> None:
    """The vehicle's own first, then sills left and right; never a dummy; of two filter classes the raw one."""
    record = record_of(isomme(*codes), "T1")
    assert record.proposed == proposed
    assert not any("HEAD" in one.name or "ACY" in one.name for one in record.channels)


def test_a_test_becomes_a_pulse(tmp_path: Path) -> None:
    """From the folder to t0 in closed form, with the mass shared as the user says."""
    for name, content in isomme_files(isomme("10VEHC000000ACXP")).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    record = isomme_record(tmp_path / "T1")
    with pytest.raises(DataError, match="the front weight of T1"):
        settle(record)
    settled = settle(record, Choices(front_share=0.56))
    assert (settled.unit, settled.braking, settled.time_zero_s) == ("m/s²", "negative", 0.0)
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


def test_a_test_without_such_a_channel_is_refused() -> None:
    """Dummies alone make no pulse."""
    with pytest.raises(DataError, match="an X acceleration of the vehicle"):
        record_of(isomme("11HEAD0000H3ACXP"), "T1")


def test_axle_weights_of_our_own_exports_are_read() -> None:
    """What crashfuse itself writes comes back with its weights."""
    own = [(".Front weight test object 1", "900"), (".Rear weight test object 1", "700")]
    record = record_of(IsommeTest("T1", [*DESCRIPTORS, *own], (channel("10VEHC000100ACXD"),)), "T1")
    assert (record.condition.front_weight_kg, record.condition.rear_weight_kg) == (900, 700)
