"""An ISO-MME test as a record: its condition, and the channels that could be the pulse."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import Limits
from crashfuse.readers.isomme import ISOMME_LIMITS, read_isomme
from crashfuse.readers.isomme_channels import Channel, IsommeTest
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel
from crashfuse.readers.unit_spelling import UNITS, number_and_unit, unit_named

_DUMMY = frozenset(
    ["HEAD", "NECK", "CHST", "THSP", "SPIN", "PELV", "FEMR", "TIBI", "FOOT", "ABDO", "SHLD", "KNEE", "RIBS", "ACTB"]
)
_PLACES = (
    (("VEHC", "CVEH"), "of the vehicle as a whole"),
    (("TUNN",), "on the tunnel"),
    (("SIME", "SILL"), "on the sills"),
    (("BPIL",), "on the B-pillars"),
)
_OWN = frozenset(code for codes, _ in _PLACES for code in codes)
_CUTOFF_HZ = {"A": 1650.0, "B": 1000.0, "C": 300.0, "D": 100.0}  # of CFC 1000, 600, 180, 60 (SAE J211-1)
_RAW_FIRST = "0PXSABCD"


def read_isomme_record(path: Path, limits: Limits = ISOMME_LIMITS) -> tuple[Record]:
    """Read one ISO-MME test as a record: its folder, its ``.mme`` file, or a zip.

    The vehicle's own X acceleration is proposed, else that of tunnel, sills or B-pillars, both sides averaged.
    """
    return (record_of(read_isomme(path, limits), path.name),)


def record_of(test: IsommeTest, source: str) -> Record:
    """The record of a test with the channels that could be the pulse; at each location, the least filtered first."""
    on_vehicles = [channel for channel in test.channels if _on_a_vehicle(channel)]
    if not on_vehicles:
        expected = "an X acceleration of the vehicle (a code such as 10VEHC000000ACXD)"
        raise DataError(Problem(source, expected, f"none in {len(test.channels)} channels", "export it too"))
    own = {channel.code[0] for channel in on_vehicles if _place(channel) in _OWN}
    objects = {channel.code[0] for channel in on_vehicles}
    vehicle = min(own or objects)
    named = _named([channel for channel in on_vehicles if channel.code[0] == vehicle])
    timed = {name: one for name, one in named.items() if one.interval_s is not None and one.values.size >= 2}
    expected, advice = "an even time, as long as the channel", "export its sampling interval"
    untimed = {name: Problem(f"{source}, {name}", expected, "none", advice) for name in named if name not in timed}
    if not timed:
        raise DataError(list(untimed.values()))
    proposed, why = _proposed(timed)
    condition, notes = _condition(test, vehicle)
    if objects != {"1"}:
        others = " and ".join(sorted(objects - {vehicle}))
        rest = f"; those of test object {others} are left out" if others else ""
        notes = (*notes, f"Channels, speed and weights are those of test object {vehicle}{rest}.")
    if untimed:
        notes = (*notes, f"Left out for lack of an even time: {', '.join(untimed)}.")
    zero = "0 is time zero of the test, by the format's definition"
    if any(timed[name].start_s is None for name in proposed or timed):
        notes = (*notes, "No time of the first sample is in the file, so that time zero has to be found.")
        zero = ""
    recorded = tuple(_recorded(name, channel) for name, channel in timed.items())
    return Record(test.name, source, condition, recorded, proposed, (*notes, why), zero, unread=untimed)


def _on_a_vehicle(channel: Channel) -> bool:
    code = channel.code.upper()
    return len(code) == 16 and code[12:15] == "ACX" and code[0].isdigit() and code[2:6] not in _DUMMY


def _place(channel: Channel) -> str:
    return channel.code[2:6].upper()


def _named(channels: Sequence[Channel]) -> dict[str, Channel]:
    """Channels by code, numbered if several share one; the least filtered first."""
    ordered = sorted(channels, key=lambda channel: _RAW_FIRST.find(channel.code[15].upper()))
    times, seen = Counter(channel.code for channel in channels), Counter[str]()
    named = {}
    for channel in ordered:
        seen[channel.code] += 1
        named[channel.code if times[channel.code] == 1 else f"{channel.code}#{seen[channel.code]}"] = channel
    return named


def _recorded(name: str, channel: Channel) -> RecordedChannel:
    assert channel.interval_s is not None  # noqa: S101 - channels without it were left out
    time_s = (channel.start_s or 0.0) + channel.interval_s * np.arange(channel.values.size)
    label, unit = printable(channel.name or name), unit_named(channel.unit, "acceleration")
    return RecordedChannel(name, label, time_s, channel.values, unit, _CUTOFF_HZ.get(channel.code[15].upper()))


def _proposed(channels: Mapping[str, Channel]) -> tuple[tuple[str, ...], str]:
    for places, what in _PLACES:
        there = [(name, channel.code.upper()) for name, channel in channels.items() if _place(channel) in places]
        sides = [next((name for name, code in there if code[6:8] == side), None) for side in ("LE", "RI")]
        chosen = tuple(side for side in sides if side is not None) or tuple(name for name, _ in there[:1])
        if chosen:
            average = "; their average is the pulse" if len(chosen) > 1 else ""
            return chosen, f"X acceleration {what}: {', '.join(chosen)}{average}."
    return (), "No X acceleration is the vehicle's own, or on tunnel, sills or B-pillars; choose one."


def _condition(test: IsommeTest, vehicle: str) -> tuple[PartialCondition, tuple[str, ...]]:
    its = f"test object {vehicle}"
    speed = _quantity(test, (f"Velocity {its}", f"Velocity {its} lon."), "speed", "m/s")
    mass, front, rear = (
        _quantity(test, (f"{name} {its}",), "mass", "kg") for name in ("Mass", ".Front weight", ".Rear weight")
    )
    notes = [f"ISO-MME test, {printable(test.descriptor('Title') or test.name)}."]
    kind = test.descriptor("Type of the test")
    if kind:
        notes.append(f"Type of the test: {printable(kind)}.")
    notes.append(f"Speed {speed:g} m/s from the .mme file." if speed else f"The .mme file has no speed of {its}.")
    if front and rear:
        notes.append(f"Front weight {front:g} kg and rear weight {rear:g} kg from the .mme file.")
    elif mass:
        notes.append(f"Mass {mass:g} kg from the .mme file, which does not say what each axle carries.")
    return PartialCondition(speed, mass, front, rear), tuple(notes)


def _quantity(test: IsommeTest, names: Sequence[str], quantity: str, default: str) -> float | None:
    """Return the first descriptor with one of these names in SI; its unit is the format's unless it states one."""
    text = next((value for name in names if (value := test.descriptor(name))), None)
    found = None if text is None else number_and_unit(text)
    if found is None or not 0 < found[0] < np.inf:
        return None
    unit = unit_named(found[1], quantity) if found[1] else default
    return None if unit is None else found[0] * UNITS[quantity][unit]
