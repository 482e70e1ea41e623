"""Crashes in closed form: a half-sine pulse that stops a car and throws it back, as laboratories would record it."""

import numpy as np

from crashfuse.importing import Choices
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import KPH, MS, G

SPEED_MPS = 56 * KPH
DURATION_S = 80 * MS
PEAK_MPS2 = 1.1 * SPEED_MPS * np.pi / (2 * DURATION_S)
STOP_S = DURATION_S / np.pi * np.arccos(1 - SPEED_MPS * np.pi / (PEAK_MPS2 * DURATION_S))
CRUSH_M = SPEED_MPS * STOP_S - PEAK_MPS2 * DURATION_S / np.pi * (
    STOP_S - DURATION_S / np.pi * np.sin(np.pi * STOP_S / DURATION_S)
)
CONDITION = PartialCondition(SPEED_MPS, 1700.0, 950.0, 750.0)
GIVEN = Choices(condition=CONDITION)


def half_sine_g(time_s: FloatArray) -> FloatArray:
    """The pulse in g, contact at 0, deceleration negative."""
    inside = (time_s >= 0) & (time_s <= DURATION_S)
    return np.asarray(np.where(inside, -PEAK_MPS2 / G * np.sin(np.pi * time_s / DURATION_S), 0.0))


def scatter_g(time_s: FloatArray, size_g: float) -> FloatArray:
    """What makes one crash differ from the next: a wave that takes no velocity in all."""
    inside = (time_s >= 0) & (time_s <= DURATION_S)
    return np.asarray(np.where(inside, size_g * np.sin(4 * np.pi * time_s / DURATION_S), 0.0))


def clock(start_s: float = -0.05, end_s: float = 0.3, rate_hz: float = 10_000) -> FloatArray:
    return start_s + np.arange(round((end_s - start_s) * rate_hz) + 1) / rate_hz


def ringing_g(time_s: FloatArray) -> FloatArray:
    """What the structure adds at the sensor: 20 g at 1 kHz, zero on average, which CFC 60 takes away."""
    return np.asarray(20 * np.sin(2 * np.pi * 1000 * time_s))


def channel(name: str = "X", scale: float = 1.0, unit: str | None = "g", **of_clock: float) -> RecordedChannel:
    """A channel with the pulse times a scale."""
    time_s = clock(**of_clock)
    return RecordedChannel(name, f"Sensor {name}", time_s, scale * half_sine_g(time_s), unit)


def record(*channels: RecordedChannel, condition: PartialCondition = CONDITION) -> Record:
    """A record whose channels are all proposed."""
    return Record("T1", "T1.test", condition, channels, tuple(one.name for one in channels))
