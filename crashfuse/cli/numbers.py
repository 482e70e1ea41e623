"""Parsers of numbers for argparse: a text that is none is told as what it is."""

import argparse
import math
from collections.abc import Callable


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
    """Parser of a number in a unit with this factor to SI."""
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


def filter_class(text: str) -> float | str:
    """A channel filter class, or "none"."""
    return text if text == "none" else number(text)
