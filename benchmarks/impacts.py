"""Measured impacts of structures that are not cars: ``python benchmarks/impacts.py FOLDER``.

Every campaign in the folder is predicted with each test left out, then with its whole speed group. Further repeats
(``unseen.parquet``: id, time_ms, acceleration_g, speed_mps) are compared with predictions from all tests, and from
those at other speeds. Printed: mean ratings, the largest fall of a test below the raw CAE, shares of a(t) inside the
band and of whole curves, 0 to 60 ms, inside that of whole pulses; by metric the mean relative errors of value and
averaged pulse, the mean relative width of 95 % intervals, the width that the errors ask for, and the share inside.
Last verdicts of fused on each test and repeat, at limits of 0.8 to 1.25 times the mean of what repeats show at their
speed, from above and from below: how many, and how many decided and wrong, by metric.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from vehicles import metrics_of

from crashfuse.approaches.metric_calibration import metric_distributions
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.certification.domain import REST_ON_PEAK, Domain
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit, estimates_at
from crashfuse.study.running import run_study
from crashfuse.study.study import Fold, Study
from crashfuse.units import G

_WINDOWS_MS = (60.0, 80.0)
_APPROACHES = ("cae", "time_domain", "displacement_domain", "fused")
_METRICS = ("peak", "max_crush", "sm25", "olc")
_LIMITS = (0.8, 0.9, 1.0, 1.1, 1.25)


def _unseen(folder: Path, campaign: Campaign) -> list[CrashTest]:
    """Further repeats, at the conditions of tests."""
    if not (file := folder / "unseen.parquet").exists():
        return []
    conditions = {round(test.condition.speed_mps, 3): test.condition for test in campaign.tests}
    return [
        CrashTest(
            str(name),
            conditions[round(speed, 3)],
            Pulse(GRID_S, np.interp(GRID_S * 1e3, rows.time_ms, rows.acceleration_g) * G),
        )
        for (name, speed), rows in pd.read_parquet(file).groupby(["id", "speed_mps"])
    ]


def _folds(study: Study, unseen: list[CrashTest]) -> Iterator[tuple[str, str, Fold]]:
    """What was left out, of what is predicted, and the predictions of it."""
    for fold in study.folds:
        yield "test", "tests", fold
    by_condition: dict[Condition, Sequence[Estimate]] = {}
    if unseen:
        fits = [Fit.of(study.campaign, name, run=Run()) for name in _APPROACHES]
        by_condition = {condition: estimates_at(fits, condition) for condition in {test.condition for test in unseen}}
    for test in unseen:
        yield "test", "repeats", Fold.of(test, by_condition[test.condition], _WINDOWS_MS)
    if study.speed_groups is None:
        return
    by_condition = {fold.test.condition: fold.estimates for fold in study.speed_groups.folds}
    for fold in study.speed_groups.folds:
        yield "speed", "tests", fold
    for test in unseen:
        yield "speed", "repeats", Fold.of(test, by_condition[test.condition], _WINDOWS_MS)


def _rows(fold: Fold) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """The ratings of the approaches in a row each, and their metrics."""
    pulses, metrics = [], []
    measured = metrics_of(fold.test.pulse.accel_mps2, fold.test.condition)
    raw = fold.ratings["cae"][_WINDOWS_MS[-1]].overall
    for estimate in fold.estimates:
        about = {"approach": estimate.approach}
        ratings = {f"0-{w:g} ms": fold.ratings[estimate.approach][w].overall for w in _WINDOWS_MS}
        coverage = fold.coverage(estimate.approach)
        fall = raw - ratings[f"0-{_WINDOWS_MS[-1]:g} ms"]
        inside = {name: getattr(coverage, key, None) for name, key in (("a(t)", "accel"), ("whole", "whole"))}
        pulses.append({**about, **ratings, "below CAE": fall, **inside})
        for metric in estimate.metrics:
            truth, drawn = measured[metric.name], estimate.draws_mps2 is not None
            if metric.name not in _METRICS or not metric.value or not np.isfinite(truth) or not drawn:
                continue
            ends = np.array([metric.lower, metric.upper], dtype=float)
            off = {name: shown / truth - 1 for name in ("value", "of_pulse") if (shown := getattr(metric, name))}
            row = {**about, "metric": metric.name, **off, "inside": metric.holds(truth), "width": np.ptp(ends) / truth}
            metrics.append(row)
    return pulses, metrics


def _verdicts(campaign: Campaign, folds: Sequence[tuple[str, str, Fold]]) -> Iterator[dict[str, object]]:
    """Verdicts on each test and repeat, by what was left out, and whether nothing faster was learned from."""
    shown = {fold.test.id: metrics_of(fold.test.pulse.accel_mps2, fold.test.condition) for *_, fold in folds}
    speeds = {fold.test.id: fold.test.condition.speed_mps for *_, fold in folds}
    for left_out, of, fold in folds:
        v0, estimate = fold.test.condition.speed_mps, next(e for e in fold.estimates if e.approach == "fused")
        group = {i for i in campaign.test_ids if speeds[i] == v0} if left_out == "speed" else {fold.test.id}
        domain = Domain.of(campaign.without(sorted(group.intersection(campaign.test_ids))), for_record=True)
        outside, unshown = domain.exceeded_by(fold.test.condition), domain.unshown(fold.test.condition)
        where = "above" if unshown else "below" if v0 < domain.speeds_mps[0] - 0.1 else "between"
        for metric, law in metric_distributions(estimate.drawn, estimate.metric_errors).items():
            measured = shown[fold.test.id][metric]
            mean = float(np.mean([shown[i][metric] for i, speed in speeds.items() if speed == v0]))
            if law is None or not (np.isfinite(measured) and np.isfinite(mean)):
                continue
            for limit in np.multiply(_LIMITS, mean).tolist():
                for is_met, p in ((measured >= limit, 1 - law.cdf(limit)), (measured <= limit, law.cdf(limit))):
                    is_judged = not outside and not (unshown and metric in REST_ON_PEAK)
                    decided = is_judged and not 0.05 < p < 0.95
                    about = {"left out": left_out, "of": of, "where": where, "metric": metric}
                    yield {**about, "decided": decided, "wrong": decided and (p >= 0.95) != is_met}


def main() -> None:
    """Run the studies and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("folder", type=Path, help="with a campaign in each of its folders")
    series = parser.parse_args().folder.glob("*/tests.csv")
    pulses: list[dict[str, object]] = []
    metrics: list[dict[str, object]] = []
    verdicts: list[dict[str, object]] = []
    for folder in sorted(path.parent for path in series):
        campaign = load_campaign(folder)
        study = run_study(campaign, StudyConfig(_APPROACHES, windows_ms=_WINDOWS_MS, leave_out="both"))
        folds = [*_folds(study, _unseen(folder, campaign))]
        verdicts += [{"series": folder.name, **row} for row in _verdicts(campaign, folds)]
        for left_out, of, fold in folds:
            about = {"left out": left_out, "of": of, "series": folder.name}
            for rows, more in zip((pulses, metrics), _rows(fold), strict=True):
                rows += [{**about, **row} for row in more]
    by = pd.DataFrame(pulses).groupby(["left out", "of", "series", "approach"], sort=False)
    shown = by[["0-60 ms", "0-80 ms", "a(t)", "whole"]].mean().join(by["below CAE"].max()).join(by.size().rename("n"))
    print(shown.to_string(float_format="{:.3f}".format))
    for keys in (["left out", "of"], ["left out", "of", "series"]):
        by = pd.DataFrame(metrics).groupby([*keys, "approach", "metric"], sort=False)
        shown = by[["value", "of_pulse", "width", "inside"]].mean()  # an open interval has no width
        shown.insert(3, "asked", 3.92 * by["value"].agg(lambda errors: float(np.sqrt(np.mean(errors**2)))))
        print(shown.join(by.size().rename("n")).to_string(float_format="{:.3f}".format))
    for keys in (["left out", "where", "metric"], ["left out", "where", "series", "metric"]):
        by = pd.DataFrame(verdicts).groupby(keys, sort=False)
        print(by[["decided", "wrong"]].sum().join(by.size().rename("n")).to_string())


if __name__ == "__main__":
    main()
