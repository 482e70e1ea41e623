"""Fit the prior of the fused weights to random vehicles: ``python benchmarks/fused_prior.py``.

Of each vehicle a few even choices of one and of two tests are learned from; with more, left-out tests decide. All
others are predicted by the time domain, the displacement domain and the raw CAE. Printed are the logits and slopes with
which the mixture rates best over 0–60 ms, on average over the vehicles, and its mean rating: with the numbers that are
shipped, with the fitted ones, and with those fitted to every other vehicle on the rest. Two networks of 500 steps stand
for the four of a study, which take too long to train for each vehicle.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import minimize
from scipy.special import softmax
from threadpoolctl import threadpool_limits
from vehicles import World

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.fused.components import COMPONENTS, Tests
from crashfuse.approaches.fused.prior import PRIOR
from crashfuse.approaches.fused.weights import log_ratios, spread
from crashfuse.approaches.left_out import STRIDE
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import RATING_DT_S, rate_many, rated_curves
from crashfuse.study.subsets import subsets

_NETWORKS = TcnConfig(members=2, min_steps=500, epochs=10)
_SIZES = (1, 2)  # tests learned from
_JUDGED = slice(75)  # 60 ms of every tenth sample
_SHARES = np.array([0.0, 0.15, 0.3, 0.5, 0.7, 1.0])  # of the time domain in what is not the raw CAE
_OF_CAE = np.array([0.0, 0.1, 0.25, 1.0])
_RIDGE = 6e-4  # a logit of 1 away from the start has to be worth 0.0003 of the rating
_START: FloatArray = np.array([0.4, 0.6, -2.0, -1.0])


@dataclass(frozen=True, eq=False)
class _Case:
    """A test predicted by all components: log ratios of their spreads, and ratings of mixtures of them."""

    log_ratios: FloatArray
    rated: RegularGridInterpolator

    def rating(self, told: FloatArray) -> float:
        """Rating of the mixture."""
        weights = softmax(_logits(told) @ self.log_ratios)
        return float(self.rated([weights[2], weights[0] / (weights[0] + weights[1])])[0])


def _campaign(seed: int) -> Campaign:
    """Seven to ten tests, evenly over speed or some of them at one speed, with a CAE run for each or none."""
    rng = np.random.default_rng([seed, 99])
    world = World.of(seed) if seed % 5 == 0 else World.any(seed)
    n = int(rng.integers(7, 11))
    if seed % 2:
        conditions = world.over_speed(rng, n)
    else:
        first, *others = world.conditions(rng, n)
        alike = [replace(c, speed_mps=first.speed_mps + float(rng.normal(0, 0.1))) for c in others[:2]]
        conditions = [first, *alike, *others[2:]]
    tests = world.test(conditions, first=0)
    return Campaign(f"vehicle {seed}", world.library(tests) if rng.random() < 0.6 else world.cae, tests)


def _cases(seed: int) -> list[_Case]:
    """All tests of a vehicle that are predicted from a few others."""
    campaign, cache = _campaign(seed), Cache()
    with threadpool_limits(1):
        return [
            case
            for subset in subsets(campaign, repeats=0, seed=0)
            if len(subset.chosen) in _SIZES
            for case in _predicted(campaign, subset.held_out(campaign), cache)
        ]


def _predicted(campaign: Campaign, held_out: Sequence[str], cache: Cache) -> Iterator[_Case]:
    rest = campaign.without(held_out)
    parts = [TimeDomain(_NETWORKS, cache=cache).fit(rest), (domain := DisplacementDomain(cache=cache).fit(rest))]
    tests = Tests.of(rest, domain.model_)
    for test in (campaign.test(test_id) for test_id in held_out):
        said = [part.predict(test.condition) for part in parts]
        raw = tests.raw(domain.model_.pulse(test.condition).accel_mps2, test.condition.speed_mps)
        draws = [*(each.draws_mps2 for each in said if each.draws_mps2 is not None), raw.draws]
        spreads = np.array([spread(own[:, ::STRIDE][:, _JUDGED]) for own in draws])
        means = np.array([*(each.accel_mps2 for each in said), raw.mean])
        weights = [[(1 - c) * share, (1 - c) * (1 - share), c] for c in _OF_CAE for share in _SHARES]
        curves = [rated_curves(test.pulse, Pulse(GRID_S, own @ means), 60.0) for own in np.array(weights)]
        ratings = rate_many(curves[0][0], np.array([mixture for _, mixture in curves]), dt_s=RATING_DT_S)
        overall = np.reshape([rating.overall for rating in ratings], (_OF_CAE.size, _SHARES.size))
        rated = RegularGridInterpolator((_OF_CAE, _SHARES), overall)
        yield _Case(log_ratios(spreads), rated)


def _logits(told: FloatArray) -> FloatArray:
    """Logits and slopes as the prior has them; the time domain's logit is 0 where the spreads are equal."""
    equal, slope, cae, cae_slope = told
    return np.array([[0.0, -slope / 2, 0.0], [equal, slope / 2, 0.0], [cae, 0.0, cae_slope]])


def _mean_rating(vehicles: Sequence[Sequence[_Case]], told: FloatArray) -> float:
    return float(np.mean([np.mean([case.rating(told) for case in own]) for own in vehicles]))


def _fitted(vehicles: Sequence[Sequence[_Case]]) -> FloatArray:
    """Logit of the displacement domain and its slope, logit of the raw CAE and its slope."""

    def loss(told: FloatArray) -> float:
        return _RIDGE / 2 * float(((told - _START) ** 2).sum()) - _mean_rating(vehicles, told)

    starts = (_START, _START + np.array([0.3, 0.0, -2.0, -0.5]))  # ratings jump, so gradients are of no use
    found = [minimize(loss, start, method="Nelder-Mead", options={"maxfev": 250}) for start in starts]
    return np.asarray(min(found, key=lambda result: float(result.fun)).x)


def main() -> None:
    """Measure, fit and print a Markdown table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--vehicles", type=int, default=10)
    arguments.add_argument("--first", type=int, default=1)
    arguments.add_argument("--workers", type=int, default=2)
    chosen = arguments.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.vehicles)
    vehicles = Parallel(chosen.workers)(delayed(_cases)(seed) for seed in seeds)
    time, displacement, cae = PRIOR
    shipped = np.array([displacement[0] - time[0], displacement[1] - time[1], cae[0] - time[0], cae[2]])
    halves = vehicles[::2], vehicles[1::2]
    crosswise = [_mean_rating(judged, _fitted(learned)) for learned, judged in (halves, halves[::-1])]
    told = _fitted(vehicles)
    print("| | logit | slope by log ratio | … of the raw CAE to both |\n|---|---:|---:|---:|")
    for name, row in zip(COMPONENTS, _logits(told), strict=True):
        print(f"| {name} | " + " | ".join(f"{value:+.2f}" for value in row) + " |")
    ratings = [_mean_rating(vehicles, shipped), _mean_rating(vehicles, told), float(np.mean(crosswise))]
    print("\nShipped {:.4f}, fitted {:.4f}, crosswise {:.4f}.".format(*ratings))


if __name__ == "__main__":
    main()
