"""The record of a Radioss run: its pulse, speed and mass, and what it says of its own quality."""

from collections.abc import Sequence

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.readers.axes import AXES, Travel
from crashfuse.readers.energies import quality_sentence
from crashfuse.readers.lsdyna.accelerometers import on_a_dummy, titled_nodes
from crashfuse.readers.lsdyna.histories import History, channel_of, integral, is_aliased
from crashfuse.readers.lsdyna.unit_system import FASTEST_MPS, LONGEST_S, of_a_vehicle, units_of
from crashfuse.readers.quantities import speed, weight
from crashfuse.readers.radioss.time_history import ACCELEROMETER, LEAST_CHANGE, MOST_CHANGE, TimeHistory, Watched
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.travel import axis_of_travel, checked_travel
from crashfuse.readers.unit_spelling import ACCELERATION_UNITS
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MS
from crashfuse.wording import Sentence

_SAME = 0.01  # of the initial velocity, or of a mass
_SYSTEMS = {(1e-3, 1e-3): (MS, "mm/ms²"), (1e-3, 1.0): (1.0, "mm/s²"), (1.0, 1.0): (1.0, "m/s²")}
_MOST_NODES = 200  # offered as channels


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
        raise _nothing(run, axis, source)
    proposed, why = _proposed(nodes, initial)
    chosen = proposed or nodes
    per_second, unit, units_told = _units(run, chosen, source)
    per_mps = None if unit is None else ACCELERATION_UNITS[unit] * per_second  # of a velocity
    steps = [f"Radioss run{f', {run.title}' if run.title else ''}.", *run.notes, units_told]
    own = float(np.median([abs(node.velocity[0]) for node in chosen]))
    moves, no_speed = True, "accelerometers alone, whose initial velocity the file does not tell"
    if np.isfinite(own):
        largest = max(float(np.nan_to_num(np.abs(node.velocity)).max()) for node in chosen)
        told, moves = checked_travel(start, (own, largest), fastest, per_mps, travel, source)
        steps.append(told)
        no_speed = f"a {units_told[0].lower()}{units_told[1:].rstrip('.')}"
    steps.append(why)
    if any(map(is_aliased, proposed)):
        steps.append("Accelerations that do not add up to the velocity are taken from the velocity.")
    speed_mps, (mass, mass_told) = None, _mass(run, own, source)
    if not moves:
        no_speed = f"nodes at rest along {AXES[axis]} at the start"
    elif per_mps is not None and np.isfinite(own):
        speed_mps, no_speed = own * per_mps, ""
        steps.append(Sentence("Speed {}, at which it sets out.", speed(speed_mps, form=".4g")))
    if mass is not None:
        steps.append(Sentence(f"Mass {{}}, {mass_told}.", weight(mass)))
    if run.unread:
        steps.append(f"Not read: {_listed(run.unread)}.")
    kept = sorted(nodes, key=lambda node: (node not in proposed, not node.title))[:_MOST_NODES]
    if len(kept) < len(nodes):
        steps.append(f"{len(kept)} of {len(nodes)} nodes are kept, those with a title first.")
    quality = run.energies.quality
    steps.append(quality_sentence(quality, "global histories"))
    return Record(
        run_id,
        source,
        PartialCondition(speed_mps, mass),
        tuple(channel_of(node, per_second, unit) for node in kept),
        tuple(node.name for node in proposed),
        tuple(steps),
        no_speed=no_speed,
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

    An accelerometer measures in a skew of its own: of its directions that with the largest ΔV is read, turned to where
    the vehicle travels.
    """
    letter = AXES[axis].upper()
    accel, velocity = one.curves.get(f"A{letter}"), one.curves.get(f"V{letter}")
    if one.is_accelerometer:
        accelerations = [of for name, of in one.curves.items() if name[0] == "A"]
        accel = max(accelerations, key=lambda of: float(np.abs(integral(of, one.time)).max()), default=None)
    if velocity is not None:
        if accel is None:
            accel = np.gradient(velocity, one.time) if one.time.size > 1 else np.full(one.time.size, np.nan)
        return History(one.name, one.title, one.time, accel, velocity)
    if accel is None:
        return None
    if initial is None:
        return History(one.name, one.title, one.time, accel, np.full(one.time.size, np.nan))
    change = integral(accel, one.time)
    speeds_up = change[np.abs(change).argmax()] * initial[axis] > 0
    turned = -1.0 if one.is_accelerometer and speeds_up else 1.0
    return History(one.name, one.title, one.time, turned * accel, initial[axis] + turned * change)


def _proposed(nodes: Sequence[History], initial: FloatArray | None) -> tuple[list[History], str]:
    """The nodes and accelerometers to average, and the reason: by their titles, else by how late they stop."""
    stopping = [node for node in nodes if _may_be_the_pulse(node, initial)]
    if not stopping:
        return [], "No accelerometer's ΔV is that of a vehicle that stops; are its columns crossed?"
    if titled := titled_nodes(stopping):
        return titled
    node = max([node for node in stopping if not on_a_dummy(node)] or stopping, key=_behind)
    name = node.name if node.name.startswith(ACCELEROMETER) else f"node {node.name}"
    told = f"{name[0].upper()}{name[1:]}{f' ({node.title})' if node.title else ''}"
    if len(nodes) == 1:
        return [node], f"{told} is the only one: it is the pulse, wherever it is."
    left = f"; {len(nodes) - len(stopping)} left out, whose ΔV is no vehicle's" if len(stopping) < len(nodes) else ""
    return [node], f"{told} of {len(nodes)} stops last and rebounds least, as what lies behind the crush does{left}."


def _may_be_the_pulse(node: History, initial: FloatArray | None) -> bool:
    """Whether it moves with the vehicle; an accelerometer must also stop as one does, which crossed columns do not."""
    if not node.name.startswith(ACCELEROMETER) or initial is None or not initial.any():
        return True
    at_start = float(np.abs(node.velocity[0]))
    change = float(np.abs(node.velocity - node.velocity[0]).max())
    return LEAST_CHANGE * at_start <= change <= MOST_CHANGE * at_start


def _behind(node: History) -> tuple[float, float]:
    """How late a node stops, and how little it rebounds."""
    forward = node.velocity * np.sign(node.velocity[0])
    stopped = np.flatnonzero(forward <= 0)
    late = float(node.time[stopped[0]] if stopped.size else 2 * node.time[-1])
    return late, float(forward.min()) if np.isfinite(forward).all() else -np.inf


def _units(run: TimeHistory, nodes: Sequence[History], source: str) -> tuple[float, str | None, str]:
    """The unit of time in s, the unit of acceleration, and a sentence; those that the run states, if they can be."""
    if run.unit_factors is not None:
        _, length, second = run.unit_factors
        system = next((own for of, own in _SYSTEMS.items() if np.allclose(of, (length, second), rtol=1e-3)), None)
        fastest = max(float(np.nan_to_num(np.abs(node.velocity)).max()) for node in nodes) * length / second
        lasts = float(nodes[0].time[-1]) * second
        if system is not None and 0 < lasts <= LONGEST_S and fastest <= FASTEST_MPS:
            return *system, f"Unit {system[1]}, as the run states its units."
    return units_of(nodes, source)


def _mass(run: TimeHistory, own: float, source: str) -> tuple[float | None, str]:
    """The mass of what moves in kg, None if the run does not tell it; and what it is the mass of."""
    total = run.model.get("MASS")
    if total is None or not total.size or not np.isfinite(total[0]):
        return None, ""
    mass, what, initial = float(total[0]), "of the whole model at the start", run.initial_velocity
    if initial is not None and initial.any():
        at_start = float(np.linalg.norm(initial))
        moving = 2 * float(run.model["KINETIC ENERGY"][0]) / at_start**2
        if abs(own - at_start) <= _SAME * at_start and moving < (1 - _SAME) * mass:  # else something moves otherwise
            mass, what = moving, f"of what moves at the start (2 × kinetic energy / speed²), of {mass:.5g} in all"
    found = of_a_vehicle(np.array([mass]))
    if found is None:
        expected, told = "a vehicle of 300 kg to 60 t", f"a model of {mass:.4g}, which is none in t, kg or g"
        raise DataError(Problem(source, expected, told, "choose the run of a whole vehicle"))
    return found, what


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _nothing(run: TimeHistory, axis: int, source: str) -> DataError:
    """The error for a run of which nothing along the axis can be read."""
    letter = AXES[axis].upper()
    expected = f"velocities or accelerations of nodes along {AXES[axis]}, or accelerometers"
    advice = f"ask the solver for V{letter} and A{letter} of the node (/TH/NODE)"
    found = _listed(sorted({name for one in run.watched for name in one.curves}) or run.unread) or "none"
    if not run.watched and run.initial_velocity is not None and not run.initial_velocity.any():
        expected, found = "a model that sets out as a vehicle does", "one at rest when the run begins"
        advice = "choose the run of a vehicle, or the time history itself (T01)"
    elif not run.watched and run.unread:
        advice = "import the time history itself (T01), or ask the solver for titles (/TH/TITLE) and convert it again"
    return DataError(Problem(source, expected, found, advice))
