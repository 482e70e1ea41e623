"""Units at the edges, to and from SI, and sentences whose quantities can be said in those that a reader wants."""

import re
from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import asdict, dataclass
from itertools import islice
from string import Formatter
from typing import Any, Literal, Self

G = 9.80665  # standard gravity, m/s² (exact, CGPM 1901)
MPH = 0.44704  # m/s (exact)
KPH = 1 / 3.6  # m/s
LB = 0.45359237  # kg (exact)
MS = 1e-3  # s
KN = 1e3  # N

SPEED: dict[str, float] = {"mph": MPH, "kph": KPH, "mps": 1.0}
MASS: dict[str, float] = {"lb": LB, "kg": 1.0}
TIME: Mapping[str, float] = {"ms": MS, "s": 1.0}
ACCELERATION: Mapping[str, float] = {"g": G, "mps2": 1.0}
"""Factors to SI by the ending of a column name (``speed_mph``: ``SPEED["mph"]``)."""

AccelerationUnit = Literal["g", "m/s²"]
SpeedUnit = Literal["mph", "km/h"]
WeightUnit = Literal["lb", "kg"]

_DIMENSIONS = {"acceleration": {"g": G, "m/s²": 1.0}, "speed": {"mph": MPH, "km/h": KPH}, "weight": MASS}
_DIMENSION_OF = {unit: dimension for dimension, own in _DIMENSIONS.items() for unit in own}
IN_SI = {unit: factor for own in _DIMENSIONS.values() for unit, factor in own.items()}
"""Factors to SI of every unit that a reader can choose."""
_UNITS = "|".join(map(re.escape, ("%", "mm", "ms", *IN_SI)))
_WITHIN_NUMBER = re.compile(rf"(?<=\d) (?=({_UNITS})(?!\w))|(?<=[±≤≥]) (?=\d)")


@dataclass(frozen=True, slots=True)
class UnitSystem:
    """Units of everything that a reader is shown; lengths are in mm, times in ms and energies in kJ in all of them."""

    speed: SpeedUnit = "mph"
    weight: WeightUnit = "lb"
    acceleration: AccelerationUnit = "g"

    def unit(self, unit: str) -> str:
        """The reader's unit for quantities in this unit (``"km/h"``: ``"mph"``); one of no choice is unchanged."""
        return str(getattr(self, _DIMENSION_OF[unit])) if unit in IN_SI else unit

    def in_si(self, unit: str) -> float:
        """Factor to SI of the reader's unit for quantities in this unit."""
        return IN_SI[self.unit(unit)]

    @property
    def endings(self) -> tuple[str, str, str]:
        """Endings of columns of speed, front and rear weight in these units."""
        return "kph" if self.speed == "km/h" else self.speed, self.weight, self.weight

    def factor(self, unit: str) -> float:
        """Factor from a unit to the reader's."""
        return IN_SI[unit] / IN_SI[self.unit(unit)] if unit in IN_SI else 1.0


def number(value: float, form: str) -> str:
    """A number for readers in a format (``".1f"``), with the minus sign of print; one that rounds to 0 has no sign."""
    sign = "+" if form.startswith("+") else ""
    text = f"{value:{sign}z{form.removeprefix(sign)}}".replace("-", "−")
    return text.removeprefix("+") if text.strip("+.0") == "" else text


def time_text(time_s: float, digits: int = 4) -> str:
    """A time for readers, in ms to so many significant digits."""
    return f"{number(time_s / MS, f'.{digits}g')} ms"


def signed(value: float, digits: int) -> str:
    """A difference for readers, with its sign; 0.000 if there is none."""
    return number(value, f"+.{digits}f")


def difference(value: float, base: float, digits: int) -> str:
    """How far a number is above another where both are shown with so many digits: the difference of what is shown."""
    return signed(round(value, digits) - round(base, digits), digits)


def interval_texts(value: str | None, lower: str | None, upper: str | None, *, is_open: bool) -> tuple[str, str]:
    """A value and its interval, whose ends may be open: ``25.3``, ``[24.1, 26.0]``; ``≤ 15.3``, ``(95 %, …)``."""
    if lower is None and upper is None:
        return value or "–", "[open]" if value and is_open else ""
    known = f"≤ {upper}" if lower is None else f"≥ {lower}" if upper is None else None
    if value is None:
        return known or f"{lower}–{upper}", "(95 %, record too short)"
    return value, f"[{known or f'{lower}, {upper}'}]"


def probability_text(probability: float | None, confidence: float) -> str:
    """A probability to three digits, never 0 or 1; a dash if it is not known.

    More digits are shown where rounding would carry it over the confidence, or its complement: 0.9499 at 0.95.
    """
    if probability is None:
        return "–"
    if not 0.001 <= probability <= 0.999:
        return ">0.999" if probability > 0.5 else "<0.001"
    for digits in range(3, 12):
        text = f"{probability:.{digits}f}"
        if _sides(float(text), confidence) == _sides(probability, confidence):
            break
    return text


def _sides(probability: float, confidence: float) -> tuple[bool, bool]:
    return probability >= confidence - 1e-12, probability <= 1 - confidence + 1e-12


def unbroken(text: str) -> str:
    """A text in which no line ends between a number and its unit, or ± and the number."""
    return _WITHIN_NUMBER.sub("\N{NO-BREAK SPACE}", text)


MPH_LB, KPH_KG = UnitSystem(), UnitSystem("km/h", "kg")
SYSTEMS = {"mph-lb": MPH_LB, "kph-kg": KPH_KG}
"""The choices of units of speed and weight, by their name in the address of a page and on the command line."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """One or more values with their unit; as a string, in this unit.

    A value that is not known is None, shown as a dash; ``form`` is the format of a value, in whatever unit. Without
    values it is the unit alone.
    """

    values: tuple[float | None, ...]
    unit: str
    form: str = ".1f"
    between: str = "–"

    def in_units(self, system: UnitSystem) -> str:
        """The quantity in the reader's unit."""
        return self._text(system.factor(self.unit), system.unit(self.unit))

    def _text(self, factor: float, unit: str) -> str:
        told = ["–" if value is None else number(value * factor, self.form) for value in self.values]
        known = any(value is not None for value in self.values) or not self.values
        words = self.between.join(each.removesuffix(".") for each in told)
        return " ".join(filter(None, (words, unit if known else "")))

    def __str__(self) -> str:
        return self._text(1.0, self.unit)


def speed(*values_mps: float, form: str = ".1f", between: str = "–") -> Quantity:
    """Speeds, given in m/s; as a string, in mph."""
    return Quantity(tuple(value / MPH for value in values_mps), "mph", form, between)


def weight(*values_kg: float, form: str = ".0f", between: str = "–") -> Quantity:
    """Weights, given in kg; as a string, in lb."""
    return Quantity(tuple(value / LB for value in values_kg), "lb", form, between)


def acceleration(*values_mps2: float) -> Quantity:
    """Accelerations, given in m/s²; as a string, in g."""
    return Quantity(tuple(value / G for value in values_mps2), "g")


class Sentence(str):
    """A text with quantities in it: a string in the units of the files, which can be said in others.

    The template has a place ``{}`` for each value. What somebody else wrote is a value, never part of the template.
    """

    __slots__ = ("template", "values")
    template: str
    values: tuple[object, ...]

    def __new__(cls, template: str, *values: object) -> Self:  # noqa: D102
        sentence = super().__new__(cls, _filled(template, map(str, values)))
        sentence.template, sentence.values = template, values
        return sentence

    @classmethod
    def of(cls, template: str, values: Mapping[str, object]) -> Self:
        """The text whose places name values, ``{speed_mps}``; names that end in a unit are of quantities."""
        places = [(text, name, form) for text, name, form, _ in Formatter().parse(template)]
        filled = [_stated(name, values[name], form or "") for _, name, form in places if name is not None]
        return cls("".join(text + "{}" * (name is not None) for text, name, _ in places), *filled)

    def __getnewargs__(self) -> tuple[Any, ...]:
        return self.template, *self.values

    def in_units(self, system: UnitSystem) -> str:
        """The text in the reader's units."""
        return _filled(self.template, (said(value, system) for value in self.values))


def _stated(name: str, value: object, form: str) -> object:
    if isinstance(value, int | float):
        if name.endswith("_mps"):
            return speed(value)
        if name.endswith("_g"):
            return Quantity((value,), "g")
        return f"{100 * value:{form[:-1]}f} %" if form.endswith("%") else format(value, form)
    if isinstance(value, Mapping):
        value = [f"{key} ({text})" for key, text in value.items()]
    return read_out(value) if isinstance(value, list | tuple) else value


def statements(templates: Iterable[str], values: Mapping[str, object]) -> Sentence:
    """The sentences of these templates whose values are all known: neither missing nor empty."""
    missing = {name for name, value in values.items() if value is None or (isinstance(value, Sized) and not len(value))}
    places = {template: {name for _, name, _, _ in Formatter().parse(template) if name} for template in templates}
    known = [template for template, names in places.items() if names <= values.keys() - missing]
    return joined([Sentence.of(template, values) for template in known])


def _filled(template: str, values: Iterable[str]) -> str:
    first, *others = template.split("{}")
    return first + "".join(f"{value}{text}" for value, text in zip(islice(values, len(others)), others, strict=True))


def said(value: object, system: UnitSystem) -> str:
    """Anything as text; a condition, a quantity or a sentence in the reader's units."""
    in_units = getattr(value, "in_units", None)
    return str(value) if in_units is None else str(in_units(system))


def packed(value: object) -> object:
    """A text as JSON values, from which :func:`unpacked` makes the same."""
    if isinstance(value, Quantity):
        return asdict(value)
    return [value.template, *map(packed, value.values)] if isinstance(value, Sentence) else str(value)


def unpacked(value: Any) -> str:  # noqa: ANN401 - anything that a file may hold
    """The text that :func:`packed` was given.

    Raises ValueError, TypeError, KeyError, IndexError if it is nothing of the kind.
    """
    if isinstance(value, str):
        return value
    template, *values = value
    parts = (Quantity(**{**v, "values": tuple(v["values"])}) if isinstance(v, dict) else unpacked(v) for v in values)
    return Sentence(template, *parts)


_MOST_NAMES = 20  # that are read out


def counted(n: int, noun: str) -> str:
    """A number with its noun: ``3 criteria``."""
    plural = "criteria" if noun == "criterion" else f"{noun}s"
    return f"{n:,} {noun if n == 1 else plural}"


def read_out(names: Sequence[str]) -> str:
    """Names as one reads them out: "A, B and C"; of many the first, and how many more there are."""
    if len(names) > _MOST_NAMES:
        names = [*names[:_MOST_NAMES], f"{len(names) - _MOST_NAMES:,} more"]
    *first, last = names or [""]
    return joined([joined(first, ", "), last], " and ") if first else last


def joined(sentences: Sequence[object], separator: str = " ") -> Sentence:
    """Several sentences as one that can still be said in other units."""
    return Sentence(separator.join(["{}"] * len(sentences)), *sentences)
