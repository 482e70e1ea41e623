"""Reader of tests in TDMS: NHTSA's newer downloads, and those of any other laboratory.

NHTSA stores its ASCII specification (:mod:`crashfuse.readers.nhtsa`) as properties of each channel: ``Inst_SenAtt``
FLLR, ``Veh_VehSpd`` …; 0 is first contact, and axle weights are not included.

Of other laboratories, the vehicle's accelerations are found by names and units, as columns of a table are: the IIHS
names channels by codes of ISO-MME, or in words (``IIWPG Acceleration (g)``, with a channel ``IIWPG Time (sec)``).
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crashfuse.errors import CHECK_PATH, printable, refusal, refuse_all, refuse_if
from crashfuse.files.archive import Budget, Limits, Member
from crashfuse.readers import nhtsa, vocabulary
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.members import ONE_TEST, opened_members, read_all
from crashfuse.readers.nhtsa import Sensor
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel, proposal, read_sound
from crashfuse.readers.table_headers import OF_A_DUMMY, OTHER_DIRECTION, ColumnUse, Heading
from crashfuse.readers.tdms_container import Properties, TdmsChannel, TdmsFile, parse_tdms
from crashfuse.readers.vocabulary import NHTSA, PROPERTIES, UNITS, UNPLACED, ChannelCode
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import KPH, time_text

_ABOUT = {name: PROPERTIES[name] for name in ("laboratory", "test_number", "date")}
_SENSOR, _COMMENTS = (PROPERTIES[name].split(", ") for name in ("sensor", "comment"))
_MOST_CHANNELS = 200  # of a test that could be its pulse
_ONE_CRASH_S = 10.0  # between loggers
_LONGEST_S = 2.0  # a time without a unit is in ms if it lasts longer
_MOST_VALUES = 20_000_000  # in all of them
_MOST_CLOCKS = 1000

TDMS_LIMITS = Limits(total_bytes=8 << 30, member_bytes=256 << 20)  # 1000 channels of 10,000 samples have 80 MB


def _text_of(properties: Properties, *names: str) -> str:
    values = (properties.get(name, "") for name in names)
    texts = (value.strip() if isinstance(value, str) else f"{value:g}" for value in values)
    return next(filter(None, texts), "")


def _number_of(properties: Properties, name: str) -> float:
    return nhtsa.number_in(properties.get(name, 0.0))


def _waveform(
    file: TdmsFile, channel: TdmsChannel, name: str, label: str, where: str, clock: FloatArray | None = None
) -> RecordedChannel:
    properties = file.properties_of(channel)
    increment, start = _number_of(properties, "wf_increment"), properties.get("wf_start_offset", 0.0)
    values = file.values(channel)
    if increment > 0 and isinstance(start, float) and values.size >= 2:
        unit_s = UNITS["time"][vocabulary.unit_named(_text_of(properties, "wf_xunit_string"), "time") or "s"]
        clock = unit_s * (start + increment * np.arange(values.size))
    if clock is None or clock.size != values.size:
        place, found = f"{where}: {printable(channel.name)}", f"{values.size} samples"
        raise refusal(place, "samples and their time (wf_increment)", found, "add a channel of time")
    unit = vocabulary.unit_named(_text_of(properties, "unit_string", "inst_yunits"), "acceleration")
    cutoff_hz = _number_of(properties, "inst_prefil") or None
    # descriptors of ISO-MME, which programs that convert it keep as properties, blanks or not
    origin, status = (_text_of(properties, f"data {of}", f"data_{of}") for of in ("source", "status"))
    origin = origin or (channel.group if vocabulary.is_simulated(channel.group) else "")
    code = ChannelCode.parsed(label)
    status = status if code is None else code.status(status)
    comment = max((_text_of(properties, key) for key in _COMMENTS), key=vocabulary.doubt_in)
    told = "the file", origin, status, _text_of(properties, *_SENSOR), "", comment
    return RecordedChannel(name, printable(label), clock, values, unit, cutoff_hz, *told)


_Named = Mapping[str, RecordedChannel]


class _Candidate(NamedTuple):
    channel: TdmsChannel
    properties: Properties
    use: ColumnUse


def _laboratory_record(file: TdmsFile, record_id: str, where: str) -> Record:
    every = []
    for channel in file.channels:
        properties = file.properties_of(channel)
        use = Heading(" ".join(channel.name.split()), _text_of(properties, "unit_string")).use
        every.append(_Candidate(channel, properties, use))
    found, what = [one for one in every if one.use.role == "acceleration"], "acceleration"
    if not found:
        unknown = [one for one in every if one.use.is_unknown and not _text_of(one.properties, "unit_string")]
        found, what = [one for one in unknown if not Heading(one.channel.name).why_no_acceleration], "channel"
    refuse_if(not found, where, "accelerations along X (unit_string)", f"none of {len(every)}", "export units")
    found = sorted(found, key=lambda one: Heading(one.channel.name).likelihood)
    repeated = Counter(one.channel.name for one in found[:_MOST_CHANNELS])
    named = {f"{one.channel.group}/{one.channel.name}": one for one in found[:_MOST_CHANNELS]}
    named = {of.channel.name if repeated[of.channel.name] == 1 else name: of for name, of in named.items()}
    is_large = sum(file.size(one.channel) for one in named.values()) > _MOST_VALUES
    refuse_if(is_large, where, f"at most {_MOST_VALUES:,} values in all", "more", ONE_TEST)
    clocks, times = [one for one in every if one.use.role == "time"][:_MOST_CLOCKS], dict[str, FloatArray]()

    def read(name: str) -> RecordedChannel:
        one = named[name]
        has_wave = _number_of(one.properties, "wf_increment")
        clock = None if has_wave else _clock_of(one, clocks, file, times)
        channel = _waveform(file, one.channel, name, one.channel.name, where, clock)
        unit = channel.unit or vocabulary.unit_named(one.use.unit or "", "acceleration")
        return replace(channel, unit=unit, cutoff_hz=channel.cutoff_hz or Heading(one.channel.name).cutoff_hz)

    channels, unread = read_sound({name: partial(read, name) for name in named})
    refuse_all([] if channels else [*unread.values()], where)
    groups, began_s = {name: one.channel.group for name, one in named.items()}, dict[str, float]()
    for name in channels:
        start = named[name].properties.get("wf_start_time")
        if _number_of(named[name].properties, "wf_increment") and isinstance(start, float) and start > 0:  # 0: not set
            began_s[name] = start
    tests = _groups_alike(channels, groups, began_s)
    condition, steps = _laboratory_condition(found[0].properties)
    speeds = {_laboratory_condition(one.properties)[0].speed_mps for one in found if one.channel.group in tests}
    if len(speeds) > 1:
        condition, steps = PartialCondition(), ["TDMS file; its groups differ in speed."]
    for part in [{test} for test in tests] or [{*groups.values()}]:
        began = {name: start_s for name, start_s in began_s.items() if groups[name] in part}
        if len(set(began.values())) > 1:
            channels |= _aligned({name: one for name, one in channels.items() if groups[name] in part}, began, steps)
    if others := sum(one.use.why in (OF_A_DUMMY, OTHER_DIRECTION) for one in every):
        steps.append(f"Left out: dummies, and other directions ({others}).")
    if unread:
        steps.append(f"Left out for lack of samples or times: {', '.join(map(printable, unread))}.")
    chosen, why = _proposed(channels, len(found), what, tests)
    if tests:
        channels = {name: replace(one, label=f"group {groups[name]}") for name, one in channels.items()}
    if chosen and (unused := {*groups.values()} - {groups[name] for name in chosen}):
        steps.append(f"Left out: accelerations of other groups: {', '.join(map(printable, sorted(unused)))}.")
    texts = ((name, text) for name, text in file.properties.items() if isinstance(text, str))
    about = [text for name, text in texts if re.search(PROPERTIES["test"], name)]
    pairs = ((name, key) for name, words in _ABOUT.items() for key in file.properties if re.fullmatch(words, key))
    pedigree = {name: text for name, key in pairs if (text := _text_of(file.properties, key))}
    content = record_id, where, condition, tuple(channels.values()), chosen, (*steps, *why)
    return Record(*content, unread=unread, other_setup=vocabulary.other_setup(about), about=pedigree)


def _groups_alike(channels: _Named, groups: Mapping[str, str], began_s: Mapping[str, float]) -> list[str]:
    """Those with one sensor of a vehicle, as of several tests."""
    of_sensor = dict[str, dict[str, float]]()
    for name, channel in channels.items():
        code = ChannelCode.parsed(channel.label)
        is_placed = code is not None and code.rank < UNPLACED
        if code and is_placed and not channel.is_simulated and not re.search(PROPERTIES["processed"], groups[name]):
            of_sensor.setdefault(code.sensor, {})[groups[name]] = began_s.get(name, np.nan)
    alike = (times for times in of_sensor.values() if not np.ptp([*times.values()]) < _ONE_CRASH_S)
    return sorted({group for times in alike if len(times) > 1 for group in times})


def _aligned(channels: _Named, began_s: Mapping[str, float], steps: list[str]) -> dict[str, RecordedChannel]:
    late_s = {name: round(start_s - min(began_s.values()), 6) for name, start_s in began_s.items()}
    times = {name: channel.time_s + late_s.get(name, 0.0) for name, channel in channels.items()}
    first_s = min(float(time_s[0]) for time_s in times.values())
    late = ", ".join(f"{printable(name)} by {time_text(delay_s, 6)}" for name, delay_s in late_s.items() if delay_s)
    steps.append(f"Aligned by wf_start_time, time 0 at the first sample: {late} later.")
    return {name: replace(channel, time_s=times[name] - first_s) for name, channel in channels.items()}


def _clock_of(
    one: _Candidate, clocks: Sequence[_Candidate], file: TdmsFile, times: dict[str, FloatArray]
) -> FloatArray | None:
    size = file.size(one.channel)
    alike = [clock for clock in clocks if file.size(clock.channel) == size >= 2]
    if not alike:
        return None

    def likeness(clock: _Candidate) -> tuple[bool, int]:
        pairs = zip(clock.channel.name.lower(), one.channel.name.lower(), strict=False)
        n_alike = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
        return clock.channel.group == one.channel.group, n_alike

    clock = max(alike, key=likeness)
    key = f"{clock.channel.group}/{clock.channel.name}"
    if key not in times:
        time = file.values(clock.channel)
        times[key] = time * UNITS["time"][clock.use.unit or ("s" if np.ptp(time) <= _LONGEST_S else "ms")]
    return times[key]


def _proposed(channels: _Named, n: int, what: str, tests: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    unit = "" if any(channel.unit for channel in channels.values()) else "; none states its unit"

    def at_best_place(names: Sequence[str]) -> tuple[tuple[str, ...], str]:
        codes = {name: code for name in names if (code := ChannelCode.parsed(channels[name].label)) is not None}
        if tests:
            named = ", ".join(map(printable, tests))
            return (), f"The same channels are in several groups, {named}: choose those of one."
        objects = {code.text[0] for code in codes.values() if code.rank < UNPLACED}
        vehicle = min(objects, default="")
        own = {name: code for name, code in codes.items() if code.text[0] == vehicle}
        chosen, why = vocabulary.propose_by_code(own or codes)
        if chosen:
            others = f" Those of test object {' and '.join(sorted(objects - {vehicle}))} are left out."
            return chosen, f"{why}{others if len(objects) > 1 else ''}"
        if len(names) == 1 and len(channels) == n and what == "acceleration":
            return tuple(names), f"The only {what}{unit}: {printable(names[0])}."
        return (), f"Choose one of {len(channels)} {what}s{unit}."

    return proposal(channels, at_best_place)


def _laboratory_condition(properties: Properties) -> tuple[PartialCondition, list[str]]:
    steps = ["TDMS file."]
    for name, value in properties.items():
        if (key := re.match(PROPERTIES["speed"], name)) is None:
            continue
        number, unit = (value, "") if isinstance(value, float) else vocabulary.number_and_unit(value) or (0.0, "")
        unit = unit or name[key.end() :].strip(" _-")
        named = vocabulary.unit_named(unit, "speed") if unit else "km/h"
        if nhtsa.number_in(number) and named:
            steps.append(f"Speed {number:g} {named} from the file's property {printable(name)}.")
            return PartialCondition(number * UNITS["speed"][named]), steps
    return PartialCondition(), steps


def read_tdms(path: Path, limits: Limits = TDMS_LIMITS) -> tuple[Record, ...]:
    """Read TDMS files (one, a folder or a zip of them), one record each."""
    kind, of_the_format = ".tdms files", FORMATS["tdms"].has
    with opened_members(path, of_the_format, kind, limits) as (members, budget):
        if of_the_format(path):
            members = [member for member in members if member.path.as_posix() == path.name]
        refuse_if(not members, path.name, kind, "none", CHECK_PATH)
        return read_all(members, lambda member: _record(member, budget), path.name)


def _record(member: Member, budget: Budget) -> Record:
    file = parse_tdms(member.content(budget), member.where)
    pairs = [(channel, file.properties_of(channel)) for channel in file.channels]
    of_nhtsa = [(channel, properties) for channel, properties in pairs if "inst_sentyp" in properties]
    if of_nhtsa:
        return _nhtsa_record(file, of_nhtsa, member.path.stem, member.where)
    return _laboratory_record(file, member.path.stem, member.where)


def _nhtsa_record(file: TdmsFile, pairs: Sequence[tuple[TdmsChannel, Properties]], stem: str, where: str) -> Record:
    sensors = {_sensor(place, pair[1]): pair for place, pair in enumerate(pairs, start=1)}
    candidates = nhtsa.of_first_vehicle(list(sensors))[:_MOST_CHANNELS]
    refuse_if(not candidates, where, nhtsa.LACKING[0], f"none in {len(pairs)} channels", nhtsa.LACKING[1])

    def read(sensor: Sensor) -> RecordedChannel:
        channel, _ = sensors[sensor]
        label = f"{sensor.comment or channel.name}{', redundant' if sensor.redundant else ''}"
        return _waveform(file, channel, str(sensor.number), label, where)

    tests = sorted({_text_of(properties, "test_tstno") for _, properties in pairs})
    refuse_if(len(tests) > 1, where, "one test", f"{printable(', '.join(tests))}", ONE_TEST)
    test = sensors[candidates[0]][1]
    speed = _number_of(test, "veh_vehspd") or _number_of(test, "test_clsspd")
    mass = _number_of(test, "veh_vehtwt")
    car = " ".join(filter(None, (_text_of(test, f"veh_{name}") for name in ("year", "maked", "modeld"))))
    title = f"NHTSA test {_text_of(test, 'test_tstno')}, {printable(car)}."
    steps = [title, *nhtsa.condition_steps(speed, mass, where), *nhtsa.other_vehicles(list(sensors))]
    condition = PartialCondition(speed * KPH or None, mass or None)
    other = nhtsa.other_configuration(_text_of(test, "test_tstcfn"), _number_of(test, "test_impang"))
    readers = {one: partial(read, one) for one in candidates}
    about = {name: _text_of(test, f"test_{key}") for name, key in NHTSA["property"]["about"].items()}
    return nhtsa.nhtsa_record(stem, where, readers, condition, steps, other, about)


def _sensor(place: int, properties: Properties) -> Sensor:
    texts = {name: _text_of(properties, f"inst_{of}") for name, of in NHTSA["property"]["sensor"].items()}
    texts |= {"vehicle": _text_of(properties, "veh_vehno") or "1", "comment": printable(texts["comment"])}
    return Sensor.of(int(_number_of(properties, "inst_curno")) or place, texts)
