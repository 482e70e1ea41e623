"""Objects introduce themselves: a line without a wall of numbers, and a small table in a notebook."""

import io
from dataclasses import replace

import pandas as pd
import pytest

import crashfuse
from crashfuse import Campaign, Condition, Study, StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.study import Fold
from crashfuse.units import KPH_KG

CONFIG = StudyConfig(approaches=("cae",))
AT = Condition.of(speed_mph=30, front_weight_lb=2050, rear_weight_lb=1500, drive="FWD")


@pytest.fixture(scope="module")
def study(campaign: Campaign) -> Study:
    test = campaign.test("T3")
    own = Estimate(test.condition, 0.9 * test.pulse.accel_mps2, approach="cae")
    return Study(campaign, CONFIG, (Fold.of(test, [own], CONFIG.windows_ms),))


def test_every_object_says_in_a_line_what_it_is(campaign: Campaign, study: Study) -> None:
    prediction = crashfuse.predict(campaign, AT, "cae")
    fold = study.fold("T3")
    objects = [
        campaign, campaign.tests[0], campaign.tests[0].pulse, campaign.cae, campaign.quality, study, fold,
        fold.ratings["cae"][60.0], fold.estimates[0], fold.explained("cae", 60.0),
        prediction, AT, crashfuse.sweep(campaign, AT, (30, 31), "cae"),
    ]  # fmt: skip
    for each in objects:
        line = repr(each)
        assert len(line) < 200, line
        assert "\n" not in line
        assert "array" not in line
    assert repr(fold.ratings["cae"][60.0]).startswith("<Rating 0.9")
    assert repr(fold) == f"<Fold of T3: cae {fold.ratings['cae'][60.0].overall:.3f} (0–60 ms)>"
    assert repr(campaign.tests[0]).startswith("<CrashTest 'T1' at 15.0 mph")


def test_a_study_shows_grades(study: Study) -> None:
    rating = study.fold("T3").ratings["cae"][60.0]
    (table,) = pd.read_html(io.StringIO(study._repr_html_()))
    assert table[["Approach", "0–60 ms"]].to_numpy().tolist() == [["CAE", f"{rating.overall:.3f} {rating.grade}"]]


def test_a_campaign_is_shown_in_the_units_of_its_tests(campaign: Campaign) -> None:
    """Of tests declared in km/h and kg, tables and figures are in these, unless others are asked for."""
    metric = replace(campaign, units=KPH_KG)
    (table,) = pd.read_html(io.StringIO(metric._repr_html_()))
    assert list(table)[:4] == ["Test", "Speed (km/h)", "Front weight (kg)", "Rear weight (kg)"]
    kph = [test.condition.speed_mps * 3.6 for test in campaign.tests]
    assert table["Speed (km/h)"].tolist() == pytest.approx(kph, abs=0.06)
    assert " mph" not in metric._repr_html_()
    assert metric.plot().data[0].name.endswith("km/h")
    assert metric.plot(units="mph-lb").data[0].name.endswith("mph")
    assert "km/h" in crashfuse.predict(metric, AT, "cae")._repr_html_()
