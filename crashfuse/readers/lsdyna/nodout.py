"""Histories of nodes in LS-DYNA's ASCII ``nodout``."""

import re
from array import array
from collections.abc import Iterable

import numpy as np

from crashfuse.errors import DataError, Problem, printable
from crashfuse.readers.axes import AXES, Travel
from crashfuse.readers.lsdyna.histories import MOST_NODES, MOST_VALUES, Histories, History, kept_of, too_much
from crashfuse.readers.lsdyna.text import lines_of, number
from crashfuse.readers.travel import axis_of_travel

_LONGEST_ID = 19  # digits
_TIME = re.compile(rb"at time\s*([-+.\dEeDd]+)")
_ROW = re.compile(rb"\s*(\d+)(?=[\s+-]|$)(.*)", re.DOTALL)  # a negative number may directly follow the node number
_NUMBER = re.compile(rb"[-+]?\d+\.\d*(?:[EeDd][-+]?\d+|[-+]\d+)?")
_ACCELERATIONS = [f"{axis}-accl".encode() for axis in AXES]
_VELOCITIES = [f"{axis}-vel".encode() for axis in AXES]


def read_nodout(chunks: Iterable[bytes], where: str, most: int, travel: Travel | None) -> Histories:
    """Read an ASCII ``nodout`` as a stream; everything but the nodes' translation is skipped.

    If there are more than ``most`` nodes, those with a title are kept first. An unreadable row raises a DataError.
    """
    reader = _Nodout(where, most, travel)
    lines = lines_of(chunks, where)
    title = printable(next(lines, b"").decode("latin-1").strip())
    whole = all(map(reader.took, lines))
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

    def took(self, line: bytes) -> bool:
        """Read a line; False if it is a row that was cut short or cannot be read."""
        if line.startswith(b"{"):
            self._in_legend = b"BEGIN" in line
        elif self._in_legend:
            node, _, text = line.decode("latin-1").strip().partition(" ")
            if node.isdecimal() and len(node) <= _LONGEST_ID and len(self._titles) < MOST_NODES:
                self._titles[str(int(node))] = printable(text.strip())
        elif b"at time" in line and (header := _TIME.search(line)) is not None:
            self._columns, self._now = [], number(header.group(1).decode(), self._where)
        elif b"nodal point" in line:
            self._columns = line.split()[2:]
            if {*_ACCELERATIONS, *_VELOCITIES} <= set(self._columns):
                self._begin_state()
            else:
                self._columns = []  # table of nodal rotations
        elif self._columns and (row := _ROW.match(line)) is not None:
            return self._took_row(row.group(1).decode("latin-1"), row.group(2))
        return True

    def histories(self, title: str, *, to_the_end: bool) -> Histories:
        """The nodes of all whole states."""
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
            raise too_much(self._where)

    def _choose(self) -> None:
        """Choose axis and nodes, now that the first state is read."""
        if not self._first:
            return
        begin = np.array(list(self._first.values())).T
        self._start = begin[3:]
        self._at_rest = not self._start.any()
        self._fastest = np.abs(self._start).max(axis=1)
        axis = self._axis = axis_of_travel(self._start, self._travel)
        kept = kept_of(list(self._first), self._titles, self._most)
        self._series = {
            name: (array("d", [values[axis]]), array("d", [values[3 + axis]]))
            for name, values in self._first.items()
            if name in kept
        }

    def _took_row(self, name: str, rest: bytes) -> bool:
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
