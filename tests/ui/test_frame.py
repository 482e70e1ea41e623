"""The frame of every page, and the settings."""

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest
from streamlit.testing.v1.element_tree import Widget

from crashfuse.execution.cache import default_folder
from crashfuse.ui.kit import campaigns, frame, visitors
from tests.ui.conftest import Session, Visit

PAGES = ("data", "train", "compare", "study", "predict")


@pytest.mark.parametrize("page", ["train", "compare", "study", "predict", "certify"])
def test_without_a_campaign_a_page_says_what_to_do(visit: Visit, page: str) -> None:
    """It offers the sample and the way to the page Data, and no more."""
    session = visit(page)
    assert "No campaign is open yet" in session.words
    assert session.buttons == ["Load the sample campaign"]
    assert not session.charts


@pytest.mark.usefixtures("open_campaign")
@pytest.mark.slow
def test_the_sidebar_asks_only_for_what_acts_on_the_page(visit: Visit) -> None:
    """No test to hold out where none is, no unit where no acceleration is shown."""
    asked = {
        page: {str(own.key) for kind in ("selectbox", "button_group") for own in visit(page).app.sidebar.get(kind)}
        for page in ("data", "study", "certify")
    }
    assert asked["data"] >= {"campaign", "test in mph-lb", "window", "system", "unit", "sign"}
    assert asked["study"] == {"campaign", "window", "system", "unit"}
    assert asked["certify"] == {"campaign", "system", "unit"}


@pytest.mark.slow
def test_a_link_opens_nothing_that_nobody_has_opened_here(visit: Visit, campaign_folder: Path) -> None:
    """A path in the address is a name that nobody knows; the page says what to do, as text."""
    for asked in (str(campaign_folder), f"../{campaign_folder.name}", "[x](https://example.org)"):
        session = visit("compare", campaign=asked)
        assert session.app.sidebar.selectbox(key="campaign").value is None
        assert f"You have not opened the campaign “{asked[:80]}” of this link." in session.words
        assert "[x](" not in session.app.warning[0].value
        assert not campaigns.opened_here().keys() - {campaigns.SAMPLE}


@pytest.mark.usefixtures("open_campaign")
@pytest.mark.slow
def test_another_campaign_is_not_shown_in_place_of_that_of_the_link(
    visit: Visit, campaign_folder: Path, tmp_path: Path
) -> None:
    """A test of the same name was another one there. The link stays in the address, and is right once it is opened."""
    session = visit("compare", campaign="elsewhere", test="T3")
    assert "have not opened the campaign “elsewhere” of this link" in session.words
    assert session.app.query_params["campaign"] == "elsewhere"
    session.app.sidebar.selectbox(key="campaign").select("sample").run()
    assert "“elsewhere”" not in session.words
    assert "T04" in session.words  # the sample's own telling test
    session = visit("data", campaign="elsewhere", test="T3")
    session.open_folder(str(shutil.copytree(campaign_folder, tmp_path / "elsewhere")))
    assert session.app.session_state["test"] == "T3"
    assert "“T9” is not among the tests; another is held out instead." in visit(test="T9").words


def test_the_campaign_of_a_link_keeps_the_links_choices_once_it_is_open(visit: Visit, campaign_folder: Path) -> None:
    """Opened in another session, and then chosen in the sidebar."""
    session = visit("compare", campaign=campaign_folder.name, test="T3", window="20")
    assert "No campaign is open yet" in session.words
    name = campaigns.open_folder(campaign_folder)
    opened = campaigns.opened_here()
    opened[name] = replace(opened[name], for_all=True)
    session.run().app.sidebar.selectbox(key="campaign").select(name).run()
    assert session.app.session_state["test"] == "T3"
    assert session.app.session_state["window"] == 20.0


@pytest.mark.usefixtures("open_campaign")
def test_the_address_is_written_again_once_a_campaign_is_open(visit: Visit) -> None:
    """After Forward, say: it takes the campaign from the address, and nobody has chosen it in the sidebar."""
    session = visit("data", campaign="elsewhere")
    session.app.session_state["campaign"] = "sample"
    assert session.run().app.query_params["campaign"] in ("sample", ["sample"])


@pytest.mark.slow
def test_a_campaign_that_goes_bad_while_open_is_refused_on_every_page(visit: Visit, open_campaign: Path) -> None:
    session = visit()
    (open_campaign / "cae.csv").unlink()
    for page in PAGES:
        session.go(page)
        assert "cannot be used: 1 problem" in session.words
        assert session.tables[0]["File"].tolist() == ["cae.csv"]


@pytest.mark.slow
def test_the_notice_of_a_synthetic_campaign_stands_on_every_page(visit: Visit, open_campaign: Path) -> None:
    """It says plainly that no real car is shown, in the line above every page; its words are text."""
    notice = "Synthetic: no real vehicle. ![x](https://example.org/x.png)"
    (open_campaign / "campaign.toml").write_text(f'name = "*Toy*"\nnotice = "{notice}"\n')
    session = visit()
    assert session.app.title[0].value == r"\*Toy\*"
    for page in PAGES:
        session.go(page)
        assert session.answer["Synthetic"] == notice
        assert not any("![" in caption.value for caption in session.app.caption)


@pytest.mark.usefixtures("open_campaign")
@pytest.mark.parametrize("page", [*PAGES, "certify"])
def test_what_a_page_shows_already_is_not_sent_over_what_is_just_being_chosen(visit: Visit, page: str) -> None:
    """A page runs again by itself; whatever it then sets anew wins over a slider that was moved a moment before."""
    session = visit(page).run()
    kinds = ("button_group", "checkbox", "multiselect", "number_input", "selectbox", "slider", "text_input", "toggle")
    widgets = [cast("Widget", widget) for kind in kinds for widget in session.app.get(kind)]
    assert widgets
    again = [widget.key or "" for widget in widgets if widget.proto.set_value]
    assert not [key for key in again if not key.endswith(" here")]  # those of a popover, see kept_choice


@pytest.mark.usefixtures("open_campaign")
def test_a_cache_that_cannot_be_written_is_said(visit: Visit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "file" / "cache"
    folder.parent.touch()
    frame._not_kept.clear()
    monkeypatch.setenv("CRASHFUSE_CACHE", str(folder))
    assert f"Results are lost when the server ends: {folder} cannot be written" in visit("train").words
    frame._not_kept.clear()


@pytest.mark.usefixtures("one_cache")
@pytest.mark.slow
def test_above_every_page_stands_what_is_known_and_what_it_takes_to_know_more(
    visit: Visit, open_campaign: Path
) -> None:
    """Criteria, then a list of conditions, then a click on Certify; the answer is there in other sessions, too."""

    def answer(session: Session) -> str:
        return list(session.answer)[2]

    answers = [answer(visit())]
    (open_campaign / "criteria.toml").write_text('[[criterion]]\nmetric = "max_crush"\nat_most = 900.0\n')
    for name, text in (("matrix.csv", "id,speed_mph,front_weight_lb,rear_weight_lb\nM,25,2050,1500\n"), ("", "")):
        answers.append(answer(visit()))
        (open_campaign / (name or "none")).write_text(text)
    assert len(set(answers)) == 3
    session = visit("certify", approach="displacement_domain").press("Certify").finish().go("train")
    known = answer(session)
    assert re.fullmatch(r"\*\*[01] of 1 planned test need not be run\*\*", known)
    assert answer(visit("certify", approach="displacement_domain").go("data")) == known
    next(button for button in session.app.button if button.label == "24 CAE runs").click()
    assert session.run().app.button_group(key="data_tab").value == "CAE model"


@pytest.mark.usefixtures("open_campaign")
def test_units_and_sign_are_kept_for_the_visitor_alone(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """In other campaigns and sessions; a link overrides them, and nothing that it asks for is kept."""
    monkeypatch.setattr(visitors, "browser", lambda: "anna")
    session = visit(unit="m/s²")
    session.app.sidebar.button_group(key="system").set_value("kph-kg").run()
    session.app.sidebar.button_group(key="sign").set_value("Deceleration").run()
    keys, expected = ("system", "unit", "sign"), ["kph-kg", "g", "Deceleration"]
    session = visit("data", campaign="sample")
    assert [session.app.session_state[key] for key in keys] == expected
    assert visit("data", sign="Acceleration").app.session_state["sign"] == "Acceleration"
    monkeypatch.setattr(visitors, "browser", lambda: "ben")
    assert visit("data").app.session_state["sign"] == "Acceleration"
    (default_folder() / "visitors.json").write_text('{"a": 1, "b": {"sign": []}}')
    assert visit("data").app.session_state["sign"] == "Acceleration"


@pytest.mark.usefixtures("open_campaign")
@pytest.mark.parametrize(("typed", "expected"), [("50", 50.0), ("0–35.5 ms", 35.5), ("5", 60.0), ("magic", 60.0)])
def test_any_window_can_be_rated(visit: Visit, typed: str, expected: float) -> None:
    """Typed in or of a link, and its ratings stand beside the usual ones; an impossible one leaves the one before."""
    assert visit("compare", window=typed).app.session_state["window"] == expected
    session = visit("compare", approaches="cae", test="T2", compare_tab="Ratings and metrics")
    field = session.app.sidebar.selectbox(key="window")
    field.options.append(typed)  # which Streamlit's tests do not know of a field that takes what is typed
    field.set_value(typed).run()
    assert session.app.session_state["window"] == expected
    ratings = session.press("Predict test T2").finish().tables[0]
    assert f"0–{expected:g} ms" in ratings.columns
    assert "0–40 ms" in ratings.columns


@pytest.mark.usefixtures("open_campaign")
@pytest.mark.parametrize("number", ["nan", "inf", "-1e999", "1e300"])
def test_a_link_with_no_number_shows_the_default(visit: Visit, number: str) -> None:
    """A page is shown, not an error; a factor that nobody knows, typed into the address, goes again."""
    session = visit("predict", speed_mph=number)
    assert 0 < cast(float, session.app.number_input[0].value) < 200
    session.app.query_params["factor_bogus"] = "1"
    session.run()


def left_out(session: Session) -> str:
    (asked,) = [each for each in session.app.button_group if each.label == "Left out"]
    return str(asked.value)


@pytest.mark.usefixtures("open_campaign")
@pytest.mark.parametrize("chosen", ["test", "speed group"])
def test_what_a_link_leaves_out_on_compare_stays_on_train_and_back(visit: Visit, chosen: str) -> None:
    """Train has it in the page, Compare in the sidebar; what is chosen on either is chosen on the other."""
    session = visit("compare", campaign="campaign", approaches="cae", test="T2", leave_out=chosen)
    assert left_out(session) == left_out(session.go("train")) == chosen
    assert "There is no way" not in session.words
    (other,) = {"test", "speed group"} - {chosen}
    session.app.button_group(key="leave_out on train").set_value(other)
    assert left_out(session.run()) == left_out(session.go("compare")) == left_out(session.go("train")) == other
