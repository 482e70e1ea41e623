"""Whether a CAE model knows how metrics change within 1 km/h and 2 %: ``python benchmarks/off_condition.py``.

Vehicles are drawn at random (``benchmarks/vehicles.py``), sisters of the sample's and others of any kind. Each of 40
conditions of a vehicle is tested twice by one specimen with one sensor noise: there, and up to 1 km/h and 2 % of each
weight off. Printed, and with ``--data`` written to ``off_condition.csv``: the root mean square of the difference in
percent, and of what the emulator leaves of it.
"""

import argparse
from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd
from tables import add_data_option, write
from vehicles import KINDS, metrics_of

from crashfuse.cae.model import CaeModel
from crashfuse.condition import Condition
from crashfuse.execution.run import Run
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.units import KPH

_N = 40


def _differences(kind: str, seed: int) -> Iterator[Mapping[str, object]]:
    """By condition and metric, the difference in percent, and what the CAE model leaves of it."""
    world, rng = KINDS[kind](seed), np.random.default_rng([seed, 77])
    planned, emulator = world.conditions(rng, _N), CaeModel().fit(world.cae, Run()).emulator_
    off = [_moved(condition, rng) for condition in planned]
    for pair in zip(world.test(planned, first=3000), world.test(off, first=3000), strict=True):
        tests = [metrics_of(test.pulse.accel_mps2, test.condition) for test in pair]
        cae = [metrics_of(emulator.predict(test.condition), test.condition) for test in pair]
        for name in METRIC_LABELS:
            difference, told = (own[1][name] - own[0][name] for own in (tests, cae))
            share = 100 / tests[0][name]
            yield {"kind": kind, "metric": name, "off": share * difference, "left": share * (difference - told)}


def _moved(condition: Condition, rng: np.random.Generator) -> Condition:
    speed, front, rear = (rng.uniform(-1, 1, 3) * [KPH, 0.02, 0.02]).tolist()
    front_kg, rear_kg = condition.front_weight_kg * (1 + front), condition.rear_weight_kg * (1 + rear)
    return Condition.of_vector([condition.speed_mps + speed, front_kg, rear_kg])


def main() -> None:
    """Compare some vehicles of both kinds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--sister", type=int, nargs="*", default=[301, 302, 303], help="their seeds")
    parser.add_argument("--any", type=int, nargs="*", default=[701, 702, 703, 721], help="seeds of those of any kind")
    add_data_option(parser)
    given = parser.parse_args()
    rows = [row for kind in ("sister", "any") for seed in getattr(given, kind) for row in _differences(kind, seed)]
    table = pd.DataFrame(rows).replace([np.inf, -np.inf], np.nan).dropna()
    shown = table.groupby(["metric", "kind"], sort=False)[["off", "left"]].agg(lambda own: np.sqrt((own**2).mean()))
    print(shown.unstack("kind").to_string(float_format="{:.2f}".format))
    if given.data is not None:
        rows = []
        for kind, vehicles in (("sister", "sisters of the sample"), ("any", "of any kind")):
            seeds = getattr(given, kind)
            for way, what in (("off", "difference"), ("left", "left")):
                values = shown.xs(kind, level="kind")[way]
                row = {name: f"{value:.1f}" for name, value in values.items()}
                about = {"vehicles": f"{len(seeds)} {vehicles}", "seeds": " ".join(map(str, seeds))}
                rows.append({**about, "root mean square in %": what} | row)
        write(pd.DataFrame(rows), given.data / "off_condition.csv", "vehicles")


if __name__ == "__main__":
    main()
