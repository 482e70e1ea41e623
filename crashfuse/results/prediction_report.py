"""Reports on untested conditions: a prediction, a sweep over speed, a ranking of the tests to run next."""

from collections.abc import Sequence
from typing import Any

from crashfuse.approaches.neighbours import nearest_sentences
from crashfuse.approaches.registry import LABELS
from crashfuse.errors import one_of, require_a
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.predicted import cautions, side_by_side
from crashfuse.results.provenance import prediction_command
from crashfuse.results.render.figure_files import Report
from crashfuse.results.render.html import ReportForm, details, render
from crashfuse.study.prediction import PredictedPulse, by_one

_SHOWN = 20
_ABREAST = 2  # predictions beside the first in one table: more would be wider than paper

NEXT_TEST_MEANING = "How a test narrows the band of the bias (RMS) follows from where it is, not from what it measures."


def prediction_report(
    prediction: PredictedPulse,
    display: Display = DEFAULT,
    beside: Sequence[PredictedPulse] = (),
    form: ReportForm = "whole",
) -> Report:
    """HTML report of a prediction; others by the same approaches ``beside`` it."""
    require_a(PredictedPulse, prediction, "crashfuse.predict(campaign, condition)")
    campaign, condition, advice = prediction.campaign, prediction.condition, prediction.recommendation
    whole = one_of("form of a report", form, {"whole": True, "short": False})
    commands = [
        prediction_command(own.campaign, own.condition, own.config, display.system) for own in (prediction, *beside)
    ]
    learned: dict[str, Any] = {"bias": campaign.draw("bias", display=display)} if whole else {}
    return render(
        "prediction" if whole else "short_prediction",
        f"prediction at {display.condition(condition)}",
        campaign,
        prediction.config,
        "; ".join(commands),
        display,
        condition=condition,
        verdict=advice.sentences,
        nearest=nearest_sentences(campaign, condition),
        motion=prediction.draw(display=display),
        over_displacement=prediction.draw("displacement", display=display),
        beside=beside and _beside([prediction, *beside], advice.approach, display),
        about=details(campaign, prediction.estimates, said=advice.sentences),
        **learned,
    )


def _beside(predictions: Sequence[PredictedPulse], approach: str, display: Display) -> dict[str, object]:
    first, *others = by_one(approach, predictions)
    return {
        "approach": LABELS[approach],
        "motion": first.draw(also=others, display=display),  # in the colours of the page
        "metrics": [
            side_by_side([first, *others[start : start + _ABREAST]], display)
            for start in range(0, len(others), _ABREAST)
        ],
        "cautions": cautions([first, *others], display),
    }
