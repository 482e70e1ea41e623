"""Compare priors of the fused weights on random vehicles: ``python benchmarks/fused_prior.py``.

Of each vehicle a few even choices of one and of two tests are learned from; with more, left-out tests decide. All
others are predicted by the time domain, the displacement domain, the pre-trained network and the raw CAE. Printed is
the mean rating over 0–60 ms, averaged over the vehicles, of mixtures by the shipped prior and by others beside it. Two
networks of 500 steps stand for the four of a study, which take too long to train for each vehicle.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed
from scipy.special import softmax
from threadpoolctl import threadpool_limits
from vehicles import World

from crashfuse.approaches.calibration import STRIDE
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.mixture import COMPONENTS, PRIOR, Tests, log_ratios, spread
from crashfuse.approaches.pretrained import Pretrained
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import RATING_DT_S, rate_many, rated_curves
from crashfuse.study.learning_curve import subsets

_NETWORKS = TcnConfig(members=2, min_steps=500, epochs=10)
_SIZES = (1, 2)  # tests learned from
_JUDGED = slice(75)  # 60 ms of every tenth sample
_STEPS = (-0.5, 0.5)  # of a logit or slope beside the shipped one


@dataclass(frozen=True, eq=False)
class _Case:
    """A test predicted by all components: log ratios of their spreads, and their pulses where they are rated."""

    log_ratios: FloatArray
    measured: FloatArray
    predicted: FloatArray

    def ratings(self, priors: Sequence[FloatArray]) -> list[float]:
        """Rating of the mixture by each prior."""
        mixtures = np.array([softmax(prior @ self.log_ratios) @ self.predicted for prior in priors])
        return [rating.overall for rating in rate_many(self.measured, mixtures, dt_s=RATING_DT_S)]


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
            for case in _predicted(campaign, [test for test in campaign.test_ids if test not in subset.chosen], cache)
        ]


def _predicted(campaign: Campaign, held_out: Sequence[str], cache: Cache) -> Iterator[_Case]:
    rest = campaign.without(held_out)
    domain = DisplacementDomain().fit(rest, Run(cache))
    parts = [TimeDomain(_NETWORKS).fit(rest, Run(cache)), domain, Pretrained().fit(rest, Run(cache))]
    tests = Tests.of(rest, domain.model_)
    for test in (campaign.test(test_id) for test_id in held_out):
        said = [part.predict(test.condition) for part in parts]
        raw = tests.raw(domain.model_.pulse(test.condition).accel_mps2, test.condition.speed_mps)
        draws = [*(each.draws_mps2 for each in said if each.draws_mps2 is not None), raw.draws]
        spreads = np.array([spread(own[:, ::STRIDE][:, _JUDGED]) for own in draws])
        means = [*(each.accel_mps2 for each in said), raw.mean]
        curves = [rated_curves(test.pulse, Pulse(GRID_S, own), 60.0) for own in means]
        yield _Case(log_ratios(spreads), curves[0][0], np.array([own for _, own in curves]))


def _beside(prior: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Priors that differ in one logit or one slope, and one without the pre-trained network."""
    for row, name in enumerate(COMPONENTS):
        for column, kind in ((0, "logit"), (row + 1, "slope")):
            for step in _STEPS:
                changed = prior.copy()
                changed[row, column] += step
                yield f"{kind} of the {name} {step:+.1f}", changed
    without = prior.copy()
    without[COMPONENTS.index("pre-trained network"), 0] = -100.0
    yield "without the pre-trained network", without


def main() -> None:
    """Measure and print a Markdown table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--vehicles", type=int, default=10)
    arguments.add_argument("--first", type=int, default=1)
    arguments.add_argument("--workers", type=int, default=2)
    chosen = arguments.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.vehicles)
    vehicles = Parallel(chosen.workers)(delayed(_cases)(seed) for seed in seeds)
    names, priors = zip(("shipped", PRIOR), *_beside(PRIOR), strict=True)
    ratings = np.mean([np.mean([case.ratings(priors) for case in own], axis=0) for own in vehicles], axis=0)
    print("| prior | mean rating |\n|---|---:|")
    for name, rating in zip(names, ratings, strict=True):
        print(f"| {name} | {rating:.4f} |", flush=True)


if __name__ == "__main__":
    main()
