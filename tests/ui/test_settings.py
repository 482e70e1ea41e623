"""Settings that several pages ask for are one choice."""

from collections.abc import Callable

import pytest

from tests.ui.conftest import Session


def left_out(session: Session) -> str:
    """What the page shows as chosen under *Left out*."""
    (asked,) = [each for each in session.app.button_group if each.label == "Left out"]
    return str(asked.value)


@pytest.mark.usefixtures("open_campaign")
@pytest.mark.parametrize("chosen", ["test", "speed group"])
def test_what_a_link_leaves_out_on_compare_stays_on_train_and_back(visit: Callable[..., Session], chosen: str) -> None:
    """Train has it in the page, Compare in the sidebar; what is chosen on either is chosen on the other."""
    session = visit("compare", campaign="campaign", approaches="cae", test="T2", leave_out=chosen)
    assert left_out(session) == left_out(session.go("train")) == chosen
    assert "There is no way" not in session.words
    (other,) = {"test", "speed group"} - {chosen}
    session.app.button_group(key="leave_out on train").set_value(other)
    assert left_out(session.run()) == left_out(session.go("compare")) == left_out(session.go("train")) == other
