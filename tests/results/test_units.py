"""A figure, a table and a report are in one system of units; the numbers in another are the same, converted."""

import io
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import cast

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
from plotly.offline import get_plotlyjs

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord, Trial
from crashfuse.certification.verdict import Verdict, Word
from crashfuse.crash_test import CrashTest
from crashfuse.results.certification import certification_result
from crashfuse.results.display import Display
from crashfuse.results.export.outgoing_pulses import PulseExport
from crashfuse.results.export.solver_curves import SolverCurve
from crashfuse.results.planning import next_tests_result, sweep_result
from crashfuse.results.plots.certification import validated_domain, verdict_matrix
from crashfuse.results.plots.conditions import condition_space
from crashfuse.results.plots.curves import by_speed
from crashfuse.results.plots.pulses import library_band, measured_pulses, motion
from crashfuse.results.prediction import prediction_result
from crashfuse.results.render.html import report
from crashfuse.results.study import study_report
from crashfuse.signals.metrics import checked_metrics
from crashfuse.signals.pulse import GRID_S
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.planning import ConditionRange, NextTests, SpeedSweep
from crashfuse.study.prediction import PredictedPulse
from crashfuse.study.study import Fold, Study
from crashfuse.units import KPH, KPH_KG, LB, MPH, MPH_LB, Sentence, UnitSystem, speed

CONFIG = StudyConfig(approaches=("cae",))
OF_ONE = {MPH_LB: r"\bmph\b|[_-]mph|\blb\b|[_-]lb\b", KPH_KG: r"km/h|kph|\bkg\b"}
SYSTEMS = pytest.mark.parametrize("system", OF_ONE, ids=["mph-lb", "kph-kg"])


def other_units(text: str, system: UnitSystem) -> list[str]:
    """Where a text has units of the system that it is not in."""
    [foreign] = [pattern for own, pattern in OF_ONE.items() if own != system]
    text = text.replace(get_plotlyjs(), "").replace("\\u002f", "/")
    text = re.sub(r'"bdata":"[^"]*"', "", text)
    assert re.search(OF_ONE[system], text)
    return [text[max(found.start() - 60, 0) : found.end() + 20] for found in re.finditer(foreign, text)]


def estimate(test: CrashTest) -> Estimate:
    """The test itself, with 100 draws around it, and a note that names a speed."""
    accel = test.pulse.accel_mps2
    notes = (Sentence("Nearest test {} away.", speed(1.0)),)
    prediction = Prediction(test.condition, accel, np.linspace(0.9, 1.1, 100)[:, None] * accel, notes)
    state = {
        "hyperparameters": {"by speed, length in v0 in m/s": 12.0, "by weight, length in front weight in kg": 300.0},
        **{"points": 9, "bias_rms_g": 3.2, "log_marginal_likelihood": 1.0, "retries": 0, "dead": False},
    }
    return Estimate(**vars(prediction), approach="cae", state=state, seconds=0.1, left_out_mps2={test.id: accel})


def predicted(campaign: Campaign, test: CrashTest) -> PredictedPulse:
    return PredictedPulse(campaign, (estimate(test),), CONFIG)


def sweep(campaign: Campaign) -> SpeedSweep:
    """One approach at two speeds, slower than all runs and faster, so that both ends are shaded."""
    speeds = np.array([1.0, 40.0])
    metrics = tuple(checked_metrics(-300 * np.exp(-GRID_S / 0.03), v0) for v0 in speeds)
    return SpeedSweep(campaign, campaign.tests[1].condition, speeds, {"cae": metrics}, CONFIG)


def ranking(campaign: Campaign) -> NextTests:
    first, second = (test.condition for test in campaign.tests[:2])
    far = replace(second, speed_mps=90 * MPH)
    return NextTests(campaign, ConditionRange.of(campaign.tests), (first, far), 30.0, np.array([25.0, 28.0]), CONFIG)


def certification(campaign: Campaign) -> Certification:
    """Limits of ΔV and mean deceleration, met at one condition, outside at another, missed by a test."""
    criteria = Criterion("change", "delta_v", at_most=60.0), Criterion("mean", "mean", at_least=10.0)
    domain, tests = Domain.of(campaign), campaign.tests
    far = replace(tests[0].condition, speed_mps=90 * MPH, front_weight_kg=2000.0)
    rows, said = [], (55.0, 50.0, 61.0)
    for condition in (tests[0].condition, far):
        outside = domain.exceeded_by(condition)
        word: Word = "outside" if outside else "met"
        reasons = [outside[0] if outside else own.compared(*said) for own in criteria]
        verdicts = (Verdict(condition, own, *said, 0.9, word, why) for own, why in zip(criteria, reasons, strict=True))
        rows.append(tuple(verdicts))
    trials = tuple(Trial(tests[0].id, "test", verdict, 62.0, 0.5) for verdict in rows[0])
    matrix = Matrix(("M1", "M2"), (tests[0].condition, far))
    asked = Criteria(criteria, 0.8)
    return Certification(campaign, asked, matrix, CONFIG, domain, tuple(rows), tuple(rows), TrackRecord(trials), {})


REPORTS: dict[str, Callable[[Campaign, Display], str]] = {
    "prediction": lambda campaign, display: report(prediction_result(predicted(campaign, campaign.tests[0])), display),
    "study": lambda campaign, display: study_report(study(campaign), display),
    "sweep": lambda campaign, display: report(sweep_result(sweep(campaign)), display),
    "next test": lambda campaign, display: report(next_tests_result(ranking(campaign)), display),
    "certification": lambda campaign, display: report(certification_result(certification(campaign)), display),
}
FIGURES: dict[str, Callable[[Campaign, Display], go.Figure]] = {
    "motion": lambda campaign, display: motion(campaign.tests[0], {}, display).figure(),
    "tests": lambda campaign, display: measured_pulses(by_speed(campaign.tests, display), display).figure(),
    "runs": lambda campaign, display: library_band(campaign.cae, by_speed(campaign.tests), display).figure(),
    "conditions": lambda campaign, display: condition_space(campaign.cae, campaign.tests, display=display).figure(),
    "sweep of ΔV": lambda campaign, display: sweep(campaign).plot("delta_v", display=display),
    "next test": lambda campaign, display: ranking(campaign).plot(display=display),
    "verdicts": lambda campaign, display: verdict_matrix(certification(campaign), display).figure(),
    "domain": lambda campaign, display: validated_domain(certification(campaign), display).figure(),
    "record": lambda campaign, display: certification(campaign).plot("record", display=display),
}


def study(campaign: Campaign) -> Study:
    folds = tuple(Fold.of(test, [estimate(test)], CONFIG.windows_ms) for test in campaign.tests[:2])
    alone = Study(campaign, CONFIG, folds)
    return replace(alone, speed_groups=alone)


@SYSTEMS
@pytest.mark.parametrize("name", REPORTS)
def test_a_report_is_in_one_system(campaign: Campaign, name: str, system: UnitSystem) -> None:
    """Condition, figures, tables, sentences and the command that makes it again; only limits stand as declared, too."""
    text = REPORTS[name](campaign, Display(system=system)).replace("\N{NO-BREAK SPACE}", " ")
    assert other_units(text.replace("at most 60 km/h", ""), system) == []


@SYSTEMS
def test_files_for_reading_are_in_one_system(campaign: Campaign, system: UnitSystem) -> None:
    """Reasons, the credibility sheet, comments of exported pulses; numbers for programs are the same in both."""
    files = certification_result(certification(campaign)).files_in(system)
    tables = {
        name: pd.read_csv(io.BytesIO(cast(bytes, files[f"{name}.csv"]()))) for name in ("certification", "credibility")
    }
    told = " ".join([*tables["certification"]["reason"], *tables["credibility"]["data_say"]])
    assert other_units(told.replace("at most 60 km/h", ""), system) == []
    assert {"speed_mph", "at_most"} <= {*tables["certification"]}
    there = replace(campaign.tests[0].condition, units=system.endings)
    own = replace(estimate(campaign.tests[0]), condition=there, accel_mps2=0.5 * campaign.tests[0].pulse.accel_mps2)
    export = PulseExport(("lsdyna", "isomme"), curve=SolverCurve("mm-s-t"))
    prediction = PredictedPulse(campaign, (own,), CONFIG)
    for form in export.formats:
        made = prediction_result(prediction, export=export).files_in(system)[f"{form}/"]()
        pulses = cast(Mapping[str, bytes], made)
        headers = " ".join(re.sub(r"\s*(Comments +:|\$|\n) *", " ", text.decode("latin-1")) for text in pulses.values())
        assert "moves forward at" in headers
        assert other_units(headers, system) == []


@SYSTEMS
@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_in_one_system(campaign: Campaign, name: str, system: UnitSystem) -> None:
    figure = FIGURES[name](campaign, Display(system=system))
    drawn = json.dumps(figure.to_plotly_json(), default=repr, ensure_ascii=False)
    assert other_units(drawn, system) == []


@pytest.mark.parametrize("name", ["conditions", "domain", "next test", "sweep of ΔV"])
def test_speeds_and_weights_are_the_same_converted(campaign: Campaign, name: str) -> None:
    usual, metric = (FIGURES[name](campaign, Display(system=system)) for system in (MPH_LB, KPH_KG))
    for one, other in zip(numbers(usual, "x"), numbers(metric, "x"), strict=True):
        np.testing.assert_allclose(other * KPH, one * MPH, rtol=1e-5)
    ends = [figure.layout.xaxis.range for figure in (usual, metric)]
    if ends[0] is not None:
        np.testing.assert_allclose(np.array(ends[1]) * KPH, np.array(ends[0]) * MPH, rtol=1e-6)
    if name == "conditions":
        for one, other in zip(numbers(usual, "y"), numbers(metric, "y"), strict=True):
            np.testing.assert_allclose(other, one * LB, rtol=1e-5)


def test_limits_are_the_same_converted(campaign: Campaign) -> None:
    """60 km/h is 37.28 mph: the point, its interval and the dashed line."""
    usual, metric = (FIGURES["record"](campaign, Display(system=system)) for system in (MPH_LB, KPH_KG))
    of_speed = [next(trace for trace in figure.data if trace.error_y.array is not None) for figure in (usual, metric)]
    np.testing.assert_allclose([of_speed[1].y[0], of_speed[0].y[0] * MPH / KPH], 55.0)
    np.testing.assert_allclose(of_speed[0].error_y.array[0] * MPH / KPH, 6.0)
    assert [round(figure.layout.shapes[0].y0, 2) for figure in (usual, metric)] == [37.28, 60.0]
    assert "at most 37.28 mph" in json.dumps(usual.to_plotly_json()["layout"], default=repr)


def numbers(figure: go.Figure, axis: str) -> Iterator[np.ndarray]:
    for trace in figure.data:
        values = trace[axis]
        if values is not None and len(values) and values[0] is not None:
            yield np.asarray(values, dtype=np.float64)
