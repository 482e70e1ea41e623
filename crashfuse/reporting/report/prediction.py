"""Report of a prediction at a condition that was never tested."""

from collections.abc import Sequence

from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.displacement import over_displacement
from crashfuse.reporting.plots.pulses import motion
from crashfuse.reporting.provenance import prediction_command
from crashfuse.reporting.report.page import render
from crashfuse.reporting.report.sections import bias, details
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.nearest import nearest_sentences
from crashfuse.study.recommendation import recommend_for


def prediction_report(campaign: Campaign, estimates: Sequence[Estimate], config: StudyConfig) -> str:
    """Report of a prediction as one HTML page, from one estimate for each approach at one condition."""
    condition = estimates[0].prediction.condition
    predictions = {estimate.approach: estimate.prediction for estimate in estimates}
    return render(
        "prediction",
        f"prediction at {condition}",
        campaign,
        config,
        prediction_command(condition, config),
        condition=condition,
        verdict=recommend_for(estimates, campaign, condition).sentences,
        nearest=nearest_sentences(campaign, condition),
        motion=motion(None, predictions, condition.speed_mps),
        over_displacement=over_displacement(None, predictions, condition.speed_mps),
        about=details(estimates),
        bias=bias(campaign),
    )
