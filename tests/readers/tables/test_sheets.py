"""Layouts of tables: row names, empty columns, titles above headers, and commas that mean two things."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from crashfuse.errors import DataError
from crashfuse.readers.tables.mapping import propose
from crashfuse.readers.tables.sheets import read_sheets
from crashfuse.readers.tables.table_reader import apply_mapping

N = 80
TIME_MS = np.arange(N) - 5.0
ACCEL = np.round(-30 * np.sin(np.arange(N) / 25) + 0.0005, 3)


def text(header: str, *columns: Iterable[object], delimiter: str = ",", decimal: str = ".", end: str = "") -> str:
    """A table of columns of numbers or texts; row ``i`` of a column is ``column[i]``."""
    rows = zip(*columns, strict=True)
    lines = [delimiter.join(str(cell).replace(".", decimal) for cell in row) + end for row in rows]
    return "\n".join([header, *lines]) + "\n"


def pulse(folder: Path, content: str, name: str = "T1.csv") -> tuple[list[float], list[float]]:
    """Times in ms and values of the only acceleration in a table."""
    (folder / name).write_text(content, encoding="utf-8")
    (sheet,) = read_sheets(folder / name)
    (record,) = apply_mapping(sheet, propose(sheet), record_id="T1")
    (channel,) = record.channels
    return np.round(channel.time_s * 1e3, 9).tolist(), channel.values.tolist()


NUMBERS = [str(number) for number in range(1, N + 1)]
QUOTED = [f'"{number}"' for number in NUMBERS]


@pytest.mark.parametrize(
    "content",
    [
        text('"time"\t"acc"', QUOTED, TIME_MS, ACCEL, delimiter="\t"),
        text('"time" "acc"', QUOTED, TIME_MS, ACCEL, delimiter=" "),
        text("time acc", NUMBERS, TIME_MS, ACCEL, delimiter=" "),
        text('"time";"acc"', QUOTED, TIME_MS, ACCEL, delimiter=";", decimal=","),
        text('"time","acc"', [f'"{2 * i + 7}"' for i in range(N)], TIME_MS, ACCEL),
        text('"time","acc"', [f'"row {i}"' for i in range(N)], TIME_MS, ACCEL),
        text('"","time","acc"', QUOTED, TIME_MS, ACCEL),
        text(",time,A8874", range(N), TIME_MS, ACCEL),
        text("Sample;time;a_x", range(N), TIME_MS, ACCEL, delimiter=";"),
        text("Nr,time,a_x", NUMBERS, TIME_MS, ACCEL),
        text("time,", TIME_MS, ACCEL),
        "Versuch 7\n" + text("time,A8874", TIME_MS, ACCEL),
        text("time,8874", TIME_MS, ACCEL),
        text("time,A8874,", TIME_MS, ACCEL, end=","),
        text("time,A8874", TIME_MS, ACCEL, end=","),
        text("time,a_x,,,", TIME_MS, ACCEL, end=",,,"),
        text("time,Kanal 1,Bemerkung", TIME_MS, ACCEL, ["Kontakt" if i == 5 else "" for i in range(N)]),
        text("time,ax left,ax right", TIME_MS, ACCEL, [""] * N),
        text("time,ax,Grenzwert [g],upper [g]", TIME_MS, ACCEL, [-60] * N, [-50] * N),
        "Nodal History,X-acceleration\n" + text("time,A8874,", TIME_MS, ACCEL, end=","),
        "Kanäle,,,\n,Kopf,Schwerpunkt,Z\n" + text("time,Kanal 1,Kanal 2,Kanal 3", TIME_MS, ACCEL * 2, ACCEL, ACCEL / 4),
        text("time,HeadAccX,PelvisAcc_X,ax,Lendenwirbel x [g]", TIME_MS, *[ACCEL * 2] * 2, ACCEL, ACCEL * 3),
    ],
)
def test_one_pulse_comes_out_of_the_right_columns(tmp_path: Path, content: str) -> None:
    """Row names of R, an index of pandas, sample numbers, empty columns, limits, titles, parts of dummies."""
    name = "T1.txt" if content.split("\n")[1].count(" ") == 2 else "T1.csv"
    assert pulse(tmp_path, content, name) == (TIME_MS.tolist(), ACCEL.tolist())


LARGE = [f"{value:,.1f}" for value in ACCEL * 9806.65]
WHOLE = [f"{value:,.0f}" for value in [*ACCEL[:20], *ACCEL[20:] * 9806.65]]


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (text("Zeit [ms],a_x [g]", range(N), ACCEL, decimal=","), "decimal commas, as in"),
        (text("Zeit [ms],a_x [g]", TIME_MS, ACCEL, decimal=","), "decimal commas, as in"),
        (text("Zeit [ms],a_x [g]", range(600), [0] * 520 + ACCEL.tolist(), decimal=","), "decimal commas, as in"),
        (text("0,0", range(N), ACCEL, decimal=","), "decimal commas, as in"),
        (text("t [ms],a [mm/s2]", TIME_MS, LARGE), "thousands separators, as in"),
        (text("t [ms],a [mm/s2]", range(580), [*[0.1] * 500, *LARGE]), "thousands separators, as in"),
        (text("t [ms],a [mm/s2]", TIME_MS, [f'"{cell}"' for cell in LARGE]), "with thousands separators"),
        (
            text("t [ms];a [mm/s2]", TIME_MS, [cell.replace(",", "'") for cell in LARGE], delimiter=";"),
            "with thousands",
        ),
        (text("t [ms],a [mm/s2]", range(N), WHOLE), "thousands separators, as in"),
        (
            text("t [ms],a [mm/s2]", range(N), [f'"{v:,.0f}"' for v in [*ACCEL[:20], *ACCEL[20:] * 9806.65]]),
            "are thousands separators",
        ),
        (text("t [ms],a [g]", range(N), [f"{v:.3e}" for v in ACCEL], decimal=","), "decimal commas, as in"),
        ("Curveplot\n" + text("Z-acceleration", TIME_MS, ACCEL, delimiter=" "), "a curve file of LS-PrePost"),
        (text("t [ms],a [g]", TIME_MS, ACCEL, ACCEL), "2 names above 3 columns of numbers"),
    ],
)
def test_what_could_be_read_in_two_ways_is_refused_by_its_cause(tmp_path: Path, content: str, cause: str) -> None:
    """Never half of a number, nor a column below the name of another."""
    with pytest.raises(DataError, match=cause) as caught:
        pulse(tmp_path, content)
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (
            "Nodal History,Resultant Acceleration\n" + text("Time,A8874", TIME_MS, ACCEL),
            "another direction than X: Resul",
        ),
        ("Nodal History,X-velocity\n" + text("Time,A8874", TIME_MS, ACCEL), "no acceleration: X-velocity"),
        (
            "Nodal History,X-displacement\n" + text("Time,A8874", TIME_MS, ACCEL),
            "not an acceleration's: X-displacement",
        ),
        ("Resultant acceleration\n" + text("Time,Value", TIME_MS, ACCEL), "another direction than X: Resultant"),
        (text("Sample,a_x [g]", range(N), ACCEL), "it numbers the rows"),
        (text("0,0", range(1, N), ACCEL[1:]), "it numbers the rows"),
        (text("time,Kopfbeschleunigung x [g]", TIME_MS, ACCEL), "a dummy's, not the vehicle's"),
        (text("time,ChestAccX [g]", TIME_MS, ACCEL), "a dummy's, not the vehicle's"),
    ],
)
def test_a_column_that_is_no_pulse_says_why(tmp_path: Path, content: str, reason: str) -> None:
    """A title speaks for a name that says nothing; row numbers are no time."""
    (tmp_path / "T1.csv").write_text(content, encoding="utf-8")
    (sheet,) = read_sheets(tmp_path / "T1.csv")
    mapping = propose(sheet)
    assert mapping.kind == "neither"
    assert any(reason in use.why for use in mapping.uses if use.role == "ignored")
