"""The condition in an import: its units, what was found, and the user's own values, which take precedence."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.condition import Condition
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.vocabulary import UNITS
from crashfuse.ui import address
from crashfuse.ui.importing.session import Source
from crashfuse.ui.text import chosen_units
from crashfuse.wording import KPH_KG, UnitSystem

_WEIGHTS = ("front weight", "rear weight", "mass")


@dataclass(frozen=True, slots=True)
class Units:
    """Units of the condition, in the fields and in what is read from them."""

    speed: str
    weight: str

    @property
    def system(self) -> UnitSystem:
        """The units that sentences are said in; they know no m/s."""
        return UnitSystem("mph" if self.speed == "mph" else "km/h", "lb" if self.weight == "lb" else "kg")

    @property
    def speed_mps(self) -> float:
        """The unit of speed in m/s."""
        return UNITS["speed"][self.speed]

    @property
    def weight_kg(self) -> float:
        """The unit of weight in kg."""
        return UNITS["mass"][self.weight]

    def told(self, condition: Condition) -> str:
        """A condition as text in these units."""
        front, rear = (f"{kg / self.weight_kg:.0f}" for kg in (condition.front_weight_kg, condition.rear_weight_kg))
        speed = f"{condition.speed_mps / self.speed_mps:.1f} {self.speed}"
        return f"{speed}, front {front} {self.weight}, rear {rear} {self.weight}"


def units_of(source: Source) -> Units:
    """Ask for the units, at first those of the open campaign's pages; what is already entered follows a change."""
    (left, right), own = st.columns(2), chosen_units() if st.session_state.get("system") else KPH_KG
    speed = _unit(left, "Speed in", "speed", own.speed, ("km/h", "mph", "m/s"), ("speed",), source)
    return Units(speed, _unit(right, "Weights in", "mass", own.weight, ("kg", "lb"), _WEIGHTS, source))


def condition_of(source: Source, records: Sequence[Record], units: Units) -> tuple[PartialCondition, float | None]:
    """Ask for values that replace the condition found; second is the front axle's share of the mass.

    Values that follow from the numbers filled in are derived, too.
    """
    kg = units.weight_kg
    speed, share = _typed("speed", units.speed_mps, source), _typed("front share", 0.01, source)
    front, rear, mass = (_typed(name, kg, source) for name in _WEIGHTS)
    given = PartialCondition(speed, mass, front, rear)
    own = replace(given.weights, front_share=share)
    known = [one.condition.overruled(given).weighing(one.condition.weights.overruled(own)) for one in records]
    pairs = [(one.front_weight_kg, one.rear_weight_kg) for one in known]
    sums = [None if None in pair else sum(filter(None, pair)) for pair in pairs]
    fronts, rears = zip(*pairs, strict=True)
    masses = [one.mass_kg or whole for one, whole in zip(known, sums, strict=True)]
    shares = [front and whole and front / whole for front, whole in zip(fronts, sums, strict=True)]
    _number(
        st.container(), "speed", f"Speed ({units.speed})", [one.speed_mps for one in known], units.speed_mps, source
    )
    left, right = st.columns(2)
    _number(left, "front weight", f"Front weight ({units.weight})", fronts, kg, source)
    _number(right, "rear weight", f"Rear weight ({units.weight})", rears, kg, source)
    _number(left, "mass", f"Mass ({units.weight})", masses, kg, source)
    tip = "Of the mass, on the front axle: for files that know no axle weights."
    _number(right, "front share", "Front share (%)", shares, 0.01, source, tip)
    return given, share


def _unit(
    place: DeltaGenerator,
    label: str,
    quantity: str,
    usual: str,
    units: Sequence[str],
    numbers: Sequence[str],
    source: Source,
) -> str:
    key, keys = f"{source.key} {label}", [f"{source.key} {name}" for name in numbers]
    was = st.session_state.get(key, usual)
    address.default(key, usual)
    if (unit := st.session_state[key]) != was:  # since then the pages' units were switched
        _convert(key, UNITS[quantity][was], quantity, keys)
    found: str = place.selectbox(
        label,
        units,
        key=key,
        persist_state="session",
        on_change=_convert,
        args=(key, UNITS[quantity][unit], quantity, keys),
    )
    return found


def _convert(unit_key: str, was: float, quantity: str, keys: Sequence[str]) -> None:
    """Convert the numbers already filled in to the unit just chosen."""
    for key in keys:
        if (value := st.session_state.get(key)) is not None:
            st.session_state[key] = float(f"{value * was / UNITS[quantity][st.session_state[unit_key]]:.7g}")


def _typed(name: str, unit: float, source: Source) -> float | None:
    value = st.session_state.get(f"{source.key} {name}")
    return None if value is None else value * unit


def _number(
    place: DeltaGenerator,
    name: str,
    label: str,
    found: Sequence[float | None],
    unit: float,
    source: Source,
    tip: str | None = None,
) -> None:
    known = sorted(value / unit for value in found if value is not None and value > 0)
    grey = "not found"
    if known:
        grey = f"{known[0]:.5g}" if known[-1] - known[0] < 1e-6 * known[-1] else f"{known[0]:.4g}–{known[-1]:.4g}"
    place.number_input(
        label,  # without limits: the browser would drop a number beyond them, and nothing would name it
        value=None,
        placeholder=grey,
        key=f"{source.key} {name}",
        persist_state="session",
        help=tip,
    )
