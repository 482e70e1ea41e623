"""ISO-MME, the exchange format of crash laboratories (ISO/TS 13499): its tests, and their reader, folder or zip.

::

    T1/T1.mme             descriptors of the test, one per line: ``Name of the descriptor      :value``
    T1/Channel/T1.chn     the list of channels: ``Name of channel 001         :10VEHC000000ACXD / Vehicle X``
    T1/Channel/T1.001     a channel: its descriptors in the same form, then one sample per line

Time is implicit (``Time of first sample`` and ``Sampling interval``, s), or a channel that others name as their
reference. Sources are those of :mod:`crashfuse.readers.vocabulary`.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePath, PurePosixPath

import numpy as np

from crashfuse.errors import DataError, Problem, collecting, printable, refusal, refuse_all, refuse_if
from crashfuse.files.archive import Budget, Limits, Member
from crashfuse.readers import vocabulary
from crashfuse.readers.members import ONE_TEST, as_text, is_numbered, opened_members
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel, proposal, read_sound, summed_wall
from crashfuse.readers.vocabulary import ISOMME, UNITS, UNPLACED, ChannelCode, Doubt
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import Sentence

NO_VALUE = "NOVALUE"  # the format's marker for an unknown value

Pairs = Sequence[tuple[str, str]]  # descriptors as name and value pairs

_MOST_LINES = 2_000_000  # per file: 100 s at 20 kHz
_MOST_DESCRIPTORS = 10_000
_UNEVEN = 0.02  # of a step, in a time channel

ISOMME_LIMITS = Limits(total_bytes=256 << 20, member_bytes=64 << 20)  # beyond 300 channels of 60,000 samples
_AGAIN, _CORRECT, _STEP = "export it again", "correct the header", "Sampling interval"


@dataclass(frozen=True, eq=False)
class Channel:
    """A recorded or computed signal, in the words of the file; what is unknown is empty or None."""

    code: str
    name: str
    unit: str  # in ISO-MME's spelling: m/(s*s)
    values: FloatArray  # NaN where a sample has no value
    interval_s: float | None  # None if the file gives no even time
    start_s: float | None = 0.0
    comments: tuple[str, ...] = ()
    source: str = ""  # transducer, calculation, camera, simulation or parameter
    filter_class: str = ""  # as a number: 60
    status: str = ""  # ok, channel failed, questionable data …
    sensor: str = ""
    prefilter: str = ""

    @property
    def remark(self) -> str:
        """The comment that speaks most against it."""
        return max(self.comments, key=vocabulary.doubt_in, default="")

    @property
    def time_s(self) -> FloatArray | None:
        """The time of each sample; None without an even time, or samples."""
        if self.interval_s is None or self.values.size < 2:
            return None
        return (self.start_s or 0.0) + self.interval_s * np.arange(self.values.size)


@dataclass(frozen=True, eq=False)
class IsommeTest:
    """One test: its channels, and in order the descriptors of its ``.mme`` file that have a value."""

    name: str
    descriptors: Pairs
    channels: tuple[Channel, ...]

    def descriptor(self, name: str) -> str:
        """The value of the first descriptor with this name (case ignored); empty if there is none."""
        return _first_of(self.descriptors, name)


def _first_of(pairs: Pairs, name: str) -> str:
    return next((value for key, value in pairs if key.lower() == name.lower()), "")


def read_isomme(path: Path, limits: Limits = ISOMME_LIMITS) -> IsommeTest:
    """Read one ISO-MME test: its folder, its ``.mme`` file or a zip. A failed channel may have no samples."""

    def is_text(file: PurePath) -> bool:
        return file.suffix.lower() in (".mme", ".chn") or is_numbered(file)

    with opened_members(path, is_text, "an ISO-MME test (.mme)", limits) as (members, budget):
        if path.suffix.lower() == ".mme" and path.is_file():
            members = [m for m in members if m.path.suffix.lower() != ".mme" or m.path == PurePosixPath(path.name)]
        return _read(members, path.name, budget)


def _read(members: Sequence[Member], name: str, budget: Budget) -> IsommeTest:
    headers = [member for member in members if member.path.suffix.lower() == ".mme"]
    refuse_if(len(headers) != 1, name, "one .mme file", f"{len(headers)} of them" if headers else "none", ONE_TEST)
    home = headers[0].path.parent
    folders = {folder for member in members if (folder := member.path.parent).name.lower() == "channel"}
    homes = {home, *(folder for folder in folders if folder.parent == home)}
    near = [member for member in members if member.path.parent in homes]
    lists = [member for member in near if member.path.suffix.lower() == ".chn"]
    listed = [pair for member in lists for pair in _descriptors(_lines_in(member, budget), member.where)]
    problems, clocks = list[Problem](), dict[str, Channel]()
    channels: list[tuple[Channel, str | None]] = []
    numbered = [member for member in near if is_numbered(member.path)]
    for member in sorted(numbered, key=lambda member: int(member.path.suffix[1:])):
        with collecting(problems):
            channel, clock = _channel(member, listed, budget)
            channels.append((channel, clock))
            clocks |= {name: channel for name in (member.path.suffix[1:], channel.name, channel.code) if name}
    refuse_all(problems, name)
    refuse_if(not channels, name, "channel files (.001 …)", "none", "export them too")
    timed = tuple(_timed(channel, clocks.get(reference or "")) for channel, reference in channels)
    descriptors = _descriptors(_lines_in(headers[0], budget), headers[0].where)
    return IsommeTest(headers[0].path.stem, tuple(descriptors), timed)


def _channel(member: Member, listed: Pairs, budget: Budget) -> tuple[Channel, str | None]:
    lines, where = _lines_in(member, budget), member.where
    end = next((row for row, line in enumerate(lines) if line.strip() and ":" not in line), len(lines))
    header = _descriptors(lines[:end], where)
    status = _first_of(header, "Data status")
    comments = tuple(value for name, value in header if name.lower() in ("comments", "comment", "remarks", "remark"))
    doubts = vocabulary.doubt_of(status), *map(vocabulary.doubt_in, comments)
    values: FloatArray = np.empty(0)
    with suppress(DataError) if Doubt.FAILED in doubts else nullcontext():
        samples, count = _numbers(lines[end:], where), _number_in(header, "Number of samples", where)
        is_other = count not in (None, samples.size)
        refuse_if(is_other, where, f"{count or 0:g} samples, as stated", f"{samples.size}", _AGAIN)
        values = samples
    interval = _seconds_in(header, _STEP, where)
    is_wrong = interval is not None and interval <= 0
    refuse_if(is_wrong, where, "a number above 0", f"{interval or 0:g}", _CORRECT, _STEP)
    code, _, name = _first_of(listed, f"Name of channel {member.path.suffix[1:]}").partition("/")
    channel = Channel(
        code=_first_of(header, "Channel code") or code.strip(),
        name=_first_of(header, "Name of the channel") or name.strip(),
        unit=_first_of(header, "Unit"),
        values=values,
        interval_s=interval,
        start_s=_seconds_in(header, "Time of first sample", where),
        comments=comments,
        source=_first_of(header, "Data source"),
        status=status,
        sensor=" ".join(filter(None, (_first_of(header, f"Transducer {what}") for what in ("type", "id")))),
        prefilter=" ".join(filter(None, (_first_of(header, of) for of in ("Pre-filter type", "Cut off frequency")))),
    )
    implicit = _first_of(header, "Reference channel").lower() == "implicit"
    return channel, None if implicit else _first_of(header, "Reference channel name")


def _timed(channel: Channel, clock: Channel | None) -> Channel:
    if clock is None or clock.values.shape != channel.values.shape or clock.values.size < 2:
        return channel
    time_s = clock.values * UNITS["time"][vocabulary.unit_named(clock.unit, "time") or "s"]
    mean = float(np.diff(time_s).mean())
    if not (mean > 0 and np.abs(np.diff(time_s) - mean).max() <= _UNEVEN * mean):
        return replace(channel, interval_s=None)
    return replace(channel, interval_s=mean, start_s=float(time_s[0]))


def _lines_in(member: Member, budget: Budget) -> list[str]:
    text = as_text(member.content(budget)).replace("\r\n", "\n").replace("\r", "\n")
    refuse_if(text.count("\n") > _MOST_LINES, member.where, f"at most {_MOST_LINES} lines", "more", "export fewer")
    return text.split("\n")  # splitlines() would also split at the … of Windows-1252 read as Latin-1


def _descriptors(lines: list[str], where: str) -> list[tuple[str, str]]:
    refuse_if(len(lines) > _MOST_DESCRIPTORS, where, f"at most {_MOST_DESCRIPTORS} descriptors", "more", _AGAIN)
    parts = [line.partition(":") for line in lines if ":" in line]
    refuse_if(not parts, where, "lines of the form Name :value", "none", _AGAIN)
    pairs = [(name.strip(), value.strip()) for name, _, value in parts]
    return [(name, value) for name, value in pairs if value.upper() not in ("", NO_VALUE)]


def _numbers(lines: Iterable[str], where: str) -> FloatArray:
    cells = (cell for line in lines if (cell := line.strip()))
    try:
        values = np.array([np.nan if cell.upper() == NO_VALUE else float(cell) for cell in cells], dtype=np.float64)
        found = "an infinite one" if np.isinf(values).any() else ""
    except ValueError as error:
        found = printable(str(error).rpartition(":")[2].strip())
    refuse_if(found, where, "one number a line", found, _AGAIN)
    return values


def _number_in(header: Pairs, name: str, where: str) -> float | None:
    if not (text := _first_of(header, name)):
        return None
    try:
        value = float(text.split()[0])  # "0.0001 s" occurs in practice
    except ValueError:
        value = np.nan
    refuse_if(not np.isfinite(value), where, "a number", printable(text), _CORRECT, name)
    return value


def _seconds_in(header: Pairs, name: str, where: str) -> float | None:
    value = _number_in(header, name, where)
    unit = _first_of(header, name).split()[1:]
    if value is None or not unit:
        return value
    named = vocabulary.unit_named(unit[0], "time") or ""
    refuse_if(not named, where, "a time in s or ms", printable(unit[0]), _CORRECT, name)
    return value * UNITS["time"][named]


def read_isomme_record(path: Path, limits: Limits = ISOMME_LIMITS) -> tuple[Record]:
    """Read one ISO-MME test as a record."""
    return (record_of(read_isomme(path, limits), path.name),)


def record_of(test: IsommeTest, source: str) -> Record:
    """The record of a test, its channels best placed and least filtered first."""
    coded = [(code, channel) for channel in test.channels if (code := ChannelCode.parsed(channel.code))]
    along_x = [(code, channel) for code, channel in coded if code.is_acceleration and code.is_along_x]
    on_vehicles = [pair for pair in along_x if pair[0].text[0].isdigit() and not pair[0].is_of_a_dummy]
    none = f"none in {len(test.channels)} channels"
    refuse_if(not on_vehicles, source, "an X acceleration of the vehicle", none, "export it too")
    objects = {code.text[0] for code, _ in on_vehicles}
    vehicle = min({code.text[0] for code, _ in on_vehicles if code.rank < UNPLACED} or objects)
    named = _named([(code, channel) for code, channel in on_vehicles if code.text[0] == vehicle])
    texts = [test.descriptor(name) for name in ISOMME["kind"]]
    values = (value for _, value in test.descriptors)
    origin = next(filter(vocabulary.is_simulated, texts), "") or vocabulary.statement_of_simulation(values)
    read = {name: partial(_recorded, name, *of, f"{source}, {name}", origin) for name, of in named.items()}
    recorded, untimed = read_sound(read)
    refuse_all([] if recorded else [*untimed.values()], source)
    chosen, why = proposal(recorded, lambda names: vocabulary.propose_by_code({name: named[name][0] for name in names}))
    condition, steps = _condition(test, vehicle)
    if objects != {"1"}:
        others = " and ".join(sorted(objects - {vehicle}))
        left_out = f"; those of test object {others} are left out" if others else ""
        steps.append(f"Channels, speed and weights of test object {vehicle}{left_out}.")
    if untimed:
        steps.append(f"Left out for lack of an even time: {', '.join(untimed)}.")
    zero = "0 is time zero, by the format's definition"
    if any(named[name][1].start_s is None for name in chosen or recorded):
        steps.append("No time of the first sample; find time zero.")
        zero = ""
    side = test.descriptor(f"Impact side test object {vehicle}")
    is_other = side.upper() in ISOMME["other_side"]
    other = vocabulary.other_setup(texts) or (f"impact side {printable(side)}" if is_other else "")
    about = {name: test.descriptor(descriptor) for name, descriptor in ISOMME["about"].items()}
    barrier = (one for one in test.channels if one.code[:1].upper() == "B")  # its test object
    codes = ((ChannelCode.parsed(f"0{one.code[1:]}"), one) for one in barrier)
    cells = [(code, one) for code, one in codes if code and code.text[12:14] == "FO" and code.is_along_x]
    rawest = {pair[0].sensor: pair for pair in sorted(cells, key=lambda pair: pair[0].order, reverse=True)}
    steps += why
    wall = summed_wall([(_force(one), code.sums) for code, one in rawest.values()], steps)
    found = test.name, source, condition, tuple(recorded.values()), chosen, tuple(steps), zero
    return Record(*found, unread=untimed, other_setup=other, about=about, wall=wall)


def _recorded(name: str, code: ChannelCode, channel: Channel, where: str, origin: str) -> RecordedChannel:
    if (time_s := channel.time_s) is None:
        raise refusal(where, "an even time", "none such", "export its sampling interval")
    label, unit = printable(channel.name or name), vocabulary.unit_named(channel.unit, "acceleration")
    status, origin = code.status(channel.status), channel.source or origin
    words = "the file", origin, status, channel.sensor, channel.prefilter, channel.remark
    return RecordedChannel(name, label, time_s, channel.values, unit, code.cutoff_hz, *words)


def _force(cell: Channel) -> tuple[FloatArray, FloatArray] | None:
    factor, time_s = {"n": 1.0, "kn": 1e3}.get(cell.unit.strip().lower()), cell.time_s
    doubt = max(vocabulary.doubt_of(cell.status), vocabulary.doubt_in(cell.remark), vocabulary.doubt_in(cell.name))
    is_sound = doubt < Doubt.FAILED and np.isfinite(cell.values).all()
    return (time_s, factor * cell.values) if factor and time_s is not None and is_sound else None


def _named(channels: Sequence[tuple[ChannelCode, Channel]]) -> dict[str, tuple[ChannelCode, Channel]]:
    ordered = sorted(channels, key=lambda pair: pair[0].order)
    times, seen = Counter(channel.code for _, channel in channels), Counter[str]()
    named = {}
    for code, channel in ordered:
        seen[channel.code] += 1
        named[channel.code if times[channel.code] == 1 else f"{channel.code}#{seen[channel.code]}"] = code, channel
    return named


def _condition(test: IsommeTest, vehicle: str) -> tuple[PartialCondition, list[str]]:
    its = f"test object {vehicle}"
    names = ("Mass", ".Front weight", ".Rear weight")
    speed_mps = _quantity(test, (f"Velocity {its}", f"Velocity {its} lon."), "speed", "m/s")
    mass, front, rear = (_quantity(test, (f"{name} {its}",), "mass", "kg") for name in names)
    notes = [f"ISO-MME test, {printable(test.descriptor('Title') or test.name)}."]
    if kind := test.descriptor("Type of the test"):
        notes.append(f"Type of the test: {printable(kind)}.")
    told = Sentence("Speed {} from the .mme file.", vocabulary.speed(speed_mps or 0.0, form=".4g"))
    notes.append(told if speed_mps else f"No speed of {its} in the .mme file.")
    if front and rear:
        weights = vocabulary.weight(front), vocabulary.weight(rear)
        notes.append(Sentence("Front weight {} and rear weight {} from the .mme file.", *weights))
    elif mass:
        notes.append(Sentence("Mass {} from the .mme file, without axle weights.", vocabulary.weight(mass)))
    return PartialCondition(speed_mps, mass, front, rear), notes


def _quantity(test: IsommeTest, names: Sequence[str], quantity: str, default: str) -> float | None:
    text = next((value for name in names if (value := test.descriptor(name))), "")
    number, unit = vocabulary.number_and_unit(text) or (0.0, "")
    named = vocabulary.unit_named(unit, quantity) if unit else default
    return number * UNITS[quantity][named] if named and 0 < number < np.inf else None
