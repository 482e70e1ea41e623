"""Unit spellings found in files (``m/(s*s)``, ``G'S``, ``km/h``, ``[ms]`` …), mapped to one name and factor to SI."""

import re
from collections.abc import Mapping

from crashfuse.errors import UsageError, printable
from crashfuse.units import KPH, LB, MPH, MS, G

ACCELERATION_UNITS: Mapping[str, float] = {"g": G, "m/s²": 1.0, "mm/s²": 1e-3, "mm/ms²": 1e3}
"""Factors to m/s² of the units that occur in records; the last two are LS-DYNA's."""

UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": MS, "µs": 1e-6},
    "acceleration": ACCELERATION_UNITS,
    "speed": {"km/h": KPH, "mph": MPH, "m/s": 1.0},
    "mass": {"kg": 1.0, "lb": LB, "t": 1000.0},
    "share": {"%": 0.01, "1": 1.0},
}
"""Factors to SI by quantity and by our own unit name."""

_SPELLINGS = {
    "s": ("s", "sec", "secs", "second", "seconds", "sek", "sekunden"),
    "ms": ("ms", "msec", "millisecond", "milliseconds", "millisekunden"),
    "µs": ("µs", "us", "μs", "usec"),
    "g": ("g", "g's", "gs", "gn", "g0", "gee"),
    "m/s²": ("m/s2", "m/ss", "m/s/s", "mps2", "ms-2", "m/sec2"),
    "mm/s²": ("mm/s2", "mm/ss", "mm/s/s", "mmps2", "mm/sec2"),
    "mm/ms²": ("mm/ms2", "mm/ms/ms", "mmpms2"),
    "km/h": ("km/h", "kph", "kmh", "kmph", "km/hr"),
    "mph": ("mph", "mi/h", "mileperhour", "milesperhour"),
    "m/s": ("m/s", "mps", "m/sec"),
    "kg": ("kg", "kgs", "kilogram", "kilograms"),
    "lb": ("lb", "lbs", "pound", "pounds", "lbm"),
    "t": ("t", "tonne", "tonnes"),
    "%": ("%", "percent", "prozent", "pct"),
}
_NAMES = {spelling: name for name, spellings in _SPELLINGS.items() for spelling in spellings}
_LEADING_NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?")


def unit_named(text: str, quantity: str | None = None) -> str | None:
    """Return our name of the unit spelt by a text; None if it is not a unit (of this quantity, a key of ``UNITS``)."""
    plain = text.strip().strip("[](){}").lower().replace("²", "2").replace("’", "'")
    name = _NAMES.get(re.sub(r"[\s^*·()]", "", plain))
    known = {name for units in UNITS.values() for name in units} if quantity is None else UNITS[quantity]
    return name if name in known else None


def acceleration_unit(text: str) -> str:
    """Our name of a unit of acceleration, however it is spelt (``mps2``).

    Raises
    ------
    UsageError
        If it is none.
    """
    if (name := unit_named(str(text), "acceleration")) is None:
        units = ", ".join(ACCELERATION_UNITS)
        raise UsageError(f"There is no unit {printable(repr(text), 40)} of acceleration; take {units}.")
    return name


def number_and_unit(text: str) -> tuple[float, str] | None:
    """Split ``56,3 km/h`` into the number and the rest; None if it does not start with a number."""
    match = _LEADING_NUMBER.match(text.strip())
    if match is None:
        return None
    return float(match.group().replace(",", ".")), text.strip()[match.end() :].strip()
