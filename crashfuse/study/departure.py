"""What sets a test apart: it differs from the tests beside it more than they do from each other.

No approach predicts such a test from its neighbours. Either something is wrong with its record, or the structure
folded in another way (a bifurcation), which the next test may do again.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from math import sqrt

import numpy as np

from crashfuse.approaches.displacement_domain.approach import measured_bias
from crashfuse.approaches.displacement_domain.bias import BiasPoints
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.signals.rating import rate_windows
from crashfuse.study.expected_rating import rating_range
from crashfuse.wording import Quantity, Sentence, acceleration

LEAST = 3  # neighbours: of three tests one is always farther from both others than these from each other


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
    def sentences(self) -> tuple[str, ...]:
        """What was found, what was measured, and what to do about it."""
        measured = Sentence(
            "Its pulse rates {} against {}, theirs {} against each other; what the CAE model gets wrong in it, over "
            "displacement, differs by {} (RMS) from theirs, theirs by {} from each other.",
            rating_range(min(self.ratings), max(self.ratings)),
            ", ".join(self.neighbours),
            rating_range(min(self.ratings_between), max(self.ratings_between)),
            _accels(self.bias_mps2),
            _accels(self.bias_between_mps2),
        )
        if not self.apart:
            found = "{} does not stand apart from the tests at its speed: they differ from each other as much."
            return Sentence(found, self.test), measured
        found = "{} differs from the tests at its speed more than they do from each other."
        advice = "Check its record and its condition, or expect bifurcation: another such test may go either way."
        return Sentence(found, self.test), measured, advice


def departure(campaign: Campaign, test_id: str, model: CaeModel, window_ms: float = 60.0) -> Departure | None:
    """Compare a test with the others of its speed group, and those with each other; None if there are under three.

    Parameters
    ----------
    model : CaeModel
        Fitted to the campaign's CAE runs.
    window_ms : float
        Pulses are rated over [0, window_ms).
    """
    test = campaign.test(test_id)
    others = [campaign.test(other) for other in campaign.speed_group(test_id) if other != test_id]
    if len(others) < LEAST:
        return None
    bias = {own.id: measured_bias(own, model) for own in (test, *others)}
    pairs = list(combinations(others, 2))
    return Departure(
        test.id,
        tuple(other.id for other in others),
        float(window_ms),
        tuple(_bias_difference(bias[test.id], bias[other.id]) for other in others),
        tuple(_bias_difference(bias[one.id], bias[other.id]) for one, other in pairs),
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


def _accels(values_mps2: tuple[float, ...]) -> Quantity:
    return acceleration(*dict.fromkeys((min(values_mps2), max(values_mps2))), between=" to ")
