"""Scales of TDMS channels: from the converter's numbers to physical ones, as National Instruments' programs store them.

``NI_Scale[n]_…`` are properties of a channel, its group or its file, the first that has any; the last scale gives the
values, and each names its input: another scale, or the numbers as stored. Names, order and meaning as in the public
package npTDMS.
"""

import re
from collections.abc import Iterable, Mapping

import numpy as np

from crashfuse.signals.pulse import FloatArray

_RAW = 0xFFFFFFFF  # as an input: the numbers as stored
_TYPE = re.compile(r"ni_scale\[(\d{1,4})\]_scale_type")
_MOST_STEPS = 16  # of one channel
_MOST_NUMBERS = 10_000  # of a polynomial or table

Properties = Mapping[str, str | float]


class UnusableScale(ValueError):
    """A scale that gives no acceleration, or makes no sense."""


def scaled(values: FloatArray, levels: Iterable[Properties]) -> FloatArray:
    """Values with their scales applied.

    Parameters
    ----------
    levels : iterable of mapping
        The properties of the channel, its group and its file, names in lower case.

    Raises
    ------
    UnusableScale
        If the scales are of a kind that no accelerometer has, lack a property, or go in a circle.
    """
    for properties in levels:
        count = _count(properties)
        if count and str(properties.get("ni_scaling_status")).lower() != "scaled":
            return _Scales(properties).applied(count - 1, values)
    return values


def _count(properties: Properties) -> int:
    """How many scales are there, by their number as stored, else by the last one."""
    if "ni_number_of_scales" in properties:
        return _whole(properties["ni_number_of_scales"])
    return max((int(match[1]) + 1 for name in properties if (match := _TYPE.fullmatch(name))), default=0)


def _whole(number: str | float) -> int:
    if not isinstance(number, float) or not number.is_integer():
        raise UnusableScale(f"{number} for a whole number")
    return int(number)


class _Scales:
    """The scales of one channel, with the steps left."""

    def __init__(self, properties: Properties) -> None:
        self._properties, self._left = properties, _MOST_STEPS

    def applied(self, index: int, values: FloatArray) -> FloatArray:
        if index == _RAW:
            return values
        self._left -= 1
        if self._left < 0:
            raise UnusableScale(f"more than {_MOST_STEPS} scales, or scales in a circle")
        kind = self._properties.get(f"ni_scale[{index}]_scale_type", "none")
        prefix = f"ni_scale[{index}]_{kind}_".lower()

        def number(name: str) -> float:
            found = self._properties.get(prefix + name)
            if not isinstance(found, float):
                raise UnusableScale(f"scale {index} ({kind}) without {name}")
            return found

        def numbers(name: str, usual: float | None = None) -> FloatArray:
            count = _whole(
                number(f"{name}_size") if usual is None else self._properties.get(f"{prefix}{name}_size", usual)
            )
            if not 0 < count <= _MOST_NUMBERS:
                raise UnusableScale(f"scale {index} ({kind}) with {count:,} {name}")
            return np.array([number(f"{name}[{n}]") for n in range(count)])

        def source(name: str = "input_source") -> FloatArray:
            return self.applied(_whole(self._properties.get(prefix + name, float(_RAW))), values)

        match kind:
            case "Linear":
                return source() * number("slope") + number("y_intercept")
            case "Polynomial":
                return np.polynomial.polynomial.polyval(source(), numbers("coefficients", 4.0))
            case "Table":
                inputs, outputs = numbers("pre_scaled_values"), numbers("scaled_values")
                return _interpolated(source(), inputs, outputs)
            case "Add":
                return source("left_operand_input_source") + source("right_operand_input_source")
            case "Subtract":  # the right one less the left one, as National Instruments' own programs do
                return source("right_operand_input_source") - source("left_operand_input_source")
            case "AdvancedAPI":
                return source()
        raise UnusableScale(f"scale {index} of the kind {kind}")


def _interpolated(values: FloatArray, inputs: FloatArray, outputs: FloatArray) -> FloatArray:
    if inputs.shape != outputs.shape:
        raise UnusableScale("a table of unlike columns")
    if inputs[0] > inputs[-1]:
        inputs, outputs = inputs[::-1], outputs[::-1]
    if not (np.diff(inputs) > 0).all():
        raise UnusableScale("a table that neither rises nor falls")
    return np.interp(values, inputs, outputs)
