"""An ISO-MME test, as it is read and written: descriptors and channels."""

from collections.abc import Sequence
from dataclasses import dataclass

from crashfuse.signals.pulse import FloatArray

NO_VALUE = "NOVALUE"
"""Stands for what is not known."""

Pairs = Sequence[tuple[str, str]]
"""Descriptors: names and values."""


@dataclass(frozen=True, eq=False)
class Channel:
    """A recorded or computed signal.

    Parameters
    ----------
    code : str
        The 16 characters; empty where the file has none.
    name, unit : str
        As they are written there, the unit in ISO-MME's spelling (``m/(s*s)``); empty where unknown.
    values : ndarray, shape (n,)
        NaN where a sample has no value.
    interval_s : float or None
        Sampling interval; None where the file tells no even time.
    start_s : float or None
        Time of the first sample; None where the file does not tell it.
    source : str
        What it comes from: ``transducer``, ``calculation``, ``camera``, ``simulation`` or ``parameter``.
    """

    code: str
    name: str
    unit: str
    values: FloatArray
    interval_s: float | None
    start_s: float | None = 0.0
    comments: tuple[str, ...] = ()
    source: str = ""


@dataclass(frozen=True, eq=False)
class IsommeTest:
    """One test: what it was, and its channels.

    Parameters
    ----------
    name : str
        Names the folder and its files.
    descriptors : sequence of (str, str)
        Lines of the ``.mme`` file in their order, without those of no value; a name may come more than once
        (``Comments``).
    """

    name: str
    descriptors: Pairs
    channels: tuple[Channel, ...]

    def descriptor(self, name: str) -> str | None:
        """Value of the first descriptor of this name, whatever its capitals; None if there is none."""
        return first_of(self.descriptors, name)


def first_of(pairs: Pairs, name: str) -> str | None:
    """Value of the first pair of this name, whatever its capitals; None if there is none."""
    return next((value for key, value in pairs if key.lower() == name.lower()), None)
