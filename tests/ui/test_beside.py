"""What is chosen for figures of pulses: any link is harmless, and a choice outlasts what a page offers."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from crashfuse.ui.beside import Shown, unlike_usual
from crashfuse.ui.captions import Caption
from crashfuse.ui.text import as_read
from tests.ui.conftest import Session

Visit = Callable[..., Session]
ONE = {"campaign": "campaign", "approaches": "cae"}


def predicted(session: Session, test: str) -> Session:
    """The page once the test is predicted."""
    return session.press(f"Predict test {test}").finish()


def beside_the_figure(session: Session) -> list[str]:
    """What is said in small print where everyone sees it, not in a popover that has to be opened."""
    folded = [caption for popover in session.app.get("popover") for caption in popover.get("caption")]
    return [as_read(each.value) for each in session.app.caption if each not in folded]


@pytest.mark.usefixtures("open_campaign")
def test_a_link_may_ask_for_anything(visit: Visit) -> None:
    """What is known is shown, and labelled in full; beside the figure it is said which tests and runs are not known."""
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
    assert "Not among the tests in use and the CAE runs: T9, none." in beside_the_figure(session)


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
def test_on_data_too_it_is_said_what_a_link_asks_for_in_vain(visit: Visit) -> None:
    """Of the tests that are shown alone, and of what is put beside them; pins wait for an answer of Predict."""
    session = visit("data", campaign="campaign", only=["T2", "T8"], also=["cae:none", "at:30mph 2000lb 1500lb"],
                    pins="30mph 2000lb 1500lb")  # fmt: skip
    said = beside_the_figure(session)
    assert "Not among the tests in use and the CAE runs: T8." in said
    assert "Not among the tests in use and the CAE runs: none." in said
    assert "Pinned predictions are shown once the page Predict has an answer with these settings." in said


@pytest.mark.usefixtures("open_campaign")
def test_hiding_every_curve_is_possible_and_said(visit: Visit) -> None:
    """An empty figure would look like an error."""
    session = visit("compare", **ONE, test="T2")
    predicted(session, "T2")
    session.app.session_state["curves"] = []
    session.run()
    assert "No curve is chosen." in session.words


@pytest.mark.usefixtures("open_campaign")
def test_figures_of_other_curves_have_files_of_other_names(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same curves come to the same name, even if the band of the recommended approach is asked for by its name.

    What predictions miss of a test has no curve of the test: none is hidden.
    """
    names: list[str] = []
    monkeypatch.setattr("crashfuse.ui.figures.offer_files", lambda _, caption, __: names.append(caption.name))
    approaches = ["cae", "displacement_domain"]
    session = predicted(visit("compare", campaign="campaign", approaches=approaches, test="T2"), "T2")
    usual = names[-1]
    session.app.session_state["band"] = "displacement_domain"
    session.run()
    assert names[-1] == usual
    session.app.session_state["curves"] = ["displacement_domain"]
    session.run()
    assert names[-1] == usual.replace("pulses", "pulses-no-Test-no-CAE")
    session.app.session_state["compared"] = "Residuals"
    session.run()
    assert names[-1] == usual.replace("pulses", "residuals-no-CAE")


@pytest.mark.usefixtures("open_campaign")
def test_a_picture_says_what_it_shows_and_nothing_that_is_hidden(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """The line above it names what is left, as do the files of a figure that always shows some curves."""
    captions: list[Caption] = []
    monkeypatch.setattr("crashfuse.ui.figures.offer_files", lambda _, caption, __: captions.append(caption))
    approaches = ["cae", "displacement_domain"]
    session = predicted(visit("compare", campaign="campaign", approaches=approaches, test="T2"), "T2")
    over_time = "Acceleration, velocity and displacement over time: "
    assert captions[-1].title == f"{over_time}test T2 and its prediction by every approach"
    session.app.session_state["curves"] = ["displacement_domain"]
    session.run()
    assert captions[-1].title == f"{over_time}prediction of test T2 by Displacement domain"
    session.app.session_state["curves"] = ["test"]
    session.run()
    assert captions[-1].title == f"{over_time}test T2"


def test_what_a_figure_shows_is_said_in_words() -> None:
    """Of a figure with further pulses alone, that they stand beside."""
    shown = Shown(True, ("cae", "fused"), (), "fused", None, (), every=False)
    assert shown.of("T2") == "test T2 and its prediction by CAE and Fused"
    assert replace(shown, every=True).by == "every approach"
    assert replace(shown, test=False, approaches=()).of("T2") == "beside test T2"


def test_a_figure_with_another_filled_band_says_whose_it_is() -> None:
    """Where it is the usual one and nothing is hidden, nothing is said."""
    assert unlike_usual([], "time_domain", "fused") == ("Time domain band",)
    assert unlike_usual(["test", "lf_tcn"], "fused", "fused") == ("no Test", "no LF TCN")
    assert unlike_usual([], "fused", "fused") == ()
