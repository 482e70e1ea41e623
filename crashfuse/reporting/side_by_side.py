"""Predictions at several conditions, or with other settings, beside each other: how their metrics differ."""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd

from crashfuse.certification.matrix import Matrix
from crashfuse.reporting.certification_tables import condition_columns, factors_of
from crashfuse.reporting.figures import otherwise
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.signals.metrics import MAIN_METRICS
from crashfuse.wording import Sentence, difference


def by_one(approach: str, predictions: Sequence[PredictedPulse]) -> list[PredictedPulse]:
    """What one approach predicts in each of several predictions."""
    return [
        replace(prediction, estimates=tuple(own for own in prediction.estimates if own.approach == approach))
        for prediction in predictions
    ]


def side_by_side(predictions: Sequence[PredictedPulse], display: Display = DEFAULT, base: int = 0) -> pd.DataFrame:
    """Main metrics by one approach, for readers: first the ``base``, then each other with its differences from it."""
    labels = predictions[0].campaign.metric_headings
    columns = [{m.name: display.metric(m) for m in prediction.estimate.metrics} for prediction in predictions]
    others = list(zip(column_names(predictions, display), columns, strict=True))
    first, subtracted = others.pop(base)
    table = {
        "Pulse metric": [display.heading(labels[name]) for name in MAIN_METRICS],
        first: [subtracted[name].text for name in MAIN_METRICS],
    }
    for who, metrics in others:
        table[who] = [metrics[name].text for name in MAIN_METRICS]
        pairs = [(metrics[name], subtracted[name].value) for name in MAIN_METRICS]
        table[f"{who} − {first}"] = [
            "–" if m.value is None or base is None else difference(m.value, base, m.digits) for m, base in pairs
        ]
    return pd.DataFrame(table)


def column_names(predictions: Sequence[PredictedPulse], display: Display) -> list[str]:
    """Names of predictions beside each other: their conditions, and their settings if these are not the first's."""
    names = display.apart([prediction.condition for prediction in predictions])
    settings = [otherwise(prediction.config, predictions[0].config) for prediction in predictions]
    return [", ".join(filter(None, pair)) for pair in zip(names, settings, strict=True)]


def cautions(predictions: Sequence[PredictedPulse], display: Display = DEFAULT) -> list[str]:
    """At which conditions after the first a prediction is an extrapolation."""
    first, *others = predictions
    return [
        Sentence("{}: {}", name, note)
        for name, prediction in zip(column_names(predictions, display)[1:], others, strict=True)
        for note in prediction.campaign.cae.extrapolation(prediction.condition)
        if prediction.condition != first.condition
    ]


def predictions_table(predictions: Sequence[PredictedPulse]) -> pd.DataFrame:
    """One row per prediction, approach and metric, with its difference from that of the first; for files."""
    first = {(own.approach, m.name): m.value for own in predictions[0].estimates for m in own.metrics}
    conditions = tuple(prediction.condition for prediction in predictions)
    ids = tuple(str(number) for number, _ in enumerate(conditions, start=1))
    factors = factors_of(Matrix(ids, conditions))
    return pd.DataFrame(
        {
            **condition_columns(number, condition, factors, conditions[0]),
            "preset": prediction.config.preset,
            "seed": prediction.config.seed,
            "approach": estimate.approach,
            "metric": m.name,
            **{name: getattr(m, name) for name in ("value", "lower", "upper", "unit")},
            "difference": None if m.value is None or base is None else m.value - base,
        }
        for number, condition, prediction in zip(ids, conditions, predictions, strict=True)
        for estimate in prediction.estimates
        for m in estimate.metrics
        for base in [first.get((estimate.approach, m.name))]
    )
