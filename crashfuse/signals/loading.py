"""The loading phase of a crash: from contact to the time of zero velocity, where displacement only grows (Fig. 14)."""

from dataclasses import dataclass

import numpy as np

from crashfuse.signals.pulse import DT_S, FloatArray, kinematics


@dataclass(frozen=True, eq=False, slots=True)
class LoadingPhase:
    """A pulse up to the time of zero velocity, as functions of time.

    Displacement is strictly increasing, so acceleration is a function of it, too.

    Attributes
    ----------
    time_s, displacement_m, velocity_mps, accel_mps2 : ndarray, shape (n,)
        The last sample is the time of zero velocity, or the end of the record if the vehicle never stops.
    t0_s : float
        Time of zero velocity (t0 in the paper, TTZV in crash laboratories); NaN where the vehicle does not stop within
        the record.
    """

    time_s: FloatArray
    displacement_m: FloatArray
    velocity_mps: FloatArray
    accel_mps2: FloatArray
    t0_s: float

    @property
    def crush_m(self) -> float:
        """Displacement at the end of the phase: the maximum dynamic crush, if the vehicle stops."""
        return float(self.displacement_m[-1])

    @property
    def speed_share(self) -> FloatArray:
        """Velocity over impact speed, shape (n,)."""
        return np.asarray(self.velocity_mps / self.velocity_mps[0])

    @property
    def end_s(self) -> float:
        """Time at the end of the phase: the time of zero velocity, if the vehicle stops."""
        return float(self.time_s[-1])

    def accel_at(self, displacement_m: FloatArray) -> FloatArray:
        """Acceleration at displacements (f_int of Eqs. 16 and 19); constant beyond the crush."""
        return np.interp(displacement_m, self.displacement_m, self.accel_mps2)

    def displacement_at_speed(self, share: float) -> float:
        """Displacement where the vehicle has first slowed to this share of its impact speed; at most the crush."""
        slowest = np.minimum.accumulate(self.velocity_mps)
        return float(np.interp(-share * self.velocity_mps[0], -slowest, self.displacement_m))


def loading_phase(accel_mps2: FloatArray, speed_mps: float) -> LoadingPhase:
    """Cut a pulse on the study grid, shape (n,), at its time of zero velocity (Eqs. 11 to 14)."""
    accel = np.asarray(accel_mps2, dtype=np.float64)
    motion = kinematics(accel, speed_mps, DT_S)
    t0 = float(motion.t0_s)
    time = np.arange(accel.size) * DT_S
    n = accel.size if np.isnan(t0) else int(np.searchsorted(time, t0))  # number of samples before t0, where v > 0
    phase = np.array([time[:n], motion.displacement_m[:n], motion.velocity_mps[:n], accel[:n]])
    if not np.isnan(t0):
        rest = t0 - time[n - 1]
        crush = motion.displacement_m[n - 1] + 0.5 * motion.velocity_mps[n - 1] * rest
        phase = np.column_stack([phase, [t0, crush, 0.0, np.interp(t0, time, accel)]])
    return LoadingPhase(phase[0], phase[1], phase[2], phase[3], t0)
