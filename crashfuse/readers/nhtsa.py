"""Reader of NHTSA's vehicle crash test database, ASCII form: a folder, or a zip of one.

::

    v10146.EV5      the test's specification: sections of lines with fields between ``|``
    v10146.093      channel 93: time in s and value, one sample per line; 0 is first contact

Fields are numbered as in NHTSA's Test Reference Guide, version 5, volume I: Vehicle Tests (2014). Speeds are in km/h,
weights in kg, lengths in mm. ``VEHCG`` is the distance of the centre of gravity behind the front axle, so with the
wheelbase it gives the axle weights.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path, PurePath

import numpy as np

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import Budget, Limits, Member
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.members import is_numbered, opened_members
from crashfuse.readers.nhtsa_sensors import (
    Sensor,
    mass_step,
    nhtsa_record,
    number_in,
    of_first_vehicle,
    other_configuration,
    speed_step,
)
from crashfuse.readers.quantities import weight
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import KPH
from crashfuse.wording import Sentence

NHTSA_LIMITS = Limits(total_bytes=512 << 20, member_bytes=32 << 20)
"""Size limits of a test; 1000 channels of 10,000 samples are within them."""

_TITLE, _CONFIGURATION, _ANGLE = 1, 8, 15  # fields of TEST
_WEIGHT, _WHEELBASE, _CENTRE_OF_GRAVITY = 10, 12, 15  # fields of VEHICLE
_SPEED = 41
_MOST_LINES = 20_000  # of a specification
_MOST_SAMPLES = 1_000_000
_UNITS = {"G'S": "g", "GS": "g", "G": "g"}


def read_nhtsa(path: Path, limits: Limits = NHTSA_LIMITS) -> tuple[Record]:
    """Read the conditions and the vehicle's X accelerations of one NHTSA test: its folder, its ``.EV5`` file, or a zip.

    The rear crossmember's channels are proposed, else those at the centre of gravity; channels that the test engineers
    marked as failed can be chosen but are never proposed.
    """
    with opened_members(path, _is_of_the_format, "an NHTSA folder or zip with a .EV5 file", limits) as (
        members,
        budget,
    ):
        specification = _specification(members, path)
        sections = _sections(specification, budget)
        stem = specification.path.stem.lower()
        files = {int(m.path.suffix[1:]): m for m in members if is_numbered(m.path) and m.path.stem.lower() == stem}
        listed = [_listed(fields, specification.where) for fields in sections.get("INSTRUMENTATION", [])]
        candidates = of_first_vehicle(list({one.number: one for one in listed if one.number in files}.values()))
        if not candidates:
            have = f"{sum(entry.of_the_vehicle for entry in listed)} listed, none of them beside it"
            expected, advice = "files of the vehicle's X accelerations", "download all channels of the test"
            raise DataError(Problem(specification.where, expected, have, advice))
        sensors = {one: partial(_channel, one, files[one.number], budget) for one in candidates}
        told = _condition(sections, candidates[0].vehicle, specification.where)
        test = sections["TEST"][0]
        other = other_configuration(_field(test, _CONFIGURATION), number_in(_field(test, _ANGLE)))
        return (nhtsa_record(specification.path.stem, path.name, sensors, told, other),)


def _specification(members: Sequence[Member], path: Path) -> Member:
    found = [member for member in members if member.path.suffix.upper() == ".EV5"]
    if path.suffix.upper() == ".EV5":
        found = [member for member in found if member.path.name == path.name]
    if len(found) != 1:
        advice = "choose the folder of one test" if found else "download the test's specification (EV5) too"
        raise DataError(Problem(path.name, "one .EV5 file", f"{len(found) or 'none'}", advice))
    return found[0]


def _sections(member: Member, budget: Budget) -> dict[str, list[list[str]]]:
    """Lines by section, split into fields."""
    lines = _text(member, budget).split("\n")  # splitlines() would also split at control characters
    if len(lines) > _MOST_LINES:
        raise DataError(Problem(member.where, f"at most {_MOST_LINES} lines", f"{len(lines)}", "download it again"))
    sections: dict[str, list[list[str]]] = {}
    current: list[list[str]] = []
    for line in lines:
        if line.startswith("-----"):
            current = sections.setdefault(line.strip("- "), [])
        elif "|" in line:
            current.append([field.strip() for field in line.split("|")])
    for name in ("TEST", "VEHICLE", "INSTRUMENTATION"):
        if not sections.get(name):
            raise DataError(Problem(member.where, f"a section {name}", "none", "download the specification again"))
    return sections


def _listed(fields: list[str], where: str) -> Sensor:
    if len(fields) < 20 or not (fields[1].isdecimal() and len(fields[1]) <= 6):
        expected, found = "20 fields a line of INSTRUMENTATION", f"{len(fields)} in {printable('|'.join(fields))!r}"
        raise DataError(Problem(where, expected, found, "download the specification again"))
    return Sensor(
        vehicle=fields[0],
        number=int(fields[1]),
        sensor=fields[2].upper(),
        occupant=fields[3].upper(),
        attachment=fields[4].upper(),
        axis=fields[5].upper(),
        unit=fields[7].upper(),
        cutoff_hz=number_in(fields[8]) or None,
        status=fields[17].upper(),
        redundant=fields[18].upper() == "R",
        comment=fields[19],
    )


def _channel(entry: Sensor, member: Member, budget: Budget) -> RecordedChannel:
    time_s, values = _samples(_text(member, budget), member.where)
    label = f"{printable(entry.comment)}{', redundant' if entry.redundant else ''}"
    return RecordedChannel(str(entry.number), label, time_s, values, _UNITS.get(entry.unit), entry.cutoff_hz)


def _samples(text: str, where: str) -> tuple[FloatArray, FloatArray]:
    lines = [line for line in text.split("\n") if line.strip()]
    expected, advice = "time and value on each line", "download the channel again"
    if not 2 <= len(lines) <= _MOST_SAMPLES:
        raise DataError(Problem(where, f"2 to {_MOST_SAMPLES} samples", f"{len(lines)}", advice))
    try:
        table = np.array([line.split() for line in lines], dtype=np.float64)
    except ValueError:
        table = np.empty((0, 0))
    if table.ndim != 2 or table.shape[1] != 2 or not np.isfinite(table).all():
        raise DataError(Problem(where, expected, "something else", advice))
    return table[:, 0].copy(), table[:, 1].copy()


def _condition(
    sections: dict[str, list[list[str]]], vehicle: str, where: str
) -> tuple[PartialCondition, tuple[str, ...]]:
    """Speed and axle weights, with sentences on their origin."""
    test = sections["TEST"][0]
    car = next((fields for fields in sections["VEHICLE"] if fields[0] == vehicle), sections["VEHICLE"][0])
    speed, mass, wheelbase, behind = (
        number_in(_field(car, index)) for index in (_SPEED, _WEIGHT, _WHEELBASE, _CENTRE_OF_GRAVITY)
    )
    notes = [f"NHTSA test, {printable(_field(test, _TITLE))}."]
    notes.append(speed_step(speed, where))
    front = rear = None
    if mass and wheelbase and 0 < behind < wheelbase:
        rear = mass * behind / wheelbase
        front = mass - rear
        told = (
            "Weight {} from {}: {} in front and {} at the rear, from the centre of gravity "
            f"{behind:g} mm behind the front axle and the wheelbase {wheelbase:g} mm."
        )
        notes.append(Sentence(told, weight(mass), where, weight(front), weight(rear)))
    elif mass:
        notes.append(mass_step(mass, where))
    return PartialCondition(speed * KPH or None, mass or None, front, rear), tuple(notes)


def _field(fields: list[str], index: int) -> str:
    return fields[index] if index < len(fields) else ""


def _text(member: Member, budget: Budget) -> str:
    return member.content(budget).decode("latin-1")


def _is_of_the_format(path: PurePath) -> bool:
    return FORMATS["nhtsa"].has(path) or is_numbered(path)
