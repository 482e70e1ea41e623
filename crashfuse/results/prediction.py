"""A prediction as a result, by itself and beside others."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cache, partial
from itertools import chain
from typing import Unpack

import pandas as pd

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.neighbours import nearest_sentences
from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.certification.matrix import Matrix
from crashfuse.condition import Condition
from crashfuse.errors import one_of, require_a, several
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results import figures
from crashfuse.results.campaign import campaign_result
from crashfuse.results.certification_tables import condition_columns, csv_as_given
from crashfuse.results.display import Display, DisplayOptions
from crashfuse.results.drawing import Drawing
from crashfuse.results.export.outgoing_pulses import PulseExport, PulseFiles, PulseFormat
from crashfuse.results.fit_explanations import bias_result, estimates_result
from crashfuse.results.provenance import fit_record, prediction_command, provenance, recommendation_record
from crashfuse.results.render.html import ReportForm
from crashfuse.results.render.text import json_bytes, parquet_bytes
from crashfuse.results.result import Content, Figure, ForReading, Result
from crashfuse.results.result_tables import metrics_shown, of_folds
from crashfuse.results.table import Table
from crashfuse.signals.metrics import Metric
from crashfuse.study.estimate import Estimate
from crashfuse.study.facts import campaign_facts, condition_facts, distinct
from crashfuse.study.prediction import PredictedPulse, by_one
from crashfuse.units import Sentence, UnitSystem, joined, speed

_ABREAST = 2  # predictions beside the first in one table: more would be wider than paper
_WITH_WHOLE_PULSES = ("motion", "acceleration")


def prediction_result(
    prediction: PredictedPulse,
    others: Sequence[PredictedPulse] = (),
    form: ReportForm = "whole",
    export: PulseExport = PulseExport(),
) -> Result:
    """A prediction, its report in one of two forms; ``others`` stand beside it, ``export`` are pulses for programs."""
    require_a(PredictedPulse, prediction, "crashfuse.predict(campaign, condition)")
    is_whole = one_of("form of a report", form, {"whole": True, "short": False})
    campaign, condition, estimates = prediction.campaign, prediction.condition, prediction.estimates
    known = dict.fromkeys(fact.sentence for fact in campaign_facts(campaign))
    here = [fact.sentence for fact in condition_facts(campaign, condition)]
    answer = tuple(dict.fromkeys(s for s in (*prediction.recommendation.sentences, *here) if s not in known))
    together, about = (prediction, *others), estimates_result(campaign, estimates, known=answer)
    more = {"displacement": Figure("Over displacement", _drawn(prediction, "displacement"))}
    near, pulses = tuple(nearest_sentences(campaign, condition)), cache(partial(export.files, campaign, estimates))
    pulses(units=campaign.units)  # that there are so many draws
    return Result(
        kind="prediction",
        template="prediction" if is_whole else "short_prediction",
        title=Sentence("prediction at {}", condition),
        campaign=campaign,
        config=prediction.config,
        command=lambda units: "; ".join(
            prediction_command(own.campaign, own.condition, own.config, units) for own in together
        ),
        answer=answer,
        shown=("metrics",),
        sentences={"nearest": near, "remarks": (*near, *prediction.notes)},
        tables=about.tables,
        figures={"motion": Figure("Pulse over time", _drawn(prediction), is_answer=True)} | (more if is_whole else {}),
        parts={"beside": (_beside_others(together),) if others else ()}
        | {"about": (about,)}
        | ({"data": (campaign_result(campaign),), "bias": (bias_result(campaign),)} if is_whole else {}),
        values={"condition": condition},
        files={
            "pulses.csv": lambda: csv_bytes(prediction.pulses),
            "pulses.parquet": lambda: parquet_bytes(prediction.pulses),
            "metrics.csv": lambda: csv_bytes(prediction.metrics),
            **({"side_by_side.csv": lambda: csv_as_given(predictions_table(together))} if others else {}),
            **{f"{name}/": ForReading(partial(_of_format, pulses, name), campaign.units) for name in export.formats},
            "prediction.json": lambda: json_bytes(prediction_record(prediction)),
        },
    )


def _drawn(prediction: PredictedPulse, figure: str = "motion") -> Callable[[Display], Drawing]:
    return lambda display: prediction.draw(figure, average=False, display=display)


def _of_format(pulses: Callable[..., PulseFiles], name: PulseFormat, units: UnitSystem) -> Content:
    return pulses(units=units)[name]


def _beside_others(predictions: Sequence[PredictedPulse]) -> Result:
    approach = predictions[0].recommendation.approach
    first, *others = by_one(approach, predictions)
    groups = [others[start : start + _ABREAST] for start in range(0, len(others), _ABREAST)]
    return Result(
        kind="prediction",
        title=f"Beside other predictions: {LABELS[approach]}",
        campaign=first.campaign,
        sentences={"cautions": tuple(cautions([first, *others]))},
        tables={str(number): side_by_side([first, *group]) for number, group in enumerate(groups)},
        figures={"motion": Figure("Pulse over time", lambda display: first.draw(also=others, display=display))},
    )


def prediction_record(prediction: PredictedPulse) -> dict[str, object]:
    """``prediction.json``."""
    campaign, condition, recommended = prediction.campaign, prediction.condition, prediction.recommendation
    advice = recommendation_record(recommended)
    expected = advice.pop("expected_rating")
    here = distinct([*condition_facts(campaign, condition), *recommended.facts])
    return {
        **provenance(campaign, (), prediction.config),
        "condition": {k: v for k, v in asdict(condition).items() if k != "units"},
        "extrapolation": list(campaign.cae.extrapolation(condition)),
        "facts_here": [fact.record for fact in here],
        "nearest": list(nearest_sentences(campaign, condition)),
        "recommendation": advice,
        "expected_rating": expected,
        "fits": [fit_record(estimate) for estimate in prediction.estimates],
    }


def prediction_figure(
    prediction: PredictedPulse,
    figure: str,
    approaches: Sequence[str] | None,
    also: Sequence[figures.Further],
    band: str | None,
    representative: bool,
    average: bool,
    **display: Unpack[DisplayOptions],
) -> Drawing:
    """A figure of a prediction, see :meth:`PredictedPulse.plot`."""
    shown = Display.of(prediction.campaign.units, **display)
    estimates = figures.chosen({each.approach: each for each in prediction.estimates}, approaches, band)
    others = [_beside(other, prediction) for other in several(also)]
    further = figures.beside(prediction.campaign, others, shown)
    lead = estimates.get(band or next(iter(by_preference(estimates)), ""))
    if representative and lead is not None and figure in _WITH_WHOLE_PULSES and lead.representative:
        singles: dict[str, Prediction] = figures.single_tests(lead)
        if not average:
            del estimates[lead.approach]
            band = next(iter(singles))
            singles[band] = replace(lead, accel_mps2=singles[band].accel_mps2)  # with its band
            further = {name: _as_single_test(own) for name, own in further.items()}
        further = {**singles, **further}
    else:
        further = {**figures.other_fold(estimates, band), **further}
    drawn = figures.pulse_figures(None, estimates | further, band, shown)
    return one_of("figure of pulses", figure, drawn)()


def _as_single_test(shown: Prediction) -> Prediction:
    if not isinstance(shown, Estimate) or shown.draws_mps2 is None:
        return shown
    return replace(shown, accel_mps2=shown.representative_pulses()[0])


def _beside(other: figures.Further, shown: PredictedPulse) -> figures.Further:
    if not isinstance(other, PredictedPulse) or other.condition != shown.condition:
        return other
    is_other = figures.otherwise(other.config, shown.config)
    return figures.EarlierPrediction(other.preferred, other.config, shown.config) if is_other else other


def side_by_side(predictions: Sequence[PredictedPulse], base: int = 0) -> Table:
    """Main metrics by one approach, in either way to fold: first the ``base``, then all others minus it."""
    shown, names = dict[Sentence, Sequence[Metric]](), column_names(predictions)
    for name, own in sorted(zip(names, predictions, strict=True), key=lambda pair: pair[0] != names[base]):
        metrics = own.preferred.metrics
        folds = {Sentence("{} if it folds as {}", name, to): [m.folds[to] for m in metrics] for to in metrics[0].folds}
        shown |= folds or {name: [*metrics]}
    table, _ = metrics_shown(shown.items(), predictions[0].campaign)
    label, first, *others = table.columns
    minus = [replace(own, kind="difference", source=own.title, further=(first.title,)) for own in others]
    minus = [replace(own, title=Sentence("{} − {}", own.title, first.title)) for own in minus]
    return replace(table, columns=(label, first, *chain.from_iterable(zip(others, minus, strict=True))))


def column_names(predictions: Sequence[PredictedPulse]) -> list[Sentence]:
    """Names of predictions beside each other: conditions, and settings if these are not the first's."""
    names = told_apart([prediction.condition for prediction in predictions])
    settings = [figures.otherwise(prediction.config, predictions[0].config) for prediction in predictions]
    return [joined([*filter(None, pair)], ", ") for pair in zip(names, settings, strict=True)]


def told_apart(conditions: Sequence[Condition]) -> list[Sentence]:
    """Conditions in as few words as tell them apart."""
    besides = [{(name, str(value)): value for name, value in one.besides_speed.items()} for one in conditions]
    shared = besides[0].keys() & set.intersection(*map(set, besides))
    return [
        joined([speed(condition.speed_mps), *(value for key, value in own.items() if key not in shared)], ", ")
        for condition, own in zip(conditions, besides, strict=True)
    ]


def cautions(predictions: Sequence[PredictedPulse]) -> list[Sentence]:
    """At which conditions after the first a prediction is an extrapolation."""
    first, *others = predictions
    return [
        Sentence("{}: {}", name, note)
        for name, prediction in zip(column_names(predictions)[1:], others, strict=True)
        for note in prediction.campaign.cae.extrapolation(prediction.condition)
        if prediction.condition != first.condition
    ]


def predictions_table(predictions: Sequence[PredictedPulse]) -> pd.DataFrame:
    """One row per prediction, approach and metric, with its difference from the first; for files."""
    first = {(own.approach, m.name): m.value for own in predictions[0].estimates for m in own.metrics}
    ids = tuple(str(number) for number, _ in enumerate(predictions, start=1))
    conditions = condition_columns(Matrix(ids, tuple(prediction.condition for prediction in predictions)))
    return pd.DataFrame(
        {
            **columns,
            "preset": prediction.config.preset,
            "seed": prediction.config.seed,
            "approach": estimate.approach,
            "metric": m.name,
            **{name: getattr(m, name) for name in ("value", "lower", "upper", "unit")},
            "difference": None if m.value is None or base is None else m.value - base,
            **of_folds(m),
        }
        for columns, prediction in zip(conditions.values(), predictions, strict=True)
        for estimate in prediction.estimates
        for m in estimate.metrics
        for base in [first.get((estimate.approach, m.name))]
    )
