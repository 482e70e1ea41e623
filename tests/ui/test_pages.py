"""Every page in every state, driven through app.py without a browser."""

import io
import json
import re
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import streamlit as st

from crashfuse.approaches.base import Approach, FittedState, Prediction
from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.execution.jobs import Job
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.run import UNKEPT, Run
from crashfuse.results.drawing import drawing_of
from crashfuse.results.result import Result
from crashfuse.results.study import study_files
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.learning_curve import learning_curve
from crashfuse.study.saved_models import load_model
from crashfuse.study.study import Fold, Study
from crashfuse.ui import study
from crashfuse.ui.kit import computation
from crashfuse.ui.kit.figures import SentFigure
from crashfuse.units import LB, MPH, G
from tests.conftest import not_none
from tests.ui.conftest import SOON, Session, as_read, begin

pytestmark = pytest.mark.usefixtures("open_campaign")

FAST = ("cae", "lf_tcn")
BIAS = {"points": 300, "bias_rms_g": 7.25, "log_marginal_likelihood": -12.3, "dead": False, "retries": 0}
SPREAD = {name: {"shared, standard deviation": to} for name, to in (("hyperparameters", 0.7), ("spread_factors", 1.5))}
FITS: dict[str, dict[str, object]] = {"displacement_domain": {**BIAS, **SPREAD, "touched_bounds": []}}


def predict(campaign: Campaign, condition: Condition, scale: float = 1.0) -> Prediction:
    """The CAE run nearest in speed, with draws around it."""
    nearest = np.abs(campaign.cae.vectors[:, 0] - condition.speed_mps).argmin()
    accel = scale * campaign.cae.accel_mps2[nearest].astype(float)
    draws = accel * np.linspace(0.9, 1.1, 21)[:, None]
    return Prediction(condition, accel, draws, ("Made for a test.",))


def quick_study(
    campaign: Campaign, config: StudyConfig, *, held_out: tuple[str, ...], watch: Watch = SILENT, **_: object
) -> Study:
    """A study that takes no time; speed groups are predicted worse."""
    folds, scale = [], 0.9 if config.leave_out == "speed group" else 1.0
    for test_id in held_out:
        test = campaign.test(test_id)
        prediction = predict(campaign, test.condition, scale)
        estimates = tuple(
            Estimate(**vars(prediction), approach=name, state=FITS.get(name, {}), seconds=0.1)
            for name in config.approaches
        )
        folds.append(Fold.of(test, estimates, config.windows_ms))
        watch.report("Held-out predictions", len(folds), len(held_out), loss=0.1)
    study = Study(campaign, config, tuple(folds), {"held_out_tests": 1.0})
    if config.leave_out != "both":
        return study
    groups = quick_study(campaign, replace(config, leave_out="speed group"), held_out=held_out)
    return replace(study, speed_groups=groups)


@pytest.fixture
def nothing_cached(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """The cache on disk holds no prediction; returns the patch for more of its kind."""
    monkeypatch.setattr(computation, "is_estimate_cached", lambda *_: False)
    return monkeypatch


@pytest.fixture
def studies_are_quick(nothing_cached: pytest.MonkeyPatch) -> None:
    nothing_cached.setattr(computation, "run_study", quick_study)


@pytest.fixture
def gate(nothing_cached: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Studies report 3 of 10 and then wait until this opens."""
    event = threading.Event()

    def slow(campaign: Campaign, config: StudyConfig, *, held_out: tuple[str, ...], watch: Watch, **_: object) -> Study:
        for i in range(4):
            watch.report("LF TCN", i, 10, loss=1.0 / (i + 1))
        while not event.wait(0.01):
            watch.report("LF TCN", 3, 10)
        return quick_study(campaign, config, held_out=held_out)

    nothing_cached.setattr(computation, "run_study", slow)
    yield event
    event.set()


WITHOUT = "Train without them"
start = partial(begin, test="T1")
"""Begin a session on a page, with the first test held out."""


def rated(session: Session) -> list[str]:
    row = [group.options for group in session.app.button_group if group.key == "explained"]
    return [re.sub(r"^:\S+ | \*\*.*", "", option) for options in row for option in options]


def running(until: Callable[[Job[Any]], object]) -> Job[Any]:
    """The job that runs, once it has come so far."""
    (job,) = computation.jobs().active
    while not until(job):
        assert job.active
    return job


@pytest.mark.usefixtures("gate")
def test_training_shows_progress_and_can_be_cancelled() -> None:
    """Step, count and a way out; then a word on what is kept."""
    session = start("train")
    session.press(WITHOUT)
    job = running(lambda job: "LF TCN" in job.steps and job.steps["LF TCN"].progress.done == 3)
    assert "LF TCN: 3 of 10" in session.run().words
    assert session.charts == 1
    drawn = json.loads(session.app.get("plotly_chart")[0].proto.spec)
    assert drawn["data"] == SentFigure(drawing_of(job.steps["LF TCN"].plot())).to_dict()["data"]
    assert [drawn["layout"][axis]["title"]["text"] for axis in ("xaxis", "yaxis")] == ["Step", "Loss"]
    session.press("Cancel")
    assert job.wait(SOON)
    assert "Cancelled" in session.run().words


@pytest.mark.slow
def test_a_second_session_joins_the_job_of_the_first(gate: threading.Event) -> None:
    """The same study is not computed twice; leaving the page changes nothing."""
    first = start("train").press(WITHOUT)
    first.go("data")
    second = start("train")
    assert len(computation.jobs().active) == 1
    assert WITHOUT not in second.buttons
    assert "Cancel" not in second.buttons
    second.press("I want it, too")
    assert "Cancel" in second.buttons
    gate.set()
    second.finish()
    assert "Rated, T1" in second.words
    assert "Rated, T1" in first.go("train").words


@pytest.mark.usefixtures("nothing_cached")
@pytest.mark.slow
def test_the_settings_reach_the_study_and_hold_on_other_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Approaches, preset and seed are those that were chosen; Compare asks for the same."""
    asked: list[StudyConfig] = []

    def remember(campaign: Campaign, config: StudyConfig, *, held_out: tuple[str, ...], **_: object) -> Study:
        asked.append(config)
        return quick_study(campaign, config, held_out=held_out)

    monkeypatch.setattr(computation, "run_study", remember)
    session = start("train")
    session.app.button_group(key="approaches").set_value(list(FAST)).run()
    session.app.radio(key="preset").set_value("paper").run()
    assert "many hours" in session.words
    session.app.number_input(key="seed").set_value(7).run()
    session.app.radio(key="device").set_value("cpu").run()
    session.press(WITHOUT).finish()
    assert asked == [StudyConfig(approaches=FAST, preset="paper", seed=7, device="cpu")]
    assert session.go("compare").charts == 1
    assert len(asked) == 1


@pytest.mark.slow
def test_fitting_on_all_tests_hands_out_models_and_predict_answers_at_once(
    open_campaign: Path, tmp_path: Path, fitting_is_an_error: Callable[[], None]
) -> None:
    """What ``crashfuse train`` does: the file predicts what the page Predict shows, and nothing is fitted again."""
    session = start("train")
    session.app.button_group(key="approaches").set_value(["cae"]).run()
    session.press("Train on all tests").finish()
    assert "Train on all tests" not in session.buttons  # there is nothing left to start
    campaign = load_campaign(open_campaign)
    assert f"Learned from {len(campaign.tests)} tests and {len(campaign.cae)} CAE runs." in session.words
    assert session.press("Export").downloads == ["models.zip"]
    fitting_is_an_error()
    job = computation.fit_request(campaign, StudyConfig(approaches=("cae",), leave_out="speed group")).find()
    assert job is not None
    assert job.result is not None
    with zipfile.ZipFile(io.BytesIO(job.result.models(campaign))) as archive:
        file = archive.extract("cae.safetensors", tmp_path)
    session.go("predict")
    speed, front, rear = (float(field.value or 0) for field in session.app.number_input[:3])
    condition = Condition.of_vector([speed * MPH, front * LB, rear * LB])
    pulse = load_model(file, campaign).approach.predict(condition).accel_mps2
    shown = session.open_tab("predict", "Metrics").tables[0].set_index("Pulse metric")["CAE"]
    assert shown["Peak deceleration (g)"] == f"{-pulse.min() / G:.1f}"


@pytest.mark.usefixtures("studies_are_quick")
def test_two_sessions_that_look_for_a_cached_result_at_once_both_find_it(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:

    def slow(*_: object) -> bool:
        time.sleep(0.3)
        return True

    monkeypatch.setattr(computation, "is_estimate_cached", slow)
    request = computation.study_request(campaign, ("T1",), StudyConfig(approaches=("cae",)))
    with ThreadPoolExecutor(2) as sessions:
        first, second = sessions.map(lambda _: request.find(), range(2))
    assert first is second
    assert first is not None
    assert first.state == "done"


@pytest.mark.usefixtures("studies_are_quick")
@pytest.mark.slow
def test_compare_starts_the_prediction_and_shows_it(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the empty state to figure, ratings, metrics, notes and files by one button."""
    session = start("compare")
    assert "not been predicted yet" in session.words
    session.press("Predict test T1").finish()
    assert session.charts == 1
    assert rated(session) == list(LABELS.values())
    assert not session.tables  # only the open tab is computed
    ratings, metrics, more, fit = session.open_tab("compare", "Ratings and metrics").tables
    assert not session.charts
    expected = quick_study(campaign, StudyConfig(), held_out=("T1",)).folds[0].ratings["cae"]
    assert ratings["0–20 ms"][0] == f"{expected[20.0].overall:.3f} {expected[20.0].grade}"
    assert ratings["Slope"][0] == f"{expected[60.0].slope:.3f}"
    assert metrics.columns[:2].tolist() == ["Pulse metric, T1", "Measured"]
    assert "[" in metrics["Fused"][0]
    assert "Displacement domain" not in metrics
    assert more["Pulse metric, T1"].iloc[0] == "Equivalent square wave (g)"
    assert "scores and single draws over 0–60 ms" in session.words
    assert "Made for a test." in session.words
    assert "Fitted to 300 points of a bias of 7.2 g RMS" in session.words
    assert fit["Known to a factor of"].tolist() == ["1.50"]
    assert session.press("Export").downloads == [
        *("scores.csv", "pulses.csv", "metrics.csv", "cae_events.csv", "study.json", "report.html", "report.pptx"),
        "fused-15mph-lsdyna.zip",
    ]
    taken: list[Result] = []
    monkeypatch.setattr("crashfuse.ui.compare.offer_result", lambda result, *_: taken.append(result))
    session.app.selectbox(key="window").select(20.0).run()
    session.press("Export")
    assert taken[-1].values["window"] == "0–20 ms"


@pytest.mark.slow
def test_what_needs_no_network_is_shown_while_the_networks_train(nothing_cached: pytest.MonkeyPatch) -> None:
    """Compare draws and rates what is known, names the rest, and has no report of half a study; Train links to it."""
    trained = threading.Event()

    def in_two_parts(
        campaign: Campaign, config: StudyConfig, *, held_out: tuple[str, ...], watch: Watch, **_: object
    ) -> Study:
        early = replace(config, approaches=("cae", "displacement_domain"))
        watch.show_part(quick_study(campaign, early, held_out=held_out))
        while not trained.wait(0.01):
            watch.report("Training LF TCN", 3, 10)
        return quick_study(campaign, config, held_out=held_out)

    nothing_cached.setattr(computation, "run_study", in_two_parts)
    session = start("compare").press("Predict test T1")
    job = running(lambda job: job.part is not None and job.steps)  # shown, and then reported
    assert rated(session.run()) == ["CAE", "Displacement domain"]
    assert "LF TCN, Time domain, Fused: still training" in session.words
    assert "Training LF TCN: 3 of 10" in session.words
    assert "T1 left out" not in session.words  # how good an approach is that happens to be known first
    parts = ["scores.csv", "pulses.csv", "metrics.csv", "cae_events.csv", "study.json"]
    assert session.press("Export").downloads == parts  # and no report
    session.go("train")
    assert "Rated, T1." in session.words
    assert "Compare T1" in session.buttons
    trained.set()
    assert job.wait(SOON)
    session.go("compare")
    assert rated(session) == list(LABELS.values())
    assert "still training" not in session.words
    assert re.search(r"T1 left out:\*\* 0\.\d{3} \w+", session.words)


CURVE = {"epoch": [1, 2], "train_loss": [1.0, 0.1], "validation_loss": [1.1, 0.2]}
NETWORK = {"members": 4, "weights": 54433, "learning_curve": CURVE}
RMSE = {"rmse": {"0.02": 0.1, "0.06": 0.2}, "left_out_rmse": {"0.02": 0.3, "0.06": 0.4}}
BY_STRENGTH = {"penalty": 0.02, "left_out_delta_v_misfit": 0.02, **RMSE}
BY_ADAM = {"tuning_curve": {"epoch": [1, 2], "train_loss": [1.0, 0.1]}}


@pytest.mark.usefixtures("studies_are_quick")
@pytest.mark.parametrize(
    ("state", "n_charts"),
    [({**NETWORK, **BY_STRENGTH}, 2), ({**NETWORK, **BY_ADAM}, 2), ({**NETWORK, "members": 1}, 1)],
)
@pytest.mark.slow
def test_compare_shows_the_networks_before_and_after_the_tests_and_how_they_learned(
    state: dict[str, object], n_charts: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Figs. 12 and 13 in one; the learning curves by either way to fine-tune, or of the CAE runs alone."""
    monkeypatch.setitem(FITS, "lf_tcn", NETWORK)
    monkeypatch.setitem(FITS, "time_domain", state)
    session = start("train").open_tab("train", "Diagnostics").press("Train without T1").finish()
    assert session.charts == 1 + n_charts
    assert "Training on CAE runs" in session.words


@pytest.mark.usefixtures("studies_are_quick")
@pytest.mark.slow
def test_the_study_holds_every_test_out(campaign: Campaign) -> None:
    """Alone and by speed group: means, heat maps, the paper's tables, spread, calibration, and files."""
    session = start("study")
    assert not session.app.get("plotly_chart")
    session.press("Leave out each of 4 tests").finish()
    assert session.charts == 1
    (heat_map,) = session.app.get("plotly_chart")
    as_streamlit_sets_it = {"clickmode": "event+select", "hovermode": "closest"}  # else drawn, set and drawn again
    assert json.loads(heat_map.proto.spec)["layout"].items() >= as_streamlit_sets_it.items()
    assert "for this campaign" in session.words
    study = quick_study(campaign, StudyConfig(leave_out="both"), held_out=campaign.test_ids)
    for line, view in enumerate(views := (study, not_none(study.speed_groups))):
        quality, means = session.tables  # a line a view, of the approach that it recommends
        approach = {label: name for name, label in LABELS.items()}[quality["Approach"][line]]
        rated = {fold.held_out: fold.ratings[approach][60.0].overall for fold in view.folds}
        assert quality["Mean"][line].startswith(f"{view.mean_rating(approach, 60.0):.3f} ")
        assert quality["Worst"][line].startswith(f"{min(rated.values()):.3f} ")
        assert rated[quality["Worst test"][line]] == min(rated.values())
        assert means["0–60 ms"][0].startswith(f"{view.mean_rating('cae', 60.0):.3f} ")
        shown = [own for view in views for own in view.scores["overall"]]  # sentences are made of the rows below them
        shown += [view.mean_rating(name, 60.0) for view in views for name in view.config.approaches]
        assert {*re.findall(r"\b[01]\.\d{3}\b", session.words)} <= {f"{rating:.3f}" for rating in shown}
        session.app.button_group(key="ways").set_value("With all tests at about its speed").run()
    session.app.selectbox(key="window").select(20.0).run()
    assert "Ratings over 0–20 ms." in session.words
    assert session.tables[0]["Mean"][0].startswith(f"{study.mean_rating(approach, 20.0):.3f} ")
    session.open_tab("study", "Bands")
    assert session.charts == 2
    assert session.tables[0]["Maximum crush"][0].endswith(f" of {len(study.folds)}")
    assert "no more can be promised" in session.words
    session.press("Export")
    assert session.downloads == [*study_files(study), "report.html", "report.pptx"]


@pytest.mark.slow
def test_the_study_tells_how_many_tests_are_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside leaving tests out: sentences, a figure, tables and files; with the cost of a test, what a gain costs."""
    quick = StudyConfig(approaches=("cae", "displacement_domain"), windows_ms=(60.0,))
    monkeypatch.setattr(study, "CURVE_CONFIG", quick)
    monkeypatch.setattr("crashfuse.ui.kit.computation.learning_curve", partial(learning_curve, workers=1, repeats=1))
    session = start("study")
    session.open_tab("study", "Number of tests")
    assert re.search(r"On this machine now: \d+ to \d+ (s|min)\.", session.words)
    session.press("Predict from 1 to 3 tests").finish()
    assert session.charts == 1
    assert "With 3 of 4 tests the displacement domain rates" in session.words
    (steps,) = session.tables
    session.press("Export")
    assert session.downloads == ["learning_curve.csv", "learning_curve.json", "report.html", "report.pptx"]
    assert steps["Tests"].tolist() == ["1 → 2", "2 → 3"]
    assert "Cost of 0.01" not in steps
    session.app.number_input(key="cost").set_value(60000.0).run()
    assert re.fullmatch(r"[\d,]+", session.tables[0]["Cost of 0.01"][0])


@pytest.mark.parametrize("page", ["data", "compare"])
@pytest.mark.slow
def test_a_page_on_one_test_says_that_it_lies_outside_the_cae_runs(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CaeLibrary, "extrapolation", lambda *_: ("Extrapolation: made for a test.",))
    told = "".join(caption.value for caption in start(page).app.sidebar.caption)
    assert "Extrapolation: made for a test." in told.replace("\\", "")


class Quick(Approach):
    """An approach that takes no time."""

    name, label = "cae", "CAE"

    def fit(self, campaign: Campaign, run: Run = UNKEPT) -> "Quick":
        run.watch.report("Fit", 1, 1)
        self.campaign_ = campaign
        return self

    def learned(self) -> FittedState:
        return FittedState({}, {})

    def restore(self, campaign: Campaign, learned: FittedState, run: Run = UNKEPT) -> "Quick":  # noqa: ARG002
        return self.fit(campaign, run)

    def predict(self, condition: Condition) -> Prediction:
        """Predict the nearest run."""
        return predict(self.campaign_, condition)


@pytest.mark.slow
def test_a_new_condition_is_predicted_and_extrapolation_is_flagged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once fitted, another speed is answered without fitting again."""
    fits: list[str] = []

    def create(name: str, **_: object) -> Approach:
        fits.append(name)
        return Quick()

    monkeypatch.setattr("crashfuse.study.config.create", create)
    session = start("predict")
    session.press("Predict").finish()
    assert session.charts == 1
    assert "Extrapolation" not in session.words
    count = len(fits)
    session.fill({"Impact speed (mph)": 60.0})
    assert "Extrapolation: speed 60.0 mph lies outside" in session.words
    session.fill({"Impact speed (mph)": 600.0})  # the field itself would refuse it, and leave what was predicted before
    assert re.search(r"Impact speed \(mph\) is from [\d.]+ to 70 here, not 600: 70 is taken", session.words)
    assert "Extrapolation: speed 70.0 mph lies outside" in session.words
    assert "lb in all" in session.words
    assert session.field("Drive").options == ["FWD"]
    session.fill({"Drive": "FWD"})
    assert session.charts == 1
    assert len(fits) == count


@pytest.mark.slow
def test_predict_answers_without_networks_while_these_train(monkeypatch: pytest.MonkeyPatch) -> None:
    """The displacement domain is drawn first, with no recommendation, report or sweep of half the approaches."""
    trained = threading.Event()

    def create(name: str, **_: object) -> Approach:
        def fit(self: Quick, campaign: Campaign, run: Run = UNKEPT) -> Quick:
            while CLASSES[name].trains_networks and not trained.wait(0.01):
                run.watch.report("Training LF TCN", 3, 10)
            return Quick.fit(self, campaign, run)

        own = {"name": name, "label": LABELS[name], "fit": fit, "__module__": __name__}
        named: type[Quick] = type("Named", (Quick,), own)
        return named()

    monkeypatch.setattr("crashfuse.study.config.create", create)
    session = start("predict").press("Predict")
    job = running(lambda job: job.part is not None and len(job.part.fits) >= 2)
    assert session.run().charts == 1
    assert "LF TCN, Time domain, Fused: still training" in session.words
    assert "Use " not in session.words
    assert "Pin this prediction" not in session.buttons
    assert "report.html" not in session.press("Export").downloads
    assert "once every approach is fitted" in session.open_tab("predict", "Over speed").words
    trained.set()
    assert job.wait(SOON)
    assert "still training" not in session.run().words
    assert "Use the fused" in session.words
    assert "Predict over speed" in session.buttons


def test_the_tests_chosen_on_train_are_in_the_link() -> None:
    """At first the one of the other pages, which the list follows until another is chosen; an unknown one is said."""
    session = start("train")

    def chosen() -> list[str]:
        return list(session.app.multiselect(key="held_out").value)

    def hold_out(test: str) -> None:
        session.go("compare").app.sidebar.selectbox(key="test in mph-lb").select(test).run()
        session.go("train")

    first = session.app.session_state["test"]
    assert chosen() == [first]
    assert "Held-out test" not in [box.label for box in session.app.sidebar.selectbox]  # one place is enough
    other = next(test for test in ("T1", "T2") if test != first)
    hold_out(other)
    assert chosen() == [other]
    session.app.multiselect(key="held_out").set_value(["T4", "T2"]).run()
    session.run()
    assert session.app.query_params["held_out"] == ["T4", "T2"]
    hold_out("T3")
    assert chosen() == ["T4", "T2"]
    linked = begin("train", held_out=["T4", "T99"])
    assert list(linked.app.multiselect(key="held_out").value) == ["T4"]
    assert "No test here is named T99" in linked.words


@pytest.mark.slow
def test_a_real_prediction_appears_and_a_new_server_finds_it_in_the_cache() -> None:
    """The raw CAE, end to end, with nothing replaced; a restart costs nothing."""
    session = start("train")
    session.app.button_group(key="approaches").set_value(["cae"]).run()
    session.press(WITHOUT).finish()
    assert "Rated, T1" in session.words
    assert session.go("compare").charts == 1
    shown = session.open_tab("compare", "Ratings and metrics").tables[0]
    st.cache_resource.clear()
    later = start("train")
    later.app.button_group(key="approaches").set_value(["cae"]).run()
    later.go("compare").open_tab("compare", "Ratings and metrics")
    pd.testing.assert_frame_equal(later.tables[0], shown)


@pytest.mark.slow
def test_what_cannot_be_computed_is_told_by_its_job(monkeypatch: pytest.MonkeyPatch) -> None:
    """A device that has gone since it was chosen: each page opens, and the job says what is wrong."""

    def gone(*_: object, **__: object) -> Approach:
        raise UsageError("There is no CUDA device.")

    monkeypatch.setattr("crashfuse.study.config.create", gone)
    session = start("compare")
    session.press("Predict test T1").finish()
    assert as_read(session.app.error[0].value) == "There is no CUDA device."
    assert "Predict test T1" in session.buttons  # to try again
    for page in ("train", "study", "predict"):
        session.go(page)


@pytest.mark.parametrize("page", ["compare", "study", "predict"])
def test_a_seed_that_there_is_not_starts_nothing(page: str) -> None:
    """Train lets one type it and says so; elsewhere nothing that can only fail is offered."""
    session = start("train").fill({"Seed": -1})
    assert "There is no seed -1: it is from 0 to 4294967295." in session.go(page).words
    assert not [button for button in session.app.button if button.label.startswith(("Predict", "Leave out"))]
