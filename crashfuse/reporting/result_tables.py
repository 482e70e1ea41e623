"""Tables of the numbers of studies, predictions and plans, as written to files and as read."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import chain

import numpy as np
import pandas as pd

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.cae_library import QualityVerdict
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import listed
from crashfuse.condition import ABOUT, About
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.signals.metrics import Metric
from crashfuse.study.estimate import Estimate
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost, gains, plus_minus, summary
from crashfuse.study.planning import NextTest, Sweep
from crashfuse.study.study import Study
from crashfuse.units import KN, MPH, MPH_LB, MS, G, UnitSystem, number, signed

_FOLDS = ("others", "apart")  # in names of columns: as most tests at about the speed fold, and as one that stands apart
_MetricRows = Iterable[tuple[object, str, Sequence[Metric]]]


def scores_table(study: Study) -> pd.DataFrame:
    """One row per held-out test, approach and window: overall rating, its four parts, its grade, what it rests on."""
    basis, to_ttzv = study.campaign.rating_basis, study.config.to_ttzv
    return pd.DataFrame(
        {"held_out": fold.held_out, "approach": approach, "window_ms": window, **asdict(rating), "basis": basis}
        | ({"ttzv_ms": fold.ttzv_ms, "overall_to_ttzv": fold.overall_to_ttzv(approach)} if to_ttzv else {})
        | fold.further(approach, window, study.config.also)
        for fold in study.folds
        for approach, ratings in fold.ratings.items()
        for window, rating in ratings.items()
    )


def archive_table(record: pd.DataFrame) -> pd.DataFrame:
    """The record of an archive as read: its vehicles, each left out and predicted with the others and without."""
    return pd.DataFrame(
        {
            "Vehicle left out": row["vehicle"],
            "From tests": row["n_tests"],
            "Predictions": row["predicted"],
            "Rating": f"{row['rating']:.3f}",
            "Rating without": f"{row['rating_without']:.3f}",
            "In 95 % intervals (%)": f"{100 * row['inside']:.1f}",
            "In those without (%)": f"{100 * row['inside_without']:.1f}",
            "Width of intervals, without = 1": f"{row['width']:.2f}",
        }
        for row in record.to_dict("records")
    )


def studies_table(studies: Iterable[tuple[str, Study]]) -> pd.DataFrame:
    """One row per study, way of leaving tests out, approach and window: mean and lowest overall rating of its tests."""
    parts = []
    for name, study in studies:
        for one in filter(None, (study, study.speed_groups)):
            config = one.config.split_configs[0]
            table = scores_table(one).groupby(["approach", "window_ms"], sort=False)["overall"]
            rows = table.agg(tests="size", mean="mean", least="min").reset_index()
            about = {"campaign": name, "preset": config.preset, "seed": config.seed, "left_out": config.leave_out}
            about["held_out"] = " ".join(fold.held_out for fold in one.folds)
            parts.append(rows.assign(**about)[[*about, *rows.columns]].assign(basis=one.campaign.rating_basis))
    return pd.concat(parts, ignore_index=True)


def pulses_table(estimates: Iterable[Estimate]) -> pd.DataFrame:
    """Predicted pulses at a new condition in ms and g, with both bands, empty where an approach has none."""
    return _pulses(("", estimate.approach, estimate.prediction) for estimate in estimates)


def study_pulses(study: Study) -> pd.DataFrame:
    """The pulse of every held-out test as measured (``test``) and as predicted, as :func:`pulses_table` has them."""
    rows = []
    for fold in study.folds:
        rows.append((fold.held_out, "test", Prediction(fold.test.condition, fold.test.pulse.accel_mps2)))
        rows += [(fold.held_out, estimate.approach, estimate.prediction) for estimate in fold.estimates]
    return _pulses(rows)


def _pulses(rows: Iterable[tuple[str, str, Prediction]]) -> pd.DataFrame:
    parts = []
    for held_out, approach, prediction in rows:
        none = (np.full(prediction.time_s.size, np.nan),) * 2
        (lower, upper), (whole_lower, whole_upper) = prediction.band() or none, prediction.whole_band() or none
        columns = {
            "held_out": held_out,
            "approach": approach,
            "time_ms": (prediction.time_s / MS).round(6),
            "acceleration_g": prediction.accel_mps2 / G,
            "lower_g": lower / G,
            "upper_g": upper / G,
            "whole_lower_g": whole_lower / G,
            "whole_upper_g": whole_upper / G,
            **{f"{way}_g": accel / G for way, accel in zip(_FOLDS, prediction.folds_mps2, strict=False)},
        }
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def metrics_table(rows: _MetricRows, campaign: Campaign, first: str = "held_out") -> pd.DataFrame:
    """Pulse metrics, one per row, from (held-out test, or what else comes ``first``, approach or ``test``, metrics).

    Where tests fold in two ways, there are columns of both, ``others_…`` and ``apart_…``, and which test is ``apart``.
    """
    bases, ends = campaign.metric_bases, ("value", "lower", "upper")
    table = pd.DataFrame(
        {first: key, "approach": approach, "metric": m.name, **{end: getattr(m, end) for end in ends}}
        | {"unit": m.unit, "basis": bases[m.name]}
        | {f"{way}_{end}": getattr(fold, end) for way, fold in folds.items() for end in ends}
        | ({"apart": [*m.folds][1]} if folds else {})
        | {"of_pulse": m.of_pulse}
        for key, approach, metrics in rows
        for m in metrics
        for folds in [dict(zip(_FOLDS, m.folds.values(), strict=False))]
    )
    table = table[[*table.columns.drop("of_pulse"), "of_pulse"]]
    return table.astype({name: float for name in table if str(name).endswith((*ends, "of_pulse"))})


def metric_texts(
    columns: Iterable[tuple[str, Sequence[Metric]]], campaign: Campaign, display: Display, head: str = "Pulse metric"
) -> pd.DataFrame:
    """Metrics in the reader's units, a column for each whose they are; indexed by their names.

    The last whose tests fold in two ways has columns of both.
    """
    shown = dict(columns)
    for who in [who for who, metrics in shown.items() if any(m.folds for m in metrics)][-1:]:
        for fold in shown[who][0].folds:
            shown[f"{who} if it folds as {fold}"] = [metric.folds[fold] for metric in shown[who]]
    texts = pd.DataFrame({who: {m.name: display.metric(m).text for m in own} for who, own in shown.items()})
    texts.insert(0, head, [display.heading(campaign.metric_headings[name]) for name in texts.index])
    return texts


def study_metrics(study: Study) -> pd.DataFrame:
    """Pulse metrics of every held-out test as measured (``test``) and as predicted."""
    rows: list[tuple[object, str, Sequence[Metric]]] = []
    for fold in study.folds:
        rows.append((fold.held_out, "test", study.campaign.metrics_of(study.campaign.test(fold.held_out))))
        rows += [(fold.held_out, estimate.approach, estimate.metrics) for estimate in fold.estimates]
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


def next_tests_table(ranked: Sequence[NextTest], units: UnitSystem = MPH_LB) -> pd.DataFrame:
    """Ranked tests as a readable table, one row each."""
    speed, weight, band = (units.in_si(unit) for unit in ("mph", "lb", "g"))
    return pd.DataFrame(
        {
            "rank": rank,
            f"speed ({units.speed})": round(test.condition.speed_mps / speed, 1),
            f"front weight ({units.weight})": round(test.condition.front_weight_kg / weight),
            f"rear weight ({units.weight})": round(test.condition.rear_weight_kg / weight),
            **dict(test.condition.factors),
            f"band now (± {units.acceleration})": round(test.before_mps2 / band, 2),
            f"band then (± {units.acceleration})": round(test.after_mps2 / band, 2),
            "gain (%)": round(100 * test.gain, 1),
            "extrapolation": "yes" if test.extrapolation else "no",
        }
        for rank, test in enumerate(ranked, start=1)
    )


def repeat_scores(study: Study) -> pd.DataFrame:
    """What a repeat of each held-out test would rate over each window, with its interval and the actual repeats."""
    return pd.DataFrame(
        [
            (fold.held_out, window, repeat.value, repeat.lower, repeat.upper, " ".join(repeat.repeats))
            for fold in study.folds
            for window, repeat in study.repeatability.get(fold.held_out, {}).items()
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
            "Approach": table["approach"].map(LABELS.__getitem__),
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


def about_table(campaign: Campaign) -> pd.DataFrame:
    """Where tests and CAE runs come from, as far as that is stated; empty if it is not."""
    rows = [(test.id, [test.about]) for test in campaign.tests if test.about]
    rows += [(f"{len(campaign.cae):,} CAE runs", list(campaign.cae.about))] if any(campaign.cae.about) else []
    return pd.DataFrame({"Of": of, **_about_cells(about)} for of, about in rows).fillna("–")


def wall_table(campaign: Campaign) -> pd.DataFrame:
    """The barrier's force beside mass and pulse of each test that has it; empty if none has."""
    beside = [(test, test.wall.beside(test.pulse.accel_mps2)) for test in campaign.tests if test.wall is not None]
    return pd.DataFrame(
        {
            "Test": test.id,
            "Impulse of the barrier (kN s)": number(witness.impulse_ns / KN, ".2f"),
            "Mass × ΔV (kN s)": number(test.condition.mass_kg * witness.change_mps / KN, ".2f"),
            "Ratio": number(witness.share(test.condition.mass_kg), ".3f"),
            "First loaded (ms)": number(witness.begins_s / MS, ".1f"),
            "Deceleration later (ms)": number(witness.lag_s / MS, ".1f"),
        }
        for test, witness in beside
    )


def _about_cells(about: Sequence[About]) -> dict[str, str]:
    counts: dict[str, Counter[str]] = {}
    for name, value in chain.from_iterable(about):
        counts.setdefault(name.removeprefix(ABOUT).replace("_", " ").capitalize(), Counter())[value] += 1
    if len(about) == 1:
        return {name: next(iter(values)) for name, values in counts.items()}
    return {name: listed(f"{v} ({n})" for v, n in values.most_common()) for name, values in counts.items()}


_OF = {
    "energy change": ("energy at the start", "≤"),
    "hourglass energy": ("largest internal energy", "<"),
    "added mass": ("mass at the start", "<"),
}


def quality_table(verdict: QualityVerdict) -> pd.DataFrame:
    """What the solver says of the CAE runs, one row a quantity, as texts; empty if nothing is recorded."""
    judged = verdict.limits is not None
    return pd.DataFrame(
        {
            "Quantity": f"{row['quantity'].capitalize()}, largest",
            "In % of": of,
            "Limit (%)": "none" if pd.isna(row["limit"]) else f"{sign} {100 * row['limit']:g}",
            **({"Pass": f"{row['passed']:,}", "Fail": f"{row['failed']:,}"} if judged else {}),
            "Not recorded": f"{row['not_recorded']:,}",
            "At worst (%)": "–" if pd.isna(row["worst"]) else number(100 * row["worst"], ".3g"),
            "In run": row["worst_run"] or "–",
        }
        for row in verdict.table.to_dict("records")
        for of, sign in [_OF[row["quantity"]]]
    )
