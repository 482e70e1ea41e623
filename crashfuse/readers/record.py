"""The record: a foreign file's content on one crash, as found; :mod:`crashfuse.importing` settles zero, sign, unit."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from crashfuse.cae_library import RunQuality
from crashfuse.condition import ABOUT, About
from crashfuse.errors import DataError, Problem, UsageError, printable
from crashfuse.readers.vocabulary import Doubt, acceleration_unit, doubt_in, doubt_of, is_simulated, mentions, weight
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.wall import Wall
from crashfuse.units import Sentence, joined

_UNEQUAL = 0.01  # of the mass: allowed for rounding and scale errors
_UNLIKE = 0.03  # share of a force by which a sum may differ from its parts
_LISTED = 5  # channels in a message
_LONGEST = 190  # characters of a column on where a record comes from

_Signal = tuple[FloatArray, FloatArray]  # time in s, and force in N


@dataclass(frozen=True, slots=True)
class PartialCondition:
    """The condition as far as a file or a user states it; None where it is not stated."""

    speed_mps: float | None = None
    mass_kg: float | None = None  # of the whole vehicle, for files without axle weights
    front_weight_kg: float | None = None
    rear_weight_kg: float | None = None
    factors: tuple[tuple[str, str], ...] = ()  # what else is worth keeping (make, model, barrier)
    front_share: float | None = None  # front axle's share of the mass

    @property
    def weights(self) -> tuple[float | None, float | None, float | None, float | None]:
        """Mass, front and rear weight and front share, as stated."""
        return self.mass_kg, self.front_weight_kg, self.rear_weight_kg, self.front_share

    def overruled(self, by: "PartialCondition") -> "PartialCondition":
        """The condition with the values of ``by`` taking precedence; for weights see :meth:`weights_by`."""
        stated = {field.name: value for field in fields(by) if (value := getattr(by, field.name)) not in (None, ())}
        weights = self.weights_by(by)
        front, rear = weights.axles()
        mass = {"mass_kg": weights.mass_kg, "front_weight_kg": front, "rear_weight_kg": rear, "front_share": None}
        return replace(self, **{**stated, **mass})

    def weights_by(self, by: "PartialCondition") -> "PartialCondition":
        """Its weights, less what contradicts ``by``: two values tell all; one keeps share, mass or other axle."""
        n_stated = sum(value is not None for value in by.weights)
        if n_stated != 1:
            return by if n_stated else self
        front, rear = self.axles()
        whole = None if front is None or rear is None else front + rear
        if by.mass_kg is not None:
            if front is not None and whole:
                return PartialCondition(mass_kg=by.mass_kg, front_share=front / whole)
            return PartialCondition(None, by.mass_kg, front, rear, front_share=self.front_share)
        if by.front_share is not None:
            return PartialCondition(mass_kg=self.mass_kg if whole is None else whole, front_share=by.front_share)
        front, rear = (front, by.rear_weight_kg) if by.front_weight_kg is None else (by.front_weight_kg, rear)
        if front is not None and rear is not None:
            return PartialCondition(front_weight_kg=front, rear_weight_kg=rear)
        return replace(by, mass_kg=self.mass_kg, front_share=self.front_share)

    def axles(self) -> tuple[float | None, float | None]:
        """Front and rear weight in kg, as far as they can be derived."""
        mass, front, rear, share = self.weights
        if front is None and rear is None and mass is not None and share is not None:
            front = share * mass
        elif front is None and rear is not None:
            front = _other_axle(mass, rear, None if share is None else 1 - share)
        if rear is None and front is not None:
            rear = _other_axle(mass, front, share)
        return front, rear

    def contradiction(self) -> str:
        """The contradiction between stated weights; empty if there is none."""
        front, rear = self.axles()
        stated = [value for value in self.weights[:3] if value is not None]
        if front is None or rear is None or not all(0 < value < np.inf for value in stated):
            return ""
        whole = front + rear
        if self.mass_kg is not None and (min(front, rear) <= 0 or abs(self.mass_kg - whole) > _UNEQUAL * whole):
            loads = [Sentence("{}", weight(value)) for value in self.weights[1:3] if value is not None]
            return Sentence("{} on the axles with a mass of {}", joined(loads, " and "), weight(self.mass_kg))
        if self.front_share is not None and abs(self.front_share - front / whole) > _UNEQUAL:
            return f"{100 * front / whole:.3g} % of the mass in front, and {100 * self.front_share:.3g} %"
        return ""

    @property
    def stated(self) -> str:
        """The names of the weights that are stated; "none" if there are none."""
        words = "mass", "front weight", "rear weight", "front share"
        present = [name for name, value in zip(words, self.weights, strict=True) if value is not None]
        return f"the {' and the '.join(present)} alone" if present else "none"


def _other_axle(mass: float | None, one: float, share: float | None) -> float | None:
    if mass is not None:
        return mass - one
    return None if not share else one / share - one


@dataclass(frozen=True, eq=False, slots=True)
class RecordedChannel:
    """One signal of a record that could be the pulse, as found: unit, sign and filter are the file's."""

    name: str  # to choose it by, unique in its record: a channel's number or code, a node, a column's header
    label: str  # the file's description, for display
    time_s: FloatArray  # in even steps, shape (n,); it has any zero
    values: FloatArray
    unit: str | None  # as acceleration_unit takes it; None if the file does not state it
    cutoff_hz: float | None = None  # −3 dB frequency of the low pass already applied, if the file says it
    unit_from: str = "the file"
    origin: str = ""  # what the file says of its source (transducer, simulation), else its label if that says so
    status: str = ""  # what the file says of its quality (ok, channel failed, questionable data)
    sensor: str = ""  # maker, model and number
    prefilter: str = ""
    comment: str = ""  # beside its label

    def __post_init__(self) -> None:
        if self.unit is not None:
            object.__setattr__(self, "unit", acceleration_unit(self.unit))
        if not self.origin and is_simulated(self.label):
            object.__setattr__(self, "origin", self.label)

    def __repr__(self) -> str:
        return f"<RecordedChannel {self.shown}: {self.values.size:,} samples in {self.unit or 'an unknown unit'}>"

    @property
    def shown(self) -> str:
        """The name, the label where it says more, and what speaks against it."""
        name, label = printable(self.name), printable(self.label)
        remark = "" if self.remark in label else self.remark
        more = ", ".join(filter(None, ("" if label in name else label, remark)))
        return f"{name} ({more})" if more else name

    @property
    def is_simulated(self) -> bool:
        """Whether the file says that nobody measured it."""
        return is_simulated(self.origin)

    @property
    def doubt(self) -> Doubt:
        """What speaks against it, by the file."""
        is_computed = Doubt.SOME if mentions(self.origin, "computed") else Doubt.NONE
        return max(is_computed, *(doubt for _, doubt in self._accounts))

    @property
    def _accounts(self) -> list[tuple[str, Doubt]]:
        comments = [(text, doubt_in(text)) for text in (self.label, self.comment)]
        return [(self.status, doubt_of(self.status)), *comments]

    @property
    def remark(self) -> str:
        """The file's words that speak against it; empty if it is measured and sound."""
        status = next((text for text, doubt in self._accounts if doubt), "")
        origin = self.origin if self.is_simulated or mentions(self.origin, "computed") else ""
        return ", ".join(printable(text, 60) for text in (status, origin) if text)


Channels = tuple[RecordedChannel, ...]


def read_sound(
    readers: Mapping[str, Callable[[], RecordedChannel]],
) -> tuple[dict[str, RecordedChannel], dict[str, Problem]]:
    """Channels by name, and the problems of those that cannot be read."""
    channels, unread = dict[str, RecordedChannel](), dict[str, Problem]()
    for name, read in readers.items():
        try:
            channels[name] = read()
        except DataError as error:
            unread[name] = error.problems[0]
    return channels, unread


def proposal(
    channels: Mapping[str, RecordedChannel], propose: Callable[[Sequence[str]], tuple[tuple[str, ...], str]]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Channels to average, and sentences: measured before simulated, sound before doubtful, failed never."""
    candidates = [name for name, one in channels.items() if not one.is_simulated] or list(channels)
    for least in (Doubt.SOME, Doubt.FAILED):
        chosen, why = propose([name for name in candidates if channels[name].doubt < least])
        if chosen:
            break
    remarks = {name: f"{printable(name)} ({one.remark})" for name, one in channels.items() if one.remark}
    steps = [why]
    if passed_over := [text for name, text in remarks.items() if name not in chosen]:
        steps.append(f"Left out by the file's own account: {', '.join(passed_over)}.")
    if doubtful := [text for name, text in remarks.items() if name in chosen and channels[name].doubt]:
        steps.append(f"Careful: taken for want of better: {', '.join(doubtful)}.")
    return chosen, tuple(steps)


def summed_wall(cells: Sequence[tuple[_Signal | None, int]], steps: list[str]) -> Wall | None:
    """The force of a barrier, told in ``steps``: of its cells, or where one fails of their sum in the file.

    Beside the signal of a cell, None where it fails, stands whether it is a sum of some cells (1) or of all (2).
    """
    ranks = [[signal for signal, sums in cells if sums == rank] for rank in range(3)]
    single, n = _total(ranks[0]), len(ranks[0])
    if single is not None and n > 2 and (largest := _sum_among(ranks[0])) is not None:
        single, n = largest, n - 1
    stated = [force for force in (*(_total([signal]) for signal in ranks[2]), _total(ranks[1])) if force is not None]
    most = max(stated, key=_impulse, default=None)
    if single is not None and not (most and _impulse(most) > (1 + _UNLIKE) * _impulse(single)):
        steps.append(f"Force of the barrier: {n} load cells summed.")
        return single
    if most:
        why = "" if not n else " Cells fail." if single is None else f" The {n} load cells add up to less."
        steps.append(f"{'Careful: ' * bool(why)}Force of the barrier: the sum in the file.{why}")
    elif any(ranks[0]):
        steps.append(f"Careful: not all {n} load cells can be summed; the barrier's force is left out.")
    return most


def _total(signals: Sequence[_Signal | None]) -> Wall | None:
    sound = [signal for signal in signals if signal is not None]
    alike = all(time_s.shape == sound[0][0].shape and np.allclose(time_s, sound[0][0]) for time_s, _ in sound)
    if not sound or not alike or len(sound) < len(signals):
        return None
    return Wall(sound[0][0], np.sum([force_n for _, force_n in sound], axis=0))


def _sum_among(signals: Sequence[_Signal | None]) -> Wall | None:
    time_s, forces = next(filter(None, signals))[0], np.array([signal[1] for signal in signals if signal is not None])
    largest = forces[np.square(forces).sum(axis=1).argmax()]
    error = np.square(forces.sum(axis=0) - 2 * largest).sum()
    return Wall(time_s, largest) if error <= _UNLIKE**2 * np.square(largest).sum() else None


def _impulse(force: Wall) -> float:
    return abs(float(np.sum(force.force_n * np.gradient(force.time_s))))


@dataclass(frozen=True, eq=False, slots=True)
class Record:
    """One crash as recorded in a foreign file; ``channels`` are all that could be its pulse, the likeliest first."""

    id: str  # proposed for the campaign
    source: str  # name of the file or folder, without its path
    condition: PartialCondition
    channels: Channels
    proposed: tuple[str, ...]  # names of the channels that the reader would average into the pulse
    steps: tuple[str, ...] = ()  # sentences: what was found, why these channels, what was joined or left out
    own_time_zero: str = ""  # why 0 in the file's time is first contact; empty if the file does not say so
    no_speed: str = ""  # why no speed could be read although the file has something like one
    unread: Mapping[str, Problem] = field(default_factory=dict)  # channels that could be the pulse but are damaged
    quality: RunQuality = field(default_factory=RunQuality)  # what the solver says of a CAE run
    other_setup: str = ""  # what the file calls the test, if that is no full-frontal barrier crash
    about: Mapping[str, str] = field(default_factory=dict)  # where it comes from: laboratory, date; solver, deck
    wall: Wall | None = None  # in the file's time

    def __repr__(self) -> str:
        return f"<Record {self.id!r} of {printable(self.source)}: channels {self.listed}>"

    @property
    def is_simulated(self) -> bool:
        """Whether it says of itself that nothing in it, or nothing that is proposed, was measured."""
        return all(channel.is_simulated for channel in self.chosen() or self.channels)

    @property
    def listed(self) -> str:
        """The channels as messages list them: those proposed, the likeliest, and how many more."""
        shown = [channel.shown for channel in sorted(self.channels, key=lambda one: one.name not in self.proposed)]
        rest = f" and {len(shown) - _LISTED} more" if len(shown) > _LISTED else ""
        return f"{', '.join(shown[:_LISTED])}{rest}"

    def chosen(self, names: Sequence[str] = ()) -> Channels:
        """The channels with these names, as in the file or as messages print them; by default those proposed."""
        if damaged := [self.unread[name] for name in names if name in self.unread]:
            raise DataError(damaged)
        found = {name: self._named(name) for name in names or self.proposed}
        unknown = [printable(name) for name, channel in found.items() if channel is None]
        if unknown:
            raise UsageError(f"There is no channel {', '.join(unknown)} in {self.source}; it has {self.listed}.")
        return tuple(dict.fromkeys(channel for channel in found.values() if channel is not None))

    def about_with(self, channels: Sequence[RecordedChannel]) -> About:
        """Columns on where it comes from, with these channels' sensors."""
        prefilters = [one.prefilter or (f"{one.cutoff_hz:g} Hz" if one.cutoff_hz else "") for one in channels]
        words = {"sensor": [one.sensor for one in channels], "prefilter": prefilters}
        stated = {**self.about, **{name: "; ".join(dict.fromkeys(filter(None, of))) for name, of in words.items()}}
        return tuple((f"{ABOUT}{name}", text) for name in stated if (text := printable(stated[name].strip(), _LONGEST)))

    def _named(self, name: str) -> RecordedChannel | None:
        """The channel of this name, else the only one that is shown or labelled so, runs of blanks aside."""
        if exact := [one for one in self.channels if one.name == name]:
            return exact[0]
        wanted, spellings = name.split(), ((one, (one.shown, one.name, one.label)) for one in self.channels)
        alike = [one for one, texts in spellings if wanted in [printable(text).split() for text in texts]]
        return alike[0] if len(alike) == 1 else None
