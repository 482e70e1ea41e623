"""What tables from laboratories have in them besides one time and one pulse: each is read rightly or refused."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import DataError, UsageError
from crashfuse.importing import ColumnChoice, Reading, import_source, read_each, read_records, settle_each
from crashfuse.importing.sources import table_forms, tables_of
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.table_mapping import apply_conditions, propose
from crashfuse.readers.tables import read_sheets
from crashfuse.signals.pulse import FloatArray, kinematics
from crashfuse.testing.readers import written
from crashfuse.units import KPH, MS, G
from tests.conftest import SHARED, needs_shared, problems_of
from tests.importing.crash_files import german, library, sentence, workbook
from tests.importing.crashes import GIVEN, clock, half_sine_g, scatter_g

TIME_S = clock(-0.02, 0.15, 5000)
PULSE_G = half_sine_g(TIME_S)


def lines(header: str, *columns: FloatArray) -> str:
    """A table with semicolons and decimal points; NaN leaves a cell empty."""
    rows = np.column_stack(columns).tolist()
    return "\n".join([header, *(";".join("" if c != c else f"{c:.5f}" for c in row) for row in rows)])


def table(folder: Path, header: str, *columns: FloatArray, name: str = "x.csv") -> Path:
    path = folder / name
    path.write_text(lines(header, *columns), encoding="utf-8")
    return path


def refusal(path: Path, conditions: Path | None = None) -> str:
    said = sentence(lambda: import_source(path, path.parent / "out", GIVEN, conditions=conditions))
    assert not (path.parent / "out").exists()
    return said


def by_id(records: Sequence[Record]) -> dict[str, Record]:
    return {record.id: record for record in records}


def side_by_side(folder: Path, headers: str) -> Path:
    """Two tests, the second twice as long and with 20 ms more before contact; the shorter ends in empty cells."""
    later_s = clock(-0.04, 0.3, 5000)
    padding = (0, later_s.size - TIME_S.size)
    first = [np.pad(column, padding, constant_values=np.nan) for column in (TIME_S / MS, PULSE_G)]
    return table(folder, headers, *first, later_s / MS, half_sine_g(later_s))


def test_each_acceleration_has_the_time_to_its_left(tmp_path: Path) -> None:
    path = side_by_side(tmp_path, "Test 1;;Test 2;\nt [ms];ax [g];t [ms];ax [g]")
    records = by_id(read_records(Reading(path)))
    assert list(records) == ["Test 1", "Test 2"]
    for record, start_s, count in zip(records.values(), (-0.02, -0.04), (TIME_S.size, 1701), strict=True):
        (channel,) = record.channels
        assert (channel.time_s[0], channel.values.size) == (pytest.approx(start_s), count)
        np.testing.assert_allclose(channel.values, half_sine_g(channel.time_s), atol=1e-3)
        assert any("times side by side" in step for step in record.steps)
    first, second = settle_each(records.values(), [], GIVEN)
    assert (first.time_zero_s, second.time_zero_s) == (0.0, 0.0)
    with pytest.raises(UsageError, match="One id is not enough"):
        import_source(path, tmp_path / "other", GIVEN, record_id="T1")


def test_sensors_with_times_of_their_own_are_no_tests(tmp_path: Path) -> None:
    """Titles that name channels: refused, until the others are left out or conditions say that they are crashes."""
    path = side_by_side(tmp_path, "sill left;;sill right;\nt [ms];left [g];t [ms];right [g]")
    said = "found left, right, each with a time of its own; if they are sensors of one crash, leave out the others"
    assert said in refusal(path)
    (one,) = read_records(Reading(path, columns=(ColumnChoice("right [g]", "ignored"),)))
    assert one.id == "left"
    conditions = tmp_path / "of_both.txt"
    conditions.write_text("id;v [km/h];VA [kg];HA [kg]\nleft;56;950;750\nRIGHT;56;950;750\n")
    assert list(by_id(read_records(Reading(path, conditions=conditions)))) == ["left", "right"]


def test_two_sensors_of_one_crash_are_not_two_tests(tmp_path: Path) -> None:
    right_g = PULSE_G + scatter_g(TIME_S, 2.0)
    path = table(tmp_path, "t [ms];ax left [g];ax right [g]", TIME_S / MS, PULSE_G, right_g)
    said = refusal(path)
    assert "found ax left, ax right; if they are sensors of one crash, average them (--id ID)" in said
    assert "(--channel 'ax left [g]')" in said
    (one,) = import_source(path, tmp_path / "one", GIVEN, record_id="T1")
    assert one.channels == ("ax left [g]", "ax right [g]")
    alike = table(tmp_path, "t [ms];ax [g];ax [g]", TIME_S / MS, PULSE_G, PULSE_G, name="alike.csv")
    assert "found ax, ax (3); if" in refusal(alike)
    conditions = tmp_path / "c.txt"
    conditions.write_text("id;v [km/h];VA [kg];HA [kg]\nax left;56;950;750\n")
    said = refusal(path, conditions=conditions)
    assert "expected conditions for ax right, found those of ax left; add rows, or leave" in said
    conditions.write_text("id;v [km/h];VA [kg];HA [kg]\nax left;56;950;750\nax right;56;950;750\n")
    assert len(import_source(path, tmp_path / "two", conditions=conditions)) == 2
    assert len(read_each(Reading(path))[0]) == 2  # before anything is added, both can be looked at


@pytest.mark.parametrize("engine", ["engine_top_X [g]", "Motor oben ax [g]", "10ENGN000000ACXP [g]"])
def test_the_engine_is_not_averaged_with_the_floor(tmp_path: Path, engine: str) -> None:
    path = table(tmp_path, f"t [ms];floor left ax [g];{engine}", TIME_S / MS, PULSE_G, 1.3 * PULSE_G)
    (one,) = import_source(path, tmp_path / "floor", GIVEN, record_id="T1")
    assert one.channels == ("floor left ax [g]",)
    assert f"Ahead of the passenger cell, not averaged: {engine}." in one.steps
    (chosen,) = import_source(path, tmp_path / "engine", replace(GIVEN, channels=(engine,)), record_id="T1")
    assert chosen.channels == (engine,)
    header = "t [ms];ax left [g];transmission tunnel X [g]"
    tunnel = table(tmp_path, header, TIME_S / MS, PULSE_G, PULSE_G, name="t.csv")
    assert len(import_source(tunnel, tmp_path / "tunnel", GIVEN, record_id="T1")[0].channels) == 2
    (alone,) = read_records(Reading(table(tmp_path, f"t [ms];{engine}", TIME_S / MS, PULSE_G, name="alone.csv")))
    assert alone.proposed == (engine,)


@pytest.mark.parametrize(
    "header",
    [
        "Time (sec)     Veh Accel Lat (g)    Veh Accel Long (g)",
        "Time (sec) Veh Accel Lat (g) Veh Accel Long (g)",
        "  Time sec\tVeh Accel Lat g\tVeh Accel Long g",
        "# Time_s ay_g ax_g",
        "Site 5, new sensors\nTime    Lateral Accel    Long Accel\n(s)     (g)     (g)",
    ],
)
def test_names_with_blanks_stand_above_columns_separated_by_blanks(tmp_path: Path, header: str) -> None:
    path = tmp_path / "x.txt"
    rows = "\n".join(f"{t:.5f}   {0.1 * a:.5f}   {a:.5f}" for t, a in zip(TIME_S, PULSE_G, strict=True))
    path.write_text(f"{header}\n{rows}")
    (sheet,) = read_sheets(path)
    (record,) = read_records(Reading(path))
    assert record.proposed == (sheet.columns[2],)
    np.testing.assert_allclose(record.channels[0].values, PULSE_G, atol=1e-5)


def test_duplicate_times_are_called_that(tmp_path: Path) -> None:
    said = refusal(table(tmp_path, "t [s];ax [g]", np.round(TIME_S, 3), PULSE_G))
    assert "x.csv, column t [s], row 3: expected each time once, found -0.02000 after -0.02000" in said


DUMMIES = (
    "Kopf Fahrer ax [g];Brust ax [g];11PELV0000H3ACXA [g];10SILLLE0000ACYA [g];Hochbeschleunigung [g];"
    "B-Säule Querbeschleunigung [g];chest acceleration"
)


@pytest.mark.parametrize(
    ("header", "pulse"),
    [
        ("Time (s);Veh Accel Lat (g);Veh Accel Long (g);Veh Accel Vert (g)", "Veh Accel Long (g)"),
        ("Time (s);LatAcc (g);Veh Accel Long (g);VertAcc (g)", "Veh Accel Long (g)"),
        ("Time (s);Acc. lat. (g);Accel Transversal (g);Long Acc (g);Acc. vert. (g)", "Long Acc (g)"),
        ("t [s];11VEHC0000__ACY_ [g];11VEHC0000__ACX_ [g];11VEHC0000__ACZ_ [g]", "11VEHC0000__ACX_ [g]"),
        ("t [s];11HEAD0000H3ACX_ [g];11VEHC0000__ACX_ [g];11VEHC0000__DSX_ [g]", "11VEHC0000__ACX_ [g]"),
        (f"t [s];{DUMMIES};Querträger ax [g]", "Querträger ax [g]"),
        ("t [s];t [ms];ax [g]", "ax [g]"),
        ("Time [s];Kanal 1", "Kanal 1"),
        *((f"Time [s];{other}", "") for other in ("Barrier force Fx [kN]", "Fx [kN]", "Kraft", "Weg", "disp_x")),
        *((f"Time [s];{other}", "") for other in ("Signal [mm]", "Druck (bar)", "Accel [V]")),
        ("t [s];Kopf ax [g];Kanal 2", ""),
    ],
)
def test_the_pulse_is_the_acceleration_of_the_vehicle_along_x(tmp_path: Path, header: str, pulse: str) -> None:
    (sheet,) = read_sheets(table(tmp_path, header, TIME_S, *[PULSE_G] * header.count(";")))
    assert [use.column for use in propose(sheet).of("acceleration")] == [pulse] * bool(pulse)


def test_what_was_planned_or_carried_is_not_what_was_tested(tmp_path: Path) -> None:
    """Planned and rebound speed, dummies and cargo are kept as factors; the steps tell what each column is."""
    table(tmp_path, "t [ms];ax [g]", TIME_S / MS, PULSE_G, name="V1.csv")
    (tmp_path / "c.txt").write_text(
        "Versuch;Sollgeschwindigkeit [km/h];rebound speed [km/h];Istgeschwindigkeit [km/h];Masse Dummys [kg];"
        "Zuladung hinten [kg];Testmasse inkl. Dummys [kg];Anteil vorn [%]\nV1;50;7;56,1;156;50;1650;58\n"
    )
    (one,) = import_source(tmp_path / "V1.csv", tmp_path / "out", conditions=tmp_path / "c.txt")
    assert one.condition.speed_mps == pytest.approx(56.1 * KPH)
    assert one.condition.front_weight_kg == pytest.approx(0.58 * 1650)
    assert dict(one.condition.factors)["Masse Dummys [kg]"] == "156"


TWICE = {"speed": "v1 [km/h];v2 [km/h]", "mass": "Leergewicht [kg];Testgewicht [kg]"}
TWICE |= {"front_weight": "1 VA [kg];2 VA [kg]"}


@pytest.mark.parametrize("role", TWICE)
def test_two_columns_of_one_quantity_are_a_question(tmp_path: Path, role: str) -> None:
    (sheet,) = read_sheets(written(tmp_path, {"c.csv": f"id;{TWICE[role]}\nT1;1400;1650\n".encode()}) / "c.csv")
    first, second = TWICE[role].split(";")
    told = f"expected one column that is the {role}, found {first}, {second}; map"
    assert told in sentence(lambda: apply_conditions(sheet, propose(sheet)))
    assert apply_conditions(sheet, propose(sheet).overruled(second, "factor"))["T1"].factors == ((second, "1650"),)


@pytest.mark.parametrize(
    ("text", "speed_kph", "front_kg"),
    [
        ("id;v [km/h];mass [kg];front share [%]\nT1;50;1000;0.58\n", 50, 580),  # Excel keeps 58 % as 0.58
        ("id;v [km/h];mass [kg];front share [%]\nT1;50;1000;58\n", 50, 580),
        ("id;v [km/h];mass [kg];Frontanteil\nT1;50;1000;0.58\n", 50, 580),
        (
            "Versuch;Zeit;v [km/h];VA [kg];HA [kg];TTF [ms];peak [g]\n"
            "T1;10:30;56,1;950;700;12;40\nV2;11:30;56;9,5e2;700;11;41\n",
            56.1,
            950,
        ),  # an hour, the moment of ignition and a peak are no pulse
    ],
)
def test_conditions_are_read_whatever_is_beside(tmp_path: Path, text: str, speed_kph: float, front_kg: float) -> None:
    """A share in per cent or not; the hour of a test is not the time of a pulse."""
    (sheet,) = read_sheets(written(tmp_path, {"c.csv": text.encode()}) / "c.csv")
    found = apply_conditions(sheet, propose(sheet))["T1"]
    assert (found.speed_mps, found.front_weight_kg) == pytest.approx((speed_kph * KPH, front_kg))


@pytest.mark.parametrize(
    ("header", "columns"),
    [("id;v [km/h];VA [kg];HA [kg]", {"HA [kg]"}), ("id;speed;front load;HA [kg]", {"speed", "front load", "HA [kg]"})],
)
def test_every_fault_among_conditions_is_told_once(tmp_path: Path, header: str, columns: set[str]) -> None:
    pulse = lines("t [ms];ax [g]", TIME_S / MS, PULSE_G).encode()
    files = {"A.csv": pulse, "B.csv": pulse, "c.csv": f"{header}\nA;56;950;fast\nB;56;950;700\n".encode()}
    problems = problems_of(lambda: import_source(written(tmp_path / "in", files), tmp_path / "out"))
    assert {problem.column for problem in problems} == columns
    assert {problem.where for problem in problems} == {"c.csv"}


def test_records_below_each_other_are_not_to_be_sorted(tmp_path: Path) -> None:
    """Their ids lie in a column whose header says nothing: it is asked for; a problem then names its record."""
    path = tmp_path / "long.csv"
    rows = "\n".join(f"{name};{t / MS:.2f};{a:.4f}" for name in "AB" for t, a in zip(TIME_S, PULSE_G, strict=True))
    path.write_text(f"Fahrzeug;Zeit [ms];a [g]\n{rows}\n")
    said = refusal(path)
    assert f"column Zeit [ms], row {TIME_S.size + 2}: expected time that increases" in said
    assert "found -20.00 after 150.00; map the column of ids (--column COLUMN=id)" in said
    ids = (ColumnChoice("Fahrzeug", "id"),)
    assert list(by_id(read_records(Reading(path, columns=ids)))) == ["A", "B"]
    slow = replace(GIVEN, condition=replace(GIVEN.condition, speed_mps=5.0))
    problems = problems_of(lambda: import_source(path, tmp_path / "out", slow, columns=ids))
    assert [problem.where for problem in problems] == ["long.csv, A", "long.csv, B"]


def test_a_preamble_with_numbers_is_not_the_data(tmp_path: Path) -> None:
    preamble = "".join(f"Key {number};{number}\n" for number in range(7))
    path = tmp_path / "x.csv"
    path.write_text(preamble + lines("Time;Accel\ns;g", TIME_S, PULSE_G))
    (record,) = read_records(Reading(path))
    assert record.channels[0].values.size == TIME_S.size
    whole = lines("Time [s];Accel [g]", TIME_S, PULSE_G).split("\n")
    path.write_text("\n".join([*whole[:51], "# airbag", *whole[51:]]))
    assert "row 52: expected a number, found '# airbag'" in refusal(path)
    rows = "\n".join(f'"{t / MS:.2f}","{a:.4f}"'.replace(".", ",") for t, a in zip(TIME_S, PULSE_G, strict=True))
    path.write_text(f'"Zeit [ms]","a [g]"\n{rows}\n')
    (record,) = read_records(Reading(path))
    np.testing.assert_allclose(record.channels[0].values, PULSE_G, atol=1e-4)


@pytest.mark.parametrize("separator", [".", ","])
def test_thousands_separators_are_no_decimal_signs(tmp_path: Path, separator: str) -> None:
    """-441.234 beside 119 and never -44.1: advice on the unit would lead astray."""
    path = tmp_path / "x.csv"
    noise = 300 * np.random.default_rng(1).normal(size=TIME_S.size)
    cells = [f"{value:,.0f}".replace(",", separator) for value in 9806.65 * PULSE_G + noise]
    rows = (f"{t * 1e6:.0f};{a}" for t, a in zip(TIME_S, cells, strict=True))
    path.write_text("\n".join(["Zeit [µs];a [mm/s²]", *rows]))
    assert "found thousands separators, as in" in refusal(path)
    fine = np.round(PULSE_G * 8) / 8  # halves and eighths, written as short as can be
    path.write_text("Zeit [ms];a [g]\n" + "\n".join(f"{t / MS:g};{a:g}" for t, a in zip(TIME_S, fine, strict=True)))
    np.testing.assert_array_equal(read_records(Reading(path))[0].channels[0].values, fine)


@pytest.mark.parametrize(
    ("accel", "time", "found"),
    [("-0,5", "-20,0", "numbers kept as text, such as '-20,0'"), ("=1+1", -20.0, "formulas")],
)
def test_a_workbook_without_numbers_says_why(tmp_path: Path, accel: str, time: object, found: str) -> None:
    header, rows = ["t [ms]", "ax [g]"], np.column_stack([TIME_S / MS, PULSE_G]).tolist()
    tables = {"x.xlsx": [header, *[[time, accel]] * 30], "y.xlsx": [header, *rows]}
    books = {name: workbook({"a": rows, "rejected": rows}, hidden="rejected") for name, rows in tables.items()}
    assert f"found {found}" in refusal(written(tmp_path, books) / "x.xlsx")
    assert "Left out as hidden: rejected." in read_records(Reading(tmp_path / "y.xlsx"))[0].steps


FILES = SHARED / "real" / "formats"
RIGHT = {14.2: (55.0, 500.0, 47.7), 15.6: (65.7, 611.0, 40.2), 6.5: (65.7, 255.0, 16.8)}  # ms, mm, g by speed in m/s
OF_OTHERS: Sequence[tuple[str, str, dict[str, Any]]] = (
    ("other_quantity/test_velocity_kph.csv", "begins at its largest value", {}),
    ("other_quantity/test_vx.csv", "vx: its name is not an acceleration's", {}),
    ("other_quantity/cae_rwall_kn.csv", "rwall_1: its name is not an acceleration's", {"role": "cae"}),
    ("other_quantity/cae_displacement_inch.csv", "does not end near 0", {"role": "cae"}),
    ("upper_header_rows/T7.csv", "ax_g: a dummy's: Driver head", {}),
    ("upper_header_rows/T12.csv", "Data: a dummy's: Driver head X", {}),
    ("upper_header_rows/T9.csv", r"by its own account ax_g \(Simulation\)", {"role": "tests"}),
    ("upper_header_rows/T13.txt", r"by its own account acc_g \(# Source: FE model run 12\)", {"role": "tests"}),
    ("line_break_in_header/T51.csv", "Acc Y [g]", {}),
    ("cabin_taken_for_dummy/T21.csv", "Occupant compartment X [g]", {}),
    ("dummy_in_other_languages/T41.csv", r"Aceleración cabeza X \[g\]: a dummy's", {}),
    ("non_latin_headers/left_right_6ms.csv", "found 加速度左, 加速度右; if they are sensors of one crash", {}),
    ("non_latin_headers/left_right_6ms.csv", "加速度右.*6 ms later than 加速度左", {"record_id": "V"}),
    ("santa_fe/T31.csv", "Santa Fe acceleration x [g]", {"role": "tests"}),
    ("santa_fe/SF", "11TUNN000000ACXP", {}),
    ("system_files/excel_lock", "Acceleration x [g]", {}),
    ("system_files/appledouble", "Acceleration x [g]", {}),
    ("forms_of_time/seconds_no_unit.csv", "Acceleration x [g]", {}),
    ("tables/lsprepost_trailing_comma.csv", "A8874", {"role": "cae"}),
    ("tables/lsprepost_trailing_comma.csv", "A8874", {"role": "cae", "record_id": "run"}),
    ("tables/lsprepost_trailing_comma.csv", r"by its own account A8874 \(Nodal History\)", {}),
    ("tables/lsprepost_resultant_title.csv", "A8874: another direction than X: Resultant Acceleration", {}),
    ("tables/V8.xlsx", "Acc X [g]", {"cae": ["Simulation 8"]}),
    ("tables/V8.xlsx", r"like CAE runs \(Simulation 8\) beside Versuch 8; .*--cae 'Simulation 8'", {}),
    ("tables/row_names_v6.5mps.txt", "acc", {}),
    ("tables/xyz.txt", "Acc X", {}),  # a contact 0.6 ms late, as before it there is noise
    ("tables/one_head.txt", "Dummy Head Acc X: a dummy's", {}),
    ("tables/decimal_comma_comma_separated_int_ms.csv", "found both, as in -0,383", {}),
)


@needs_shared
@pytest.mark.parametrize(("name", "right", "options"), OF_OTHERS)
def test_each_kind_of_foreign_file_is_read_or_refused_by_its_cause(
    tmp_path: Path, name: str, right: str, options: dict[str, Any]
) -> None:
    speed_mps = 6.5 if "6.5" in name else 15.6 if "tables" in name else 14.2
    given = replace(GIVEN, condition=PartialCondition(speed_mps, front_weight_kg=905.0, rear_weight_kg=655.0))
    if right.endswith((" [g]", "ACXP", "A8874", "acc", "Acc X")):
        one, *others = import_source(FILES / name, tmp_path / "out", given, **options)
        motion = kinematics(one.pulse.accel_mps2[one.pulse.time_s >= 0], speed_mps, one.pulse.dt_s)
        found = motion.t0_s / MS, motion.displacement_m.max() / MS, -one.pulse.accel_mps2.min() / G
        assert one.channels == (right,)
        assert found == pytest.approx(RIGHT[speed_mps], rel=0.015)
        roles = [options.get("role", "tests"), *["cae"] * ("cae" in options)]
        assert [one.role, *(other.role for other in others)] == roles
        return
    with pytest.raises(DataError, match=right) as caught:
        import_source(FILES / name, tmp_path / "out", given, **options)
    assert len(caught.value.problems) == 1
    assert not (tmp_path / "out").exists()


@needs_shared
def test_a_logger_that_counts_within_the_second_is_read_with_its_clock() -> None:
    (record,) = read_records(Reading(FILES / "forms_of_time" / "us_wraps.csv"))
    np.testing.assert_allclose(record.channels[0].time_s, 1e-4 * np.arange(1801), atol=1e-9)


@pytest.mark.parametrize(
    ("above", "right"),
    [
        (";Kopf;Tunnel\n;x;x\nZeit [ms];;", "= x (3)"),  # as pandas writes levels, and the name of the index
        ("place;Dummy;Vehicle\npart;chest;tunnel\nt_ms;;", "= tunnel"),
        ("Driver;;\nhead;head;\nt [ms];ax [g];ay [g]", "ax [g]: a dummy's: head"),
        ("Messstelle;Kopf Fahrer X\nDummy;H3\nEinheit;g\nZeit [ms];Wert", "Wert: a dummy's: Kopf Fahrer X"),
        ("Sensor location;Tunnel\nUnits;g\nDummy;Hybrid III head\nTime (ms);Data", "= Data"),
        ("Name;tête;tunnel\nUnité;g;g\nT;C1;C2", "= C2"),
        ("# Location: Engine top\nt [ms];a [g]", "Careful: a [g]: ahead of the passenger cell"),
        ("Motor oben X\nt [ms];a [g]", "Careful: a [g]: ahead of the passenger cell"),
        ("# Direction: Y\nt [ms];a [g]", "Careful: travel along y"),
        ("Solver;LS-DYNA R13\nt [ms];a [g]", "by its own account a [g] (LS-DYNA R13)"),
        ("Numerical simulation, run 7\nt [ms];a [g]", "by its own account a [g] (Numerical simulation, run 7)"),
        ("Versuch 7 zur Simulation\nHyundai Santa Fe\nt [ms];a [g]", "= a [g]"),
        ("Model: Santa Fe\nFrontal, rigid wall, 2 dummies, engine 1.6 l\nt [ms];a [g]", "= a [g]"),
        ("Channel 1: Driver head X\nChannel 2: Sill X\nt [ms];ch1;ch2", "= ch2"),
        ("Velocity;51 km/h\nSpeed;51 km/h\nt [ms];CH1", "= CH1"),
        ("X-velocity\nTime [ms];A8874", "A8874: no acceleration: X-velocity"),
        ('"t\n[ms]";"Kopf X\n[g]"', "Kopf X [g]: a dummy's"),
        ('"t\r\n[ms]";"Acc Y\r\n(g)";"Tunnel\r\nAcc X\r\n(g)"', "= Tunnel Acc X (g)"),
        ("t [ms];Fußraum links [g];Motor [g]", "= Fußraum links [g]"),
        ("t [ms];乗員室 X [g];エンジン X [g];頭部 X [g]", "= 乗員室 X [g]"),
        ("t [ms];Bumper X [g];testa X [g]", "the channel of x that is the vehicle's pulse, found Bumper X [g]"),
        ("t [ms];Engine X [g];Tunnel Y [g]", "the channel of x that is the vehicle's pulse, found Engine X [g]"),
        ("Время [мс];Ускорение слева [g];Ускорение справа [g]", "found Ускорение слева, Ускорение справа; if they"),
        ("时间（ms）;头部加速度（g）;加速度Y（g）;加速度X（g）", "= 加速度X（g）"),
        ("t [ms];RF1", "RF1: its name is not an acceleration's"),
        ("t [ms];Kontaktkraft", "Kontaktkraft: its name is not an acceleration's"),
        ("t [ms];SANTA-FE floor [g]", "= SANTA-FE floor [g]"),
        ("t [ms];FE-Netz 3 [g]", "by its own account FE-Netz 3 [g]"),
    ],
)
def test_what_names_a_column_is_read_wherever_it_stands(tmp_path: Path, above: str, right: str) -> None:
    n = above.count(";") if '"' in above else max(line.count(";") for line in above.split("\n"))
    path = table(tmp_path, above, TIME_S / MS, *[PULSE_G] * n)
    if right.startswith("= "):
        assert import_source(path, tmp_path / "out", GIVEN)[0].channels == (right[2:],)
    elif right.startswith("Careful"):
        assert right in " ".join(import_source(path, tmp_path / "out", GIVEN)[0].steps)
    else:
        assert right in refusal(path)


@pytest.mark.parametrize(
    ("encoding", "header"),
    [("cp932", "時間 [ms];頭部加速度 [g]"), ("gb18030", "时间 [ms];头部 [g]"), ("cp1251", "Время [ms];голова [g]")],
)
def test_encodings_are_told_by_their_words(tmp_path: Path, encoding: str, header: str) -> None:
    (tmp_path / "x.csv").write_bytes(lines(header, TIME_S / MS, PULSE_G).encode(encoding))
    assert f"{header.partition(';')[2]}: a dummy's" in refusal(tmp_path / "x.csv")


@pytest.mark.parametrize("role", ["tests", "cae"])
def test_a_curve_of_another_quantity_is_asked_about(tmp_path: Path, role: Role) -> None:
    """One of the units always fits: velocity and displacement in any, until the user says that it is one."""
    motion = kinematics(9.80665 * PULSE_G, 15.6, 2e-4)
    velocity, displacement = 3.6 * motion.velocity_mps, 1e3 * motion.displacement_m
    for values, cause in ((velocity, "begins at its largest"), (velocity - 56, "end near"), (displacement, "end near")):
        path = table(tmp_path, "t [ms];CH1", TIME_S / MS, values)
        with pytest.raises(DataError, match=cause):
            import_source(path, tmp_path / "out", GIVEN, role=role)


DAY = datetime(2024, 3, 5, 23, 59, 59, 950_000)


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("Time;a [g]", "{t:%H:%M:%S.%f};{a:.5f}"),
        ("Timestamp;a [g]", "{t:%d.%m.%Y %H:%M:%S,%f};{a:.5f}"),
        ("Date;Time;ms;a [g]", "{t:%Y/%m/%d};{t:%H:%M:%S};{ms:.1f};{a:.5f}"),
        ("µs;a [g]", "{us:.0f};{a:.5f}"),
        ("Time [s];a [g]", "{s:.4f};{a:.5f}"),
    ],
)
def test_clocks_and_counters_that_begin_anew_are_times(tmp_path: Path, header: str, row: str) -> None:
    """Over midnight, a full second or minute; time goes on from the first row."""
    rows = []
    for late_s, a in zip((TIME_S - TIME_S[0]).tolist(), PULSE_G.tolist(), strict=True):
        t = DAY + timedelta(microseconds=round(1e6 * late_s))
        rows.append(row.format(t=t, a=a, ms=t.microsecond / 1e3, us=t.microsecond, s=t.second + t.microsecond / 1e6))
    (tmp_path / "x.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    (record,) = read_records(Reading(tmp_path / "x.csv"))
    time_s = record.channels[0].time_s
    np.testing.assert_allclose(time_s - time_s[0], TIME_S - TIME_S[0], atol=1e-7)
    np.testing.assert_allclose(record.channels[0].values, PULSE_G, atol=1e-4)


def test_a_simulation_beside_a_test_is_not_averaged_with_it(tmp_path: Path) -> None:
    path = table(tmp_path, "t [ms];Versuch7 [g];CAE7 [g]", TIME_S / MS, PULSE_G, 0.9 * PULSE_G)
    assert "found what looks like CAE runs (CAE7) beside Versuch7; name those that are" in refusal(path)
    with pytest.raises(DataError, match=r"by its own account CAE7 \[g\]"):
        import_source(path, tmp_path / "out", GIVEN, role="tests")
    both = import_source(path, tmp_path / "both", GIVEN, cae=["CAE7"])
    assert [(one.id, one.role) for one in both] == [("Versuch7", "tests"), ("CAE7", "cae")]
    columns = (TIME_S / MS, PULSE_G, PULSE_G, 0.5 * PULSE_G)
    sensors = table(tmp_path, "t [ms];left [g];right [g];CAE [g]", *columns, name="y.csv")
    (one,) = import_source(sensors, tmp_path / "one", GIVEN, record_id="T1")
    assert one.channels == ("left [g]", "right [g]")
    assert "Left out by the file's own account: CAE [g] (CAE)." in one.steps


@pytest.mark.parametrize(
    "header",
    [
        "held_out;approach;time_ms;acceleration_g",
        "time_ms;acceleration_g;lower_g;upper_g",
        "# Predicted by crashfuse 0.1.0, not measured: CAE.\ntime_ms;acceleration_g",
    ],
)
def test_a_prediction_of_ours_is_no_test(tmp_path: Path, header: str) -> None:
    columns = {"time_ms": TIME_S / MS, "acceleration_g": PULSE_G, "lower_g": PULSE_G - 1, "upper_g": PULSE_G + 1}
    given = [columns.get(name, np.full(TIME_S.size, np.nan)) for name in header.split("\n")[-1].split(";")]
    path = table(tmp_path, header, *given)
    roles: tuple[Role | None, ...] = (None, "tests")
    for role in roles:
        with pytest.raises(DataError, match=r"by its own account acceleration_g \((# P|p)redict"):
            import_source(path, tmp_path / "out", GIVEN, role=role)


def test_sheets_of_dummies_and_other_directions_are_left_out_and_told(tmp_path: Path) -> None:
    scales = {"X": 1.0, "Y": 0.2, "Kopf": 1.3}
    rows = {title: np.column_stack([TIME_S / MS, by * PULSE_G]).tolist() for title, by in scales.items()}
    book = workbook({title: [["t [ms]", "Acc [g]"], *of] for title, of in rows.items()})
    (one,) = import_source(written(tmp_path, {"V7.xlsx": book}) / "V7.xlsx", tmp_path / "out", GIVEN)
    assert one.id == "X"
    left = next(step for step in one.steps if step.startswith("Left out"))
    assert "another direction than X: Y" in left
    assert "a dummy's: Kopf" in left


def test_a_table_of_far_too_many_conditions_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No library has so many: half a million took 0.7 GB."""
    monkeypatch.setattr("crashfuse.readers.table_mapping.MOST_ROWS", 3)
    (sheet,) = read_sheets(written(tmp_path, {"c.csv": b"id,speed_kph\nA,50\nB,50\nC,50\nD,50\n"}) / "c.csv")
    said = sentence(lambda: apply_conditions(sheet, propose(sheet)))
    assert "expected conditions in at most 3 rows, found more" in said


def test_tables_are_sorted_by_their_headers(tmp_path: Path) -> None:
    written(library(tmp_path), {"a.csv": b"ID;v [km/h]\n1;2\n", "b.csv": b"ID;v [km/h]\n2;3\n3;4\n", "c.csv": b"\x00"})
    forms = {form.names: form for form in table_forms(tables_of(tmp_path))}
    assert set(forms) == {("a.csv", "b.csv"), ("conditions.csv",), ("runs.csv",)}
    assert forms["a.csv", "b.csv"].columns == ("ID", "v [km/h]")
    assert forms["runs.csv",].proposed.kind == "pulses"
    assert forms["runs.csv",].unit_of(["Run 0 [m/s^2]", "Run 1 [m/s^2]"]) == "m/s²"
    assert forms["runs.csv",].unit_of(["Time [s]", "Run 1 [m/s^2]"]) is None
    table = german(clock(), half_sine_g(clock()), 0 * clock(), header="Zeit [ms];a [g];b [g]")
    (form,) = table_forms([written(tmp_path, {"x.csv": table}) / "x.csv"])
    same = {"time": ["Zeit [ms]"], "acceleration": ["a [g]", "b [g]"], "id": ()}
    assert form.choices(same, {"time": None}) == ()  # type: ignore[arg-type]
    picked = {**same, "acceleration": ["a [g]"]}
    assert form.choices(picked, {"time": "s", "acceleration": "m/s²"}) == (  # type: ignore[arg-type]
        ColumnChoice("Zeit [ms]", "time", "s"),
        ColumnChoice("a [g]", "acceleration", "m/s²"),
        ColumnChoice("b [g]", "ignored"),
    )
    assert {choice.role for choice in form.nothing()} == {"ignored"}
