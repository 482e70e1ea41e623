"""Shared by both forms of NHTSA's database: a test's setup and speed, and the sensors that measure the pulse."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import refuse
from crashfuse.readers.credibility import doubt_of
from crashfuse.readers.quantities import speed, weight
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel, proposal
from crashfuse.units import KPH, MS
from crashfuse.wording import Sentence

_LONGEST_S = 100 * MS
_STATUS = {"AM": "as measured", "CF": "channel failed", "CM": "computed", "QD": "questionable data"}
_CENTRE = "VECG"
_SETUPS = {"VTV": "vehicle into vehicle (VTV)", "ITV": "impactor into vehicle (ITV)", "VTP": "vehicle into pole (VTP)"}
_REAR_FLOOR = ("FLLR", "FLRR", "SELR", "SERR")
_REAR_WORDS = ("CROSSMEMBER", "CROSS MEMBER", "X-MEMBER", "FLOOR", "SILL", "SEAT")


@dataclass(frozen=True, slots=True)
class Sensor:
    """A line of INSTRUMENTATION."""

    vehicle: str
    number: int
    sensor: str
    occupant: str
    attachment: str
    axis: str
    unit: str
    cutoff_hz: float | None
    status: str
    redundant: bool
    comment: str

    @property
    def of_the_vehicle(self) -> bool:
        """Whether it could measure the pulse: an X accelerometer on the vehicle, not on a dummy or the barrier."""
        on_it = self.vehicle != "0" and self.occupant in ("NA", "", "00")
        return self.sensor == "AC" and self.axis.startswith("X") and on_it

    @property
    def quality(self) -> str:
        """The data status in words, or its code where the words are not ours."""
        return _STATUS.get(self.status, self.status)

    @property
    def at_the_rear(self) -> bool:
        """Whether it is on the floor behind the crush zone, where both sides follow the motion of the whole vehicle."""
        label = self.comment.upper()
        return self.attachment in _REAR_FLOOR or ("REAR" in label and any(word in label for word in _REAR_WORDS))


def number_in(value: str | float) -> float:
    """Return a number above 0; otherwise 0, NHTSA's own code for unknown."""
    try:
        number = float(value)
    except ValueError:
        return 0.0
    return number if 0 < number < math.inf else 0.0


def speed_step(speed_kph: float, where: str) -> str:
    """A sentence on the speed; 0 means unknown."""
    told = Sentence("Speed {} from {}.", speed(speed_kph * KPH, form=".4g"), where)
    return told if speed_kph else f"{where} has no speed of the vehicle."


def mass_step(mass_kg: float, where: str) -> str:
    """A sentence on the mass of a vehicle whose axle weights are unknown."""
    return Sentence("Weight {} from {}, which does not say what each axle carried.", weight(mass_kg), where)


def other_configuration(setup: str, angle_deg: float) -> str:
    """The configuration, unless it is that of a full-frontal barrier test (VTB at 0°) or unknown."""
    usual = setup in ("VTB", "") and not angle_deg
    return "" if usual else printable(f"{_SETUPS.get(setup, setup or 'unknown')} at {angle_deg:g}°")


def nhtsa_record(
    stem: str,
    source: str,
    sensors: Mapping[Sensor, Callable[[], RecordedChannel]],
    told: tuple[PartialCondition, Sequence[str]],
    other_setup: str,
) -> Record:
    """Read the channels of one vehicle into a record, proposing those at the best location.

    Parameters
    ----------
    stem : str
        Stem of the file name: v and the number of the test.
    sensors : mapping of Sensor to callable
        The function that reads each sensor's channel. It may raise a DataError, which is passed on only for a channel
        that would be proposed, or if no other is left.
    told : (PartialCondition, sequence of str)
        The condition, and sentences on its origin.
    other_setup : str
        As in :class:`~crashfuse.readers.record.Record`.
    """
    channels: dict[Sensor, RecordedChannel] = {}
    damaged: dict[Sensor, Problem] = {}
    for sensor, read in sensors.items():
        try:
            channels[sensor] = replace(read(), status=sensor.quality)
        except DataError as error:
            damaged[sensor] = error.problems[0]
    wanted, _ = _at_best_place([entry for entry in sensors if not doubt_of(entry.quality)])
    if set(wanted) & set(damaged) or not channels:
        refuse([problem for entry, problem in damaged.items() if entry in wanted] or list(damaged.values()), source)
    names = ", ".join(f"{entry.number} ({printable(entry.comment)})" for entry in damaged)
    left_out = (f"Left out as damaged or empty: {names}.",) if damaged else ()
    proposed, why = _proposed(channels)
    condition, found = told
    zero = "0 is first contact, by the format's definition"
    steps = (*found, *left_out, *why)
    best_first = tuple(channels[sensor] for sensor in sorted(channels, key=_likelihood))
    unread = {str(entry.number): problem for entry, problem in damaged.items()}
    return Record(
        stem.lstrip("vV"),
        source,
        condition,
        best_first,
        proposed,
        steps,
        zero,
        unread=unread,
        other_setup=other_setup,
    )


def of_first_vehicle(sensors: Sequence[Sensor]) -> list[Sensor]:
    """The sensors that could measure the pulse, of the first vehicle that has any."""
    there = [sensor for sensor in sensors if sensor.of_the_vehicle]
    return [sensor for sensor in there if sensor.vehicle == min(other.vehicle for other in there)]


def _likelihood(sensor: Sensor) -> tuple[bool, bool, bool]:
    """Sort key: sound ones first, those at the rear, those at the centre of gravity."""
    return bool(doubt_of(sensor.quality)), not sensor.at_the_rear, sensor.attachment != _CENTRE


def _proposed(channels: Mapping[Sensor, RecordedChannel]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The channels to average, and sentences on why."""
    named = {str(entry.number): (entry, channel) for entry, channel in channels.items()}

    def at_best_place(names: Sequence[str]) -> tuple[tuple[str, ...], str]:
        long = (
            entry
            for entry, channel in map(named.__getitem__, names)
            if channel.time_s[-1] >= _LONGEST_S - 2 * (channel.time_s[1] - channel.time_s[0])
        )
        chosen, what = _at_best_place(list(long))
        if not chosen:
            return (), "No channel lies on the rear floor or at the centre of gravity; choose one."
        told = ", ".join(f"{entry.number} ({printable(entry.comment)})" for entry in chosen)
        average = "their average is the pulse" if len(chosen) > 1 else "it is the pulse"
        return tuple(str(entry.number) for entry in chosen), f"Channels {what}: {told}; {average}."

    return proposal({name: channel for name, (_, channel) in named.items()}, at_best_place)


def _at_best_place(sound: Sequence[Sensor]) -> tuple[list[Sensor], str]:
    """The sensors on the rear floor, else those at the centre of gravity, with a description."""
    rear = [entry for entry in sound if entry.at_the_rear]
    if rear:
        return rear, "on the rear crossmember or floor, behind the crush"
    return [entry for entry in sound if entry.attachment == _CENTRE], "at the centre of gravity"
