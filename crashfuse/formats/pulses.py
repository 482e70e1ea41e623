"""Pulse files: one a test or run, or all in one tidy table; from any even sampling to the study grid.

Tables are read in batches and their samples go straight into the float32 array of the source, so that a library of
100,000 runs needs little more memory than the array itself.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.errors import DataError, Problem
from crashfuse.filters import cfc_filter
from crashfuse.formats.tables import find_column, not_a_number
from crashfuse.pulse import GRID_S, N_SAMPLES, FloatArray, Pulse
from crashfuse.units import ACCELERATION, MS, TIME

_BATCH_ROWS = 1_000_000
_SLOWEST_S = 1e-3
_SHORTEST_S = 60e-3  # the longest rated window by default
_UNEVEN = 0.02  # of a step: what rounding the times to five digits can do

Signal = tuple[FloatArray, FloatArray, int]
"""Time in s, acceleration in m/s², and the row of the file where they start."""


@dataclass(slots=True)
class PulseSource:
    """All pulses of ``tests`` or ``cae`` of a campaign folder, on their way to the study grid.

    Parameters
    ----------
    folder : Path
    source : {"tests", "cae"}
    channel_filter_class : float or None
        CFC to filter the whole record with, before it is cropped to the grid.
    """

    folder: Path
    source: str
    channel_filter_class: float | None
    problems: list[Problem] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    ends_s: dict[str, float] = field(default_factory=dict)
    """Where the records that are shorter than the study grid end, by id."""
    _unreadable: bool = False

    def read(self, ids: Sequence[str]) -> npt.NDArray[np.float32]:
        """Pulses of these ids on the study grid, shape (n_ids, 1250), m/s²; what is wrong is in ``problems``."""
        accel = np.zeros((len(ids), N_SAMPLES), dtype=np.float32)
        row_of = {run_id: row for row, run_id in enumerate(ids)}
        missing, strangers = set(ids), 0
        for run_id, where, signal in self._signals(ids):
            if run_id not in row_of:
                strangers += 1
            elif run_id in missing:
                missing.remove(run_id)
                if signal is None:
                    continue
                on_grid = self._on_grid(signal, f"{where}, {run_id}" if "_pulses" in where else where)
                if on_grid is not None:
                    accel[row_of[run_id]] = on_grid
                    if _ends_early(signal[0]):
                        self.ends_s[run_id] = float(signal[0][-1])
            else:
                found = f"rows of {run_id} in two places"
                advice = "sort the file by id, then by time"
                self.problems.append(
                    Problem(where, "the rows of one id together", found, advice, "id", signal and signal[2])
                )
        if missing and not self._unreadable:
            self._report_missing([run_id for run_id in ids if run_id in missing])
        if strangers:
            self.warnings.append(
                f"{strangers} pulses of {self.source} have no row in {self.source}.csv and are left out."
            )
        return accel

    def _signals(self, ids: Sequence[str]) -> Iterator[tuple[str, str, Signal | None]]:
        tables = [
            path for ending in ("parquet", "csv") if (path := self.folder / f"{self.source}_pulses.{ending}").is_file()
        ]
        singles = self.folder / self.source
        forms = [path.name for path in tables] + ([f"{singles.name}/"] if singles.is_dir() else [])
        if len(forms) != 1:
            expected = f"the pulses either in {self.source}_pulses.parquet (or .csv) or in {self.source}/<id>.csv"
            found = " and ".join(forms) if forms else "neither"
            self.problems.append(Problem(self.source, expected, found, "keep one form" if forms else "add the pulses"))
            self._unreadable = True
        elif tables:
            yield from self._from_table(tables[0])
        else:
            yield from self._from_files(singles, ids)

    def _from_files(self, folder: Path, ids: Sequence[str]) -> Iterator[tuple[str, str, Signal | None]]:
        for run_id in ids:
            for path in (folder / f"{run_id}.csv", folder / f"{run_id}.parquet"):
                if path.is_file():
                    where = f"{folder.name}/{path.name}"
                    parts = [signal for _, signal in self._batches(path, where, with_id=False)]
                    yield run_id, where, _joined(parts) if parts else None
                    break
        known = set(ids)
        for path in sorted(folder.iterdir()):
            if path.suffix in (".csv", ".parquet") and path.stem not in known:
                yield path.stem, path.name, None

    def _from_table(self, path: Path) -> Iterator[tuple[str, str, Signal | None]]:
        """Yield one signal a run, joining what a batch's end has cut."""
        pending_id: str | None = None
        pending: list[Signal] = []
        for codes, (time, accel, first_row) in self._batches(path, path.name, with_id=True):
            starts = np.flatnonzero(np.r_[True, codes.codes[1:] != codes.codes[:-1]])
            for start, stop in zip(starts, np.r_[starts[1:], len(codes)], strict=True):
                run_id = str(codes.categories[codes.codes[start]]).strip()
                if pending and run_id != pending_id:
                    yield str(pending_id), path.name, _joined(pending)
                    pending = []
                pending_id = run_id
                pending.append((time[start:stop], accel[start:stop], first_row + int(start)))
        if pending:
            yield str(pending_id), path.name, _joined(pending)

    def _batches(self, path: Path, where: str, *, with_id: bool) -> Iterator[tuple[pd.Categorical, Signal]]:
        """Yield batches as ids and SI samples; a file that cannot be read appends problems and yields nothing more."""
        row = 2
        try:
            for frame in _frames(path):
                columns = self._columns(frame, where, with_id=with_id)
                if columns is None:
                    self._unreadable |= with_id
                    return
                time, accel = (
                    factor * not_a_number(frame[column], column, where, row, self.problems)
                    for column, factor in columns
                )
                ids = pd.Categorical(frame["id"] if with_id else np.zeros(len(frame), dtype=np.int8))
                if (ids.codes < 0).any():
                    nameless = row + int(np.argmax(ids.codes < 0))
                    advice = "name the run that the row belongs to"
                    self.problems.append(Problem(where, "an id in each row", "an empty cell", advice, "id", nameless))
                elif len(frame):
                    yield ids, (time, accel, row)
                row += len(frame)
        except (pd.errors.EmptyDataError, pd.errors.ParserError, UnicodeDecodeError, pa.ArrowInvalid, OSError) as error:
            found = " ".join(str(error).split())[:200]
            self.problems.append(Problem(where, "a table with a header", found, "export the file again"))
            self._unreadable |= with_id
            return
        if row == 2:
            self.problems.append(Problem(where, "a header and rows", "an empty table", "add the samples"))
            self._unreadable |= with_id

    def _columns(self, frame: pd.DataFrame, where: str, *, with_id: bool) -> list[tuple[str, float]] | None:
        """Find time and acceleration with their factors to SI; None, and problems, if the table lacks a column."""
        found = [
            find_column(frame.columns, "time", TIME, where, self.problems),
            find_column(frame.columns, "acceleration", ACCELERATION, where, self.problems),
        ]
        if with_id and "id" not in frame.columns:
            shown = f"the columns {', '.join(map(str, frame.columns))}"
            self.problems.append(Problem(where, "a column id", shown, "name the run of each row in it"))
            return None
        columns = [column for column in found if column is not None]
        return columns if len(columns) == 2 else None

    def _on_grid(self, signal: Signal, where: str) -> FloatArray | None:
        """Bring a signal to the study grid, or say why that is impossible."""
        time, accel, first_row = signal
        if not (np.isfinite(time).all() and np.isfinite(accel).all()):
            return None  # reported cell by cell already
        trouble = _time_trouble(time, where, first_row) or _cover_trouble(time, where)
        if trouble is not None:
            self.problems.append(trouble)
            return None
        step = (time[-1] - time[0]) / (time.size - 1)
        if self.channel_filter_class is not None:
            try:
                accel = cfc_filter(accel, cfc=self.channel_filter_class, dt_s=step)
            except DataError as error:
                self.problems.extend(Problem(where, p.expected, p.found, p.advice) for p in error.problems)
                return None
        early = _ends_early(time)
        if early:
            self.warnings.append(
                f"{where}: the record ends at {time[-1] / MS:.4g} ms; it goes on with no acceleration."
            )
        return np.interp(GRID_S, time, accel, right=0.0 if early else None)

    def _report_missing(self, missing: list[str]) -> None:
        for run_id in missing[:20]:
            expected = f"a pulse for {run_id}"
            found = f"none in {self.source}/ or {self.source}_pulses"
            self.problems.append(
                Problem(f"{self.source}.csv", expected, found, "add its pulse or remove its row", "id")
            )
        if len(missing) > 20:
            found = f"{len(missing) - 20} more without one"
            self.problems.append(Problem(f"{self.source}.csv", "a pulse for each row", found, "add them", "id"))


def read_pulse(path: Path) -> Pulse:
    """Read one pulse from a CSV or Parquet file as it is sampled there.

    Raises
    ------
    DataError
        With every problem of the file.
    """
    if not path.is_file():
        raise DataError(Problem(str(path), "a pulse file", "no such file", "check the path"))
    source = PulseSource(path.parent, "", None)
    parts = [signal for _, signal in source._batches(path, str(path), with_id=False)]
    if not source.problems:
        time, accel, first_row = _joined(parts)
        trouble = _time_trouble(time, str(path), first_row)
        if trouble is None:
            return Pulse(time, accel)
        source.problems.append(trouble)
    raise DataError(source.problems)


def _frames(path: Path) -> Iterator[pd.DataFrame]:
    if path.suffix == ".parquet":
        with pq.ParquetFile(path) as file:
            names = [
                name for name in file.schema_arrow.names if name == "id" or name.startswith(("time", "acceleration"))
            ]
            text_id = "id" in names and not pa.types.is_dictionary(file.schema_arrow.field("id").type)
        with pq.ParquetFile(path, read_dictionary=["id"] if text_id else None) as file:
            for batch in file.iter_batches(batch_size=_BATCH_ROWS, columns=names):
                yield batch.to_pandas()
        return
    with pd.read_csv(
        path,
        chunksize=_BATCH_ROWS,
        dtype={"id": str},
        keep_default_na=False,
        encoding="utf-8-sig",
        skipinitialspace=True,
        low_memory=False,
    ) as chunks:
        for frame in chunks:
            frame.columns = frame.columns.str.strip()
            yield frame


def _joined(parts: list[Signal]) -> Signal:
    if len(parts) == 1:
        return parts[0]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts]), parts[0][2]


def _time_trouble(time: FloatArray, where: str, first_row: int) -> Problem | None:
    """Say what makes the time of a record unfit, if anything."""
    if time.size < 2:
        return Problem(where, "at least two samples", f"{time.size}", "export the whole record", "time")
    steps = np.diff(time)
    if steps.min() <= 0:
        row = first_row + int(np.argmax(steps <= 0)) + 1
        found = f"{time[row - first_row] / MS:.6g} ms after {time[row - first_row - 1] / MS:.6g} ms"
        return Problem(where, "time that increases from row to row", found, "sort the rows by time", "time", row)
    step = np.median(steps)
    off = np.abs(steps - step)
    if off.max() > _UNEVEN * step:
        row = first_row + int(off.argmax()) + 1
        found = f"a step of {steps[row - first_row - 1] / MS:.4g} ms among steps of {step / MS:.4g} ms"
        return Problem(where, "evenly sampled time", found, "resample the record", "time", row)
    if step > _SLOWEST_S * (1 + _UNEVEN):
        found = f"{1 / step:.0f} Hz"
        return Problem(where, "at least 1000 samples a second", found, "export at a higher rate", "time")
    return None


def _ends_early(time: FloatArray) -> bool:
    """Tell whether an even record leaves the end of the study grid open."""
    return bool(time[-1] < GRID_S[-1] - (time[-1] - time[0]) / (time.size - 1))


def _cover_trouble(time: FloatArray, where: str) -> Problem | None:
    """Say what part of the study grid a record misses, if too much."""
    step = time[1] - time[0]
    if time[0] <= step and time[-1] >= _SHORTEST_S - step:
        return None
    found = f"{time[0] / MS:.4g} to {time[-1] / MS:.4g} ms"
    advice = "export the whole record, with time zero at first contact"
    return Problem(where, "a record from 0 to at least 60 ms (100 ms is best)", found, advice, "time")
