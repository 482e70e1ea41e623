"""What is chosen for figures of pulses: any link is harmless, and a choice outlasts what a page offers."""

from collections.abc import Callable
from pathlib import Path

import pytest

from crashfuse.campaign_folder.load import load_campaign
from crashfuse.study.config import StudyConfig
from crashfuse.study.history import PastResult, keep
from tests.ui.conftest import Session

Visit = Callable[..., Session]
ONE = {"campaign": "campaign", "approaches": "cae"}


def predicted(session: Session, test: str) -> Session:
    """The page once the test is predicted."""
    return session.press(f"Predict test {test}").finish()


@pytest.mark.usefixtures("open_campaign")
def test_a_link_may_ask_for_anything(visit: Visit) -> None:
    """Unknown curves, tests, runs and conditions are passed over; what is known is shown, and labelled in full."""
    session = visit("compare", **ONE, test="T2", band="magic", also=["T9", "T3", "cae:C00", "cae:none", "at:1mph"])
    predicted(session, "T2")
    session.app.session_state["pins"] = ["30mph 2000lb 1500lb", "0mph 1lb", "🚗"]
    session.run()
    (also,) = [each for each in session.app.multiselect if each.label == "Also show"]
    assert also.value == ["T3", "cae:C00"]
    assert "T3 · 26.0 mph" in also.options
    assert any(option.startswith("CAE run C00 · ") for option in also.options)
    assert [option for option in also.options if " at 30.0 mph" in option] == ["CAE at 30.0 mph, 2000 + 1500 lb"]
    assert not any(option.startswith("T2") for option in also.options)  # it is there already


@pytest.mark.usefixtures("open_campaign")
def test_the_nearest_tests_are_those_of_this_speed_first(visit: Visit) -> None:
    """T3 is one mile per hour from T2; a choice made for one test is kept for another."""
    session = visit("compare", **ONE, test="T2")
    predicted(session, "T2").press("Nearest tests")
    assert session.app.session_state["also"][0] == "T3"
    assert sorted(session.app.session_state["also"]) == ["T1", "T3", "T4"]
    session.app.session_state["test"] = "T3"
    predicted(session.run(), "T3")
    (also,) = [each for each in session.app.multiselect if each.label == "Also show"]
    assert also.value == ["T1", "T4"]
    assert "T3" in session.app.session_state["also"]


@pytest.mark.usefixtures("open_campaign")
def test_hiding_every_curve_is_possible_and_said(visit: Visit) -> None:
    """An empty figure would look like an error."""
    session = visit("compare", **ONE, test="T2")
    predicted(session, "T2")
    session.app.session_state["curves"] = []
    session.run()
    assert "No curve is chosen." in session.words


def test_the_history_needs_no_campaign_and_compares_what_it_can(visit: Visit, tmp_path: Path) -> None:
    """Before anything was computed it says so; two studies without a common test say that."""
    assert tmp_path
    assert "Nothing was computed on this machine yet" in visit("history").words
    for test, campaign in (("T1", "![a](b)"), ("T2", "other")):
        ratings = {test: {"cae": {60.0: 0.5}}}
        keep(PastResult(campaign, campaign, StudyConfig(), "ISO", "cae", "2030-01-01T00:00:00+00:00", ratings))
    session = visit("history")
    assert "no rating in common" in session.words
    (listed,) = session.app.dataframe
    assert sorted(listed.value["What"]) == ["test T1", "test T2"]


def test_the_latest_study_is_compared_with_the_one_before_of_the_same_data(visit: Visit) -> None:
    """Not with that of another vehicle; a report and a figure show both."""
    for day, data, seed in ((1, "a", 0), (2, "b", 0), (3, "a", 1)):
        ratings = {test: {"cae": {60.0: 0.5 + 0.1 * seed}} for test in ("T1", "T2")}
        keep(PastResult(data, data, StudyConfig(seed=seed), "ISO", "cae", f"2030-01-0{day}T00:00:00+00:00", ratings))
    session = visit("history")
    chosen = [
        box.format_func(box.value) for box in session.app.selectbox if box.label in ("First study", "Second study")
    ]
    assert [text.split(" · ")[2] for text in chosen] == ["fast, seed 0", "fast, seed 1"]
    assert {text.split(" · ")[3] for text in chosen} == {"a"}
    assert "mean 0.600 in the second, 0.500 in the first (+0.100" in session.words
    assert "Each test left out alone, the only way that both studies have." in session.words
    assert session.charts == 1
    assert {"comparison.csv", "comparison.html"} <= {button.label for button in session.app.download_button}


def test_where_folders_are_restricted_others_results_are_not_listed(
    visit: Visit, open_campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only those of campaigns that are open to the visitor."""
    for fingerprint in (load_campaign(open_campaign).fingerprint, "of someone else"):
        ratings = {"T1": {"cae": {60.0: 0.5}}}
        keep(PastResult("a", fingerprint, StudyConfig(), "ISO", "cae", "2030-01-01T00:00:00+00:00", ratings))
    assert len(visit("history").app.dataframe[0].value) == 2
    monkeypatch.setattr("crashfuse.ui.campaigns.roots", lambda: [open_campaign])
    assert len(visit("history").app.dataframe[0].value) == 1
