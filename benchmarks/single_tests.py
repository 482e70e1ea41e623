"""What a single test shows beside what is predicted for it: ``python benchmarks/single_tests.py --vehicles 4``.

Each seed is another synthetic vehicle (``benchmarks/vehicles.py``) with 8 to 11 tests, and 40 further ones at random
conditions, of which nothing is learned. Printed by approach and metric: mean relative error of the value and of the
averaged pulse, over all crashes and as the mean size of the vehicles' own; relative width of the 95 % intervals beside
the width that the errors ask for, and their coverage. Then the mean rating over 0–60 ms, the share of whole pulses
inside the band at each time and inside that of whole pulses, and how much wider this is.
"""

import argparse

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits
from vehicles import KINDS, metrics_of

from crashfuse.approaches.base import WHOLE_S
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.execution.run import Run
from crashfuse.signals.metrics import MAIN_METRICS
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import rate_iso18571
from crashfuse.study.estimate import Fit, estimates_at

_APPROACHES = ("time_domain", "displacement_domain", "fused")
_JUDGED = GRID_S < WHOLE_S


def _crashes(kind: str, seed: int) -> tuple[Campaign, tuple[CrashTest, ...]]:
    world, rng = KINDS[kind](seed), np.random.default_rng([seed, 9])
    tests = world.test(world.over_speed(rng, int(rng.integers(8, 12))), first=0)
    return Campaign(f"Vehicle {seed}", world.library(tests), tests), world.test(world.conditions(rng, 40), first=1000)


def _rows(kind: str, seed: int) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    with threadpool_limits(1):
        return _predicted(kind, seed)


def _predicted(kind: str, seed: int) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    campaign, crashes = _crashes(kind, seed)
    fits = [Fit.of(campaign, name, run=Run()) for name in _APPROACHES]
    metrics: list[dict[str, object]] = []
    pulses: list[dict[str, object]] = []
    for crash in crashes:
        accel, measured = crash.pulse.accel_mps2, metrics_of(crash.pulse.accel_mps2, crash.condition)
        for estimate in estimates_at(fits, crash.condition):
            about = {"approach": estimate.approach, "seed": seed}
            for metric in estimate.metrics:
                truth = measured[metric.name]
                if metric.name in MAIN_METRICS and metric.value and metric.of_pulse and np.isfinite(truth):
                    ends = np.array([metric.lower, metric.upper], dtype=float)
                    row = {"value": metric.value / truth - 1, "of_pulse": metric.of_pulse / truth - 1}
                    inside = metric.holds(truth) if np.isfinite(ends).all() else None
                    metrics.append(
                        {**about, "metric": metric.name, **row, "inside": inside, "width": np.ptp(ends) / truth}
                    )
            bands = estimate.band(), estimate.whole_band()
            insides, widths = [], []
            for lower, upper in filter(None, bands):
                insides.append(bool(((lower <= accel) & (accel <= upper))[_JUDGED].all()))
                widths.append(float((upper - lower)[_JUDGED].mean()))
            overall = rate_iso18571(crash.pulse, Pulse(GRID_S, estimate.accel_mps2), window_ms=60.0).overall
            row = {"rating": overall, "at each time": insides[0], "whole": insides[1], "wider": widths[1] / widths[0]}
            pulses.append({**about, **row})
    return metrics, pulses


def main() -> None:
    """Predict and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--vehicles", type=int, default=4)
    parser.add_argument("--first", type=int, default=6001, help="seed of the first vehicle")
    parser.add_argument("--kind", choices=list(KINDS), default="any", help="of vehicle")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    metrics: list[dict[str, object]] = []
    pulses: list[dict[str, object]] = []
    seeds = range(given.first, given.first + given.vehicles)
    for vehicle in Parallel(given.workers)(delayed(_rows)(given.kind, seed) for seed in seeds):
        for rows, more in zip((metrics, pulses), vehicle, strict=True):
            rows += more
    table = pd.DataFrame(metrics)
    by = table.groupby(["approach", "metric"], sort=False)
    shown = by[["value", "of_pulse"]].mean().join(by["width"].mean())
    shown["asked"] = 3.92 * by["value"].agg(lambda errors: float(np.sqrt(np.mean(errors**2))))
    shown["inside"] = table.dropna(subset="inside").groupby(["approach", "metric"])["inside"].mean()
    of_vehicles = table.groupby(["approach", "metric", "seed"], sort=False)[["value", "of_pulse"]].mean().abs()
    shown = shown.join(of_vehicles.groupby(level=[0, 1], sort=False).mean().add_suffix(" of a vehicle"))
    print(shown.to_string(float_format="{:.3f}".format))
    whole = pd.DataFrame(pulses).groupby("approach", sort=False)[["rating", "at each time", "whole", "wider"]].mean()
    print(whole.to_string(float_format="{:.3f}".format))


if __name__ == "__main__":
    main()
