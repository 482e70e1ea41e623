"""Layouts of tables: row names, empty columns, titles above headers, and commas that mean two things."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from crashfuse.readers.table_mapping import apply_mapping, propose
from crashfuse.readers.table_sheet import Sheet
from crashfuse.readers.tables import read_sheets
from crashfuse.signals.pulse import FloatArray
from tests.importing.crash_files import sentence

N = 80
TIME_MS = np.arange(N) - 5.0
ACCEL = np.round(-30 * np.sin(np.arange(N) / 25) + 0.0005, 3)


def text(header: str, *columns: Iterable[object], delimiter: str = ",", decimal: str = ".", end: str = "") -> str:
    """A table of columns of numbers or texts; row ``i`` of a column is ``column[i]``."""
    rows = zip(*columns, strict=True)
    lines = [delimiter.join(str(cell).replace(".", decimal) for cell in row) + end for row in rows]
    return "\n".join([header, *lines]) + "\n"


def sheets(folder: Path, content: str, name: str = "V7.lvm") -> tuple[Sheet, ...]:
    (folder / name).write_bytes(content.encode())
    return read_sheets(folder / name)


def pulse(folder: Path, content: str, name: str = "T1.csv") -> tuple[list[float], list[float]]:
    """Times in ms and values of the only acceleration in a table."""
    (sheet,) = sheets(folder, content, name)
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
    name = "T1.txt" if content.split("\n")[1].count(" ") == 2 else "T1.csv"
    assert pulse(tmp_path, content, name) == (TIME_MS.tolist(), ACCEL.tolist())


LARGE = [f"{value:,.1f}" for value in ACCEL * 9806.65]
WHOLE = [f"{value:,.0f}" for value in [*ACCEL[:20], *ACCEL[20:] * 9806.65]]
BOTH, WITHOUT = "commas between columns or in numbers", "without thousands separators"


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (text("Zeit [ms],a_x [g]", range(N), ACCEL, decimal=","), BOTH),
        (text("Zeit [ms],a_x [g]", TIME_MS, ACCEL, decimal=","), BOTH),
        (text("Zeit [ms],a_x [g]", range(600), [0] * 520 + ACCEL.tolist(), decimal=","), BOTH),
        (text("0,0", range(N), ACCEL, decimal=","), BOTH),
        (text("t [ms],a [mm/s2]", TIME_MS, LARGE), BOTH),
        (text("t [ms],a [mm/s2]", range(580), [*[0.1] * 500, *LARGE]), BOTH),
        (text("t [ms],a [mm/s2]", TIME_MS, [f'"{cell}"' for cell in LARGE]), WITHOUT),
        (text("t [ms];a [mm/s2]", TIME_MS, [cell.replace(",", "'") for cell in LARGE], delimiter=";"), WITHOUT),
        (text("t [ms],a [mm/s2]", range(N), WHOLE), BOTH),
        (text("t [ms],a [mm/s2]", range(N), [f'"{cell}"' for cell in WHOLE]), "found thousands separators, as in"),
        (text("t [ms],a [g]", range(N), [f"{v:.3e}" for v in ACCEL], decimal=","), BOTH),
        ("Curveplot\n" + text("Z-acceleration", TIME_MS, ACCEL, delimiter=" "), "a curve file of LS-PrePost"),
        (text("t [ms],a [g]", TIME_MS, ACCEL, ACCEL), "2 names above 3 columns of numbers"),
    ],
)
def test_what_could_be_read_in_two_ways_is_refused_by_its_cause(tmp_path: Path, content: str, cause: str) -> None:
    assert cause in sentence(lambda: pulse(tmp_path, content))


HISTORY = "Nodal History,{}\n" + text("Time,A8874", TIME_MS, ACCEL)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (HISTORY.format("Resultant Acceleration"), "another direction than X: Resul"),
        (HISTORY.format("X-velocity"), "no acceleration: X-velocity"),
        (HISTORY.format("X-displacement"), "not an acceleration's: X-displacement"),
        ("Resultant acceleration\n" + text("Time,Value", TIME_MS, ACCEL), "another direction than X: Resultant"),
        (text("Sample,a_x [g]", range(N), ACCEL), "it numbers the rows"),
        (text("0,0", range(1, N), ACCEL[1:]), "it numbers the rows"),
        (text("time,Kopfbeschleunigung x [g]", TIME_MS, ACCEL), "a dummy's"),
        (text("time,ChestAccX [g]", TIME_MS, ACCEL), "a dummy's"),
    ],
)
def test_a_column_that_is_no_pulse_says_why(tmp_path: Path, content: str, reason: str) -> None:
    (sheet,) = sheets(tmp_path, content, "T1.csv")
    mapping = propose(sheet)
    assert mapping.kind == "neither"
    assert any(reason in use.why for use in mapping.uses if use.role == "ignored")


N_SAMPLES, STEP_S = 60, 2e-4
X = np.round(-np.arange(N_SAMPLES) / 7, 6)
Y = np.round(np.arange(N_SAMPLES) / 11, 6)
CHANNELS = {"Acc X": X, "Acc Y": Y}


def measurement(
    channels: Mapping[str, FloatArray] = CHANNELS,
    *,
    x_columns: str = "One",
    delimiter: str = "\t",
    decimal: str = ".",
    starts: Sequence[str] = ("09:15:00.1234567890", "09:15:00.1234567890"),
    segments: Sequence[tuple[slice, float]] = ((slice(None), 0.0),),
    unit: str = "g",
) -> str:
    """A file of these channels; ``segments`` are samples, and the time at which they begin."""

    def cell(value: float) -> str:
        return f"{value:.6f}".replace(".", decimal)

    between = 2 * delimiter if x_columns == "Multi" else delimiter
    pairs = {"Writer_Version": "2", "Separator": {"\t": "Tab", ",": "Comma"}[delimiter], "Decimal_Separator": decimal}
    pairs |= {"Multi_Headings": "Yes", "X_Columns": x_columns, "Date": "2026/03/02", "Time": "09:15:00"}
    lines = ["LabVIEW Measurement", *(f"{tag}{delimiter}{text}" for tag, text in pairs.items())]
    lines += ["***Start_Special***", "X_Value\tno channel", "***End_Special***", "***End_of_Header***", delimiter]
    for rows, begin_s in segments:
        tags = {"Channels": [f"{len(channels)}"], "Date": ["2026/03/02"] * len(channels), "Time": list(starts)}
        tags |= {"Y_Unit_Label": [unit] * len(channels), "X_Dimension": ["Time"] * len(channels)}
        tags |= {"X0": [cell(begin_s)] * len(channels), "Delta_X": [cell(STEP_S)] * len(channels)}
        lines += [f"{tag}{delimiter}{between.join(cells)}{delimiter}" for tag, cells in tags.items()]
        names = delimiter.join(("X_Value" + delimiter if x_columns == "Multi" else "") + name for name in channels)
        first = "" if x_columns == "Multi" else f"X_Value{delimiter}"
        lines += ["***End_of_Header***", f"{first}{names}{delimiter}Comment"]
        for number, values in enumerate(np.column_stack([values[rows] for values in channels.values()]).tolist()):
            time = cell(begin_s + number * STEP_S)
            before = {"One": time + delimiter, "No": delimiter, "Multi": ""}[x_columns]
            each = time + delimiter if x_columns == "Multi" else ""
            comment = f"{delimiter}contact" if number == 3 else ""
            lines.append(before + delimiter.join(each + cell(value) for value in values) + comment)
        lines.append("")
    return "\r\n".join(lines)


@pytest.mark.parametrize("x_columns", ["One", "Multi", "No"])
@pytest.mark.parametrize(("delimiter", "decimal"), [("\t", "."), ("\t", ","), (",", ".")])
def test_the_header_has_names_units_and_times(tmp_path: Path, x_columns: str, delimiter: str, decimal: str) -> None:
    content = measurement(x_columns=x_columns, delimiter=delimiter, decimal=decimal)
    for name in ("V7.lvm", "V7.txt"):
        (sheet,) = sheets(tmp_path, content, name)
        assert (sheet.columns, sheet.units) == (("X_Value", "Acc X", "Acc Y"), ("s", "g", "g"))
        np.testing.assert_allclose(sheet.numbers("X_Value"), np.arange(N_SAMPLES) * STEP_S, atol=1e-12)
        np.testing.assert_array_equal(sheet.numbers("Acc X"), X)
        assert {use.column: use.role for use in propose(sheet).uses}["Acc Y"] == "ignored"


@pytest.mark.parametrize("x_columns", ["One", "Multi", "No"])
def test_a_channel_that_begins_later_has_its_own_times(tmp_path: Path, x_columns: str) -> None:
    """Its logger was triggered 12 ms after the other's, as the times of day say: they are never on one clock."""
    channels = {"left X": X, "right X": X}
    left, right = sheets(tmp_path, measurement(channels, x_columns=x_columns, starts=("09:15:59.995", "09:16:00.007")))
    for sheet, begin_s in ((left, 0.0), (right, 0.012)):
        np.testing.assert_allclose(sheet.parsed(sheet.columns[0]), begin_s + np.arange(N_SAMPLES) * STEP_S, atol=1e-9)


def test_segments_that_continue_are_one_record_and_others_are_refused(tmp_path: Path) -> None:
    parts = [(slice(0, 20), 0.0), (slice(20, 45), 20 * STEP_S), (slice(45, N_SAMPLES), 45 * STEP_S)]
    (sheet,) = sheets(tmp_path, measurement(segments=parts))
    np.testing.assert_allclose(sheet.numbers("X_Value"), np.arange(N_SAMPLES) * STEP_S, atol=1e-12)
    np.testing.assert_array_equal(sheet.numbers("Acc X"), X)
    for begin_s in (0.0, 1.0):
        apart = partial(sheets, tmp_path, measurement(segments=[parts[0], (slice(20, N_SAMPLES), begin_s)]))
        assert "segments that continue each other" in sentence(apart)


def test_volts_are_no_acceleration(tmp_path: Path) -> None:
    (sheet,) = sheets(tmp_path, measurement(unit="Volts"))
    assert propose(sheet).kind == "neither"


def test_what_cannot_be_read_is_refused(tmp_path: Path) -> None:
    for content, told in (
        ("LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\n", "samples below names that begin with X_Value"),
        (measurement(x_columns="No").replace("Delta_X", "Delta"), "times, or X0 and Delta_X, of Acc X"),
        (measurement({f"c{number}": X for number in range(2100)}, starts=[""] * 2100), "at most 2000 columns"),
    ):
        assert told in sentence(partial(sheets, tmp_path, content))
