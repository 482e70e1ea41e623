"""Data model of an ISO-MME test, for reading and writing: descriptors and channels."""

from collections.abc import Sequence
from dataclasses import dataclass

from crashfuse.signals.pulse import FloatArray

NO_VALUE = "NOVALUE"
"""The format's marker for an unknown value."""

Pairs = Sequence[tuple[str, str]]
"""Descriptors as name and value pairs."""


@dataclass(frozen=True, eq=False)
class Channel:
    """A recorded or computed signal.

    Parameters
    ----------
    code : str
        The 16-character channel code; empty if the file has none.
    name, unit : str
        As written in the file, the unit in ISO-MME's spelling (``m/(s*s)``); empty if unknown.
    values : ndarray, shape (n,)
        NaN where a sample has no value.
    interval_s : float or None
        Sampling interval; None if the file gives no even time.
    start_s : float or None
        Time of the first sample; None if the file does not give it.
    source : str
        Origin of the signal: ``transducer``, ``calculation``, ``camera``, ``simulation`` or ``parameter``.
    status : str
        Quality of the signal: ``ok``, ``channel failed``, ``questionable data`` …; empty if unknown.
    filter_class : str
        The channel filter class as a number (``60``); empty if unknown.
    """

    code: str
    name: str
    unit: str
    values: FloatArray
    interval_s: float | None
    start_s: float | None = 0.0
    comments: tuple[str, ...] = ()
    source: str = ""
    filter_class: str = ""
    status: str = ""


@dataclass(frozen=True, eq=False)
class IsommeTest:
    """One test: its descriptors and channels.

    Parameters
    ----------
    name : str
        Name of the test, used for the folder and its files.
    descriptors : sequence of (str, str)
        Lines of the ``.mme`` file in order, without those that have no value; a name may occur more than once
        (``Comments``).
    """

    name: str
    descriptors: Pairs
    channels: tuple[Channel, ...]

    def descriptor(self, name: str) -> str | None:
        """The value of the first descriptor with this name (case ignored); None if there is none."""
        return first_of(self.descriptors, name)


def first_of(pairs: Pairs, name: str) -> str | None:
    """The value of the first pair with this name (case ignored); None if there is none."""
    return next((value for key, value in pairs if key.lower() == name.lower()), None)
