"""How many planned tests have to be run, if each is followed by new verdicts: ``python benchmarks/one_at_a_time.py``.

Each seed is a vehicle of any kind, or of another one (``benchmarks/vehicles.py``), tested at four
speeds evenly over its range; twelve further tests are planned. As long as any of them neither need not be run, as all
criteria are met at once, nor is known to miss one, the next is run, and all others are judged anew: the fastest or the
slowest of those left, or the most probable to meet all criteria. The limits on peak, crush, SM25, OLC and VPI are such
that a part of 60 further conditions meets each. Every answer is compared with the test itself. Each certification is
beside the one before it, so that what that said of a test is in the record when it has been run, and is counted. Of a
campaign four of its own tests, evenly over speed, have been run, all others are planned, and the limits are such that a
part of all tests meets each.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from certification import limiting, limits, shown
from joblib import Parallel, delayed
from vehicles import KINDS

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.certification.certify import certify_matrix
from crashfuse.certification.criteria import Criteria
from crashfuse.certification.earlier import LaterTests, parse_earlier
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import Verdict, all_met, needs_no_test
from crashfuse.crash_test import CrashTest
from crashfuse.execution.run import Run
from crashfuse.results.certification import certification_json
from crashfuse.results.certification_facts import outcomes
from crashfuse.study.learning_curve import subsets

_SHARES = (0.6, 0.9)
_RUN, _PLANNED, _FURTHER = 4, 12, 60

Row = tuple[Verdict, ...]
_FIRST: dict[str, Callable[[Row], float]] = {
    "fastest": lambda row: row[0].condition.speed_mps,
    "slowest": lambda row: -row[0].condition.speed_mps,
    "most probable": lambda row: all_met(row).probability,
}


class _Plan(NamedTuple):
    """Tests that have been run, those that are planned, and what tests of the vehicle show."""

    name: str
    cae: CaeLibrary
    begun: tuple[CrashTest, ...]
    planned: tuple[CrashTest, ...]
    shown: pd.DataFrame


def _vehicle(seed: int, kind: str) -> _Plan:
    world, rng = KINDS[kind](seed), np.random.default_rng([seed, 9])
    begun = world.test(world.over_speed(rng, _RUN), first=0)
    planned = world.test(world.over_speed(rng, _PLANNED), first=1000)
    further = world.test(world.conditions(rng, _FURTHER), first=2000)
    return _Plan(f"Vehicle {seed}", world.library((*begun, *planned)), begun, planned, shown(further))


def _campaign(folder: Path) -> _Plan:
    campaign = load_campaign(folder)
    [own, *_] = (each for each in subsets(campaign, repeats=0, seed=0) if len(each.chosen) == _RUN)
    planned = campaign.without(own.chosen).tests
    begun = campaign.without([test.id for test in planned]).tests
    return _Plan(campaign.name, campaign.cae, begun, planned, shown(campaign.tests))


def _settled(plan: _Plan) -> list[dict[str, object]]:
    """How many tests are run and need not be, by limits and by which is run first."""
    matrix = Matrix(tuple(test.id for test in plan.planned), tuple(test.condition for test in plan.planned))
    rows = []
    for share in _SHARES:
        at_most = limits(plan.shown, share)
        criteria, meets = limiting(at_most), (shown(plan.planned) <= at_most).all(axis=1)
        for first, key in _FIRST.items():
            run, last, said = _one_at_a_time(plan, matrix, criteria, key)
            saved = [i for i, row in last.items() if needs_no_test(row, criteria.confidence)]
            missing = [i for i, row in last.items() if any(own.word == "not met" for own in row)]
            rows.append(
                {"limits": share, "first": first, "planned": len(plan.planned), "would meet all": int(meets.sum())}
                | {"run": run, "need not be run": len(saved), "missed one": int((~meets[saved]).sum())}
                | {"said to miss one": len(missing), "missed none": int(meets[missing].sum())}
                | dict(zip(("said of those", "wrong", "held", "intervals"), said, strict=True))
            )
            print(plan.name, rows[-1], flush=True)
    return rows


def _one_at_a_time(
    plan: _Plan, matrix: Matrix, criteria: Criteria, key: Callable[[Row], float]
) -> tuple[int, dict[str, Row], list[int]]:
    """How many tests are run until nothing is open, the rows of the others, and what was said of those that were run.

    That is how many verdicts were met or not met, how many of them wrong, how many intervals held what was measured,
    and of how many.
    """
    run: tuple[CrashTest, ...] = ()
    said, before = [0, 0, 0, 0], None
    while True:
        campaign = Campaign(plan.name, plan.cae, (*plan.begun, *run))
        found = certify_matrix(campaign, criteria, matrix, run=Run())
        if before is not None:
            found, since = found.beside(before), LaterTests(before, campaign)
            wrong, n = outcomes(since)["verdicts"]  # of all that were run so far
            said = [n, wrong, *TrackRecord(since.counted).intervals]
        before = parse_earlier(certification_json(found))
        left = {i: row for i, row in found.rows.items() if i not in found.run}
        unsettled = {
            i: row
            for i, row in left.items()
            if not needs_no_test(row, criteria.confidence) and all(own.word != "not met" for own in row)
        }
        if not unsettled:
            return len(run), left, said
        chosen = max(unsettled, key=lambda i: key(unsettled[i]))
        run = (*run, *(test for test in plan.planned if test.id == chosen))


def main() -> None:
    """Run the tests of some vehicles one at a time and print the sums."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--vehicles", type=int, default=6)
    parser.add_argument("--first", type=int, default=701, help="seed of the first vehicle")
    parser.add_argument("--kind", choices=list(KINDS), default="any", help="of vehicle")
    parser.add_argument(
        "--campaign", type=Path, nargs="+", default=[], help="campaign folders instead: their own tests"
    )
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.vehicles)
    plans = [_campaign(folder) for folder in given.campaign] or [_vehicle(seed, given.kind) for seed in seeds]
    tables = Parallel(given.workers)(delayed(_settled)(plan) for plan in plans)
    table = pd.DataFrame(row for rows in tables for row in rows)
    print(table.groupby(["limits", "first"], sort=False).sum().to_string())


if __name__ == "__main__":
    main()
