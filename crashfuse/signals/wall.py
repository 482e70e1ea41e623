"""The force of the barrier, a second witness of a crash: its impulse tells of mass and sensor, its begin of time zero.

Over a crash the impulse is the mass times the change of velocity, whatever breaks on the way. Where it is not, the
change of velocity over the impact speed tells which is wrong: a vehicle that stops rebounds a little.
"""

from dataclasses import dataclass

import numpy as np

from crashfuse.errors import refuse_if
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, kinematics
from crashfuse.units import MS, number

BEGIN_S, END_S = -0.02, 0.15
"""What is kept of a force, from contact."""
_OFF = 0.06  # of the impulse: load cells and accelerometers scatter by a few per cent
_STOPS = (0.98, 1.3)  # ΔV over the impact speed of a vehicle that stops and rebounds
_OF_WEIGHTS = ((0.43, 0.48), (0.6, 1.6), (2.1, 2.33))  # wrong weights: lb for kg, or so far off; else the force is
_LOADED = 0.02  # of the largest force: less is no contact
_LATE_S, _LAG_S = 4e-3, 8e-3  # of contact, and of the deceleration behind it; what breaks first leads by 2 to 5 ms
_LONG_ENOUGH_S, _AT_ITS_END = 0.09, 0.9  # an impulse is largest at its end


@dataclass(frozen=True, eq=False, slots=True)
class Wall:
    """The force of the barrier on a vehicle, in N, positive while it brakes, over even time from contact in s."""

    time_s: FloatArray
    force_n: FloatArray

    def from_contact(self, zero_s: float) -> "Wall":
        """At CFC 60 and 12.5 kHz, in time from contact, which is at ``zero_s`` of its time; braking is positive."""
        even = np.linspace(self.time_s[0], self.time_s[-1], self.time_s.size)
        as_written: FloatArray = np.interp(even, self.time_s, self.force_n)
        force = cfc_filter(as_written, cfc=60, dt_s=float(even[1] - even[0]))
        begin, end = max(BEGIN_S, self.time_s[0] - zero_s), min(END_S, self.time_s[-1] - zero_s)
        grid = DT_S * np.arange(np.ceil(begin / DT_S), np.floor(end / DT_S) + 1)
        force = np.interp(grid, even - zero_s, force)
        return Wall(grid, force * (np.sign(force.sum()) or 1.0))

    def require_force(self, where: str) -> None:
        """Raise a DataError if it is no force over time: an impulse, say."""
        found, force = "", self.force_n
        if force.size < 2 or not np.isfinite(force).all() or not (np.diff(self.time_s) > 0).all():
            found = "a time that does not increase, or no numbers"
        elif self.time_s[-1] > _LONG_ENOUGH_S and abs(float(force[-1])) > _AT_ITS_END * np.abs(force).max() > 0:
            found = "one that is largest at its end, as an impulse is"
        advice = "differentiate an impulse over time, or import again"
        refuse_if(found, where, "a force that ends with the crash", found, advice)

    def beside(self, accel_mps2: FloatArray) -> "Witness":
        """What it says beside a pulse on the study grid, as far as both go."""
        inside = self.time_s[-1] >= GRID_S
        force = np.interp(GRID_S, self.time_s, self.force_n, right=0.0)
        impulse = float(force[inside].sum() * DT_S)
        change = -float(kinematics(accel_mps2, 0.0, DT_S).velocity_mps[inside][-1])
        peak = int(self.force_n.argmax())
        calm = self.time_s[:peak][self.force_n[:peak] < _LOADED * self.force_n[peak]]
        begins_s = float(calm[-1]) if calm.size else float(self.time_s[0])
        n = 2 * force.size
        alike = np.fft.irfft(np.fft.rfft(-accel_mps2, n) * np.conj(np.fft.rfft(force, n)), n)
        most = int(alike.argmax())
        return Witness(impulse, change, begins_s, (most if most < force.size else most - n) * DT_S)


@dataclass(frozen=True, slots=True)
class Witness:
    """Impulse of the barrier in N s and change of velocity; when it is first loaded, how late a pulse follows, in s."""

    impulse_ns: float
    change_mps: float
    begins_s: float
    lag_s: float

    def share(self, mass_kg: float) -> float:
        """The impulse over the mass times the change of velocity: 1 if all are right."""
        return self.impulse_ns / max(mass_kg * self.change_mps, 1e-9)

    def findings(self, mass_kg: float, speed_mps: float) -> list[str]:
        """What it contradicts, and what to check."""
        share, rows = self.share(mass_kg), []
        if abs(share - 1) > _OFF:
            cause = self._cause(share, mass_kg, speed_mps)
            rows.append(f"the barrier's impulse is {share:.2f} times mass times change of velocity; {cause}")
        if abs(self.begins_s) > _LATE_S:
            rows.append(f"the barrier is first loaded at {number(self.begins_s / MS, '.1f')} ms; check its time zero")
        if not -_LATE_S <= self.lag_s <= _LAG_S:
            late = f"{abs(self.lag_s) / MS:.1f} ms {'behind' if self.lag_s > 0 else 'ahead of'}"
            rows.append(f"its deceleration is {late} the barrier's force; check the trigger of its sensor")
        return rows

    def _cause(self, share: float, mass_kg: float, speed_mps: float) -> str:
        weights = f"check its weights, {self.impulse_ns / max(self.change_mps, 1e-9):.0f} kg would fit"
        sensor = f"check its sensor, which reads {1 / (share or 1e-9):.2f} of that"
        stops = {weights: self.change_mps / speed_mps, sensor: self.impulse_ns / mass_kg / speed_mps}
        likely = [advice for advice, of_speed in stops.items() if _STOPS[0] <= of_speed <= _STOPS[1]]
        if likely == [weights] and not any(low <= share <= high for low, high in _OF_WEIGHTS):
            return f"check the load cells (their unit, a sum among them): {1 / share:.3g} times their force would fit"
        return likely[0] if len(likely) == 1 else "check its weights, the scale of its sensor, and the load cells"
