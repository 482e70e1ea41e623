"""An ISO-MME test as a record: its condition, and the channels that could be the pulse."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import Limits
from crashfuse.readers.channel_codes import UNPLACED, ChannelCode, proposed
from crashfuse.readers.crash_setup import other_setup
from crashfuse.readers.credibility import is_simulated, statement_of_simulation
from crashfuse.readers.isomme import ISOMME_LIMITS, read_isomme
from crashfuse.readers.isomme_channels import Channel, IsommeTest
from crashfuse.readers.quantities import speed, weight
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel, proposal
from crashfuse.readers.unit_spelling import UNITS, number_and_unit, unit_named
from crashfuse.wording import Sentence

_OTHER_SIDES = ("LE", "RI", "RE", "LEFT", "RIGHT", "REAR")


def read_isomme_record(path: Path, limits: Limits = ISOMME_LIMITS) -> tuple[Record]:
    """Read one ISO-MME test as a record: its folder, its ``.mme`` file, or a zip.

    The X accelerations at the rear seat are proposed, else the vehicle's own, else those of tunnel, sills or B-pillars:
    of what is measured and sound, by ``Data source`` and ``Data status``.
    """
    return (record_of(read_isomme(path, limits), path.name),)


def record_of(test: IsommeTest, source: str) -> Record:
    """The record of a test with the channels that could be the pulse, best placed and least filtered first."""
    on_vehicles = [(code, channel) for channel in test.channels if (code := _on_a_vehicle(channel))]
    if not on_vehicles:
        expected = "an X acceleration of the vehicle (a code such as 10VEHC000000ACXD)"
        raise DataError(Problem(source, expected, f"none in {len(test.channels)} channels", "export it too"))
    own = {code.test_object for code, _ in on_vehicles if code.rank < UNPLACED}
    objects = {code.test_object for code, _ in on_vehicles}
    vehicle = min(own or objects)
    named = _named([(code, channel) for code, channel in on_vehicles if code.test_object == vehicle])
    timed = {name: one for name, one in named.items() if one[1].interval_s is not None and one[1].values.size >= 2}
    expected, advice = "an even time, as long as the channel", "export its sampling interval"
    untimed = {name: Problem(f"{source}, {name}", expected, "none such", advice) for name in named if name not in timed}
    if not timed:
        raise DataError(list(untimed.values()))
    origin = _origin(test)
    recorded = {name: _recorded(name, code, channel, origin) for name, (code, channel) in timed.items()}
    chosen, why = proposal(recorded, lambda names: proposed({name: timed[name][0] for name in names}))
    condition, notes = _condition(test, vehicle)
    if objects != {"1"}:
        others = " and ".join(sorted(objects - {vehicle}))
        rest = f"; those of test object {others} are left out" if others else ""
        notes = (*notes, f"Channels, speed and weights are those of test object {vehicle}{rest}.")
    if untimed:
        notes = (*notes, f"Left out for lack of an even time: {', '.join(untimed)}.")
    zero = "0 is time zero of the test, by the format's definition"
    if any(timed[name][1].start_s is None for name in chosen or timed):
        notes = (*notes, "No time of the first sample is in the file, so that time zero has to be found.")
        zero = ""
    steps = (*notes, *why)
    channels, other = tuple(recorded.values()), _other_setup(test, vehicle)
    return Record(test.name, source, condition, channels, chosen, steps, zero, unread=untimed, other_setup=other)


def _on_a_vehicle(channel: Channel) -> ChannelCode | None:
    """The code of a channel that could be the vehicle's pulse."""
    code = ChannelCode.parsed(channel.code)
    if code is None or code.of_a_dummy or not (code.is_acceleration and code.is_along_x):
        return None
    return code if code.test_object.isdigit() else None


def _named(channels: Sequence[tuple[ChannelCode, Channel]]) -> dict[str, tuple[ChannelCode, Channel]]:
    """Channels by code as written, numbered if several share one; best placed and least filtered first."""
    ordered = sorted(channels, key=lambda pair: pair[0].order)
    times, seen = Counter(channel.code for _, channel in channels), Counter[str]()
    named = {}
    for code, channel in ordered:
        seen[channel.code] += 1
        named[channel.code if times[channel.code] == 1 else f"{channel.code}#{seen[channel.code]}"] = code, channel
    return named


def _origin(test: IsommeTest) -> str:
    """What the test says of the source of channels that do not say it, if nothing was measured at all."""
    texts = (test.descriptor(name) or "" for name in ("Type of the test", "Subtype of the test", "Title"))
    return next(filter(is_simulated, texts), "") or statement_of_simulation(value for _, value in test.descriptors)


def _recorded(name: str, code: ChannelCode, channel: Channel, origin: str) -> RecordedChannel:
    assert channel.interval_s is not None  # noqa: S101 - channels without it were left out
    time_s = (channel.start_s or 0.0) + channel.interval_s * np.arange(channel.values.size)
    label, unit = printable(channel.name or name), unit_named(channel.unit, "acceleration")
    origin, status = channel.source or origin, channel.status
    return RecordedChannel(name, label, time_s, channel.values, unit, code.cutoff_hz, origin=origin, status=status)


def _condition(test: IsommeTest, vehicle: str) -> tuple[PartialCondition, tuple[str, ...]]:
    its = f"test object {vehicle}"
    speed_mps = _quantity(test, (f"Velocity {its}", f"Velocity {its} lon."), "speed", "m/s")
    mass, front, rear = (
        _quantity(test, (f"{name} {its}",), "mass", "kg") for name in ("Mass", ".Front weight", ".Rear weight")
    )
    notes = [f"ISO-MME test, {printable(test.descriptor('Title') or test.name)}."]
    kind = test.descriptor("Type of the test")
    if kind:
        notes.append(f"Type of the test: {printable(kind)}.")
    if speed_mps:
        notes.append(Sentence("Speed {} from the .mme file.", speed(speed_mps, form=".4g")))
    else:
        notes.append(f"The .mme file has no speed of {its}.")
    if front and rear:
        notes.append(Sentence("Front weight {} and rear weight {} from the .mme file.", weight(front), weight(rear)))
    elif mass:
        told = "Mass {} from the .mme file, which does not say what each axle carries."
        notes.append(Sentence(told, weight(mass)))
    return PartialCondition(speed_mps, mass, front, rear), tuple(notes)


def _other_setup(test: IsommeTest, vehicle: str) -> str:
    """What the test is called, if that is no full-frontal crash; the side of its impact, if that is not the front."""
    texts = [test.descriptor(name) or "" for name in ("Type of the test", "Subtype of the test", "Title")]
    side = test.descriptor(f"Impact side test object {vehicle}") or ""
    return other_setup(texts) or (f"impact side {printable(side)}" if side.upper() in _OTHER_SIDES else "")


def _quantity(test: IsommeTest, names: Sequence[str], quantity: str, default: str) -> float | None:
    """Return the first descriptor with one of these names in SI; its unit is the format's unless it states one."""
    text = next((value for name in names if (value := test.descriptor(name))), None)
    found = None if text is None else number_and_unit(text)
    if found is None or not 0 < found[0] < np.inf:
        return None
    unit = unit_named(found[1], quantity) if found[1] else default
    return None if unit is None else found[0] * UNITS[quantity][unit]
