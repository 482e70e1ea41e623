"""A prediction with other settings beside those of a study: named by what differs, and drawn as it was predicted."""

from dataclasses import replace

import pytest

from crashfuse.campaign import Campaign
from crashfuse.reporting.figures import EarlierPrediction
from crashfuse.reporting.plots.display import Display
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.study import Fold, Study
from crashfuse.units import G
from tests.reporting.conftest import with_and_without_band

SHOWN = StudyConfig(approaches=("cae", "fused"))


@pytest.fixture
def earlier(campaign: Campaign) -> EarlierPrediction:
    """Half the paired CAE run, by seed 1."""
    whole = with_and_without_band(campaign, campaign.test("T2"), "fused")["cae"]
    estimate = Estimate("fused", replace(whole, accel_mps2=whole.accel_mps2 / 2), {}, 0.0)
    return EarlierPrediction(estimate, replace(SHOWN, seed=1), SHOWN)


@pytest.mark.parametrize(
    ("config", "shown", "text"),
    [
        (replace(SHOWN, seed=1), SHOWN, "seed 1"),
        (SHOWN, replace(SHOWN, seed=1), "seed 0"),
        (replace(SHOWN, preset="paper", seed=7), SHOWN, "paper settings, seed 7"),
        (replace(SHOWN, leave_out="speed group"), SHOWN, "all at its speed left out"),
        (SHOWN, replace(SHOWN, preset="paper", leave_out="speed group"), "fast settings, left out alone"),
    ],
)
def test_it_is_named_by_what_differs(
    earlier: EarlierPrediction, config: StudyConfig, shown: StudyConfig, text: str
) -> None:
    """Seen from the other side, by what it has instead."""
    own = replace(earlier, config=config, shown=shown)
    assert own.text == text
    assert own.curve(Display())[0] == f"Fused, {text}"


def test_it_stands_beside_that_of_the_study(campaign: Campaign, earlier: EarlierPrediction) -> None:
    """Of the same approach, with a curve of its own."""
    test = campaign.test("T2")
    predictions = with_and_without_band(campaign, test, "fused")
    own = [Estimate(name, prediction, {}, 0.0) for name, prediction in predictions.items()]
    study = Study(campaign, SHOWN, (Fold.of(test, own, SHOWN.windows_ms),))
    drawn = study.plot("T2", "acceleration", approaches=["fused"], also=[earlier])
    shown = {name: trace.y for trace in drawn.data if (name := trace.name) and trace.line.width != 0}
    assert shown["Fused"] == pytest.approx(predictions["fused"].accel_mps2 / G)
    assert shown["Fused, seed 1"] == pytest.approx(predictions["fused"].accel_mps2 / 2 / G)
