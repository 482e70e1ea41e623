"""Predictions as shown: their figure, their card in a notebook, and several of them side by side."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import Unpack

import pandas as pd

from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.certification.matrix import Matrix
from crashfuse.errors import several
from crashfuse.results import figures
from crashfuse.results.certification_tables import condition_columns, factors_of
from crashfuse.results.display import DEFAULT, Display, DisplayOptions
from crashfuse.results.drawing import Drawing
from crashfuse.results.render.notebook import card
from crashfuse.results.result_tables import metrics_shown
from crashfuse.results.table import Table
from crashfuse.study.prediction import PredictedPulse
from crashfuse.units import Sentence

_WITH_WHOLE_PULSES = ("motion", "acceleration")


def prediction_figure(
    prediction: PredictedPulse,
    figure: str,
    approaches: Sequence[str] | None,
    also: Sequence[figures.Further],
    band: str | None,
    representative: bool,
    **display: Unpack[DisplayOptions],
) -> Drawing:
    """A figure of a prediction, see :meth:`PredictedPulse.plot`."""
    shown = Display.of(prediction.campaign.units, **display)
    estimates = figures.chosen({each.approach: each for each in prediction.estimates}, approaches, band)
    others = [_beside(other, prediction) for other in several(also)]
    further = {**figures.other_fold(estimates, band), **figures.beside(prediction.campaign, others, shown)}
    lead = estimates.get(band or next(iter(by_preference(estimates)), ""))
    if representative and lead is not None and figure in _WITH_WHOLE_PULSES:
        further = {**lead.representative, **further}
    return figures.Curves(None, estimates | further, band).draw(figure, shown)


def _beside(other: figures.Further, shown: PredictedPulse) -> figures.Further:
    """What stands in a figure of a prediction; another one at the same condition is named by its settings."""
    if not isinstance(other, PredictedPulse) or other.condition != shown.condition:
        return other
    is_other = figures.otherwise(other.config, shown.config)
    return figures.EarlierPrediction(other.preferred, other.config, shown.config) if is_other else other


def prediction_html(prediction: PredictedPulse) -> str:
    """A prediction in a notebook."""
    display = Display(system=prediction.campaign.units)
    columns = [(LABELS[estimate.approach], estimate.metrics) for estimate in prediction.estimates]
    table, _ = metrics_shown(columns, prediction.campaign, "Metric")
    notes = ("In brackets: the 95 % interval of a single test.", *map(display.words, prediction.sentences))
    return card(f"The pulse at {display.condition(prediction.condition)}", table, notes, display)


def side_by_side(predictions: Sequence[PredictedPulse], display: Display = DEFAULT, base: int = 0) -> Table:
    """Main metrics by one approach, for readers: first the ``base``, then each other with its differences from it."""
    metrics = [[replace(metric, folds={}) for metric in own.preferred.metrics] for own in predictions]
    shown = list(zip(column_names(predictions, display), metrics, strict=True))
    shown.insert(0, shown.pop(base))
    table, _ = metrics_shown(shown, predictions[0].campaign)
    label, first, *others = table.columns
    minus = [
        replace(own, title=f"{own.title} − {first.title}", kind="difference", source=own.title, further=(first.title,))
        for own in others
    ]
    return replace(table, columns=(label, first, *chain.from_iterable(zip(others, minus, strict=True))))


def column_names(predictions: Sequence[PredictedPulse], display: Display) -> list[str]:
    """Names of predictions beside each other: their conditions, and their settings if these are not the first's."""
    names = display.apart([prediction.condition for prediction in predictions])
    settings = [figures.otherwise(prediction.config, predictions[0].config) for prediction in predictions]
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
    """One row per prediction, approach and metric, with its difference from the first; for files."""
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
