"""Tables of what a rating is made of have a row for each hump and for each stretch outside the corridor."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.results import rating_tables as tables
from crashfuse.results.display import Display
from crashfuse.results.study import study_record
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.signals.rating_explanation import explain_rating
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.history import PastResult
from crashfuse.study.recommendation import recommend
from crashfuse.study.running import run_study
from crashfuse.study.study import Fold, Study
from tests.conftest import not_none
from tests.signals.test_rating_explanation import TEST, bump, pulse


def texts(comparison: Pulse) -> pd.DataFrame:
    """The humps of the test beside those of another pulse, as shown."""
    return tables.humps_table(explain_rating(pulse(TEST), comparison, 70.0)).texts()


def test_humps_have_their_times_in_both_curves() -> None:
    """The third comes 4 ms late; one that is missing is named as missing."""
    late = texts(pulse(bump(15, 200) + bump(33, 250) + bump(54, 220)))
    assert list(late["Hump"]) == ["1", "2", "3"]
    assert late["Late (ms)"].iloc[2] in ("+3.9", "+4.0", "+4.1")
    missing = texts(pulse(bump(15, 200) + bump(33, 250)))
    assert list(missing["Peak, prediction (ms)"])[2] == "none"
    assert list(missing["Late (ms)"])[2] == "–"


def test_stretches_outside_the_corridor_are_in_the_readers_unit_and_sign() -> None:
    """A pulse 20 % too strong; shown as deceleration it lies above."""
    explanation = explain_rating(pulse(TEST), pulse(1.2 * TEST), 70.0)
    table = tables.excursions_table(explanation)
    assert len(table) == len(explanation.excursions) > 0
    assert all(value.startswith("−") for value in table.texts()["Prediction minus test, largest (g)"])
    flipped = table.texts(Display(unit="m/s²", deceleration=True))
    assert all(value.startswith("+") for value in flipped["Prediction minus test, largest (m/s²)"])
    assert tables.excursions_table(explain_rating(pulse(TEST), pulse(TEST), 70.0)).empty


def test_the_record_is_plain_json_whose_losses_complete_the_rating() -> None:
    explanation = explain_rating(pulse(TEST), pulse(1.2 * TEST), 70.0)
    record = json.loads(json.dumps(tables.explanation_record(explanation, "comparison")))
    assert abs(1 - sum(record["losses"].values()) - explanation.rating.overall) < 1e-12
    assert set(record["sentences"]) == {"overall", "corridor", "phase", "magnitude", "slope"}
    assert [hump["late_ms"] for hump in record["humps"]] == [0.0, 0.0, 0.0]


def study(campaign: Campaign) -> Study:
    config = StudyConfig(approaches=("cae", "displacement_domain"), windows_ms=(20.0, 60.0))
    folds = []
    for test in campaign.tests[:2]:
        own = [
            Estimate(test.condition, scale * test.pulse.accel_mps2, approach=name)
            for name, scale in (("cae", 0.7), ("displacement_domain", 1.0))
        ]
        folds.append(Fold.of(test, own, config.windows_ms))
    return Study(campaign, config, tuple(folds))


def test_ratings_to_zero_velocity_end_where_the_test_stops_and_advise_nothing(campaign: Campaign) -> None:
    """A column of tables alone: recommendation, coverage, draws and what a past result keeps are as without it."""
    usual = study(campaign)
    asked = replace(usual, config=StudyConfig(usual.config.approaches, windows_ms=(20.0, 60.0, "ttzv")))  # type: ignore[arg-type]
    assert asked.config == replace(usual.config, to_ttzv=True)
    for fold in asked.folds:
        stop_ms = not_none(fold.ttzv_ms)
        assert stop_ms == pytest.approx(
            float(fold.test.pulse.kinematics(fold.test.condition.speed_mps).t0_s) * 1e3, abs=0.1
        )
        whole = rate_windows(fold.test.pulse, Pulse(GRID_S, fold.estimate("cae").accel_mps2), [stop_ms])
        assert fold.overall_to_ttzv("cae") == whole[stop_ms].overall
    rows = tables.mean_values(asked)
    assert rows.drop(columns=tables.TTZV_COLUMN).equals(tables.mean_values(usual))
    assert rows.loc["cae", tables.TTZV_COLUMN] == np.mean([fold.overall_to_ttzv("cae") for fold in asked.folds])
    columns = ["ttzv_ms", "overall_to_ttzv"]
    assert asked.scores.drop(columns=columns).equals(usual.scores)
    assert recommend(asked).sentences == recommend(usual).sentences
    assert PastResult.of_study(asked).id == PastResult.of_study(usual).id
    slow = campaign.tests[0]
    endless = Fold.of(replace(slow, recorded_s=0.02), usual.folds[0].estimates, (20.0,))
    assert endless.ttzv_ms is None
    assert np.isnan(endless.overall_to_ttzv("cae"))


def test_measures_beside_the_rating_are_columns_where_they_are_asked_for(campaign: Campaign) -> None:
    """A prediction of 0.7 times the test errs by -0.3 in magnitude, and not in phase; all else is as without."""
    usual = study(campaign)
    asked = replace(usual, config=replace(usual.config, also=("sprague-geers", "anova")))
    columns = ["sg_magnitude", "sg_phase", "sg_comprehensive", "anova_mean", "anova_deviation"]
    assert asked.scores.drop(columns=columns).equals(usual.scores)
    cae = asked.scores.set_index("approach").loc["cae", columns[:2]].to_numpy()
    np.testing.assert_allclose(cae, np.tile([-0.3, 0.0], (4, 1)), atol=1e-6)
    shown = tables.further_table(asked, asked.folds[0], 60.0).texts()
    assert list(shown["Sprague–Geers magnitude"]) == ["−0.300", "0.000"]
    assert tables.further_table(usual, usual.folds[0], 60.0).empty
    assert PastResult.of_study(asked).id == PastResult.of_study(usual).id


def test_a_prediction_learns_nothing_of_the_time_at_which_its_test_stops(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The estimates of a study that rates to it are the same to the bit, made while nobody may ask for it."""
    config = StudyConfig(("cae", "displacement_domain"), windows_ms=(60.0,))
    with monkeypatch.context() as patch:
        patch.setattr(Fold, "ttzv_ms", property(lambda _: pytest.fail("it was asked for before the tables")))
        asked = run_study(campaign, replace(config, to_ttzv=True), held_out=["T1"], cache=Cache(tmp_path))
        advice, record = recommend(asked), study_record(asked)
    usual = run_study(campaign, config, held_out=["T1"])
    assert advice == recommend(usual)
    assert record["recommendation"] == study_record(usual)["recommendation"]
    for one, other in zip(asked.folds[0].estimates, usual.folds[0].estimates, strict=True):
        np.testing.assert_array_equal(one.accel_mps2, other.accel_mps2)
        assert one.metrics == other.metrics


def test_a_table_has_a_row_for_each_test_and_approach_and_the_mean_at_its_foot(campaign: Campaign) -> None:
    """Windows are columns, as in the paper; of a single test, the mean would repeat its rows."""
    table = tables.rating_table(study(campaign), tables.TABLE_5)
    assert list(table.columns) == ["(0, 20) ms", "(0, 60) ms"]
    assert list(table.index) == [(t, a) for t in ("T1", "T2", "Mean") for a in ("Displacement domain", "CAE")]
    np.testing.assert_allclose(table.xs("Displacement domain", level=1), 1.0)
    cae = table.xs("CAE", level=1)
    np.testing.assert_allclose(cae.loc["Mean"], cae.loc[["T1", "T2"]].mean())
    two = study(campaign)
    one = tables.rating_table(replace(two, folds=two.folds[:1]), tables.TABLE_5)
    assert list(one.index) == [("T1", "Displacement domain"), ("T1", "CAE")]
    assert tables.rating_table(two, tables.TABLE_3).empty  # which compares networks, and there is none here


def test_the_best_of_a_test_is_marked_window_by_window() -> None:
    """Equal to three digits is equally good, as the reader sees it."""
    index = pd.MultiIndex.from_product([["T1", "T2"], ["a", "b"]])
    table = pd.DataFrame({"w": [0.8, 0.9, 0.70004, 0.70001], "v": [0.5, 0.4, 0.1, 0.2]}, index=index)
    assert tables.best(table).to_numpy().tolist() == [[False, True], [True, False], [True, False], [True, True]]
