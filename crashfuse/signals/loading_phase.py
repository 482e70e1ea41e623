"""The loading phase of a crash, from contact to the time of zero velocity, and the energy absorbed over crush."""

from dataclasses import dataclass

import numpy as np

from crashfuse.signals.pulse import DT_S, TAIL, FloatArray, kinematics


@dataclass(frozen=True, eq=False, slots=True)
class LoadingPhase:
    """A pulse up to the time of zero velocity, as functions of time; shape (n,).

    Displacement only grows, so acceleration is a function of it, too. The last sample is the time of zero velocity
    ``t0_s``, or the end of the record if the vehicle does not stop within it, where that is NaN.
    """

    time_s: FloatArray
    displacement_m: FloatArray
    velocity_mps: FloatArray
    accel_mps2: FloatArray
    t0_s: float

    @property
    def crush_m(self) -> float:
        """Displacement at the end: the maximum dynamic crush, if the vehicle stops."""
        return float(self.displacement_m[-1])

    @property
    def speed_share(self) -> FloatArray:
        """Velocity over impact speed, shape (n,)."""
        return np.asarray(self.velocity_mps / self.velocity_mps[0])

    @property
    def end_s(self) -> float:
        """Time at the end: the time of zero velocity, if the vehicle stops."""
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
        crush = motion.displacement_m[n - 1] + 0.5 * motion.velocity_mps[n - 1] * (t0 - time[n - 1])
        phase = np.column_stack([phase, [t0, crush, 0.0, np.interp(t0, time, accel)]])
    return LoadingPhase(phase[0], phase[1], phase[2], phase[3], t0)


_POINTS = 201


@dataclass(frozen=True, eq=False, slots=True)
class EnergyCurve:
    """Energy absorbed over crush in J/kg, shape (n,); multiply by the vehicle's mass in kg for J.

    ``lower_jpkg`` and ``upper_jpkg`` are the central 95 % of the draws at each crush, None without draws.
    """

    crush_m: FloatArray
    energy_jpkg: FloatArray
    lower_jpkg: FloatArray | None = None
    upper_jpkg: FloatArray | None = None


def energy_crush(accel_mps2: FloatArray, speed_mps: float, draws_mps2: FloatArray | None = None) -> EnergyCurve:
    """Energy absorbed per kg over crush, e(s) = (v0² − v(s)²)/2, of a pulse on the study grid, shape (1250,).

    The curve has 201 even displacements up to the maximum dynamic crush, or the end of the record. A draw that stops
    before some crush counts there as v0²/2. One whose record ends before it counts as the energy absorbed so far in the
    lower end of the band, and as v0²/2 in the upper.
    """
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
