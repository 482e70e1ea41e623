"""Pulse files, one per test or run or all in one tidy table, resampled from any even sampling to the study grid.

Tables are read in batches and their samples go straight into the float32 array of all pulses, so that a library of
100,000 runs needs little more memory than the array itself.
"""

import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import numpy.typing as npt

from crashfuse.campaign_folder.columns import MOST_PROBLEMS
from crashfuse.campaign_folder.gap import gap_s
from crashfuse.campaign_folder.recorded_pulse import RecordedPulse, cover_trouble, ends_early, joined, time_trouble
from crashfuse.campaign_folder.sample_tables import check_length, sample_batches, whole_record
from crashfuse.errors import DataError, Problem, collecting, printable
from crashfuse.files.csv_text import unreadable
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import GRID_S, N_SAMPLES, FloatArray
from crashfuse.signals.sensor_faults import SensorFault, sensor_faults
from crashfuse.wording import time_text

_composed = partial(unicodedata.normalize, "NFC")
_ENDINGS = (".csv", ".parquet")
_MOST_RECORDS = 500_000
_MOST_STRANGERS = 3  # named in the warning


@dataclass(slots=True)
class PulseFiles:
    """Reader of all pulses of ``tests`` or ``cae`` in a campaign folder, resampled to the study grid.

    With a channel filter class, whole records are filtered before they are cropped to the grid. With a gap before the
    barrier, a record begins where its run is through it, by its speed.
    """

    folder: Path
    role: str
    channel_filter_class: float | None
    gap_m: float = 0.0
    speeds_mps: Mapping[str, float] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    ends_s: dict[str, float] = field(default_factory=dict)
    """End times of the records that are shorter than the study grid, by id."""
    unread: list[int] = field(default_factory=list)
    """Rows of the ids without a pulse that can be used."""
    faults: dict[str, tuple[SensorFault, ...]] = field(default_factory=dict)
    """What looks like a fault of a test's sensor in its record as stored, by id."""
    through_gap: int = 0
    """Records whose gap was taken out."""
    _unreadable: bool = False

    def read(self, ids: Sequence[str], unused: Sequence[str] = ()) -> npt.NDArray[np.float32]:
        """The pulses of these ids on the study grid, shape (n_ids, 1250), m/s².

        Problems go to ``problems``; a pulse that has any is zero and in ``unread``. Unused ids are passed over.
        """
        passed_over = set(map(_composed, unused))
        accel = np.zeros((len(ids), N_SAMPLES), dtype=np.float32)  # takes memory only where a pulse is written
        row_of = {run_id: row for row, run_id in enumerate(ids)}
        missing, unread = set(ids), set(row_of.values())
        strangers, named = 0, list[str]()
        for run_id, where, record in self.records(ids):
            if _composed(run_id) in passed_over:
                continue
            if run_id not in row_of:
                strangers += 1
                if strangers <= _MOST_STRANGERS:
                    named.append(printable(run_id, 60))
            elif run_id in missing:
                missing.remove(run_id)
                if record is None:
                    continue
                record = self._through_gap(record, run_id)
                on_grid = self._on_grid(record, _named(run_id, where))
                if on_grid is not None:
                    accel[row_of[run_id]] = on_grid
                    unread.remove(row_of[run_id])
                    if self.role == "tests" and (faults := sensor_faults(record.time_s, record.accel_mps2)):
                        self.faults[run_id] = faults
                    if ends_early(record.time_s):
                        self.ends_s[run_id] = float(record.time_s[-1])
        self.unread = sorted(unread)
        more = f" and {strangers - _MOST_STRANGERS} more" if strangers > _MOST_STRANGERS else ""
        without_row = f"{', '.join(named)}{more}"
        if not self._unreadable:
            found, advice = f"none in {self.role}/ or {self.role}_pulses", "add its pulse or remove its row"
            found += f", but {without_row} without a row" if strangers else ""
            named_first = islice((run_id for run_id in ids if run_id in missing), MOST_PROBLEMS)
            for expected in (f"a pulse for {printable(run_id, 60)}" for run_id in named_first):
                self.problems.append(Problem(f"{self.role}.csv", expected, found, advice, "id"))
            if (rest := len(missing) - MOST_PROBLEMS) > 0:
                found, advice = f"{rest} more like these", "correct them too"
                self.problems.append(Problem(f"{self.role}.csv", "a pulse for each id", found, advice, "id"))
        if strangers:
            told = f"pulses without a row in {self.role}.csv are left out, namely {without_row}."
            self.warnings.append(f"{self.role}: {told}")
        return accel

    def check(self) -> None:
        """Check every record there is, for want of a table that says which belong; problems go to ``problems``."""
        if self._forms():
            for run_id, where, record in self.records(None):
                if record is not None:
                    self._on_grid(record, _named(run_id, where))

    def _forms(self) -> list[Path]:
        """The tables of pulses and the folder of single files, as far as they are there."""
        tables = [path for ending in _ENDINGS if (path := self.folder / f"{self.role}_pulses{ending}").exists()]
        singles = self.folder / self.role
        return [*tables, *([singles] if singles.is_dir() else [])]

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
            ids = list(dict.fromkeys(name.rpartition(".")[0] for name in names if name.endswith(_ENDINGS)))
        for run_id in ids:
            files = [there[name] for ending in _ENDINGS if (name := _composed(f"{run_id}{ending}")) in there]
            record, where = None, f"{folder.name}/{files[0] if files else ''}"
            if len(files) > 1:
                found, advice = " and ".join(files), "keep one of them"
                self.problems.append(Problem(f"{folder.name}/", f"one pulse for {run_id}", found, advice))
            elif files:
                with collecting(self.problems):
                    record = whole_record(folder / files[0], where, self.problems)
            if files:
                yield run_id, where, record
        known = set(map(_composed, ids))
        for name in names:
            stem, dot, ending = name.rpartition(".")
            if f"{dot}{ending}" in _ENDINGS and _composed(stem) not in known:
                yield stem, name, None

    def _from_table(self, path: Path) -> Iterator[tuple[str, str, RecordedPulse | None]]:
        """Yield one record per run, joining records that were split at a batch boundary."""
        finished: set[str] = set()
        pending_id = ""
        pending: list[RecordedPulse] = []
        so_far = len(self.problems)
        try:
            for codes, rows_of in sample_batches(path, path.name, self.problems, with_id=True):
                starts = np.flatnonzero(np.r_[True, codes.codes[1:] != codes.codes[:-1]])
                for start, stop in zip(starts, np.r_[starts[1:], len(codes)], strict=True):
                    run_id = str(codes.categories[codes.codes[start]]).strip()
                    if pending and run_id != pending_id:
                        yield pending_id, path.name, joined(pending)
                        finished.add(pending_id)
                        pending = []
                    pending_id = run_id
                    pending.append(rows_of[start:stop])
                    if len(finished) > _MOST_RECORDS:
                        found, advice = "more", "check its ids, or leave runs out"
                        raise DataError(Problem(path.name, f"at most {_MOST_RECORDS:,} runs", found, advice, "id"))
                    if run_id in finished:
                        del self.problems[so_far:]  # problems of records split between batches are not real
                        found = f"rows of {printable(run_id, 60)} in two places"
                        advice, row = "sort the file by id, then by time", int(pending[0].rows[0])
                        raise DataError(Problem(path.name, "the rows of one id together", found, advice, "id", row))
                    check_length(pending, path.name)
        except DataError as error:
            self.problems.extend(error.problems)
            self._unreadable = True
            return
        if pending:
            yield pending_id, path.name, joined(pending)

    def _through_gap(self, record: RecordedPulse, run_id: str) -> RecordedPulse:
        """The record with its time zero where the run is through the gap, if it has one."""
        time_s, accel = record.time_s, record.accel_mps2
        if not self.gap_m or time_s.size < 2 or not (np.isfinite(time_s).all() and np.isfinite(accel).all()):
            return record
        lasts_s = gap_s(time_s, accel, self.speeds_mps[run_id], self.gap_m)
        self.through_gap += lasts_s > 0
        return replace(record, time_s=time_s - lasts_s)

    def _on_grid(self, record: RecordedPulse, where: str) -> FloatArray | None:
        """Resample a record to the study grid; where that is impossible, append a problem and return None."""
        time, accel = record.time_s, record.accel_mps2
        if not np.isfinite(time).all():
            return None  # already reported cell by cell
        trouble = time_trouble(record, where) or cover_trouble(record, where)
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
        early = ends_early(time)
        if early:
            self.warnings.append(
                f"{where}: the record ends at {time_text(time[-1])}; it goes on with no acceleration, which nobody "
                f"measured: ratings over windows beyond {time_text(time[-1])} mean nothing for it."
            )
        return np.interp(GRID_S, time, accel, right=0.0 if early else None)


def _named(run_id: str, where: str) -> str:
    """The place of a record: its file, with its id if the file holds many."""
    return f"{where}, {printable(run_id, 60)}" if "_pulses" in where else where
