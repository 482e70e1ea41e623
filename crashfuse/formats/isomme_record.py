"""What an ISO-MME test says of one crash: its condition, and which of its channels could be the pulse."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.formats.archive import Limits, shown
from crashfuse.formats.isomme import ISOMME_LIMITS, Channel, IsommeTest, read_isomme
from crashfuse.formats.record import PartialCondition, Record, RecordedChannel
from crashfuse.formats.spelling import UNITS, number_and_unit, unit_named

_DUMMY = (
    "HEAD",
    "NECK",
    "CHST",
    "THSP",
    "SPIN",
    "PELV",
    "FEMR",
    "TIBI",
    "FOOT",
    "ABDO",
    "SHLD",
    "KNEE",
    "RIBS",
    "ACTB",
)
_PLACES = (
    (("VEHC", "CVEH"), "of the vehicle as a whole"),
    (("TUNN",), "on the tunnel"),
    (("SIME", "SILL"), "on the sills"),
    (("BPIL",), "on the B-pillars"),
)
_CUTOFF_HZ = {"A": 1650.0, "B": 1000.0, "C": 300.0, "D": 100.0}  # of CFC 1000, 600, 180, 60 (SAE J211-1)
_RAW_FIRST = "0PXSABCD"


def isomme_record(path: Path, limits: Limits = ISOMME_LIMITS) -> Record:
    """Read one ISO-MME test as a record.

    Parameters
    ----------
    path : Path
        The folder of the test, its ``.mme`` file, or a zip.
    limits : Limits
        Sizes beyond which it is refused.

    Returns
    -------
    Record
        With the vehicle's own X acceleration proposed, else that of tunnel, sills or B-pillars, both sides averaged.

    Raises
    ------
    DataError
        If it is no ISO-MME test, or has no X acceleration of the vehicle.
    """
    return record_of(read_isomme(path, limits), path.name)


def record_of(test: IsommeTest, source: str) -> Record:
    """Choose what could be the pulse; the least filtered of several channels at one place comes first."""
    ordered = sorted(
        filter(_of_the_vehicle, test.channels), key=lambda channel: _RAW_FIRST.find(channel.code[15].upper())
    )
    names = _names(ordered)
    recorded = tuple(map(_recorded, names, ordered))
    if not recorded:
        expected = "an X acceleration of the vehicle (a code such as 10VEHC000000ACXD)"
        raise DataError(Problem(source, expected, f"none in {len(test.channels)} channels", "export it too"))
    proposed, why = _proposed(names, ordered)
    condition, notes = _condition(test)
    zero = "0 is time zero of the test, by the format's definition"
    return Record(test.name, source, condition, recorded, proposed, (*notes, why), zero)


def _of_the_vehicle(channel: Channel) -> bool:
    code = channel.code.upper()
    on_it = len(code) == 16 and code[12:15] == "ACX" and code[0].isdigit() and code[2:6] not in _DUMMY
    return on_it and channel.interval_s is not None and channel.values.size >= 2


def _names(channels: Sequence[Channel]) -> list[str]:
    """Return the codes, counted where several channels have the same."""
    times, seen = Counter(channel.code for channel in channels), Counter[str]()
    names = []
    for channel in channels:
        seen[channel.code] += 1
        names.append(channel.code if times[channel.code] == 1 else f"{channel.code}#{seen[channel.code]}")
    return names


def _recorded(name: str, channel: Channel) -> RecordedChannel:
    assert channel.interval_s is not None  # noqa: S101 - the others were left out
    time_s = channel.start_s + channel.interval_s * np.arange(channel.values.size)
    label, unit = shown(channel.name or name), unit_named(channel.unit, "acceleration")
    return RecordedChannel(name, label, time_s, channel.values, unit, _CUTOFF_HZ.get(channel.code[15].upper()))


def _proposed(names: Sequence[str], channels: Sequence[Channel]) -> tuple[tuple[str, ...], str]:
    for places, what in _PLACES:
        there = [(name, ch.code.upper()) for name, ch in zip(names, channels, strict=True) if ch.code[2:6] in places]
        sides = [next((name for name, code in there if code[6:8] == side), None) for side in ("LE", "RI")]
        chosen = tuple(side for side in sides if side is not None) or tuple(name for name, _ in there[:1])
        if chosen:
            average = "; their average is the pulse" if len(chosen) > 1 else ""
            return chosen, f"X acceleration {what}: {', '.join(chosen)}{average}."
    if len(names) == 1:
        return (names[0],), f"The only X acceleration of the vehicle: {names[0]}."
    return (), "No X acceleration is the vehicle's own, or on tunnel, sills or B-pillars; one has to be chosen."


def _condition(test: IsommeTest) -> tuple[PartialCondition, tuple[str, ...]]:
    speed = _quantity(test, ("Velocity test object 1", "Velocity test object 1 lon."), "speed", "m/s")
    mass, front, rear = (
        _quantity(test, (name,), "mass", "kg")
        for name in ("Mass test object 1", ".Front weight test object 1", ".Rear weight test object 1")
    )
    notes = [f"ISO-MME test, {shown(test.descriptor('Title') or test.name)}."]
    kind = test.descriptor("Type of the test")
    if kind:
        notes.append(f"Type of the test: {shown(kind)}.")
    notes.append(
        f"Speed {speed:g} m/s from the .mme file." if speed else "The .mme file has no speed of test object 1."
    )
    if front and rear:
        notes.append(f"Front weight {front:g} kg and rear weight {rear:g} kg from the .mme file.")
    elif mass:
        notes.append(f"Mass {mass:g} kg from the .mme file, which does not say what each axle carries.")
    return PartialCondition(speed, mass, front, rear), tuple(notes)


def _quantity(test: IsommeTest, names: Sequence[str], quantity: str, default: str) -> float | None:
    """Return the first descriptor of these names in SI; its unit is the format's where it has none of its own."""
    text = next((value for name in names if (value := test.descriptor(name))), None)
    found = None if text is None else number_and_unit(text)
    if found is None or not 0 < found[0] < np.inf:
        return None
    unit = unit_named(found[1], quantity) if found[1] else default
    return None if unit is None else found[0] * UNITS[quantity][unit]
