"""What sets a test apart: it differs from the tests beside it more than they do from each other.

No approach predicts such a test from its neighbours. Either something is wrong with its record, or the structure
folded in another way (a bifurcation), which the next test may do again.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache as cached
from itertools import combinations
from math import sqrt
from typing import Any

import numpy as np

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.displacement_domain.approach import measured_bias
from crashfuse.approaches.displacement_domain.bias import BiasPoints
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import SPEED_STEP_MPS, CrashTest
from crashfuse.execution.cache import Code, Entry, remembered
from crashfuse.execution.run import Run
from crashfuse.signals.metrics import Metric
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.rating import GRADES, rate_windows
from crashfuse.units import G, Sentence, acceleration, read_out, speed

WINDOW_MS = 60.0
LEAST = 3  # neighbours: of three tests one is always farther from both others than these from each other
_MOST = 12  # neighbours
_KIND = "departures"  # in the cache


@dataclass(frozen=True, slots=True)
class Departure:
    """How a test differs from its neighbours, three other tests of its speed group at least, and they from each other.

    By root mean square differences of what the CAE model gets wrong over displacement, and by ratings of the pulses
    against each other, scaled to the other's speed: of the test with each neighbour, and between every two of them.
    """

    test: str
    neighbours: tuple[str, ...]
    speed_mps: float
    window_ms: float
    bias_mps2: tuple[float, ...]
    bias_between_mps2: tuple[float, ...]
    ratings: tuple[float, ...]
    ratings_between: tuple[float, ...]
    alone: tuple[str, ...] = ()  # factors with the value that none of its neighbours has

    @property
    def apart(self) -> bool:
        """Whether it differs more from each neighbour than any two of these do, by bias and pulse, below Excellent."""
        by_bias = min(self.bias_mps2) > max(self.bias_between_mps2)
        return by_bias and max(self.ratings) < min(GRADES[0][0], *self.ratings_between)


def departure(campaign: Campaign, test_id: str, model: CaeModel, window_ms: float = WINDOW_MS) -> Departure | None:
    """Compare a test with the others of its speed group, and those with each other; None if there are under three.

    Of a larger group, with the twelve of nearest weights. The model is fitted to the campaign's CAE runs.
    """
    return _departure(campaign, campaign.test(test_id), lambda test: measured_bias(test, model), window_ms)


@remembered
def departures(campaign: Campaign) -> tuple[Departure, ...]:
    """How each test that stands apart differs from the others at its speed, over 0–60 ms; kept in the cache."""
    has_groups = any(len(campaign.speed_group(test_id)) > LEAST for test_id in campaign.test_ids)
    return _cached_departures(campaign, Run.of(campaign)) if has_groups else ()


def departures_near(campaign: Campaign, condition: Condition, *, at_nearest: bool = False) -> tuple[Departure, ...]:
    """How the tests that stand apart at about the speed of a condition, or the tested one nearest to it, differ."""
    away = {test.id: abs(test.condition.speed_mps - condition.speed_mps) for test in campaign.tests}
    reach = SPEED_STEP_MPS + (min(away.values(), default=0.0) if at_nearest else 0.0)
    near = {test_id for test_id in away if away[test_id] < reach}
    if all(len(campaign.speed_group(test_id)) <= LEAST for test_id in near):
        return ()  # without a look at all tests, which takes a second
    return tuple(departure for departure in departures(campaign) if departure.test in near)


def with_both_folds(
    prediction: Prediction, departure: Departure, test: CrashTest, left_out_mps2: FloatArray, fitted_mps2: FloatArray
) -> Prediction:
    """The prediction near a test that stands apart: a test here may fold as it did, or as the others at its speed.

    The two differ by what the test showed more than is predicted without it (``left_out_mps2``), in proportion to the
    speed. What a fit to all has learned of that, as its prediction for the test (``fitted_mps2``) shows, is taken out.
    Then 1½ of n + 1 draws (n tests, one of them apart; Jeffreys' prior) have the whole difference.
    """
    if prediction.draws_mps2 is None:
        return prediction
    whole = test.pulse.accel_mps2 - left_out_mps2
    learned = float(np.clip((fitted_mps2 - left_out_mps2) @ whole / (whole @ whole), 0.0, 1.0))
    difference = prediction.condition.speed_mps / test.condition.speed_mps * whole
    share = 1.5 / (len(departure.neighbours) + 2)
    apart = np.diff(np.floor(np.arange(len(prediction.draws_mps2) + 1) * share)) > 0
    draws = prediction.draws_mps2 + np.multiply.outer(apart - learned, difference)
    expected = prediction.accel_mps2 - learned * difference
    return replace(prediction, accel_mps2=expected, draws_mps2=draws, apart=apart, apart_as=test.id)


def folds_sentence(departure: Departure, metrics: Sequence[Metric]) -> str:
    """What a prediction near a test that stands apart shows in either way to fold."""
    peak, crush = (next(metric.folds for metric in metrics if metric.name == name) for name in ("peak", "max_crush"))
    peaks = [acceleration((fold.value or 0.0) * G) for fold in peak.values()]
    crushes = [f"{fold.value or 0.0:.0f} mm" for fold in crush.values()]
    template = "Tests at about {} came out in two ways: as {} (here peak {}, crush {}), or as {} (peak {}, crush {})."
    usual = speed(departure.speed_mps), read_out(departure.neighbours), peaks[0], crushes[0]
    return Sentence(template, *usual, departure.test, peaks[1], crushes[1])


def _cached_departures(campaign: Campaign, run: Run) -> tuple[Departure, ...]:
    def compute() -> tuple[tuple[Departure, ...], Entry]:
        model = CaeModel().fit(campaign.cae, run)
        bias_of = cached(lambda test: measured_bias(test, model))  # of each test once
        compared = (_departure(campaign, test, bias_of, WINDOW_MS, only_apart=True) for test in campaign.tests)
        apart = tuple(departure for departure in compared if departure is not None and departure.apart)
        return apart, {"departures": np.array(json.dumps([asdict(departure) for departure in apart]))}

    def restore(entry: Entry) -> tuple[Departure, ...]:
        records = json.loads(str(entry["departures"]))
        rows: list[Any] = [{k: tuple(x) if isinstance(x, list) else x for k, x in own.items()} for own in records]
        return tuple(Departure(**values) for values in rows)

    key = {"campaign": campaign.fingerprint, "code": Code(__name__)}
    return run.get_or_compute(_KIND, key, compute, restore)


def _departure(
    campaign: Campaign,
    test: CrashTest,
    bias_of: Callable[[CrashTest], BiasPoints],
    window_ms: float,
    *,
    only_apart: bool = False,
) -> Departure | None:
    others = [campaign.test(other) for other in campaign.speed_group(test.id) if other != test.id]
    if len(others) < LEAST:
        return None
    nearest = sorted(others, key=lambda other: abs(other.condition.mass_kg - test.condition.mass_kg))[:_MOST]
    others = [other for other in others if other in nearest]
    away, between = [(test, other) for other in others], list(combinations(others, 2))
    bias, bias_between = (tuple(_bias_difference(*map(bias_of, pair)) for pair in own) for own in (away, between))
    if only_apart and min(bias) <= max(bias_between):
        return None
    ratings, ratings_between = (tuple(_rated_both_ways(*pair, window_ms) for pair in own) for own in (away, between))
    ids, speed_mps = tuple(other.id for other in others), test.condition.speed_mps
    known = {name: {dict(own.condition.factors).get(name, "") for own in others} for name, _ in test.condition.factors}
    alone = tuple(f"{name} {v}" for name, v in test.condition.factors if v and not {v, ""} & known[name])
    return Departure(test.id, ids, speed_mps, float(window_ms), bias, bias_between, ratings, ratings_between, alone)


def _bias_difference(one: BiasPoints, other: BiasPoints) -> float:
    at = np.linspace(0.0, min(one.displacement_m[-1], other.displacement_m[-1]), 200)
    first, second = (np.interp(at, points.displacement_m, points.bias_mps2) for points in (one, other))
    return sqrt(float(((first - second) ** 2).mean()))


def _rated_both_ways(one: CrashTest, other: CrashTest, window_ms: float) -> float:
    ratings = []
    for test, compared in ((one, other), (other, one)):
        scale = test.condition.speed_mps / compared.condition.speed_mps
        scaled = replace(compared.pulse, accel_mps2=scale * compared.pulse.accel_mps2)
        ratings.append(rate_windows(test.pulse, scaled, [window_ms])[float(window_ms)].overall)
    return float(np.mean(ratings))
