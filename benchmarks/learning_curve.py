"""Compare what one more test is said to add with what it adds: ``python benchmarks/learning_curve.py``.

Each seed is another vehicle, drawn at random. A campaign of random tests gets its learning curve, and from it
the gain expected of one more test. Then four further tests are run at random conditions, each is added alone, and
twenty unseen tests, evenly spaced over speed, are predicted with and without it. The displacement domain stands for the
fused prediction, whose networks take too long to train for each vehicle. With ``--data`` the table is written to
``one_more_test.csv``.
"""

import argparse
from collections.abc import Sequence

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from tables import add_data_option, write
from threadpoolctl import threadpool_limits
from vehicles import World

from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.learning_curve import learning_curve, measure
from crashfuse.study.one_more_test import one_more

_APPROACH, _WINDOW_MS = "displacement_domain", 60.0
_CONFIG = StudyConfig(approaches=(_APPROACH,), windows_ms=(_WINDOW_MS,))
_UNSEEN, _FURTHER = 20, 4


def _vehicle(seed: int, n_tests: int) -> dict[str, float]:
    """Expected gain with its interval, and the mean measured gain with its standard error over the unseen tests."""
    world, rng = World.of(seed), np.random.default_rng([seed, 5])
    tests = world.test(world.conditions(rng, n_tests), first=0)
    unseen = world.test(world.over_speed(rng, _UNSEEN), first=100)
    further = world.test(world.conditions(rng, _FURTHER), first=50)
    library = world.library([*tests, *further, *unseen])

    def ratings(own: Sequence[CrashTest]) -> FloatArray:
        fit = Fit.of(Campaign("", library, tuple(own)), _APPROACH, _CONFIG)
        return np.array([measure(fit.estimate(test.condition), test, _WINDOW_MS)["overall"] for test in unseen])

    curve = learning_curve(Campaign("", library, tests), _CONFIG, repeats=0, workers=1)
    if (more := one_more(curve)) is None:
        raise SystemExit("It takes at least 5 tests.")
    with threadpool_limits(1):
        gain = np.mean([ratings([*tests, test]) for test in further], axis=0) - ratings(tests)
    return {
        "expected": more.gain,
        "lower": more.lower,
        "upper": more.upper,
        "measured": float(gain.mean()),
        "standard error": float(gain.std(ddof=1) / np.sqrt(_UNSEEN)),
    }


def main() -> None:
    """Measure, print and write a table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seeds", type=int, default=8)
    arguments.add_argument("--tests", type=int, default=9)
    arguments.add_argument("--workers", type=int, default=2)
    add_data_option(arguments)
    chosen = arguments.parse_args()
    seeds = range(1, chosen.seeds + 1)
    rows = Parallel(chosen.workers)(delayed(_vehicle)(seed, chosen.tests) for seed in seeds)
    table = pd.DataFrame(rows, index=pd.Index(seeds, name="vehicle"))
    shown = table.map("{:.4f}".format).reset_index().astype({"vehicle": str})
    print(shown.to_string(index=False))
    print(f"Mean expected {table['expected'].mean():.4f}, measured {table['measured'].mean():.4f}")
    if chosen.data is not None:
        write(shown, chosen.data / "one_more_test.csv", "vehicle")


if __name__ == "__main__":
    main()
