"""Foreign tables: their form is found, their columns are proposed, the user has the last word."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from crashfuse.errors import DataError, UsageError
from crashfuse.files.archive import Limits
from crashfuse.readers.record import Record
from crashfuse.readers.table_mapping import apply_conditions, apply_mapping, propose
from crashfuse.readers.table_sheet import Sheet
from crashfuse.readers.tables import read_sheets
from crashfuse.readers.vocabulary import number_and_unit, unit_named
from crashfuse.testing.readers import written
from crashfuse.units import KPH, LB, MPH, MS
from tests.importing.crash_files import sentence, workbook

TIMES_MS = [0.0, 0.1, 0.2, 0.3]
VALUES = [0.0, -1.25, -2.5, -1e-3]


def one_sheet(path: Path, content: str | bytes, encoding: str = "utf-8") -> Sheet:
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    (sheet,) = read_sheets(path)
    return sheet


def one_record(sheet: Sheet) -> Record:
    (record,) = apply_mapping(sheet, propose(sheet), record_id="T1")
    return record


def table(header: str, delimiter: str, decimal: str = ".", scale: float = 1.0) -> str:
    rows = [f"{t * scale:g}{delimiter}{a!r}".replace(".", decimal) for t, a in zip(TIMES_MS, VALUES, strict=True)]
    return "\n".join([header, *rows]) + "\n"


@pytest.mark.parametrize(
    ("content", "encoding"),
    [
        (table("Zeit [ms];a_x [g]", ";", ","), "cp1252"),
        (table("Zeit [ms];Beschleunigung Längsträger (g)", ";", ","), "cp1252"),
        (table("t/ms\tAX_g", "\t", ","), "utf-8"),
        (table("time_ms,acceleration_g", ","), "utf-8-sig"),
        (table("Time (s), Accel X [G's]", ",", scale=1e-3), "utf-8"),
        (table("Test report of a car\nSampling rate;10000\n\nTime;Acc X\n[ms];[g]", ";"), "utf-8"),
        (table('"Zeit in ms"|"ax in g"', "|"), "utf-16"),
        (table("time_ms   a_g", "   "), "utf-8"),
        (table("Zeit [ms]  a_x [g]", " ", ","), "utf-8"),
        (table("Zeit [ms];a_x [g]", ";", ",").replace("\n", "\r\n"), "utf-8"),
        (table("Zeit [ms];a_x [g];a_y [g]", ";", ",").replace("\n", ";9\n").replace("[g];9", "[g]"), "utf-8"),
    ],
)
def test_whatever_the_form_the_pulse_is_the_same(tmp_path: Path, content: str, encoding: str) -> None:
    record = one_record(one_sheet(tmp_path / "T1.csv", content, encoding))
    (channel,) = record.channels
    np.testing.assert_allclose(channel.time_s, np.array(TIMES_MS) * MS, atol=1e-12)
    np.testing.assert_array_equal(channel.values, VALUES)
    assert channel.unit == "g"
    assert record.id == "T1"


def test_without_headers_the_clock_is_found(tmp_path: Path) -> None:
    """Two bare columns: the one that increases evenly is time, in the unit in which length and rate are a crash's."""
    for step, factor, n in ((0.1, MS, 1000), (1e-4, 1.0, 1000), (5e-4, 1.0, 11_000), (100.0, 1e-6, 1800)):
        lines = [f"{-0.5 * i % 7} {i * step:.6f}" for i in range(n)]
        record = one_record(one_sheet(tmp_path / "T1.txt", "\n".join(lines)))
        (channel,) = record.channels
        assert channel.time_s[-1] == pytest.approx((n - 1) * step * factor)
        assert (channel.values[1], channel.unit) == (6.5, None)


@pytest.mark.parametrize("missing", [{0}, {0, 1, 2}, {2}, {1, 7, 50}])
def test_a_missing_cell_among_the_first_rows_loses_no_header(tmp_path: Path, missing: set[int]) -> None:
    rows = [f"{0.1 * i:g},{'' if i in missing else -i}" for i in range(100)]
    sheet = one_sheet(tmp_path / "T1.csv", "\n".join(["time (ms),accel x (g)", *rows]))
    assert (sheet.columns, sheet.first_row) == (("time (ms)", "accel x (g)"), 2)
    (channel,) = one_record(sheet).channels
    assert channel.unit == "g"
    np.testing.assert_array_equal(channel.values, [-i for i in range(100) if i not in missing])


def test_columns_are_records_or_channels_of_one(tmp_path: Path) -> None:
    text = "t [ms],T1 [g],T2 [g]\n0,0,0\n1,-1,-2\n2,-2,-4\n3,-1,\n"
    sheet = one_sheet(tmp_path / "all.csv", text)
    records = apply_mapping(sheet, propose(sheet), record_id="all")
    assert [record.id for record in records] == ["T1", "T2"]
    assert [record.channels[0].values.size for record in records] == [4, 3]  # a shorter one ends in empty cells
    (together,) = apply_mapping(sheet, propose(sheet), record_id="all", together=True)
    assert (together.id, [channel.name for channel in together.channels]) == ("all", ["T1 [g]", "T2 [g]"])
    assert "Read as acceleration in g: T1 [g] and T2 [g] (its unit is g)." in together.steps


def test_a_column_of_ids_parts_a_tidy_table(tmp_path: Path) -> None:
    text = "Versuch;Zeit [ms];a [m/s²]\nB;0;1,5\nB;1;2,5\nA;0;3,5\nA;1;4,5\n"
    sheet = one_sheet(tmp_path / "long.csv", text)
    records = apply_mapping(sheet, propose(sheet), record_id="x")
    assert {record.id: record.channels[0].values.tolist() for record in records} == {"B": [1.5, 2.5], "A": [3.5, 4.5]}


def test_the_least_filtered_of_one_signal_is_taken(tmp_path: Path) -> None:
    sheet = one_sheet(tmp_path / "x.csv", "t_s,left_raw_g,left_cfc60_g,right_CFC180_g\n0,1,2,3\n1,1,2,3\n")
    assert [use.role for use in propose(sheet).uses] == ["time", "acceleration", "ignored", "acceleration"]
    records = apply_mapping(sheet, propose(sheet), record_id="x")
    assert [record.channels[0].cutoff_hz for record in records] == [None, 300.0]


def test_the_user_overrules_the_proposal(tmp_path: Path) -> None:
    sheet = one_sheet(tmp_path / "x.csv", "Kanal 1,Kanal 2,bemerkung\n0,1,2\n5,1,2\n")
    mapping = propose(sheet).overruled("Kanal 1", "time", "ms").overruled("Kanal 2", "acceleration", "m/s^2")
    (record,) = apply_mapping(sheet, mapping.overruled("bemerkung", "ignored"), record_id="x")
    assert (record.channels[0].time_s[-1], record.channels[0].unit) == (5 * MS, "m/s²")
    with pytest.raises(UsageError, match="that is time has s, ms, µs, not 'g'"):
        mapping.overruled("Kanal 1", "time", "g")


@pytest.mark.parametrize(
    "text",
    [
        "Versuch;v0 [km/h];Gewicht vorne [kg];Gewicht hinten [kg];Antrieb\nT1;56,3;950,5;750;FWD\nT2;40;900;700;AWD\n",
        "test id\timpact speed (mph)\tfront axle load (lb)\trear axle load (lb)\tAntrieb\n"
        f"T1\t{56.3 * KPH / MPH!r}\t{950.5 / LB!r}\t{750 / LB!r}\tFWD\nT2\t24.85\t1984\t1543\tAWD\n",
        "name,Geschwindigkeit_kmh,Masse VA (t),Masse HA (t),Antrieb\nT1,56.3,0.9505,0.75,FWD\nT2,40,.9,.7,AWD\n",
        "ID;Speed;Total mass;Front share;Antrieb\n;km/h;kg;%;\nT1;56,3;1700,5;55,89532490443987;FWD\n"
        "T2;40;1600;56;AWD\n",
    ],
)
def test_conditions_with_foreign_names(tmp_path: Path, text: str) -> None:
    sheet = one_sheet(tmp_path / "conditions.csv", text)
    mapping = propose(sheet)
    assert mapping.kind == "conditions"
    conditions = apply_conditions(sheet, mapping)
    assert list(conditions) == ["T1", "T2"]
    first = conditions["T1"]
    assert first.speed_mps == pytest.approx(56.3 * KPH)
    assert first.front_weight_kg == pytest.approx(950.5)
    assert first.rear_weight_kg == pytest.approx(750)
    assert first.factors == (("Antrieb", "FWD"),)


def test_conditions_that_cannot_be_understood_are_refused(tmp_path: Path) -> None:
    for text, told in (
        ("id,speed,mass_kg\nT1,50,1700\n", "column speed: expected a unit in the header (km/h, mph, m/s)"),
        ("id,speed_kph,mass_kg\nT1,fast,1700\n", "column speed_kph, row 2: expected a number, found 'fast'"),
        ("id,speed_kph,mass_kg\nT1,50,1700\nT1,50,1700\n", "each id once, found 'T1' 2 times"),
    ):
        sheet = one_sheet(tmp_path / "c.csv", text)
        assert told in sentence(partial(apply_conditions, sheet, propose(sheet)))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("x.csv", b"", "two columns of numbers"),
        ("x.csv", b"a,b\nc,d\n", "two columns of numbers"),
        ("x.csv", b"\x00\x01\x02,\x00", "bytes that are no text"),
        ("x.csv", b"t_s,a_g\n" + b"0,1\n" * 500 + b"0,1,2,3\n", "2 cells in each row"),
        ("x.xls", b"\xd0\xcf\x11\xe0", "save it as .xlsx"),
        ("x.xlsx", b"PK\x03\x04", "a sound workbook"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    assert message in sentence(lambda: one_sheet(tmp_path / name, content))


def test_a_cell_that_is_no_number_is_named(tmp_path: Path) -> None:
    sheet = one_sheet(tmp_path / "x.csv", "note\nt_ms,a_g\n0,1\n1,2\n2,oops\n3,4\n4,5\n5,6\n6,1\n")
    with pytest.raises(DataError, match="column a_g, row 5: expected a number, found 'oops'"):
        one_record(sheet)


def test_a_workbook_gives_a_sheet_a_table(tmp_path: Path) -> None:
    conditions: list[list[object]] = [["Test", "v [km/h]", "front [kg]", "rear [kg]"], ["T1", 50, 900, 700]]
    pulses: list[tuple[object, ...]] = [("Zeit", "a"), ("ms", "g"), *((0.1 * i, -0.5 * i) for i in range(10))]
    book = workbook({"Notes": [["nothing here"]], "Conditions": conditions, "T1": pulses})
    first, second = read_sheets(written(tmp_path, {"book.xlsx": book}) / "book.xlsx")
    assert apply_conditions(first, propose(first))["T1"].speed_mps == pytest.approx(50 * KPH)
    (channel,) = one_record(second).channels
    assert channel.time_s.tolist() == pytest.approx([1e-4 * i for i in range(10)])
    assert (channel.values[-1], channel.unit) == (-4.5, "g")


def test_sizes_are_bounded(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("t_s,a_g\n" + "0,1\n" * 1000)
    with pytest.raises(DataError, match="at most 10 rows"):
        read_sheets(tmp_path / "x.csv", Limits(rows=10))
    with pytest.raises(DataError, match="at most 0 MiB a table"):
        read_sheets(tmp_path / "x.csv", Limits(member_bytes=100))


def test_units_are_known_by_their_spellings() -> None:
    spelt: dict[str | None, tuple[str, ...]] = {
        **{"m/s²": ("m/(s*s)", "m/s**2", "M/S^2"), "mm/ms²": ("mm/ms^2",), "g": ("G'S",), "ms": ("[ms]", "msec")},
        **{"km/h": ("km/h",), "lb": ("lbs",), None: ("furlong", "")},
    }
    assert all(unit_named(text) == name for name, texts in spelt.items() for text in texts)
    assert unit_named("s", "speed") is None
    assert number_and_unit("56,3 km/h") == (56.3, "km/h")
    assert number_and_unit("fast") is None
