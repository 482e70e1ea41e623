"""The state of a fitted approach in a form that can be stored: values and arrays, no code."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from crashfuse.execution.cache import Entry


@dataclass(frozen=True, eq=False)
class FittedState:
    """What a fit found; with the data it was fitted to, enough to predict again to the same bits.

    Parameters
    ----------
    values : mapping
        Plain JSON values.
    """

    values: Mapping[str, Any]
    arrays: Entry

    @classmethod
    def of(cls, values: Mapping[str, Any], arrays: Entry, **parts: "FittedState") -> "FittedState":
        """Join values and arrays with the states of a model's parts."""
        nested = {f"{part}/{name}": array for part, own in parts.items() for name, array in own.arrays.items()}
        return cls({**values, **{part: own.values for part, own in parts.items()}}, {**arrays, **nested})

    def part(self, name: str) -> "FittedState":
        """The state of the part of this name."""
        start = f"{name}/"
        own = {key.removeprefix(start): array for key, array in self.arrays.items() if key.startswith(start)}
        return FittedState(self.values[name], own)
