"""Conditions on the command line: speed and weights in either unit, converted as they are read, and factors."""

import argparse
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from crashfuse.errors import UsageError
from crashfuse.units import KPH, LB, MPH

if TYPE_CHECKING:
    from crashfuse.campaign import Campaign
    from crashfuse.condition import Condition


AXES = {
    "speed_mps": {"--speed-mph": MPH, "--speed-kph": KPH},
    "front_weight_kg": {"--front-weight-lb": LB, "--front-weight-kg": 1.0},
    "rear_weight_kg": {"--rear-weight-lb": LB, "--rear-weight-kg": 1.0},
}
"""Options by the name of what they are in SI, in either unit with its factor."""
ACCELERATION_UNITS = {"mps2": "m/s²", "mmps2": "mm/s²", "mmpms2": "mm/ms²"}
ACCELERATION_UNITS |= {"cmps2": "cm/s²", "inps2": "in/s²", "ftps2": "ft/s²"}
"""Units of accelerations other than g, by their names here."""


def add_axes(parser: argparse.ArgumentParser, axes: Iterable[str], *, required: bool = False, **options: Any) -> None:  # noqa: ANN401 - those of argparse
    """Add the options for speed and weights to a parser."""
    for name in axes:
        group = parser.add_mutually_exclusive_group(required=required)
        for flag, factor in AXES[name].items():
            own: dict[str, Any] = {"metavar": flag[2].upper(), "action": _InUnit, **options}
            group.add_argument(flag, dest=name, type=in_si(factor), **own)


class _InUnit(argparse.Action):
    """Stores the unit of what is given, too: the end of the option's name."""

    def __call__(self, _: object, namespace: argparse.Namespace, values: object, option: str | None = None) -> None:
        setattr(namespace, self.dest, values)
        setattr(namespace, f"{self.dest} unit", str(option).rpartition("-")[2])


def units_of(arguments: argparse.Namespace) -> tuple[str, str, str]:
    """Units that speed, front and rear weight were given in, else those of files."""
    from crashfuse.condition import FILE_UNITS

    given = [getattr(arguments, f"{name} unit", usual) for name, usual in zip(AXES, FILE_UNITS, strict=True)]
    return given[0], given[1], given[2]


def require_positive(arguments: argparse.Namespace) -> None:
    """Refuse speeds and weights that are not above 0."""
    asked = [given for name in AXES if (given := getattr(arguments, name)) is not None]
    numbers = [number for each in asked for number in (each if isinstance(each, list) else [each])]
    if not all(0 < number < float("inf") for number in numbers):
        raise UsageError("Speed and weights must be numbers above 0.")


def condition_of(arguments: argparse.Namespace, campaign: "Campaign", speed_mps: float) -> "Condition":
    """The condition that is asked for, at this speed."""
    from crashfuse.condition import Condition

    factors = tuple(factor(text, campaign.factors) for text in arguments.factor or ())
    vector = [speed_mps, arguments.front_weight_kg, arguments.rear_weight_kg]
    return Condition.of_vector(vector, factors, units_of(arguments))


def factor(text: str, known: Mapping[str, Sequence[str]]) -> tuple[str, str]:
    """Name and value of a factor; raises if no test has it."""
    name, _, value = text.partition("=")
    if value not in known.get(name, ()):
        choices = "; ".join(f"{name}={value}" for name, values in known.items() for value in values) or "none"
        raise UsageError(f"No test has the factor {text!r}; the tests have: {choices}.")
    return name, value


def number(text: str) -> float:
    """A finite number."""
    try:
        parsed = float(text)
    except ValueError:
        parsed = math.nan
    if not math.isfinite(parsed):
        raise argparse.ArgumentTypeError(f"must be a number with a decimal point, if any, not {text!r}")
    return parsed


def in_si(factor: float) -> Callable[[str], float]:
    """Parser of a number, by the factor of its unit."""
    return lambda text: number(text) * factor


def whole(low: int, high: int | None = None) -> Callable[[str], int]:
    """Parser of an integer within bounds."""

    def parsed(text: str) -> int:
        allowed = f"{low} or more" if high is None else f"between {low} and {high}"
        try:
            found = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"must be a whole number, {allowed}, not {text!r}") from None
        if found < low or (high is not None and found > high):
            raise argparse.ArgumentTypeError(f"must be {allowed}, got {found}")
        return found

    return parsed


def number_or(word: str) -> Callable[[str], float | str]:
    """Parser of a number, or of a word."""
    return lambda text: text if text == word else number(text)
