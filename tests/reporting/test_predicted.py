"""A prediction as the library offers it: tables in known units, the pages' figure, one sentence for what is wrong."""

import io
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import crashfuse
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.reporting.predicted import PredictedPulse, predict
from crashfuse.reporting.result_tables import pulses_table
from crashfuse.study.config import StudyConfig

AT = Condition.of(speed_mph=30, front_weight_lb=2050, rear_weight_lb=1500, drive="FWD")


@pytest.fixture(scope="module")
def predicted(campaign: crashfuse.Campaign) -> PredictedPulse:
    """What the displacement domain predicts at 30 mph."""
    return predict(campaign, AT, "displacement_domain")


def test_the_table_holds_the_pulse_and_its_motion(predicted: PredictedPulse) -> None:
    """Equal to pulses.csv; velocity falls by the integral of the acceleration, displacement is that of the velocity."""
    frame = predicted.to_frame()
    assert list(frame) == ["time_ms", "acceleration_g", "lower_g", "upper_g", "velocity_kph", "displacement_mm"]
    same = pulses_table([predicted.estimate])
    assert frame[list(frame)[:4]].equals(same[list(frame)[:4]].reset_index(drop=True))
    assert frame["velocity_kph"].iloc[0] == pytest.approx(30 * 1.609344)
    change = np.trapezoid(frame["acceleration_g"] * 9.80665, frame["time_ms"] / 1e3) * 3.6
    assert frame["velocity_kph"].iloc[-1] - frame["velocity_kph"].iloc[0] == pytest.approx(change, rel=1e-6)
    covered = np.trapezoid(frame["velocity_kph"] / 3.6, frame["time_ms"])
    assert frame["displacement_mm"].iloc[-1] == pytest.approx(covered, rel=1e-6)


def test_the_figure_marks_the_crush_of_the_metrics(predicted: PredictedPulse) -> None:
    """At the end of the drawn pulse, with the interval of the table: here, and of a prediction put beside it."""
    crush = predicted.metrics.set_index("metric").loc["max_crush"]
    marks = [t for t in predicted.plot("displacement", also=[predicted]).data if t.mode == "markers"]
    assert len(marks) == 2
    for mark in marks:
        assert mark.x[0] == pytest.approx(crush["of_pulse"], rel=1e-4)
        assert mark.x[0] - mark.error_x.arrayminus[0] == pytest.approx(crush["lower"], rel=1e-4)
        assert mark.x[0] + mark.error_x.array[0] == pytest.approx(crush["upper"], rel=1e-4)


def test_how_tests_would_be_left_out_tells_no_predictions_apart(predicted: PredictedPulse) -> None:
    """None is: beside the same with another way, it is named by its condition, not by what was left out."""
    both = replace(predicted, config=StudyConfig(leave_out="both"))
    assert both.config == predicted.config
    drawn = both.plot(also=[replace(both, config=StudyConfig(seed=1))])
    assert "Displacement domain, seed 1" in {curve.name for curve in drawn.data}


def test_it_shows_itself(predicted: PredictedPulse) -> None:
    """In a line, as a table, as the pages' figure in the unit asked for."""
    assert repr(predicted).startswith("<PredictedPulse, displacement domain, at 30.0 mph")
    (table,) = pd.read_html(io.StringIO(predicted._repr_html_()))
    assert table["Metric"].tolist()[0] == "Peak deceleration (g)"
    assert "m/s²" in predicted.plot(unit="m/s²").layout.yaxis.title.text


def test_what_the_campaign_does_not_have_is_a_sentence(campaign: crashfuse.Campaign) -> None:
    """An approach with the nearest name, a factor, a value of one."""

    def refusal(condition: Condition, approach: str = "cae") -> str:
        with pytest.raises(UsageError) as caught:
            predict(campaign, condition, approach)
        return str(caught.value)

    assert refusal(AT, "fusd").startswith("There is no approach 'fusd'; did you mean fused?")
    wheels = Condition.of(speed_mph=30, front_weight_lb=2050, rear_weight_lb=1500, wheels="4")
    assert refusal(wheels) == "Tiny has no factor 'wheels'; its factors are: drive."
    rear = Condition.of(speed_mph=30, front_weight_lb=2050, rear_weight_lb=1500, drive="RWD")
    assert refusal(rear) == "No test has drive 'RWD'; known are FWD."


def test_what_is_no_campaign_or_condition_is_a_sentence(campaign: crashfuse.Campaign) -> None:
    """A folder's name, or three numbers: the sentence says what makes one of them."""
    folder: Any = "campaign"
    numbers: Any = (30, 2050, 1500)
    settings: Any = {"seed": 1}
    for call, sentence in (
        (lambda: crashfuse.run_study(folder), "This takes a Campaign (crashfuse.load_campaign(folder)), not 'c"),
        (lambda: crashfuse.certify(folder, [], pd.DataFrame()), "This takes a Campaign"),
        (lambda: predict(folder, AT), "This takes a Campaign"),
        (lambda: predict(campaign, numbers), "This takes a Condition (crashfuse.Condition.of(speed_mph=…, …)"),
        (lambda: crashfuse.run_study(campaign, settings), "This takes a StudyConfig (crashfuse.StudyConfig())"),
    ):
        with pytest.raises(UsageError) as caught:
            call()
        assert str(caught.value).startswith(sentence)


def test_an_error_in_a_notebook_is_its_sentence() -> None:
    """IPython shows what this returns, in place of all frames."""
    assert UsageError("No.")._render_traceback_() == ["UsageError: No."]


def test_a_study_takes_a_single_name_as_it_is(campaign: crashfuse.Campaign) -> None:
    """A test or an approach need not be in a list; an unknown one is told with the nearest."""
    study = crashfuse.run_study(campaign, held_out="T3", approaches="cae", workers=1)
    assert [fold.held_out for fold in study.folds] == ["T3"]
    for held_out, approach, sentence in (
        ("T9", "cae", "There is no test 'T9' in Tiny; it has T1, T2, T3, T4."),
        ("T3", "displacement", "There is no approach 'displacement'; did you mean displacement_domain?"),
    ):
        with pytest.raises(UsageError) as caught:
            crashfuse.run_study(campaign, held_out=held_out, approaches=approach)
        assert str(caught.value).startswith(sentence)
