"""Share of verdicts that fewer tests would decide, beside the other measures of a learning curve."""

from dataclasses import replace

import numpy as np

from crashfuse.approaches.metric_calibration import Distribution
from crashfuse.certification.criteria import RATING, Criteria, Criterion
from crashfuse.study.learning_curve import LearningCurve


def with_decided(curve: LearningCurve, criteria: Criteria) -> LearningCurve:
    """Add the column ``decided``: the share of criteria on metrics that each prediction decides for its held-out test.

    A criterion is decided if its probability, or the complement, reaches the confidence; one that the record is too
    short for is not. What a rating would be is not part of a learning curve, so criteria on ratings do not count;
    without any other the column is NaN.
    """
    limits = [criterion for criterion in criteria.items if criterion.metric != RATING]

    def decides(own: Distribution | None, criterion: Criterion) -> bool:
        if own is None:
            return False
        probability = own.probability(criterion.at_least, criterion.at_most)
        return not 1 - criteria.confidence < probability < criteria.confidence

    def share(forecast: dict[str, Distribution | None]) -> float:
        decided = [decides(forecast[criterion.metric], criterion) for criterion in limits]
        return float(np.mean(decided)) if decided else float("nan")

    return replace(curve, table=curve.table.assign(decided=[share(own) for own in curve.forecasts]))
