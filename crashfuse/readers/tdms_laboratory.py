"""TDMS files of any laboratory: the accelerations of the vehicle among all their channels, judged by name and unit.

Names and units are read as those of a table's columns (:mod:`crashfuse.readers.tables.headers`). The IIHS names
channels by codes of ISO-MME (``11VEHC0000__ACX_``, and ``11VEHC0000__ACXD`` for the filtered signal), or in words with
the unit (``IIWPG Acceleration (g)``, with a channel ``IIWPG Time (sec)``); the property ``Impact_velocity`` of the file
is the speed, a text in km/h. Channels whose recording began at different times (``wf_start_time``) are aligned by them.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np

from crashfuse.errors import DataError, Problem, printable
from crashfuse.readers.channel_codes import ChannelCode, proposed
from crashfuse.readers.crash_setup import other_setup
from crashfuse.readers.nhtsa_sensors import number_in
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel, proposal
from crashfuse.readers.tables.headers import (
    OF_A_DUMMY,
    OTHER_DIRECTION,
    ColumnUse,
    cutoff_of,
    likelihood,
    use_of,
    why_no_acceleration,
)
from crashfuse.readers.tdms_container import TdmsChannel, TdmsFile
from crashfuse.readers.tdms_waveform import MOST_CHANNELS, Told, number_of, text_of, waveform
from crashfuse.readers.unit_spelling import UNITS, number_and_unit, unit_named
from crashfuse.signals.pulse import FloatArray
from crashfuse.wording import time_text

_LONGEST_S = 2.0  # a time without a unit is in ms if it lasts longer
_MOST_VALUES = 20_000_000  # in all of them
_MOST_CLOCKS = 1000
_SPEED = re.compile(r"impact[ _-]*(velocity|speed)", re.IGNORECASE)
_ABOUT_THE_TEST = re.compile(r"type|config|title|descr|test|crash|mode|subject", re.IGNORECASE)


@dataclass(frozen=True, eq=False, slots=True)
class _Candidate:
    """A channel, its properties, and what its name and unit make of it."""

    channel: TdmsChannel
    said: Told
    use: ColumnUse


def laboratory_record(file: TdmsFile, record_id: str, where: str) -> Record:
    """The record of a file with its accelerations that could be the vehicle's along X, the likeliest first.

    Those at the best place are proposed, by the codes of their names; without codes, the only acceleration.

    Raises
    ------
    DataError
        If there is none, or none has samples and a time.
    """
    every = [_candidate(channel, file.told(channel)) for channel in file.channels]
    found, what = [one for one in every if one.use.role == "acceleration"], "acceleration"
    if not found:
        found, what = [one for one in every if _may_be_one(one)], "channel"
    if not found:
        expected = "accelerations of the vehicle along X, by their units (unit_string) and names"
        raise DataError(Problem(where, expected, f"none of {len(every)}", "export them with their units"))
    found = sorted(found, key=lambda one: likelihood(one.channel.name))
    channels, unread, began_s = _read(file, found[:MOST_CHANNELS], every, where)
    if not channels:
        raise DataError(list(unread.values()))
    condition, steps = _condition(found[0].said)
    if len(set(began_s.values())) > 1:
        channels = _aligned(channels, began_s, steps)
    others = sum(one.use.why in (OF_A_DUMMY, OTHER_DIRECTION) for one in every)
    if others:
        steps.append(f"Left out: accelerations of dummies or in other directions ({others}).")
    if unread:
        steps.append(f"Left out for lack of samples or of their time: {', '.join(map(printable, unread))}.")
    chosen, why = _proposed(channels, len(found), what)
    told = [value for name, value in file.properties.items() if isinstance(value, str) and _ABOUT_THE_TEST.search(name)]
    recorded = tuple(channels.values())
    other = other_setup(told)
    return Record(record_id, where, condition, recorded, chosen, (*steps, *why), unread=unread, other_setup=other)


def _candidate(channel: TdmsChannel, said: Told) -> _Candidate:
    return _Candidate(channel, said, use_of(" ".join(channel.name.split()), text_of(said, "unit_string")))


def _may_be_one(one: _Candidate) -> bool:
    """Whether a channel that nothing is known of could be an acceleration."""
    unknown = one.use.role == "ignored" and not one.use.why and not text_of(one.said, "unit_string")
    return unknown and not why_no_acceleration(one.channel.name, "")


def _read(
    file: TdmsFile, found: Sequence[_Candidate], every: Sequence[_Candidate], where: str
) -> tuple[dict[str, RecordedChannel], dict[str, Problem], dict[str, float]]:
    """The channels by name, the problems of those that have no samples or no time, and when recording began, in s."""
    repeated = Counter(one.channel.name for one in found)
    clocks = [one for one in every if one.use.role == "time"][:_MOST_CLOCKS]
    times: dict[str, FloatArray] = {}
    channels: dict[str, RecordedChannel] = {}
    unread: dict[str, Problem] = {}
    began_s: dict[str, float] = {}
    for one in found:
        channel, start = one.channel, one.said.get("wf_start_time")
        name = channel.name if repeated[channel.name] == 1 else f"{channel.group}/{channel.name}"
        try:
            clock = None if number_of(one.said, "wf_increment") else _clock_of(one, clocks, file, times)
            read = waveform(file, channel, one.said, name, channel.name, where, clock)
        except DataError as error:
            unread[name] = error.problems[0]
            continue
        if clock is None and isinstance(start, float) and start > 0:  # 0 is not set
            began_s[name] = start
        unit = read.unit or unit_named(one.use.unit or "", "acceleration")
        channels[name] = replace(read, unit=unit, cutoff_hz=read.cutoff_hz or cutoff_of(channel.name))
        if sum(each.values.size for each in channels.values()) > _MOST_VALUES:
            expected = f"accelerations of at most {_MOST_VALUES:,} values in all"
            raise DataError(Problem(where, expected, "more", "choose the file of one test"))
    return channels, unread, began_s


def _aligned(
    channels: Mapping[str, RecordedChannel], began_s: Mapping[str, float], steps: list[str]
) -> dict[str, RecordedChannel]:
    """The channels in one time, from the first sample on: zeros of their own are those of several triggers."""
    late_s = {name: round(start_s - min(began_s.values()), 6) for name, start_s in began_s.items()}
    times = {name: channel.time_s + late_s.get(name, 0.0) for name, channel in channels.items()}
    first_s = min(float(time_s[0]) for time_s in times.values())
    late = ", ".join(f"{printable(name)} by {time_text(delay_s, 6)}" for name, delay_s in late_s.items() if delay_s)
    told = f"Aligned by the times at which recording began (wf_start_time): {late} later"
    steps.append(f"{told}; time counts from the first sample.")
    return {name: replace(channel, time_s=times[name] - first_s) for name, channel in channels.items()}


def _clock_of(
    one: _Candidate, clocks: Sequence[_Candidate], file: TdmsFile, times: dict[str, FloatArray]
) -> FloatArray | None:
    """Time in s from a channel of time of equal length, if any: of its group, and of a name that begins alike."""
    size = file.size(one.channel)
    alike = [clock for clock in clocks if file.size(clock.channel) == size >= 2]
    if not alike:
        return None

    def likeness(clock: _Candidate) -> tuple[bool, int]:
        pairs = zip(clock.channel.name.lower(), one.channel.name.lower(), strict=False)
        alike_at_first = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
        return clock.channel.group == one.channel.group, alike_at_first

    clock = max(alike, key=likeness)
    key = f"{clock.channel.group}/{clock.channel.name}"
    if key not in times:
        time = file.values(clock.channel)
        unit = clock.use.unit or ("s" if np.ptp(time) <= _LONGEST_S else "ms")
        times[key] = time * UNITS["time"][unit]
    return times[key]


def _proposed(
    channels: Mapping[str, RecordedChannel], found: int, what: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The channels to average, and sentences on why."""
    unit = "" if any(channel.unit for channel in channels.values()) else "; none states its unit"

    def at_best_place(names: Sequence[str]) -> tuple[tuple[str, ...], str]:
        codes = {name: code for name in names if (code := ChannelCode.parsed(channels[name].label)) is not None}
        chosen, why = proposed(codes)
        if chosen:
            return chosen, why
        if len(names) == 1 and len(channels) == found and what == "acceleration":
            return tuple(names), f"The only {what}{unit}: {printable(names[0])}."
        return (), f"Choose one of {len(channels)} {what}s{unit}."

    return proposal(channels, at_best_place)


def _condition(said: Told) -> tuple[PartialCondition, list[str]]:
    """The speed among the properties of the file (or of a group), and sentences on its origin."""
    steps = ["TDMS file."]
    for name, value in said.items():
        if (key := _SPEED.match(name)) is None:
            continue
        number, unit = (value, "") if isinstance(value, float) else number_and_unit(value) or (0.0, "")
        unit = unit or name[key.end() :].strip(" _-")
        named = unit_named(unit, "speed") if unit else "km/h"
        if number_in(number) and named:
            steps.append(f"Speed {number:g} {named} from the file's property {printable(name)}.")
            return PartialCondition(number * UNITS["speed"][named]), steps
    return PartialCondition(), steps
