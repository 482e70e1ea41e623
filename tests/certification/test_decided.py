"""The share of verdicts that fewer tests would decide, from the forecasts of a learning curve."""

import numpy as np
import pandas as pd
import pytest

from crashfuse.approaches.metric_calibration import Distribution
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.decided import with_decided
from crashfuse.reporting.result_tables import curve_table
from crashfuse.study.config import StudyConfig
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import sentences, summary

CRUSH, PEAK = Criterion("crush", "max_crush", at_most=500.0), Criterion("peak", "peak", at_least=30.0)
RATING = Criterion("rating", "rating", at_least=0.8, window_ms=60.0)
SURE, UNSURE = Distribution(400.0, 10.0, 9.0), Distribution(495.0, 10.0, 9.0)


@pytest.fixture
def curve(campaign: Campaign) -> LearningCurve:
    """Two numbers of tests, two held-out tests each; with more tests the crush is better known."""
    row = {"chosen": "", "choice": "even", "approach": "fused", "window_ms": 60.0, "overall": 0.9, "inside": 0.9}
    rows = [{**row, "n_tests": n, "held_out": f"T{i}", "half_width_g": 2.0} for n in (2, 3) for i in (1, 2)]
    peak = Distribution(20.0, 1.0, 9.0)
    crushes = (UNSURE, None, SURE, UNSURE)
    forecasts = tuple({"max_crush": own, "peak": peak} for own in crushes)
    config = StudyConfig(approaches=("fused",), windows_ms=(60.0,))
    return LearningCurve(campaign, config, 0, pd.DataFrame(rows), forecasts, 1.0)


def test_a_verdict_counts_as_decided_by_its_probability(curve: LearningCurve) -> None:
    """The peak is missed for certain; the crush is decided once; what is not known is not decided."""
    found = with_decided(curve, Criteria((CRUSH, PEAK, RATING)))
    assert found.table["decided"].tolist() == [0.5, 0.5, 1.0, 0.5]
    assert summary(found)["decided"].tolist() == [0.5, 0.75]
    assert curve_table(found)["Decided (%)"].tolist() == ["50", "75"]
    assert "It decides 75 % of the verdicts on metrics, counted over these tests." in sentences(found)[0]


def test_a_lower_confidence_decides_more(curve: LearningCurve) -> None:
    """At 0.6 five tenths of a standard deviation are enough."""
    assert with_decided(curve, Criteria((CRUSH,), 0.6)).table["decided"].tolist() == [1.0, 0.0, 1.0, 1.0]


def test_ratings_alone_decide_nothing(curve: LearningCurve) -> None:
    """The column is empty then, and no sentence tells of it."""
    found = with_decided(curve, Criteria((RATING,)))
    assert np.isnan(found.table["decided"]).all()
    assert "decides" not in " ".join(sentences(found))
    assert "decided" not in curve.table
