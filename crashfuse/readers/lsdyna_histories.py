"""Histories of nodes and energies of an LS-DYNA run, and its ASCII files: ``nodout``, ``glstat`` and ``matsum``.

Names and layout are those of the solver's own converter from binout to text. Hourglass energy is computed only if the
model asks for it (HGEN = 2 in *CONTROL_ENERGY): zero throughout counts as not recorded.
"""

import re
from array import array
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from crashfuse.cae_library import RunQuality
from crashfuse.errors import DataError, Problem, printable
from crashfuse.readers.format import AXES, Travel
from crashfuse.readers.solver_run import Energies, History, axis_of_travel, complete_quality
from crashfuse.signals.pulse import FloatArray

MOST_NODES = 200_000
"""Limit of the nodes listed in a file."""
MOST_VALUES = 20_000_000
"""Limit of states times nodes kept per run."""
_LONGEST_LINE = 1 << 16
_NO_EXPONENT_LETTER = re.compile(r"(?<=[\d.])([-+])")

GLSTAT = frozenset({"kinetic_energy", "total_energy", "external_work", "internal_energy", "hourglass_energy"})
GLSTAT |= {"percent_increase", "time"}
MATSUM = frozenset({"time", "internal_energy", "hourglass_energy"})
"""Variables of a state in a binout, of the whole model and of each part."""

_GLSTAT_LINE = re.compile(rb" *([a-z/ ]*[a-z]) *\.{2,} *([-+.\dEeDd]+)")
_MATSUM_PART = re.compile(rb"(inten|hgeng)= *([-+.\dEeDd]+)")
_MATSUM_TIME = re.compile(rb" *time *= *([-+.\dEeDd]+)")
_AS_TEXT = {
    "kinetic energy": "kinetic_energy",
    "internal energy": "internal_energy",
    "hourglass energy": "hourglass_energy",
    "external work": "external_work",
    "total energy": "total_energy",
    "percentage increase": "percent_increase",
    "inten": "internal_energy",
    "hgeng": "hourglass_energy",
}
_MOST_STATES = 1_000_000

States = dict[float, dict[str, float]]
"""Values by name, by the time of the state: a restart repeats some states."""

_LONGEST_ID = 19  # digits
_STATE_TIME = re.compile(rb"at time\s*([-+.\dEeDd]+)")
_ROW = re.compile(rb"\s*(\d+)(?=[\s+-]|$)(.*)", re.DOTALL)  # a negative number may directly follow the node number
_NUMBER = re.compile(rb"[-+]?\d+\.\d*(?:[EeDd][-+]?\d+|[-+]\d+)?")
_ACCELERATIONS = [f"{axis}-accl".encode() for axis in AXES]
_VELOCITIES = [f"{axis}-vel".encode() for axis in AXES]


@dataclass(frozen=True, eq=False, slots=True)
class Histories:
    """The nodal histories of a run.

    ``start`` are velocities at the first state, shape (3, n_nodes), ``fastest`` the largest speeds of any node along
    each axis; of the start alone where nodes set out with a speed.
    """

    title: str
    nodes: tuple[History, ...]
    total: int  # nodes in the files
    start: FloatArray = field(default_factory=lambda: np.zeros((3, 1)))
    fastest: FloatArray = field(default_factory=lambda: np.zeros(3))
    kinetic_energy: float | None = None  # of the whole model at its first state
    notes: tuple[str, ...] = ()  # what was joined or left out
    quality: RunQuality = field(default_factory=RunQuality)

    def added_to(self, others: "Histories") -> "Histories":
        """These nodes and others of the same run; a node that is among both is taken from the others."""
        names = {node.name for node in others.nodes}
        nodes = (*others.nodes, *(node for node in self.nodes if node.name not in names))
        return replace(others, nodes=nodes, total=max(len(nodes), self.total, others.total))


def nodes_to_keep(names: Sequence[str], titles: Mapping[str, str], most: int) -> set[str]:
    """The nodes to keep if there are too many: those with a title first, then in file order."""
    return set(sorted(names, key=lambda name: not titles.get(name))[:most])


def too_many_values(where: str) -> DataError:
    """The error for more values than are kept per run."""
    expected = f"at most {MOST_VALUES:,} states times nodes"
    return DataError(Problem(where, expected, "more", "write fewer nodes (*DATABASE_HISTORY_NODE) or fewer states"))


def _lines_of(chunks: Iterable[bytes], where: str) -> Iterator[bytes]:
    rest = b""
    for chunk in chunks:
        *whole, rest = (rest + chunk).split(b"\n")
        yield from whole
        if len(rest) > _LONGEST_LINE:
            raise DataError(Problem(where, "lines of text", "one without an end", f"choose the {where} of a run"))
    if rest:
        yield rest


def number(text: str, where: str) -> float:
    """Read a number as written by Fortran: 1.2E-03, 1.2D-03, and 1.2-103 for three-digit exponents."""
    plain = text.upper().replace("D", "E")
    try:
        return float(plain if "E" in plain else _NO_EXPONENT_LETTER.sub(r"E\1", plain))
    except ValueError:
        raise DataError(Problem(where, "numbers", repr(printable(text, 40)), "copy it again from the run")) from None


def glstat_text(chunks: Iterable[bytes], where: str) -> States:
    """The states of a ``glstat`` as text."""
    states: States = {}
    now: dict[str, float] = {}
    for line in _lines_of(chunks, where):
        if (match := _GLSTAT_LINE.match(line)) is None:
            continue
        name, value = match.group(1).decode(), number(match.group(2).decode(), where)
        if name == "time" and len(states) < _MOST_STATES:
            now = states.setdefault(value, {})
        elif name in _AS_TEXT:
            now[_AS_TEXT[name]] = value
    return states


def matsum_text(chunks: Iterable[bytes], where: str) -> States:
    """The states of a ``matsum`` as text, summed over the parts."""
    states: States = {}
    now: dict[str, float] = defaultdict(float)
    for line in _lines_of(chunks, where):
        if (match := _MATSUM_TIME.match(line)) is not None and len(states) < _MOST_STATES:
            now = states[number(match.group(1).decode(), where)] = defaultdict(float)
        for name, value in _MATSUM_PART.findall(line):
            now[_AS_TEXT[name.decode()]] += number(value.decode(), where)
    return states


def quality_of(glstat: States, matsum: States) -> RunQuality:
    """The quality of a run; what ``glstat`` lacks is taken from ``matsum``."""
    added = _column(glstat, "percent_increase")
    both = {time: state for time, state in glstat.items() if {"total_energy", "external_work"} <= state.keys()}
    total, work = _column(both, "total_energy"), _column(both, "external_work")  # a killed run's last state lacks some
    whole = Energies(total, work, *_strain(glstat), None if added is None else added / 100)
    return complete_quality(whole.quality, Energies(None, None, *_strain(matsum)).quality)


def _strain(states: States) -> tuple[FloatArray | None, FloatArray | None]:
    """Internal and hourglass energy; the latter not if it is zero throughout."""
    hourglass = _column(states, "hourglass_energy")
    return _column(states, "internal_energy"), hourglass if hourglass is not None and hourglass.any() else None


def _column(states: States, name: str) -> FloatArray | None:
    values = [state[name] for _, state in sorted(states.items()) if name in state]
    return np.array(values) if values else None


def read_nodout(chunks: Iterable[bytes], where: str, most: int, travel: Travel | None) -> Histories:
    """Read an ASCII ``nodout`` as a stream; everything but the nodes' translation is skipped.

    If there are more than ``most`` nodes, those with a title are kept first. An unreadable row raises a DataError.
    """
    reader = _Nodout(where, most, travel)
    lines = _lines_of(chunks, where)
    title = printable(next(lines, b"").decode("latin-1").strip())
    whole = all(map(reader.take, lines))
    return reader.histories(title, to_the_end=whole or next(lines, None) is None)


class _Nodout:
    """What was read of a file so far. The first state tells along which axis the others are read."""

    def __init__(self, where: str, most: int, travel: Travel | None) -> None:
        self._where, self._most, self._travel = where, most, travel
        self._titles: dict[str, str] = {}
        self._in_legend = False
        self._columns: list[bytes] = []
        self._now = np.nan
        self._times: list[float] = []
        self._first: dict[str, list[float]] = {}
        self._start = np.zeros((3, 0))
        self._at_rest = False
        self._fastest = np.zeros(3)
        self._series: dict[str, tuple[array[float], array[float]]] = {}
        self._places: list[int] = []  # of accelerations and velocities in a row
        self._axis = 0

    def take(self, line: bytes) -> bool:
        """Read a line; False if it is a row that was cut short or cannot be read."""
        if line.startswith(b"{"):
            self._in_legend = b"BEGIN" in line
        elif self._in_legend:
            node, _, text = line.decode("latin-1").strip().partition(" ")
            if node.isdecimal() and len(node) <= _LONGEST_ID and len(self._titles) < MOST_NODES:
                self._titles[str(int(node))] = printable(text.strip())
        elif b"at time" in line and (header := _STATE_TIME.search(line)) is not None:
            self._columns, self._now = [], number(header.group(1).decode(), self._where)
        elif b"nodal point" in line:
            self._columns = line.split()[2:]
            if {*_ACCELERATIONS, *_VELOCITIES} <= set(self._columns):
                self._begin_state()
            else:
                self._columns = []  # table of nodal rotations
        elif self._columns and (row := _ROW.match(line)) is not None:
            return self._take_row(row.group(1).decode("latin-1"), row.group(2))
        return True

    def histories(self, title: str, *, to_the_end: bool) -> Histories:
        if len(self._times) == 1:
            self._choose()
        counts = {len(values) for pair in self._series.values() for values in pair}
        whole, states = min(counts, default=0), len(self._times)
        if not to_the_end or whole < states - 1 or max(counts, default=0) > states:
            expected, found = "rows with all values of each node", f"one that cannot be read after state {whole}"
            raise DataError(Problem(self._where, expected, found, "copy it again from the run"))
        if not whole:
            expected = "the velocities and accelerations of nodes (x-vel, x-accl …)"
            raise DataError(Problem(self._where, expected, "none", "choose the nodout of a run"))
        time = np.array(self._times[:whole])
        return Histories(
            title,
            tuple(
                History(name, self._titles.get(name, ""), time, np.array(accel[:whole]), np.array(velocity[:whole]))
                for name, (accel, velocity) in self._series.items()
            ),
            len(self._first),
            self._start,
            self._fastest,
            notes=("Its last state is incomplete and left out.",) if whole < states else (),
        )

    def _begin_state(self) -> None:
        if len(self._times) == 1:
            self._choose()
        self._times.append(self._now)
        self._places = [self._columns.index(column) for column in (*_ACCELERATIONS, *_VELOCITIES)]
        if len(self._times) * max(len(self._series), 1) > MOST_VALUES:
            raise too_many_values(self._where)

    def _choose(self) -> None:
        if not self._first:
            return
        begin = np.array(list(self._first.values())).T
        self._start = begin[3:]
        self._at_rest = not self._start.any()
        self._fastest = np.abs(self._start).max(axis=1)
        axis = self._axis = axis_of_travel(self._start, self._travel)
        kept = nodes_to_keep(list(self._first), self._titles, self._most)
        self._series = {
            name: (array("d", [values[axis]]), array("d", [values[3 + axis]]))
            for name, values in self._first.items()
            if name in kept
        }

    def _take_row(self, name: str, rest: bytes) -> bool:
        first = len(self._times) == 1 and len(self._first) < MOST_NODES
        if not first and name not in self._series:
            return True
        values = _NUMBER.findall(rest)
        if len(values) != len(self._columns):
            return False
        if first and name in self._first:
            return False
        if first:
            self._first[name] = [number(values[place].decode(), self._where) for place in self._places]
            return True
        for into, place in zip(self._series[name], self._places[self._axis :: 3], strict=True):
            into.append(number(values[place].decode(), self._where))
        if self._at_rest:  # how fast it gets says why it is no vehicle
            speeds = [abs(number(values[place].decode(), self._where)) for place in self._places[3:]]
            self._fastest = np.maximum(self._fastest, speeds)
        return True
