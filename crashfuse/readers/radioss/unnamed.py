"""Which of the unnamed columns of a node is which: told by the run's initial velocity and by what is whose integral."""

from dataclasses import replace

import numpy as np

from crashfuse.readers.lsdyna.histories import integral
from crashfuse.readers.radioss.time_history import ACCELEROMETER, LEAST_CHANGE, MOST_CHANGE, TimeHistory, Watched
from crashfuse.signals.pulse import FloatArray

_SAME = 1e-3  # of the initial velocity
_INTEGRAL, _ALIASED = 0.02, 0.05  # of the range of a displacement, of a velocity
_NEAR = 0.75  # of the initial velocity: how far a part of a vehicle is from its centre of gravity
_ALIKE = 0.9  # correlation of an impulse with the velocity


def with_names(history: TimeHistory) -> TimeHistory:
    """Name the curves of the nodes and accelerometers that have no names; those that cannot be told go unread."""
    watched, unread, guessed = [], list(history.unread), False
    for one in history.watched:
        if not any(name.startswith("var ") for name in one.curves):
            watched.append(one)
        elif curves := _named(history, one):
            guessed = True
            is_node = any(name.startswith("V") for name in curves)
            watched.append(replace(one, name=one.name if is_node else f"{ACCELEROMETER}{one.name}", curves=curves))
        else:
            unread.append(f"unnamed columns of {one.title or 'node'} ({one.name})")
    told = (
        "The file does not name the variables of its nodes; they are told by the run's initial velocity (twice the "
        "kinetic energy over the momentum) and by what is whose integral.",
    )
    notes = (*history.notes, *(told if guessed else ()))
    return replace(history, watched=tuple(watched), unread=tuple(unread), notes=notes)


def _named(history: TimeHistory, one: Watched) -> dict[str, FloatArray]:
    """The velocity of a node, its displacement and acceleration; or the acceleration of an accelerometer.

    The columns are in the order of Radioss's codes: of a node displacement before velocity before acceleration. Empty
    if they cannot be told apart without doubt, or the run sets out at rest or along no axis.
    """
    initial = history.initial_velocity
    if initial is None or np.count_nonzero(initial) != 1:
        return {}
    axis = int(np.abs(initial).argmax())
    speed, letter = float(initial[axis]), "XYZ"[axis]
    momentum = history.model[f"{letter}-MOMENTUM"]
    time, columns = one.time, list(one.curves.values())
    if not np.isfinite([*map(np.sum, columns), momentum.sum(), momentum[0]]).all() or not momentum[0]:
        return {}
    # velocity of the centre of gravity of what moves
    vehicle = np.interp(time, history.time, momentum / momentum[0] * speed)
    alive = [column for column in columns if np.ptp(column) > 0]
    velocities = [
        place
        for place, column in enumerate(alive)
        if abs(column[0] - speed) <= _SAME * abs(speed) and np.abs(column - vehicle).max() <= _NEAR * abs(speed)
    ]
    if len(velocities) == 1:
        place = velocities[0]
        velocity = alive[place]
        found = {f"V{letter}": velocity}
        travel = integral(velocity, time)
        for before in alive[:place]:
            if np.abs(before - before[0] - travel).max() <= _INTEGRAL * np.ptp(travel):
                found[f"D{letter}"] = before
        for after in alive[place + 1 :]:
            if np.abs(integral(after, time) - (velocity - velocity[0])).max() <= _ALIASED * np.ptp(velocity):
                found[f"A{letter}"] = after
        return found
    if velocities:
        return {}
    stopping = [column for column in alive if _stops(column, vehicle, time)]
    return {f"A{letter}": stopping[0]} if len(stopping) == 1 else {}


def _stops(acceleration: FloatArray, vehicle: FloatArray, time: FloatArray) -> bool:
    """Whether a column, in either sign, is the acceleration of something that moves with the vehicle.

    The impulse of a force grows as the velocity falls, which no acceleration does.
    """
    if np.ptp(vehicle) > 0 and abs(np.corrcoef(acceleration, vehicle)[0, 1]) > _ALIKE:
        return False
    speed = vehicle[0]
    change = integral(acceleration, time)
    change = -change if change[-1] * speed > 0 else change
    largest = float(-(change / speed).min())
    near = bool(np.abs(speed + change - vehicle).max() <= _NEAR * abs(speed))
    return near and LEAST_CHANGE <= largest <= MOST_CHANGE
