"""Reader of NHTSA's vehicle crash test database, ASCII form: a folder, or a zip of one; what its TDMS form shares.

::

    v10146.EV5      the test's specification: sections of lines with fields between ``|``
    v10146.093      channel 93: time in s and value, one sample per line; 0 is first contact

Fields are numbered as in NHTSA's Test Reference Guide, version 5, volume I: Vehicle Tests (2014); km/h, kg, mm.
``VEHCG``, how far the centre of gravity is behind the front axle, gives the axle weights with the wheelbase.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePath

import numpy as np

from crashfuse.errors import DataError, printable, refuse_all, refuse_if
from crashfuse.files.archive import Budget, Limits, Member
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.members import ONE_TEST, is_numbered, opened_members
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel, proposal, read_sound, summed_wall
from crashfuse.readers.vocabulary import NHTSA, Doubt, doubt_in, doubt_of, iso_date, speed, sums_of, weight
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import KPH, MS, Sentence

_LONGEST_S = 100 * MS
_CENTRE = "VECG"

NHTSA_LIMITS = Limits(total_bytes=512 << 20, member_bytes=32 << 20)  # beyond 1000 channels of 10,000 samples
LACKING = "X accelerations of the vehicle", "download all channels of the test"  # expected, and advice
_AGAIN = "download it again"

_TITLE, _CONFIGURATION, _ANGLE = 1, 8, 15  # fields of TEST
_CODES = ("sensor", "occupant", "attachment", "axis", "unit", "status")
_MOST_LINES = 20_000  # of a specification
_MOST_SAMPLES = 1_000_000
_UNITS = {"G'S": "g", "GS": "g", "G": "g"}


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
    maker: str = ""

    @classmethod
    def of(cls, number: int, texts: Mapping[str, str]) -> "Sensor":
        """From the texts of its fields by name, and ``cutoff`` and ``kind``; most are codes, in any case."""
        codes = {name: texts[name].upper() for name in _CODES}
        cutoff_hz, redundant = number_in(texts["cutoff"]) or None, texts["kind"].upper() == "R"
        words = {name: texts[name] for name in ("vehicle", "comment", "maker")}
        return cls(number=number, cutoff_hz=cutoff_hz, redundant=redundant, **codes, **words)

    @property
    def is_of_the_vehicle(self) -> bool:
        """Whether it is an X accelerometer on the vehicle, not on a dummy or the barrier."""
        on_it = self.vehicle != "0" and self.occupant in ("NA", "", "00")
        return self.sensor == "AC" and self.axis.startswith("X") and on_it

    @property
    def is_of_the_barrier(self) -> bool:
        """Whether it measures a force along X on the barrier."""
        return self.vehicle == "0" and self.sensor == "LC" and self.axis.startswith("X") and self.unit == "NWT"

    @property
    def quality(self) -> str:
        """The data status in words, else its code."""
        return str(NHTSA["status"].get(self.status, self.status))

    @property
    def doubt(self) -> Doubt:
        """By data status and comment."""
        return max(doubt_of(self.quality), doubt_in(self.comment))

    @property
    def shown(self) -> str:
        """Its number and comment, as messages print them."""
        return f"{self.number} ({printable(self.comment)})"

    @property
    def is_at_the_rear(self) -> bool:
        """Whether it is on the floor behind the crush zone."""
        label = self.comment.upper()
        return self.attachment in NHTSA["rear_floor"] or ("REAR" in label and any(w in label for w in NHTSA["rear"]))


def number_in(value: str | float) -> float:
    """Return a number above 0; otherwise 0, NHTSA's own code for unknown."""
    with suppress(ValueError):
        return number if 0 < (number := float(value)) < math.inf else 0.0
    return 0.0


def condition_steps(speed_kph: float, mass_kg: float, where: str) -> Iterator[str]:
    """Sentences on speed, and on mass without axle weights; 0 means unknown."""
    sentence = Sentence("Speed {} from {}.", speed(speed_kph * KPH, form=".4g"), where)
    yield sentence if speed_kph else f"{where} has no speed of the vehicle."
    if mass_kg:
        yield Sentence("Weight {} from {}, without axle weights.", weight(mass_kg), where)


def other_configuration(setup: str, angle_deg: float) -> str:
    """The configuration, unless it is that of a full-frontal barrier test (VTB at 0°) or unknown."""
    usual = setup in ("VTB", "") and not angle_deg
    return "" if usual else printable(f"{NHTSA['setup'].get(setup, setup or 'unknown')} at {angle_deg:g}°")


def nhtsa_record(
    stem: str,
    source: str,
    sensors: Mapping[Sensor, Callable[[], RecordedChannel]],
    condition: PartialCondition,
    notes: Sequence[str],
    other_setup: str,
    about: Mapping[str, str],
) -> Record:
    """Read the channels of one vehicle into a record, proposing those at the best location.

    ``stem`` is v and the number of the test. The DataError of a function in ``sensors``, which reads a channel, is
    passed on only for a channel that would be proposed, or if no other is left.
    """
    channels, damaged = read_sound({str(sensor.number): read for sensor, read in sensors.items()})
    by_name = {str(sensor.number): sensor for sensor in sensors}
    for name, channel in channels.items():
        channels[name] = replace(channel, status=by_name[name].quality, sensor=by_name[name].maker)
    wanted = [str(sensor.number) for sensor in _at_best_place([one for one in sensors if not one.doubt])[0]]
    if {*wanted} & {*damaged} or not channels:
        refuse_all([damaged[name] for name in wanted if name in damaged] or [*damaged.values()], source)
    if damaged:
        notes = [*notes, f"Left out as damaged or empty: {', '.join(by_name[name].shown for name in damaged)}."]

    def at_best_place(names: Sequence[str]) -> tuple[tuple[str, ...], str]:
        times = {by_name[name]: channels[name].time_s for name in names}
        chosen, what = _at_best_place([one for one, t in times.items() if t[-1] >= _LONGEST_S - 2 * (t[1] - t[0])])
        if not chosen:
            return (), "No channel is on the rear floor or at the centre of gravity; choose one."
        why = f"Channels {what}, averaged: {', '.join(sensor.shown for sensor in chosen)}."
        return tuple(str(sensor.number) for sensor in chosen), why

    def likelihood(name: str) -> tuple[bool, bool, bool]:
        sensor = by_name[name]
        return bool(sensor.doubt), not sensor.is_at_the_rear, sensor.attachment != _CENTRE

    proposed, why = proposal(channels, at_best_place)
    number = stem.lstrip("vV")
    about = {**about, "test_number": number, "date": iso_date(about["date"], "%d/%b/%Y")}
    ordered = tuple(channels[name] for name in sorted(channels, key=likelihood))
    zero = "0 is first contact, by the format's definition"
    found = number, source, condition, ordered, proposed, (*notes, *why), zero
    return Record(*found, unread=damaged, other_setup=other_setup, about=about)


def of_first_vehicle(sensors: Sequence[Sensor]) -> list[Sensor]:
    """The sensors that could measure the pulse, of the first vehicle that has any."""
    there = [sensor for sensor in sensors if sensor.is_of_the_vehicle]
    return [sensor for sensor in there if sensor.vehicle == min(other.vehicle for other in there)]


def other_vehicles(sensors: Sequence[Sensor]) -> list[str]:
    """A sentence on sensors of other vehicles, if any."""
    first, *others = sorted({sensor.vehicle for sensor in sensors if sensor.is_of_the_vehicle}) or [""]
    left_out = printable(" and ".join(others))
    return [f"Channels of vehicle {printable(first)}; those of vehicle {left_out} are left out."] if others else []


def _at_best_place(sound: Sequence[Sensor]) -> tuple[list[Sensor], str]:
    if rear := [sensor for sensor in sound if sensor.is_at_the_rear]:
        return rear, "on the rear crossmember or floor, behind the crush"
    return [sensor for sensor in sound if sensor.attachment == _CENTRE], "at the centre of gravity"


def read_nhtsa(path: Path, limits: Limits = NHTSA_LIMITS) -> tuple[Record]:
    """Read one NHTSA test: its folder, its ``.EV5`` file, or a zip."""

    def wanted(file: PurePath) -> bool:
        return FORMATS["nhtsa"].has(file) or is_numbered(file)

    with opened_members(path, wanted, "an NHTSA test (.EV5)", limits) as (members, budget):
        specification = _specification(members, path)
        sections = _sections(specification, budget)
        stem = specification.path.stem.lower()
        files = {int(m.path.suffix[1:]): m for m in members if is_numbered(m.path) and m.path.stem.lower() == stem}
        listed = [_listed(fields, specification.where) for fields in sections.get("INSTRUMENTATION", [])]
        candidates = of_first_vehicle(list({one.number: one for one in listed if one.number in files}.values()))
        have = f"{sum(entry.is_of_the_vehicle for entry in listed)} listed, none of them beside it"
        refuse_if(not candidates, specification.where, LACKING[0], have, LACKING[1])
        sensors = {one: partial(_channel, one, files[one.number], budget) for one in candidates}
        condition, steps = _condition(sections, candidates[0].vehicle, specification.where)
        steps += other_vehicles([one for one in listed if one.number in files])
        test = sections["TEST"][0]
        other = other_configuration(_field(test, _CONFIGURATION), number_in(_field(test, _ANGLE)))
        about = {name: _field(test, index) for name, index in NHTSA["field"]["about"].items()}
        wall = summed_wall([_load_cell(one, files, budget) for one in listed if one.is_of_the_barrier], steps)
        record = nhtsa_record(specification.path.stem, path.name, sensors, condition, steps, other, about)
        return (replace(record, wall=wall),)


def _load_cell(
    entry: Sensor, files: Mapping[int, Member], budget: Budget
) -> tuple[tuple[FloatArray, FloatArray] | None, int]:
    with suppress(DataError, KeyError):
        if entry.doubt < Doubt.FAILED:
            return _samples(files[entry.number], budget), sums_of(entry.comment)
    return None, sums_of(entry.comment)


def _specification(members: Sequence[Member], path: Path) -> Member:
    found = [member for member in members if member.path.suffix.upper() == ".EV5"]
    if path.suffix.upper() == ".EV5":
        found = [member for member in found if member.path.name == path.name]
    advice = ONE_TEST if found else "download it too"
    refuse_if(len(found) != 1, path.name, "one .EV5 file", f"{len(found) or 'none'}", advice)
    return found[0]


def _sections(member: Member, budget: Budget) -> dict[str, list[list[str]]]:
    sections, current = dict[str, list[list[str]]](), list[list[str]]()
    for line in _lines(member, budget, _MOST_LINES):
        if line.startswith("-----"):
            current = sections.setdefault(line.strip("- "), [])
        elif "|" in line:
            current.append([field.strip() for field in line.split("|")])
    for name in ("TEST", "VEHICLE", "INSTRUMENTATION"):
        refuse_if(not sections.get(name), member.where, f"a section {name}", "none", _AGAIN)
    return sections


def _listed(fields: list[str], where: str) -> Sensor:
    is_wrong = len(fields) < 20 or not (fields[1].isdecimal() and len(fields[1]) <= 6)
    found = f"{len(fields)} in {printable('|'.join(fields))!r}"
    refuse_if(is_wrong, where, "20 fields a line", found, _AGAIN)
    return Sensor.of(int(fields[1]), {name: fields[index] for name, index in NHTSA["field"]["sensor"].items()})


def _channel(entry: Sensor, member: Member, budget: Budget) -> RecordedChannel:
    time_s, values = _samples(member, budget)
    label = f"{printable(entry.comment)}{', redundant' if entry.redundant else ''}"
    return RecordedChannel(str(entry.number), label, time_s, values, _UNITS.get(entry.unit), entry.cutoff_hz)


def _samples(member: Member, budget: Budget) -> tuple[FloatArray, FloatArray]:
    lines = [line for line in _lines(member, budget, _MOST_SAMPLES) if line.strip()]
    n, table = len(lines), np.empty((0, 0))
    refuse_if(not 2 <= n <= _MOST_SAMPLES, member.where, f"2 to {_MOST_SAMPLES} samples", f"{n}", _AGAIN)
    with suppress(ValueError):
        table = np.array([line.split() for line in lines], dtype=np.float64)
    is_wrong = table.shape != (n, 2) or not np.isfinite(table).all()
    refuse_if(is_wrong, member.where, "time and value on each line", "something else", _AGAIN)
    return table[:, 0].copy(), table[:, 1].copy()


def _condition(sections: dict[str, list[list[str]]], vehicle: str, where: str) -> tuple[PartialCondition, list[str]]:
    test = sections["TEST"][0]
    car = next((fields for fields in sections["VEHICLE"] if fields[0] == vehicle), sections["VEHICLE"][0])
    speed, mass, wheelbase, behind = (number_in(_field(car, index)) for index in NHTSA["field"]["vehicle"].values())
    front = rear = None
    has_axles = mass and wheelbase and 0 < behind < wheelbase
    notes = [f"NHTSA test, {printable(_field(test, _TITLE))}."]
    notes += condition_steps(speed, 0.0 if has_axles else mass, where)
    if has_axles:
        rear = mass * behind / wheelbase
        front = mass - rear
        template = "Weight {} from {}: front {}, rear {}, by wheelbase and centre of gravity."
        notes.append(Sentence(template, weight(mass), where, weight(front), weight(rear)))
    return PartialCondition(speed * KPH or None, mass or None, front, rear), notes


def _field(fields: list[str], index: int) -> str:
    return fields[index] if index < len(fields) else ""


def _lines(member: Member, budget: Budget, most: int) -> list[str]:
    content = member.content(budget)
    n = content.count(b"\n")
    refuse_if(n > most, member.where, f"at most {most} lines", f"{n}", _AGAIN)
    return content.decode("latin-1").split("\n")  # splitlines() would also split at control characters
