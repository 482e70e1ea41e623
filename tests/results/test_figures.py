"""Figures of studies, campaigns and predictions by name: what they draw, and one sentence for what there is not."""

from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

import crashfuse
from crashfuse import Campaign, Display, Note, PredictedPulse, Study, StudyConfig, UsageError
from crashfuse.condition import Condition
from crashfuse.results.drawing import figure_table
from crashfuse.results.figures import EarlierPrediction
from crashfuse.results.plots import pulses as plots
from crashfuse.results.plots.curves import POINTWISE, WHOLE
from crashfuse.study.estimate import Estimate
from crashfuse.study.study import Fold
from crashfuse.units import G
from tests.conftest import with_pulse
from tests.results.conftest import with_and_without_band

CONFIG = StudyConfig(approaches=("cae", "fused"), windows_ms=(20.0, 40.0))
HERE = Condition.of(speed_mph=30, front_weight_lb=2050, rear_weight_lb=1500)


@pytest.fixture(scope="module")
def study(campaign: Campaign) -> Study:
    """T2 and T3 left out; the raw CAE, and the same with a band as fused."""
    network = {"learning_curve": {"epoch": [1, 2], "train_loss": [1.0, 0.1]}, "penalty": 0.1}
    network |= {"rmse": {"0.1": 0.1, "0.2": 0.2}, "left_out_rmse": {"0.1": 0.3, "0.2": 0.2}}
    folds = []
    for test_id in ("T2", "T3"):
        test = campaign.test(test_id)
        predictions = with_and_without_band(campaign, test, "fused")
        own = [Estimate(**vars(prediction), approach=name, state=network) for name, prediction in predictions.items()]
        folds.append(Fold.of(test, own, CONFIG.windows_ms))
    return Study(campaign, CONFIG, tuple(folds))


@pytest.fixture(scope="module")
def elsewhere(study: Study) -> PredictedPulse:
    """A prediction at 30 mph."""
    estimate = replace(study.folds[0].estimates[1], approach="fused", condition=HERE, state={})
    return PredictedPulse(study.campaign, (estimate,))


def names(figure: go.Figure) -> list[str]:
    return [t.name for t in figure.data if t.showlegend is not False and t.name not in (POINTWISE, WHOLE)]


def test_every_figure_is_one_call(study: Study) -> None:
    """Of a test, of a whole study, of a campaign; each has numbers."""
    named = ("motion", "acceleration", "displacement", "energy", "integration", "residuals", "scores", "rating")
    networks = ("bias parts", "training", "fine-tuning")
    drawn = [study.plot("T2", name, unit="m/s2", units="kph-kg") for name in (*named, *networks)]
    for name in ("ratings", "draws", "calibration"):
        drawn += [study.plot(figure=name), study.plot(figure=name, approaches=["fused"])]
    for name in ("tests", "conditions", "cae", "cae and test", "bias", "cae events"):
        drawn.append(study.campaign.plot(name, held_out="T2", units="kph-kg"))
    assert min(len(figure_table(figure)) for figure in drawn) > 0


@pytest.mark.parametrize("name", ["motion", "acceleration", "displacement", "energy", "integration"])
def test_every_figure_of_a_prediction_is_one_call(elsewhere: PredictedPulse, name: str) -> None:
    drawn = elsewhere.plot(name, also=["T3"])
    single = ["Fused, representative pulse"] if name in ("motion", "acceleration") else []
    assert names(drawn) == ["Fused", *single, "T3 · 26.0 mph"]
    assert names(elsewhere.plot(name, average=False)) == (single or ["Fused"])
    assert "T3 · 26.0 mph" in figure_table(drawn).to_csv()


def test_the_options_are_those_of_the_pages(study: Study, elsewhere: PredictedPulse) -> None:
    fold = study.fold("T2")
    predictions = {each.approach: each for each in fold.estimates}
    drawn = plots.overlay(fold.test, predictions, Display(40.0, "m/s²", deceleration=True)).figure()
    assert study.plot("T2", "acceleration", window_ms=40, unit="m/s2", deceleration=True) == drawn
    assert study.plot("T2", "acceleration", display=Display(40.0, "m/s²", deceleration=True)) == drawn
    assert study.plot("T2", "acceleration").layout.annotations[0].text == "rated: 0–40 ms"
    some = study.plot(
        "T2", "acceleration", approaches="fused", measured=False, also=["T3", "cae:C05", elsewhere], units="kph-kg"
    )
    assert [name.partition(" · ")[0] for name in names(some)] == [
        "Fused", "T3", "CAE run C05", "Fused at 48.3 km/h, 930 + 680 kg"
    ]  # fmt: skip
    assert names(study.plot("T2", approaches=())) == ["Test"]
    corridors = study.plot("T2", corridors=True, notes=[Note("T2", "kink", 30.0), Note("T3", "other", 10.0)])
    assert sum("Corridor" in (name or "") for name in names(corridors)) == 2
    assert [each.text for each in corridors.layout.annotations] == ["rated: 0–40 ms", "kink"]


@pytest.mark.parametrize(
    ("own", "shown", "text"),
    [
        ({"seed": 1}, {}, "seed 1"),
        ({}, {"seed": 1}, "seed 0"),
        ({"preset": "paper", "seed": 7}, {}, "paper settings, seed 7"),
        ({"leave_out": "speed group"}, {}, "all at its speed left out"),
        ({}, {"preset": "paper", "leave_out": "speed group"}, "fast settings, left out alone"),
    ],
)
def test_a_prediction_with_other_settings_is_named_by_what_differs_and_drawn_as_it_was(
    study: Study, own: dict[str, Any], shown: dict[str, Any], text: str
) -> None:
    """Seen from the other side, by what it has instead; half the CAE run beside the whole one."""
    fold = study.fold("T2")
    accel = fold.estimates[0].accel_mps2
    half = replace(fold.estimates[0], approach=fold.estimates[1].approach, accel_mps2=accel / 2)
    earlier = EarlierPrediction(half, replace(CONFIG, **own), replace(CONFIG, **shown))
    assert earlier.text == text
    drawn = study.plot("T2", "acceleration", approaches=["fused"], also=[earlier])
    curves = {name: trace.y for trace in drawn.data if (name := trace.name) and trace.line.width != 0}
    assert curves["Fused"] == pytest.approx(accel / G)
    assert curves[f"Fused, {text}"] == pytest.approx(accel / 2 / G)


def test_a_campaign_shows_some_tests_and_what_is_put_beside_them(campaign: Campaign, elsewhere: PredictedPulse) -> None:
    beside = campaign.plot(tests=["T2"], also=["C05", elsewhere], held_out="T2")
    assert names(beside)[0] == "T2 · 25.0 mph (held out)"
    assert any(name.startswith("Fused at 30.0 mph") for name in names(beside))
    assert len(campaign.plot(tests=["T2"], cfc=60).data) == 2
    peak = max(campaign.test("T2").pulse.accel_mps2, key=abs) / G
    assert max(campaign.plot(tests="T2").data[0].y, key=abs) == pytest.approx(peak)


@pytest.mark.slow
def test_the_parts_of_a_bias_do_not_change_with_the_held_out_pulse(study: Study) -> None:
    softer = with_pulse(study.campaign, "T2", 0.5 * study.campaign.test("T2").pulse.accel_mps2)
    changed = replace(study, campaign=softer)
    one, two = (each.plot("T2", "bias parts", measured=False) for each in (study, changed))
    for trace, same in zip(one.data, two.data, strict=True):
        np.testing.assert_array_equal(trace.y, same.y)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"held_out": "T9"}, "Test 'T9' was not left out in this study; left out were T2, T3."),
        (
            {"figure": "motion"},
            "There is no figure of a whole study 'motion'; choose from ratings, draws, calibration.",
        ),
        (
            {"held_out": "T2", "figure": "motoin"},
            "There is no figure of a held-out test 'motoin'; did you mean motion?",
        ),
        ({"held_out": "T2", "band": "fusd"}, "There is no prediction by 'fusd'; did you mean fused? All are"),
        ({"held_out": "T2", "approaches": ["fusd"]}, "There is no prediction by 'fusd'; did you mean fused? All are"),
        ({"held_out": "T2", "also": ["T7"]}, "Tiny has no test and no CAE run 'T7'; its tests are T1, T2, T3, T4."),
        ({"held_out": "T2", "unit": "mph"}, "There is no unit of accelerations 'mph'; choose from g, m/s², m/s2."),
        ({"units": "kmh-kg"}, "There is no system of units 'kmh-kg'; did you mean kph-kg? All are mph-lb, kph-kg."),
        ({"window": 40}, "There is no option of a figure 'window'; did you mean window_ms?"),
        ({"window_ms": 60}, "The study was rated over 0 to 20, 40 ms, not to 60 ms."),
        ({"held_out": "T2", "figure": "scores", "window_ms": 60}, "The study was rated over 0 to 20, 40 ms"),
        ({"held_out": "T2", "figure": "energy", "corridors": True}, "Corridors stand in the figures motion and"),
        ({"held_out": "T2", "figure": "fine-tuning", "approaches": []}, "None of these approaches trained a network"),
        ({"figure": "draws", "approaches": ["cae"]}, "None of these approaches has a band to draw pulses from."),
    ],
)
def test_what_there_is_not_is_one_sentence(study: Study, options: dict[str, object], sentence: str) -> None:
    with pytest.raises(UsageError) as caught:
        study.plot(**options)  # type: ignore[arg-type]
    assert str(caught.value).startswith(sentence)


def test_so_it_is_of_a_campaign_and_a_prediction(campaign: Campaign, elsewhere: PredictedPulse) -> None:
    for ask, sentence in (
        (lambda: campaign.plot("test"), "There is no figure of a campaign 'test'; did you mean tests?"),
        (lambda: campaign.plot(tests=["T9"]), "There is no test 'T9' in Tiny; it has T1, T2, T3, T4."),
        (lambda: campaign.plot("cae", cfc=60), "A filter is for the figure tests."),
        (lambda: campaign.plot("bias", also=["T1"]), "Further curves are for the figures tests and cae."),
        (lambda: elsewhere.plot("residuals"), "There is no figure of pulses 'residuals'; choose from motion"),
        (lambda: crashfuse.sweep(campaign, HERE, (40, 30), "cae"), "A sweep takes a speed above 0 and a higher one"),
        (lambda: crashfuse.predict(campaign, HERE, ()), "A prediction takes an approach at least, such as fused."),
    ):
        with pytest.raises(UsageError) as caught:
            ask()
        assert str(caught.value).startswith(sentence)
