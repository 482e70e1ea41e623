"""Measured impacts of structures that are not cars: ``python benchmarks/impacts.py FOLDER [--series NAME …]``.

Every campaign in the folder is predicted with each test left out, then with all tests at its speed, which in these
series is that of one height or one pendulum. Further repeats (``unseen.parquet``: id, time_ms, acceleration_g,
speed_mps) are compared with predictions from all tests, and from those at other speeds. Beside the approaches stand
the plain methods of ``plain_methods.py``, and *a repeat*: the other tests at the speed. Printed: mean ratings, the
largest fall of a test below the raw CAE, shares of a(t) inside the band and of whole curves, 0 to 60 ms, inside that of
whole pulses; by metric the mean relative errors of value and averaged pulse, the mean relative width of 95 % intervals,
the width that the errors ask for, and the share inside. Last verdicts of fused on each test and repeat, at limits of
0.8 to 1.25 times the mean of what repeats show at their speed, from above and from below: how many, and how many
decided and wrong, by metric. With ``--data`` ratings and metrics are written to ``impacts.csv`` and
``impacts_metrics.csv``.
"""

import argparse
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from plain_methods import METHODS, NOT_RUN, fit_plain
from tables import add_data_option, write
from vehicles import metrics_of

from crashfuse.approaches.metric_calibration import metric_distributions
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.certification.domain import REST_ON_PEAK, Domain
from crashfuse.crash_test import CrashTest
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.estimate import Estimate, estimate_at
from crashfuse.study.study import Fold
from crashfuse.units import G

_WINDOWS_MS = (60.0, 80.0)
_APPROACHES = ("cae", "time_domain", "displacement_domain", "fused")
_METRICS = ("peak", "max_crush", "sm25", "olc")
_LIMITS = (0.8, 0.9, 1.0, 1.1, 1.25)
_REPEAT = "a repeat"
_TITLES = {
    "cone_blunt": "Cone of 80° into water",
    "cone_spring": "Cone of 60° into water",
    "helmet_front": "Helmet, front",
    "helmet_left": "Helmet, side",
    "quadcopter": "Quadcopter",
}


class Case(NamedTuple):
    """A test or a further repeat, what it is predicted from, and the fold."""

    left_out: str
    of: str
    training: Campaign
    fold: Fold
    plain_mps2: dict[str, list[FloatArray]]  # predictions by the plain methods, and the repeats at its speed


def further_repeats(folder: Path, campaign: Campaign) -> list[CrashTest]:
    """The repeats in a series' folder that are no tests of the campaign, at the conditions of tests."""
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


def _cases(campaign: Campaign, unseen: Sequence[CrashTest]) -> Iterator[Case]:
    """Each test and repeat, predicted without itself, then without its speed."""

    @cache
    def training(left_out: tuple[str, ...]) -> Campaign:
        return campaign.without(left_out)

    plain = cache(lambda left_out: fit_plain(training(left_out)))

    @cache
    def estimates(left_out: tuple[str, ...], like: str) -> list[Estimate]:
        return [estimate_at(training(left_out), campaign.test(like).condition, name) for name in _APPROACHES]

    for way in ("test", "speed"):
        for test in (*campaign.tests, *unseen):
            at_speed = [other for other in campaign.tests if other.condition == test.condition]
            is_test = test.id in campaign.test_ids
            left_out = tuple(other.id for other in at_speed) if way == "speed" else (test.id,) * is_test
            if not training(left_out).tests:
                continue
            fold = Fold.of(test, estimates(left_out, at_speed[0].id), _WINDOWS_MS)
            pulses = {name: [predict(test.condition)] for name, predict in plain(left_out).items()}
            pulses[_REPEAT] = [other.pulse.accel_mps2 for other in at_speed if other.id != test.id]
            yield Case(way, "tests" if is_test else "repeats", training(left_out), fold, pulses)


def _rows(case: Case) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """The ratings of the approaches in a row each, and their metrics."""
    pulses, metrics = [], []
    fold = case.fold
    measured = metrics_of(fold.test.pulse.accel_mps2, fold.test.condition)
    raw = fold.ratings["cae"][_WINDOWS_MS[-1]].overall
    for name, repeats in case.plain_mps2.items():
        rated = [rate_windows(fold.test.pulse, Pulse(GRID_S, accel), _WINDOWS_MS) for accel in repeats]
        ratings = {f"0-{w:g} ms": float(np.mean([one[w].overall for one in rated])) for w in _WINDOWS_MS if rated}
        pulses.append(
            {"approach": name, **ratings, "below CAE": raw - ratings.get(f"0-{_WINDOWS_MS[-1]:g} ms", np.nan)}
        )
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


def _verdicts(cases: Sequence[Case]) -> Iterator[dict[str, object]]:
    """Verdicts on each test and repeat, by what was left out, and whether nothing faster was learned from."""
    shown = {case.fold.test.id: metrics_of(case.fold.test.pulse.accel_mps2, case.fold.test.condition) for case in cases}
    speeds = {case.fold.test.id: case.fold.test.condition.speed_mps for case in cases}
    for left_out, of, training, fold, _ in cases:
        v0, estimate = fold.test.condition.speed_mps, fold.estimate("fused")
        domain = Domain.of(training, for_record=True)
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


def _tables(shown: pd.DataFrame, of_metrics: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The tables of the documentation: of left-out tests alone, and metrics of further repeats in a column."""
    names = {"cae": "raw CAE", "time_domain": "time domain", "displacement_domain": "displacement domain"}
    titles = {"peak": "Peak", "max_crush": "Maximum crush", "sm25": "SM25", "olc": "OLC"}
    way = {"test": "a test", "speed": "its speed"}
    ratings = []
    for (left_out, series), rows in shown.xs("tests", level="of").groupby(level=["left out", "series"], sort=False):
        by_approach = rows.droplevel(["left out", "series"])
        row = {"series": _TITLES.get(series, series), "left out": way[left_out]}
        for name in (_REPEAT, _APPROACHES[0], *METHODS, *_APPROACHES[1:]):
            for window in ("0-60 ms", "0-80 ms"):
                column = f"{names.get(name, name)}, {window.replace('-', '–')}"
                row[column] = f"{by_approach[window][name]:.2f}"
        fall = by_approach["below CAE"]["fused"]
        ratings.append(row | {"largest fall, 0–80 ms": f"{fall:.2f}" if round(fall, 2) > 0 else ""})
    metrics = []
    for (left_out, series, approach, metric), row in of_metrics.xs("tests", level="of").iterrows():
        further = of_metrics["inside"].get((left_out, "repeats", series, approach, metric), np.nan)
        metrics.append(
            {
                "series": _TITLES.get(series, series),
                "metric": titles[metric],
                "left out": way[left_out],
                "approach": names.get(approach, approach),
                "mean error of the value (%)": _signed(row["value"]),
                "mean error of the averaged pulse (%)": _signed(row["of_pulse"]),
                "width of the interval (%)": f"{100 * row['width']:.0f}" if row["open"] < 0.5 else "mostly open",
                "inside (%)": _percent(row["inside"]),
                "further repeats inside (%)": _percent(further),
            }
        )
    order = [*titles.values()]
    by = pd.DataFrame(metrics).sort_values("metric", key=lambda column: column.map(order.index), kind="stable")
    return pd.DataFrame(ratings), by.sort_values("series", kind="stable")


def _percent(share: float) -> str:
    return "" if np.isnan(share) else f"{100 * share:.0f}"


def _signed(share: float) -> str:
    return f"{100 * share:+.0f}".replace("-", "−").replace("+0", "0").replace("−0", "0")


def main() -> None:
    """Run the studies and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("folder", type=Path, help="with a campaign in each of its folders")
    parser.add_argument("--series", nargs="+", help="names of folders there; default: all")
    add_data_option(parser)
    given = parser.parse_args()
    pulses: list[dict[str, object]] = []
    metrics: list[dict[str, object]] = []
    verdicts: list[dict[str, object]] = []
    for folder in sorted(path.parent for path in given.folder.glob("*/tests.csv")):
        if given.series and folder.name not in given.series:
            continue
        campaign = load_campaign(folder)
        cases = [*_cases(campaign, further_repeats(folder, campaign))]
        verdicts += [{"series": folder.name, **row} for row in _verdicts(cases)]
        for case in cases:
            about = {"left out": case.left_out, "of": case.of, "series": folder.name}
            for rows, more in zip((pulses, metrics), _rows(case), strict=True):
                rows += [{**about, **row} for row in more]
    by = pd.DataFrame(pulses).groupby(["left out", "of", "series", "approach"], sort=False)
    shown = by[["0-60 ms", "0-80 ms", "a(t)", "whole"]].mean().join(by["below CAE"].max()).join(by.size().rename("n"))
    print(shown.to_string(float_format="{:.3f}".format))
    print(NOT_RUN)
    by_metric = []
    for keys in (["left out", "of"], ["left out", "of", "series"]):
        by = pd.DataFrame(metrics).groupby([*keys, "approach", "metric"], sort=False)
        of_metrics = by[["value", "of_pulse", "width", "inside"]].mean()  # an open interval has no width
        of_metrics.insert(3, "asked", 3.92 * by["value"].agg(lambda errors: float(np.sqrt(np.mean(errors**2)))))
        of_metrics = of_metrics.join(by["width"].agg(lambda widths: widths.isna().mean()).rename("open"))
        by_metric.append(of_metrics.join(by.size().rename("n")))
        print(by_metric[-1].to_string(float_format="{:.3f}".format))
    for keys in (["left out", "where", "metric"], ["left out", "where", "series", "metric"]):
        by = pd.DataFrame(verdicts).groupby(keys, sort=False)
        print(by[["decided", "wrong"]].sum().join(by.size().rename("n")).to_string())
    if given.data:
        ratings, of_metrics = _tables(shown, by_metric[1])
        write(ratings, given.data / "impacts.csv", key="series")
        write(of_metrics, given.data / "impacts_metrics.csv", key="series")


if __name__ == "__main__":
    main()
