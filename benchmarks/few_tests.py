"""What few tests give, and what is left beyond them: ``python benchmarks/few_tests.py CAMPAIGN … [--vehicles N]``.

Of each campaign (default: the sample) one, two, three, four and six evenly chosen tests are learned from, then all but
one, and all but a whole speed group; the other tests are predicted and rated over 0–60 ms. ``--vehicles`` adds random
vehicles of any kind. *Better part* is the higher mean of the time and the displacement domain, *worst change* the
lowest rating of a single test against the raw CAE, *inside* the share of the time up to zero velocity at which the
measured a(t) lies inside the 95 % band.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
from joblib import Parallel, delayed
from tables import add_data_option, write
from threadpoolctl import threadpool_limits
from vehicles import World

from crashfuse.approaches.calibration import Coverage
from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit, estimates_at
from crashfuse.study.learning_curve import subsets
from crashfuse.study.study import Fold
from crashfuse.units import signed

_SIZES = (1, 2, 3, 4, 6)
_WINDOW_MS = 60.0
_APPROACHES = ("cae", "time_domain", "displacement_domain", "fused")
_PARTS = ["time_domain", "displacement_domain"]
_CONFIG = StudyConfig(approaches=_APPROACHES, windows_ms=(_WINDOW_MS,))
_TESTS = 9  # of a random vehicle


def _choices(campaign: Campaign) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Which tests to predict from all others, under the heading of the row."""
    n = len(campaign.tests)
    for subset in subsets(campaign, repeats=0, seed=0):
        size = len(subset.chosen)
        if size in _SIZES or size == n - 1:
            others = tuple(test for test in campaign.test_ids if test not in subset.chosen)
            yield "all but one" if size == n - 1 else str(size), others
    for group in dict.fromkeys(campaign.speed_group(test_id) for test_id in campaign.test_ids):
        if len(group) < n:
            yield "all but a speed group", group


def _predicted(campaign: Campaign, learned_from: str, held_out: tuple[str, ...]) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    rest, cache = campaign.without(held_out), Cache()
    with threadpool_limits(1):
        fits = [Fit.of(rest, approach, _CONFIG, Run(cache)) for approach in _APPROACHES]
        for test in (campaign.test(test_id) for test_id in held_out):
            fold = Fold.of(test, estimates_at(fits, test.condition), (_WINDOW_MS,))
            raw = fold.ratings["cae"][_WINDOW_MS].overall
            for estimate in fold.estimates:
                draws, rating = estimate.draws_mps2, fold.ratings[estimate.approach][_WINDOW_MS].overall
                inside = None if draws is None else Coverage.of(test, draws).accel
                row = {"tests": learned_from, "approach": estimate.approach, "rating": rating}
                rows.append({**row, "change": rating - raw, "inside": inside})
    return rows


def _print(campaign: Campaign, workers: int, data: Path | None) -> None:
    Fit.of(campaign, "lf_tcn", _CONFIG)  # the networks depend on the CAE runs alone: trained once
    choices = list(_choices(campaign))
    tables = Parallel(workers)(delayed(_predicted)(campaign, *choice) for choice in choices)
    rows = pd.DataFrame([row for table in tables for row in table])
    mean = rows.groupby(["tests", "approach"])[["rating", "inside"]].mean()
    worst = rows.groupby(["tests", "approach"])["change"].min()
    print(f"\n### {campaign.name}\n\nRating, worst change, a(t) inside the band:\n")
    print("| tests | " + " | ".join(LABELS[name] for name in _APPROACHES) + " | better part |")
    print("|---|" + "---:|" * (len(_APPROACHES) + 1))
    written = []
    for tests in dict.fromkeys(learned_from for learned_from, _ in choices):
        cells = [f"{mean.loc[(tests, 'cae'), 'rating']:.3f}"]
        for name in _APPROACHES[1:]:
            rating, inside = mean.loc[(tests, name)]
            cells.append(f"{rating:.3f}, {signed(worst[tests, name], 3)}, {inside:.2f}")
        better = mean.loc[tests].loc[_PARTS, "rating"].max()
        print(f"| {tests} | " + " | ".join(cells) + f" | {better:.3f} |", flush=True)
        fused = cells[-1].split(", ")
        row = {"campaign": campaign.name.partition(" (")[0], "learned from": tests, "fused": fused[0]}
        written.append({**row, "better part": f"{better:.3f}", "worst change": fused[1], "inside": fused[2]})
    if data is not None:
        write(pd.DataFrame(written), data / "few_tests.csv")


def main() -> None:
    """Measure and print Markdown tables."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("campaigns", type=Path, nargs="*")
    arguments.add_argument("--vehicles", type=int, default=0, help="random vehicles, besides the campaigns")
    arguments.add_argument("--first", type=int, default=1000, help="seed of the first; below 1000 some took part")
    arguments.add_argument("--workers", type=int, default=2)
    add_data_option(arguments)
    chosen = arguments.parse_args()
    folders = chosen.campaigns or ([] if chosen.vehicles else [Path("sample_data")])
    for folder in folders:
        _print(load_campaign(folder), chosen.workers, chosen.data)
    for seed in range(chosen.first, chosen.first + chosen.vehicles):
        _print(World.any(seed).campaign(_TESTS), chosen.workers, chosen.data)


if __name__ == "__main__":
    main()
