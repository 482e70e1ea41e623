"""The interface of an approach: its names and plot style, fitting to a campaign, prediction at a condition."""

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, NamedTuple, Self, get_args

import numpy as np
import numpy.typing as npt

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import NotFittedError, UsageError, one_of, require_number
from crashfuse.execution.cache import Cache, Code, Entry
from crashfuse.execution.run import UNKEPT, Run
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, FloatArray
from crashfuse.signals.rating import WEIGHTS, corridor_score, slope_score
from crashfuse.units import G
from crashfuse.vehicle_archive import Prior

Preset = Literal["fast", "paper"]
PRESETS: tuple[Preset, ...] = get_args(Preset)

Device = Literal["auto", "cpu", "cuda"]
DEVICES: tuple[Device, ...] = get_args(Device)


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings that approaches are created from; each uses those that apply to it.

    Parameters
    ----------
    preset : {"fast", "paper"}
        ``paper`` uses the settings of Tables 2 and 4, ``fast`` ours. ``fused`` uses the fast forms either way.
    seed : int
        Of networks, draws and the starts of optimisers.
    device : {"auto", "cpu", "cuda"}
        For training networks; ``auto`` uses CUDA if available. Everything else runs on the CPU. Results of different
        devices differ in their last bits.
    """

    preset: Preset = "fast"
    seed: int = 0
    device: Device = "auto"

    def __post_init__(self) -> None:
        one_of("preset", self.preset, dict.fromkeys(PRESETS))
        one_of("device", self.device, dict.fromkeys(DEVICES))


WHOLE_SHARE, WHOLE_S = 0.9, 0.06  # of tests that lie inside the band of whole pulses, and until when
_COMPARED_DRAWS = 100  # about how many, for their agreement
_LEAST_WIDTH_MPS2 = 0.5 * G  # at contact all draws agree, to less than a sensor does


@dataclass(frozen=True, eq=False)
class Prediction:
    """The pulse that an approach predicts at a condition, on :data:`crashfuse.signals.pulse.GRID_S`, in m/s²."""

    condition: Condition
    accel_mps2: FloatArray  # the central prediction, shape (1250,)
    draws_mps2: FloatArray | None = None  # equally likely whole pulses, shape (n_draws, 1250); None without a band
    notes: tuple[str, ...] = ()  # for the reader: extrapolation, the source of the CAE pulse, a fit that was retried
    apart: npt.NDArray[np.bool_] | None = None  # draws that fold as a test that stands apart; None if all fold alike
    apart_as: str = ""  # the id of that test

    def __repr__(self) -> str:
        drawn = "no band" if self.draws_mps2 is None else f"{len(self.draws_mps2)} draws"
        return f"<Prediction at {self.condition}, {drawn}>"

    @property
    def time_s(self) -> FloatArray:
        """The study grid in s, shape (1250,)."""
        return GRID_S

    @property
    def agreement(self) -> float:
        """How well its draws agree with it, 0 to 1: their median score over 0–60 ms; NaN without draws.

        By corridor and slope, whose scores take no search for shifts and warps.
        """
        if self.draws_mps2 is None:
            return float("nan")
        n, every = round(WHOLE_S / DT_S), max(len(self.draws_mps2) // _COMPARED_DRAWS, 1)
        pulse, draws = self.accel_mps2[:n], np.asarray(self.draws_mps2[::every, :n], dtype=np.float64)
        corridor, slope = WEIGHTS["corridor"], WEIGHTS["slope"]
        scores = corridor * corridor_score(pulse, draws) + slope * slope_score(pulse, draws)
        return float(np.median(scores)) / (corridor + slope)

    def band(self, level: float = 0.95) -> tuple[FloatArray, FloatArray] | None:
        """Central prediction interval at each time as (lower, upper) in m/s², or None; ``level`` is its share."""
        require_number("level", level)
        if not 0 < level < 1:
            raise UsageError(f"The level of a band is a share between 0 and 1, such as 0.95, not {level:g}.")
        return None if self.draws_mps2 is None else central_interval(self.draws_mps2, level)

    @property
    def folds_mps2(self) -> tuple[FloatArray, ...]:
        """The average of draws that fold as most tests there, and of those that fold as the one apart; or none."""
        if self.apart is None or self.draws_mps2 is None:
            return ()
        return tuple(self.draws_mps2[draws].mean(axis=0, dtype=float) for draws in (~self.apart, self.apart))

    def whole_band(self) -> tuple[FloatArray, FloatArray] | None:
        """Band inside which nine of ten tests lie as a whole, see :func:`whole_interval`; or None."""
        return None if self.draws_mps2 is None else whole_interval(self.draws_mps2)


def central_interval(draws: FloatArray, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Central interval of draws, shape (n_draws, ...): to the bit ``numpy.quantile``, in a fifth of the time."""
    ordered, tail = np.sort(draws, axis=0), (1 - level) / 2
    low, high = (_at(ordered, share * (len(ordered) - 1)) for share in (tail, 1 - tail))
    return low, high


def whole_interval(draws: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Band inside which nine of ten whole draws lie up to 60 ms, shape (n_draws, 1250 / k), in m/s².

    It is the central 95 % interval, made wider about the median by one factor for all times (Diquigiovanni, Fontana,
    Vantini, *The importance of being a band*, Statistica Sinica 35, 2025).
    """
    ordered = np.sort(draws, axis=0)
    lower, median, upper = (_at(ordered, share * (len(ordered) - 1)) for share in (0.025, 0.5, 0.975))
    above, below = (np.maximum(width, _LEAST_WIDTH_MPS2) for width in (upper - median, median - lower))
    judged = _judged(draws.shape[1])
    away = draws[:, judged] - median[judged]
    reach = np.maximum(away / above[judged], -away / below[judged]).max(axis=1)
    factor = float(np.quantile(reach, WHOLE_SHARE))
    return median - factor * below, median + factor * above


def holds_whole(band: tuple[FloatArray, FloatArray], accel_mps2: FloatArray) -> bool:
    """Whether a pulse, shape (1250,), lies inside a band, at every k-th sample, up to 60 ms throughout."""
    lower, upper = band
    accel = accel_mps2[:: N_SAMPLES // lower.size]
    return bool(((lower <= accel) & (accel <= upper))[_judged(lower.size)].all())


def _judged(n_times: int) -> slice:
    return slice(round(WHOLE_S / (N_SAMPLES * DT_S) * n_times))


def _at(ordered: FloatArray, place: float) -> FloatArray:
    row, share = int(place), np.float64(place % 1)  # float64 also of draws in float32
    before, after = ordered[row], ordered[min(row + 1, len(ordered) - 1)]
    step = after - before
    values: FloatArray = before + step * share if share < 0.5 else after - step * (1 - share)  # as NumPy does
    return values


@dataclass(frozen=True, eq=False)
class FittedState:
    """Result of a fit, JSON values and arrays: with the fitted data it gives every prediction again."""

    values: Mapping[str, Any]
    arrays: Entry

    @classmethod
    def of(cls, values: Mapping[str, Any], arrays: Entry, **parts: "FittedState") -> "FittedState":
        """Combine values and arrays with the states of a model's parts."""
        nested = {f"{part}/{name}": array for part, state in parts.items() for name, array in state.arrays.items()}
        return cls({**values, **{part: state.values for part, state in parts.items()}}, {**arrays, **nested})

    def part(self, name: str) -> "FittedState":
        """The state of the part with this name."""
        start = f"{name}/"
        arrays = {key.removeprefix(start): array for key, array in self.arrays.items() if key.startswith(start)}
        return FittedState(self.values[name], arrays)


FITS = "fits"  # kind of cache entry
_TEXT = "text"  # name of the array there that holds everything else as JSON
MOST_TESTS = 30  # that the exact posteriors are fitted to: their cost grows with the cube of the number


class Approach(ABC):
    """One way to predict a pulse, with everything that the rest of the program needs to know about it.

    A new approach is a subclass in its own module, listed in :mod:`crashfuse.approaches.registry`. Fitted attributes
    end in an underscore; hyperparameters are a frozen config. Before :meth:`fit`, all that needs it raises
    NotFittedError; :meth:`prepare` and :meth:`fit` raise Cancelled if the run was told to stop,
    and keep what does not depend on the tests (emulator, LF training) in its cache.

    Attributes
    ----------
    name, label, in_words : str
        The name in files and calls, in figures and tables, and in a sentence, with its article.
    description : str
        What it does, as a sentence to follow its label and a colon.
    colour, dark_colour, dash : str
        ``#RRGGBB`` of its curves on a white and, if that is not legible there, on a dark page; Plotly's dash style:
        solid is reserved for approaches that learn from tests.
    preference : int
        Among approaches that the tests cannot separate, the lowest number is recommended.
    learns_from_tests, trains_networks : bool
        Whether :meth:`fit` uses tests, and whether :meth:`prepare` trains networks, which takes long.
    made_of : tuple of Approach classes
        The approaches that it mixes, if any; the first note of a prediction then states the weights.
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
    trains_networks: ClassVar[bool] = False
    made_of: ClassVar[tuple[type["Approach"], ...]] = ()

    taught_: float = 0.0  # how far past vehicles teach this fit, up to 1
    _thinning: tuple[str, ...] = ()

    @classmethod
    def create(cls, settings: Settings) -> Self:  # noqa: ARG003 - most others need it
        """Create an unfitted approach from the settings that apply to it."""
        return cls()

    @classmethod
    def taught_by(cls, prior: Prior | None) -> Prior | None:  # noqa: ARG003 - most do not
        """What :meth:`fit` uses of what past vehicles teach, ``campaign.prior``."""
        return None

    def prepare(self, campaign: Campaign, conditions: Sequence[Condition], run: Run = UNKEPT) -> None:  # noqa: ARG002
        """Compute and cache everything that no test's pulse affects; all fits to these CAE runs share it.

        The campaign has the CAE runs and no tests; ``conditions`` are where tests are learned from or predicted.
        """
        if not self.learns_from_tests:
            self.fit(campaign, run)

    @abstractmethod
    def fit(self, campaign: Campaign, run: Run = UNKEPT) -> Self:
        """Fit to the whole campaign as given; a UsageError or DataError if there is not enough to learn from."""

    @abstractmethod
    def predict(self, condition: Condition) -> Prediction:
        """Predict the pulse at a condition."""

    @property
    def parts(self) -> tuple["Approach", ...]:
        """The fitted approaches that this one mixes, one of each class in ``made_of``."""
        return ()

    def predict_from(self, condition: Condition, parts: Sequence[Prediction]) -> Prediction:  # noqa: ARG002 - see above
        """Predict as :meth:`predict` does, given the predictions of its :attr:`parts` at this condition."""
        return self.predict(condition)

    def left_out(self, campaign: Campaign) -> dict[str, Prediction]:
        """Prediction for each test left out (cross-validation), by id; empty under the paper's preset."""
        return {} if self.learns_from_tests else {test.id: self.predict(test.condition) for test in campaign.tests}

    @abstractmethod
    def learned(self) -> FittedState:
        """The fitted state, the result of :meth:`fit`."""

    @abstractmethod
    def restore(self, campaign: Campaign, learned: FittedState, run: Run = UNKEPT) -> Self:
        """Restore what was learned from this campaign; a KeyError, ValueError or RuntimeError if it was not."""

    @property
    def identity(self) -> dict[str, object]:
        """All that determines its numbers besides the data: kept fits are those of the same approach and settings."""
        settings = {"config": getattr(self, "config", None), "seed": getattr(self, "seed", 0), "device": self.device}
        return {"code": Code(type(self).__module__), "approach": self.name, **settings}

    def fitted(self, campaign: Campaign, run: Run) -> tuple[Self, float]:
        """:meth:`fit`, or :meth:`restore` what the cache has of the same fit; and how long that took, in s."""
        campaign = self._taught(campaign)

        def learn() -> tuple[float, Mapping[str, npt.ArrayLike]]:
            start = time.perf_counter()
            self.fit(campaign, run)
            seconds = time.perf_counter() - start
            learned = self.learned()
            text = json.dumps({"values": learned.values, "seconds": seconds})
            return seconds, {**learned.arrays, _TEXT: np.array(text)}

        def restore(entry: Entry) -> float:
            text = json.loads(str(entry.pop(_TEXT)))
            self.restore(campaign, FittedState(text["values"], entry), run)
            return float(text["seconds"])

        return self, run.get_or_compute(FITS, self.fit_key(campaign), learn, restore)

    def is_cached(self, campaign: Campaign) -> bool:
        """Whether :meth:`fitted` would find this fit in the campaign's cache."""
        return Cache(campaign.cache_folder).is_cached(FITS, self.fit_key(self._taught(campaign)))

    def _taught(self, campaign: Campaign) -> Campaign:
        # fits that past vehicles do not change are those without an archive
        return replace(campaign, prior=self.taught_by(campaign.prior))

    def fit_key(self, campaign: Campaign) -> dict[str, object]:
        """All that determines a fit."""
        return {**self.identity, "campaign": replace(campaign, cae=campaign.cae.learned_from).fingerprint}

    def _thinned(self, campaign: Campaign) -> Campaign:
        n = len(campaign.tests)
        self._thinning = (f"Of {n} tests {MOST_TESTS} were learned from, evenly over speed.",) * (n > MOST_TESTS)
        return campaign.evenly_over_speed(MOST_TESTS)

    def _require_tests(self, campaign: Campaign) -> None:
        if not campaign.tests:
            name = f"{self.in_words[0].upper()}{self.in_words[1:]}"
            raise UsageError(f"{name} learns from tests; this campaign has none.")

    def _require(self, learned: str) -> None:
        if not hasattr(self, learned):
            raise NotFittedError(f"The approach {self.name} has not been fitted; call fit(campaign) first.")

    @property
    def usual_errors(self) -> Mapping[str, FloatArray]:
        """Standardised errors of metrics that past vehicles teach, beside those of left-out tests; most have none."""
        return {}

    @property
    def device(self) -> str:
        """Device it trains on, ``cpu`` or ``cuda``, if that affects the last bits; a UsageError if there is none."""
        return ""

    @property
    def state(self) -> dict[str, object]:
        """Fit results as plain JSON values, for study.json and the pages."""
        return {}


def draw(mean: FloatArray, covariance: FloatArray, n_samples: int, rng: np.random.Generator) -> FloatArray:
    """Draw from a normal distribution whose covariance may be singular, shape (n_samples, m)."""
    return np.asarray(mean + rng.standard_normal((n_samples, mean.size)) @ root(covariance).T)


def root(covariance: FloatArray) -> FloatArray:
    """A root of a covariance that may be singular: times its transpose it gives the covariance, shape (m, m)."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


class StudentT(NamedTuple):
    """Student's t of several numbers at once: its location, shape (m,), and a :func:`root` of its scale matrix."""

    mean: FloatArray
    root: FloatArray
    freedom: int

    def draw(self, n_samples: int, rng: np.random.Generator) -> FloatArray:
        """Draws, shape (n_samples, m)."""
        widening = np.sqrt(self.freedom / rng.chisquare(self.freedom, size=(n_samples, 1)))
        normal = np.zeros_like(self.mean) + rng.standard_normal((n_samples, self.mean.size)) @ self.root.T
        return np.asarray(self.mean + widening * normal)
