"""Report on a learning curve: how well tests are predicted from fewer of the others, and what one more would buy."""

from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.provenance import learning_curve_command
from crashfuse.reporting.report.page import render
from crashfuse.reporting.result_tables import curve_table, gains_table
from crashfuse.study.cost import Cost
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import sentences

LEARNING_CURVE_MEANING = (
    "Parts of the tests take the place of the campaign in turn, chosen evenly over speed and at random; all other "
    "tests are predicted from each part and rated. Every mean counts each held-out test once."
)
ONE_MORE_MEANING = (
    "Each gain is the mean difference on the same held-out tests, with its standard error; the cost of one hundredth "
    "is given where the gain is above it. One more test is extrapolated by the law: rating = limit − a / n, fitted "
    "to the means by least squares; its interval covers exponents of n from 0.5 to 2."
)


def learning_curve_report(curve: LearningCurve, cost: Cost | None = None, display: Display = DEFAULT) -> str:
    """HTML report of a learning curve; with the cost of a test, also what a hundredth of rating costs."""
    return render(
        "learning_curve",
        "how many tests are enough",
        curve.campaign,
        curve.config,
        learning_curve_command(curve.config, curve.repeats, str(cost or ""), display.system),
        display,
        curve.campaign.test_ids,
        verdict=sentences(curve, cost),
        meaning=LEARNING_CURVE_MEANING,
        law=ONE_MORE_MEANING,
        drawn=curve.plot(display=display),
        steps=gains_table(curve, cost),
        means=curve_table(curve, display),
    )
