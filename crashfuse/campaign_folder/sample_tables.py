"""Tables of samples (time and acceleration), one pulse each or tidy tables of many, read in batches."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from crashfuse.campaign_folder.columns import find_column, listed, not_a_number
from crashfuse.campaign_folder.recorded_pulse import RecordedPulse, joined, time_trouble
from crashfuse.errors import DataError, Problem, collecting, shortened
from crashfuse.files.csv_text import CsvTable
from crashfuse.files.parquet import ParquetTable
from crashfuse.signals.pulse import Pulse
from crashfuse.units import ACCELERATION, TIME

_MOST_SAMPLES = 2_000_000  # a record of 10 s at 200 kHz
_LARGEST_S, _LARGEST_MPS2 = 1e6, 1e6  # 100,000 g: beyond any sensor or vehicle


def sample_batches(
    path: Path, where: str, problems: list[Problem], *, with_id: bool = False
) -> Iterator[tuple[pd.Categorical, RecordedPulse]]:
    """Yield the samples of a CSV or Parquet file in SI units, batch by batch, with the record id of each.

    Cells that are not numbers become problems and NaN. Without an id column, all rows belong to one record. A file that
    cannot be read, lacks a column or an id, or is empty raises a DataError.
    """
    empty = True
    with (ParquetTable if path.suffix == ".parquet" else CsvTable).opened(path, where) as table:
        (time, to_s), (accel, to_mps2) = _columns(table.names, where, with_id=with_id)
        for frame, rows in table.blocks([*(["id"] if with_id else []), time, accel]):
            if any((blank := _blank(frame)).tolist()):
                frame, rows = frame[~blank], rows[~blank]
            if not len(frame):
                continue
            empty = False
            ids = pd.Categorical(frame["id"] if with_id else np.zeros(len(frame), dtype=np.int8))
            nameless = (ids.codes < 0) | np.isin(ids.codes, np.flatnonzero(ids.categories == ""))
            if nameless.any():
                row, advice = int(rows[nameless.argmax()]), "name the run that the row belongs to"
                raise DataError(Problem(where, "an id in each row", "an empty cell", advice, "id", row))
            time_s = to_s * not_a_number(frame[time], time, where, rows, problems, _LARGEST_S / to_s)
            largest = _LARGEST_MPS2 / to_mps2
            accel_mps2 = to_mps2 * not_a_number(frame[accel], accel, where, rows, problems, largest)
            yield ids, RecordedPulse(time_s, accel_mps2, rows, time)
    if empty:
        raise DataError(Problem(where, "a header and rows", "an empty table", "add the samples"))


def whole_record(path: Path, where: str, problems: list[Problem]) -> RecordedPulse:
    """All samples of a file with one pulse; raises as :func:`sample_batches` does."""
    parts: list[RecordedPulse] = []
    for _, part in sample_batches(path, where, problems):
        parts.append(part)
        check_length(parts, where)
    return joined(parts)


def check_length(parts: Sequence[RecordedPulse], where: str) -> None:
    """Raise a DataError if a record has more samples than any real one."""
    if (count := sum(part.rows.size for part in parts)) > _MOST_SAMPLES:
        found, advice = f"{count} at least", "cut the record, or export it at a lower rate"
        row, column = int(parts[0].rows[0]), parts[0].time_column
        raise DataError(Problem(where, f"at most {_MOST_SAMPLES} samples a record", found, advice, column, row))


def read_pulse(path: Path) -> Pulse:
    """Read one pulse from a CSV or Parquet file as sampled; raise a DataError with every problem of the file."""
    if not path.exists():
        raise DataError(Problem(str(path), "a pulse file", "no such file", "check the path"))
    problems: list[Problem] = []
    with collecting(problems):
        record = whole_record(path, str(path), problems)
        if not problems and (trouble := time_trouble(record, str(path))) is not None:
            problems.append(trouble)
    if problems:
        raise DataError(shortened(problems))
    return Pulse(record.time_s, record.accel_mps2)


def _columns(names: Sequence[str], where: str, *, with_id: bool) -> tuple[tuple[str, float], tuple[str, float]]:
    """The time and acceleration columns with their factors to SI."""
    problems: list[Problem] = []
    time = find_column(names, "time", TIME, where, problems)
    accel = find_column(names, "acceleration", ACCELERATION, where, problems)
    if with_id and "id" not in names:
        found = f"the columns {listed(names)}"
        problems.append(Problem(where, "a column id", found, "name the run of each row in it"))
    if problems or time is None or accel is None:
        raise DataError(problems)
    return time, accel


def _blank(frame: pd.DataFrame) -> npt.NDArray[np.bool_]:
    """Mask of the lines that are empty in all columns, such as spreadsheets leave at the end."""
    if not all(isinstance(kind, pd.StringDtype) for kind in frame.dtypes):
        return np.zeros(len(frame), dtype=bool)
    return np.asarray((frame == "").all(axis=1))
