"""Events of the CAE model's bias: ranges of crush where its force is too low or too high, and what that costs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import comb
from typing import cast

import numpy as np
import numpy.typing as npt
from scipy.special import stdtr, stdtrit

from crashfuse.approaches.base import MOST_TESTS
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import remembered
from crashfuse.execution.run import Run, one_thread
from crashfuse.signals.pulse import DT_S, FloatArray
from crashfuse.signals.rating import rate_many
from crashfuse.units import MS, G

_CELL_M = 0.01
_LEAST_CELLS = 4  # a CFC 60 pulse at 35 mph holds nothing shorter
_ROUNDED = 2  # cells at each end of an event, where the filter rounds it off
_CUT = 0.02  # share of the squared force of all tests that a further cut has to explain
_LEAST_MPS2 = 0.3 * G  # sensors differ as much
_SHOWN, _MOSTLY = 0.5, 2 / 3  # of the largest test's force, to show an event; of the tests that get there
_SURE = 0.95
_SHORT_S = 1e-3  # by which a record may lack the end of the window
_CHANCE = 20  # ways to choose as many tests: with fewer, they may be the heaviest by chance


@dataclass(frozen=True, eq=False, slots=True)
class CaeEvent:
    """A range of crush in which tests resist with another force than the CAE model."""

    from_m: float
    to_m: float
    from_s: float  # when the CAE vehicle passes it at the condition of the fastest test that shows it
    to_s: float
    timed_in: str
    force_n: float  # test minus CAE model, above 0 where the model is too soft
    lower_n: float
    upper_n: float
    probability: float  # of this sign
    conditions: str  # which of the tests that get there show it: all, most, fast, slow, heavy, light
    tests: tuple[str, ...]
    reached: tuple[str, ...]
    rating_alone: float = np.nan  # mean rating of the CAE model with this mended
    rating_but: float = np.nan  # with all others mended
    gain: float = np.nan  # mean of what mending it gives first and last
    share: float = np.nan  # of what the whole bias costs

    def accel_at(self, test: CrashTest, displacement_m: FloatArray) -> FloatArray:
        """What mends the CAE model at a test's condition."""
        is_mended = test.id in self.tests or test.id not in self.reached
        inside = (displacement_m >= self.from_m) & (displacement_m < self.to_m)
        return -self.force_n / test.condition.mass_kg * is_mended * inside


@dataclass(frozen=True, eq=False, slots=True)
class CaeEvents:
    """Events, the most expensive first, and the force that the CAE model lacks in the tests that taught its bias.

    Ratings are means over these tests: of the CAE model, with all events mended, and with the whole bias taken out.
    """

    events: tuple[CaeEvent, ...]
    tests: tuple[CrashTest, ...]
    displacement_m: FloatArray  # shape (n,)
    force_n: FloatArray  # shape (n_tests, n); NaN where the vehicle stops
    window_ms: float
    rating_cae: float
    rating_mended: float
    rating_all: float
    n_rated: int  # tests whose record lasts as long as the window


@remembered
def cae_events(campaign: Campaign, window_ms: float) -> CaeEvents:
    """Find what to mend in the CAE model by the hierarchical bias of all tests of a campaign."""
    domain, _ = DisplacementDomain().fitted(campaign, Run.of(campaign))
    with one_thread():
        return _events_of(domain, campaign.evenly_over_speed(MOST_TESTS).tests, window_ms)


def _events_of(domain: DisplacementDomain, tests: Sequence[CrashTest], window_ms: float) -> CaeEvents:
    stops = [points.speed_share < HierarchicalBias.end_share for points in domain.points_]
    ends = np.array([p.displacement_m[~stop].max() for p, stop in zip(domain.points_, stops, strict=True)])
    edges = np.arange(round(ends.max() / _CELL_M) + 1) * _CELL_M
    middles = edges[:-1] + _CELL_M / 2
    force = np.array([-test.condition.mass_kg * domain.common_bias([test], middles)[0] for test in tests])
    force[middles >= ends[:, None]] = np.nan
    events = [event for step in _steps(force) for event in _events(domain, tests, force[:, step], middles[step])]
    n, rated, overall = len(events), slice(round(window_ms * MS / DT_S)), []
    versions = np.vstack([np.zeros(n), np.ones(n), np.eye(n), 1 - np.eye(n)])
    recorded = [test for test in tests if test.recorded_s > window_ms * MS - _SHORT_S] or tests
    for test in recorded:

        def added(at: FloatArray, test: CrashTest = test) -> FloatArray:
            steps = np.reshape([event.accel_at(test, at) for event in events], (n, at.size))
            return np.vstack([domain.common_bias([test], at)[0], versions @ steps])

        pulses = domain.mended(test.condition, added)[:, rated]
        overall.append([rating.overall for rating in rate_many(test.pulse.accel_mps2[rated], pulses, dt_s=DT_S)])
    whole, cae, mended, *others = np.mean(overall, axis=0).tolist()
    ranked = []
    for event, alone, but in zip(events, others[:n], others[n:], strict=True):
        gain = (alone - cae + mended - but) / 2
        share = gain / (whole - cae) if whole > cae else np.nan
        ranked.append(replace(event, rating_alone=alone, rating_but=but, gain=gain, share=share))
    return CaeEvents(
        events=tuple(sorted(ranked, key=lambda event: -event.gain)),
        tests=tuple(tests),
        displacement_m=middles,
        force_n=force,
        window_ms=window_ms,
        rating_cae=cae,
        rating_mended=mended,
        rating_all=whole,
        n_rated=len(recorded),
    )


def _steps(force: FloatArray) -> Iterator[slice]:
    """Steps, last first, of the least squares for their number."""
    known, values = np.isfinite(force), np.nan_to_num(force)
    sums = [np.pad(np.cumsum(of, axis=1), ((0, 0), (1, 0))) for of in (known, values, values**2)]
    count, total, squares = (of[:, None, :] - of[:, :, None] for of in sums)
    cost = (squares - total**2 / np.maximum(count, 1)).sum(axis=0) + _CUT * (values**2).sum()
    best, first = np.append(0.0, np.full(force.shape[1], np.inf)), [0] * (force.shape[1] + 1)
    for stop in range(_LEAST_CELLS, best.size):
        costs = (best + cost[:, stop])[: stop - _LEAST_CELLS + 1]
        first[stop] = int(costs.argmin())
        best[stop] = costs[first[stop]]
    stop = force.shape[1]
    while stop >= _LEAST_CELLS:
        yield slice(first[stop], stop)
        stop = first[stop]


def _events(
    domain: DisplacementDomain, tests: Sequence[CrashTest], force: FloatArray, middles: FloatArray
) -> Iterator[CaeEvent]:
    """Events in a step: of tests that resist more, of those that resist less."""
    freedom, known = cast(HierarchicalBias, domain.bias_).freedom_, np.isfinite(force)
    arrived = known.mean(axis=1) > 0.5
    reached = [test for test, there in zip(tests, arrived, strict=True) if there]
    size = np.nanmean(force[arrived], axis=1)
    edges = np.array([middles[0] - _CELL_M / 2, middles[-1] + _CELL_M / 2])
    inner = middles[_ROUNDED:-_ROUNDED] if middles.size > 3 * _ROUNDED else middles
    for sign in (1, -1):
        shows = sign * size > max(_SHOWN * np.max(sign * size, initial=0.0), 0.0)
        if not (conditions := _conditions(reached, shows)):
            continue
        showing = [test for test, shown in zip(reached, shows, strict=True) if shown]
        mean, covariance = domain.common_bias(showing, inner)
        weights = -np.repeat([test.condition.mass_kg for test in showing], inner.size) / mean.size
        middle, spread = float(weights @ mean), float(np.sqrt(max(float(weights @ covariance @ weights), 1.0)))
        probability, reach = stdtr(freedom, sign * middle / spread), spread * stdtrit(freedom, 0.975)
        if probability < _SURE or sign * middle < -_LEAST_MPS2 * weights.sum():
            continue
        fastest = max(showing, key=lambda test: test.condition.speed_mps)
        phase = domain.model_.loading_curve(fastest.condition).phase
        from_s, to_s = np.interp(edges, phase.displacement_m, phase.time_s).tolist()
        yield CaeEvent(
            from_m=float(edges[0]),
            to_m=float(edges[1]),
            from_s=from_s,
            to_s=to_s,
            timed_in=fastest.id,
            force_n=middle,
            lower_n=middle - reach,
            upper_n=middle + reach,
            probability=probability,
            conditions=conditions,
            tests=tuple(test.id for test in showing),
            reached=tuple(test.id for test in reached),
        )


def _conditions(reached: Sequence[CrashTest], shows: npt.NDArray[np.bool_]) -> str:
    if shows.sum() < 2:  # nothing tells the CAE model's error from what a single test does
        return ""
    if shows.all():
        return "all"
    quantities = {("fast", "slow"): [test.condition.speed_mps for test in reached]}
    if comb(len(reached), int(shows.sum())) >= _CHANCE:
        quantities["heavy", "light"] = [test.condition.mass_kg for test in reached]
    for (more, less), values in quantities.items():
        those, others = np.array(values)[shows], np.array(values)[~shows]
        if those.min() > others.max() or those.max() < others.min():
            return more if those.min() > others.max() else less
    return "most" if shows.mean() >= _MOSTLY else ""
