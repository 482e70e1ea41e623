"""Reader of OpenRadioss and Radioss runs: the binary time history ``<run>T01``.

A time history is a Fortran file, big-endian, of records framed by their length: a header that lists what is written,
then for each state its time, the global histories, those of parts and subsets, and those of each group of ``/TH``.
Layout and codes are those of OpenRadioss's own converter (``th_to_csv``) and writer (``hist1.F``, ``hist2.F``). Of the
groups only nodes are read. The converter's CSV does not tell which of a node's columns is which, so it is not read.
"""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import DEFAULT_LIMITS, Limits
from crashfuse.readers.energies import Energies, quality_sentence
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.lsdyna.histories import MOST_VALUES, History, channel_of, is_aliased
from crashfuse.readers.lsdyna.unit_system import of_a_vehicle, units_of
from crashfuse.readers.members import opened_members
from crashfuse.readers.record import ACCELERATION_UNITS, PartialCondition, Record
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MS

_KIND = "a time history of Radioss (T01)"
_GLOBAL = {"internal": 1, "kinetic": 2, "mass": 6, "rotation": 8, "work": 9, "contact": 11, "hourglass": 12}
_GLOBAL |= {"added mass": 18}  # codes of the global histories; the last in per cent
_NODES, _VELOCITY, _ACCELERATION = 0, 4, 7  # kind of a group, codes of its variables along x
_MOST_RECORDS, _MOST_COUNT = 2_000_000, 1_000_000
_NEWER, _NEWEST, _WITH_UNITS = 3041, 4021, 3050  # codes of the layout


def read_radioss(path: Path, limits: Limits = DEFAULT_LIMITS) -> tuple[Record, ...]:
    """Read a run: the x accelerations of its nodes, its speed and mass, and what its global histories say.

    Raises
    ------
    DataError
        If it is no time history, is damaged, or has no velocity of a node along x.
    """
    mine = FORMATS["radioss"].has
    with opened_members(path, mine, _KIND, limits) as (members, budget):
        chosen = [member for member in members if not mine(path) or member.path.name == path.name]
        if not chosen:
            raise DataError(Problem(path.name, _KIND, "none", "check the path"))
        member = chosen[0]
        name = member.path.name
        history = _TimeHistory(member.content(budget), name)
    with np.errstate(all="ignore"):  # damaged data may hold any number
        return (_record(name[:-3] or name, name, history),)


def _record(run_id: str, source: str, run: "_TimeHistory") -> Record:
    nodes = run.nodes()
    if not nodes:
        advice = "ask the solver for VX and AX of the node (/TH/NODE)"
        raise DataError(Problem(source, "the velocity of nodes along x (VX)", "none", advice))
    node = max(nodes, key=_behind)
    per_second, unit, units_told = units_of([node], source)
    speed = abs(float(node.velocity[0])) * ACCELERATION_UNITS[unit or "m/s²"] * (1.0 if per_second == 1 else MS)
    known = unit is not None and bool(np.isfinite(speed))
    mass = of_a_vehicle(run.column("mass")) if known else None
    quality = run.energies().quality
    steps = [f"Radioss run{f', {run.title}' if run.title else ''}.", units_told]
    others = f" of {len(nodes)}" if len(nodes) > 1 else ""
    steps.append(f"Node {node.name}{others} stops last and rebounds least, as what lies behind the crush does.")
    if is_aliased(node):
        steps.append("Accelerations that do not add up to the node's velocity are taken from the velocity.")
    if known:
        steps.append(f"Speed {speed:.4g} m/s, at which it sets out.")
    if mass is not None:
        steps.append(f"Mass {mass:.5g} kg, of the whole model at the start.")
    steps.append(quality_sentence(quality, "global histories"))
    return Record(
        run_id,
        source,
        PartialCondition(speed if known else None, mass),
        tuple(channel_of(each, per_second, unit) for each in nodes),
        (node.name,),
        tuple(steps),
        no_speed="" if known else f"a {units_told[0].lower()}{units_told[1:].rstrip('.')}",
        quality=quality,
    )


def _behind(node: History) -> tuple[int, float]:
    """How late a node stops, and how little it rebounds."""
    forward = node.velocity * np.sign(node.velocity[0])
    stopped = np.flatnonzero(forward <= 0)
    return int(stopped[0]) if stopped.size else forward.size, float(forward.min())


class _TimeHistory:
    """A time history in memory; a DataError if it is damaged or none."""

    def __init__(self, content: bytes, where: str) -> None:
        self._where = where
        records = self._records(content)
        first = self._next(records)
        if len(first) != 84 or not 1000 <= (layout := _ints(first[:4])[0]) <= 9999:
            raise self._damaged("another kind of file")
        self.title = printable(first[4:].decode("latin-1").strip())
        self._width = 100 if layout >= _NEWEST else 80 if layout >= _NEWER else 40
        for _ in range(3 if layout > _WITH_UNITS else 1):  # date; length of titles; factors of the units
            self._next(records)
        parts, materials, sections, subsets, groups, self._globals = self._counts(self._next(records), 6)
        self._codes = _ints(self._next(records)) if self._globals else ()
        sizes = [1, self._globals, self._parts(records, parts)]
        for _ in range(materials + sections):
            self._next(records)
        sizes.append(self._subsets(records, subsets))
        self._groups: list[tuple[int, tuple[str, ...], tuple[int, ...]]] = []
        for _ in range(groups):
            self._group(records)
        sizes += [len(names) * len(codes) for _, names, codes in self._groups]
        self._blocks = [size for size in sizes if size]
        self._states = self._data(content)

    def column(self, name: str) -> FloatArray | None:
        """A global history; None if it is not written."""
        code = _GLOBAL[name]
        return self._block(1)[:, self._codes.index(code)].astype(np.float64) if code in self._codes else None

    def energies(self) -> Energies:
        """The global histories; hourglass energy is always computed."""
        kinetic, internal, rotation, contact, hourglass = map(
            self.column, ("kinetic", "internal", "rotation", "contact", "hourglass")
        )
        added = self.column("added mass")
        total = None
        if kinetic is not None and internal is not None:
            total = sum((one for one in (rotation, contact, hourglass) if one is not None), kinetic + internal)
        return Energies(total, self.column("work"), internal, hourglass, None if added is None else added / 100)

    def nodes(self) -> list[History]:
        """The nodes whose velocity along x is written, each once."""
        found: dict[str, History] = {}
        time = self._block(0)[:, 0].astype(np.float64)
        at = len(self._blocks) - sum(bool(names and codes) for _, names, codes in self._groups)
        for kind, names, codes in self._groups:
            if not names or not codes:
                continue
            if kind == _NODES and _VELOCITY in codes:
                values = self._block(at).reshape(len(time), len(names), len(codes)).astype(np.float64)
                for place, name in enumerate(names):
                    number, _, title = name.partition(" ")
                    velocity = values[:, place, codes.index(_VELOCITY)]
                    accel = np.full(time.size, np.nan)
                    if _ACCELERATION in codes:
                        accel = values[:, place, codes.index(_ACCELERATION)]
                    elif time.size > 1:
                        accel = np.gradient(velocity, time)
                    found.setdefault(number, History(number, title, time, accel, velocity))
            at += 1
        return list(found.values())

    def _block(self, number: int) -> npt.NDArray[np.float32]:
        """One record of every state, shape (n_states, size)."""
        start = sum(self._blocks[:number]) + 2 * number + 1
        return self._states[:, start : start + self._blocks[number]]

    def _data(self, content: bytes) -> npt.NDArray[np.float32]:
        """All whole states with the frames of their records, shape (n_states, words of a state)."""
        words = sum(self._blocks) + 2 * len(self._blocks)
        states = (len(content) - self._at) // (4 * words)
        if not states:
            raise self._damaged("no state")
        if states * sum(self._blocks) > 4 * MOST_VALUES:
            raise self._damaged("more values than a run has")
        raw = np.frombuffer(content, ">i4", count=states * words, offset=self._at).reshape(states, words)
        place = 0
        for size in self._blocks:
            if (raw[:, [place, place + size + 1]] != 4 * size).any():
                raise self._damaged("states that are not alike")
            place += size + 2
        return raw.view(">f4")

    def _parts(self, records: Iterator[bytes], count: int) -> int:
        total = 0
        for _ in range(count):
            variables = self._counts(self._next(records)[-4:], 1)[0]
            total += variables
            if variables:
                self._next(records)
        return total

    def _subsets(self, records: Iterator[bytes], count: int) -> int:
        total = 0
        for _ in range(count):
            _, _, children, parts, variables = self._counts(self._next(records), 5)
            total += variables
            for listed in (children, parts, variables):
                if listed:
                    self._next(records)
        return total

    def _group(self, records: Iterator[bytes]) -> None:
        _, kind, _, elements, variables = self._counts(self._next(records), 5)
        names = []
        for _ in range(elements):
            body = self._next(records)
            title = printable(body[4 : 4 + self._width].decode("latin-1").strip())
            names.append(f"{_ints(body[:4])[0]} {title}")
        codes = _ints(self._next(records)) if variables else ()
        self._groups.append((kind, tuple(names), codes))

    def _records(self, content: bytes) -> Iterator[bytes]:
        """Yield the records of the header; ``_at`` is where the next one begins."""
        self._at = 0
        for _ in range(_MOST_RECORDS):
            if self._at + 8 > len(content):
                return
            size = struct.unpack_from(">i", content, self._at)[0]
            end = self._at + 4 + size
            if size < 0 or end + 4 > len(content) or struct.unpack_from(">i", content, end)[0] != size:
                return
            record = content[self._at + 4 : end]
            self._at = end + 4
            yield record

    def _next(self, records: Iterator[bytes]) -> bytes:
        record = next(records, b"")
        if len(record) < 4:
            raise self._damaged("one that was cut short, or another kind of file")
        return record

    def _counts(self, record: bytes, count: int) -> tuple[int, ...]:
        if len(record) < 4 * count:
            raise self._damaged("a header that makes no sense")
        found = _ints(record[: 4 * count])
        if any(not 0 <= each <= _MOST_COUNT for each in found[-2:]):
            raise self._damaged("a header that makes no sense")
        return found

    def _damaged(self, found: str) -> DataError:
        return DataError(Problem(self._where, _KIND, found, "copy it again from the run"))


def _ints(record: bytes) -> tuple[int, ...]:
    return struct.unpack(f">{len(record) // 4}i", record[: len(record) // 4 * 4])
