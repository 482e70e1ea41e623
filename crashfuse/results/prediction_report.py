"""Reports on untested conditions: a prediction, a sweep over speed, a ranking of the tests to run next."""

from collections.abc import Sequence
from typing import Any

from crashfuse.approaches.neighbours import nearest_sentences
from crashfuse.approaches.registry import LABELS
from crashfuse.errors import one_of, require_a
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.predicted import PredictedPulse, by_one, cautions, side_by_side
from crashfuse.results.provenance import learning_curve_command, next_test_command, prediction_command, sweep_command
from crashfuse.results.render.figure_files import Report
from crashfuse.results.render.html import ReportForm, details, render
from crashfuse.results.result_tables import curve_table, gains_table, next_tests_table
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_LABELS
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost, sentences
from crashfuse.study.planning import NextTests, SpeedSweep, weights_sentence

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


def sweep_report(sweep: SpeedSweep, display: Display = DEFAULT) -> Report:
    """HTML report of a sweep over speed, with a figure for each main metric; the others are in ``sweep.csv``."""
    campaign, condition, config = sweep.campaign, sweep.condition, sweep.config
    origin = campaign, config, sweep_command(campaign, condition, sweep.speeds_mps, config, display.system), display
    metrics = [(METRIC_LABELS[name], sweep.draw(name, display=display), sweep.missing(name)) for name in MAIN_METRICS]
    weights = weights_sentence(condition, campaign.tests)
    return render("sweep", "pulse metrics over impact speed", *origin, weights=weights, metrics=metrics)


def next_test_report(ranking: NextTests, display: Display = DEFAULT) -> Report:
    """HTML report of a ranking of next tests."""
    over, config = ranking.over, ranking.config
    origin = ranking.campaign, config, next_test_command(over.low, over.high, config, display.system), display
    return render(
        "next_test",
        "which test next",
        *origin,
        over=over,
        meaning=NEXT_TEST_MEANING,
        drawn=ranking.draw(display=display),
        best=next_tests_table(ranking, _SHOWN),
        ranked=len(ranking.conditions),
    )


LEARNING_CURVE_MEANING = "From parts of the tests, even over speed and at random, all others are predicted and rated."
ONE_MORE_MEANING = "One more test: rating = limit − a / n (least squares); the interval covers exponents from 0.5 to 2."


def learning_curve_report(curve: LearningCurve, cost: Cost | None = None, display: Display = DEFAULT) -> Report:
    """HTML report of a learning curve; with the cost of a test, also what a hundredth of rating costs."""
    command = learning_curve_command(curve.campaign, curve.config, curve.repeats, str(cost or ""), display.system)
    origin = curve.campaign, curve.config, command, display, curve.campaign.test_ids
    return render(
        "learning_curve",
        "how many tests are enough",
        *origin,
        verdict=sentences(curve, cost),
        meaning=LEARNING_CURVE_MEANING,
        law=ONE_MORE_MEANING,
        drawn=curve.draw(display=display),
        steps=gains_table(curve, cost),
        means=curve_table(curve),
    )
