"""Predictions at several conditions beside each other: their metrics, and how they differ from the first."""

from collections.abc import Mapping, Sequence

import pandas as pd

from crashfuse.campaign import Campaign
from crashfuse.certification.matrix import Matrix
from crashfuse.reporting.certification_tables import condition_columns, factors_of
from crashfuse.reporting.fit_explanations import missing_by_table
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.signals.metrics import MAIN_METRICS, Metric
from crashfuse.study.estimate import Estimate
from crashfuse.wording import Sentence, signed


def by_one(approach: str, answers: Sequence[Sequence[Estimate]]) -> list[Estimate]:
    """What one approach estimates at each of several conditions."""
    return [next(each for each in estimates if each.approach == approach) for estimates in answers]


def side_by_side(estimates: Sequence[Estimate], campaign: Campaign, display: Display = DEFAULT) -> pd.DataFrame:
    """Main metrics as a table for readers: each column after the first is followed by its differences from the first.

    The estimates are by one approach, and the columns are named after their conditions.
    """
    headings = {name: display.heading(campaign.metric_headings[name]) for name in MAIN_METRICS}
    own = [
        (who, {metric.name: display.metric(metric) for metric in metrics})
        for who, metrics in _columns(estimates, display)
    ]
    (first, base), *others = own
    table = {"Pulse metric": list(headings.values()), first: [base[name].text for name in headings]}
    for who, metrics in others:
        table[who] = [metrics[name].text for name in headings]
        table[f"Difference, {who}"] = [_difference(metrics[name], base[name]) for name in headings]
    return pd.DataFrame(table)


def cautions(estimates: Sequence[Estimate], campaign: Campaign, display: Display = DEFAULT) -> list[str]:
    """What has to be known of the columns after the first: where a condition is an extrapolation, what is missing."""
    columns = _columns(estimates, display)[1:]
    outside = [
        Sentence("{}: {}", name, note)
        for (name, _), estimate in zip(columns, estimates[1:], strict=True)
        for note in campaign.cae.extrapolation(estimate.prediction.condition)
    ]
    return [*outside, *missing_by_table(columns)[0]]


def conditions_table(answers: Sequence[Sequence[Estimate]]) -> pd.DataFrame:
    """One row per condition, approach and metric, with its difference from the first condition's; for files.

    Conditions are numbered, and in the columns of ``matrix.csv``.
    """
    first = _values(answers[0])
    conditions = [estimates[0].prediction.condition for estimates in answers]
    matrix = Matrix(tuple(str(number + 1) for number in range(len(conditions))), tuple(conditions))
    factors = factors_of(matrix)
    return pd.DataFrame(
        {
            **condition_columns(number, condition, factors),
            "approach": estimate.approach,
            "metric": m.name,
            "value": m.value,
            "lower": m.lower,
            "upper": m.upper,
            "unit": m.unit,
            "difference": _minus(m.value, first.get((estimate.approach, m.name))),
        }
        for (number, condition), estimates in zip(matrix.items, answers, strict=True)
        for estimate in estimates
        for m in estimate.metrics
    )


def _columns(estimates: Sequence[Estimate], display: Display) -> list[tuple[str, Sequence[Metric]]]:
    names = display.apart([each.prediction.condition for each in estimates])
    return [(name, each.metrics) for name, each in zip(names, estimates, strict=True)]


def _values(estimates: Sequence[Estimate]) -> Mapping[tuple[str, str], float | None]:
    return {(estimate.approach, metric.name): metric.value for estimate in estimates for metric in estimate.metrics}


def _difference(metric: Metric, base: Metric) -> str:
    gap = _minus(metric.value, base.value)
    return "–" if gap is None else signed(gap, metric.digits)


def _minus(value: float | None, base: float | None) -> float | None:
    return None if value is None or base is None else value - base
