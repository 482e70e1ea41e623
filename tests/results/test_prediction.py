"""A prediction as the library offers it: tables in known units, the pages' figure, one sentence for what is wrong."""

import io
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import crashfuse
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.results.display import Display
from crashfuse.results.prediction import cautions, predictions_table, side_by_side, told_apart
from crashfuse.results.result_tables import pulses_table
from crashfuse.signals.metrics import Metric
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit
from crashfuse.study.prediction import PredictedPulse, predict
from crashfuse.units import KPH, KPH_KG, LB, MPH, G

AT = Condition.of(speed_mph=30, front_weight_lb=2050, rear_weight_lb=1500, drive="FWD")


@pytest.fixture(scope="module")
def predicted(campaign: crashfuse.Campaign) -> PredictedPulse:
    """What the displacement domain predicts at 30 mph."""
    return predict(campaign, AT, "displacement_domain")


def test_the_table_holds_the_pulse_and_its_motion(predicted: PredictedPulse) -> None:
    """Equal to pulses.csv; velocity falls by the integral of the acceleration, displacement is that of the velocity."""
    frame = predicted.to_frame()
    assert list(frame) == ["time_ms", "acceleration_g", "lower_g", "upper_g", "velocity_kph", "displacement_mm"]
    same = pulses_table([predicted.preferred])
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
    assert repr(predicted).startswith("<PredictedPulse, displacement_domain, at 30.0 mph")
    (table,) = pd.read_html(io.StringIO(predicted._repr_html_()))
    assert table["Pulse metric"].tolist()[0] == "Peak deceleration (g)"
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
        assert caught.value._render_traceback_() == [f"UsageError: {caught.value}"]  # which IPython shows


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


def moved(campaign: Campaign, speed_mph: float, seed: int = 0, **changed: float | None) -> PredictedPulse:
    """At the condition of a test but for its speed, with that test's metrics, some of them changed."""
    condition = replace(campaign.tests[0].condition, speed_mps=speed_mph * MPH)
    own = campaign.metrics_of(campaign.tests[0])
    metrics = tuple(Metric(m.name, changed.get(m.name, m.value), None, None, m.unit) for m in own)
    found = Estimate(condition, campaign.tests[0].pulse.accel_mps2, approach="cae")
    vars(found)["metrics"] = metrics
    return PredictedPulse(campaign, (found,), StudyConfig(seed=seed))


def test_each_column_is_followed_by_its_differences_from_the_first(campaign: Campaign) -> None:
    """Rounded as the values are; unknown where one of both is."""
    base = moved(campaign, 20, peak=20.0, max_crush=500.0, t0=None)
    other = moved(campaign, 21, peak=23.25, max_crush=499.99, t0=70.0)
    table = side_by_side([base, other]).texts().set_index("Pulse metric")
    assert list(table) == ["20.0 mph", "21.0 mph", "21.0 mph − 20.0 mph"]
    assert table.loc["Peak deceleration (g)", "21.0 mph − 20.0 mph"] == "+3.2"
    assert table.loc["Maximum dynamic crush (mm)", "21.0 mph − 20.0 mph"] == "0.0"
    assert table.loc["Time of zero velocity (TTZV) (ms)", "21.0 mph − 20.0 mph"] == "–"
    assert list(side_by_side([base, other], 1).texts())[1:] == ["21.0 mph", "20.0 mph", "20.0 mph − 21.0 mph"]
    in_si = side_by_side([base, other]).texts(Display(unit="m/s²"))
    peak = in_si.set_index("Pulse metric").loc["Peak deceleration (m/s²)"]
    assert float(peak["21.0 mph − 20.0 mph"]) == pytest.approx(3.25 * G, abs=0.05)
    folds = (replace(m, folds={"most": m, "T9": replace(m, value=0.0)}) for m in other.estimates[0].metrics)
    vars(other.estimates[0])["metrics"] = tuple(folds)
    columns = list(side_by_side([base, other]).texts())[2::2]  # both in place of their mixture
    assert columns == ["21.0 mph if it folds as most", "21.0 mph if it folds as T9"]
    assert predictions_table([base, other])["apart_value"].dropna().eq(0).sum() == len(base.estimates[0].metrics)


def test_a_column_beside_says_where_it_is_an_extrapolation(campaign: Campaign) -> None:
    """Of the first column the page and the report speak themselves."""
    far = moved(campaign, 61)  # beyond all CAE runs
    (outside,) = cautions([far, moved(campaign, 60)])
    assert outside.startswith("60.0 mph: Extrapolation: speed 60.0 mph lies outside")
    assert cautions([far, moved(campaign, 20)]) == []


def test_another_seed_is_told_by_it(campaign: Campaign) -> None:
    """At the same condition and at others; what the first column says of it, its extrapolation, is not said again."""
    first, *others = (moved(campaign, mph, seed) for mph, seed in ((60, 0), (60, 1), (61, 0), (61, 1)))
    columns = [column.title for column in side_by_side([first, *others]).columns[1:]]
    names = [name for name in columns if " − " not in name]
    assert names == ["60.0 mph", "60.0 mph, seed 1", "61.0 mph", "61.0 mph, seed 1"]
    assert all("seed 1" not in sentence for sentence in cautions([first, others[0]]))


def test_a_file_holds_every_approach_at_every_condition(campaign: Campaign) -> None:
    """Numbered, in the units of all files, with the difference from the first condition by the same approach."""
    fit = Fit.of(campaign, "cae", StudyConfig(approaches=("cae",)))
    conditions = [campaign.tests[0].condition, Condition.of_vector([64 * KPH, 900.0, 700.0], (("drive", "FWD"),))]
    config = StudyConfig(seed=1)
    table = predictions_table([PredictedPulse(campaign, (fit.estimate(own),), config) for own in conditions])
    assert (set(table["preset"]), set(table["seed"])) == ({"fast"}, {1})
    first, second = (own.set_index("metric") for _, own in table.groupby("id", sort=False))
    assert set(first["speed_mph"]) == {15.0}
    assert second["speed_mph"].to_numpy() == pytest.approx(64 * KPH / MPH)
    assert second["front_weight_lb"].to_numpy() == pytest.approx(900.0 / LB)
    assert (set(first["drive"]), set(second["drive"])) == ({dict(conditions[0].factors).get("drive", "")}, {"FWD"})
    assert (first["difference"].dropna() == 0).all()
    pd.testing.assert_series_equal(second["difference"], second["value"] - first["value"], check_names=False)


def test_conditions_are_told_apart_in_few_words_in_any_unit() -> None:
    slow, fast = (Condition.of(speed_mph=speed, front_weight_lb=2100, rear_weight_lb=1550) for speed in (30, 35))
    heavy = Condition.of(speed_mph=35, front_weight_lb=2200, rear_weight_lb=1550, drive="AWD")
    assert told_apart([slow, fast]) == ["30.0 mph", "35.0 mph"]
    assert told_apart([fast, heavy]) == ["35.0 mph, 2100 + 1550 lb", "35.0 mph, 2200 + 1550 lb, AWD"]
    assert [name.in_units(KPH_KG) for name in told_apart([slow, fast])] == ["48.3 km/h", "56.3 km/h"]
