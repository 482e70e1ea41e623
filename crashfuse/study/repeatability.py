"""Repeatability: the rating that a repeat of each test would get against it, a measure for its predictions.

Pulses of repeats are drawn with the scatter that all tests of a campaign show and rated against the test. Where it has
been repeated, what the repeats rate counts too, by how much it says. Nothing of this is used to predict.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache as once
from functools import partial

import numpy as np

from crashfuse.approaches.displacement_domain.scatter import Scatter
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import Cache, Entry, numbers
from crashfuse.execution.code_digest import code_digest
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.pulse import DT_S, FloatArray
from crashfuse.signals.rating import rate_many

REPEATABILITY = "Repeatability"
"""Name of this step of a computation in progress reports."""

_KIND = "repeatability"  # of cache entry
_N_DRAWS = 100
_SAME = 0.02  # relative difference in speed and mass up to which a test counts as a repeat
_LEAST_LACK = 1e-4  # of a rating to 1: identical pulses lack nothing, and have no logarithm
_LEAST_SPREAD = 0.1
_REACH = 1.96  # standard deviations on each side of a central 95 % interval
_MODEL_SPREAD, _SPREAD_OF_A_TEST = 0.15, 2.0


@dataclass(frozen=True, slots=True)
class Repeatability:
    """The overall rating that a repeat of a test would get against it over one window: expectation and central 95 %."""

    value: float
    lower: float
    upper: float
    repeats: tuple[str, ...] = ()  # ids of the tests at about the same condition whose rating counted

    @property
    def text(self) -> str:
        """The value with its interval."""
        return f"{self.value:.3f} [{self.lower:.2f}, {self.upper:.2f}]"

    def sentence(self, rating: float, label: str) -> str:
        """How the rating of an approach's prediction compares with what a repeat would get."""
        place = "below" if rating < self.lower else "above" if rating > self.upper else "within"
        repeat = f"A repeat of this test would rate {self.text} (95 %)"
        return f"{repeat}; the prediction's {rating:.3f} ({label}) is {place} what repeats reach."


def repeatability(
    campaign: Campaign,
    windows_ms: Sequence[float],
    tests: Sequence[str] = (),
    *,
    seed: int = 0,
    cache: Cache | None = None,
    watch: Watch = SILENT,
) -> dict[str, dict[float, Repeatability]]:
    """Estimate for tests, by default all, and windows [0, w) how a repeat would rate against each; cached.

    Empty of a campaign of one test, and of a test over a window which its record does not fill.
    """
    if len(campaign.tests) < 2:
        return {}
    windows = tuple(float(window) for window in windows_ms)
    cache, chosen = cache or Cache(), tests or campaign.test_ids
    shared = {"campaign": campaign.fingerprint, "windows": windows, "seed": seed, "code": code_digest(__name__)}
    by_test = {}

    @once
    def scatter() -> Scatter:
        return Scatter(cache=cache).fit(campaign, watch)

    def compute(test_id: str, repeats: tuple[CrashTest, ...]) -> tuple[FloatArray, Entry]:
        rng = np.random.default_rng([seed, campaign.test_ids.index(test_id)])
        drawn = scatter().repeats(campaign.test(test_id), _N_DRAWS, rng)
        rated = _rated(campaign.test(test_id), repeats, drawn, windows, len(campaign.tests))
        return rated, {"rated": rated}

    for done, test_id in enumerate(chosen):
        watch.report(REPEATABILITY, done, len(chosen))
        repeats, key = repeats_of(campaign.test(test_id), campaign), {**shared, "test": test_id}
        work = partial(compute, test_id, repeats)
        rated = cache.get_or_compute(_KIND, key, work, lambda entry: numbers(entry, "rated", len(windows), 3), watch)
        by_test[test_id] = {
            window: Repeatability(value, lower, upper, tuple(other.id for other in repeats))
            for window, (value, lower, upper) in zip(windows, rated.tolist(), strict=True)
            if not np.isnan(value)
        }
    watch.report(REPEATABILITY, len(chosen), len(chosen))
    return by_test


def _rated(
    test: CrashTest, repeats: Sequence[CrashTest], drawn: FloatArray, windows_ms: Sequence[float], n_tests: int
) -> FloatArray:
    """Value, lower and upper by window, NaN where there is none, shape (n_windows, 3)."""
    unknown = _MODEL_SPREAD**2 + (_SPREAD_OF_A_TEST / n_tests) ** 2
    measured = np.array([other.pulse.accel_mps2 for other in repeats])
    rated = np.full((len(windows_ms), 3), np.nan)
    for row, window in zip(rated, windows_ms, strict=True):
        n = round(window / 1e3 / DT_S)
        if window / 1e3 <= test.recorded_s + 1e-3 and np.ptp(test.pulse.accel_mps2[:n]) > 0:
            lack = _lack(test, measured[:, :n]) if len(measured) else np.empty(0)
            row[:] = combined(_lack(test, drawn[:, :n]), lack, unknown)
    return rated


def repeats_of(test: CrashTest, campaign: Campaign) -> tuple[CrashTest, ...]:
    """The other tests at about the condition of this one: speed and mass within 2 %, and the same factors."""
    mine = test.condition
    return tuple(
        other
        for other in campaign.tests
        if other.id != test.id
        and abs(other.condition.speed_mps - mine.speed_mps) <= _SAME * mine.speed_mps
        and abs(other.condition.mass_kg - mine.mass_kg) <= _SAME * mine.mass_kg
        and other.condition.factors == mine.factors
    )


def _lack(test: CrashTest, pulses_mps2: FloatArray) -> FloatArray:
    """What the ratings of pulses against a test lack to 1."""
    rated = rate_many(test.pulse.accel_mps2[: pulses_mps2.shape[1]], pulses_mps2, dt_s=DT_S)
    return np.maximum([1 - rating.overall for rating in rated], _LEAST_LACK)


def combined(drawn: FloatArray, measured: FloatArray, unknown: float) -> tuple[float, float, float]:
    """Value, lower and upper end of a rating from what drawn and real repeats lack to 1, above 0.

    What ratings lack is taken as log-normal. The draws' mean is uncertain by the variance ``unknown`` of its logarithm,
    and each real repeat is one sample with the draws' spread, so the more repeats there are the more they count.
    """
    logs = np.log(drawn)
    spread = max(float(logs.std()), _LEAST_SPREAD)
    share, shift = 0.0, 0.0
    if measured.size:
        share = unknown / (unknown + spread**2 / measured.size)
        shift = share * float(np.log(measured).mean() - logs.mean())
    reach = _REACH * np.sqrt(spread**2 + (1 - share) * unknown)
    middle = float(logs.mean()) + shift
    value = 1 - float(drawn.mean()) * np.exp(shift)
    lower, upper = 1 - np.exp(middle + reach), 1 - np.exp(middle - reach)
    return max(value, 0.0), max(float(lower), 0.0), float(upper)
