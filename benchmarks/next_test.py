"""Compare tests chosen by their rank with other choices: ``python benchmarks/next_test.py``.

Each seed is another vehicle: that of the sample campaign, with forces, gaps and folds of the CAE model and of the truth
drawn anew, independently. Three tests have been run: two near 25 mph and one near 35 mph, or with ``--start paper``
three drawn from the eleven of Zeng et al. 2023, Table 1, most of them also near 25 and 35 mph. Then one, two and three
more are added: chosen one by one by :func:`crashfuse.study.next_test.rank_next_tests`, drawn at random from
the range, or spaced evenly over its speeds at the middle weights. All predict the same further tests across the
range.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.config import DisplacementConfig
from crashfuse.campaign import CaeLibrary, Campaign, CrashTest
from crashfuse.condition import Condition
from crashfuse.execution.cache import Cache
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.next_test import ConditionRange, rank_next_tests
from crashfuse.synthetic.models import CAE_MODEL, SENSOR_NOISE_MPS2, TRUTH, scattered
from crashfuse.synthetic.sample import TABLE_1
from crashfuse.synthetic.vehicle import CrushZone, Vehicle, simulate
from crashfuse.units import LB, MPH, G

_RANGE = ConditionRange(
    Condition(8.0 * MPH, 1922.0 * LB, 1349.0 * LB), Condition(35.2 * MPH, 2185.0 * LB, 1770.0 * LB)
)  # of the sample campaign, without the slowest
_N_RUNS, _N_HELD_OUT, _MORE = 240, 14, 3
_BEFORE_CONTACT = 250  # samples, for the filter
_WINDOW_MS = 60.0
_MEASURES = {"rating": "rating 0–60 ms", "error": "RMS error (g)", "band": "band (± g)"}


@dataclass(frozen=True)
class World:
    """A vehicle whose true behaviour is known: it can be tested at any condition."""

    model: Vehicle
    truth: Vehicle
    cae: CaeLibrary
    seed: int

    @classmethod
    def of(cls, seed: int) -> "World":
        """Draw a vehicle, and run its CAE model over the whole range and slightly beyond."""
        rng = np.random.default_rng([seed, 0])
        model, truth = _another(CAE_MODEL, rng), _another(TRUTH, rng)
        low, high = _RANGE.low.vector * [0.6, 1, 1], _RANGE.high.vector
        vectors = qmc.scale(qmc.LatinHypercube(d=3, rng=seed).random(_N_RUNS), low, high)
        conditions = tuple(Condition(*vector) for vector in vectors.tolist())
        pulses = _recorded([model], conditions, None)
        return cls(
            model, truth, CaeLibrary(tuple(map(str, range(_N_RUNS))), conditions, pulses.astype(np.float32)), seed
        )

    def library(self, tests: Sequence[CrashTest]) -> CaeLibrary:
        """The CAE runs, and one at the condition of each test."""
        conditions = tuple(test.condition for test in tests)
        paired = _recorded([self.model], conditions, None).astype(np.float32)
        ids = (*self.cae.ids, *(f"CAE-{test.id}" for test in tests))
        return CaeLibrary(ids, (*self.cae.conditions, *conditions), np.vstack([self.cae.accel_mps2, paired]))

    def test(self, conditions: Sequence[Condition], first: int) -> tuple[CrashTest, ...]:
        """Run one test per condition, numbered from ``first``: equal numbers have equal scatter and noise."""
        streams = [np.random.default_rng([self.seed, 1, first + i]) for i in range(len(conditions))]
        specimens = [scattered(self.truth, rng) for rng in streams]
        noise = np.array([rng.normal(0.0, SENSOR_NOISE_MPS2, N_SAMPLES + 2 * _BEFORE_CONTACT) for rng in streams])
        pulses = _recorded(specimens, conditions, noise)
        return tuple(
            CrashTest(f"T{first + i}", condition, Pulse(GRID_S, pulse))
            for i, (condition, pulse) in enumerate(zip(conditions, pulses, strict=True))
        )


def _another(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    """A similar vehicle: each zone's forces differ by 10 % as a whole and 8 % at each knot, and so on."""

    def zone(old: CrushZone) -> CrushZone:
        factors = np.exp(0.1 * rng.standard_normal() + 0.08 * rng.standard_normal(len(old.force_n)))
        gap, fold, length = rng.standard_normal(3)
        return replace(
            old,
            force_n=tuple((np.array(old.force_n) * factors).tolist()),
            gap_m=old.gap_m * np.exp(0.1 * gap),
            fold_share=old.fold_share * np.exp(0.2 * fold),
            fold_length_m=old.fold_length_m * np.exp(0.1 * length),
        )

    return replace(
        vehicle,
        rails=zone(vehicle.rails),
        shell=zone(vehicle.shell),
        engine=zone(vehicle.engine),
        firewall=zone(vehicle.firewall),
    )


def _recorded(vehicles: Sequence[Vehicle], conditions: Sequence[Condition], noise: FloatArray | None) -> FloatArray:
    n_samples = N_SAMPLES + _BEFORE_CONTACT
    fleet = vehicles[0] if len(vehicles) == 1 else vehicles
    records = np.pad(simulate(fleet, conditions, n_samples).accel_mps2, ((0, 0), (_BEFORE_CONTACT, 0)))
    filtered = cfc_filter(records + (0.0 if noise is None else noise), cfc=60, dt_s=DT_S)
    return filtered[:, _BEFORE_CONTACT : _BEFORE_CONTACT + N_SAMPLES]


def _drawn(rng: np.random.Generator, n: int) -> list[Condition]:
    """Random conditions in the range."""
    vectors = rng.uniform(_RANGE.low.vector, _RANGE.high.vector, (n, 3))
    return [Condition(*vector) for vector in vectors.tolist()]


def _start(start: str, rng: np.random.Generator) -> list[Condition]:
    """Conditions of the tests already run."""
    if start == "paper":
        rows = [TABLE_1[i] for i in rng.choice(len(TABLE_1), 3, replace=False)]
        return [Condition(speed * MPH, front * LB, rear * LB) for speed, front, rear, *_ in rows]
    speeds = (np.array([25.0, 25.0, 35.0]) + rng.normal(0, 0.15, 3)) * MPH
    return [replace(c, speed_mps=v) for v, c in zip(speeds.tolist(), _drawn(rng, 3), strict=True)]


def _study(seed: int, start: str) -> pd.DataFrame:
    """Results for one vehicle: every selection method, with every number of further tests."""
    with threadpool_limits(1):
        world, rng = World.of(seed), np.random.default_rng([seed, 2])
        begun = world.test(_start(start, rng), first=0)
        speeds = np.linspace(_RANGE.low.speed_mps, _RANGE.high.speed_mps, _N_HELD_OUT).tolist()
        further = [replace(c, speed_mps=v) for v, c in zip(speeds, _drawn(rng, _N_HELD_OUT), strict=True)]
        held_out = world.test(further, first=100)
        cache = Cache()

        def fit(tests: Sequence[CrashTest]) -> DisplacementDomain:
            campaign = Campaign("", world.library(tests), tuple(tests))
            return DisplacementDomain(DisplacementConfig(n_draws=100), cache=cache).fit(campaign)

        def rows(way: str, domain: DisplacementDomain, more: int) -> list[dict[str, object]]:
            speeds = " ".join(f"{p.condition.speed_mps / MPH:.0f}" for p in domain.points_[len(begun) :])
            return [
                {"seed": seed, "way": way, "more": more, "speeds": speeds, **_judge(domain, test)} for test in held_out
            ]

        first = fit(begun)
        found = rows("none", first, 0)
        at_random = _drawn(rng, _MORE)
        tests, domain = begun, first
        for more in range(1, _MORE + 1):
            best = rank_next_tests(domain, _RANGE)[0].condition
            tests = (*tests, *world.test([best], first=9 + more))
            domain = fit(tests)
            found += rows("ranked", domain, more)
            others: dict[str, list[Condition]] = {"random": at_random[:more], "even": _evenly(more)}
            for way, conditions in others.items():
                found += rows(way, fit((*begun, *world.test(conditions, first=10))), more)
        return pd.DataFrame(found)


def _evenly(n: int) -> list[Condition]:
    """Midpoints of n equal parts of the speed range, at the middle weights."""
    middle = (_RANGE.low.vector + _RANGE.high.vector) / 2
    low, high = _RANGE.low.speed_mps, _RANGE.high.speed_mps
    return [Condition(low + (i + 0.5) / n * (high - low), *middle[1:].tolist()) for i in range(n)]


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


def _mean_and_error(values: pd.Series) -> str:
    return f"{values.mean():.4f} ± {values.std() / np.sqrt(len(values)):.4f}"


def _print(table: pd.DataFrame, index: str) -> None:
    print(f"| {index} | " + " | ".join(_MEASURES[name] for name in table) + " |")
    print("|---:|---|" + "---:|" * len(table.columns))
    for (more, way), row in table.iterrows():
        print(f"| {more} | {way} | " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
