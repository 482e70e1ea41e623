"""Pulse files, one per test or run or all in one tidy table, resampled from any even sampling to the study grid.

Tables are read in batches, straight into the array of all pulses: 100,000 runs need little more memory than that.
"""

import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from crashfuse import errors
from crashfuse.campaign_folder import condition_tables
from crashfuse.campaign_folder.condition_tables import PULSES, ConditionTable, find_column, listed, numbers_in
from crashfuse.campaign_folder.plausibility import gap_s
from crashfuse.errors import DataError, Problem, collecting, printable, refusal, refuse_if, require_there, shortened
from crashfuse.files.csv_text import unreadable
from crashfuse.files.parquet import opened_table
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import GRID_S, N_SAMPLES, FloatArray, Pulse
from crashfuse.signals.sensor_faults import SensorFault, sensor_faults
from crashfuse.units import ACCELERATION, MS, TIME, number, time_text

UNEVEN = 0.02  # allowed unevenness as a share of a time step: what rounding the times to a few digits can cause
SLOWEST_S = 1e-3 * (1 + UNEVEN)  # longest time step of a record
SHORTEST_S = 60e-3  # shortest record from contact: the longest rated window by default
_NO_CRASH_S, _AN_INSTANT_S = 10.0, 1e-3  # 60 ms and more taken for seconds; a second and less taken for ms
_MOST_SAMPLES = 2_000_000  # a record of 10 s at 200 kHz
_LARGEST_S, _LARGEST_MPS2 = 1e6, 1e6  # 100,000 g: beyond any sensor or vehicle
_MOST_RECORDS = 500_000


@dataclass(frozen=True, eq=False, slots=True)
class RecordedPulse:
    """A record as stored in a file, with the file's row of each sample, shape (n,), and the name of its times."""

    time_s: FloatArray
    accel_mps2: FloatArray
    rows: condition_tables.RowNumbers
    time_column: str

    def __getitem__(self, part: slice) -> "RecordedPulse":
        return RecordedPulse(self.time_s[part], self.accel_mps2[part], self.rows[part], self.time_column)


@dataclass(slots=True)
class PulseFiles:
    """Reader of all pulses of ``tests`` or ``cae`` in a campaign folder, resampled to the study grid."""

    folder: Path
    role: str
    channel_filter_class: float | None = None  # of whole records, before they are cropped to the grid
    gap_m: float = 0.0  # before the barrier: a record begins where its run is through, by its speed
    problems: list[Problem] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    unread: set[int] = field(default_factory=set)  # rows of ids without a usable pulse
    through_gap: int = 0  # records whose gap was taken out
    _unreadable: bool = False

    def read(self, table: ConditionTable, unused: Iterable[str] = ()) -> ConditionTable:
        """The table with its pulses, which are resampled; one with problems is zero."""
        passed_over = set(map(_composed, unused))
        accel = np.zeros((len(table.ids), N_SAMPLES), dtype=np.float32)  # takes memory only where a pulse is written
        row_of = {run_id: row for row, run_id in enumerate(table.ids)}
        missing, self.unread = dict.fromkeys(table.ids), set(row_of.values())
        strangers, ends_s, faults = list[str](), dict[str, float](), dict[str, tuple[SensorFault, ...]]()
        for run_id, where, record in self.records(table.ids):
            if _composed(run_id) in passed_over:
                continue
            if run_id not in row_of:
                strangers.append(run_id)
            elif run_id in missing:
                del missing[run_id]
                if record is None:
                    continue
                row = row_of[run_id]
                record = self._through_gap(record, table.conditions[row].speed_mps)
                if (on_grid := self._on_grid(record, _named(run_id, where))) is None:
                    continue
                accel[row] = on_grid
                self.unread.remove(row)
                if self.role == "tests" and (likely := sensor_faults(record.time_s, record.accel_mps2)):
                    faults[run_id] = likely
                if _ends_early(record.time_s):
                    ends_s[run_id] = float(record.time_s[-1])
        if not self._unreadable:
            found = f"none in {self.role}/ or {self.role}_pulses"
            found += f", but {listed(strangers)} without a row" if strangers else ""
            expected = [f"a pulse for {printable(run_id, 60)}" for run_id in missing]
            self.problems += [Problem(table.file, text, found, "add it or remove its row", "id") for text in expected]
        if strangers:
            left_out = f"{self.role}: pulses without a row in {table.file} are left out"
            self.warnings.append(f"{left_out}, namely {listed(strangers)}.")
        return replace(table, accel_mps2=accel, ends_s=ends_s, faults=faults)

    def check(self) -> None:
        """Check every record there is, for want of a table that says which belong."""
        for run_id, where, record in self.records(None) if self._forms() else ():
            if record is not None:
                self._on_grid(record, _named(run_id, where))

    def _forms(self) -> list[Path]:
        tables = [path for ending in PULSES if (path := self.folder / f"{self.role}_pulses{ending}").exists()]
        return [*tables, *filter(Path.is_dir, [self.folder / self.role])]

    def records(self, ids: Sequence[str] | None) -> Iterator[tuple[str, str, RecordedPulse | None]]:
        """Yield id, place and samples (None if unreadable) of each record, at least of these ids; None for all."""
        forms = self._forms()
        if len(forms) != 1:
            expected = f"the pulses either in {self.role}_pulses.parquet (or .csv) or in {self.role}/<id>.csv"
            found = " and ".join(f"{form.name}{'/' * form.is_dir()}" for form in forms) or "neither"
            self.problems.append(Problem(self.role, expected, found, "keep one form" if forms else "add the pulses"))
            self._unreadable = True
        elif forms[0].name == self.role:
            yield from self._from_files(forms[0], ids)
        else:
            yield from self._from_table(forms[0])

    def _from_files(self, folder: Path, ids: Sequence[str] | None) -> Iterator[tuple[str, str, RecordedPulse | None]]:
        try:
            names = sorted(path.name for path in folder.iterdir())
        except OSError as error:
            self.problems.append(unreadable(f"{folder.name}/", error))
            self._unreadable = True
            return
        there = {_composed(name): name for name in names}  # some systems write accents apart
        if ids is None:
            ids = list(dict.fromkeys(name.rpartition(".")[0] for name in names if name.endswith(PULSES)))
        for run_id in ids:
            files = [there[name] for ending in PULSES if (name := _composed(f"{run_id}{ending}")) in there]
            record, where = None, f"{folder.name}/{files[0] if files else ''}"
            if len(files) > 1:
                expected = f"one pulse for {run_id}"
                self.problems.append(Problem(f"{folder.name}/", expected, " and ".join(files), errors.KEEP_ONE))
            elif files:
                with collecting(self.problems):
                    record = _whole_record(folder / files[0], where, self.problems)
            if files:
                yield run_id, where, record
        known = set(map(_composed, ids))
        for name in names:
            stem, dot, ending = name.rpartition(".")
            if f"{dot}{ending}" in PULSES and _composed(stem) not in known:
                yield stem, name, None

    def _from_table(self, path: Path) -> Iterator[tuple[str, str, RecordedPulse | None]]:
        finished, pending_id, pending = set[str](), "", list[RecordedPulse]()
        so_far = len(self.problems)
        try:
            for codes, rows_of in _sample_batches(path, path.name, self.problems, with_id=True):
                starts = np.flatnonzero(np.r_[True, codes.codes[1:] != codes.codes[:-1]])
                for start, stop in zip(starts, np.r_[starts[1:], len(codes)], strict=True):
                    run_id = str(codes.categories[codes.codes[start]]).strip()
                    if pending and run_id != pending_id:
                        yield pending_id, path.name, _joined(pending)
                        finished.add(pending_id)
                        pending = []
                    pending_id = run_id
                    pending.append(rows_of[start:stop])
                    if len(finished) > _MOST_RECORDS:
                        raise refusal(path.name, f"at most {_MOST_RECORDS:,} runs", "more", "check its ids", "id")
                    if run_id in finished:
                        del self.problems[so_far:]  # problems of records split between batches are not real
                        found = f"rows of {printable(run_id, 60)} in two places"
                        trouble, at = (found, "sort the file by id, then by time"), int(pending[0].rows[0])
                        raise refusal(path.name, "the rows of one id together", *trouble, "id", at)
                    _check_length(pending, path.name)
        except DataError as error:
            self.problems.extend(error.problems)
            self._unreadable = True
            return
        if pending:
            yield pending_id, path.name, _joined(pending)

    def _through_gap(self, record: RecordedPulse, speed_mps: float) -> RecordedPulse:
        time_s, accel = record.time_s, record.accel_mps2
        if not self.gap_m or time_s.size < 2 or not (np.isfinite(time_s).all() and np.isfinite(accel).all()):
            return record
        lasts_s = gap_s(time_s, accel, speed_mps, self.gap_m)
        self.through_gap += lasts_s > 0
        return replace(record, time_s=time_s - lasts_s)

    def _on_grid(self, record: RecordedPulse, where: str) -> FloatArray | None:
        time, accel = record.time_s, record.accel_mps2
        if not np.isfinite(time).all():
            return None  # already reported cell by cell
        trouble = _time_trouble(record, where) or _cover_trouble(record, where)
        if trouble is not None:
            self.problems.append(trouble)
        if trouble is not None or not np.isfinite(accel).all():
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
            found = f"{where}: the record ends at {time_text(time[-1])}; it goes on with no acceleration"
            self.warnings.append(f"{found}: ratings over windows beyond that mean nothing for it.")
        return np.interp(GRID_S, time, accel, right=0.0 if early else None)


def _joined(parts: Sequence[RecordedPulse]) -> RecordedPulse:
    if len(parts) == 1:
        return parts[0]
    columns = zip(*((part.time_s, part.accel_mps2, part.rows) for part in parts), strict=True)
    time_s, accel_mps2, rows = map(np.concatenate, columns)
    return RecordedPulse(time_s, accel_mps2, rows, parts[0].time_column)


def _time_trouble(record: RecordedPulse, where: str) -> Problem | None:
    time, rows, column = record.time_s, record.rows, record.time_column
    if time.size < 2:
        return Problem(where, "at least two samples", f"{time.size}", "export the whole record", column)
    steps = np.diff(time)
    if steps.min() <= 0:
        at = int(np.argmax(steps <= 0))
        found = f"{time_text(time[at + 1], 6)} after {time_text(time[at], 6)}"
        advice = "sort by time, delete duplicates"
        return Problem(where, "time that increases", found, advice, column, int(rows[at + 1]))
    step = float(np.median(steps))
    off = np.abs(steps - step)
    if off.max() > UNEVEN * step:
        at = int(off.argmax())
        found = f"a step of {time_text(steps[at])} among steps of {time_text(step)}"
        return Problem(where, "evenly sampled time", found, "resample the record", column, int(rows[at + 1]))
    if slow := rate_trouble(step, float(time[-1] - time[0])):
        return Problem(where, *slow, column)
    return None


def rate_trouble(step_s: float, lasts_s: float) -> tuple[str, str, str] | None:
    """Expected, found and advice for a record that is sampled too slowly."""
    if step_s <= SLOWEST_S:
        return None
    if lasts_s > _NO_CRASH_S:
        return "a crash, of about 100 ms", f"one of {lasts_s:.4g} s", "check the unit: if it is ms, name it time_ms"
    return "at least 1000 samples a second", f"{1 / step_s:.0f} Hz", "export at a higher rate"


def advice_if_short(lasts_s: float, otherwise: str) -> str:
    """What to do about a record that is too short."""
    return "check the unit of time: if it is s, name it time_s" if lasts_s < _AN_INSTANT_S else otherwise


def _ends_early(time_s: FloatArray) -> bool:
    return bool(time_s[-1] < GRID_S[-1] - (time_s[-1] - time_s[0]) / (time_s.size - 1))


def _cover_trouble(record: RecordedPulse, where: str) -> Problem | None:
    time_s = record.time_s
    step = time_s[1] - time_s[0]
    if time_s[0] <= step and time_s[-1] >= SHORTEST_S - step:
        return None
    found = f"{number(time_s[0] / MS, '.4g')} to {time_text(time_s[-1])}"
    advice = advice_if_short(time_s[-1] - time_s[0], "export all of it, with time zero at first contact")
    return Problem(where, "a record from 0 to at least 60 ms (100 ms is best)", found, advice, record.time_column)


def _sample_batches(
    path: Path, where: str, problems: list[Problem], *, with_id: bool = False
) -> Iterator[tuple[pd.Categorical, RecordedPulse]]:
    """In SI units; a cell that is no number is a problem and NaN."""
    empty = True
    with opened_table(path, where) as table:
        (time, to_s), (accel, to_mps2) = _columns(table.names, where, with_id=with_id)
        for frame, rows in table.blocks([*(["id"] if with_id else []), time, accel]):
            if all(isinstance(kind, pd.StringDtype) for kind in frame.dtypes):
                filled = ~np.asarray((frame == "").all(axis=1))
                frame, rows = frame[filled], rows[filled]
            if not len(frame):
                continue
            empty = False
            ids = pd.Categorical(frame["id"] if with_id else np.zeros(len(frame), dtype=np.int8))
            nameless = (ids.codes < 0) | np.isin(ids.codes, np.flatnonzero(ids.categories == ""))
            refuse_if(nameless.any(), where, *condition_tables.NAMELESS, "id", int(rows[nameless.argmax()]))
            time_s = to_s * numbers_in(frame[time], time, where, rows, problems, _LARGEST_S / to_s)
            accel_mps2 = to_mps2 * numbers_in(frame[accel], accel, where, rows, problems, _LARGEST_MPS2 / to_mps2)
            yield ids, RecordedPulse(time_s, accel_mps2, rows, time)
    refuse_if(empty, where, "a header and rows", "an empty table", "add the samples")


def _whole_record(path: Path, where: str, problems: list[Problem]) -> RecordedPulse:
    parts: list[RecordedPulse] = []
    for _, part in _sample_batches(path, where, problems):
        parts.append(part)
        _check_length(parts, where)
    return _joined(parts)


def _check_length(parts: Sequence[RecordedPulse], where: str) -> None:
    if (count := sum(part.rows.size for part in parts)) > _MOST_SAMPLES:
        expected, place = f"at most {_MOST_SAMPLES} samples a record", (parts[0].time_column, int(parts[0].rows[0]))
        raise refusal(where, expected, f"{count} at least", "cut the record", *place)


def read_pulse(path: Path) -> Pulse:
    """Read one pulse from a CSV or Parquet file as sampled; raise a DataError with every problem of the file."""
    require_there(path, "a pulse file")
    problems: list[Problem] = []
    with collecting(problems):
        record = _whole_record(path, str(path), problems)
        if not problems and (trouble := _time_trouble(record, str(path))) is not None:
            problems.append(trouble)
    if problems:
        raise DataError(shortened(problems))
    return Pulse(record.time_s, record.accel_mps2)


def _columns(names: Sequence[str], where: str, *, with_id: bool) -> tuple[tuple[str, float], tuple[str, float]]:
    problems: list[Problem] = []
    time = find_column(names, "time", TIME, where, problems)
    accel = find_column(names, "acceleration", ACCELERATION, where, problems)
    if with_id and "id" not in names:
        problems.append(Problem(where, "a column id", f"the columns {listed(names)}", "name each row's run in it"))
    if problems or time is None or accel is None:
        raise DataError(problems)
    return time, accel


def _named(run_id: str, where: str) -> str:
    return f"{where}, {printable(run_id, 60)}" if "_pulses" in where else where


def _composed(name: str) -> str:
    return unicodedata.normalize("NFC", name)
