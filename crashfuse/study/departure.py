"""What sets a test apart: it differs from the tests beside it more than they do from each other.

No approach predicts such a test from its neighbours. Either something is wrong with its record, or the structure
folded in another way (a bifurcation), which the next test may do again.
"""

import json
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from math import sqrt
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from crashfuse.approaches.displacement_domain.approach import measured_bias
from crashfuse.approaches.displacement_domain.bias import BiasPoints
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import Cache, Entry
from crashfuse.execution.code_digest import code_digest
from crashfuse.signals.rating import rate_windows
from crashfuse.study.expected_rating import rating_range
from crashfuse.wording import Sentence, acceleration, speed

WINDOW_MS = 60.0
LEAST = 3  # neighbours: of three tests one is always farther from both others than these from each other
_MOST = 12  # neighbours
_KIND = "departures"  # in the cache


@dataclass(frozen=True, slots=True)
class Departure:
    """How a test differs from its neighbours, the tests at about its speed, and they from each other.

    Attributes
    ----------
    neighbours : tuple of str
        Ids of the other tests of its speed group, at least three.
    bias_mps2, bias_between_mps2 : tuple of float
        Root mean square differences of what the CAE model gets wrong, over displacement: of the test from each
        neighbour, and of every two of them from each other.
    ratings, ratings_between : tuple of float
        Overall ratings of the pulses against each other, mean of both directions, likewise; each pulse is scaled to
        the other's speed.
    """

    test: str
    neighbours: tuple[str, ...]
    speed_mps: float
    window_ms: float
    bias_mps2: tuple[float, ...]
    bias_between_mps2: tuple[float, ...]
    ratings: tuple[float, ...]
    ratings_between: tuple[float, ...]

    @property
    def by_bias(self) -> bool:
        """Whether its bias differs from that of every neighbour by more than any two of theirs do."""
        return min(self.bias_mps2) > max(self.bias_between_mps2)

    @property
    def by_pulse(self) -> bool:
        """Whether its pulse rates worse against every neighbour than any two of theirs do against each other."""
        return max(self.ratings) < min(self.ratings_between)

    @property
    def apart(self) -> bool:
        """Whether the test stands apart, both by its bias and its pulse."""
        return self.by_bias and self.by_pulse

    @property
    def sentence(self) -> str:
        """That the test stands apart, by how much, and what to do; or that it does not."""
        if not self.apart:
            return Sentence(
                "{} does not stand apart from the tests at its speed: they differ from each other as much.", self.test
            )
        return Sentence(
            "{} differs from the other {} tests at about {} by {} or more (RMS over crush), these from each other by "
            "{} or less. A test there may fold either way: check its record, or judge {} by both.",
            self.test,
            len(self.neighbours),
            speed(self.speed_mps),
            acceleration(min(self.bias_mps2)),
            acceleration(max(self.bias_between_mps2)),
            speed(self.speed_mps),
        )

    @property
    def evidence(self) -> str:
        """How the pulses of the test and its neighbours rate against each other."""
        return Sentence(
            "Its pulse rates {} against {}, theirs {} against each other.",
            rating_range(min(self.ratings), max(self.ratings)),
            ", ".join(self.neighbours),
            rating_range(min(self.ratings_between), max(self.ratings_between)),
        )


def departure(campaign: Campaign, test_id: str, model: CaeModel, window_ms: float = WINDOW_MS) -> Departure | None:
    """Compare a test with the others of its speed group, and those with each other; None if there are under three.

    Of a larger group, with the twelve of nearest weights.

    Parameters
    ----------
    model : CaeModel
        Fitted to the campaign's CAE runs.
    window_ms : float
        Pulses are rated over [0, window_ms).
    """
    return _departure(campaign, test_id, model, window_ms, only_apart=False)


def departures(campaign: Campaign, cache: Cache | None = None) -> tuple[Departure, ...]:
    """How each test that stands apart differs from the others at its speed, over 0–60 ms; kept in the cache."""
    if campaign not in _known:  # asked for at every condition
        _known[campaign] = _kept(campaign, cache or Cache())
    return _known[campaign]


_known: WeakKeyDictionary[Campaign, tuple[Departure, ...]] = WeakKeyDictionary()


def _kept(campaign: Campaign, cache: Cache) -> tuple[Departure, ...]:
    if not any(len(campaign.speed_group(test_id)) > LEAST for test_id in campaign.test_ids):
        return ()
    key = {"campaign": campaign.fingerprint, "code": code_digest(__name__)}
    return cache.get_or_compute(_KIND, key, lambda: _found(campaign, cache), _restored)


def _found(campaign: Campaign, cache: Cache) -> tuple[tuple[Departure, ...], dict[str, np.ndarray]]:
    model = CaeModel(cache=cache).fit(campaign.cae)
    compared = (_departure(campaign, test_id, model, WINDOW_MS, only_apart=True) for test_id in campaign.test_ids)
    apart = tuple(departure for departure in compared if departure is not None and departure.apart)
    return apart, {"departures": np.array(json.dumps([asdict(departure) for departure in apart]))}


def _restored(entry: Entry) -> tuple[Departure, ...]:
    return tuple(map(_departure_of, json.loads(str(entry["departures"]))))


def _departure_of(record: dict[str, Any]) -> Departure:
    values: dict[str, Any] = {name: tuple(x) if isinstance(x, list) else x for name, x in record.items()}
    return Departure(**values)


def _departure(
    campaign: Campaign, test_id: str, model: CaeModel, window_ms: float, *, only_apart: bool
) -> Departure | None:
    """See :func:`departure`; None also, if only tests that stand apart are of interest, where the bias excludes it."""
    test = campaign.test(test_id)
    others = [campaign.test(other) for other in campaign.speed_group(test_id) if other != test_id]
    if len(others) < LEAST:
        return None
    nearest = sorted(others, key=lambda other: abs(other.condition.mass_kg - test.condition.mass_kg))[:_MOST]
    others = [other for other in others if other in nearest]
    bias = {own.id: measured_bias(own, model) for own in (test, *others)}
    pairs = list(combinations(others, 2))
    away = tuple(_bias_difference(bias[test.id], bias[other.id]) for other in others)
    between = tuple(_bias_difference(bias[one.id], bias[other.id]) for one, other in pairs)
    if only_apart and min(away) <= max(between):
        return None
    return Departure(
        test.id,
        tuple(other.id for other in others),
        test.condition.speed_mps,
        float(window_ms),
        away,
        between,
        tuple(_rated_both_ways(test, other, window_ms) for other in others),
        tuple(_rated_both_ways(one, other, window_ms) for one, other in pairs),
    )


def _bias_difference(one: BiasPoints, other: BiasPoints) -> float:
    """Root mean square difference over the displacement that both reach, in m/s²."""
    end = min(one.displacement_m[-1], other.displacement_m[-1])
    at = np.linspace(0.0, end, 200)
    first, second = (np.interp(at, own.displacement_m, own.bias_mps2) for own in (one, other))
    return sqrt(float(((first - second) ** 2).mean()))


def _rated_both_ways(one: CrashTest, other: CrashTest, window_ms: float) -> float:
    """Mean of the ratings of each pulse against the other, which is scaled to its speed."""
    return float(np.mean([_rated(one, other, window_ms), _rated(other, one, window_ms)]))


def _rated(test: CrashTest, other: CrashTest, window_ms: float) -> float:
    scale = test.condition.speed_mps / other.condition.speed_mps
    scaled = replace(other.pulse, accel_mps2=scale * other.pulse.accel_mps2)
    return rate_windows(test.pulse, scaled, [window_ms])[float(window_ms)].overall
