"""On Predict, the same condition by other seeds and presets stands beside what is shown."""

from collections.abc import Callable

import pytest

from tests.ui.conftest import Session
from tests.ui.test_earlier import figure, offered

Visit = Callable[..., Session]
HERE = {"campaign": "campaign", "approaches": "displacement_domain", "speed_mph": "30"}
SEED_1 = "by:fast 1 test"


def predicted(session: Session) -> Session:
    """The page once the approaches are fitted."""
    return session.press("Predict").finish()


@pytest.mark.usefixtures("open_campaign")
def test_the_next_seed_is_one_click_away_and_then_stands_beside(visit: Visit) -> None:
    """In the figure and in the table with differences; whoever opens the link later has it at once."""
    session = predicted(visit("predict", **HERE))
    assert offered(session) == ["Displacement domain, seed 1"]
    session.app.session_state["also"] = [SEED_1]
    session.run()
    assert "Nothing was predicted with seed 1 yet. This takes a minute or two" in session.words
    assert "seed 1" not in figure(session)
    session.press("Predict with seed 1").finish()
    assert "Displacement domain, seed 1" in figure(session)
    assert "yet" not in session.words
    other = visit("predict", **HERE, also=SEED_1, predict_tab="Metrics")
    condition, *_ = other.tables[0].columns[1:]
    assert list(other.tables[0].columns[2:]) == [f"{condition}, seed 1", f"Difference, {condition}, seed 1"]


@pytest.mark.usefixtures("open_campaign")
def test_what_was_fitted_before_is_offered_whatever_was_left_out(visit: Visit) -> None:
    """Seen from the other seed, too; ways of leaving out, chosen on Compare, mean nothing here."""
    predicted(visit("predict", **HERE))
    session = predicted(visit("predict", **HERE, seed="1", also="by:fast 0 speed group"))
    assert offered(session) == ["Displacement domain, seed 0", "Displacement domain, seed 2"]
    assert "Displacement domain, seed 0" in figure(session)
    session.app.session_state["also"] = ["by:fast 1 speed group"]  # what is shown anyway
    assert "Nothing was predicted" not in session.run().words


@pytest.mark.usefixtures("open_campaign")
def test_a_link_may_ask_for_any_settings(visit: Visit) -> None:
    """Such as there are none of."""
    session = predicted(visit("predict", **HERE))
    session.app.session_state["also"] = ["by:fast 0 magic", "by:*seven*", "by:fast 99999999999 test", "by:"]
    assert "Nothing was predicted" not in session.run().words
    assert offered(session) == ["Displacement domain, seed 1"]
