"""Histories of nodes and energies of an LS-DYNA run, and its ASCII files: ``nodout``, ``glstat`` and ``matsum``.

Names and layout are those of the solver's own converter from binout to text. Hourglass energy is computed only if the
model asks for it (HGEN = 2 in *CONTROL_ENERGY): zero throughout counts as not recorded.
"""

import re
from array import array
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from crashfuse.cae_library import QUALITIES, RunQuality
from crashfuse.errors import printable, refusal, refuse_if
from crashfuse.readers.members import COPY_AGAIN
from crashfuse.readers.solver_run import CUT, STAMP, History, axis_of_travel, departure_time, quality_by_histories
from crashfuse.readers.vocabulary import AXES, Travel, iso_date
from crashfuse.signals.pulse import FloatArray

MOST_NODES = 200_000  # listed in a file
MOST_VALUES = 20_000_000  # states times nodes kept per run
_MOST_STATES = 1_000_000
_LONGEST_LINE = 1 << 16

# variables of a state in a binout, of each part and of the whole model
MATSUM = frozenset({"time", "internal_energy", "hourglass_energy"})
GLSTAT = MATSUM | {"kinetic_energy", "total_energy", "external_work", "percent_increase"}

_ENERGY = re.compile(rb"([a-z/ ]*[a-z]) *(?:\.{2,}|=) *([-+.\dEeDd]+)")
_AS_TEXT = {"percentage increase": "percent_increase", "inten": "internal_energy", "hgeng": "hourglass_energy"}
_AS_TEXT |= {name.replace("_", " "): name for name in GLSTAT if name.endswith(("energy", "work"))}

States = dict[float, dict[str, float]]  # values by name, by the time of the state

_NO_EXPONENT_LETTER = re.compile(r"(?<=[\d.])([-+])")  # as Fortran writes exponents of three digits: 1.2-103
_LONGEST_ID = 19  # digits
_STATE_TIME = re.compile(rb"at time\s*([-+.\dEeDd]+)")
_ROW = re.compile(rb"\s*(\d+)(?=[\s+-]|$)(.*)", re.DOTALL)  # a negative number may directly follow the node number
_NUMBER = re.compile(rb"[-+]?\d+\.\d*(?:[EeDd][-+]?\d+|[-+]\d+)?")
_WANTED = [f"{axis}-{kind}".encode() for kind in ("accl", "vel") for axis in AXES]


@dataclass(frozen=True, eq=False, slots=True)
class Histories:
    """Nodal histories of a run."""

    title: str
    nodes: tuple[History, ...]
    total: int  # nodes in the files
    start: FloatArray = field(default_factory=lambda: np.zeros((3, 1)))  # velocities at the first state, (3, n_nodes)
    fastest: FloatArray = field(default_factory=lambda: np.zeros(3))  # of any node along each axis
    notes: tuple[str, ...] = ()  # what was joined or left out
    is_cut: bool = False  # to begin where velocities are set
    about: Mapping[str, str] = field(default_factory=dict)  # version and date
    walls: States = field(default_factory=dict)  # forces of all rigid walls together

    def since_departure(self, travel: Travel | None, start: Callable[[float], FloatArray]) -> "Histories":
        """From where a velocity is set, if so; ``start`` gives velocities then, shape (3, n_nodes)."""
        nodes = [node for node in self.nodes if node.name.isdecimal()] or list(self.nodes)
        if not nodes or (time := departure_time(nodes, travel)) <= nodes[0].time[0]:
            return self
        note = f"Nodes rest until {time:.4g} in the time of the run, where their velocity is set: read from there on."
        cut = tuple(node.since(time) for node in self.nodes if node.time[-1] > time)
        return replace(self, nodes=cut, start=start(time), notes=(*self.notes, note), is_cut=True)


def latest(times: Sequence[float]) -> list[int]:
    """Places of states as written, of those that a restart repeats the later."""
    places: list[int] = []
    for place, time in enumerate(times):
        while places and times[places[-1]] >= time:
            places.pop()
        places += [place] if np.isfinite(time) else []
    return places


def add_state(states: States, time: float, values: dict[str, float]) -> dict[str, float]:
    """Add a state as written, in the place of those that a restart repeats."""
    while states and time <= next(reversed(states)):
        states.popitem()
    states[time] = values
    return values


def nodes_to_keep(names: Sequence[str], titles: Mapping[str, str], most: int) -> set[str]:
    """Those with a title first."""
    return set(sorted(names, key=lambda name: not titles.get(name))[:most])


def check_count(values: int, where: str) -> None:
    """Raise a DataError for more values than are kept per run."""
    expected, advice = f"at most {MOST_VALUES:,} states times nodes", "write fewer (*DATABASE_HISTORY_NODE)"
    refuse_if(values > MOST_VALUES, where, expected, "more", advice)


def _lines_of(chunks: Iterable[bytes], where: str) -> Iterator[bytes]:
    rest = b""
    for chunk in chunks:
        *whole, rest = (rest + chunk).split(b"\n")
        yield from whole
        refuse_if(len(rest) > _LONGEST_LINE, where, "lines of text", "one without end", f"choose the {where} of a run")
    yield rest


def _number(cell: bytes, where: str) -> float:
    plain = cell.decode("latin-1").upper().replace("D", "E")
    try:
        return float(plain if "E" in plain else _NO_EXPONENT_LETTER.sub(r"E\1", plain))
    except ValueError:
        raise refusal(where, "numbers", repr(printable(cell.decode("latin-1"), 40)), COPY_AGAIN) from None


def energies_text(chunks: Iterable[bytes], where: str) -> States:
    """The states of a ``glstat`` as text, or of a ``matsum``, summed over the parts."""
    states: States = {}
    now: dict[str, float] = defaultdict(float)
    for line in _lines_of(chunks, where):
        for label, number in _ENERGY.findall(line):
            name = label.decode().strip()
            if name == "time" and len(states) < _MOST_STATES:
                now = add_state(states, _number(number, where), defaultdict(float))
            elif name in _AS_TEXT:
                now[_AS_TEXT[name]] += _number(number, where)
    return states


def quality_of(glstat: States, matsum: States) -> RunQuality:
    """The quality of a run; what ``glstat`` lacks is taken from ``matsum``."""
    names = "total_energy", "external_work"  # a killed run's last state lacks some
    both = {time: state for time, state in glstat.items() if set(names) <= state.keys()}
    total, work = (_column(both, name) for name in names)
    whole = quality_by_histories(total, work, *_strain(glstat), _column(glstat, "percent_increase"))
    parts = quality_by_histories(None, None, *_strain(matsum))
    return RunQuality(*(getattr(parts if getattr(whole, name) is None else whole, name) for name in QUALITIES))


def _strain(states: States) -> tuple[FloatArray | None, FloatArray | None]:
    hourglass = _column(states, "hourglass_energy")
    return _column(states, "internal_energy"), hourglass if hourglass is not None and hourglass.any() else None


def _column(states: States, name: str) -> FloatArray | None:
    values = [state[name] for _, state in sorted(states.items()) if name in state]
    return np.array(values) if values else None


def read_nodout(chunks: Iterable[bytes], where: str, most: int, travel: Travel | None) -> Histories:
    """Read the translation of at most so many nodes from an ASCII ``nodout`` as a stream."""
    reader, lines = _Nodout(where, most, travel), _lines_of(chunks, where)
    first, second = next(lines, b""), next(lines, b"")
    for line in chain([second], lines):
        reader.take(line)
    stamp = STAMP.search(b"\n".join((first, second)).decode("latin-1"))
    about = {"version": stamp[2], "date": iso_date(stamp[3], "%m/%d/%Y")} if stamp else {}
    return replace(reader.histories(printable(first.decode("latin-1").strip())), about=about)


class _Nodout:
    def __init__(self, where: str, most: int, travel: Travel | None) -> None:
        self._where, self._most, self._travel = where, most, travel
        self._titles: dict[str, str] = {}
        self._in_legend, self._now = False, np.nan
        self._times: list[float] = []
        self._width = 0  # of the rows of this table; 0 if none is wanted of it
        self._places: list[int] = []  # of accelerations and velocities in a row
        self._first: dict[str, list[float]] = {}
        self._start = np.zeros((3, 0))
        self._series: dict[str, array[float]] = {}  # three accelerations and three velocities a state
        self._unread = False  # a row of the last state was cut short or cannot be read
        self._notes: list[str] = []

    def take(self, line: bytes) -> None:
        if line.startswith(b"{"):
            self._in_legend = b"BEGIN" in line
        elif self._in_legend:
            node, _, text = line.decode("latin-1").strip().partition(" ")
            if node.isdecimal() and len(node) <= _LONGEST_ID and len(self._titles) < MOST_NODES:
                self._titles[str(int(node))] = printable(text.strip())
        elif b"at time" in line and (header := _STATE_TIME.search(line)) is not None:
            self._width, self._now = 0, _number(header.group(1), self._where)
        elif b"nodal point" in line:
            columns = line.split()[2:]
            self._width = len(columns) if set(_WANTED) <= set(columns) else 0  # not the table of nodal rotations
            if self._width:
                self._begin_state(columns)
        elif self._width and (row := _ROW.match(line)) is not None:
            self._refuse_if(self._unread)
            self._unread = not self._take_row(row.group(1).decode("latin-1"), row.group(2))

    def _refuse_if(self, wrong: bool) -> None:
        whole = min((len(values) for values in self._series.values()), default=0) // 6 if wrong else 0
        refuse_if(wrong, self._where, "whole rows", f"damage after state {whole}", COPY_AGAIN)

    def histories(self, title: str) -> Histories:
        self._choose()
        counts = {len(values) // 6 for values in self._series.values()}
        whole, states = min(counts, default=0), len(self._times)
        self._refuse_if(whole < states - 1 or max(counts, default=0) > states)
        expected = "velocities and accelerations (x-vel, x-accl)"
        refuse_if(not whole, self._where, expected, "none", "choose the nodout of a run")
        time, values = np.array(self._times[:whole]), np.array([of[: 6 * whole] for of in self._series.values()])
        values = values.reshape(-1, whole, 2, 3).transpose(2, 3, 0, 1)  # acceleration first; axes, nodes, states
        fastest = np.maximum(np.abs(self._start).max(axis=1), np.abs(values[1]).max(axis=(1, 2)))
        along = values[:, axis_of_travel(self._start, self._travel, fastest)]
        rows = zip(self._series, *along, strict=True)
        nodes = tuple(History(name, self._titles.get(name, ""), time, *curves) for name, *curves in rows)
        notes = (*self._notes, *[CUT] * (whole < states))
        run = Histories(title, nodes, len(self._first), self._start, fastest, notes)
        return run.since_departure(self._travel, lambda begin: values[1][..., int(np.searchsorted(time, begin))])

    def _rewind(self) -> None:
        place = bisect_left(self._times, self._now)
        refuse_if(not place, self._where, "one run", f"another, which begins at {self._now:.4g}", "split the file")
        self._notes.append(f"A restart repeats the states from {self._now:.4g} on: the later ones are read.")
        del self._times[place:]
        for values in self._series.values():
            del values[6 * place :]
        self._unread = False

    def _begin_state(self, columns: list[bytes]) -> None:
        self._choose()
        if self._times and self._now <= self._times[-1]:
            self._rewind()
        self._refuse_if(self._unread)
        self._times.append(self._now)
        self._places = [columns.index(column) for column in _WANTED]
        check_count(3 * len(self._times) * max(len(self._series), 1), self._where)

    def _choose(self) -> None:
        if len(self._times) != 1 or not self._first:
            return
        self._start = np.array(list(self._first.values())).T[3:]
        kept = nodes_to_keep(list(self._first), self._titles, self._most)
        self._series = {name: array("d", values) for name, values in self._first.items() if name in kept}

    def _take_row(self, name: str, rest: bytes) -> bool:
        first = len(self._times) == 1 and len(self._first) < MOST_NODES
        if not first and name not in self._series:
            return True
        cells = _NUMBER.findall(rest)
        if len(cells) != self._width or (first and name in self._first):
            return False
        values = [_number(cells[place], self._where) for place in self._places]
        (self._first.setdefault(name, []) if first else self._series[name]).extend(values)
        return True
