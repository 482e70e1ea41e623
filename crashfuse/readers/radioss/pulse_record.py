"""The record of a Radioss run: its pulse, speed and mass, and what it says of its own quality."""

from collections.abc import Sequence

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.readers.energies import quality_sentence
from crashfuse.readers.lsdyna.histories import History, channel_of, integral, is_aliased
from crashfuse.readers.lsdyna.unit_system import of_a_vehicle, units_of
from crashfuse.readers.radioss.time_history import TimeHistory, Watched
from crashfuse.readers.record import ACCELERATION_UNITS, PartialCondition, Record
from crashfuse.readers.travel import AXES, Travel, axis_of_travel, checked_travel
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MS

_SAME = 0.01  # of the initial velocity, or of a mass
_LEAST, _MOST = 0.8, 1.6  # of the initial velocity: ΔV of a vehicle that stops
_SYSTEMS = {(1e-3, 1e-3): (MS, "mm/ms²"), (1e-3, 1.0): (1.0, "mm/s²"), (1.0, 1.0): (1.0, "m/s²")}
_LONGEST_S, _SLOWEST_MPS, _FASTEST_MPS = 2.0, 1.0, 100.0


def record_of(run: TimeHistory, run_id: str, source: str, travel: Travel | None) -> Record:
    """Make the record of a run.

    Raises
    ------
    DataError
        If nothing in it tells a pulse, or nothing travels as a vehicle does.
    """
    start, fastest = _motion(run)
    axis = axis_of_travel(start, travel)
    initial = run.initial_velocity
    nodes = [node for one in run.watched if (node := _along(one, axis, initial)) is not None]
    if not nodes:
        raise _nothing(run, source)
    stopping = [node for node in nodes if _may_be_the_pulse(node, initial)]
    node = max(stopping or nodes, key=_behind)
    per_second, unit, units_told = _units(run, node, source)
    per_mps = None if unit is None else ACCELERATION_UNITS[unit] * per_second  # of a velocity
    speeds = float(np.abs(node.velocity[0])), float(np.abs(node.velocity).max())
    travel_told, moves = checked_travel(start, speeds, fastest, per_mps, travel, source)
    speed = speeds[0] * per_mps if per_mps is not None and np.isfinite(speeds[0]) and moves else None
    mass, mass_told = _mass(run, node, per_mps)
    quality = run.energies.quality
    steps = [f"Radioss run{f', {run.title}' if run.title else ''}.", *run.notes, units_told, travel_told]
    steps.append(_why(node, nodes, stopping))
    if is_aliased(node):
        steps.append("Accelerations that do not add up to the node's velocity are taken from the velocity.")
    if speed is not None:
        steps.append(f"Speed {speed:.4g} m/s, at which it sets out.")
    if mass is not None:
        steps.append(mass_told)
    if run.unread:
        steps.append(f"Not read: {_listed(run.unread)} (Radioss writes impulses for forces).")
    steps.append(quality_sentence(quality, "global histories"))
    return Record(
        run_id,
        source,
        PartialCondition(speed, mass),
        tuple(channel_of(each, per_second, unit) for each in nodes),
        (node.name,) if stopping else (),
        tuple(steps),
        no_speed="" if speed is not None else f"a {units_told[0].lower()}{units_told[1:].rstrip('.')}",
        no_mass="" if mass is not None else mass_told,
        quality=quality,
    )


def _motion(run: TimeHistory) -> tuple[FloatArray, FloatArray]:
    """Velocities of all nodes when the run begins, shape (3, n_nodes), and the largest along each axis, shape (3,).

    If no velocity was written, those of all that moves, from energy and momentum.
    """
    letters = AXES.upper()
    velocities = [[one.curves.get(f"V{letter}") for letter in letters] for one in run.watched]
    known = [each for each in velocities if any(of is not None for of in each)]
    if not known:
        initial = run.initial_velocity
        start = np.zeros((3, 1)) if initial is None else initial[:, None]
        return start, np.abs(start).max(axis=1)
    start = np.array([[0.0 if of is None else of[0] for of in each] for each in known]).T
    fastest = np.array([[0.0 if of is None else np.abs(of).max() for of in each] for each in known])
    return start, fastest.max(axis=0)


def _along(one: Watched, axis: int, initial: FloatArray | None) -> History | None:
    """A node or accelerometer along the axis of travel; None if nothing was written of it.

    An accelerometer measures in its own skew, so of its directions the one with the largest ΔV is read.
    """
    letter = AXES[axis].upper()
    velocity = one.curves.get(f"V{letter}")
    if velocity is None and f"V{letter}" not in one.curves and any(name[0] in "DV" for name in one.curves):
        if (accel := one.curves.get(f"A{letter}")) is None:
            return None
        return History(one.name, one.title, one.time, accel, _from_acceleration(accel, one.time, axis, initial))
    if velocity is not None:
        accel = one.curves.get(f"A{letter}")
        if accel is None:
            accel = np.gradient(velocity, one.time) if one.time.size > 1 else np.full(one.time.size, np.nan)
        return History(one.name, one.title, one.time, accel, velocity)
    accelerations = [(of, name[1]) for name, of in one.curves.items() if name[0] == "A"]
    if not accelerations:
        return None
    accel, _ = max(accelerations, key=lambda each: (float(np.abs(integral(each[0], one.time)).max()), each[1]))
    return History(one.name, one.title, one.time, accel, _from_acceleration(accel, one.time, axis, initial))


def _from_acceleration(accel: FloatArray, time: FloatArray, axis: int, initial: FloatArray | None) -> FloatArray:
    """The velocity along the axis of what sets out with the model and is slowed down; all NaN if that is unknown."""
    if initial is None:
        return np.full(time.size, np.nan)
    change = integral(accel, time)
    largest = change[np.abs(change).argmax()] if change.size else 0.0
    return float(initial[axis]) * np.ones(time.size) + (change if largest * initial[axis] < 0 else -change)


def _may_be_the_pulse(node: History, initial: FloatArray | None) -> bool:
    """Whether it moves with the vehicle; an accelerometer must also stop as one does, which crossed columns do not."""
    if not node.name.startswith("accelerometer") or initial is None:
        return True
    speed = float(np.abs(node.velocity[0]))
    change = float(np.abs(node.velocity - node.velocity[0]).max())
    return _LEAST * speed <= change <= _MOST * speed


def _behind(node: History) -> tuple[int, float]:
    """How late a node stops, and how little it rebounds."""
    forward = node.velocity * np.sign(node.velocity[0])
    stopped = np.flatnonzero(forward <= 0)
    late = float(node.time[stopped[0]] if stopped.size else node.time[-1] * 2)
    return late, float(forward.min()) if np.isfinite(forward).all() else -np.inf


def _units(run: TimeHistory, node: History, source: str) -> tuple[float, str | None, str]:
    """The unit of time in s, the unit of acceleration, and a sentence; those that the run states, if they can be."""
    if run.unit_factors is not None:
        _, length, second = run.unit_factors
        system = next((own for of, own in _SYSTEMS.items() if np.allclose(of, (length, second), rtol=1e-3)), None)
        fastest = float(np.nanmax(np.abs(node.velocity), initial=0.0)) * length / second
        lasts = float(node.time[-1]) * second
        if system is not None and 0 < lasts <= _LONGEST_S and fastest <= _FASTEST_MPS:
            return *system, f"Unit {system[1]}, as the run states its units."
    return units_of([node], source)


def _mass(run: TimeHistory, node: History, per_mps: float | None) -> tuple[float | None, str]:
    """The mass of the vehicle, and a sentence; or None and why it is unknown."""
    total = run.model.get("MASS")
    initial = run.initial_velocity
    whole = None if total is None or not total.size or not np.isfinite(total[0]) else float(total[0])
    moving, what = whole, "of the whole model at the start"
    if initial is not None and whole is not None:
        speed = float(np.linalg.norm(initial))
        moves = 2 * float(run.model["KINETIC ENERGY"][0]) / speed**2
        if abs(abs(node.velocity[0]) - speed) <= _SAME * speed and moves < (1 - _SAME) * whole:
            moving, what = moves, f"of what moves at the start (2 × kinetic energy / speed²), of {whole:.5g} in all"
    if moving is None or per_mps is None:
        return None, ""
    mass = of_a_vehicle(np.array([moving]))
    if mass is None:
        return None, f"a model of {moving:.4g} in its unit of mass, which is no vehicle in t, kg or g"
    return mass, f"Mass {mass:.5g} kg, {what}."


def _why(node: History, nodes: Sequence[History], stopping: Sequence[History]) -> str:
    name = node.name if node.name.startswith("accelerometer") else f"node {node.name}"
    told = f"{name[0].upper()}{name[1:]}{f' ({node.title})' if node.title else ''}"
    if not stopping:
        return "No accelerometer's ΔV is that of a vehicle that stops; are its columns crossed?"
    if len(nodes) == 1:
        return f"{told} is the only one; choose its place with care."
    left = f"; {len(nodes) - len(stopping)} left out, whose ΔV is no vehicle's" if len(stopping) < len(nodes) else ""
    return f"{told} of {len(nodes)} stops last and rebounds least, as what lies behind the crush does{left}."


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _nothing(run: TimeHistory, source: str) -> DataError:
    expected = "velocities or accelerations of nodes, or accelerometers"
    kinetic = run.model.get("KINETIC ENERGY", np.ones(1))
    if not run.watched and kinetic[0] == 0:
        expected, found = "a model that sets out as a vehicle does", "one at rest when the run begins"
        return DataError(
            Problem(source, expected, found, "choose the run of a vehicle, or the time history itself (T01)")
        )
    if run.watched:
        names = sorted({name for one in run.watched for name in one.curves})
        found = f"of its nodes {_listed(names)}"
    else:
        found = f"{_listed(run.unread)}, whose variables it does not tell apart" if run.unread else "none"
    advice = "ask the solver for VX and AX of the node (/TH/NODE)"
    if not run.watched and run.unread:
        advice = "import the time history itself (T01), or ask the solver for titles (/TH/TITLE) and convert it again"
    return DataError(Problem(source, expected, found, advice))
