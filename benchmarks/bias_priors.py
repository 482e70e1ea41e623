"""Priors of the bias model, learned from many vehicles: ``python benchmarks/bias_priors.py``.

Each seed is a vehicle of any kind (``World.any``), tested evenly over its speeds. The hyperparameters most probable
given all of its tests are those that a campaign with many tests ends with; with few tests the priors of
``displacement_domain/hierarchical_bias.py`` stand in for them. Printed beside these: the median over the vehicles,
and the standard deviation of the logarithms.
"""

import argparse
from typing import cast

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from vehicles import World

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias


def _learned(seed: int, n_tests: int) -> pd.DataFrame:
    """Hyperparameters learned from one vehicle's tests, with the median and spread of their priors."""
    campaign = World.any(seed).campaign(n_tests, paired=seed % 2 == 0)
    bias = cast(HierarchicalBias, DisplacementDomain().fit(campaign).bias_)
    priors = [*(prior for part in bias.process_.parts for prior in part.priors), bias.process_.noise]
    found = cast(dict[str, float], bias.state["hyperparameters"])
    return pd.DataFrame(
        {"name": list(found), "found": list(found.values()), "median": [p.median for p in priors]}
        | {"spread": [p.spread for p in priors]}
    )


def main() -> None:
    """Print a Markdown table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seeds", type=int, default=24)
    arguments.add_argument("--first", type=int, default=0, help="the first seed")
    arguments.add_argument("--tests", type=int, default=10, help="tests of each vehicle")
    arguments.add_argument("--workers", type=int, default=2)
    chosen = arguments.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.seeds)
    tables = pd.concat(Parallel(chosen.workers)(delayed(_learned)(seed, chosen.tests) for seed in seeds))
    print("| hyperparameter | prior: median | spread | learned: median | spread |\n|---|---:|---:|---:|---:|")
    for name, rows in tables.groupby("name", sort=False):
        prior, logs = rows.iloc[0], np.log(rows["found"])
        numbers = f"{prior['median']:.3g} | {prior['spread']:.2g} | {np.exp(logs.median()):.3g} | {logs.std():.2g}"
        print(f"| {name} | {numbers} |")


if __name__ == "__main__":
    main()
