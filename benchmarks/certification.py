"""How often verdicts are wrong: ``python benchmarks/certification.py --vehicles 4``.

Each seed is another synthetic vehicle (``benchmarks/vehicles.py``), a sister of the sample's, tested at the eleven
conditions of Zeng et al. 2023, Table 1, or one of any kind, with a tuned CAE model or not; other numbers of tests,
and those of any kind, lie evenly over speed. The limits lie in the middle of what occurs at 60 further conditions, so
that guessing is wrong half the time; every verdict is compared with a test that nothing was learned from. Printed:
coverage and width of the metrics' intervals, verdicts by kind and how many were wrong, Brier scores beside those of the
raw CAE with its own error as band, the probabilities in bins, and seconds. With ``--data`` the tables are written as
CSV: ``certification.csv`` (whole tests), ``certification_metrics.csv``, ``certification_bins.csv`` and
``all_at_once.csv`` (the probability that all criteria are met, by draws, by Boole's inequality, and as if criteria were
independent).
"""

import argparse
import time
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from tables import add_data_option, write
from vehicles import KINDS, metrics_of

from crashfuse.approaches.cae import Cae
from crashfuse.approaches.metric_calibration import Distribution, metric_errors
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.certification.certify import certify_matrix
from crashfuse.certification.criteria import CONFIDENCE, Criteria, Criterion
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import largest_share, share_bounds, wrong_shares
from crashfuse.certification.verdict import all_met, reaches
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.run import Run
from crashfuse.execution.workers import Local
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
_KINDS = {"sister": "sisters of the sample", "any": "of any kind", "tuned": "with a tuned CAE model"}
_DIGITS = {"inside": 2}
_WAYS = ("share of draws", "Boole's inequality", "independent")


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
    found = certify_matrix(campaign, criteria, matrix, config, run=Run(workers=Local()))
    raw = Cae().fit(campaign, Run())
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
    """Whether each further test meets all criteria, and with which probability by each way, by how high limits are."""
    measured, rows = shown(new), []
    for share in _QUANTILES:
        at_most = limits(measured, share)
        certification = certify_matrix(campaign, limiting(at_most), matrix, config, run=Run(workers=Local()))
        met = (measured <= at_most).all(axis=1)
        for test, row in certification.rows.items():
            chances = all_met(row)
            independent = float(np.prod([verdict.probability or 0.0 for verdict in row]))
            by_way = dict(zip(_WAYS, (chances.probability, chances.at_least, independent), strict=True))
            words = {verdict.word for verdict in row}
            known = words <= {"met", "not met", "open"} and all(verdict.probability is not None for verdict in row)
            need = {
                "waived": test in certification.waived,
                "each met": words == {"met"} and not row[0].run,
                "known": known,
            }
            rows.append({"vehicle": campaign.name, "share": share, "met": met[test], **need, **by_way})
    return rows


def _whole_table(whole: pd.DataFrame, vehicles: dict[str, str]) -> pd.DataFrame:
    """Tests that need not be run, and those of them that miss a criterion, by how high the limits are."""
    rows = []
    for share, tests in whole.groupby("share"):
        saved = tests[tests["waived"]]
        wrong = wrong_shares((~saved["met"]).tolist(), vehicles=saved["vehicle"].tolist())
        bounds = {name: f"{100 * largest_share(*own):.1f} %" for name, own in wrong.items()}
        row: dict[str, object] = {**vehicles, "share that meets a limit": share, "conditions": len(tests)}
        row |= {"would meet all": int(tests["met"].sum()), "need not be run": len(saved)}
        row |= {"of these missed one": wrong["verdicts"].wrong, "bound": bounds["verdicts"]}
        expected = f"{(1 - saved[_WAYS[0]]).sum():.1f}"
        with_one = f"{wrong['vehicles'].wrong} of {wrong['vehicles'].n}"
        row |= {"missed ones expected": expected, "vehicles with one": with_one}
        rows.append({**row, "bound by vehicle": bounds["vehicles"]})
    return pd.DataFrame(rows)


def _at_once_table(whole: pd.DataFrame, vehicles: dict[str, str], confidence: float) -> pd.DataFrame:
    """Scores of the probability that all criteria are met, and whom it would spare a test."""
    known, rows = whole[whole["known"]], []
    for way in _WAYS:
        chance = known[way].clip(1e-3, 1 - 1e-3)
        saved = known[known["each met"] & known[way].map(lambda p: reaches(p, confidence))]
        row: dict[str, object] = {**vehicles, "all five at once": way, "probabilities": len(known)}
        row |= {"Brier score": f"{((known[way] - known['met']) ** 2).mean():.3f}"}
        row |= {"log score": f"{-np.log(chance.where(known['met'], 1 - chance)).mean():.3f}"}
        row |= {"need not be run": len(saved), "of these missed one": int((~saved["met"]).sum())}
        rows.append({**row, "expected": f"{(1 - saved[way]).sum():.1f}"})
    return pd.DataFrame(rows)


def _by_metric(table: pd.DataFrame, vehicles: dict[str, str]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Scores of the verdicts by metric, then of all; and the probabilities in bins."""
    known = table[np.isfinite(table["measured"]) & table["probability"].notna()].copy()
    known["decided"] = known["verdict"].isin(["met", "not met"])
    known["wrong"] = known["decided"] & ((known["verdict"] == "met") != known["met"])
    known["Brier score"] = (known["probability"] - known["met"]) ** 2
    known["of the raw CAE"] = (known["cae"].astype(float) - known["met"]) ** 2
    both = known["lower"].notna() & known["upper"].notna()
    known["inside"] = ((known["lower"] <= known["measured"]) & (known["measured"] <= known["upper"])).where(both)
    known["half width"] = ((known["upper"] - known["lower"]) / 2 / known["measured"]).where(both)
    rows = []
    for metric, own in [*known.groupby("metric", sort=False), ("all", known)]:
        decided, wrong = int(own["decided"].sum()), int(own["wrong"].sum())
        means = own[["Brier score", "of the raw CAE", "inside", "half width"]].astype(float).mean()
        row: dict[str, object] = {
            **vehicles,
            "metric": metric,
            "verdicts": len(own),
            "decided": decided,
            "wrong": wrong,
        }
        rows.append(row | {name: f"{value:.{_DIGITS.get(str(name), 3)}f}" for name, value in means.items()})
    bins = []
    for low, high in pairwise(_BINS):
        own = known[(known["probability"] >= low) & (known["probability"] < high + (high == 1))]
        if n := len(own):
            met = int(own["met"].sum())
            ends = "–".join(f"{end:.3f}" for end in share_bounds(met, n))
            of_bin = {**vehicles, "probability": f"{low:.2f}–{high:.2f}", "verdicts": n}
            mean = f"{own['probability'].mean():.3f}"
            bins.append({**of_bin, "mean": mean, "share met": f"{met / n:.3f}", "two-sided 95 % interval": ends})
    return pd.DataFrame(rows), pd.DataFrame(bins)


def _own_record(folder: str, approach: str) -> None:
    """The track record of a campaign's own tests, with the limits in the middle of what they showed."""
    campaign = load_campaign(folder)
    measured = [metrics_of(test.pulse.accel_mps2, test.condition) for test in campaign.tests]
    middle = {name: float(np.median([m[name] for m in measured if np.isfinite(m[name])])) for name in _METRICS}
    criteria = Criteria(tuple(Criterion(name, name, at_most=limit) for name, limit in middle.items()))
    matrix = Matrix(campaign.test_ids, tuple(test.condition for test in campaign.tests))
    record = certify_matrix(
        campaign, criteria, matrix, StudyConfig(approaches=(approach,)), run=Run(workers=Local())
    ).record
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
    add_data_option(parser)
    given = parser.parse_args()
    for folder in given.campaign:
        _own_record(folder, given.approach)
    if given.campaign:
        return
    seeds = range(given.first, given.first + given.vehicles)
    judged = [_judged(seed, *random_campaign(seed, given.tests, given.kind), given.approach) for seed in seeds]
    vehicles = {"vehicles": f"{given.vehicles} {_KINDS[given.kind]}", "seeds": f"{seeds[0]}–{seeds[-1]}"}
    whole = pd.DataFrame(row for _, rows in judged for row in rows)
    metrics, bins = _by_metric(pd.concat(table for table, _ in judged), vehicles)
    tables = {"certification": _whole_table(whole, vehicles), "certification_metrics": metrics}
    tables |= {"certification_bins": bins, "all_at_once": _at_once_table(whole, vehicles, CONFIDENCE)}
    for name, table in tables.items():
        print(f"\n{name}\n{table.to_string(index=False)}")
        if given.data is not None:
            write(table, given.data / f"{name}.csv", "vehicles")


if __name__ == "__main__":
    main()
