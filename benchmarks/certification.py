"""How often verdicts are wrong: ``python benchmarks/certification.py --vehicles 4``.

Each seed is another synthetic vehicle (``benchmarks/vehicles.py``), a sister of the sample's, tested at the eleven
conditions of Zeng et al. 2023, Table 1, or one of any kind, with a calibrated CAE model or not; other numbers of tests,
and those of any kind, lie evenly over speed. The limits lie in the middle of what occurs at 60 further conditions, so
that guessing is wrong half the time; every verdict is compared with a test that nothing was learned from. Printed:
coverage and width of the metrics' intervals, verdicts by kind and how many were wrong, Brier scores beside those of the
raw CAE with its own error as band, the probabilities in bins, and seconds.
"""

import argparse
import time
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from vehicles import KINDS, metrics_of

from crashfuse.approaches.cae import Cae
from crashfuse.approaches.metric_calibration import Distribution, metric_errors
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.certification.certify import certify_matrix
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import at_most, share_bounds, wrong_shares
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import Cache
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.study.config import StudyConfig
from crashfuse.synthetic.sample import TABLE_1
from crashfuse.units import LB, MPH

_N_NEW = 60
_METRICS = tuple(METRIC_LABELS)
LIMITED = ("peak", "max_crush", "sm25", "olc", "vpi")
"""What is limited where whole tests are counted."""

_QUANTILES = (0.5, 0.75, 0.9)
_BINS = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


def random_campaign(seed: int, n_tests: int, kind: str) -> tuple[Campaign, tuple[CrashTest, ...]]:
    """A campaign of a random vehicle, and further tests of it."""
    world, rng = KINDS[kind](seed), np.random.default_rng([seed, 9])
    if n_tests == len(TABLE_1) and kind == "sister":
        conditions = [Condition.of_vector([speed * MPH, front * LB, rear * LB]) for speed, front, rear, *_ in TABLE_1]
    else:
        conditions = world.over_speed(rng, n_tests)
    tests = world.test(conditions, first=0)
    return Campaign(f"Vehicle {seed}", world.library(tests), tests), world.test(
        world.conditions(rng, _N_NEW), first=1000
    )


def shown(tests: Iterable[CrashTest]) -> pd.DataFrame:
    """What tests show of :data:`LIMITED`, by their ids."""
    return pd.DataFrame({test.id: metrics_of(test.pulse.accel_mps2, test.condition) for test in tests}).T[list(LIMITED)]


def limits(by: pd.DataFrame, share: float) -> pd.Series:
    """Limits that this share of some tests meets, each."""
    return by[np.isfinite(by).all(axis=1)].quantile(share)


def limiting(limits: pd.Series) -> Criteria:
    """Criteria that limit from above."""
    return Criteria(tuple(Criterion(name, name, at_most=float(limits[name])) for name in LIMITED))


def _judged(
    seed: int, campaign: Campaign, new: tuple[CrashTest, ...], approach: str
) -> tuple[pd.DataFrame, list[dict[str, Any]]]:
    """All verdicts on a vehicle, each with what was measured and what the raw CAE says; and :func:`_whole_tests`."""
    measured = [metrics_of(test.pulse.accel_mps2, test.condition) for test in new]
    middle = {name: float(np.median([m[name] for m in measured if np.isfinite(m[name])])) for name in _METRICS}
    criteria = Criteria(tuple(Criterion(name, name, at_most=limit) for name, limit in middle.items()))
    matrix = Matrix(tuple(test.id for test in new), tuple(test.condition for test in new))
    start = time.perf_counter()
    config = StudyConfig(approaches=(approach,))
    found = certify_matrix(campaign, criteria, matrix, config, cache=Cache())
    raw = Cae(cache=Cache()).fit(campaign)
    errors = metric_errors(raw.left_out(campaign), campaign)
    rows = []
    for test, truth, row in zip(new, measured, found.verdicts, strict=True):
        values = metrics_of(raw.predict(test.condition).accel_mps2, test.condition)
        for verdict in row:
            name, limit = verdict.criterion.metric, verdict.criterion.at_most
            cae = Distribution.of(np.array([values[name]]), errors[name])
            rows.append(
                {
                    "seed": seed,
                    "metric": name,
                    "verdict": verdict.word,
                    "probability": verdict.probability,
                    "cae": None if cae is None else cae.probability(None, limit),
                    "measured": truth[name],
                    "met": truth[name] <= float(limit or 0),
                    "lower": verdict.lower,
                    "upper": verdict.upper,
                    "away": abs(float(limit or 0) - verdict.value) / float(limit or 1) if verdict.value else None,
                }
            )
    decided, wrong = found.record.decided
    print(
        f"vehicle {seed}: record {decided} decided, {wrong} wrong; learned in {found.seconds['learn']:.0f} s, judged "
        f"{len(new)} × {len(_METRICS)} in {found.seconds['judge']:.0f} s ({time.perf_counter() - start:.0f} s)",
        flush=True,
    )
    return pd.DataFrame(rows), _whole_tests(campaign, new, matrix, config)


def _whole_tests(
    campaign: Campaign, new: tuple[CrashTest, ...], matrix: Matrix, config: StudyConfig
) -> list[dict[str, Any]]:
    """How many tests need not be run, and how many of these miss a criterion, by how high the limits are."""
    measured, found = shown(new), []
    for share in _QUANTILES:
        at_most = limits(measured, share)
        waived = certify_matrix(campaign, limiting(at_most), matrix, config, cache=Cache()).waived
        met = (measured <= at_most).all(axis=1)
        risks = 1 - np.array(list(waived.values())).reshape(-1, 3)
        missed, (most, expected, least) = int((~met[list(waived)]).sum()), risks.sum(axis=0)
        row = {"limits": share, "tests": len(new), "would meet all": int(met.sum()), "need not be run": len(waived)}
        row["wrong"] = (~met[list(waived)]).tolist()
        found.append({**row, "missed one": missed, "expected": expected, "said at least": least, "said at most": most})
    return found


def _summary(table: pd.DataFrame) -> None:
    known = table[np.isfinite(table["measured"]) & table["probability"].notna()].copy()
    known["decided"] = known["verdict"].isin(["met", "not met"])
    known["wrong"] = known["decided"] & ((known["verdict"] == "met") != known["met"])
    known["brier"] = (known["probability"] - known["met"]) ** 2
    known["brier_cae"] = (known["cae"].astype(float) - known["met"]) ** 2
    both = known[known["lower"].notna() & known["upper"].notna()].copy()
    both["inside"] = (both["lower"] <= both["measured"]) & (both["measured"] <= both["upper"])
    both["half_width"] = (both["upper"] - both["lower"]) / 2 / both["measured"]
    by = known.groupby("metric", sort=False)
    shown = by[["decided", "brier", "brier_cae"]].mean()
    shown["wrong"] = by["wrong"].sum() / by["decided"].sum()
    shown = shown.join(both.groupby("metric", sort=False)[["inside", "half_width"]].mean())
    print(shown.to_string(float_format="{:.3f}".format))
    decided, wrong = int(known["decided"].sum()), int(known["wrong"].sum())
    print(
        f"all: {len(known)} cells, decided {decided / len(known):.3f}, wrong {wrong / max(decided, 1):.4f}, outside "
        f"{(known['verdict'] == 'outside').mean():.3f}; open ones a median of "
        f"{known.loc[known['verdict'] == 'open', 'away'].median():.3f} from the limit; Brier "
        f"{known['brier'].mean():.4f}, raw CAE {known['brier_cae'].mean():.4f}"
    )
    for low, high in pairwise(_BINS):
        own = known[(known["probability"] >= low) & (known["probability"] < high + (high == 1))]
        if n := len(own):
            met = int(own["met"].sum())
            bounds = "–".join(f"{end:.3f}" for end in share_bounds(met, n))
            mean = own["probability"].mean()
            print(f"  {low:.2f}–{high:.2f}: {n} of mean probability {mean:.3f}, {met / n:.3f} met ({bounds})")


def _own_record(folder: str, approach: str) -> None:
    """The track record of a campaign's own tests, with the limits in the middle of what they showed."""
    campaign = load_campaign(folder)
    measured = [metrics_of(test.pulse.accel_mps2, test.condition) for test in campaign.tests]
    middle = {name: float(np.median([m[name] for m in measured if np.isfinite(m[name])])) for name in _METRICS}
    criteria = Criteria(tuple(Criterion(name, name, at_most=limit) for name, limit in middle.items()))
    matrix = Matrix(campaign.test_ids, tuple(test.condition for test in campaign.tests))
    record = certify_matrix(campaign, criteria, matrix, StudyConfig(approaches=(approach,)), cache=Cache()).record
    print(
        f"{campaign.name}: {len(campaign.tests)} tests, verdicts and wrong ones {record.counts()}, Brier {record.brier}"
    )
    for own in record.reliability:
        bounds = f"{own.lower:.3f}–{own.upper:.3f}"
        print(f"  {own.low:.2f}–{own.high:.2f}: {own.n} of mean {own.probability:.3f}, {own.met:.3f} met ({bounds})")


def main() -> None:
    """Judge some vehicles and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--vehicles", type=int, default=4)
    parser.add_argument("--first", type=int, default=301, help="seed of the first vehicle")
    parser.add_argument("--tests", type=int, default=len(TABLE_1))
    parser.add_argument("--kind", choices=list(KINDS), default="sister", help="of vehicle")
    parser.add_argument("--approach", default="fused")
    parser.add_argument("--campaign", nargs="+", default=[], help="campaign folders: their own records instead")
    given = parser.parse_args()
    for folder in given.campaign:
        _own_record(folder, given.approach)
    if given.campaign:
        return
    tables, whole = zip(
        *(
            _judged(seed, *random_campaign(seed, given.tests, given.kind), given.approach)
            for seed in range(given.first, given.first + given.vehicles)
        ),
        strict=True,
    )
    _summary(pd.concat(tables))
    of_limits = pd.DataFrame(row for rows in whole for row in rows).groupby("limits")
    print(of_limits.sum().drop(columns="wrong").to_string(float_format="{:.1f}".format))
    for share, wrong in of_limits["wrong"]:
        vehicles = np.repeat(np.arange(len(wrong)), wrong.map(len)).tolist()
        bounds = wrong_shares(wrong.sum(), vehicles=vehicles)
        print(f"limits {share}, exact 95 % bounds:", *(f"{unit} {at_most(*own)}" for unit, own in bounds.items()))


if __name__ == "__main__":
    main()
