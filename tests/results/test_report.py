"""The report holds what a reader who was not there needs, and stays light."""

import re
from dataclasses import replace

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from crashfuse.approaches.base import Prediction
from crashfuse.cae_library import NAMED_LIMITS, RunQuality
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError
from crashfuse.results.display import Display
from crashfuse.results.prediction import prediction_result
from crashfuse.results.render.figure_files import Report
from crashfuse.results.render.html import ReportOptions, report
from crashfuse.results.study import study_report
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.prediction import PredictedPulse
from crashfuse.study.recommendation import worst_test
from crashfuse.study.repeatability import Repeatability
from crashfuse.study.study import Fold, Study

CONFIG = StudyConfig(approaches=("cae",))


def estimate(test: CrashTest) -> Estimate:
    """The test itself, with 100 draws around it."""
    accel = test.pulse.accel_mps2
    prediction = Prediction(test.condition, accel, np.linspace(0.9, 1.1, 100)[:, None] * accel)
    return Estimate(**vars(prediction), approach="cae", seconds=0.1, left_out_mps2={test.id: accel})


def predicted(campaign: Campaign, test: CrashTest) -> PredictedPulse:
    return PredictedPulse(campaign, (estimate(test),), CONFIG)


@pytest.fixture(scope="module")
def study(campaign: Campaign) -> Study:
    folds = tuple(Fold.of(test, [estimate(test)], CONFIG.windows_ms) for test in campaign.tests[:2])
    return Study(campaign, CONFIG, folds)


@pytest.fixture(scope="module")
def text(study: Study) -> Report:
    return study_report(study)


def test_a_study_has_its_figures_and_every_part_a_certification_review_asks_for(text: Report) -> None:
    """Heat map, spread, calibration, bias by speed; motion and the same over displacement; the worst test's rating."""
    assert len(text.contents.figures) == 4 + 2 * 2 + 1
    assert text.count("by speed</h2>") == 1
    assert text.count("The same over displacement") == 2
    assert "T4 \\u00b7 35.0 mph" in text
    sections = ["result", "tables", "band", "data", "quality", "method", "bias", "limits", "origin"]
    assert re.findall(r"<section id=(\w+)><h2>", text) == sections
    assert re.findall(r"<section class=test><h2>Test (\w+): ", text) == ["T1", "T2"]


def test_a_study_says_what_repeats_would_rate(study: Study) -> None:
    """In a table by window, and in a sentence with each test: as a repeat only if any was run."""
    own = Repeatability(0.95, 0.91, 0.97, ("T9",))
    repeats = {"T1": {60.0: own}, "T2": {60.0: replace(own, value=1.0)}}
    text = study_report(replace(study, repeatability=repeats)).replace("\N{NO-BREAK SPACE}", " ")
    assert "<h2>How well tests repeat" in text
    assert re.search(r"<td>T1</td><td>–</td><td>–</td><td>0.950 \[0.91, 0.97\]</td><td>T9</td>", text)
    repeat = "By T9, a repeat of this test rates 0.950 [0.91, 0.97] (95 %)"
    assert f"{repeat}. The prediction&#39;s 1.000 (CAE) is above" in text
    assert "How well tests repeat" not in study_report(study)
    estimated = study_report(replace(study, repeatability={"T1": {60.0: replace(own, repeats=())}}))
    assert [text in estimated for text in ("No repeat of this test was run.", "what repeats reach")] == [True, False]


def test_a_study_of_one_test_tells_its_recommendation_once(study: Study) -> None:
    text = study_report(replace(study, folds=study.folds[:1]), Display(window_ms=20.0))
    assert text.partition("<script type=")[0].count("Use the ") == 1
    assert "Recommended before it was run" not in text
    assert "<h3>The test itself</h3>" in text


def test_a_study_says_why_each_test_is_rated_as_it_is_and_draws_it_for_the_worst(text: Report, study: Study) -> None:
    assert text.count("<h3>Why it is rated as it is") == 2
    assert text.count("over 0–60 ms: nothing is lost.") == 2
    worst = text.partition("<h3>The worst test</h3>")[2].partition("</section>")[0]
    assert re.search(rf"<p>We left out {worst_test(study).test.id} \(.* mph\) and rated it over 0–60 ms. ", worst)
    assert "it takes 3 to tell whether a test stands apart." in worst
    assert text.count("b>Magnitude 1.000") == 1  # the title of a row of its figure


def test_a_study_says_whether_the_cae_model_is_fit_to_be_believed(study: Study, text: Report) -> None:
    heading = "<h2>Is the CAE model fit to be believed?</h2>"
    assert f"{heading}\n<p>Energy balance, hourglass energy and added mass are not recorded for any of the 24" in text
    quality = (RunQuality(-0.02, 0.12, 0.01), *(RunQuality(-0.02, 0.01),) * 23)
    campaign = replace(study.campaign, cae=replace(study.campaign.cae, quality=quality))
    judged = replace(campaign, quality_limits=NAMED_LIMITS["euro-ncap-vt-2025"])
    told = study_report(replace(study, campaign=judged)).partition(heading)[2].partition("</section>")[0]
    assert "0 of 24 pass, 1 fail; 23 cannot be judged" in told
    assert "Runs that fail: C00 (hourglass energy 12 %)." in told
    assert "<td>Hourglass energy, largest</td><td>largest internal energy</td><td>&lt; 10</td><td>23</td>" in told


@pytest.mark.slow
def test_the_best_rating_of_each_window_is_bold(study: Study) -> None:
    config = StudyConfig(approaches=("cae", "fused"), windows_ms=(20.0, 60.0))
    folds = []
    for test in study.campaign.tests[:2]:
        exact = estimate(test)
        weaker = replace(exact, accel_mps2=0.9 * test.pulse.accel_mps2)
        folds.append(Fold.of(test, [weaker, replace(exact, approach="fused")], config.windows_ms))
    text = study_report(Study(study.campaign, config, tuple(folds)))
    ratings = folds[0].ratings["cae"]
    assert "<tr><td>Fused</td><td><b>1.000</b></td><td><b>1.000</b></td></tr>" in text
    assert f"<tr><td>CAE</td><td>{ratings[20.0].overall:.3f}</td><td>{ratings[60.0].overall:.3f}</td></tr>" in text


def test_accelerations_that_the_command_would_write_otherwise_are_said_to_be(study: Study, text: Report) -> None:
    """Beside the command, in every form of a report; it has no options for their unit and sign."""
    shown = Display(unit="m/s²", deceleration=True)
    said = "Shown in m/s², braking positive; files"
    for own in (
        study_report(study, shown),
        study_report(study, shown, ReportOptions("short")),
        report(prediction_result(PredictedPulse(study.campaign, study.folds[0].estimates, CONFIG)), shown),
    ):
        assert said in own
    assert "Shown in g, braking positive;" in study_report(study, Display(deceleration=True))
    assert "Shown in " not in text


def test_speed_groups_are_shown_beside_where_they_were_left_out(study: Study) -> None:
    """With their own ratings."""
    weaker = replace(estimate(study.folds[1].test), accel_mps2=0.8 * study.folds[1].test.pulse.accel_mps2)
    folds = (study.folds[0], Fold.of(study.folds[1].test, [weaker], CONFIG.windows_ms))
    both = study_report(replace(study, speed_groups=(groups := replace(study, folds=folds))))
    alone, _, grouped = both.partition("<h2>A whole speed group left out")
    mean = f"<b>{groups.mean_rating('cae', 60.0):.3f}"
    assert mean in grouped.partition("</section>")[0]
    assert mean not in alone
    assert len(both.contents.figures) == len(study_report(study).contents.figures) + 1


def test_a_report_is_light_and_equal_for_equal_results(study: Study, text: Report) -> None:
    """Below 150 kB a figure but for Plotly itself; a review can compare reports, however long they took."""
    assert len(text) - len(get_plotlyjs()) < 150_000 * len(text.contents.figures)
    assert study_report(replace(study, seconds={"prepare": 7.0})) == text


def test_a_prediction_is_shown_without_a_test(campaign: Campaign) -> None:
    """Nothing was measured there; what may be expected, the nearest tests and the bias of the tests stand."""
    text = report(prediction_result(predicted(campaign, campaign.tests[0])))
    assert len(text.contents.figures) == 3
    assert '"name":"Test"' not in text
    assert "by speed</h2>" in text
    assert "We expect a rating of 1.00 over 0–60 ms (80 %, Excellent)" in text
    assert "Nearest tests by speed and weights: T1 (0.0 mph" in text
    assert "crashfuse predict CAMPAIGN --out DIR --speed-mph 15 " in text


def test_a_short_report_of_a_prediction_has_what_one_decides_by(campaign: Campaign) -> None:
    here, other = campaign.tests[:2]
    beside = [predicted(campaign, other)]
    text = report(prediction_result(predicted(campaign, here), beside, "short"))
    assert len(text.contents.figures) == 2
    for kept in ("We expect a rating", "Pulse metric", "Beside other predictions", "Limits</h2>", "--speed-mph 15 "):
        assert kept in text
    for left in ("Data: ", "Method and settings", "by speed</h2>", "Over displacement", "How the fit went"):
        assert left not in text
    assert text.index("<th>Pulse metric") < text.index("Beside other predictions") < text.index("Limits</h2>")
    whole = report(prediction_result(predicted(campaign, here), beside))
    assert whole.count('<table class="metrics"') == text.count('<table class="metrics"') == 2
    assert whole.index("<th>Pulse metric") < whole.index("Beside other predictions") < whole.index("Over displacement")
    with pytest.raises(UsageError, match="whole"):
        prediction_result(predicted(campaign, here), form="brief")  # type: ignore[arg-type]


def test_many_pinned_predictions_make_no_table_wider_than_paper(campaign: Campaign) -> None:
    first = estimate(campaign.tests[0])
    speeds = [replace(first.condition, speed_mps=speed_mps) for speed_mps in (8.0, 9.0, 10.0, 11.0)]
    moved = (replace(first, condition=at) for at in speeds)
    pinned = [PredictedPulse(campaign, (each,), CONFIG) for each in moved]
    text = report(prediction_result(predicted(campaign, campaign.tests[0]), pinned, "short"))
    told = text[text.index("Beside other predictions") :]
    assert [head.count(" − ") for head in re.findall(r"<thead>(.*?)</thead>", told)] == [2, 2]
    assert told.count('<table class="metrics"') == 2  # whose cells no line cuts


@pytest.mark.slow
def test_a_short_report_has_the_result_and_the_worst_test_alone(study: Study) -> None:
    """Heat map and one test's pulses; data, method and the other tests are in the whole one."""
    test = study.campaign.tests[1]
    weaker = replace(estimate(test), accel_mps2=0.8 * test.pulse.accel_mps2)
    folds = (study.folds[0], Fold.of(test, [weaker], CONFIG.windows_ms))
    short = study_report(replace(study, folds=folds), options=ReportOptions("short"))
    assert len(short.contents.figures) == 2
    assert "<h2>Test T2: " in short
    assert "<h2>Test T1: " not in short
    assert "The worst test" in short
    assert "Method and settings" not in short
    assert short.index("Pulse metric, T2") < short.index("Pulses over time")  # so that no page ends early


def test_a_report_shows_chosen_tests_in_the_units_and_the_window_of_the_page(study: Study) -> None:
    """Means are over all tests; figures rate the window; what was not left out cannot be shown."""
    display = Display(window_ms=20.0, unit="m/s²")
    text = study_report(study, display, ReportOptions(tests=("T2",)))
    assert "<h2>Test T2: " in text
    assert "<h2>Test T1: " not in text
    assert "Every held-out test, 0–20 ms" in text
    assert " mph) and rated it over 0–20 ms." in text  # the worst test
    assert "With\n2 tests, no more than this can be promised." in text
    pulses = next(figure.drawn for figure in text.contents.figures if figure.title.endswith("Pulses over time"))
    assert pulses["layout"]["yaxis"]["title"]["text"] == "Acceleration (m/s²)"
    assert "rated: 0–20 ms" in [note["text"] for note in pulses["layout"]["annotations"]]
    with pytest.raises(UsageError, match="T4"):
        study_report(study, options=ReportOptions(tests=("T4",)))


def test_what_users_typed_stands_in_the_report_as_text(study: Study) -> None:
    notes = (Note("T1", "<img src=x onerror=alert(1)> barrier & face", 12.0, 20.0), Note("T4", "not left out"))
    named = replace(study, campaign=replace(study.campaign, name="<script>alert(1)</script>"))
    text = study_report(named, options=ReportOptions(notes=notes))
    assert "<img" not in text
    assert "12–20 ms</td><td>&lt;img src=x onerror=alert(1)&gt; barrier &amp; face</td>" in text
    assert "not left out" not in text
    assert "<h1>&lt;script&gt;alert(1)&lt;/script&gt;: study" in text
    assert "<script>alert(1)" not in text
    assert "<h2>Notes" not in study_report(study)
