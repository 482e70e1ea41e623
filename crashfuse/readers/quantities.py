"""Speeds and weights of foreign files: in both systems of units as a string, in the reader's alone on a page."""

from crashfuse.units import KPH
from crashfuse.wording import KPH_KG, MPH_LB, Quantity


class _InBoth(Quantity):
    """A quantity whose reader's units nobody knows before there is a campaign."""

    __slots__ = ()

    def __str__(self) -> str:
        return f"{self.in_units(KPH_KG)} ({self.in_units(MPH_LB)})"


def speed(*values_mps: float, form: str = ".1f", between: str = "–") -> Quantity:
    """Speeds, given in m/s; as a string, in km/h and mph."""
    return _InBoth(tuple(value / KPH for value in values_mps), "km/h", form, between)


def weight(*values_kg: float, form: str = ".0f", between: str = "–") -> Quantity:
    """Weights, given in kg; as a string, in kg and lb."""
    return _InBoth(values_kg, "kg", form, between)
