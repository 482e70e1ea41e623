"""Which curves a figure of pulses shows: the choice of its own, and what is added."""

import json
from types import SimpleNamespace

import pytest

from crashfuse.ui.kit.files import Caption
from crashfuse.ui.kit.text import as_read
from tests.ui.conftest import Session, Visit

pytestmark = pytest.mark.usefixtures("open_campaign")

CAE_ONLY = {"approaches": "cae"}
ONE = {"approaches": "displacement_domain"}
SEED_1 = "by:fast 1 test"
NOT_YET = "The prediction of {} with {} is not there (any more)."
NEVER = "Not shown: {}. There are no such settings."
HERE = {**ONE, "speed_mph": "30"}


def beside_the_figure(session: Session) -> list[str]:
    """What is said in small print where everyone sees it, not in a popover that has to be opened."""
    folded = [caption for popover in session.app.get("popover") for caption in popover.get("caption")]
    return [as_read(each.value) for each in session.app.caption if each not in folded]


def test_a_link_may_ask_for_anything(visit: Visit) -> None:
    """What is known is shown, and labelled in full; beside the figure it is said which tests and runs are not known."""
    asked = ["T9", "T3", "cae:C00", "cae:none", "at:1mph"]
    session = visit("compare", **CAE_ONLY, test="T2", explained="magic", compare_also=asked)
    predicted(session)
    session.app.session_state["pins"] = ["30mph 2000lb 1500lb", "0mph 1lb", "🚗"]
    session.run()
    (also,) = [each for each in session.app.multiselect if each.label == "Also show"]
    assert also.value == ["T3", "cae:C00"]
    assert "T3 · 26.0 mph" in also.options
    assert any(option.startswith("CAE run C00 · ") for option in also.options)
    assert [option for option in also.options if " at 30.0 mph" in option] == ["CAE at 30.0 mph, 2000 + 1500 lb"]
    assert not any(option.startswith("T2") for option in also.options)  # it is there already
    assert "Not among the tests in use and the CAE runs: T9, none." in beside_the_figure(session)


def test_the_nearest_tests_follow_the_test_and_go_as_they_came(visit: Visit) -> None:
    """T3 is one mile per hour from T2; on Predict nothing of it is shown."""
    session = predicted(visit("compare", **CAE_ONLY, test="T2"))
    session.app.toggle(key="compare_nearest").set_value(True).run()
    assert all(f"{name} · " in figure(session) for name in ("T1", "T3", "T4"))
    assert "T2 · " not in figure(session)
    session.app.session_state["test"] = "T3"
    predicted(session.run(), "T3")
    assert "T2 · " in figure(session)
    assert "T3 · " not in figure(session)
    assert "T2 · " not in figure(fitted(visit("predict", **CAE_ONLY)))
    session.app.toggle(key="compare_nearest").set_value(False).run()
    assert "T2 · " not in figure(session)


def test_a_test_that_stands_apart_is_always_among_the_nearest(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many are nearer."""
    apart = SimpleNamespace(test="T1")
    monkeypatch.setattr("crashfuse.ui.kit.curves.departures_near", lambda *_: (apart,))
    monkeypatch.setattr("crashfuse.ui.kit.curves._NEAREST", 1)
    session = predicted(visit("compare", **CAE_ONLY, test="T2", compare_nearest="true"))
    assert [f"{name} · " in figure(session) for name in ("T1", "T3", "T4")] == [True, True, False]


def test_a_page_begins_with_the_curves_that_matter(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recommended prediction, the CAE model and the test; files of other curves have other names."""
    captions: list[Caption] = []
    monkeypatch.setattr("crashfuse.ui.kit.figures.offer_files", lambda _, caption, __: captions.append(caption))
    approaches = ["cae", "displacement_domain"]
    session = predicted(visit("compare", approaches=approaches, test="T2"))
    over_time = "Acceleration, velocity and displacement over time: "
    assert captions[-1].title == f"{over_time}test T2 and its prediction by CAE and Displacement domain"
    assert "pulses-Displacement-domain-Test-CAE" in captions[-1].name
    session.app.session_state["compare_curves"] = []
    session.run()
    assert captions[-1].title == f"{over_time}test T2, prediction by Displacement domain"
    assert "Test" not in captions[-1].name
    fitted(visit("predict", approaches=approaches))
    assert captions[-1].title.startswith("Prediction by CAE and Displacement domain at ")
    assert "Representative" not in captions[-1].name


def predicted(session: Session, test: str = "T2") -> Session:
    """The page once the test is predicted."""
    return session.press(f"Predict test {test}").finish()


def offered(session: Session) -> list[str]:
    """What *Also show* offers besides tests and CAE runs."""
    (also,) = [each for each in session.app.multiselect if each.label == "Also show"]
    return [option for option in also.options if option.startswith("Displacement domain")]


def figure(session: Session) -> str:
    """What the figure is made of."""
    return json.dumps(json.loads(session.app.get("plotly_chart")[0].proto.spec), ensure_ascii=False)


def test_another_seed_and_way_of_leaving_out_are_offered_once_they_are_known(visit: Visit) -> None:
    """Of the same test; with the settings that they have, they are the ones that the others are put beside."""
    first = predicted(visit("compare", **ONE, test="T2"))
    assert offered(first) == []
    second = predicted(visit("compare", **ONE, test="T2", seed="1", leave_out="speed group"))
    assert offered(second) == ["Displacement domain, seed 0, left out alone"]
    assert offered(first.run()) == ["Displacement domain, seed 1, all at its speed left out"]
    assert offered(predicted(visit("compare", **ONE, test="T3"), "T3")) == []


def test_a_link_shows_it_or_says_that_it_is_not_there(visit: Visit) -> None:
    """Where it is computed later, it is shown then; the settings that are shown anyway are not missed."""
    session = predicted(visit("compare", **ONE, test="T2", compare_also=SEED_1))
    assert NOT_YET.format("T2", "seed 1") in session.words
    assert "seed 1" not in figure(session)
    other = predicted(visit("compare", **ONE, test="T2", seed="1", compare_also=SEED_1))
    assert "Not shown" not in other.words
    assert "Not shown" not in session.run().words
    assert "Displacement domain, seed 1" in figure(session)
    session.app.session_state["test"] = "T3"
    predicted(session.run(), "T3")
    assert NOT_YET.format("T3", "seed 1") in session.words
    session.press("Predict T3 with seed 1").finish()
    assert "Displacement domain, seed 1" in figure(session)


def test_its_rating_and_metrics_stand_below_those_that_it_was_put_beside(visit: Visit) -> None:
    """In the same tables; those of the study that computed it."""
    link = {**ONE, "test": "T2", "compare_tab": "Ratings and metrics"}
    other = predicted(visit("compare", **link, leave_out="speed group"))
    session = predicted(visit("compare", **link, compare_also="by:fast 0 speed group"))
    name, label = "Displacement domain, all at its speed left out", "Displacement domain"
    (ratings, metrics), (own_ratings, own_metrics) = session.tables[:2], other.tables[:2]
    beside = ratings.set_index("Approach").loc[name]
    assert beside.tolist() == own_ratings.set_index("Approach").loc[label].tolist()
    assert beside.tolist() != ratings.set_index("Approach").loc[label].tolist()
    assert metrics[name].tolist() == own_metrics[label].tolist()


def test_it_is_said_which_of_several_settings_are_not_shown(visit: Visit) -> None:
    """Whatever a link has in their place."""
    asked = [SEED_1, "by:paper 0 speed group", "by:fast 0 magic", "by:*seven*"]
    session = predicted(visit("compare", **ONE, test="T2", compare_also=asked))
    for words in ("seed 1", "paper settings, all at its speed left out"):
        assert NOT_YET.format("T2", words) in session.words
    assert NEVER.format("fast 0 magic or *seven*") in beside_the_figure(session)


def fitted(session: Session) -> Session:
    """The page once the approaches are fitted."""
    return session.press("Predict").finish()


def test_the_next_seed_is_one_click_away_and_then_stands_beside(visit: Visit) -> None:
    """In the figure and in the table with differences; whoever opens the link later has it at once."""
    session = fitted(visit("predict", **HERE))
    session.app.session_state["predict_also"] = ["by:fast 0 magic", "by:*seven*", "by:fast 99999999999 test", "by:"]
    assert "is not there" not in session.run().words
    assert offered(session) == ["Displacement domain, seed 1"]
    session.app.session_state["predict_also"] = [SEED_1]
    session.run()
    assert NOT_YET.format("this condition", "seed 1") in session.words
    assert "seed 1" not in figure(session)
    session.press("Predict with seed 1").finish()
    assert "Displacement domain, seed 1" in figure(session)
    assert "is not there" not in session.words
    other = visit("predict", **HERE, predict_also=SEED_1)
    condition, *_ = other.tables[0].columns[1:]
    seed_1 = f"{condition}, seed 1"
    assert list(other.tables[0].columns[2:]) == [seed_1, f"{seed_1} − {condition}"]
    other.app.button_group(key="subtracted").set_value(seed_1).run()
    assert list(other.tables[0].columns[1:]) == [seed_1, condition, f"{condition} − {seed_1}"]


def test_what_was_fitted_before_is_offered_whatever_was_left_out(visit: Visit) -> None:
    """Seen from the other seed, too; ways of leaving out, chosen on Compare, mean nothing here."""
    fitted(visit("predict", **HERE))
    session = fitted(visit("predict", **HERE, seed="1", predict_also="by:fast 0 speed group"))
    assert offered(session) == ["Displacement domain, seed 0", "Displacement domain, seed 2"]
    assert "Displacement domain, seed 0" in figure(session)
    session.app.session_state["predict_also"] = ["by:fast 1 speed group"]  # what is shown anyway
    assert "is not there" not in session.run().words
