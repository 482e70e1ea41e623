"""Fit the prior of the fused weights to random vehicles: ``python benchmarks/fused_prior.py``.

Of each vehicle a few choices of one to four tests, and all but one test or speed group, are learned from; the others
are predicted by the time domain, the displacement domain and the raw CAE. Printed are the logits and slopes with which
the mixture's score on them, against that of the raw CAE alone, is best on average over the vehicles: with one test, and
by how much they change with the logarithm of the number of tests. Two networks of 500 steps stand for the four of a
study, which take too long to train for each vehicle.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from joblib import Parallel, delayed
from scipy.optimize import minimize
from scipy.special import softmax
from threadpoolctl import threadpool_limits
from vehicles import World

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.fused.components import COMPONENTS, Tests
from crashfuse.approaches.fused.weights import Scores
from crashfuse.approaches.left_out import STRIDE
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.subsets import subsets

_NETWORKS = TcnConfig(members=2, min_steps=500, epochs=10)
_MOST = {1: 2, 2: 2, 3: 2, 4: 1}  # even choices of so many tests
_JUDGED = slice(75)  # 60 ms of every tenth sample
_PRIOR: FloatArray = np.array(
    [[0.0] * 5, [0.0] * 5, [-1.4, 0.0, -1.0, 0.0, 0.0]]
)  # the vehicles hardly tell of the CAE
_RIDGE = 0.01


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


def _held_out(campaign: Campaign, rng: np.random.Generator) -> Iterator[tuple[str, ...]]:
    even = [subset for subset in subsets(campaign, repeats=0, seed=0) if len(subset.chosen) in _MOST]
    for size, most in _MOST.items():
        yield from [subset.held_out(campaign) for subset in even if len(subset.chosen) == size][:most]
    groups = list(dict.fromkeys(campaign.speed_group(test_id) for test_id in campaign.test_ids))
    for number in rng.permutation(len(groups))[:2]:
        yield groups[number]
    for number in rng.permutation(len(campaign.tests))[:2]:
        yield (campaign.test_ids[number],)
    by_speed = sorted(campaign.tests, key=lambda test: test.condition.speed_mps)
    half = len(by_speed) // 2 + 1
    yield tuple(test.id for test in by_speed[half:])
    yield tuple(test.id for test in by_speed[: len(by_speed) - half])


def _scores(seed: int) -> list[tuple[Scores, int]]:
    """Scores of the components on predicted tests, with the number of tests that were learned from."""
    campaign, cache, found = _campaign(seed), Cache(), []
    with threadpool_limits(1):
        for held_out in _held_out(campaign, np.random.default_rng([seed, 98])):
            rest = campaign.without(held_out)
            time_domain = TimeDomain(_NETWORKS, cache=cache).fit(rest)
            displacement_domain = DisplacementDomain(cache=cache).fit(rest)
            tests = Tests.of(rest, displacement_domain.model_)
            for test in (campaign.test(test_id) for test_id in held_out):
                said = [part.predict(test.condition) for part in (time_domain, displacement_domain)]
                cae = displacement_domain.model_.pulse(test.condition).accel_mps2
                raw = tests.raw(cae, test.condition.speed_mps).draws
                draws = [*(each.draws_mps2 for each in said if each.draws_mps2 is not None), raw]
                own = Scores.of(test.pulse.accel_mps2[::STRIDE][_JUDGED], [d[:, ::STRIDE][:, _JUDGED] for d in draws])
                found.append((own, len(rest.tests)))
    return found


def _fitted(vehicles: list[list[tuple[Scores, int]]]) -> FloatArray:
    """Logit and slopes with one test, and their change with the logarithm of the number, for each component."""
    cases = [(scores, n, 1 / len(own) / len(vehicles)) for own in vehicles for scores, n in own]
    counts = np.array([count for *_, count in cases])

    def loss(flat: FloatArray) -> float:
        logits = flat.reshape(_PRIOR.shape)
        found = []
        for scores, n, _ in cases:
            first, second, raw = np.log(scores.spreads)
            ratio = first - second
            at = np.array([1.0, ratio, raw - (first + second) / 2, np.log(n), ratio * np.log(n)])
            found.append(scores.crps(np.asarray(softmax(logits @ at))) / scores.away[-1])
        return float(counts @ found + _RIDGE / 2 * ((logits - _PRIOR) ** 2).sum())

    return np.asarray(minimize(loss, _PRIOR.ravel(), method="L-BFGS-B").x).reshape(_PRIOR.shape)


def main() -> None:
    """Measure, fit and print a Markdown table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--vehicles", type=int, default=10)
    arguments.add_argument("--first", type=int, default=1)
    arguments.add_argument("--workers", type=int, default=2)
    chosen = arguments.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.vehicles)
    logits = _fitted(Parallel(chosen.workers)(delayed(_scores)(seed) for seed in seeds))
    print("| | logit | slope by log ratio | … of the raw CAE to both | logit by log tests | slope by log tests |")
    print("|---" + "|---:" * 5 + "|")
    for name, row in zip(COMPONENTS, logits, strict=True):
        print(f"| {name} | " + " | ".join(f"{value:+.2f}" for value in row) + " |")


if __name__ == "__main__":
    main()
