"""Tables of the numbers of a study or prediction, as written to files."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict

import numpy as np
import pandas as pd

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.cae.quality import QualityVerdict
from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.signals.metrics import Metric
from crashfuse.study.estimate import Estimate
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost, gains, plus_minus, summary
from crashfuse.study.study import Study
from crashfuse.study.sweep import Sweep
from crashfuse.units import MPH, MS, G
from crashfuse.wording import number, signed


def scores_table(study: Study) -> pd.DataFrame:
    """One row per held-out test, approach and window: overall rating, its four parts, its grade, what it rests on."""
    basis = study.campaign.rating_basis
    return pd.DataFrame(
        {"held_out": fold.held_out, "approach": approach, "window_ms": window, **asdict(rating), "basis": basis}
        for fold in study.folds
        for approach, ratings in fold.ratings.items()
        for window, rating in ratings.items()
    )


def studies_table(studies: Iterable[tuple[str, Study]]) -> pd.DataFrame:
    """One row per study, way of leaving tests out, approach and window: mean and lowest overall rating of its tests.

    Each study comes with the name of its campaign.
    """
    parts = []
    for name, study in studies:
        for one in (study, study.speed_groups):
            if one is not None:
                config = one.config.split_configs[0]
                table = scores_table(one).groupby(["approach", "window_ms"], sort=False)["overall"]
                rows = table.agg(tests="size", mean="mean", least="min").reset_index()
                about = {"campaign": name, "preset": config.preset, "seed": config.seed, "left_out": config.leave_out}
                about["held_out"] = " ".join(fold.held_out for fold in one.folds)
                parts.append(rows.assign(**about)[[*about, *rows.columns]].assign(basis=one.campaign.rating_basis))
    return pd.concat(parts, ignore_index=True)


def pulses_table(estimates: Iterable[Estimate]) -> pd.DataFrame:
    """Predicted pulses at a new condition in ms and g with the central 95 % band, empty where an approach has none."""
    rows = [_pulse_rows("", estimate.approach, estimate.prediction) for estimate in estimates]
    return pd.concat(rows, ignore_index=True)


def study_pulses(study: Study) -> pd.DataFrame:
    """The pulse of every held-out test as measured (``test``) and as predicted, as :func:`pulses_table` has them."""
    rows = []
    for fold in study.folds:
        measured = Prediction(fold.test.condition, fold.test.pulse.accel_mps2)
        rows.append(_pulse_rows(fold.held_out, "test", measured))
        rows += [_pulse_rows(fold.held_out, each.approach, each.prediction) for each in fold.estimates]
    return pd.concat(rows, ignore_index=True)


def metrics_table(
    rows: Iterable[tuple[object, str, Sequence[Metric]]], campaign: Campaign, first: str = "held_out"
) -> pd.DataFrame:
    """Pulse metrics, one per row, from (held-out test, or what else comes ``first``, approach or ``test``, metrics)."""
    bases = campaign.metric_bases
    return pd.DataFrame(
        [
            (key, approach, m.name, m.value, m.lower, m.upper, m.unit, bases[m.name])
            for key, approach, own in rows
            for m in own
        ],
        columns=[first, "approach", "metric", "value", "lower", "upper", "unit", "basis"],
    ).astype(dict.fromkeys(("value", "lower", "upper"), float))


def study_metrics(study: Study) -> pd.DataFrame:
    """Pulse metrics of every held-out test as measured (``test``) and as predicted."""
    rows: list[tuple[object, str, Sequence[Metric]]] = []
    for fold in study.folds:
        rows.append((fold.held_out, "test", study.campaign.metrics_of(study.campaign.test(fold.held_out))))
        rows.extend((fold.held_out, estimate.approach, estimate.metrics) for estimate in fold.estimates)
    return metrics_table(rows, study.campaign)


def sweep_table(sweeps: Sequence[Sweep], campaign: Campaign) -> pd.DataFrame:
    """Pulse metrics at every speed, then those of the tests, which have their own weights."""
    rows: list[tuple[object, str, Sequence[Metric]]] = [
        (speed_mps / MPH, sweep.approach, metrics)
        for sweep in sweeps
        for speed_mps, metrics in zip(sweep.speeds_mps.tolist(), sweep.metrics, strict=True)
    ]
    rows += [(test.condition.speed_mps / MPH, "test", campaign.metrics_of(test)) for test in campaign.tests]
    return metrics_table(rows, campaign, "speed_mph")


def repeat_scores(study: Study) -> pd.DataFrame:
    """What a repeat of each held-out test would rate over each window, with its interval and the actual repeats."""
    return pd.DataFrame(
        [
            (fold.held_out, window, own.value, own.lower, own.upper, " ".join(own.repeats))
            for fold in study.folds
            for window, own in study.repeatability.get(fold.held_out, {}).items()
        ],
        columns=["held_out", "window_ms", "value", "lower", "upper", "repeats"],
    )


def gains_table(curve: LearningCurve, cost: Cost | None = None) -> pd.DataFrame:
    """Gains of the judged approach as a readable table; the cost of a hundredth only for gains above their error."""
    return pd.DataFrame(
        {
            "Tests": f"{step.before} → {step.after}",
            "Gain of rating": signed(step.gain, 3) + plus_minus(step.error),
            "Per test": signed(step.per_test, 4),
            **({} if cost is None else {"Cost of 0.01": cost.times(0.01 / step.per_test) if step.is_clear else "–"}),
        }
        for step in gains(curve)
    )


def curve_table(curve: LearningCurve, display: Display = DEFAULT) -> pd.DataFrame:
    """The summary of the approaches that learn from tests, as a readable table."""
    table = summary(curve)
    table = table[[CLASSES[name].learns_from_tests for name in table["approach"]]]
    half_width, known = table["half_width_g"] * display.units.factor("g"), table["half_width_g"].notna()
    return pd.DataFrame(
        {
            "Approach": table["approach"].map(LABELS),
            "Tests": table["n_tests"],
            "Chosen": table["choice"].map({"even": "evenly", "random": "at random"}),
            "Predictions": table["predictions"],
            "Rating": [f"{r:.3f}{plus_minus(e)}" for r, e in zip(table["rating"], table["error"], strict=True)],
            "80 % within": [f"{low:.2f}–{high:.2f}" for low, high in zip(table["low"], table["high"], strict=True)],
            "a(t) in band (%)": (100 * table["inside"]).map("{:.0f}".format).where(known, "–"),
            f"Band (± {display.unit})": half_width.map("{:.1f}".format).where(known, "–"),
            **({"Decided (%)": (100 * table["decided"]).map("{:.0f}".format)} if "decided" in table else {}),
        }
    )


def _pulse_rows(held_out: str, approach: str, prediction: Prediction) -> pd.DataFrame:
    lower, upper = prediction.band() or (np.full(prediction.time_s.size, np.nan),) * 2
    return pd.DataFrame(
        {
            "held_out": held_out,
            "approach": approach,
            "time_ms": (prediction.time_s / MS).round(6),
            "acceleration_g": prediction.accel_mps2 / G,
            "lower_g": lower / G,
            "upper_g": upper / G,
        }
    )


_OF = {
    "energy change": "energy at the start",
    "hourglass energy": "largest internal energy",
    "added mass": "mass at the start",
}


def quality_table(verdict: QualityVerdict) -> pd.DataFrame:
    """One row a quantity, as texts; empty if nothing is recorded for any run."""
    judged = verdict.limits is not None
    return pd.DataFrame(
        {
            "Quantity": f"{row['quantity'].capitalize()}, largest",
            "In % of": _OF[row["quantity"]],
            "Limit (%)": "none" if pd.isna(row["limit"]) else _limit(row),
            **({"Pass": f"{row['passed']:,}", "Fail": f"{row['failed']:,}"} if judged else {}),
            "Not recorded": f"{row['not_recorded']:,}",
            "At worst (%)": "–" if pd.isna(row["worst"]) else number(100 * row["worst"], ".3g"),
            "In run": row["worst_run"] or "–",
        }
        for row in verdict.table.to_dict("records")
    )


def _limit(row: dict[str, object]) -> str:
    sign = "≤" if row["quantity"] == "energy change" else "<"
    return f"{sign} {100 * float(str(row['limit'])):g}"
