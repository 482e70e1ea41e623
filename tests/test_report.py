"""The report holds the figures it should, and stays light."""

import re

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from crashfuse.approaches import Prediction
from crashfuse.campaign import Campaign, CrashTest
from crashfuse.config import StudyConfig
from crashfuse.estimate import Estimate
from crashfuse.pulse import GRID_S, Pulse
from crashfuse.rating import rate_windows
from crashfuse.report import prediction_report, study_report
from crashfuse.results import metrics_table, scores_table, study_metrics
from crashfuse.study import Fold, Study

RECORD = {"fingerprint": "f", "crashfuse": "0", "python": "3", "platform": "p", "packages": {}, "config": {}}


def estimate(test: CrashTest) -> Estimate:
    """The test itself, with 100 draws around it."""
    accel = test.pulse.accel_mps2
    return Estimate("cae", Prediction(test.condition, accel, np.linspace(0.9, 1.1, 100)[:, None] * accel), {}, 0.1)


@pytest.fixture
def study(campaign: Campaign) -> Study:
    """A study of two tests with one approach."""
    config = StudyConfig(approaches=("cae",))
    folds = []
    for test in campaign.tests[:2]:
        made = estimate(test)
        rating = rate_windows(test.pulse, Pulse(GRID_S, made.prediction.accel_mps2), config.windows_ms)
        folds.append(Fold(test.id, (made,), {"cae": rating}))
    return Study(campaign, config, tuple(folds))


def figures(text: str) -> int:
    """How many figures a report holds."""
    return len(re.findall('class="plotly-graph-div"', text))


def test_a_study_shows_the_bias_by_speed_once_and_every_held_out_test_over_displacement(study: Study) -> None:
    """Ratings, bias, and two figures a test; every test's line is in the bias, held out or not."""
    text = study_report(study, scores_table(study), study_metrics(study), RECORD)
    assert figures(text) == 1 + 1 + 2 * 2
    assert text.count("by speed</h2>") == 1
    assert text.count("The same over displacement") == 2
    assert "T4 \\u00b7 35.0 mph" in text


def test_the_figures_over_displacement_are_light(study: Study) -> None:
    """All but Plotly itself stays below 100 kB a figure."""
    text = study_report(study, scores_table(study), study_metrics(study), RECORD)
    assert len(text) - len(get_plotlyjs()) < 100_000 * figures(text)


def test_a_prediction_is_shown_over_displacement_without_a_test(campaign: Campaign) -> None:
    """Nothing was measured there; the bias of the campaign's tests stands below."""
    text = prediction_report(campaign, [estimate(campaign.tests[0])], metrics_table([]), RECORD)
    assert figures(text) == 3
    assert '"name":"Test"' not in text
    assert "by speed</h2>" in text
