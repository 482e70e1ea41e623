"""The condition of a crash: impact speed, axle weights, and any further factors."""

from dataclasses import dataclass

import numpy as np

from crashfuse.signals.pulse import FloatArray
from crashfuse.units import KPH, LB, MPH
from crashfuse.wording import UnitSystem, speed, weight


@dataclass(frozen=True, slots=True)
class Condition:
    """Condition of a full-frontal barrier crash.

    Parameters
    ----------
    speed_mps : float
        Impact speed v0 in m/s, positive.
    front_weight_kg, rear_weight_kg : float
        Weights on the two axles in kg.
    factors : tuple of (str, str)
        Further columns of the table (powertrain, drive) as pairs of name and value.
    """

    speed_mps: float
    front_weight_kg: float
    rear_weight_kg: float
    factors: tuple[tuple[str, str], ...] = ()

    @property
    def mass_kg(self) -> float:
        """Mass of the vehicle in kg."""
        return self.front_weight_kg + self.rear_weight_kg

    @property
    def vector(self) -> FloatArray:
        """The paper's x = [v0, wf, wr] (Eq. 3) in m/s and kg, shape (3,)."""
        return np.array([self.speed_mps, self.front_weight_kg, self.rear_weight_kg])

    def in_units(self, system: UnitSystem) -> str:
        """Speed and weights with their units, in words."""
        v0, front, rear = speed(self.speed_mps), weight(self.front_weight_kg), weight(self.rear_weight_kg)
        return f"{v0.in_units(system)}, front {front.in_units(system)}, rear {rear.in_units(system)}"

    def __str__(self) -> str:
        return (
            f"{self.speed_mps / MPH:.1f} mph ({self.speed_mps / KPH:.1f} km/h), "
            f"front {self.front_weight_kg / LB:.0f} lb, rear {self.rear_weight_kg / LB:.0f} lb"
        )
