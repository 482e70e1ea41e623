"""Reader of tests in TDMS: NHTSA's newer downloads, and any other file whose channels are accelerations.

NHTSA stores the content of its ASCII specification (:mod:`crashfuse.readers.nhtsa`) as properties of each channel:
``Inst_SenAtt`` FLLR, ``Inst_Axis`` XG, ``Veh_VehSpd``, ``Veh_VehTWt`` … in km/h and kg; sampling is in ``wf_increment``
and ``wf_start_offset``, and 0 is first contact. Axle weights are not included.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from crashfuse.errors import DataError, Problem, collecting, printable
from crashfuse.files.archive import Limits, Member, refuse
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.members import opened_members
from crashfuse.readers.nhtsa_sensors import (
    Sensor,
    nhtsa_record,
    number_in,
    of_first_vehicle,
    other_configuration,
    speed_step,
)
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel
from crashfuse.readers.tdms_container import TdmsChannel, TdmsFile, parse_tdms
from crashfuse.readers.unit_spelling import UNITS, unit_named
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import KPH

TDMS_LIMITS = Limits(total_bytes=8 << 30, member_bytes=256 << 20)
"""Size limits of a file; a test of 1000 channels of 10,000 samples has 80 MB."""

_TIME_NAMES = ("time", "zeit", "t")
_LONGEST_S = 2.0  # a time without a unit is in ms if it lasts longer
_ACCELERATION = re.compile(r"acc|beschl|puls|^a[ _-]?x", re.IGNORECASE)
_MOST_CHANNELS = 200  # per test, that could be its pulse

_Told = Mapping[str, str | float]


def read_tdms(path: Path, limits: Limits = TDMS_LIMITS) -> tuple[Record, ...]:
    """Read TDMS files (one, a folder or a zip of them), one record each.

    For an NHTSA test, the record has the vehicle's X accelerations and proposes those on the rear floor, else those at
    the centre of gravity; for another file, it has every acceleration, proposed if it is the only one.
    """
    kind = "a .tdms file, or a folder or zip of them"
    of_the_format = FORMATS["tdms"].has
    with opened_members(path, of_the_format, kind, limits) as (members, budget):
        if of_the_format(path):
            members = [member for member in members if member.path.as_posix() == path.name]
        if not members:
            raise DataError(Problem(path.name, kind, "none", "check the path"))
        records: list[Record] = []
        problems: list[Problem] = []
        for member in members:
            with collecting(problems):
                records.append(_record(parse_tdms(member.content(budget), member.where), member))
        refuse(problems, path.name)
    return tuple(records)


def _record(file: TdmsFile, member: Member) -> Record:
    where = member.where
    told = [(channel, file.told(channel)) for channel in file.channels]
    of_nhtsa = [(channel, said) for channel, said in told if "inst_sentyp" in said]
    if of_nhtsa:
        return _nhtsa_record(file, of_nhtsa, member)
    found = [(c, said) for c, said in told if unit_named(_text(said, "unit_string"), "acceleration")]
    what = "acceleration"
    if not found:
        found = [(c, said) for c, said in told if not _text(said, "unit_string") and not _is_time(c, said)]
        what = "channel"
    if not found:
        expected = "channels in a unit of acceleration (unit_string)"
        raise DataError(Problem(where, expected, f"none of {len(told)}", "export them with their units"))
    repeated = Counter(channel.name for channel, _ in found)
    channels: list[RecordedChannel] = []
    damaged: dict[str, Problem] = {}
    for channel, said in found[:_MOST_CHANNELS]:
        name = channel.name if repeated[channel.name] == 1 else f"{channel.group}/{channel.name}"
        try:
            clock = None if _number(said, "wf_increment") else _clock(file, channel, told)
            channels.append(_channel(file, channel, said, name, channel.name, where, clock))
        except DataError as error:
            damaged[name] = error.problems[0]
    if not channels:
        raise DataError(list(damaged.values()))
    only = len(found) == 1 and (what == "acceleration" or _ACCELERATION.search(channels[0].name) is not None)
    proposed = (channels[0].name,) if only else ()
    unit = "" if what == "acceleration" else "; none states its unit"
    why = f"The only {what}{unit}: {proposed[0]}." if proposed else f"Choose one of {len(channels)} {what}s{unit}."
    left_out = (f"Left out as damaged: {', '.join(map(printable, damaged))}.",) if damaged else ()
    steps = ("TDMS file.", *left_out, why)
    return Record(member.path.stem, where, PartialCondition(), tuple(channels), proposed, steps, unread=damaged)


def _is_time(channel: TdmsChannel, said: _Told) -> bool:
    unit = _text(said, "unit_string")
    return unit_named(unit, "time") is not None or (not unit and channel.name.strip().lower() in _TIME_NAMES)


def _clock(file: TdmsFile, channel: TdmsChannel, told: Sequence[tuple[TdmsChannel, _Told]]) -> FloatArray | None:
    """Time in s from the time channel that accompanies a channel; None if there is none of equal length."""
    values = file.values(channel)
    for beside, said in told:
        if beside.group == channel.group and _is_time(beside, said):
            time = file.values(beside)
            if time.size == values.size >= 2:
                unit = unit_named(_text(said, "unit_string"), "time") or ("s" if np.ptp(time) <= _LONGEST_S else "ms")
                return time * UNITS["time"][unit]
    return None


def _nhtsa_record(file: TdmsFile, told: Sequence[tuple[TdmsChannel, _Told]], member: Member) -> Record:
    where = member.where
    sensors = {_sensor(place, said): (channel, said) for place, (channel, said) in enumerate(told, start=1)}
    candidates = of_first_vehicle(list(sensors))[:_MOST_CHANNELS]
    if not candidates:
        found = f"none in {len(told)} channels"
        raise DataError(Problem(where, "X accelerations of the vehicle", found, "download all channels of the test"))

    def read(sensor: Sensor) -> RecordedChannel:
        channel, said = sensors[sensor]
        label = f"{sensor.comment or channel.name}{', redundant' if sensor.redundant else ''}"
        return _channel(file, channel, said, str(sensor.number), label, where)

    test = sensors[candidates[0]][1]
    other = other_configuration(_text(test, "test_tstcfn"), _number(test, "test_impang"))
    readers = {one: partial(read, one) for one in candidates}
    return nhtsa_record(member.path.stem, where, readers, _condition(test, where), other)


def _sensor(place: int, said: _Told) -> Sensor:
    """A channel's properties as a sensor, as if from a line of the ASCII specification."""
    return Sensor(
        vehicle=_text(said, "veh_vehno") or "1",
        number=int(_number(said, "inst_curno")) or place,
        sensor=_text(said, "inst_sentyp").upper(),
        occupant=_text(said, "inst_senloc").upper(),
        attachment=_text(said, "inst_senatt").upper(),
        axis=_text(said, "inst_axis").upper(),
        unit=_text(said, "unit_string") or _text(said, "inst_yunits"),
        cutoff_hz=_number(said, "inst_prefil") or None,
        status=_text(said, "inst_dastat").upper(),
        redundant=_text(said, "inst_chstat").upper() == "R",
        comment=printable(_text(said, "inst_inscom")),
    )


def _channel(
    file: TdmsFile,
    channel: TdmsChannel,
    said: _Told,
    name: str,
    label: str,
    where: str,
    clock: FloatArray | None = None,
) -> RecordedChannel:
    """A channel with its own even time, else with that of the accompanying time channel."""
    increment, start = _number(said, "wf_increment"), said.get("wf_start_offset", 0.0)
    values = file.values(channel)
    if increment > 0 and isinstance(start, float) and values.size >= 2:
        unit_s = UNITS["time"][unit_named(_text(said, "wf_xunit_string"), "time") or "s"]
        clock = unit_s * (start + increment * np.arange(values.size))
    if clock is None:
        expected, found = "samples and the time between them (wf_increment)", f"{values.size} samples without it"
        advice = "export it as a waveform, or with a channel of time beside it"
        raise DataError(Problem(f"{where}: {printable(channel.name)}", expected, found, advice))
    unit = unit_named(_text(said, "unit_string") or _text(said, "inst_yunits"), "acceleration")
    return RecordedChannel(name, printable(label), clock, values, unit, _number(said, "inst_prefil") or None)


def _condition(said: _Told, where: str) -> tuple[PartialCondition, tuple[str, ...]]:
    speed, mass = _number(said, "veh_vehspd") or _number(said, "test_clsspd"), _number(said, "veh_vehtwt")
    car = " ".join(filter(None, (_text(said, name) for name in ("veh_year", "veh_maked", "veh_modeld"))))
    steps = [f"NHTSA test {_text(said, 'test_tstno')}, {printable(car)}."]
    steps.append(speed_step(speed, where))
    if mass:
        steps.append(f"Weight {mass:g} kg from {where}, which does not say what each axle carried.")
    return PartialCondition(speed * KPH or None, mass or None), tuple(steps)


def _text(said: _Told, name: str) -> str:
    value = said.get(name, "")
    return value.strip() if isinstance(value, str) else f"{value:g}"


def _number(said: _Told, name: str) -> float:
    return number_in(said.get(name, 0.0))
