"""Units at the edges: inside the library everything is SI; a column's name ends in its unit."""

from collections.abc import Mapping

G = 9.80665  # standard gravity, m/s² (exact, CGPM 1901)
MPH = 0.44704  # m/s (exact)
KPH = 1 / 3.6  # m/s
LB = 0.45359237  # kg (exact)
MS = 1e-3  # s
KN = 1e3  # N

SPEED: Mapping[str, float] = {"mph": MPH, "kph": KPH, "mps": 1.0}
MASS: Mapping[str, float] = {"lb": LB, "kg": 1.0}
TIME: Mapping[str, float] = {"ms": MS, "s": 1.0}
ACCELERATION: Mapping[str, float] = {"g": G, "mps2": 1.0}
"""Factors to SI by the ending of a column name (``speed_mph``: ``SPEED["mph"]``)."""
