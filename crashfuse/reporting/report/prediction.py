"""Report of a prediction at a condition that was never tested."""

from collections.abc import Sequence

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.displacement import over_displacement
from crashfuse.reporting.plots.pulses import motion
from crashfuse.reporting.provenance import prediction_command, provenance
from crashfuse.reporting.report.page import figure, page, paragraphs, section
from crashfuse.reporting.report.sections import (
    OVER_DISPLACEMENT,
    bias,
    data,
    fits,
    limits,
    method,
    metrics,
    notes,
    origin,
)
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.nearest import nearest_sentences
from crashfuse.study.recommendation import recommend_for

_UNRATED = (
    "Nothing was measured at this condition, so nothing can be rated here: what may be expected is known from tests "
    "that were left out. A study of the same campaign shows each of them."
)


def prediction_report(campaign: Campaign, estimates: Sequence[Estimate], config: StudyConfig) -> str:
    """Report of a prediction as one HTML page.

    Parameters
    ----------
    campaign : Campaign
        What was learned from.
    estimates : sequence of Estimate
        One for each approach, at one condition.
    config : StudyConfig
    """
    condition = estimates[0].prediction.condition
    predictions = {estimate.approach: estimate.prediction for estimate in estimates}
    advice = recommend_for(estimates, campaign, condition)
    parts = [
        f"<div class=verdict>{paragraphs(advice.sentences)}</div>",
        section(
            f"Prediction at {condition}",
            paragraphs([_UNRATED, *nearest_sentences(campaign, condition)]),
            figure(motion(None, predictions, speed_mps=condition.speed_mps)),
            OVER_DISPLACEMENT,
            figure(over_displacement(None, predictions, speed_mps=condition.speed_mps)),
            metrics([(LABELS[estimate.approach], estimate.metrics) for estimate in estimates]),
            notes(estimates),
            fits(estimates),
        ),
        data(campaign),
        bias(campaign),
        method(config),
        limits(campaign),
        origin(provenance(campaign, (), config), prediction_command(condition, config)),
    ]
    return page(f"{campaign.name}: prediction at {condition}", campaign, parts)
