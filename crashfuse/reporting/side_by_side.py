"""Predictions at several conditions beside each other: their metrics, and how they differ from the first."""

from collections.abc import Collection, Mapping, Sequence

import pandas as pd

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.reporting.fit_explanations import missing_by_table
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.signals.metrics import METRIC_LABELS, Metric
from crashfuse.study.estimate import Estimate
from crashfuse.wording import Sentence, signed


def side_by_side(
    columns: Sequence[tuple[str, Sequence[Metric]]],
    campaign: Campaign,
    display: Display = DEFAULT,
    names: Collection[str] = METRIC_LABELS,
) -> pd.DataFrame:
    """Metrics as a table for readers: each column after the first is followed by its differences from the first.

    ``names`` are those of the metrics that it holds.
    """
    headings = {name: display.heading(label) for name, label in campaign.metric_headings.items() if name in names}
    own = [(who, {metric.name: display.metric(metric) for metric in metrics}) for who, metrics in columns]
    (first, base), *others = own
    table = {"Pulse metric": list(headings.values()), first: [base[name].text for name in headings]}
    for who, metrics in others:
        table[who] = [metrics[name].text for name in headings]
        table[f"Difference, {who}"] = [_difference(metrics[name], base[name]) for name in headings]
    return pd.DataFrame(table)


def cautions(
    columns: Sequence[tuple[str, Sequence[Metric]]], conditions: Sequence[Condition], campaign: Campaign
) -> list[str]:
    """What has to be known of the columns after the first: where a condition is an extrapolation, what is missing."""
    outside = [
        Sentence("{}: {}", name, note)
        for (name, _), condition in zip(columns[1:], conditions[1:], strict=True)
        for note in campaign.cae.extrapolation(condition)
    ]
    return [*outside, *missing_by_table(columns[1:])[0]]


def conditions_table(answers: Sequence[Sequence[Estimate]]) -> pd.DataFrame:
    """One row per condition, approach and metric, with its difference from the first condition's; for files."""
    first = _values(answers[0])
    rows = [
        (estimate.prediction.condition.text, estimate.approach, m.name, m.value, m.lower, m.upper, m.unit,
         _minus(m.value, first.get((estimate.approach, m.name))))
        for estimates in answers
        for estimate in estimates
        for m in estimate.metrics
    ]  # fmt: skip
    names = ["condition", "approach", "metric", "value", "lower", "upper", "unit", "difference"]
    return pd.DataFrame(rows, columns=names)


def _values(estimates: Sequence[Estimate]) -> Mapping[tuple[str, str], float | None]:
    return {(estimate.approach, metric.name): metric.value for estimate in estimates for metric in estimate.metrics}


def _difference(metric: Metric, base: Metric) -> str:
    gap = _minus(metric.value, base.value)
    return "–" if gap is None else signed(gap, metric.digits)


def _minus(value: float | None, base: float | None) -> float | None:
    return None if value is None or base is None else value - base
