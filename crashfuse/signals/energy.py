"""Energy absorbed by the vehicle over crush."""

from dataclasses import dataclass

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.signals.loading import loading_phase
from crashfuse.signals.metrics import TAIL, checked_pulse
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray

_POINTS = 201


@dataclass(frozen=True, eq=False, slots=True)
class EnergyCurve:
    """Energy absorbed over crush in J/kg; multiply by the vehicle's mass in kg for J.

    Attributes
    ----------
    crush_m, energy_jpkg : ndarray, shape (n,)
    lower_jpkg, upper_jpkg : ndarray, shape (n,), or None
        Central 95 % of the draws at each crush; None without draws.
    """

    crush_m: FloatArray
    energy_jpkg: FloatArray
    lower_jpkg: FloatArray | None = None
    upper_jpkg: FloatArray | None = None


def energy_crush(accel_mps2: FloatArray, speed_mps: float, *, draws_mps2: FloatArray | None = None) -> EnergyCurve:
    """Energy that the vehicle has absorbed per kg of its mass over crush: e(s) = (v0² − v(s)²)/2.

    It is the area under deceleration over displacement, and v0²/2 at the maximum dynamic crush.

    Parameters
    ----------
    accel_mps2 : ndarray, shape (n,)
        Signed acceleration on the study grid, 12.5 kHz over 0–100 ms, in m/s².
    speed_mps : float
        Impact speed in m/s.
    draws_mps2 : ndarray, shape (n_draws, n), optional
        Equally likely whole pulses.

    Raises
    ------
    DataError
        As :func:`crashfuse.signals.metrics.pulse_metrics`, or if the grid is another.

    Returns
    -------
    EnergyCurve
        At 201 evenly spaced displacements from contact to the pulse's maximum dynamic crush, or the end of its record.

    Notes
    -----
    A draw that stops before some crush counts there as v0²/2. One whose record ends before it counts as the energy
    absorbed so far in the lower end of the band, and as v0²/2 in the upper.
    """
    accel_mps2, draws_mps2 = checked_pulse(accel_mps2, speed_mps, DT_S, draws_mps2)
    if accel_mps2.size != N_SAMPLES:
        expected, found = f"{N_SAMPLES} samples, 12.5 kHz over 0–100 ms", f"{accel_mps2.size} samples"
        raise DataError(Problem("accel_mps2", expected, found, "use crashfuse.Pulse.resampled"))
    return checked_energy(accel_mps2, speed_mps, draws_mps2)


def checked_energy(accel_mps2: FloatArray, speed_mps: float, draws_mps2: FloatArray | None = None) -> EnergyCurve:
    """The same of a pulse whose units were checked as it was read."""
    phase = loading_phase(accel_mps2, speed_mps)
    crush = np.linspace(0.0, phase.crush_m, _POINTS)
    total = speed_mps**2 / 2
    energy = np.interp(crush, phase.displacement_m, total - phase.velocity_mps**2 / 2)
    if draws_mps2 is None:
        return EnergyCurve(crush, energy)
    least, most = np.empty((2, len(draws_mps2), crush.size))
    for i, draw in enumerate(draws_mps2):
        phase = loading_phase(draw, speed_mps)
        absorbed = total - phase.velocity_mps**2 / 2
        least[i] = np.interp(crush, phase.displacement_m, absorbed)
        most[i] = np.interp(crush, phase.displacement_m, absorbed, right=total)
    return EnergyCurve(crush, energy, np.quantile(least, TAIL, axis=0), np.quantile(most, 1 - TAIL, axis=0))
