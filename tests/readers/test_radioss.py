"""Runs of Radioss: a vehicle's pulse, speed, mass and energies are read; anything else is told in a sentence."""

import re
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse.errors import DataError
from crashfuse.files.archive import zipped
from crashfuse.importing import Choices, Reading, Settled, format_of, import_source, read_records, settle
from crashfuse.readers.radioss import read_binary, read_converted, read_radioss
from crashfuse.readers.radioss_history import TimeHistory, Watched, with_names
from crashfuse.readers.record import Record
from crashfuse.testing.readers import written
from crashfuse.units import MS
from tests.conftest import SHARED, needs_shared
from tests.importing.crash_files import sentence
from tests.importing.crashes import CRUSH_M, PEAK_MPS2, SPEED_MPS, STOP_S
from tests.readers.radioss_files import MASS_KG, Converter, RadiossRun
from tests.readers.test_lsdyna import WEIGHTS

FILES = SHARED / "real" / "formats" / "radioss"
RUN = RadiossRun()


def only(folder: Path, **files: bytes) -> Record:
    """The one record of these files, each named after its key (``hc1T01_csv`` has the suffix .csv)."""
    named = {name.replace("_csv", ".csv").replace("_thy", ".thy"): content for name, content in files.items()}
    (record,) = read_records(Reading(written(folder, named)))
    return record


def is_the_crash(record: Record) -> Settled:
    """Settle it and compare with what the run was made of."""
    assert record.condition.speed_mps == pytest.approx(SPEED_MPS, rel=1e-5)
    settled = settle(record, WEIGHTS, role="cae")
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=2e-3)
    motion = settled.pulse.kinematics(settled.condition.speed_mps)
    assert motion.t0_s == pytest.approx(STOP_S, abs=1e-4)
    assert motion.displacement_m.max() == pytest.approx(CRUSH_M, rel=2e-3)
    return settled


def refusal(folder: Path, **files: bytes) -> str:
    return sentence(lambda: only(folder, **files))


@pytest.mark.parametrize("layout", [3040, 3050, 4021])
@pytest.mark.parametrize("curves", [("DX", "DZ", "VX", "AX"), ("VX", "AX"), ("VX",), ("AX",)])
def test_the_pulse_of_what_lies_behind_the_crush_is_read(tmp_path: Path, curves: tuple[str, ...], layout: int) -> None:
    content = RadiossRun(curves, layout=layout).binary()
    (tmp_path / "hc1T01").write_bytes(content)
    assert format_of(tmp_path / "hc1T01") == "radioss"
    record = only(tmp_path / "run", hc1T01=content)
    assert (record.id, record.proposed, len(record.channels)) == ("hc1", ("758",), 2)
    assert record.condition.mass_kg == pytest.approx(MASS_KG)
    settled = is_the_crash(record)
    assert (settled.unit, settled.deceleration_sign) == ("mm/ms²", "positive")


def test_units_are_those_that_the_run_states(tmp_path: Path) -> None:
    """Unless they cannot be: 120 s and 15 m/s in an SI run that really is in mm and ms. It may drive along y."""
    stated = only(tmp_path / "a", hc1T01=RadiossRun(layout=4021).binary())
    assert "Unit mm/ms², as the run states its units." in stated.steps
    wrong = only(tmp_path / "b", hc1T01=RadiossRun(layout=4021, factors=(1.0, 1.0, 1.0)).binary())
    assert any(step.startswith("Units mm and ms: the run ends at") for step in wrong.steps)
    along_y = only(tmp_path / "c", hc1T01=RadiossRun(("DY", "VX", "VY", "AX", "AY"), axis="Y").binary())
    assert "Travel along -y, as the nodes set out." in along_y.steps
    for record in (stated, wrong, along_y):
        is_the_crash(record)


def test_an_accelerometer_in_a_skew_of_its_own_is_read(tmp_path: Path) -> None:
    for gauge in (("AX", "AY", "AZ"), ("AX", "AY", "AZ", "WX", "WY", "WZ")):
        record = only(tmp_path / gauge[-1], hc1T01=RadiossRun((), gauge).binary())
        assert (record.proposed, record.channels[0].label) == (("accelerometer 9",), "rear seat")
        is_the_crash(record)
    record = only(tmp_path / "both", hc1T01=RadiossRun(gauge=("AX", "AY", "AZ")).binary())
    assert {channel.name for channel in record.channels} == {"accelerometer 9", "690", "758"}
    is_the_crash(replace(record, proposed=("accelerometer 9",)))


def test_an_accelerometer_may_be_no_pulse_or_lack_a_speed(tmp_path: Path) -> None:
    """A ΔV of 2 % of the initial velocity: it has to be chosen. Without global histories nothing tells its speed."""
    record = only(tmp_path / "crossed", hc1T01=RadiossRun((), ("AY", "AZ")).binary())
    assert record.proposed == ()
    assert "No accelerometer's ΔV is that of a vehicle that stops; are its columns crossed?" in record.steps
    with pytest.raises(DataError, match="that is the vehicle's pulse"):
        settle(record, WEIGHTS, role="cae")
    record = only(tmp_path / "alone", hc1T01a=RadiossRun((), ("AX", "AY", "AZ"), globals_=0).binary())
    assert record.no_speed == "accelerometers alone, without an initial velocity"
    known = replace(WEIGHTS, condition=replace(WEIGHTS.condition, speed_mps=SPEED_MPS))
    assert settle(record, known, role="cae").pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=2e-3)


def test_a_vehicle_struck_at_rest_needs_its_direction_and_speed(tmp_path: Path) -> None:
    """Nothing sets out, so it is refused, until the user says along which axis it is pushed, and how fast."""
    content = replace(RUN, pushed=True).binary()
    assert "give axis and speed (--travel, --speed-kph)" in refusal(tmp_path / "a", hc1T01=content)
    (record,) = read_radioss(written(tmp_path / "b", {"hc1T01": content}), "x")
    assert record.no_speed == "nodes at rest along x at the start"
    with pytest.raises(DataError, match="set out along x, found along -x"):
        read_radioss(written(tmp_path / "c", {"hc1T01": RUN.binary()}), "x")


@pytest.mark.parametrize("form", ["T01", "T01.csv"])
def test_quality_is_that_of_the_global_histories(tmp_path: Path, form: str) -> None:
    """Of all energy less the work from outside 3 % are lost in time; hourglass 0.04 of 0.8; 1.25 % added mass."""
    (record,) = read_records(Reading(written(tmp_path, {f"hc1{form}": RUN.csv() if "csv" in form else RUN.binary()})))
    assert astuple(record.quality) == pytest.approx((-0.03 * (1 - 1 / 1200), 0.05, 0.0125), rel=1e-3)


def test_a_barrier_that_does_not_move_is_no_mass_of_the_vehicle(tmp_path: Path) -> None:
    """A model of 1700 kg that moves and 800 kg that does not: momentum and kinetic energy know only the vehicle."""
    table = RUN.csv(titled=True).decode().splitlines()
    column = table[0].split(",").index('"MASS"')
    rows = [",".join("2.500000e+03" if i == column else cell for i, cell in enumerate(r.split(","))) for r in table[1:]]
    record = only(tmp_path, hc1T01_csv=("\n".join([table[0], *rows]) + "\n").encode())
    assert record.condition.mass_kg == pytest.approx(MASS_KG, rel=1e-5)
    assert any("of 2500 in all" in step for step in record.steps)


@pytest.mark.parametrize(
    ("damage", "found"),
    [
        (lambda _: b"", "one that was cut short"),
        (lambda _: b"x" * 5000, "one that was cut short, or another kind"),
        (lambda content: content[:200], "cut short"),
        (lambda content: content[:1200], "found "),
        (lambda content: content[:-40_000] + b"\1" * 20_000, "states that are not alike"),
        (
            lambda content: content[:8] + b"\xff" * 80 + content[88:184] + b"\x7f" * 24 + content[208:],
            "a senseless header",
        ),
        (lambda content: b"\x54\0\0\0" + content[4:], r"another kind of file; .* default form \(/TFILE/4\)"),
        (lambda _: b"hc1T01 FORMAT\nZZZZZEOR    1I   72C\n 3040Nova\n", "another kind of file"),
    ],
)
def test_a_file_that_cannot_be_read_is_told(tmp_path: Path, damage: Callable[[bytes], bytes], found: str) -> None:
    path = written(tmp_path, {"hc1T01": damage(RUN.binary())}) / "hc1T01"
    assert re.search(found, sentence(lambda: read_radioss(path)))


def test_a_run_that_was_stopped_is_read_to_its_last_whole_state(tmp_path: Path) -> None:
    for name, content in (("hc1T01", RUN.binary()), ("hc1T01_csv", RUN.csv())):
        for lost in (1, 30):
            record = only(tmp_path / f"{name}{lost}", **{name: content[:-lost]})
            assert record.channels[0].time_s.size == RUN.time_ms.size - 1
            assert any(step.endswith("is cut short and left out.") for step in record.steps)
            is_the_crash(record)


@pytest.mark.parametrize("form", ["hc1T{:02}", "hc1T{:02}_csv", "hc1_{:04}_thy"])
def test_a_restarted_run_is_one_run(tmp_path: Path, form: str) -> None:
    """Its second part computes 5 ms anew and replaces them; the first alone would end while the car still moves."""
    parts = {form.format(1): replace(RUN, end_ms=60.0), form.format(2): replace(RUN, begin_ms=55.0, end_ms=120.0)}
    files = {name: run.csv() if "csv" in name else run.binary() for name, run in parts.items()}
    record = only(tmp_path, **files)
    np.testing.assert_allclose(record.channels[0].time_s, RUN.time_ms * MS, atol=1e-8)
    assert sum(step.startswith("Joined from hc1") for step in record.steps) == 1
    is_the_crash(record)
    with_second = written(tmp_path, {}) / form.format(2).replace("_csv", ".csv").replace("_thy", ".thy")
    (same,) = read_radioss(with_second)
    np.testing.assert_array_equal(same.channels[0].values, record.channels[0].values)


def test_a_run_with_a_part_missing_is_refused(tmp_path: Path) -> None:
    early, late = replace(RUN, end_ms=60.0).binary(), replace(RUN, begin_ms=80.0).binary()
    other = replace(RUN, curves=("VX",), begin_ms=60.0).binary()
    for n, (files, told) in enumerate(
        (
            ({"hc1T01": early, "hc1T03": late}, "expected every part once, from T01 on, found hc1T01 and hc1T03"),
            ({"hc1T02": late}, "found hc1T02"),
            ({"hc1T01": early, "hc1T02": late}, "expected states from 59.9 on, found the first at 80"),
            ({"hc1T01": early, "hc1T02": other}, "found others; keep runs"),
        )
    ):
        assert told in refusal(tmp_path / f"{n}", **files)


def test_nodes_may_lie_in_an_additional_file(tmp_path: Path) -> None:
    """``T01a`` has its own output interval and no global histories; those of ``T01`` are taken."""
    main, more = RadiossRun(curves=(), step_ms=1.0), replace(RUN, globals_=0)
    record = only(tmp_path / "both", hc1T01=main.binary(), hc1T01a=more.binary())
    assert record.quality.hourglass_share == pytest.approx(0.05)
    is_the_crash(record)
    alone = only(tmp_path / "alone", hc1T01a=more.binary())
    assert not alone.quality.recorded
    is_the_crash(alone)


def test_a_folder_of_runs_is_a_library(tmp_path: Path) -> None:
    files = {"aT01": RUN.binary(), "aT01.csv": RUN.csv(), "b-2T01": RUN.binary()}
    assert [record.id for record in read_radioss(written(tmp_path / "one", files))] == ["a", "b-2"]
    files = {"a/hc1T01": RUN.binary(), "b/hc1T01": RUN.binary(), "b/hc1T01_TITLES": b"         0 VX"}
    assert [record.id for record in read_radioss(written(tmp_path / "many", files))] == ["a-hc1", "b-hc1"]
    tables = dict.fromkeys(("x/aT01.csv", "y/bT01.csv"), RUN.csv())
    for of, ids in ((files, ["a-hc1", "b-hc1"]), (tables, ["a", "b"])):
        written(tmp_path, {"runs.zip": zipped(of)})
        assert [record.id for record in read_records(Reading(tmp_path / "runs.zip"))] == ids


@pytest.mark.parametrize("titled", [False, True])
@pytest.mark.parametrize("version", ["2022", "doubled", "today"])
@pytest.mark.parametrize("written", [12, 15, 18, 22])
def test_the_csv_gives_the_original_numbers(tmp_path: Path, version: Converter, titled: bool, written: int) -> None:
    run = replace(RUN, globals_=written, curves=("DX", "DZ", "VX", "VZ", "AX"))
    original = only(tmp_path / "T01", hc1T01=run.binary())
    converted = only(tmp_path / "csv", hc1T01_csv=run.csv(version, titled=titled))
    assert converted.proposed == original.proposed == ("758",)
    for mine, its in zip(converted.channels, original.channels, strict=True):
        assert (mine.name, mine.unit) == (its.name, its.unit)
        np.testing.assert_allclose(mine.time_s, its.time_s, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(mine.values, its.values, rtol=0, atol=1e-6 * np.abs(its.values).max())
    is_the_crash(converted)


@pytest.mark.parametrize("titled", [False, True])
def test_accelerometers_of_a_csv_are_told_by_their_change_of_velocity(tmp_path: Path, titled: bool) -> None:
    run = RadiossRun((), ("AX", "AY", "AZ"), globals_=12)
    record = only(tmp_path, hc1T01_csv=run.csv(titled=titled))
    assert record.proposed == ("accelerometer 9",)
    is_the_crash(record)


def test_an_impulse_is_never_taken_for_motion(tmp_path: Path) -> None:
    """It grows as the velocity falls; that of a truck of 15 t (mm, s, t) integrates to about its speed, too."""
    said = refusal(tmp_path, hc1T01_csv=RadiossRun(()).csv())
    assert "found unnamed columns of w (1); import the T01 itself" in said
    time = RUN.time_ms * MS
    velocity = RUN.motion()["V"] * 1e3
    model = {f"{axis}-MOMENTUM": 15 * velocity * (axis == "X") for axis in "XYZ"}
    model["KINETIC ENERGY"] = 15 * velocity**2 / 2
    impulse, accel = 15 * (velocity - velocity[0]), RUN.motion()["A"] * 1e6
    assert 0.8 < np.trapezoid(impulse, time) / SPEED_MPS / 1e3 < 1.6
    for column, read in ((impulse, 0), (0.9 * impulse, 0), (accel, 1)):
        wall = Watched("1", "wall", time, {"var 9": column})
        assert len(with_names(TimeHistory("", time, model, (wall,))).watched) == read


def test_labels_with_stray_characters_are_read(tmp_path: Path) -> None:
    """Control characters and even a line break before the closing quote, as some versions write them."""
    content = RUN.csv(titled=True).replace(b'VX         "', b'VX        \x18\x0c"')
    assert b"\x18" in content
    is_the_crash(only(tmp_path, run7_csv=content.replace(b'AX         "', b'AX   \n"')))


def test_rows_that_hold_no_state_each_are_refused(tmp_path: Path) -> None:
    """Of a time history that was cut short the converter wraps its rows at the wrong place."""
    head, *rows = RUN.csv().decode().splitlines()
    cells = ",".join(rows).split(",")
    wrapped = [",".join(cells[at : at + 31]) for at in range(0, len(cells) // 31 * 31, 31)]
    assert "import the T01 itself." in refusal(tmp_path, hc1T01_csv="\n".join([head, *wrapped, ""]).encode())


@needs_shared
def test_a_vehicle_of_openradioss_is_read_as_its_converter_reads_it(tmp_path: Path) -> None:
    (record,) = read_radioss(FILES / "veh_pickup" / "hc1T01")
    table = pd.read_csv(FILES / "veh_pickup" / "hc1T01.csv")
    table.columns = [name.strip() for name in table.columns]
    assert record.proposed == ("758",)
    np.testing.assert_allclose(record.channels[0].time_s, table["time"] * 1e-3, rtol=1e-6, atol=1e-9)
    _, _, velocity, accel = table.filter(regex="^mains +758").to_numpy().T
    np.testing.assert_allclose(record.channels[0].values, accel, rtol=0, atol=1e-6 * np.abs(accel).max())
    settled = settle(record, Choices(front_share=0.55), role="cae")
    motion = settled.pulse.kinematics(settled.condition.speed_mps)
    assert record.condition.speed_mps == pytest.approx(abs(velocity[0]), rel=1e-6)
    crossing = table["time"][int(np.argmax(velocity >= 0))]
    assert motion.t0_s * 1e3 == pytest.approx(crossing, abs=0.3)
    energy = table[["INTERNAL ENERGY", "KINETIC ENERGY", "ROTATION ENERGY", "CONTACT ENERGY", "HOURGLASS ENERGY"]]
    change = energy.sum(axis=1) - table["EXTERNAL WORK"] - energy.iloc[0].sum()
    assert record.quality.energy_change == pytest.approx(change[change.abs().idxmax()] / energy.iloc[0].sum(), rel=1e-3)
    assert record.quality.hourglass_share == 0.0
    assert record.quality.added_mass_share == pytest.approx(table["PERCENTAGE ADDED MASS"].max() / 100, rel=1e-6)
    (twin,) = import_source(FILES / "veh_pickup" / "hc1T01.csv", tmp_path, Choices(front_share=0.55), role="cae")
    np.testing.assert_allclose(twin.pulse.accel_mps2, settled.pulse.accel_mps2, rtol=0, atol=1e-6 * PEAK_MPS2)


@needs_shared
def test_an_accelerometer_of_openradioss_is_the_same_in_both_forms() -> None:
    """Its converter labels three columns too many here; read are columns 13 to 15, as ``var 13`` to ``var 15`` say."""
    rows = pd.read_csv(FILES / "ACCELEROT01.csv", header=None, skiprows=1).to_numpy()
    read = read_binary((FILES / "ACCELEROT01").read_bytes(), "T01")
    converted = read_converted((FILES / "ACCELEROT01.csv").read_bytes(), "T01.csv")
    gauge = next(one for one in read.watched if one.is_accelerometer)
    unnamed = next(one for one in converted.watched if "ACCEL" in one.title)
    for column, curve in zip((13, 14, 15), gauge.curves.values(), strict=True):
        np.testing.assert_allclose(curve, rows[:, column], rtol=1e-6)
        np.testing.assert_array_equal(unnamed.curves[f"var {column}"], rows[:, column])
    np.testing.assert_allclose(read.model["HOURGLASS ENERGY"], rows[:, 12], rtol=1e-6)
    np.testing.assert_array_equal(converted.model["HOURGLASS ENERGY"], rows[:, 12])


@needs_shared
@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("ACCELEROT01", "expected nodes fastest at the start"),
        ("ACCELEROT01.csv", "found a model at rest when the run begins"),
        ("BOX1BLT01", "expected a vehicle of 300 kg to 60 t, found 240; choose"),
    ],
)
def test_runs_without_a_vehicle_are_fairly_refused(name: str, found: str) -> None:
    assert found in sentence(lambda: settle(read_radioss(FILES / name)[0], role="cae"))
