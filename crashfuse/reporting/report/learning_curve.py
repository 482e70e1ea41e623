"""Report on a learning curve: how well tests are predicted from fewer of the others, and what one more would buy."""

from crashfuse.reporting.plots.number_of_tests import over_number_of_tests
from crashfuse.reporting.provenance import learning_curve_command
from crashfuse.reporting.report.page import render
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import Cost, sentences, steps_table, summary_table

LEARNING_CURVE_MEANING = (
    "Parts of the tests take the place of the campaign in turn, chosen evenly over speed and at random; all other "
    "tests are predicted from each part and rated. Every mean counts each held-out test once."
)
ONE_MORE_MEANING = (
    "One more test is extrapolated by the law: rating = limit − a / n^0.7, fitted to the means by least squares; its "
    "interval spans those with the exponents 0.4 and 1.2. It holds for a test chosen like these, and for vehicles and "
    "conditions like these."
)


def learning_curve_report(curve: LearningCurve, cost: Cost | None = None) -> str:
    """HTML report of a learning curve; with the cost of a test, also what a hundredth of rating costs."""
    return render(
        "learning_curve",
        "how many tests are enough",
        curve.campaign,
        curve.config,
        learning_curve_command(curve.config, curve.repeats, str(cost or "")),
        curve.campaign.test_ids,
        verdict=sentences(curve, cost),
        meaning=LEARNING_CURVE_MEANING,
        law=ONE_MORE_MEANING,
        drawn=over_number_of_tests(curve),
        steps=steps_table(curve, cost),
        means=summary_table(curve),
    )
