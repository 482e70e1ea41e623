"""LabVIEW measurement files: names, units and times come from their headers."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from crashfuse.errors import DataError
from crashfuse.readers.tables.mapping import propose
from crashfuse.readers.tables.sheet import Sheet
from crashfuse.readers.tables.sheets import read_sheets
from crashfuse.signals.pulse import FloatArray

N, STEP_S = 60, 2e-4
X = np.round(-np.arange(N) / 7, 6)
Y = np.round(np.arange(N) / 11, 6)
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
        lines += [
            "***End_of_Header***",
            ("" if x_columns == "Multi" else "X_Value" + delimiter) + names + delimiter + "Comment",
        ]
        for number, values in enumerate(np.column_stack([values[rows] for values in channels.values()]).tolist()):
            time = cell(begin_s + number * STEP_S)
            before = {"One": time + delimiter, "No": delimiter, "Multi": ""}[x_columns]
            each = time + delimiter if x_columns == "Multi" else ""
            comment = f"{delimiter}contact" if number == 3 else ""
            lines.append(before + delimiter.join(each + cell(value) for value in values) + comment)
        lines.append("")
    return "\r\n".join(lines)


def sheets(folder: Path, content: str, name: str = "V7.lvm") -> tuple[Sheet, ...]:
    """The tables of a file."""
    (folder / name).write_bytes(content.encode())
    return read_sheets(folder / name)


@pytest.mark.parametrize("x_columns", ["One", "Multi", "No"])
@pytest.mark.parametrize(("delimiter", "decimal"), [("\t", "."), ("\t", ","), (",", ".")])
def test_names_units_and_times_are_those_of_the_header(
    tmp_path: Path, x_columns: str, delimiter: str, decimal: str
) -> None:
    """However times are written; comments are no channel, and special blocks no names."""
    content = measurement(x_columns=x_columns, delimiter=delimiter, decimal=decimal)
    for name in ("V7.lvm", "V7.txt"):
        (sheet,) = sheets(tmp_path, content, name)
        assert (sheet.columns, sheet.units) == (("X_Value", "Acc X", "Acc Y"), ("s", "g", "g"))
        np.testing.assert_allclose(sheet.numbers("X_Value"), np.arange(N) * STEP_S, atol=1e-12)
        np.testing.assert_array_equal(sheet.numbers("Acc X"), X)
        assert {use.column: use.role for use in propose(sheet).uses}["Acc Y"] == "ignored"


@pytest.mark.parametrize("x_columns", ["One", "Multi", "No"])
def test_a_channel_that_begins_later_has_its_own_times(tmp_path: Path, x_columns: str) -> None:
    """Its logger was triggered 12 ms after the other's, as the times of day say: they are never on one clock."""
    channels = {"left X": X, "right X": X}
    left, right = sheets(tmp_path, measurement(channels, x_columns=x_columns, starts=("09:15:59.995", "09:16:00.007")))
    for sheet, begin_s in ((left, 0.0), (right, 0.012)):
        np.testing.assert_allclose(sheet.parsed(sheet.columns[0]), begin_s + np.arange(N) * STEP_S, atol=1e-9)


def test_segments_that_continue_are_one_record_and_others_are_refused(tmp_path: Path) -> None:
    """Three calls of a logger; a second trigger is another record."""
    parts = [(slice(0, 20), 0.0), (slice(20, 45), 20 * STEP_S), (slice(45, N), 45 * STEP_S)]
    (sheet,) = sheets(tmp_path, measurement(segments=parts))
    np.testing.assert_allclose(sheet.numbers("X_Value"), np.arange(N) * STEP_S, atol=1e-12)
    np.testing.assert_array_equal(sheet.numbers("Acc X"), X)
    for begin_s in (0.0, 1.0):
        with pytest.raises(DataError, match="segments that continue each other") as caught:
            sheets(tmp_path, measurement(segments=[parts[0], (slice(20, N), begin_s)]))
        assert len(caught.value.problems) == 1


def test_volts_are_no_acceleration(tmp_path: Path) -> None:
    """What was never scaled is refused for its unit, whatever its name."""
    (sheet,) = sheets(tmp_path, measurement(unit="Volts"))
    assert propose(sheet).kind == "neither"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\n", "samples below a row of names"),
        (measurement(x_columns="No").replace("Delta_X", "Delta"), "times, or X0 and Delta_X, of Acc X"),
        (measurement({f"c{number}": X for number in range(2100)}, starts=[""] * 2100), "at most 2000 columns"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path: Path, content: str, message: str) -> None:
    """In one sentence."""
    with pytest.raises(DataError, match=message) as caught:
        sheets(tmp_path, content)
    assert len(caught.value.problems) == 1
