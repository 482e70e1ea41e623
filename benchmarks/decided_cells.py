"""How many limits can be decided: ``python benchmarks/decided_cells.py``.

Vehicles are drawn at random (``benchmarks/vehicles.py``), sisters of the sample's and others of any kind, each with 8
to 11 tests. At 40 unseen crashes of each, limits at 0.9 to 1.1 of the value of a metric count as decided where the
probability of staying below is 0.95 and more, or 0.05 and less. Printed: the share of decided limits, that of somebody
who knows the vehicle and only not how a single test of it scatters (24 repeats at three speeds), the share of decided
ones that the crash contradicts, how many intervals hold, and their width beside what errors ask for. With ``--tests 4
--archive FILE`` vehicles have four tests, and an archive of ``benchmarks/archive.py`` teaches them. With ``--data`` the
table is written to ``decided_cells.csv``.
"""

import argparse

import numpy as np
import pandas as pd
from certification import random_campaign
from tables import add_data_option, write
from vehicles import KINDS, metrics_of

from crashfuse.approaches.metric_calibration import metric_distributions
from crashfuse.execution.run import Run
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.vehicle_archive import VehicleArchive, load_archive

_METRICS = ("peak", "sm25", "olc", "max_crush", "t0", "mean", "vpi")
_LIMITS = np.linspace(0.9, 1.1, 21)
_UNSEEN, _REPEATS = 40, 8
_SURE = 1.645  # standard deviations of the one-sided 95 %


def _cells(kind: str, seed: int, n_tests: int | None, archive: VehicleArchive | None) -> pd.DataFrame:
    """One row an unseen crash and metric."""
    n_tests = n_tests or int(np.random.default_rng([seed, 5]).integers(8, 12))
    campaign, new = random_campaign(seed, n_tests, kind)
    if archive is not None:
        campaign = campaign.with_archive(archive)
    unseen, world = new[:_UNSEEN], KINDS[kind](seed)
    by_speed = sorted((test.condition for test in unseen), key=lambda condition: condition.speed_mps)
    repeats = [
        pd.DataFrame(metrics_of(test.pulse.accel_mps2, at) for test in world.test([at] * _REPEATS, first=5000))
        for at in by_speed[8::12]
    ]
    finite = (own.where(np.isfinite(own)) for own in repeats)  # slow repeats may end before a metric is known
    known = np.sqrt(pd.concat([(own.std() / own.mean()) ** 2 for own in finite], axis=1).mean(axis=1))
    fit, rows = Fit.of(campaign, "fused", StudyConfig(), Run()), []
    for test in unseen:
        found = metric_distributions(fit.estimate(test.condition).drawn, fit.metric_errors)
        measured = metrics_of(test.pulse.accel_mps2, test.condition)
        for name in _METRICS:
            distribution = found[name]
            if distribution is None or (value := distribution.median) is None or not np.isfinite(measured[name]):
                continue
            below = np.array([distribution.probability(None, value * limit) for limit in _LIMITS])
            decided = (below >= 0.95) | (below <= 0.05)
            wrong = decided & ((below >= 0.95) != (measured[name] <= value * _LIMITS))
            lower, upper = distribution.interval
            rows.append(
                {
                    "kind": kind,
                    "metric": name,
                    "decided": decided.mean(),
                    "known": (np.abs(_LIMITS - 1) > _SURE * known[name]).mean(),
                    "wrong": wrong.mean(),
                    "inside": (lower or 0) <= measured[name] <= (np.inf if upper is None else upper),
                    "width": np.nan if lower is None or upper is None else (upper - lower) / value,
                    "error": measured[name] / value - 1,
                }
            )
    return pd.DataFrame(rows)


def main() -> None:
    """Print a table of both kinds."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--sister", type=int, nargs="*", default=[*range(8201, 8209)], help="their seeds")
    parser.add_argument("--any", type=int, nargs="*", default=[*range(8101, 8115)], help="seeds of those of any kind")
    parser.add_argument("--tests", type=int, help="of each vehicle, instead of 8 to 11")
    parser.add_argument("--archive", type=load_archive, help="file of the archive that teaches them")
    add_data_option(parser)
    given = parser.parse_args()
    cells = pd.concat(
        _cells(kind, seed, given.tests, given.archive) for kind in ("sister", "any") for seed in getattr(given, kind)
    )
    cells["square"] = cells.pop("error") ** 2
    everything = cells.assign(metric="all")
    table = pd.concat([cells, everything]).groupby(["kind", "metric"], sort=False).mean(numeric_only=True)
    table["wrong"] /= table["decided"]
    table["asked"] = 3.92 * np.sqrt(table.pop("square"))
    table.insert(0, "of known", table["decided"] / table["known"])
    print(table.to_string(float_format="{:.3f}".format))
    if given.data is not None:
        write(table.map("{:.3f}".format).reset_index(), given.data / "decided_cells.csv", "kind")


if __name__ == "__main__":
    main()
