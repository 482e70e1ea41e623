"""What a fit found, in a form that can be kept: values and arrays, nothing that could run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from crashfuse.execution.cache import Entry


@dataclass(frozen=True, eq=False)
class Learned:
    """What a fit found: with the data that it was fitted to, enough to predict again to the same bits.

    Parameters
    ----------
    values : mapping
        Plain JSON values.
    arrays : dict of str to ndarray
    """

    values: Mapping[str, Any]
    arrays: Entry

    @classmethod
    def of(cls, values: Mapping[str, Any], arrays: Entry, **parts: "Learned") -> "Learned":
        """Join values and arrays with what the parts of a model learned."""
        nested = {f"{part}/{name}": array for part, own in parts.items() for name, array in own.arrays.items()}
        return cls({**values, **{part: own.values for part, own in parts.items()}}, {**arrays, **nested})

    def part(self, name: str) -> "Learned":
        """What the part of this name learned."""
        start = f"{name}/"
        own = {key.removeprefix(start): array for key, array in self.arrays.items() if key.startswith(start)}
        return Learned(self.values[name], own)
