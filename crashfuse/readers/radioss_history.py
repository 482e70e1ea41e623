"""A time history of Radioss, whichever form it comes in, and the record that is made of it.

Columns of nodes that the file does not name are told apart by the run's initial velocity and by what is whose integral.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from crashfuse.cae_library import RunQuality
from crashfuse.campaign_folder.condition_tables import listed
from crashfuse.errors import DataError, Problem, refuse_if
from crashfuse.readers import solver_run
from crashfuse.readers.record import Record
from crashfuse.readers.solver_run import FASTEST_MPS, LONGEST_S, History, Units
from crashfuse.readers.vocabulary import AXES, RADIOSS, Travel
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MS

GLOBAL = RADIOSS["global"]
"""The global histories in the order of their codes, 1 first, as the solver's converter calls them."""

MOST_VALUES = 40_000_000  # states times values kept of a file
ACCELEROMETER = "accelerometer "  # what the names of accelerometers begin with; those of nodes are numbers

_LEAST_CHANGE, _MOST_CHANGE = 0.8, 1.6  # ΔV of a vehicle that stops, as a multiple of its initial velocity
_STEPS = 5.5  # of output: a longer gap between two parts of a run is one
_LARGEST_SHARE = 1e-3  # of a momentum, below which a direction counts as none
_SAME_VELOCITY = 1e-3  # of the initial velocity
_INTEGRAL, _ALIASED = 0.02, 0.05  # of the range of a displacement, of a velocity
_NEAR = 0.75  # of the initial velocity: how far a part of a vehicle is from its centre of gravity
_ALIKE = 0.9  # correlation of an impulse with the velocity
_SAME = 0.01  # of the initial velocity, or of a mass
_SYSTEMS = {(1e-3, 1e-3): (MS, "mm/ms²"), (1e-3, 1.0): (1.0, "mm/s²"), (1.0, 1.0): (1.0, "m/s²")}
_MOST_NODES = 200  # offered as channels


@dataclass(frozen=True, eq=False, slots=True)
class Watched:
    """What was written of one node or accelerometer at each time, shape (n,).

    Curves have Radioss's names: ``DX``, ``VX``, ``AX``, of an accelerometer the integral ``WX`` of its acceleration;
    ``var 33`` where the file does not name them.
    """

    name: str  # its number; accelerometer 9 for an accelerometer
    title: str
    time: FloatArray
    curves: Mapping[str, FloatArray]

    @property
    def is_accelerometer(self) -> bool:
        """Whether it measures in a skew of its own."""
        return self.name.startswith(ACCELEROMETER)


@dataclass(frozen=True, eq=False, slots=True)
class TimeHistory:
    """What a time history tells of a crash, in the units of the run."""

    title: str
    time: FloatArray
    model: Mapping[str, FloatArray]  # those of GLOBAL that were written, shape (n,)
    watched: tuple[Watched, ...]  # nodes and accelerometers
    unread: tuple[str, ...] = ()  # what else the file holds, for display: rigid walls, sections …
    unit_factors: tuple[float, ...] = ()  # to SI, of mass, length and time
    notes: tuple[str, ...] = ()  # what was joined, aligned or left out
    about: Mapping[str, str] = field(default_factory=lambda: {"solver": "Radioss"})
    walls: Mapping[str, FloatArray] = field(default_factory=dict)  # impulses of all rigid walls along X, Y, Z

    @property
    def quality(self) -> RunQuality:
        """The quality of the run; Radioss always computes hourglass energy."""
        names = ("INTERNAL", "KINETIC", "ROTATION", "CONTACT", "HOURGLASS")
        energies = {name: of for name in names if (of := self.model.get(f"{name} ENERGY")) is not None}
        total = np.sum([*energies.values()], axis=0) if {"INTERNAL", "KINETIC"} <= energies.keys() else None
        work, added = self.model.get("EXTERNAL WORK"), self.model.get("PERCENTAGE ADDED MASS")
        internal, hourglass = energies.get("INTERNAL"), energies.get("HOURGLASS")
        return solver_run.quality_by_histories(total, work, internal, hourglass, added)

    @property
    def initial_velocity(self) -> FloatArray | None:
        """Of all that moves, along X, Y, Z, shape (3,): twice the kinetic energy over the momentum."""
        needed = ("KINETIC ENERGY", *(f"{axis}-MOMENTUM" for axis in "XYZ"))
        if any(name not in self.model or not self.model[name].size for name in needed):
            return None
        kinetic, *momentum = (float(self.model[name][0]) for name in needed)
        size = float(np.linalg.norm(momentum))
        if kinetic and not (np.isfinite([kinetic, size]).all() and size > 0 and kinetic > 0):
            return None
        velocity = 2 * kinetic * np.array(momentum) / size**2 if kinetic else np.zeros(3)
        return np.where(np.abs(velocity) > _LARGEST_SHARE * np.abs(velocity).max(), velocity, 0.0)


def join_parts(parts: Sequence[TimeHistory], names: Sequence[str]) -> TimeHistory:
    """A run that was stopped and restarted; a later part replaces what it computed anew."""
    whole = parts[0]
    for part, name in zip(parts[1:], names[1:], strict=True):
        first, second = ([(one.name, *one.curves) for one in of.watched] for of in (whole, part))
        refuse_if(first != second, name, f"nodes as in {names[0]}", "others", solver_run.KEEP_APART)
        start = float(part.time[0])
        early = whole.time < start
        last = whole.time[early][-3:]
        gap = not last.size or start - last[-1] > _STEPS * np.diff(last).max(initial=0.0 if last.size > 1 else np.inf)
        expected = f"states from {last[-1]:g} on" if last.size else "states after those before it"
        refuse_if(gap, name, expected, f"the first at {start:g}", "add the missing file")
        watched = []
        for one, later in zip(whole.watched, part.watched, strict=True):
            kept = one.time < start
            curves = {key: np.concatenate([of[kept], later.curves[key]]) for key, of in one.curves.items()}
            watched.append(replace(one, time=np.concatenate([one.time[kept], later.time]), curves=curves))
        both = whole.model.keys() & part.model.keys()
        model = {key: np.concatenate([of[early], part.model[key]]) for key, of in whole.model.items() if key in both}
        time, notes = np.concatenate([whole.time[early], part.time]), dict.fromkeys((*whole.notes, *part.notes))
        # impulses of walls may be counted anew
        whole = replace(whole, time=time, model=model, watched=tuple(watched), notes=tuple(notes), walls={})
    joined = (f"Joined from {', '.join(names)}.",) * (len(parts) > 1)
    return replace(whole, notes=(*joined, *whole.notes))


def join_files(histories: Sequence[TimeHistory]) -> TimeHistory:
    """The main file of a run with the nodes of its additional ones (``T01a`` …)."""
    return replace(
        histories[0],
        model=next((history.model for history in histories if history.model), {}),
        watched=tuple({one.name: one for history in reversed(histories) for one in history.watched}.values()),
        unread=tuple(dict.fromkeys(name for history in histories for name in history.unread)),
        unit_factors=next((history.unit_factors for history in histories if history.unit_factors), ()),
        notes=tuple(dict.fromkeys(note for history in histories for note in history.notes)),
    )


def with_names(history: TimeHistory) -> TimeHistory:
    """Name the curves that have no names; those that cannot be told go unread."""
    watched, unread, notes = [], list(history.unread), dict.fromkeys(history.notes)
    for one in history.watched:
        if not any(name.startswith("var ") for name in one.curves):
            watched.append(one)
        elif curves := _named(history, one):
            notes["Unnamed variables are told by initial velocity and integrals."] = None
            is_node = any(name.startswith("V") for name in curves)
            watched.append(replace(one, name=one.name if is_node else f"{ACCELEROMETER}{one.name}", curves=curves))
        else:
            unread.append(f"unnamed columns of {one.title or 'node'} ({one.name})")
    return replace(history, watched=tuple(watched), unread=tuple(unread), notes=tuple(notes))


def _named(history: TimeHistory, one: Watched) -> dict[str, FloatArray]:
    """Empty in doubt."""
    initial = history.initial_velocity
    if initial is None or np.count_nonzero(initial) != 1:
        return {}
    axis = int(np.abs(initial).argmax())
    speed, letter = float(initial[axis]), "XYZ"[axis]
    momentum = history.model[f"{letter}-MOMENTUM"]
    time, columns = one.time, list(one.curves.values())
    if not np.isfinite([*map(np.sum, columns), momentum.sum(), momentum[0]]).all() or not momentum[0]:
        return {}
    vehicle = np.interp(time, history.time, momentum / momentum[0] * speed)  # the centre of gravity of what moves
    alive = [column for column in columns if np.ptp(column) > 0]
    starts = [abs(column[0] - speed) <= _SAME_VELOCITY * abs(speed) for column in alive]
    near = [np.abs(column - vehicle).max() <= _NEAR * abs(speed) for column in alive]
    velocities = np.flatnonzero(np.logical_and(starts, near)).tolist()
    if not velocities:
        stopping = [column for column in alive if _stops(column, vehicle, time)]
        return {f"A{letter}": stopping[0]} if len(stopping) == 1 else {}
    place, velocity = velocities[0], alive[velocities[0]]
    if len(velocities) > 1:
        return {}
    found = {f"V{letter}": velocity}
    travel = solver_run.integral(velocity, time)
    for before in alive[:place]:
        if np.abs(before - before[0] - travel).max() <= _INTEGRAL * np.ptp(travel):
            found[f"D{letter}"] = before
    for after in alive[place + 1 :]:
        if np.abs(solver_run.integral(after, time) - (velocity - velocity[0])).max() <= _ALIASED * np.ptp(velocity):
            found[f"A{letter}"] = after
    return found


def _stops(acceleration: FloatArray, vehicle: FloatArray, time: FloatArray) -> bool:
    """The impulse of a force grows as the velocity falls; an acceleration does not."""
    if np.ptp(vehicle) > 0 and abs(np.corrcoef(acceleration, vehicle)[0, 1]) > _ALIKE:
        return False
    speed, change = vehicle[0], solver_run.integral(acceleration, time)
    change = -change if change[-1] * speed > 0 else change
    largest = float(-(change / speed).min())
    near = bool(np.abs(speed + change - vehicle).max() <= _NEAR * abs(speed))
    return near and _LEAST_CHANGE <= largest <= _MOST_CHANGE


def record_of(run: TimeHistory, run_id: str, source: str, travel: Travel | None) -> Record:
    """The record of a run; a DataError if nothing in it tells a pulse."""
    start, fastest = _motion(run)
    axis = solver_run.axis_of_travel(start, travel)
    initial = run.initial_velocity
    nodes = [node for one in run.watched if (node := _along(one, axis, initial)) is not None]
    if not nodes:
        raise DataError(_no_node(run, axis, source))
    proposed, why = _proposed(nodes, initial)
    chosen = proposed or nodes
    set_out = solver_run.initial_speed(chosen)  # in the units of the run
    mass, mass_of = _mass(run, set_out)
    units = _units(run, chosen, source)
    steps = [f"Radioss run{f', {run.title}' if run.title else ''}.", *run.notes, units[2]]
    speed_mps, no_speed = None, "accelerometers alone, without an initial velocity"
    if np.isfinite(set_out):
        speed_mps, no_speed, travels = solver_run.departure(chosen, units, (start, fastest), travel, source)
        steps.append(travels)
    steps.append(why)
    if run.unread:
        steps.append(f"Not read: {listed(run.unread)}.")
    is_none = mass is not None and solver_run.mass_unit_kg(mass, units[1] or "m/s²") is None
    found = f"{mass:.4g}" if mass is not None else ""
    refuse_if(is_none, source, "a vehicle of 300 kg to 60 t", found, "choose another run")
    kept = sorted(nodes, key=lambda node: (node not in proposed, not node.title))[:_MOST_NODES]
    steps += solver_run.note_of_kept(len(kept), len(nodes))
    impulse = run.walls.get("XYZ"[axis])  # walls are written as impulses, not as forces
    wall = None if impulse is None or run.time.size < 2 else (run.time, np.gradient(impulse, run.time))
    known = (speed_mps, no_speed), (mass, mass_of), run.quality, steps, run.about, wall
    return solver_run.run_record(run_id, source, kept, proposed, units, *known)


def _motion(run: TimeHistory) -> tuple[FloatArray, FloatArray]:
    """Velocities at the start, shape (3, n_nodes), and the largest along each axis, (3,)."""
    names = [f"V{letter}" for letter in "XYZ"]
    rows = [[one.curves.get(name, np.zeros(1)) for name in names] for one in run.watched if {*names} & {*one.curves}]
    if not rows:
        initial = run.initial_velocity
        rows = [[np.zeros(1)] * 3 if initial is None else list(initial[:, None])]
    start = np.array([[of[0] for of in row] for row in rows]).T
    return start, np.max([[np.abs(of).max() for of in row] for row in rows], axis=0)


def _along(one: Watched, axis: int, initial: FloatArray | None) -> History | None:
    """An accelerometer has its own skew: read is the direction of largest ΔV."""
    accel, velocity = (one.curves.get(f"{kind}{'XYZ'[axis]}") for kind in "AV")
    if one.is_accelerometer:
        accelerations = [of for name, of in one.curves.items() if name[0] == "A"]
        accel = max(accelerations, key=lambda of: float(np.abs(solver_run.integral(of, one.time)).max()), default=None)
    unknown = np.full(one.time.size, np.nan)
    if velocity is not None and accel is None:
        accel = np.gradient(velocity, one.time) if one.time.size > 1 else unknown
    if accel is None:
        return None
    if velocity is None and initial is not None:
        change = solver_run.integral(accel, one.time)
        speeds_up = change[np.abs(change).argmax()] * initial[axis] > 0
        turned = -1.0 if one.is_accelerometer and speeds_up else 1.0
        accel, velocity = turned * accel, initial[axis] + turned * change
    return History(one.name, one.title, one.time, accel, unknown if velocity is None else velocity)


def _proposed(nodes: Sequence[History], initial: FloatArray | None) -> tuple[list[History], str]:
    stopping = [node for node in nodes if _may_be_the_pulse(node, initial)]
    if not stopping:
        return [], "No accelerometer's ΔV is that of a vehicle that stops; are its columns crossed?"
    if titled := solver_run.titled_nodes(stopping):
        return titled
    node = max([node for node in stopping if not solver_run.is_on_a_dummy(node)] or stopping, key=_behind)
    name = node.name.capitalize() if node.name.startswith(ACCELEROMETER) else f"Node {node.name}"
    left = f"; {len(nodes) - len(stopping)} left out, whose ΔV is no vehicle's" if len(stopping) < len(nodes) else ""
    return [node], f"{name} of {len(nodes)} stops last and rebounds least, as behind the crush{left}."


def _may_be_the_pulse(node: History, initial: FloatArray | None) -> bool:
    """Crossed columns of an accelerometer do not stop as a vehicle does."""
    if not node.name.startswith(ACCELEROMETER) or initial is None or not initial.any():
        return True
    change, at_start = float(np.abs(node.velocity - node.velocity[0]).max()), float(np.abs(node.velocity[0]))
    return _LEAST_CHANGE * at_start <= change <= _MOST_CHANGE * at_start


def _behind(node: History) -> tuple[float, float]:
    forward = node.velocity * np.sign(node.velocity[0])
    stopped = np.flatnonzero(forward <= 0)
    late = float(node.time[stopped[0]] if stopped.size else 2 * node.time[-1])
    return late, float(forward.min()) if np.isfinite(forward).all() else -np.inf


def _units(run: TimeHistory, nodes: Sequence[History], source: str) -> Units:
    if run.unit_factors:
        _, length, second = run.unit_factors
        stated = (system for factors, system in _SYSTEMS.items() if np.allclose(factors, (length, second), rtol=1e-3))
        system = next(stated, None)
        fastest = max(float(np.nan_to_num(np.abs(node.velocity)).max()) for node in nodes) * length / second
        lasts = float(nodes[0].time[-1]) * second
        if system is not None and 0 < lasts <= LONGEST_S and fastest <= FASTEST_MPS:
            return *system, f"Unit {system[1]}, as the run states its units."
    return solver_run.units_of(nodes, source)


def _mass(run: TimeHistory, set_out: float) -> tuple[float | None, str]:
    total = run.model.get("MASS")
    if total is None or not total.size or not np.isfinite(total[0]):
        return None, ""
    mass, what, initial = float(total[0]), "of the whole model at the start", run.initial_velocity
    if initial is not None and initial.any():
        at_start = float(np.linalg.norm(initial))
        moving = 2 * float(run.model["KINETIC ENERGY"][0]) / at_start**2
        # else something moves otherwise
        if abs(set_out - at_start) <= _SAME * at_start and moving < (1 - _SAME) * mass:
            mass, what = moving, f"of what moves at the start (2 × kinetic energy / speed²), of {mass:.5g} in all"
    return mass, what


def _no_node(run: TimeHistory, axis: int, source: str) -> Problem:
    letter = AXES[axis].upper()
    found = listed(sorted({name for one in run.watched for name in one.curves}) or run.unread) or "none"
    if not run.watched and run.initial_velocity is not None and not run.initial_velocity.any():
        found = "a model at rest when the run begins"
    advice = f"import the T01 itself, or ask for V{letter} and A{letter} of the node (/TH/NODE, /TH/TITLE)"
    return Problem(source, f"velocities or accelerations along {AXES[axis]}, or accelerometers", found, advice)
