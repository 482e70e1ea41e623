"""Recommendations follow from left-out tests, and say so."""

from dataclasses import replace

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign, CrashTest
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.fold import Fold
from crashfuse.study.recommendation import recommend, recommend_for
from crashfuse.study.study import Study


def estimate(approach: str, campaign: Campaign, test: CrashTest, scale: float, spread: float = 0.0) -> Estimate:
    """An approach that is always off by a factor, with a band of a relative width."""
    accel = scale * test.pulse.accel_mps2
    draws = None if spread == 0 else accel * (1 + spread * np.linspace(-1, 1, 41)[:, None])
    left_out: dict[str, FloatArray] = {other.id: scale * other.pulse.accel_mps2 for other in campaign.tests}
    notes = ("Nearest test 1.0 mph away: weights.",) if approach == "fused" else ()
    return Estimate(approach, Prediction(test.condition, accel, draws, notes), {}, 0.0, left_out)


def study(campaign: Campaign, scales: dict[str, float]) -> Study:
    """A study in which each approach is off by its factor in every test."""
    config = StudyConfig(approaches=tuple(scales))
    folds = []
    for number, test in enumerate(campaign.tests):
        own = [
            estimate(name, campaign, test, scale + 0.001 * number, 0.0 if name == "cae" else 0.05)
            for name, scale in scales.items()
        ]
        folds.append(Fold.of(test, own, config.windows_ms))
    return Study(campaign, config, tuple(folds))


def test_what_predicted_near_tests_best_is_recommended(campaign: Campaign) -> None:
    """The time domain was nearly right, the others were not."""
    rest, test = campaign.without(["T2"]), campaign.test("T2")
    scales = {"cae": 0.5, "time_domain": 0.99, "displacement_domain": 0.8}
    found = recommend_for([estimate(name, rest, test, s) for name, s in scales.items()], rest, test.condition)
    assert found.approach == "time_domain"
    assert "The raw CAE model rated" in " ".join(found.sentences)


def test_between_equals_the_mixture_is_recommended_and_gives_its_reason(campaign: Campaign) -> None:
    """A hundredth of the rating is no difference."""
    rest, test = campaign.without(["T2"]), campaign.test("T2")
    scales = {"cae": 0.5, "time_domain": 1.0, "displacement_domain": 1.0, "fused": 0.999}
    found = recommend_for([estimate(name, rest, test, s) for name, s in scales.items()], rest, test.condition)
    assert found.approach == "fused"
    assert "Nearest test 1.0 mph away: weights." in found.sentences


def test_where_nothing_beats_the_raw_model_that_is_recommended(campaign: Campaign) -> None:
    """A correction that spoils tests it has not seen is not to be used."""
    rest, test = campaign.without(["T2"]), campaign.test("T2")
    found = recommend_for(
        [estimate("cae", rest, test, 0.9), estimate("displacement_domain", rest, test, 0.4)], rest, test.condition
    )
    assert found.approach == "cae"


@pytest.mark.parametrize(("held_out", "approach"), [("T2", "time_domain"), ("T4", "displacement_domain")])
def test_without_left_out_tests_the_papers_advice_is_given(campaign: Campaign, held_out: str, approach: str) -> None:
    """T2 has a neighbour 1 mph away, T4 none within 3 mph (Sect. 4.3)."""
    rest, test = campaign.without([held_out]), campaign.test(held_out)
    both = [
        replace(estimate(name, rest, test, 1.0), left_out_mps2={}) for name in ("time_domain", "displacement_domain")
    ]
    found = recommend_for(both, rest, test.condition)
    assert found.approach == approach
    assert "Sect. 4.3" in found.sentences[0]
    assert found.expected is None


def test_a_campaign_gets_the_approach_with_the_least_crps(campaign: Campaign) -> None:
    """Nearly right with a narrow band is nearer to what was measured than any other."""
    found = recommend(study(campaign, {"cae": 0.6, "time_domain": 0.8, "displacement_domain": 0.97}))
    assert found.approach == "displacement_domain"
    assert "on 4 tests that were left out" in found.sentences[0]
    assert "better in no test" in found.sentences[1]
    assert "maximum crush in" in found.sentences[2]


def test_harm_against_the_raw_model_is_named_with_its_test(campaign: Campaign) -> None:
    """Whoever recommends must say where it was worse."""
    spoiled = study(campaign, {"cae": 0.9, "displacement_domain": 0.97})
    first = campaign.tests[0]
    bad = Fold.of(
        first,
        [estimate("cae", campaign, first, 0.99), estimate("displacement_domain", campaign, first, 0.7, 0.05)],
        spoiled.config.windows_ms,
    )
    text = " ".join(recommend(replace(spoiled, folds=(bad, *spoiled.folds[1:]))).sentences)
    harm = bad.ratings["cae"][60.0].overall - bad.ratings["displacement_domain"][60.0].overall
    assert f"better than this in T1 (by up to {harm:.3f})" in text


def test_equal_approaches_are_said_to_be_equal(campaign: Campaign) -> None:
    """Of two that tests can't tell apart the mixture is taken, and the other named."""
    found = recommend(study(campaign, {"cae": 0.6, "displacement_domain": 0.97, "fused": 0.97}))
    assert found.approach == "fused"
    assert "These tests can't tell it from the displacement domain." in found.sentences


def test_of_a_single_test_no_rating_is_expected(campaign: Campaign) -> None:
    """Nothing was left out, so nothing is known: the paper's advice decides, and a mixture is not taken."""
    single, other = campaign.without(["T1", "T2", "T3"]), campaign.test("T1")
    estimates = [estimate(name, single, other, 0.9, 0.05) for name in ("fused", "displacement_domain", "time_domain")]
    found = recommend_for(estimates, single, other.condition)
    assert (found.approach, found.expected) == ("displacement_domain", None)
    assert "only one test, which cannot be left out" in " ".join(found.sentences)
    beside = recommend_for(estimates, single, single.tests[0].condition)
    assert beside.approach == "time_domain"
