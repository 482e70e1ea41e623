"""Compare tests chosen by their rank with other choices: ``python benchmarks/next_test.py``.

Each seed is another vehicle: that of the sample campaign, with forces, gaps and folds of the CAE model and of the truth
drawn anew, independently. Three tests have been run: two near 25 mph and one near 35 mph, or with ``--start paper``
three drawn from the eleven of Zeng et al. 2023, Table 1, most of them also near 25 and 35 mph. Then one, two and three
more are added: chosen one by one by :func:`crashfuse.study.planning.rank_next_tests`, drawn at random from
the range, or spaced evenly over its speeds at the middle weights. All predict the same further tests across the
range. With ``--data`` the mean ratings are written to ``next_test.csv``.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from tables import add_data_option, write
from threadpoolctl import threadpool_limits
from vehicles import SAMPLE_RANGE, World

from crashfuse.approaches.displacement_domain.approach import DisplacementConfig, DisplacementDomain
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.planning import rank_next_tests
from crashfuse.synthetic.sample import TABLE_1
from crashfuse.units import LB, MPH, G

_N_HELD_OUT, _MORE = 14, 3
_WINDOW_MS = 60.0
_MEASURES = {"rating": "rating 0–60 ms", "error": "RMS error (g)", "band": "band (± g)"}


def _start(start: str, world: World, rng: np.random.Generator) -> list[Condition]:
    """Conditions of the tests already run."""
    if start == "paper":
        rows = [TABLE_1[i] for i in rng.choice(len(TABLE_1), 3, replace=False)]
        return [Condition.of_vector([speed * MPH, front * LB, rear * LB]) for speed, front, rear, *_ in rows]
    speeds = (np.array([25.0, 25.0, 35.0]) + rng.normal(0, 0.15, 3)) * MPH
    return [replace(c, speed_mps=v) for v, c in zip(speeds.tolist(), world.conditions(rng, 3), strict=True)]


def _study(seed: int, start: str) -> pd.DataFrame:
    """Results for one vehicle: every selection method, with every number of further tests."""
    with threadpool_limits(1):
        world, rng = World.of(seed), np.random.default_rng([seed, 2])
        begun = world.test(_start(start, world, rng), first=0)
        held_out = world.test(world.over_speed(rng, _N_HELD_OUT), first=100)
        cache = Cache()

        def campaign_of(tests: Sequence[CrashTest]) -> Campaign:
            return Campaign("", world.library(tests), tuple(tests))

        def fit(tests: Sequence[CrashTest]) -> DisplacementDomain:
            return DisplacementDomain(DisplacementConfig(n_draws=100)).fit(campaign_of(tests), Run(cache))

        def rows(way: str, domain: DisplacementDomain, more: int) -> list[dict[str, object]]:
            speeds = " ".join(f"{p.condition.speed_mps / MPH:.0f}" for p in domain.points_[len(begun) :])
            return [
                {"seed": seed, "way": way, "more": more, "speeds": speeds, **_judge(domain, test)} for test in held_out
            ]

        first = fit(begun)
        found = rows("none", first, 0)
        at_random = world.conditions(rng, _MORE)
        tests, domain = begun, first
        for more in range(1, _MORE + 1):
            best = rank_next_tests(campaign_of(tests), domain, SAMPLE_RANGE).conditions[0]
            tests = (*tests, *world.test([best], first=9 + more))
            domain = fit(tests)
            found += rows("ranked", domain, more)
            others: dict[str, list[Condition]] = {"random": at_random[:more], "even": _evenly(more)}
            for way, conditions in others.items():
                found += rows(way, fit((*begun, *world.test(conditions, first=10))), more)
        return pd.DataFrame(found)


def _evenly(n: int) -> list[Condition]:
    """Midpoints of n equal parts of the speed range, at the middle weights."""
    middle = (SAMPLE_RANGE.low.vector + SAMPLE_RANGE.high.vector) / 2
    low, high = SAMPLE_RANGE.low.speed_mps, SAMPLE_RANGE.high.speed_mps
    return [Condition.of_vector([low + (i + 0.5) / n * (high - low), *middle[1:].tolist()]) for i in range(n)]


def _judge(domain: DisplacementDomain, test: CrashTest) -> dict[str, float]:
    prediction = domain.predict(test.condition)
    rated = int(_WINDOW_MS / 1e3 / DT_S)
    lower, upper = prediction.band() or (np.zeros(N_SAMPLES),) * 2
    return {
        "speed": test.condition.speed_mps / MPH,
        "rating": rate_windows(test.pulse, Pulse(GRID_S, prediction.accel_mps2), [_WINDOW_MS])[_WINDOW_MS].overall,
        "error": float(np.sqrt(np.mean((prediction.accel_mps2 - test.pulse.accel_mps2)[:rated] ** 2))) / G,
        "band": float(np.mean((upper - lower)[:rated])) / 2 / G,
    }


def main() -> None:
    """Measure and print Markdown tables."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seeds", type=int, default=24)
    arguments.add_argument("--first", type=int, default=0, help="the first seed")
    arguments.add_argument("--start", choices=("clusters", "paper"), default="clusters")
    arguments.add_argument("--workers", type=int, default=2)
    add_data_option(arguments)
    chosen = arguments.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.seeds)
    tables = Parallel(chosen.workers)(delayed(_study)(seed, chosen.start) for seed in seeds)
    all_rows = pd.concat(tables)
    by_vehicle = all_rows.groupby(["more", "way", "seed"])[list(_MEASURES)].mean()
    print(f"{chosen.seeds} vehicles, {_N_HELD_OUT} further tests each; mean ± standard error over the vehicles\n")
    _print(by_vehicle.groupby(["more", "way"]).agg(_mean_and_error), "tests added | chosen")
    differences = {
        (more, other): by_vehicle.loc[more].loc["ranked"] - by_vehicle.loc[more].loc[other]
        for more in range(1, _MORE + 1)
        for other in ("random", "even")
    }
    print("\nRanked minus the other way, vehicle by vehicle:\n")
    paired = pd.concat(differences, names=["more", "way", "seed"])
    _print(paired.groupby(["more", "way"]).agg(_mean_and_error), "tests added | against")
    if chosen.data is not None:
        means = by_vehicle["rating"].groupby(["more", "way"]).mean().unstack()
        means = means.apply(lambda way: way.fillna(means["none"])).rename_axis("further tests").reset_index()
        columns = {"ranked": "by rank", "even": "evenly spaced", "random": "random"}
        table = means[["further tests", *columns]].rename(columns=columns)
        write(table.astype({"further tests": str}).map(_three_digits), chosen.data / "next_test.csv", "further tests")


def _three_digits(value: object) -> object:
    return f"{value:.3f}" if isinstance(value, float) else value


def _mean_and_error(values: pd.Series) -> str:
    return f"{values.mean():.4f} ± {values.std() / np.sqrt(len(values)):.4f}"


def _print(table: pd.DataFrame, index: str) -> None:
    print(f"| {index} | " + " | ".join(_MEASURES[name] for name in table) + " |")
    print("|---:|---|" + "---:|" * len(table.columns))
    for (more, way), row in table.iterrows():
        print(f"| {more} | {way} | " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
