"""Tables of strangers are bounded before they are held; ours hold no formula, and read back to what went in."""

import io
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import openpyxl
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.errors import DataError
from crashfuse.files import csv_text


@contextmanager
def little_memory(most_mb: float) -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most_mb * 1e6
    finally:
        tracemalloc.stop()


WIDE = ",".join(f"c{n}" for n in range(490))


@pytest.mark.parametrize(
    "text",
    [
        "id,speed_mph\n" + "T1,35\n" * 400_000,
        f"{WIDE}\n" + "T1,35\n" * 100_000,
        "id,speed_mph\n" + "\n" * 1_000_000,
        "id,text\n" + f"T1,{'x' * 90_000}\n" * 400,
        "id,text\n" + "x" * 200_000,
    ],
    ids=["rows", "cells", "empty lines", "characters", "no end"],
)
def test_a_table_larger_than_any_campaigns_is_refused_before_it_is_held(text: str, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(text, encoding="utf-8")
    with little_memory(150), pytest.raises(DataError, match=r"table\.csv"):
        csv_text.read_rows(tmp_path / "table.csv", "table.csv")


def test_rows_are_bounded_and_empty_lines_are_none(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("\ufeffid,speed_mph\n" + "T1,35\r\n" * 5 + "\n,\n" * 20, encoding="utf-8")
    names, rows, numbers = csv_text.read_rows(path, "table.csv", most_rows=5)
    assert (names, rows, numbers) == (["id", "speed_mph"], [["T1", "35"]] * 5, [2, 3, 4, 5, 6])
    with pytest.raises(DataError, match="at most 4 rows"):
        csv_text.read_rows(path, "table.csv", most_rows=4)


def test_short_lines_of_a_wide_table_do_not_fill_the_memory(tmp_path: Path) -> None:
    """300 kB of empty lines under 490 columns would be 150 million cells; a few of them are as good as none."""
    path = tmp_path / "pulse.csv"
    path.write_text(f"{WIDE}\n" + "\n" * 300_000, encoding="utf-8")
    with (
        little_memory(50),
        pytest.raises(DataError, match="lines with far fewer"),
        csv_text.CsvTable.opened(path, "p") as table,
    ):
        next(table.blocks(["c0", "c1"]))
    path.write_text(f"{WIDE}\n" + "1,2\n" * 100, encoding="utf-8")
    with csv_text.CsvTable.opened(path, "p") as table:
        ((frame, rows),) = table.blocks(["c0", "c1"])
    assert (frame.to_numpy(dtype=float) == [1, 2]).all()
    assert rows.tolist() == list(range(2, 102))


FORMULAS = (
    *('=HYPERLINK("http://example.org")', "+cmd|' /C calc'!A0", "-1+cmd|' /C calc'!A0", "@SUM(1+1)*cmd|' /C calc'!A0"),
    *("\t=1+1", "\r=1+1", "\n=1+1", "  =1+1", "=1+1"),
)
cells = st.text(alphabet="=+-@\t\r\n;' \"1.e,aé＝", max_size=12)


@pytest.mark.parametrize("text", FORMULAS)
def test_no_formula_begins_a_cell(text: str) -> None:
    assert csv_text.neutral(text).lstrip(" ").startswith("'")
    assert all(not part.lstrip(' "').startswith(("=", "+", "@")) for part in csv_text.neutral(f"a;{text}").split(";"))


@pytest.mark.parametrize(
    "text", ["-1", "-1.5e-3", "+3", "-.5", "-50,0", "-", "plain", "it's", "a-b", "AWD", "a; -5; b", ""]
)
def test_numbers_and_plain_text_stay_as_they_are(text: str) -> None:
    """Negative numbers in a column of text are numbers to whoever opens the table, with decimal commas, too."""
    assert csv_text.neutral(text) == text


@given(text=cells)
def test_every_text_comes_back(text: str) -> None:
    assert csv_text.original(csv_text.neutral(text)) == text


@given(texts=st.lists(st.text("=+-@';a1é", min_size=1), min_size=1))
def test_a_table_that_was_written_is_read_to_the_same_text(
    texts: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("table") / "t.csv"
    header = ["id", "=1+1", "+a;=b"]
    path.write_text(csv_text.csv_text([header, *(["r", text, "n"] for text in texts)]), encoding="utf-8", newline="")
    names, rows, _ = csv_text.read_rows(path, "t.csv")
    assert names == header
    assert [row[1] for row in rows] == texts


odd = st.sampled_from(("", "NA", "nan", "None", "null", "NULL", "n/a", "#N/A", "-", "inf", "1e5", "007", "True", "=1"))


@given(ids=st.lists(odd | st.text("=+-@';a1é ", max_size=6), min_size=1), data=st.data())
def test_a_frame_that_was_written_is_read_to_the_same_frame(
    ids: list[str], data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("table") / "t.csv"
    numbers = st.lists(st.sampled_from([0.25, -3.5, np.nan]), min_size=len(ids), max_size=len(ids))
    frame = pd.DataFrame({"id": ids, "value": np.array(data.draw(numbers)), "seed": np.arange(len(ids)) + 1234567})
    path.write_bytes(csv_text.csv_bytes(frame))
    pd.testing.assert_frame_equal(csv_text.read_csv_table(path, ("value", "seed")), frame)


def test_a_frame_keeps_its_numbers_and_loses_its_formulas() -> None:
    columns = {"=name": ["=1+1", None, "plain"], "value": [-1.5, np.nan, 2.0], "mixed": [-3, "@x", None]}
    frame = pd.DataFrame(columns)
    frame.insert(2, "kind", pd.Categorical(["+cmd", "-1", "+cmd"]))
    before = frame.copy(deep=True)
    read = pd.read_csv(io.BytesIO(csv_text.csv_bytes(frame)), dtype=str, keep_default_na=False)
    assert list(read) == ["'=name", "value", "kind", "mixed"]
    assert read.to_numpy().tolist() == [
        ["'=1+1", "-1.5", "'+cmd", "-3"],
        ["", "", "-1", "'@x"],
        ["plain", "2", "'+cmd", ""],
    ]
    pd.testing.assert_frame_equal(frame, before)
    assert csv_text.without_formulas(frame)["value"].dtype == np.float64


def test_a_spreadsheet_program_sees_text() -> None:
    """What a workbook library would store as a formula is stored as a string once it is neutral."""
    book = openpyxl.Workbook()
    assert book.active is not None
    for row, text in enumerate(FORMULAS[-3:], start=1):
        cell = book.active.cell(row, 1, csv_text.neutral(text).strip())
        assert cell.data_type == "s"


def test_no_number_is_a_negative_zero() -> None:
    """A record that begins with −0.0 is written from 0, in six digits as it was."""
    table = pd.DataFrame({"g": [-0.0, -1e-12, 1 / 3, np.nan]})
    assert csv_text.csv_bytes(table) == b'g\n0\n-1e-12\n0.333333\n""\n'
