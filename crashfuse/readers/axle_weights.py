"""Axle weights, determined by any two of mass, front weight, rear weight and front-axle share."""

from dataclasses import dataclass

import numpy as np

from crashfuse.readers.quantities import weight
from crashfuse.wording import Sentence, joined

_UNEQUAL = 0.01  # of the mass: allowed for rounding and scale errors


@dataclass(frozen=True, slots=True)
class AxleWeights:
    """A vehicle's weights as stated by one source (a file or a user); None where not stated."""

    mass_kg: float | None = None
    front_kg: float | None = None
    rear_kg: float | None = None
    front_share: float | None = None  # front axle's share of the mass

    @property
    def told(self) -> int:
        """How many of the four values are stated."""
        return sum(value is not None for value in (self.mass_kg, self.front_kg, self.rear_kg, self.front_share))

    def overruled(self, by: "AxleWeights") -> "AxleWeights":
        """Return the weights with the values of ``by`` taking precedence; values that contradict them are dropped.

        Two values determine all. A mass alone keeps the front-axle share, a share alone keeps the mass, and the weight
        of one axle keeps that of the other.
        """
        if by.told == 0:
            return self
        if by.told > 1:
            return by
        front, rear = self.axles()
        whole = None if front is None or rear is None else front + rear
        if by.mass_kg is not None:
            if front is not None and whole:
                return AxleWeights(by.mass_kg, front_share=front / whole)
            return AxleWeights(by.mass_kg, front, rear, self.front_share)
        if by.front_share is not None:
            return AxleWeights(self.mass_kg if whole is None else whole, front_share=by.front_share)
        pair = AxleWeights(
            None, front if by.front_kg is None else by.front_kg, rear if by.rear_kg is None else by.rear_kg
        )
        return pair if pair.told > 1 else AxleWeights(self.mass_kg, by.front_kg, by.rear_kg, self.front_share)

    def axles(self) -> tuple[float | None, float | None]:
        """Front and rear weight in kg, as far as they can be derived."""
        mass, front, rear, share = self.mass_kg, self.front_kg, self.rear_kg, self.front_share
        if front is None and rear is None and mass is not None and share is not None:
            front = share * mass
        elif front is None and rear is not None:
            front = _rest(mass, rear, None if share is None else 1 - share)
        if rear is None and front is not None:
            rear = _rest(mass, front, share)
        return front, rear

    def contradiction(self) -> str:
        """The contradiction between stated values; empty if there is none."""
        front, rear = self.axles()
        own = [value for value in (self.mass_kg, self.front_kg, self.rear_kg) if value is not None]
        if front is None or rear is None or not all(0 < value < np.inf for value in own):
            return ""
        whole = front + rear
        if self.mass_kg is not None and (min(front, rear) <= 0 or abs(self.mass_kg - whole) > _UNEQUAL * whole):
            axles = ((self.front_kg, "in front"), (self.rear_kg, "at the rear"))
            said = [Sentence("{} {}", weight(value), where) for value, where in axles if value is not None]
            return Sentence("{} with a mass of {}", joined(said, " and "), weight(self.mass_kg))
        if self.front_share is not None and abs(self.front_share - front / whole) > _UNEQUAL:
            return (
                f"{100 * front / whole:.3g} % of the mass in front with a front share of {100 * self.front_share:.3g} %"
            )
        return ""

    def alone(self) -> str:
        """The one value that is stated where they do not tell both axles; "none" if there is none."""
        if self.front_share is not None:
            return f"a front share of {100 * self.front_share:.4g} % alone"
        for name, value in (("mass", self.mass_kg), ("front weight", self.front_kg), ("rear weight", self.rear_kg)):
            if value is not None:
                return Sentence("a {} of {} alone", name, weight(value))
        return "none"


def _rest(mass: float | None, one: float, share: float | None) -> float | None:
    """The weight of the other axle, from the mass or from this axle's share."""
    if mass is not None:
        return mass - one
    return None if not share else one / share - one
