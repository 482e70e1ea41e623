"""Energies of an LS-DYNA run: ``glstat`` and ``matsum``, in a ``binout`` or as text beside it.

Names and layout are those of the solver's own converter from binout to text. Hourglass energy is computed only if the
model asks for it (HGEN = 2 in *CONTROL_ENERGY): zero throughout counts as not recorded.
"""

import re
from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from crashfuse.readers.energies import Energies, completed
from crashfuse.readers.lsdyna.lsda import LsdaFile
from crashfuse.readers.lsdyna.text import lines_of, number
from crashfuse.run_quality import RunQuality
from crashfuse.signals.pulse import FloatArray

GLSTAT = frozenset({"kinetic_energy", "total_energy", "external_work", "internal_energy", "hourglass_energy"})
GLSTAT |= {"percent_increase", "time"}
MATSUM = frozenset({"time", "internal_energy", "hourglass_energy"})
"""Variables of a state in a binout, of the whole model and of each part."""

_LINE = re.compile(rb" *([a-z/ ]*[a-z]) *\.{2,} *([-+.\dEeDd]+)")
_PART = re.compile(rb"(inten|hgeng)= *([-+.\dEeDd]+)")
_TIME = re.compile(rb" *time *= *([-+.\dEeDd]+)")
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


def states_of(file: LsdaFile, database: str) -> States:
    """The states of ``glstat`` or ``matsum`` in a binout; those of parts are summed."""
    states: States = {}
    for folder, names in file.folders.items():
        if folder[0] != database or (time := file.read(folder, "time")) is None or not time.size:
            continue
        values = {name: file.read(folder, name) for name in names if name != "time"}
        states[float(time[0])] = {
            name: float(value.sum(dtype=np.float64)) for name, value in values.items() if value is not None
        }
    return states


def glstat_text(chunks: Iterable[bytes], where: str) -> States:
    """The states of a ``glstat`` as text."""
    states: States = {}
    now: dict[str, float] = {}
    for line in lines_of(chunks, where):
        if (match := _LINE.match(line)) is None:
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
    for line in lines_of(chunks, where):
        if (match := _TIME.match(line)) is not None and len(states) < _MOST_STATES:
            now = states[number(match.group(1).decode(), where)] = defaultdict(float)
        for name, value in _PART.findall(line):
            now[_AS_TEXT[name.decode()]] += number(value.decode(), where)
    return states


def quality_of(glstat: States, matsum: States) -> RunQuality:
    """The quality of a run; what ``glstat`` lacks is taken from ``matsum``."""
    added = _column(glstat, "percent_increase")
    both = {time: state for time, state in glstat.items() if {"total_energy", "external_work"} <= state.keys()}
    total, work = _column(both, "total_energy"), _column(both, "external_work")  # a killed run's last state lacks some
    whole = Energies(total, work, *_strain(glstat), None if added is None else added / 100)
    return completed(whole.quality, Energies(None, None, *_strain(matsum)).quality)


def kinetic_energy(glstat: States) -> float | None:
    """The kinetic energy at the first state."""
    return glstat[min(glstat)].get("kinetic_energy") if glstat else None


def _strain(states: States) -> tuple[FloatArray | None, FloatArray | None]:
    """Internal and hourglass energy; the latter not if it is zero throughout."""
    hourglass = _column(states, "hourglass_energy")
    return _column(states, "internal_energy"), hourglass if hourglass is not None and hourglass.any() else None


def _column(states: States, name: str) -> FloatArray | None:
    """One history in order of time, of the states that have it; None if none has."""
    values = [state[name] for _, state in sorted(states.items()) if name in state]
    return np.array(values) if values else None
