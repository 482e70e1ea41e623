"""Pulse files: one a test or run, or all in one tidy table; from any even sampling to the study grid.

Tables are read in batches and their samples go straight into the float32 array of all pulses, so that a library of
100,000 runs needs little more memory than the array itself.
"""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from crashfuse.campaign_folder.condition_tables import find_column, listed, not_a_number
from crashfuse.campaign_folder.recorded_signal import Signal, cover_trouble, ends_early, joined, time_trouble
from crashfuse.errors import DataError, Problem, printable, shortened
from crashfuse.files.csv_text import CsvTable, unreadable
from crashfuse.files.parquet import ParquetTable
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import GRID_S, N_SAMPLES, FloatArray, Pulse
from crashfuse.units import ACCELERATION, MS, TIME

_ENDINGS = (".csv", ".parquet")
_MOST_SAMPLES = 2_000_000  # a record of 10 s at 200 kHz
_LARGEST_S, _LARGEST_MPS2 = 1e6, 1e6  # 100,000 g: no sensor, no vehicle
_MOST_STRANGERS = 3  # named


@dataclass(slots=True)
class PulseFiles:
    """All pulses of ``tests`` or ``cae`` of a campaign folder, on their way to the study grid.

    Parameters
    ----------
    folder : Path
    role : {"tests", "cae"}
    channel_filter_class : float or None
        CFC to filter the whole record with, before it is cropped to the grid.
    """

    folder: Path
    role: str
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
        missing = set(ids)
        strangers: dict[str, None] = {}
        for run_id, where, signal in self._signals(ids):
            if run_id not in row_of:
                strangers[run_id] = None
            elif run_id in missing:
                missing.remove(run_id)
                if signal is None:
                    continue
                on_grid = self._on_grid(signal, f"{where}, {printable(run_id, 60)}" if "_pulses" in where else where)
                if on_grid is not None:
                    accel[row_of[run_id]] = on_grid
                    if ends_early(signal.time_s):
                        self.ends_s[run_id] = float(signal.time_s[-1])
        if not self._unreadable:
            self._report_missing([run_id for run_id in ids if run_id in missing])
        if strangers:
            named = ", ".join(printable(run_id, 60) for run_id in list(strangers)[:_MOST_STRANGERS])
            more = f" and {len(strangers) - _MOST_STRANGERS} more" if len(strangers) > _MOST_STRANGERS else ""
            self.warnings.append(
                f"{self.role}: pulses without a row in {self.role}.csv are left out, namely {named}{more}."
            )
        return accel

    def _signals(self, ids: Sequence[str]) -> Iterator[tuple[str, str, Signal | None]]:
        tables = [path for ending in _ENDINGS if (path := self.folder / f"{self.role}_pulses{ending}").exists()]
        singles = self.folder / self.role
        forms = [path.name for path in tables] + ([f"{singles.name}/"] if singles.is_dir() else [])
        if len(forms) != 1:
            expected = f"the pulses either in {self.role}_pulses.parquet (or .csv) or in {self.role}/<id>.csv"
            found = " and ".join(forms) if forms else "neither"
            self.problems.append(Problem(self.role, expected, found, "keep one form" if forms else "add the pulses"))
            self._unreadable = True
        elif tables:
            yield from self._from_table(tables[0])
        else:
            yield from self._from_files(singles, ids)

    def _from_files(self, folder: Path, ids: Sequence[str]) -> Iterator[tuple[str, str, Signal | None]]:
        try:
            names = sorted(path.name for path in folder.iterdir())
        except OSError as error:
            self.problems.append(unreadable(f"{folder.name}/", error))
            self._unreadable = True
            return
        there = set(names)
        for run_id in ids:
            files = [name for ending in _ENDINGS if (name := f"{run_id}{ending}") in there]
            if len(files) > 1:
                found, advice = " and ".join(files), "keep one of them"
                self.problems.append(Problem(f"{folder.name}/", f"one pulse for {run_id}", found, advice))
                yield run_id, files[0], None
            elif files:
                where = f"{folder.name}/{files[0]}"
                parts: list[Signal] = []
                for _, part in self._batches(folder / files[0], where, with_id=False):
                    parts.append(part)
                    if self._too_long(parts, where):
                        parts = []
                        break
                yield run_id, where, joined(parts) if parts else None
        known = set(ids)
        for name in names:
            stem, dot, ending = name.rpartition(".")
            if f"{dot}{ending}" in _ENDINGS and stem not in known:
                yield stem, name, None

    def _from_table(self, path: Path) -> Iterator[tuple[str, str, Signal | None]]:
        """Yield one signal a run, joining what a batch's end has cut."""
        finished: set[str] = set()
        pending_id = ""
        pending: list[Signal] = []
        so_far = len(self.problems)
        for codes, rows_of in self._batches(path, path.name, with_id=True):
            starts = np.flatnonzero(np.r_[True, codes.codes[1:] != codes.codes[:-1]])
            for start, stop in zip(starts, np.r_[starts[1:], len(codes)], strict=True):
                run_id = str(codes.categories[codes.codes[start]]).strip()
                if pending and run_id != pending_id:
                    yield pending_id, path.name, joined(pending)
                    finished.add(pending_id)
                    pending = []
                pending_id = run_id
                pending.append(rows_of[start:stop])
                if run_id in finished:
                    found = f"rows of {printable(run_id, 60)} in two places"
                    advice, row = "sort the file by id, then by time", int(pending[0].rows[0])
                    # what was said of records cut to pieces is no fault of theirs
                    self.problems[so_far:] = [
                        Problem(path.name, "the rows of one id together", found, advice, "id", row)
                    ]
                    self._unreadable = True
                    return
                if self._too_long(pending, path.name):
                    self._unreadable = True
                    return
        if pending:
            yield pending_id, path.name, joined(pending)

    def _too_long(self, parts: Sequence[Signal], where: str) -> bool:
        """Tell, and say, whether a record has more samples than any has."""
        if (count := sum(part.rows.size for part in parts)) <= _MOST_SAMPLES:
            return False
        found, advice = f"{count} at least", "cut the record, or export it at a lower rate"
        row = int(parts[0].rows[0])
        self.problems.append(Problem(where, f"at most {_MOST_SAMPLES} samples a record", found, advice, "time", row))
        return True

    def _batches(self, path: Path, where: str, *, with_id: bool) -> Iterator[tuple[pd.Categorical, Signal]]:
        """Yield batches as ids and SI samples; a file that cannot be read appends problems and yields nothing more."""
        empty = True
        try:
            with _opened(path, where) as table:
                columns = self._columns(table.names, where, with_id=with_id)
                if columns is None:
                    self._unreadable |= with_id
                    return
                (time, to_s), (accel, to_mps2) = columns
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
                        self.problems.append(Problem(where, "an id in each row", "an empty cell", advice, "id", row))
                        self._unreadable = True
                        return
                    time_s = to_s * not_a_number(frame[time], time, where, rows, self.problems, _LARGEST_S / to_s)
                    accel_mps2 = to_mps2 * not_a_number(
                        frame[accel], accel, where, rows, self.problems, _LARGEST_MPS2 / to_mps2
                    )
                    yield ids, Signal(time_s, accel_mps2, rows)
        except DataError as error:
            self.problems.extend(error.problems)
            self._unreadable |= with_id
            return
        if empty:
            self.problems.append(Problem(where, "a header and rows", "an empty table", "add the samples"))
            self._unreadable |= with_id

    def _columns(
        self, names: Sequence[str], where: str, *, with_id: bool
    ) -> tuple[tuple[str, float], tuple[str, float]] | None:
        """Find time and acceleration with their factors to SI; None, and problems, if the table lacks a column."""
        time = find_column(names, "time", TIME, where, self.problems)
        accel = find_column(names, "acceleration", ACCELERATION, where, self.problems)
        if with_id and "id" not in names:
            shown = f"the columns {listed(names)}"
            self.problems.append(Problem(where, "a column id", shown, "name the run of each row in it"))
            return None
        return None if time is None or accel is None else (time, accel)

    def _on_grid(self, signal: Signal, where: str) -> FloatArray | None:
        """Bring a signal to the study grid, or say why that is impossible."""
        time, accel = signal.time_s, signal.accel_mps2
        if not (np.isfinite(time).all() and np.isfinite(accel).all()):
            return None  # reported cell by cell already
        trouble = time_trouble(signal, where) or cover_trouble(time, where)
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
        early = ends_early(time)
        if early:
            self.warnings.append(
                f"{where}: the record ends at {time[-1] / MS:.4g} ms; it goes on with no acceleration, which nobody "
                f"measured: ratings over windows beyond {time[-1] / MS:.4g} ms mean nothing for it."
            )
        return np.interp(GRID_S, time, accel, right=0.0 if early else None)

    def _report_missing(self, missing: Sequence[str]) -> None:
        found = f"none in {self.role}/ or {self.role}_pulses"
        for run_id in missing:
            expected = f"a pulse for {printable(run_id, 60)}"
            self.problems.append(Problem(f"{self.role}.csv", expected, found, "add its pulse or remove its row", "id"))


def read_pulse(path: Path) -> Pulse:
    """Read one pulse from a CSV or Parquet file as it is sampled there.

    Raises
    ------
    DataError
        With every problem of the file.
    """
    if not path.exists():
        raise DataError(Problem(str(path), "a pulse file", "no such file", "check the path"))
    files = PulseFiles(path.parent, "", None)
    parts: list[Signal] = []
    for _, part in files._batches(path, str(path), with_id=False):
        parts.append(part)
        if files._too_long(parts, str(path)):
            break
    if not files.problems:
        signal = joined(parts)
        trouble = time_trouble(signal, str(path))
        if trouble is None:
            return Pulse(signal.time_s, signal.accel_mps2)
        files.problems.append(trouble)
    raise DataError(shortened(files.problems))


def _opened(path: Path, where: str) -> AbstractContextManager[CsvTable | ParquetTable]:
    return (ParquetTable if path.suffix == ".parquet" else CsvTable).opened(path, where)


def _blank(frame: pd.DataFrame) -> npt.NDArray[np.bool_]:
    """Lines with nothing in any of the columns, such as those that spreadsheets leave at the end."""
    if not all(isinstance(kind, pd.StringDtype) for kind in frame.dtypes):
        return np.zeros(len(frame), dtype=bool)
    return np.asarray((frame == "").all(axis=1))
