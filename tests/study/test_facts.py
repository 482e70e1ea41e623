"""Facts of a campaign and of a condition: codes and values, in order, wherever a result is shown."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse.cae_library import QualityLimits, RunQuality
from crashfuse.campaign import Campaign
from crashfuse.certification.certify import certify
from crashfuse.results.export.outgoing_pulses import PulseExport, outgoing
from crashfuse.results.provenance import provenance
from crashfuse.signals.pulse import GRID_S
from crashfuse.study.config import StudyConfig
from crashfuse.study.facts import by_importance, campaign_facts, condition_facts, distinct, window_facts
from crashfuse.study.planning import next_test
from crashfuse.study.prediction import predict
from crashfuse.study.running import run_study
from crashfuse.units import MPH, G
from tests.conftest import not_none
from tests.study.test_outliers import at_one_speed


@pytest.fixture(scope="module")
def apart(campaign: Campaign) -> Campaign:
    """Four tests at 25 mph, of which S4 stands apart, and the others; one test is out of use, one CAE run fails."""
    group = at_one_speed(campaign, [1.0, 1.02, 0.98, 1.3]).tests
    others = tuple(test for test in campaign.tests if test.id not in ("T2", "T3"))  # at another speed
    bad = (RunQuality(hourglass_share=0.3), *[RunQuality(hourglass_share=0.01)] * (len(campaign.cae) - 1))
    return replace(
        campaign,
        tests=(*group, *others),
        cae=replace(campaign.cae, quality=bad),
        quality_limits=QualityLimits("house", hourglass_share=0.1),
        unused=(("T3", campaign.test("T3").condition),),
        why_unused={"T3": "no t0"},
        warnings=("tests.csv: T1 is odd.",),
        notice="Synthetic: simulated.",
    )


def test_facts_have_codes_and_values_in_the_order_of_their_importance(apart: Campaign) -> None:
    """What stands apart first, with its size; the notice last."""
    facts = campaign_facts(apart)
    codes = "test.stands_apart cae.runs_fail tests.left_out_of_use campaign.warning campaign.notice"
    assert [fact.code for fact in facts] == codes.split()
    assert by_importance(reversed(facts)) == facts
    assert distinct([*facts, *reversed(facts)]) == facts
    first, runs, unused, *_ = (fact.record for fact in facts)
    assert first["about"] == ["S4"]
    assert first["neighbours"] == ["S1", "S2", "S3"]
    assert first["speed_mps"] == apart.test("S4").condition.speed_mps
    assert float(str(first["differs_by_g"])) > float(str(first["others_differ_by_g"])) > 0
    assert float(str(first["best_rating"])) < float(str(first["lowest_rating_of_others"])) < 1
    assert (runs["failing"], runs["runs"]) == ([apart.cae.ids[0]], len(apart.cae))
    assert (unused["tests"], unused["reasons"]) == (["T3"], ["no t0"])


def test_a_condition_has_those_of_its_speed_and_what_is_extrapolated(apart: Campaign) -> None:
    """Where the tested speed nearest to it is that of the test that stands apart, and nowhere else."""
    at = apart.test("S4").condition
    apart_there, beyond = ["test.stands_apart"], ["condition.extrapolated"]
    for off_mph, expected in ((1.9, apart_there), (-4.0, apart_there), (-8.0, []), (60.0, beyond)):
        there = replace(at, speed_mps=at.speed_mps + off_mph * MPH)
        assert [fact.code for fact in condition_facts(apart, there)] == expected


def test_a_window_that_ends_before_the_peak_says_so(campaign: Campaign) -> None:
    """Of a triangle that peaks at 30 ms; the vehicle stops later, and what the window holds is not mentioned."""
    pulse = replace(campaign.tests[0].pulse, accel_mps2=-300.0 * np.interp(GRID_S, [0.0, 0.03, 0.06], [0.0, 1.0, 0.0]))
    test = replace(campaign.tests[0], pulse=pulse)
    (beyond,) = window_facts(test, 20.0)
    assert beyond.code == "test.beyond_window"
    assert beyond.values["peak_ms"] == pytest.approx(30.0, abs=0.1)
    assert beyond.values["ttzv_ms"] == pytest.approx(38.2, abs=5.0)
    assert beyond.sentence.endswith("stops at 20 ms, before the peak and zero velocity.")
    (later,) = window_facts(test, 31.0)
    assert "peak" not in later.sentence
    assert window_facts(test, 60.0) == ()


@pytest.mark.slow
def test_what_stands_apart_is_in_every_result(apart: Campaign, tmp_path: Path) -> None:
    """Report, record, notebook and exports of a study, a prediction and a certification."""
    config = StudyConfig(approaches=("cae", "displacement_domain"))
    criteria = [{"name": "peak", "metric": "peak", "at_most": 40}]
    matrix = pd.DataFrame([{"id": "M1", **apart.test("S1").condition.columns}])
    sentence = str(campaign_facts(apart)[0].sentence)
    for each in (
        run_study(apart, held_out=["T1"], config=config, workers=1),
        predict(apart, apart.test("S1").condition, ["cae", "displacement_domain"], config),
        certify(apart, criteria, matrix, approach="cae", config=config, workers=1),
    ):
        folder = tmp_path / type(each).__name__
        each.write(folder)
        text = (folder / "report.html").read_text(encoding="utf-8")
        (record,) = (json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json"))
        assert text[: text.index(sentence)].count("<h2") <= 1, "after the answer alone"
        known = json.loads(json.dumps(provenance(apart, (), config)["facts"]))
        assert record["facts"][: len(known)] == known
        assert sentence in each._repr_html_()
    folds = predict(apart, apart.test("S1").condition, "displacement_domain", config)
    assert "Displacement domain if it folds as S4" in (tmp_path / "PredictedPulse" / "report.html").read_text("utf-8")
    peak = folds.metrics.set_index("metric").loc["peak"]
    assert (peak["apart"], folds.metrics.columns[-1]) == ("S4", "of_pulse")
    (note,) = (note for note in folds.notes if "in two ways" in note)
    for way in ("others", "apart"):
        assert f"peak {peak[f'{way}_value']:.1f} g" in note
    by_fold = folds.preferred.by_fold.values()  # what is drawn has the peaks of the table, and goes out
    for way, own in zip(("others", "apart"), by_fold, strict=True):
        assert -own.representative_pulses()[0].min() / G == pytest.approx(peak[f"{way}_value"], rel=0.02)
    assert {"others", "apart"} < {pulse.which for pulse in outgoing(folds.estimates, 0, 0)}
    (repeat,) = next_test(apart, config=config).repeats
    assert repeat.startswith("Repeat S4 first (")
    drawn = folds.preferred
    of_apart = not_none(drawn.draws_mps2)[not_none(drawn.apart)].mean(axis=0)
    np.testing.assert_allclose(folds.pulses["apart_g"], of_apart / G, rtol=1e-4)
    assert "S4 stands apart" in (tmp_path / "Certification" / "certification.csv").read_text(encoding="utf-8")
    assert sentence in apart._repr_html_()
    prediction = predict(apart, apart.test("S1").condition, "cae", config)
    files = PulseExport(("isomme",)).files(apart, prediction.estimates)["isomme"]
    assert any(sentence.encode("ascii", "ignore")[:40] in content for content in files.values())
