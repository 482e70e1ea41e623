"""What an approach is: it says what it is called and how it is drawn, fits a campaign and predicts at a condition."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from crashfuse.approaches.settings import Settings
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import NotFittedError
from crashfuse.execution.cache import Entry
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.pulse import GRID_S, FloatArray


@dataclass(frozen=True, eq=False)
class Prediction:
    """The pulse that an approach expects at a condition.

    Parameters
    ----------
    accel_mps2 : ndarray, shape (1250,)
        The central prediction on :data:`crashfuse.signals.pulse.GRID_S`, m/s².
    draws_mps2 : ndarray, shape (n_draws, 1250), optional
        Equally likely whole pulses; None where the approach has no band.
    notes : tuple of str
        What the reader must know: extrapolation, where the CAE pulse came from, a fit that had to be retried.
    """

    condition: Condition
    accel_mps2: FloatArray
    draws_mps2: FloatArray | None = None
    notes: tuple[str, ...] = ()

    @property
    def time_s(self) -> FloatArray:
        """The study grid in s, shape (1250,)."""
        return GRID_S

    def band(self, level: float = 0.95) -> tuple[FloatArray, FloatArray] | None:
        """Central prediction interval at each time as (lower, upper) in m/s², or None."""
        if self.draws_mps2 is None:
            return None
        tail = (1 - level) / 2
        lower, upper = np.quantile(self.draws_mps2, [tail, 1 - tail], axis=0)
        return lower, upper


@dataclass(frozen=True, eq=False)
class FittedState:
    """What a fit found, with no code in it: plain JSON values, and arrays by name.

    With the data that was fitted to it is enough to predict again to the same bits.
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


MOST_TESTS = 30
"""From how many tests the exact posteriors learn: their cost grows with the cube of the number."""


class Approach(ABC):
    """One way to predict a pulse, and all that the rest of the program has to know about it.

    A new approach is a subclass in a module of its own, entered in :mod:`crashfuse.approaches.registry`. FittedState
    attributes end in an underscore; hyperparameters are a frozen config.

    Attributes
    ----------
    name : str
        The name in every file and call.
    label : str
        The name in figures and tables.
    in_words : str
        The name in a sentence, with its article.
    description : str
        What it does, in a sentence that follows its label and a colon.
    colour, dark_colour : str
        ``#RRGGBB`` of its curves on a white page and on a dark one; no ``dark_colour`` where one reads on both.
    dash : str
        Plotly's dash of its curves; solid is for what has learned from tests.
    preference : int
        Of approaches that tests cannot tell apart, the one with the lowest number is recommended.
    learns_from_tests : bool
        Whether :meth:`fit` looks at tests at all.
    made_of : tuple of Approach classes
        The approaches that it mixes, if any; the first of a prediction's notes then says how.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    in_words: ClassVar[str]
    description: ClassVar[str]
    colour: ClassVar[str]
    dark_colour: ClassVar[str | None] = None
    dash: ClassVar[str] = "solid"
    preference: ClassVar[int]
    learns_from_tests: ClassVar[bool] = True
    made_of: ClassVar[tuple[type["Approach"], ...]] = ()

    _thinning: tuple[str, ...] = ()

    @classmethod
    def create(cls, settings: Settings) -> Self:  # noqa: ARG003 - most others need it
        """An unfitted approach with these settings; those that do not concern it are passed over."""
        return cls()

    def prepare(self, campaign: Campaign, watch: Watch = SILENT) -> None:  # noqa: B027 - there may be nothing
        """Do what depends on the CAE runs alone and keep it in the cache: all fits to this campaign share it.

        Raises
        ------
        Cancelled
            If the watch was told to stop.
        """

    @abstractmethod
    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Learn from the campaign as it is handed over: held-out tests have been taken out of it already.

        Raises
        ------
        UsageError, DataError
            If there is not enough to learn from.
        Cancelled
            If the watch was told to stop.
        """

    @abstractmethod
    def predict(self, condition: Condition) -> Prediction:
        """Predict the pulse at a condition.

        Raises
        ------
        NotFittedError
            If called before :meth:`fit`.
        """

    @property
    def parts(self) -> tuple["Approach", ...]:
        """The fitted approaches that it mixes, one of each class in ``made_of``.

        Raises
        ------
        NotFittedError
            If there are some, and they are asked for before :meth:`fit`.
        """
        return ()

    def predict_from(self, condition: Condition, parts: Sequence[Prediction]) -> Prediction:  # noqa: ARG002 - see above
        """As :meth:`predict`, where what its :attr:`parts` predict there is known already."""
        return self.predict(condition)

    def left_out(self, campaign: Campaign) -> dict[str, FloatArray]:  # noqa: ARG002 - others need it
        """What it expects of each test of the campaign that it was fitted to, as if that test had not been run.

        Pulses in m/s², shape (1250,), by the test's id; empty where it is not known, as under the paper's preset.
        """
        return {}

    @abstractmethod
    def learned(self) -> FittedState:
        """What :meth:`fit` found.

        Raises
        ------
        NotFittedError
            If called before :meth:`fit`.
        """

    @abstractmethod
    def restore(self, campaign: Campaign, learned: FittedState) -> Self:
        """Take up what an approach with these hyperparameters learned from this campaign, instead of :meth:`fit`.

        Raises
        ------
        KeyError, ValueError, RuntimeError
            If that is no such thing.
        """

    def _thinned(self, campaign: Campaign) -> Campaign:
        """The tests that are learned from, evenly over speed; the notes of predictions tell if these are not all."""
        n = len(campaign.tests)
        self._thinning = (f"Of {n} tests {MOST_TESTS} were learned from, evenly over speed.",) * (n > MOST_TESTS)
        return campaign.evenly_over_speed(MOST_TESTS)

    def _require(self, learned: str) -> None:
        """Raise unless ``fit`` has set this attribute."""
        if not hasattr(self, learned):
            raise NotFittedError(f"The approach {self.name} has not been fitted; call fit(campaign) first.")

    @property
    def device(self) -> str:
        """Kind of device that it trains on, ``cpu`` or ``cuda``, if that decides the last bits; else empty.

        Raises
        ------
        UsageError
            If the device that was asked for is not there.
        """
        return ""

    @property
    def state(self) -> dict[str, object]:
        """What the fit found, as plain JSON values, for study.json and the pages."""
        return {}
