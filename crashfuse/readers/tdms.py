"""Reader of tests in TDMS: NHTSA's newer downloads, and other laboratories' (:mod:`crashfuse.readers.tdms_laboratory`).

NHTSA stores the content of its ASCII specification (:mod:`crashfuse.readers.nhtsa`) as properties of each channel:
``Inst_SenAtt`` FLLR, ``Inst_Axis`` XG, ``Veh_VehSpd``, ``Veh_VehTWt`` … in km/h and kg; sampling is in ``wf_increment``
and ``wf_start_offset``, and 0 is first contact. Axle weights are not included.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from crashfuse.errors import DataError, Problem, collecting, printable
from crashfuse.files.archive import Limits, Member, refuse
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.members import opened_members
from crashfuse.readers.nhtsa_sensors import (
    Sensor,
    mass_step,
    nhtsa_record,
    of_first_vehicle,
    other_configuration,
    speed_step,
)
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel
from crashfuse.readers.tdms_container import TdmsChannel, TdmsFile, parse_tdms
from crashfuse.readers.tdms_laboratory import laboratory_record
from crashfuse.readers.tdms_waveform import MOST_CHANNELS, Told, number_of, text_of, waveform
from crashfuse.units import KPH

TDMS_LIMITS = Limits(total_bytes=8 << 30, member_bytes=256 << 20)
"""Size limits of a file; a test of 1000 channels of 10,000 samples has 80 MB."""


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
            with collecting(problems), np.errstate(all="ignore"):  # damaged data may hold any number
                records.append(_record(parse_tdms(member.content(budget), member.where), member))
        refuse(problems, path.name)
    return tuple(records)


def _record(file: TdmsFile, member: Member) -> Record:
    told = [(channel, file.told(channel)) for channel in file.channels]
    of_nhtsa = [(channel, said) for channel, said in told if "inst_sentyp" in said]
    if of_nhtsa:
        return _nhtsa_record(file, of_nhtsa, member)
    return laboratory_record(file, member.path.stem, member.where)


def _nhtsa_record(file: TdmsFile, told: Sequence[tuple[TdmsChannel, Told]], member: Member) -> Record:
    where = member.where
    sensors = {_sensor(place, said): (channel, said) for place, (channel, said) in enumerate(told, start=1)}
    candidates = of_first_vehicle(list(sensors))[:MOST_CHANNELS]
    if not candidates:
        found = f"none in {len(told)} channels"
        raise DataError(Problem(where, "X accelerations of the vehicle", found, "download all channels of the test"))

    def read(sensor: Sensor) -> RecordedChannel:
        channel, said = sensors[sensor]
        label = f"{sensor.comment or channel.name}{', redundant' if sensor.redundant else ''}"
        return waveform(file, channel, said, str(sensor.number), label, where)

    test = sensors[candidates[0]][1]
    other = other_configuration(text_of(test, "test_tstcfn"), number_of(test, "test_impang"))
    readers = {one: partial(read, one) for one in candidates}
    return nhtsa_record(member.path.stem, where, readers, _condition(test, where), other)


def _sensor(place: int, said: Told) -> Sensor:
    """A channel's properties as a sensor, as if from a line of the ASCII specification."""
    return Sensor(
        vehicle=text_of(said, "veh_vehno") or "1",
        number=int(number_of(said, "inst_curno")) or place,
        sensor=text_of(said, "inst_sentyp").upper(),
        occupant=text_of(said, "inst_senloc").upper(),
        attachment=text_of(said, "inst_senatt").upper(),
        axis=text_of(said, "inst_axis").upper(),
        unit=text_of(said, "unit_string") or text_of(said, "inst_yunits"),
        cutoff_hz=number_of(said, "inst_prefil") or None,
        status=text_of(said, "inst_dastat").upper(),
        redundant=text_of(said, "inst_chstat").upper() == "R",
        comment=printable(text_of(said, "inst_inscom")),
    )


def _condition(said: Told, where: str) -> tuple[PartialCondition, tuple[str, ...]]:
    speed, mass = number_of(said, "veh_vehspd") or number_of(said, "test_clsspd"), number_of(said, "veh_vehtwt")
    car = " ".join(filter(None, (text_of(said, name) for name in ("veh_year", "veh_maked", "veh_modeld"))))
    steps = [f"NHTSA test {text_of(said, 'test_tstno')}, {printable(car)}."]
    steps.append(speed_step(speed, where))
    if mass:
        steps.append(mass_step(mass, where))
    return PartialCondition(speed * KPH or None, mass or None), tuple(steps)
