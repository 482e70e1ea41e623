"""Which of the unnamed columns of a node is which: told by the run's initial velocity and by what is whose integral."""

import numpy as np

from crashfuse.readers.lsdyna.histories import integral
from crashfuse.readers.radioss.time_history import TimeHistory
from crashfuse.signals.pulse import FloatArray

_SAME = 1e-3  # of the initial velocity
_INTEGRAL, _ALIASED = 0.02, 0.05  # of the range of a displacement, of a velocity
_NEAR = 0.75  # of the initial velocity: how far a part of a vehicle is from its centre of gravity
_LEAST, _MOST = 0.8, 1.6  # of the initial velocity: ΔV of what stops


def named(history: TimeHistory, columns: FloatArray) -> dict[str, FloatArray]:
    """Name the velocity of a node, its displacement and acceleration, or the acceleration of an accelerometer.

    Parameters
    ----------
    columns : ndarray, shape (n, k)
        In the order of Radioss's codes: of a node displacement before velocity before acceleration.

    Returns
    -------
    dict of str to ndarray
        By Radioss's names (``VX``); empty if the columns cannot be told apart without doubt, or the run sets out at
        rest or along no axis.
    """
    initial = history.initial_velocity
    if initial is None or np.count_nonzero(initial) != 1 or "MASS" not in history.model:
        return {}
    axis = int(np.abs(initial).argmax())
    speed, letter = float(initial[axis]), "XYZ"[axis]
    momentum = history.model[f"{letter}-MOMENTUM"]
    if not np.isfinite(momentum).all() or not momentum[0] or not np.isfinite(columns).all():
        return {}
    vehicle = momentum / momentum[0] * speed  # velocity of the centre of gravity of what moves
    time = history.time
    alive = [column for column in columns.T if np.ptp(column) > 0]
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
    """Whether a column, in either sign, is the acceleration of something that moves with the vehicle."""
    speed = vehicle[0]
    change = integral(acceleration, time)
    change = -change if change[-1] * speed > 0 else change
    largest = float(-(change / speed).min())
    near = bool(np.abs(speed + change - vehicle).max() <= _NEAR * abs(speed))
    return near and _LEAST <= largest <= _MOST
