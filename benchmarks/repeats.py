"""How well tests tell what a repeat would rate: ``python benchmarks/repeats.py [--kind sister]``.

Vehicles are drawn at random (``benchmarks/vehicles.py``), with tests evenly over speed, each repeated 16 times. By
number of tests: what repeats rate over 0–60 ms, the error of the estimate, its mean and standard deviation over the
vehicles, the mean width of the 95 % intervals, and the share of repeats inside.
"""

import argparse
from functools import partial

import numpy as np
import pandas as pd
from tables import add_data_option, write
from vehicles import KINDS, NAMES, World

from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.signals.pulse import DT_S, FloatArray
from crashfuse.signals.rating import rate_many
from crashfuse.study.repeatability import repeatability
from crashfuse.units import number, signed

_SIZES = (4, 11)
_WINDOW_MS = 60.0
_REPEATS = 16
_FIRST = 1000  # number of the first repeat: each has a specimen and noise of its own


def _rated(world: World, place: int, test: CrashTest) -> FloatArray:
    n, first = round(_WINDOW_MS / 1e3 / DT_S), _FIRST + _REPEATS * place
    pulses = [repeat.pulse.accel_mps2[:n] for repeat in world.test([test.condition] * _REPEATS, first)]
    return np.array([rating.overall for rating in rate_many(test.pulse.accel_mps2[:n], np.array(pulses), dt_s=DT_S)])


def _judged(campaign: Campaign, world: World) -> dict[str, float]:
    estimates = {name: windows[_WINDOW_MS] for name, windows in repeatability(campaign, (_WINDOW_MS,)).items()}
    repeats = {test.id: _rated(world, place, test) for place, test in enumerate(campaign.tests)}
    inside = [(estimates[name].lower <= rated) & (rated <= estimates[name].upper) for name, rated in repeats.items()]
    true = float(np.mean(list(repeats.values())))
    error = float(np.mean([estimate.value for estimate in estimates.values()])) - true
    width = float(np.mean([estimate.upper - estimate.lower for estimate in estimates.values()]))
    return {"repeats rate": true, "error": error, "width": width, "inside": float(np.mean(inside))}


def main() -> None:
    """Estimate, repeat, print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", choices=list(KINDS), default="sister")
    parser.add_argument("--vehicles", type=int, nargs="*", default=range(9211, 9215), help="their seeds")
    add_data_option(parser)
    given = parser.parse_args()
    rows = []
    for seed in given.vehicles:
        world = KINDS[given.kind](seed)
        rows += [{"tests": n} | _judged(world.campaign(n, paired=seed % 2 == 0), world) for n in _SIZES]
    groups = pd.DataFrame(rows).groupby("tests")
    table = groups.mean().join(groups["error"].std().rename("deviation")).reset_index()
    print(table.round(3).to_string(index=False))
    if given.data is not None:
        errors = zip(table["error"], table.pop("deviation"), strict=True)
        shown = {name: table[name].map(partial(number, form=".3f")) for name in ("repeats rate", "width")}
        shown |= {"error": [f"{signed(mean, 3)} ± {deviation:.3f}" for mean, deviation in errors]}
        shown |= {"inside": table["inside"].map(partial(number, form=".2f"))}
        write(table.assign(campaign=NAMES[given.kind], **shown), given.data / "repeats.csv")


if __name__ == "__main__":
    main()
