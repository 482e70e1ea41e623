"""Display settings of all figures, tables and reports: units, the rated window, the sign of accelerations."""

from dataclasses import dataclass, replace
from typing import Any, Self, TypedDict, TypeVar, Unpack, cast

import numpy as np

from crashfuse.condition import Condition
from crashfuse.errors import one_of, require_a
from crashfuse.signals.metrics import Metric
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import WINDOWS_MS, require_window
from crashfuse.units import MPH_LB, SYSTEMS, AccelerationUnit, G, UnitSystem, said, speed, weight

Number = TypeVar("Number", float, FloatArray)

_UNITS: dict[str, AccelerationUnit] = {"g": "g", "m/s²": "m/s²", "m/s2": "m/s²"}


class DisplayOptions(TypedDict, total=False):
    """How a figure is drawn, option by option, as in :class:`Display`; ``unit`` may be ``m/s2``, too.

    ``units``: ``mph-lb`` or ``kph-kg``, by default those that the campaign's tests are declared in; ``display``: all at
    once, of which the others then change some.
    """

    window_ms: float
    unit: str
    deceleration: bool
    units: str
    display: "Display"


@dataclass(frozen=True, slots=True)
class Display:
    """The reader's display settings for all figures and tables; a UsageError if there is no such setting.

    Parameters
    ----------
    window_ms : float
        The rating is computed over [0, window_ms), of 10 to 100 ms; figures that show a test shade it.
    unit : {"g", "m/s²"}
        Unit of accelerations.
    deceleration : bool
        Show braking as positive; the data stay signed.
    system : UnitSystem, or {"mph-lb", "kph-kg"}
        Units of speeds and weights, such as :data:`crashfuse.units.KPH_KG`.
    """

    window_ms: float = WINDOWS_MS[-1]
    unit: AccelerationUnit = "g"
    deceleration: bool = False
    system: UnitSystem = MPH_LB

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", one_of("unit of accelerations", self.unit, _UNITS))
        if not isinstance(self.system, UnitSystem):
            object.__setattr__(self, "system", one_of("system of units", self.system, SYSTEMS))
        require_window(self.window_ms)
        require_a(bool, self.deceleration, "deceleration=True shows braking as positive")

    @classmethod
    def of(
        cls, system: UnitSystem = MPH_LB, usual_ms: float = WINDOWS_MS[-1], /, **options: Unpack[DisplayOptions]
    ) -> Self:
        """The display that these options ask for, by default in these units and over ``usual_ms``."""
        given = cast(dict[str, Any], options)
        for name in given:
            one_of("option of a figure", name, DisplayOptions.__annotations__)
        changed = {{"units": "system"}.get(name, name): value for name, value in given.items() if name != "display"}
        shown: Self = given.get("display", replace(DEFAULT, window_ms=usual_ms, system=system))
        require_a(Display, shown, "crashfuse.Display()")
        return replace(shown, **changed)

    @property
    def units(self) -> UnitSystem:
        """The units of everything, accelerations included."""
        return replace(self.system, acceleration=self.unit)

    @property
    def accel_scale(self) -> float:
        """Factor from signed m/s² to the axis' unit and sign."""
        return (1 / G if self.unit == "g" else 1.0) * (-1 if self.deceleration else 1)

    @property
    def in_names(self) -> tuple[str, str]:
        """Rated window and unit, for names of files."""
        return f"0-{self.window_ms:g}ms", "g" if self.unit == "g" else "mps2"

    @property
    def accel_axis(self) -> tuple[str, str]:
        """Quantity and unit of an acceleration axis."""
        return "Deceleration" if self.deceleration else "Acceleration", self.unit

    def axis(self, label: str, unit: str) -> tuple[str, str]:
        """Label and the reader's unit, for an axis."""
        return label, self.units.unit(unit)

    def speeds(self, values_mps: Number) -> Number:
        """Speeds in the reader's unit, as numbers."""
        return values_mps / self.system.in_si("mph")

    def weights(self, values_kg: Number) -> Number:
        """Weights in the reader's unit, as numbers."""
        return values_kg / self.system.in_si("lb")

    def vectors(self, vectors: FloatArray) -> FloatArray:
        """Conditions [v0, wf, wr], shape (..., 3), in the reader's units."""
        scaled: FloatArray = vectors * np.array([self.speeds(1.0), self.weights(1.0), self.weights(1.0)])
        return scaled

    def speed(self, speed_mps: float) -> str:
        """A speed with its unit."""
        return speed(speed_mps).in_units(self.system)

    def weight(self, weight_kg: float) -> str:
        """A weight with its unit."""
        return weight(weight_kg).in_units(self.system)

    def condition(self, condition: Condition) -> str:
        """A condition in words: speed, front and rear weight."""
        return condition.in_units(self.system)

    def title(self, label: str, unit: str) -> str:
        """A label with the reader's unit, if any: an axis, a column or a field."""
        return f"{label} ({self.units.unit(unit)})" if unit else label

    def metric(self, metric: Metric) -> Metric:
        """A metric in the reader's unit."""
        factor, unit = self.units.factor(metric.unit), self.units.unit(metric.unit)
        numbers = metric.value, metric.lower, metric.upper, metric.of_pulse
        value, lower, upper, of_pulse = (None if number is None else number * factor for number in numbers)
        return replace(metric, value=value, lower=lower, upper=upper, unit=unit, of_pulse=of_pulse)

    def words(self, text: object) -> str:
        """A sentence, condition or quantity in the reader's units; any other text as it is."""
        return said(text, self.units)


DEFAULT = Display()
