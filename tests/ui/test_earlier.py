"""On Compare and Data, predictions of the held-out test are offered once they were computed."""

from collections.abc import Callable

import pytest

from tests.ui.conftest import Session
from tests.ui.test_beside import beside_the_figure

Visit = Callable[..., Session]
ONE = {"campaign": "campaign", "approaches": "displacement_domain"}
SEED_1 = "by:fast 1 test"
NOT_YET = "The prediction of {} with {} is not there yet, or is no longer kept."
NEVER = "{} with {} is not shown: it comes out the same, or there are no such settings."


def predicted(session: Session, test: str = "T2") -> Session:
    """The page once the test is predicted."""
    return session.press(f"Predict test {test}").finish()


def offered(session: Session) -> list[str]:
    """What *Also show* offers besides tests and CAE runs."""
    (also,) = [each for each in session.app.multiselect if each.label == "Also show"]
    return [option for option in also.options if option.startswith("Displacement domain")]


def figure(session: Session) -> str:
    """What the figure is made of."""
    return str(session.app.get("plotly_chart")[0].proto.spec)


@pytest.mark.usefixtures("open_campaign")
def test_another_seed_and_way_of_leaving_out_are_offered_once_they_are_known(visit: Visit) -> None:
    """Of the same test; with the settings that they have, they are the ones that the others are put beside."""
    first = predicted(visit("compare", **ONE, test="T2"))
    assert offered(first) == []
    second = predicted(visit("compare", **ONE, test="T2", seed="1", leave_out="speed group"))
    assert offered(second) == ["Displacement domain, seed 0, left out alone"]
    assert offered(first.run()) == ["Displacement domain, seed 1, all at its speed left out"]
    third = predicted(visit("compare", **ONE, test="T3"), "T3")
    assert offered(third) == []


@pytest.mark.usefixtures("open_campaign")
def test_a_link_shows_it_or_says_that_it_is_not_there(visit: Visit) -> None:
    """Where it is computed later, it is shown then; the settings that are shown anyway are not missed."""
    session = predicted(visit("compare", **ONE, test="T2", also=SEED_1))
    assert NOT_YET.format("T2", "seed 1") in session.words
    assert "seed 1" not in figure(session)
    other = predicted(visit("compare", **ONE, test="T2", seed="1", also=SEED_1))
    assert "is not shown" not in other.words
    assert "is not shown" not in session.run().words
    assert "Displacement domain, seed 1" in figure(session)
    session.app.session_state["test"] = "T3"
    predicted(session.run(), "T3")
    assert NOT_YET.format("T3", "seed 1") in session.words
    session.press("Predict T3 with seed 1").finish()
    assert "Displacement domain, seed 1" in figure(session)


@pytest.mark.usefixtures("open_campaign")
def test_its_rating_and_metrics_stand_below_those_that_it_was_put_beside(visit: Visit) -> None:
    """In the same tables; those of the study that computed it."""
    other = predicted(visit("compare", **ONE, test="T2", leave_out="speed group")).open_tab(
        "compare", "Ratings and metrics"
    )
    session = predicted(visit("compare", **ONE, test="T2", also="by:fast 0 speed group"))
    session.open_tab("compare", "Ratings and metrics")
    name, label = "Displacement domain, all at its speed left out", "Displacement domain"
    (ratings, metrics), (own_ratings, own_metrics) = session.tables[:2], other.tables[:2]
    beside = ratings.set_index("Approach").loc[name]
    assert beside.tolist() == own_ratings.set_index("Approach").loc[label].tolist()
    assert beside.tolist() != ratings.set_index("Approach").loc[label].tolist()
    assert metrics[name].tolist() == own_metrics[label].tolist()


@pytest.mark.usefixtures("open_campaign")
def test_it_is_said_which_of_several_settings_are_not_shown(visit: Visit) -> None:
    """Whatever a link has in their place."""
    asked = [SEED_1, "by:paper 0 speed group", "by:fast 0 magic", "by:*seven*"]
    session = predicted(visit("compare", **ONE, test="T2", also=asked))
    for words in ("seed 1", "paper settings, all at its speed left out"):
        assert NOT_YET.format("T2", words) in session.words
    assert NEVER.format("T2", "fast 0 magic or with *seven*") in beside_the_figure(session)


@pytest.mark.usefixtures("open_campaign")
def test_on_data_it_stands_among_the_tests_by_the_name_of_its_own(visit: Visit) -> None:
    """One with the usual settings, too, as no other is shown there; the CAE runs have it beside them as well."""
    predicted(visit("compare", **ONE, test="T2"))
    predicted(visit("compare", **ONE, test="T2", seed="1"))
    session = visit("data", **ONE, test="T2", also=["by:fast 0 test", SEED_1])
    for tab in ("Tests", "CAE model"):
        session.open_tab("data", tab)
        assert "T2 by Displacement domain, seed 1" in figure(session)
        (also,) = [each for each in session.app.multiselect if each.label == "Also show"]
        assert also.value == ["by:fast 0 test", SEED_1]
        assert "T2 by Displacement domain" in also.options
    session.app.session_state["test"] = "T3"
    words = session.run().words
    for settings in ("the usual settings", "seed 1"):
        assert NOT_YET.format("T3", settings) in words
    session.press("Predict T3 with seed 1").finish()
    assert "T3 by Displacement domain, seed 1" in figure(session)


@pytest.mark.usefixtures("open_campaign")
def test_what_stands_in_the_figure_is_not_asked_for_though_other_approaches_lack_it(visit: Visit) -> None:
    """A study by one approach is enough for its prediction, where the page would compare two."""
    predicted(visit("compare", **ONE, test="T2", seed="1"))
    session = visit("data", approaches=["displacement_domain", "lf_tcn"], test="T2", also=SEED_1)
    assert "Displacement domain, seed 1" in figure(session)
    assert NOT_YET.format("T2", "seed 1") not in session.words
