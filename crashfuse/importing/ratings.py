"""Ratings of files against each other: two of any kind that the import reads, pairs from a table, ISO-MME tests.

A table in our own form (time and acceleration with their units) is rated as it stands, and so is each channel of whole
ISO-MME tests. Every other file goes through the steps of the import, so that a rating is the same before and after it.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal, cast

import pandas as pd

from crashfuse.campaign_folder.pulse_files import read_pulse
from crashfuse.condition import Condition
from crashfuse.errors import (
    CrashfuseError,
    DataError,
    Problem,
    UsageError,
    as_path,
    one_of,
    printable,
    require_a,
    several,
)
from crashfuse.files.csv_text import read_rows
from crashfuse.files.parquet import opened_table
from crashfuse.importing.channels import missing_choices, resample_evenly
from crashfuse.importing.detection import Choices, delta_v
from crashfuse.importing.pulse_conversion import settled_at
from crashfuse.importing.sources import Reading, format_of, read_records
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.isomme import Channel, read_isomme
from crashfuse.readers.record import Record
from crashfuse.readers.vocabulary import ACCELERATION_UNITS, Doubt, doubt_of
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.metrics import FURTHER_METRICS, further_metrics
from crashfuse.signals.pulse import Pulse
from crashfuse.signals.rating import WEIGHTS, filter_class_text, rate_windows, rated_curves, rating_basis
from crashfuse.signals.rating_explanation import RatingExplanation, explain_rating
from crashfuse.units import ACCELERATION, TIME

WINDOWS_MS = (20.0, 40.0, 60.0)
COLUMNS = (*("reference", "comparison", "channel", "window_ms"), *("overall", *WEIGHTS, "grade", "basis", "note"))
"""Of a table of ratings; a note says why there is no rating, or what speaks against a channel that was rated."""

_PAIR_COLUMNS = ("reference", "comparison", "reference_channel", "comparison_channel")
_MOST_PAIRS = 10_000
_KEPT = 8  # files in memory, as pairs often share a reference
_USUAL_REBOUND = 1.1  # change of velocity over impact speed
_CLASSES = {"A": "CFC 1000", "B": "CFC 600", "C": "CFC 180", "D": "CFC 60", "0": "unfiltered", "P": "prefiltered"}


_Class = float | Literal["none"] | None


@dataclass(frozen=True, slots=True)
class RatingChoices:
    """How the files of a rating are read, beyond what the import detects; a UsageError if there is no such choice."""

    channels: tuple[str, ...] = ()  # of the reference, to be averaged
    comparison_channels: tuple[str, ...] = ()  # of the comparison, if they are others
    channel_filter_class: _Class = None  # as the import finds; tables in our own form are not filtered
    unit: str | None = None  # of the acceleration in files of other formats
    also: tuple[str, ...] = ()  # measures beside the rating: sprague-geers, anova

    def __post_init__(self) -> None:
        Choices(unit=self.unit, channel_filter_class=self.channel_filter_class)  # refuses what there is not
        for name in ("channels", "comparison_channels", "also"):
            object.__setattr__(self, name, several(getattr(self, name)))
        for name in self.also:
            one_of("measure", name, FURTHER_METRICS)


_Row = dict[str, object]
_Curve = tuple[Pulse, str]  # and its filter class, in words
_Read = Callable[[Path, tuple[str, ...], _Class, str | None], _Curve]


def rate_files(
    reference: str | Path,
    comparison: str | Path,
    windows_ms: Sequence[float] = WINDOWS_MS,
    *,
    choices: RatingChoices = RatingChoices(),
) -> pd.DataFrame:
    """Rate one file against another by ISO/TS 18571: columns :data:`COLUMNS`, one row for each window.

    Parameters
    ----------
    reference, comparison : str or Path
        The test and what is compared with it, one of any kind that the import reads.
    windows_ms : sequence of float
        Rated are 0 to each of these, in ms.

    A DataError refuses a file that cannot be read as one pulse, or ends within a window; a UsageError a channel or unit
    that does not exist.
    """
    one, other = as_path(reference, "the reference"), as_path(comparison, "the comparison")
    return _pair_table(one, other, windows_ms, choices, _curve)


def explain_files(
    reference: str | Path,
    comparison: str | Path,
    windows_ms: Sequence[float] = WINDOWS_MS,
    *,
    choices: RatingChoices = RatingChoices(),
) -> list[RatingExplanation]:
    """Explain how two files rate, over each window: as :func:`rate_files`, with what each rating is made of."""
    paths = as_path(reference, "the reference"), as_path(comparison, "the comparison")
    (one, _), (other, _) = _curves(*paths, choices, _curve)
    return [explain_rating(one, other, window_ms) for window_ms in cast(tuple[float, ...], several(windows_ms))]


def rate_pairs(
    table: str | Path, windows_ms: Sequence[float] = WINDOWS_MS, *, choices: RatingChoices = RatingChoices()
) -> pd.DataFrame:
    """Rate every pair of files in a table, as :func:`rate_files` does.

    The table has the columns ``reference`` and ``comparison``, paths relative to its folder, and may have
    ``reference_channel`` and ``comparison_channel``, several channels to be averaged separated by semicolons.
    A pair that cannot be rated has one row, with a note; a DataError says that it is no such table.
    """
    path = as_path(table, "the table of pairs")
    if not path.is_file():
        raise DataError(Problem(str(path), "a table of pairs", "no such file", "check the path"))
    names, rows, numbers = read_rows(path, path.name)
    unknown = [name for name in names if name not in _PAIR_COLUMNS]
    if unknown or not {"reference", "comparison"} <= set(names) or len(set(names)) < len(names):
        expected = f"the columns reference and comparison, and at most {', '.join(_PAIR_COLUMNS[2:])}"
        raise DataError(Problem(path.name, expected, ", ".join(names), "name the columns so"))
    if not rows or len(rows) > _MOST_PAIRS:
        raise DataError(Problem(path.name, f"1 to {_MOST_PAIRS} pairs", f"{len(rows)}", "one pair a row"))
    read = lru_cache(_KEPT)(_curve)
    parts = []
    for cells, number in zip(rows, numbers, strict=True):
        row = dict(zip(names, cells, strict=True))
        one, other = (row[name].strip() for name in ("reference", "comparison"))
        if not (one and other):
            raise DataError(Problem(path.name, "two files", "an empty cell", "name both files of the pair", row=number))
        channels = _split(row.get("reference_channel", "")) or choices.channels
        others = _split(row.get("comparison_channel", "")) or choices.comparison_channels
        of_pair = replace(choices, channels=channels, comparison_channels=others)
        try:
            rated = _pair_table(path.parent / one, path.parent / other, windows_ms, of_pair, read)
        except CrashfuseError as error:
            rated = _ratings_table([{"note": _reason(error)}])
        parts.append(rated.assign(reference=one, comparison=other))
    return pd.concat(parts, ignore_index=True)


def _split(cell: str) -> tuple[str, ...]:
    return tuple(filter(None, (name.strip() for name in cell.split(";"))))


def _pair_table(
    reference: Path, comparison: Path, windows_ms: Sequence[float], choices: RatingChoices, read: _Read
) -> pd.DataFrame:
    rows = [*_rated_rows(*_curves(reference, comparison, choices, read), windows_ms, choices.also)]
    return _ratings_table(rows).assign(reference=str(reference), comparison=str(comparison))


def _curves(reference: Path, comparison: Path, choices: RatingChoices, read: _Read) -> tuple[_Curve, _Curve]:
    require_a(RatingChoices, choices, "crashfuse.RatingChoices()")
    shared = choices.channel_filter_class, choices.unit
    return (
        read(reference, choices.channels, *shared),
        read(comparison, choices.comparison_channels or choices.channels, *shared),
    )


def _rated_rows(one: _Curve, other: _Curve, windows_ms: Sequence[float], also: Sequence[str]) -> Iterator[_Row]:
    (reference, filtering), (comparison, others) = one, other
    filtering = filtering if others == filtering else f"reference {filtering}, comparison {others}"
    for window, rating in rate_windows(reference, comparison, windows_ms).items():
        row = {"window_ms": window, **asdict(rating), "basis": rating_basis(filtering)}
        yield row | further_metrics(rated_curves(reference, comparison, window), also) if also else row


def _ratings_table(rows: Sequence[_Row]) -> pd.DataFrame:
    columns = dict.fromkeys([*COLUMNS, *(name for row in rows for name in row)])
    table = pd.DataFrame(rows).reindex(columns=list(columns))
    text = ["reference", "comparison", "channel", "grade", "basis", "note"]
    return table.assign(**{name: table[name].astype(object).fillna("") for name in text})


def _reason(error: CrashfuseError) -> str:
    return " ".join(map(str, error.problems)) if isinstance(error, DataError) else str(error)


def _curve(path: Path, channels: tuple[str, ...], cfc: _Class, unit: str | None) -> _Curve:
    if not path.exists():
        raise DataError(Problem(str(path), "a pulse file", "no such file", "check the path"))
    if not channels and _is_own(path):
        pulse = read_pulse(path)
        if cfc is None or isinstance(cfc, str):
            return pulse, filter_class_text(None)
        return Pulse(pulse.time_s, cfc_filter(pulse.accel_mps2, cfc=cfc, dt_s=pulse.dt_s)), filter_class_text(cfc)
    fmt = format_of(path)
    records = read_records(Reading(path, fmt, together=bool(channels)))
    if len(records) != 1:
        ids = ", ".join(record.id for record in records[:10])
        raise DataError(Problem(path.name, "one test or run", f"{len(records)}: {ids}", "name the file of one"))
    record, given = records[0], Choices(channels, unit, channel_filter_class=cfc)
    if missing := missing_choices(record, given):
        raise DataError(missing)
    condition = Condition.of_vector([_speed(record, given), 1.0, 1.0])  # weights do not matter to a pulse
    settled = settled_at(record, given, condition, FORMATS[fmt].role, [], raw=False)
    return settled.pulse, filter_class_text(settled.channel_filter_class)


def _is_own(path: Path) -> bool:
    with suppress(DataError):
        if path.suffix in (".csv", ".parquet"):
            with opened_table(path, path.name) as table:
                has_time = any(f"time_{unit}" in table.names for unit in TIME)
                has_acceleration = any(f"acceleration_{unit}" in table.names for unit in ACCELERATION)
                return has_time and has_acceleration and "id" not in table.names
    return path.suffix == ".parquet"


def _speed(record: Record, choices: Choices) -> float:
    if record.condition.speed_mps is not None:
        return record.condition.speed_mps
    channel = record.chosen(choices.channels)[0]
    unit = choices.unit or channel.unit
    if unit is None or unit not in ACCELERATION_UNITS:
        expected, advice = f"the unit of the acceleration of {record.id}", "give it (--unit)"
        raise DataError(Problem(record.source, expected, unit or "none", advice))
    gain = delta_v(*resample_evenly(channel, record.source)[:2]) * ACCELERATION_UNITS[unit]
    return abs(gain) / _USUAL_REBOUND


def rate_channels(
    reference: str | Path,
    comparison: str | Path,
    windows_ms: Sequence[float] = WINDOWS_MS,
    *,
    choices: RatingChoices = RatingChoices(),
) -> pd.DataFrame:
    """Rate every channel of one ISO-MME test against the channel of the other that has the same code.

    Of several channels with one code, the n-th is rated against the n-th; one that cannot be rated has one row, with a
    note. Tests are given by their folder, ``.mme`` file or zip. Of the choices only ``also`` counts; a UsageError
    refuses others.
    """
    if choices != RatingChoices(also=choices.also):
        raise UsageError("Channels are rated as they are: choose nothing.")
    reference, comparison = as_path(reference, "the reference"), as_path(comparison, "the comparison")
    sides = [_channels(path) for path in (reference, comparison)]
    if not set(sides[0]) & set(sides[1]):
        found = "codes that occur in one of them only"
        raise DataError(Problem(comparison.name, f"channels of {reference.name}", found, "rate their pulses instead"))
    rows: list[_Row] = []
    for code, n in sorted(sides[0], key=lambda key: key not in sides[1]):
        name = code if n == 1 else f"{code} ({n})"
        if (code, n) not in sides[1]:
            rows.append({"channel": name, "note": "only in the reference"})
            continue
        try:
            rated = _rows(sides[0][code, n], sides[1][code, n], windows_ms, choices.also)
            rows += [{"channel": name, **row} for row in rated]
        except DataError as error:
            rows.append({"channel": name, "note": _reason(error)})
    rows += [{"channel": key[0], "note": "only in the comparison"} for key in sides[1] if key not in sides[0]]
    return _ratings_table(rows).assign(reference=str(reference), comparison=str(comparison))


def _rows(one: Channel, other: Channel, windows_ms: Sequence[float], also: Sequence[str]) -> Iterator[_Row]:
    if one.unit != other.unit:
        raise DataError(Problem(one.code, f"the unit {one.unit or 'none'}", other.unit or "none", "convert"))
    sides = (("reference", one.status), ("comparison", other.status))
    doubts = [(doubt_of(status), side, status) for side, status in sides]
    note = "; ".join(f"the {side} marks it {printable(status)!r}" for doubt, side, status in doubts if doubt)
    if max(doubts)[0] == Doubt.FAILED:
        yield {"note": note}
        return
    yield from ({**row, "note": note} for row in _rated_rows(_signal(one), _signal(other), windows_ms, also))


def _channels(path: Path) -> dict[tuple[str, int], Channel]:
    count: Counter[str] = Counter()
    numbered: dict[tuple[str, int], Channel] = {}
    for channel in read_isomme(path).channels:
        if code := channel.code.upper():
            count[code] += 1
            numbered[code, count[code]] = channel
    return numbered


def _signal(channel: Channel) -> _Curve:
    if channel.time_s is None:
        raise DataError(Problem(channel.code, "an evenly sampled signal", "no sampling interval", "export it again"))
    return Pulse(channel.time_s, channel.values), _CLASSES.get(channel.code[-1:].upper(), "filter class unknown")
