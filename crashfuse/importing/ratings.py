"""Ratings of files against each other: two of any kind that the import reads, pairs from a table, ISO-MME tests.

Tables keep their time and sign, channels of whole ISO-MME tests all they have. Every other file goes through the steps
of the import, so that a rating is the same before and after it. A note has what they changed.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple, cast

import pandas as pd

from crashfuse import errors
from crashfuse.campaign_folder.pulse_files import read_pulse
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError, DataError, UsageError, as_path, refusal, refuse_if, require_there, several
from crashfuse.files.csv_text import read_rows
from crashfuse.files.parquet import opened_table
from crashfuse.importing.channels import agreeing_channels, average, missing_choices, resample_evenly
from crashfuse.importing.detection import Case, Choices, delta_v, filter_class
from crashfuse.importing.pulse_conversion import settled_at
from crashfuse.importing.sources import Reading, format_of, read_records
from crashfuse.readers.formats import FORMATS, TABLES
from crashfuse.readers.isomme import Channel, read_isomme
from crashfuse.readers.record import Record, RecordedChannel
from crashfuse.readers.vocabulary import ACCELERATION_UNITS, Doubt, doubt_of
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.metrics import FURTHER_METRICS, further_metrics
from crashfuse.signals.pulse import Pulse
from crashfuse.signals.rating import WEIGHTS, filter_class_text, rate_windows, rated_curves, rating_basis
from crashfuse.signals.rating_explanation import RatingExplanation, explain_rating
from crashfuse.units import ACCELERATION, TIME, time_text

WINDOWS_MS = (20.0, 40.0, 60.0)
COLUMNS = (*("reference", "comparison", "channel", "window_ms"), *("overall", *WEIGHTS, "grade", "basis", "note"))
"""Of a table of ratings; a note says why there is none, what was changed before, or what speaks against it."""

_PAIR_COLUMNS = ("reference", "comparison", "reference_channel", "comparison_channel")
_MOST_PAIRS = 10_000
_KEPT = 8  # files in memory, as pairs often share a reference
_USUAL_REBOUND = 1.1  # change of velocity over impact speed
_CAREFUL = "Careful: "  # begins the steps of an import that may be wrong
_BRAKING = re.compile("decel|verz[oö]g", re.IGNORECASE)  # in the name of a quantity that is positive while braking
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
    as_given: bool = False  # nothing moved, turned or filtered that nobody asked for, whatever the format

    def __post_init__(self) -> None:
        Choices(unit=self.unit, channel_filter_class=self.channel_filter_class)  # refuses what there is not
        for name in ("channels", "comparison_channels", "also"):
            object.__setattr__(self, name, several(getattr(self, name)))
        for name in self.also:
            errors.one_of("measure", name, FURTHER_METRICS)


class _Curve(NamedTuple):
    pulse: Pulse
    filtering: str  # its filter class, in words
    changes: tuple[str, ...] = ()  # sentences on what the import changed, and did with care


_Row = dict[str, object]
_Read = Callable[[Path, tuple[str, ...], RatingChoices], _Curve]


def rate_files(
    reference: str | Path,
    comparison: str | Path,
    windows_ms: Sequence[float] = WINDOWS_MS,
    *,
    choices: RatingChoices = RatingChoices(),
) -> pd.DataFrame:
    """Rate one file against another by ISO/TS 18571: columns :data:`COLUMNS`, one row for each window from 0 in ms.

    ``reference`` is the test, of any kind that the import reads. A DataError refuses a file that cannot be read as one
    pulse, or ends within a window; a UsageError a channel or unit that does not exist.
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
    """As :func:`rate_files`, what each rating is made of."""
    paths = as_path(reference, "the reference"), as_path(comparison, "the comparison")
    one, other = _curves(*paths, choices, _curve)
    windows = cast(tuple[float, ...], several(windows_ms))
    return [explain_rating(one.pulse, other.pulse, window_ms) for window_ms in windows]


def rate_pairs(
    table: str | Path, windows_ms: Sequence[float] = WINDOWS_MS, *, choices: RatingChoices = RatingChoices()
) -> pd.DataFrame:
    """Rate every pair of files in a table, as :func:`rate_files` does.

    The table has the columns ``reference`` and ``comparison``, paths relative to its folder, and may have
    ``reference_channel`` and ``comparison_channel``, several channels to be averaged separated by semicolons.
    A pair that cannot be rated has one row, with a note; a DataError says that it is no such table.
    """
    path = as_path(table, "the table of pairs")
    refuse_if(not path.is_file(), str(path), "a table of pairs", "no such file", "check the path")
    names, rows, numbers = read_rows(path, path.name)
    is_other = not {*_PAIR_COLUMNS[:2]} <= {*names} <= {*_PAIR_COLUMNS} or len(set(names)) < len(names)
    expected = f"the columns reference, comparison, at most {', '.join(_PAIR_COLUMNS[2:])}"
    refuse_if(is_other, path.name, expected, ", ".join(names), "name the columns so")
    is_empty = not 0 < len(rows) <= _MOST_PAIRS
    refuse_if(is_empty, path.name, f"1 to {_MOST_PAIRS} pairs", f"{len(rows)}", "one pair a row")
    read = lru_cache(_KEPT)(_curve)
    parts = []
    for cells, number in zip(rows, numbers, strict=True):
        row = dict(zip(names, cells, strict=True))
        one, other = (row[name].strip() for name in _PAIR_COLUMNS[:2])
        refuse_if(not (one and other), path.name, "two files", "an empty cell", "name both", row=number)
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
    errors.require_a(RatingChoices, choices, "crashfuse.RatingChoices()")
    others = choices.comparison_channels or choices.channels
    return read(reference, choices.channels, choices), read(comparison, others, choices)


def _rated_rows(one: _Curve, other: _Curve, windows_ms: Sequence[float], also: Sequence[str]) -> Iterator[_Row]:
    pulses, filtering = (one.pulse, other.pulse), one.filtering
    if other.filtering != filtering:
        filtering = f"reference {filtering}, comparison {other.filtering}"
    changes = (f"{side}: {text}" for side, own in (("reference", one), ("comparison", other)) for text in own.changes)
    note = " ".join(changes)
    for window, rating in rate_windows(*pulses, windows_ms).items():
        row = {"window_ms": window, **asdict(rating), "basis": rating_basis(filtering), "note": note}
        yield row | further_metrics(rated_curves(*pulses, window), also) if also else row


def _ratings_table(rows: Sequence[_Row]) -> pd.DataFrame:
    columns = dict.fromkeys([*COLUMNS, *(name for row in rows for name in row)])
    table = pd.DataFrame(rows).reindex(columns=list(columns))
    text = ["reference", "comparison", "channel", "grade", "basis", "note"]
    return table.assign(**{name: table[name].astype(object).fillna("") for name in text})


def _reason(error: CrashfuseError) -> str:
    return " ".join(map(str, error.problems)) if isinstance(error, DataError) else str(error)


def _curve(path: Path, channels: tuple[str, ...], choices: RatingChoices) -> _Curve:
    require_there(path, "a pulse file")
    if not channels and _is_own(path):
        return _filtered(read_pulse(path), choices.channel_filter_class)
    fmt = format_of(path)
    records = read_records(Reading(path, fmt, together=bool(channels)))
    ids = ", ".join(record.id for record in records[:10])
    refuse_if(len(records) != 1, path.name, "one test or run", f"{len(records)}: {ids}", "name the file of one")
    record, given = records[0], Choices(channels, choices.unit, channel_filter_class=choices.channel_filter_class)
    if missing := missing_choices(record, given):
        raise DataError(missing)
    has_zero = all(channel.time_s[0] <= 0 <= channel.time_s[-1] for channel in record.chosen(channels))
    if choices.as_given or (fmt == TABLES and has_zero):
        return _as_given(Case(record, given, FORMATS[fmt].role, math.nan, [*record.steps]), choices)
    condition = Condition.of_vector([_speed(record, given), 1.0, 1.0])  # weights do not matter to a pulse
    settled = settled_at(record, given, condition, FORMATS[fmt].role, [*record.steps], raw=False)
    changes = []
    if moved_s := settled.time_zero_s:
        changes.append(f"taken {time_text(abs(moved_s))} {'earlier' if moved_s > 0 else 'later'}, from contact on.")
    if settled.deceleration_sign == "positive":
        changes.append("turned, so that deceleration is negative.")
    if choices.unit is None and not any(channel.unit for channel in record.chosen(channels)):
        changes.append(f"read in {settled.unit}, by its change of velocity.")
    filtering = filter_class_text(settled.channel_filter_class)
    return _Curve(settled.pulse, filtering, (*changes, *_with_care(settled.steps)))


def _as_given(case: Case, choices: RatingChoices) -> _Curve:
    channels = agreeing_channels(case)
    time_s, values = average(case, channels)
    accel, changes = values * ACCELERATION_UNITS[_unit(case.record, channels[0], case.choices)], list[str]()
    if choices.as_given:
        return _filtered(Pulse(time_s, accel), choices.channel_filter_class, *_with_care(case.steps))
    if delta_v(time_s, values) > 0 and _BRAKING.search(channels[0].name):
        accel, changes = -accel, ["turned, as it is named a deceleration."]
    cfc = filter_class(case, channels, time_s, accel)
    return _filtered(Pulse(time_s, accel), cfc, *changes, *_with_care(case.steps))


def _with_care(steps: Iterable[str]) -> Iterator[str]:
    return (step.removeprefix(_CAREFUL) for step in steps if step.startswith(_CAREFUL))


def _filtered(pulse: Pulse, cfc: _Class, *changes: str) -> _Curve:
    if cfc is None or isinstance(cfc, str):
        return _Curve(pulse, filter_class_text(None), changes)
    filtered = Pulse(pulse.time_s, cfc_filter(pulse.accel_mps2, cfc=cfc, dt_s=pulse.dt_s))
    return _Curve(filtered, filter_class_text(cfc), changes)


def _is_own(path: Path) -> bool:
    with suppress(DataError):
        if path.suffix in (".csv", ".parquet"):
            with opened_table(path, path.name) as table:
                has_time = any(f"time_{unit}" in table.names for unit in TIME)
                has_acceleration = any(f"acceleration_{unit}" in table.names for unit in ACCELERATION)
                return has_time and has_acceleration and "id" not in table.names
    return path.suffix == ".parquet"


def _unit(record: Record, channel: RecordedChannel, choices: Choices) -> str:
    if (unit := choices.unit or channel.unit) is None:
        raise refusal(record.source, f"the unit of the acceleration of {record.id}", "none", "give it (--unit)")
    return unit


def _speed(record: Record, choices: Choices) -> float:
    if record.condition.speed_mps is not None:
        return record.condition.speed_mps
    channel = record.chosen(choices.channels)[0]
    gain = delta_v(*resample_evenly(channel, record.source)[:2])
    return abs(gain) * ACCELERATION_UNITS[_unit(record, channel, choices)] / _USUAL_REBOUND


def rate_channels(
    reference: str | Path,
    comparison: str | Path,
    windows_ms: Sequence[float] = WINDOWS_MS,
    *,
    choices: RatingChoices = RatingChoices(),
) -> pd.DataFrame:
    """Rate every channel of one ISO-MME test against the channel of the other that has the same code.

    Of several channels with one code, the n-th is rated against the n-th; one that cannot be rated has one row, with a
    note. Tests are given by their folder, ``.mme`` file or zip. A UsageError refuses choices that change a curve.
    """
    if choices != RatingChoices(also=choices.also, as_given=choices.as_given):
        raise UsageError("Channels are rated as they are: choose nothing.")
    reference, comparison = as_path(reference, "the reference"), as_path(comparison, "the comparison")
    sides = [_channels(path) for path in (reference, comparison)]
    are_others, expected = not set(sides[0]) & set(sides[1]), f"channels of {reference.name}"
    refuse_if(are_others, comparison.name, expected, "codes of one only", "rate their pulses instead")
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
    refuse_if(one.unit != other.unit, one.code, f"the unit {one.unit or 'none'}", other.unit or "none", "convert")
    sides = (("reference", one.status), ("comparison", other.status))
    doubts = [(doubt_of(status), side, status) for side, status in sides]
    note = "; ".join(f"the {side} marks it {errors.printable(status)!r}" for doubt, side, status in doubts if doubt)
    if max(doubts)[0] == Doubt.FAILED:
        yield {"note": note}
        return
    yield from ({**row, "note": note} for row in _rated_rows(_signal(one), _signal(other), windows_ms, also))


def _channels(path: Path) -> dict[tuple[str, int], Channel]:
    count, numbered = Counter[str](), dict[tuple[str, int], Channel]()
    for channel in read_isomme(path).channels:
        if code := channel.code.upper():
            count[code] += 1
            numbered[code, count[code]] = channel
    return numbered


def _signal(channel: Channel) -> _Curve:
    if channel.time_s is None:
        raise refusal(channel.code, "an evenly sampled signal", "no sampling interval", "export it again")
    filtering = _CLASSES.get(channel.code[-1:].upper(), "filter class unknown")
    return _Curve(Pulse(channel.time_s, channel.values), filtering)
