"""The condition of a crash: impact speed, axle weights, and any further factors."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from html import escape
from typing import Self
from urllib.parse import quote, unquote

import numpy as np

from crashfuse.errors import UsageError, printable, require_number
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import KPH, LB, MASS, MPH, SPEED, Sentence, UnitSystem, joined, speed, weight

ABOUT = "about_"
"""How columns begin that say where a row comes from (laboratory, solver); they are no factors."""
About = tuple[tuple[str, str], ...]
"""Those of a row that are filled, with their names."""


def about_label(name: str) -> str:
    """What such a column is about, to be read."""
    return name.removeprefix(ABOUT).replace("_", " ")


Factors = tuple[tuple[str, str], ...]
_Units = tuple[str, str, str]
SAME_CONDITION = 2e-3
"""Relative: as tables are rounded, to 1 kg and 0.1 km/h; speeds of tests are off by more."""
STEP_MPS, STEP_KG = 0.1 * MPH, 1.0
"""A step of what readers are shown, in the coarser unit. A condition is outside a range if it is farther beyond an end:
so an end that is read off and typed in again lies inside, and what lies outside is shown as beyond the end."""
FILE_UNITS = "mph", "lb", "lb"
"""Of speed, front and rear weight where nobody has given any others: endings of columns."""
_PRINTED = {"kph": "km/h", "mps": "m/s"}
QUANTITIES: Mapping[str, Mapping[str, float]] = {"speed": SPEED, "front_weight": MASS, "rear_weight": MASS}
"""What the columns of a condition are called but for their units, and factors to SI by unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
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
    units : tuple of str
        Endings of the columns that speed, front and rear weight were given in; files have these again.
    """

    speed_mps: float
    front_weight_kg: float
    rear_weight_kg: float
    factors: Factors = ()
    units: _Units = field(default=FILE_UNITS, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("speed_mps", "front_weight_kg", "rear_weight_kg"):
            require_number(name, getattr(self, name))  # its sign is judged where tables and requests are
        if not (isinstance(self.factors, tuple) and all(map(_is_factor, self.factors))):
            found = printable(repr(self.factors), 60)
            raise UsageError(f'Factors are pairs of name and value, such as (("drive", "FWD"),), not {found}.')

    @classmethod
    def of(cls, **given: float | str | None) -> Self:
        """A condition from quantities whose names end in their units, as the columns of ``tests.csv`` do.

        One of ``speed_mph``, ``speed_kph``, ``speed_mps``; one of ``front_weight_lb``, ``front_weight_kg``; one of
        ``rear_weight_lb``, ``rear_weight_kg``. Any further name is a factor, such as ``drive="FWD"``; None: not known.
        A UsageError if one is missing, given in two units or an unknown one, or no number above 0.

        Examples
        --------
        >>> Condition.of(speed_mph=35, front_weight_lb=2100, rear_weight_lb=1550, drive="FWD").mass_kg
        1655.612...
        """
        (speed, v0), (front, wf), (rear, wr) = (_quantity(name, units, given) for name, units in QUANTITIES.items())
        used = {f"{name}_{unit}" for name, units in QUANTITIES.items() for unit in units}
        factors = tuple((name, str(value)) for name, value in given.items() if name not in used and value is not None)
        return cls.of_vector([speed, front, rear], factors, (v0, wf, wr))

    @classmethod
    def of_vector(cls, vector: Iterable[float], factors: Factors = (), units: _Units = FILE_UNITS) -> Self:
        """The condition with this :attr:`vector`, shape (3,), in m/s and kg, that was given in these units."""
        speed_mps, front_kg, rear_kg = map(float, vector)
        return cls(speed_mps=speed_mps, front_weight_kg=front_kg, rear_weight_kg=rear_kg, factors=factors, units=units)

    @classmethod
    def of_cells(cls, vector: Iterable[float], factors: Factors, units: _Units) -> Self:
        """As :meth:`of_vector`, with NaN for a cell of a table that is no number."""
        condition = object.__new__(cls)
        for name, value in zip(cls.__slots__, (*map(float, vector), factors, units), strict=True):
            object.__setattr__(condition, name, value)
        return condition

    def _repr_html_(self) -> str:
        kind = "".join(f", {name} {value}" for name, value in self.factors if value)
        return escape(f"{self}{kind}")

    @property
    def mass_kg(self) -> float:
        """Mass of the vehicle in kg."""
        return self.front_weight_kg + self.rear_weight_kg

    @property
    def vector(self) -> FloatArray:
        """The paper's x = [v0, wf, wr] (Eq. 3) in m/s and kg, shape (3,)."""
        return np.array([self.speed_mps, self.front_weight_kg, self.rear_weight_kg])

    def may_be(self, other: "Condition") -> bool:
        """Whether no factor tells this condition from another: each is equal in both, or lacking in one."""
        known = dict(other.factors)
        return all(not value or known.get(name, value) in ("", value) for name, value in self.factors)

    def shared_factors(self, other: "Condition") -> int:
        """How many factors are known of both and equal."""
        return len({pair for pair in self.factors if pair[1]} & {*other.factors})

    def is_at(self, other: "Condition") -> bool:
        """Whether it is another's, to a relative 2e-3 in speed and weights, and no factor tells them apart."""
        return self.may_be(other) and bool((np.abs(self.vector / other.vector - 1) <= SAME_CONDITION).all())

    def in_units(self, system: UnitSystem) -> str:
        """Speed and weights with their units, in words."""
        v0, front, rear = speed(self.speed_mps), weight(self.front_weight_kg), weight(self.rear_weight_kg)
        return f"{v0.in_units(system)}, front {front.in_units(system)}, rear {rear.in_units(system)}"

    @property
    def besides_speed(self) -> dict[str, object]:
        """Its weights and what factors it has, in few words."""
        weights = weight(self.front_weight_kg, self.rear_weight_kg, between=" + ")
        return {"": weights} | {name: value for name, value in self.factors if value}

    @property
    def brief(self) -> Sentence:
        """The condition in few words: speed, front and rear weight, factors."""
        return joined([speed(self.speed_mps), *self.besides_speed.values()], ", ")

    def __str__(self) -> str:
        weights = f"front {self.front_weight_kg / LB:.0f} lb, rear {self.rear_weight_kg / LB:.0f} lb"
        return f"{self.speed_mps / MPH:.1f} mph ({self.speed_mps / KPH:.1f} km/h), {weights}"

    @property
    def columns(self) -> dict[str, float]:
        """Speed and weights as they were given, by the names of their columns: ``{"speed_kph": 56.0, …}``."""
        rows = zip(QUANTITIES.items(), self.units, self.vector.tolist(), strict=True)
        return {f"{name}_{unit}": round(value / units[unit], 9) for (name, units), unit, value in rows}

    @property
    def speed_name(self) -> str:
        """The speed as it was given, for names of files: ``56kph``."""
        return f"{next(iter(self.columns.values())):.6g}{self.units[0]}"

    @property
    def stated(self) -> str:
        """The same in words: ``56 km/h, front 950 kg, rear 700 kg``."""
        v0, front, rear = self._stated
        return f"{v0}, front {front}, rear {rear}"

    @property
    def stated_speed(self) -> str:
        """The speed in words: ``56 km/h``."""
        return self._stated[0]

    @property
    def _stated(self) -> list[str]:
        return [f"{v:.6g} {_PRINTED.get(u, u)}" for v, u in zip(self.columns.values(), self.units, strict=True)]

    @property
    def text(self) -> str:
        """The condition on one short line that :meth:`parse` reads: ``35mph 900kg 800kg``.

        Each quantity is in the unit that takes fewest characters; factors follow as ``name=value``.
        """
        parts = [_shortest(self.speed_mps, SPEED), *(_shortest(kg, MASS) for kg in self.vector.tolist()[1:])]
        return " ".join([*parts, *(f"{quote(name, safe='')}={quote(value, safe='')}" for name, value in self.factors)])

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a condition from its :attr:`text`, to nine digits; a UsageError if it is none."""
        parts = text.split()
        quantities = zip([*parts, "", "", ""], (SPEED, MASS, MASS), strict=False)
        (speed_mps, v0), (front_kg, front), (rear_kg, rear) = (_read(part, units) for part, units in quantities)
        pairs = [part.partition("=") for part in parts[3:]]
        if not (speed_mps and front_kg and rear_kg) or not all(name and found for name, found, _ in pairs):
            found = printable(text, 60)
            raise UsageError(f"A condition is a speed and two weights, such as 35mph 2100lb 1500lb, not {found!r}.")
        factors = tuple((unquote(name), unquote(value)) for name, _, value in pairs)
        return cls.of_vector([speed_mps, front_kg, rear_kg], factors, (v0, front, rear))


def _is_factor(pair: object) -> bool:
    return isinstance(pair, tuple) and len(pair) == 2 and all(isinstance(text, str) for text in pair)


_QUANTITY = re.compile(r"(?P<number>\d{1,12}(\.\d{1,12})?)(?P<unit>[a-z]+)")


def _shortest(value: float, units: Mapping[str, float]) -> str:
    return min((f"{value / size:.9g}{unit}" for unit, size in units.items()), key=len)


def _read(text: str, units: Mapping[str, float]) -> tuple[float, str]:
    found = _QUANTITY.fullmatch(text)
    return (float(found["number"]) * units.get(found["unit"], 0.0), found["unit"]) if found else (0.0, "")


def _quantity(name: str, units: Mapping[str, float], given: Mapping[str, float | str | None]) -> tuple[float, str]:
    words, names = name.replace("_", " "), [f"{name}_{unit}" for unit in units]
    found = [key for key in given if key == name or key.startswith(f"{name}_")]
    unknown = [key for key in found if key not in names]
    if unknown or not found:
        ending = f"; {printable(unknown[0], 40)} does not end in one of these units" if unknown else ""
        raise UsageError(f"A condition needs a {words}: {' or '.join(names)}{ending}.")
    if len(found) > 1:
        raise UsageError(f"A condition has one {words}; given are {' and '.join(found)}.")
    try:
        value = float(math.nan if isinstance(given[found[0]], bool) else given[found[0]] or math.nan)
    except (TypeError, ValueError):
        value = math.nan
    if not 0 < value < math.inf:
        raise UsageError(f"{found[0]} is a number above 0, not {printable(repr(given[found[0]]), 60)}.")
    unit = found[0].rpartition("_")[2]
    return value * units[unit], unit
