"""The record: what a foreign file says of one crash, before anybody has decided anything about it.

Every reader of a foreign format (:mod:`~crashfuse.readers.nhtsa`, :mod:`~crashfuse.readers.isomme`,
:mod:`~crashfuse.readers.tables.table_reader` …) returns records: numbers and signs as they are found, and for each fact
where it was found. What they mean, time zero, sign and unit, is settled in one place, :mod:`crashfuse.importing`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.readers.axle_weights import AxleWeights
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import G

ACCELERATION_UNITS: Mapping[str, float] = {"g": G, "m/s²": 1.0, "mm/s²": 1e-3, "mm/ms²": 1e3}
"""Factors to m/s² of the units that records come in; the last two are LS-DYNA's."""


@dataclass(frozen=True, slots=True)
class PartialCondition:
    """What a file says of the condition; None where it says nothing.

    Parameters
    ----------
    speed_mps, mass_kg, front_weight_kg, rear_weight_kg : float, optional
        ``mass_kg`` is the whole vehicle's, for files that know no axle weights.
    factors : tuple of (str, str)
        Anything else worth keeping (make, model, barrier) as name and value.
    """

    speed_mps: float | None = None
    mass_kg: float | None = None
    front_weight_kg: float | None = None
    rear_weight_kg: float | None = None
    factors: tuple[tuple[str, str], ...] = ()

    def overruled(self, by: "PartialCondition") -> "PartialCondition":
        """Put everything that ``by`` knows in the place of what is known here; weights as :class:`AxleWeights` does."""
        known = {each.name: value for each in fields(by) if (value := getattr(by, each.name)) not in (None, ())}
        return replace(self, **known).weighing(self.weights.overruled(by.weights))

    @property
    def weights(self) -> AxleWeights:
        """What is said of the weights."""
        return AxleWeights(self.mass_kg, self.front_weight_kg, self.rear_weight_kg)

    def weighing(self, weights: AxleWeights) -> "PartialCondition":
        """Return the condition with these weights, those that follow included."""
        front, rear = weights.axles()
        return replace(self, mass_kg=weights.mass_kg, front_weight_kg=front, rear_weight_kg=rear)


@dataclass(frozen=True, eq=False, slots=True)
class RecordedChannel:
    """One signal of a record that could be the pulse.

    Parameters
    ----------
    name : str
        What it is chosen by, unique in its record: a channel's number or code, a node, a column's header.
    label : str
        What the file calls it, for people.
    time_s : ndarray, shape (n,)
        The file's own time in s, increasing, in even steps, wherever its zero may be.
    values : ndarray, shape (n,)
        As found: unfiltered by us, uncropped, sign and unit as in the file.
    unit : str or None
        A key of :data:`ACCELERATION_UNITS`; None where the file does not tell.
    cutoff_hz : float, optional
        −3 dB frequency of the low pass that the file says the signal went through; None where it does not tell.
    """

    name: str
    label: str
    time_s: FloatArray
    values: FloatArray
    unit: str | None
    cutoff_hz: float | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Record:
    """One crash as a foreign file holds it.

    Parameters
    ----------
    id : str
        Proposed id of the test or run in the campaign.
    source : str
        The file or folder, by name and without its path.
    channels : tuple of RecordedChannel
        All that could be the pulse, at least one.
    proposed : tuple of str
        Names of the channels that the reader would average into the pulse.
    steps : tuple of str
        Sentences: what was found and where, why these channels are proposed, what was joined or left out.
    own_time_zero : str, optional
        Why 0 in the file's time is first contact ("time zero of the test, by the format's definition"); empty
        where the file does not say so and it has to be looked for.
    no_speed : str, optional
        Why the file tells no speed, where it has something of the kind ("nodes at 612 a second, …").
    unread : mapping of str to Problem, optional
        Channels that could be the pulse but are damaged, and what is wrong with each.
    """

    id: str
    source: str
    condition: PartialCondition
    channels: tuple[RecordedChannel, ...]
    proposed: tuple[str, ...]
    steps: tuple[str, ...] = ()
    own_time_zero: str = ""
    no_speed: str = ""
    unread: Mapping[str, Problem] = field(default_factory=dict)

    def chosen(self, names: Sequence[str] = ()) -> tuple[RecordedChannel, ...]:
        """The channels of these names; of none, the proposed ones.

        Raises
        ------
        UsageError
            If the record has no such channel.
        DataError
            If it is one that could not be read.
        """
        if damaged := [self.unread[name] for name in names if name in self.unread]:
            raise DataError(damaged)
        by_name = {channel.name: channel for channel in self.channels}
        unknown = [name for name in names if name not in by_name]
        if unknown:
            have = ", ".join(f"{channel.name} ({channel.label})" for channel in self.channels[:20])
            rest = f" and {len(self.channels) - 20} more" if len(self.channels) > 20 else ""
            raise UsageError(f"There is no channel {', '.join(unknown)} in {self.source}; it has {have}{rest}.")
        return tuple(by_name[name] for name in names or self.proposed)
