"""What people are told of fits and bands."""

from dataclasses import replace
from typing import Any

import numpy as np

from crashfuse.approaches.calibration import Calibration, Coverage
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.campaign import Campaign
from crashfuse.results.display import Display
from crashfuse.results.fit_explanations import coverage_table, fit_sentences, fit_table, whole_sentences
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.study import Fold, Study
from crashfuse.units import KPH_KG
from tests.golden import assert_golden

INSIDE = Coverage(1.0, 0.9, 0.8, crush=True, peak=True)
STATE = {
    "points": 300,
    "bias_rms_g": 7.25,
    "log_marginal_likelihood": -12.3,
    "dead": False,
    "retries": 1,
    "hyperparameters": {"shared, standard deviation": 0.7123, "noise, standard deviation": 0.05},
    "spread_factors": {"shared, standard deviation": 1.5, "noise, standard deviation": 1.1},
    "touched_bounds": ["noise, standard deviation"],
    "factors": ["powertrain"],
    "left_out_log_density": {"none": -10.4, "powertrain": -3.2},
    "band_check": Calibration(1.15, (INSIDE,) * 3).state,
}


def test_the_coverage_of_a_study_counts_its_held_out_tests(campaign: Campaign) -> None:
    folds = []
    for test, factor in zip(campaign.tests[:2], (1.0, 1.5), strict=True):
        draws = factor * np.linspace(0.95, 1.05, 100)[:, None] * test.pulse.accel_mps2
        with_band = Estimate(test.condition, draws[50], draws, approach="displacement_domain")
        without = Estimate(test.condition, draws[50], approach="cae")
        folds.append(Fold(test, (without, with_band), {}))
    config = StudyConfig(approaches=("cae", "displacement_domain"))
    found = Study(campaign, config, tuple(folds)).coverage
    assert list(found) == ["displacement_domain"]
    assert found["displacement_domain"].count("peak") == 1
    counted = [replace(own, state={"band_check": found[own.approach].state}) for own in folds[0].estimates[1:]]
    (sentence,) = whole_sentences([folds[0].estimates[0], *counted])
    assert sentence.endswith(": Displacement domain 1 of 2.")
    assert whole_sentences(folds[0].estimates) == []


def test_the_table_of_coverage_says_percent_and_counts() -> None:
    never = Coverage(1.0, 1.0, float("nan"), crush=False, peak=True)
    row = coverage_table({"displacement_domain": Calibration(1.0, (INSIDE, never))}).texts().iloc[0]
    assert row["a(t) up to TTZV"] == "100 %"
    assert row["v(t) up to TTZV"] == "95 %"
    assert row["a(t) after TTZV"] == "80 %"
    assert row["Maximum crush"] == "1 of 2"
    assert coverage_table({"displacement_domain": Calibration(1.0, (never,))}).texts()["a(t) after TTZV"][0] == "–"


def test_hyperparameters_are_shown_with_their_spread_and_bounds() -> None:
    table = fit_table("displacement_domain", STATE).texts().set_index("Hyperparameter")
    assert table.loc["shared, standard deviation"].tolist() == ["0.712", "1.50", "no"]
    assert table.loc["noise, standard deviation", "At its bound"] == "yes"
    assert fit_table("cae", {}).empty


def test_hyperparameters_of_a_fit_are_in_the_units_of_the_reader(campaign: Campaign) -> None:
    """Speeds and weights of every name that the bias model gives."""
    state = DisplacementDomain().fit(campaign).state
    for display, units in ((Display(), "mph lb"), (Display(system=KPH_KG), "km/h kg")):
        shown = fit_table("displacement_domain", state).texts(display)["Hyperparameter"]
        endings = {name.rpartition(" in ")[2] for name in shown if " in " in name}
        assert endings == {*units.split(), "m", "v/v0"}


def test_what_is_said_of_fits() -> None:
    """Of a bias model, alive and dead, a fine-tuning, a mixture, and a band that was widened more after TTZV."""
    tuned = {"members": 4, "weights": 63000, "penalty": 0.02, "left_out_rmse": {"0.02": 0.23, "0.06": 0.25}}
    states: list[dict[str, Any]] = [
        STATE,
        {**STATE, "dead": True, "factors": [], "band_check": {}},
        {**tuned, "left_out_delta_v_misfit": 0.041, "band_check": Calibration(1.0, (INSIDE,) * 3).state},
        {"weights_at_equal_bands": {"time domain": 0.4, "displacement domain": 0.6, "raw CAE": 0.0}},
        {"band_check": Calibration(1.15, (INSIDE,) * 3, late_widening=2.0).state},
    ]
    assert_golden("fits", [str(sentence) for state in states for sentence in fit_sentences(state)])
    assert fit_sentences({}) == []
