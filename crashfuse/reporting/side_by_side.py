"""Predictions at several conditions, or with other settings, beside each other: how their metrics differ."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd

from crashfuse.certification.matrix import Matrix
from crashfuse.reporting.certification_tables import condition_columns, factors_of
from crashfuse.reporting.earlier_prediction import otherwise
from crashfuse.reporting.fit_explanations import missing_by_table
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.signals.metrics import MAIN_METRICS, Metric
from crashfuse.wording import Sentence, difference


def by_one(approach: str, predictions: Sequence[PredictedPulse]) -> list[PredictedPulse]:
    """What one approach predicts in each of several predictions."""
    return [
        replace(own, estimates=tuple(each for each in own.estimates if each.approach == approach))
        for own in predictions
    ]


def side_by_side(predictions: Sequence[PredictedPulse], display: Display = DEFAULT) -> pd.DataFrame:
    """Main metrics as a table for readers: each column after the first is followed by its differences from the first.

    The predictions are by one approach, and the columns are named after their conditions, and by their settings if
    these are not the first's.
    """
    campaign = predictions[0].campaign
    headings = {name: display.heading(campaign.metric_headings[name]) for name in MAIN_METRICS}
    own = [
        (who, {metric.name: display.metric(metric) for metric in metrics})
        for who, metrics in _columns(predictions, display)
    ]
    (first, base), *others = own
    table = {"Pulse metric": list(headings.values()), first: [base[name].text for name in headings]}
    for who, metrics in others:
        table[who] = [metrics[name].text for name in headings]
        table[f"Difference, {who}"] = [_difference(metrics[name], base[name]) for name in headings]
    return pd.DataFrame(table)


def cautions(predictions: Sequence[PredictedPulse], display: Display = DEFAULT) -> list[str]:
    """What has to be known of the columns after the first: where a condition is an extrapolation, what is missing."""
    columns, (first, *others) = _columns(predictions, display)[1:], predictions
    outside = [
        Sentence("{}: {}", name, note)
        for (name, _), own in zip(columns, others, strict=True)
        for note in own.campaign.cae.extrapolation(own.condition)
        if own.condition != first.condition
    ]
    return [*outside, *missing_by_table(columns)[0]]


def predictions_table(predictions: Sequence[PredictedPulse]) -> pd.DataFrame:
    """One row per prediction, approach and metric, with its difference from that of the first; for files.

    Predictions are numbered, and their conditions in the columns of ``matrix.csv``.
    """
    first = _values(predictions[0])
    conditions = [own.condition for own in predictions]
    matrix = Matrix(tuple(str(number + 1) for number in range(len(conditions))), tuple(conditions))
    factors = factors_of(matrix)
    return pd.DataFrame(
        {
            **condition_columns(number, condition, factors, conditions[0]),
            "preset": own.config.preset,
            "seed": own.config.seed,
            "approach": estimate.approach,
            "metric": m.name,
            "value": m.value,
            "lower": m.lower,
            "upper": m.upper,
            "unit": m.unit,
            "difference": _minus(m.value, first.get((estimate.approach, m.name))),
        }
        for (number, condition), own in zip(matrix.items, predictions, strict=True)
        for estimate in own.estimates
        for m in estimate.metrics
    )


def _columns(predictions: Sequence[PredictedPulse], display: Display) -> list[tuple[str, Sequence[Metric]]]:
    names, shown = display.apart([own.condition for own in predictions]), predictions[0].config
    return [
        (", ".join(filter(None, [name, otherwise(own.config, shown)])), own.estimate.metrics)
        for name, own in zip(names, predictions, strict=True)
    ]


def _values(own: PredictedPulse) -> Mapping[tuple[str, str], float | None]:
    return {(estimate.approach, metric.name): metric.value for estimate in own.estimates for metric in estimate.metrics}


def _difference(metric: Metric, base: Metric) -> str:
    if metric.value is None or base.value is None:
        return "–"
    return difference(metric.value, base.value, metric.digits)


def _minus(value: float | None, base: float | None) -> float | None:
    return None if value is None or base is None else value - base
