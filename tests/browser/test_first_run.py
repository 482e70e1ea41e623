"""A newcomer's first steps in a real browser."""

from typing import TYPE_CHECKING

import pytest

from tests.browser.conftest import FIGURE, TABLE

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User


def test_a_newcomer_gets_from_a_cold_link_to_a_rated_comparison(cold_server: "Server", user: "User") -> None:
    """Open /compare, load the sample, train without the networks, see the table."""
    user.open(cold_server, "compare")
    user.sees("No campaign is open yet")
    user.press("Load the sample campaign")  # the first click counts
    assert "Synthetic" in user.sees("has not been predicted yet")
    user.go("Train")
    user.choose_approaches("CAE", "Displacement domain")
    user.press("Start")
    user.sees("are ready")
    user.press("Compare T")
    user.sees("Displacement (mm)", FIGURE)
    user.open_tab("Ratings and metrics")
    table = user.sees("Corridor", TABLE)
    assert all(approach in table for approach in ("CAE", "Displacement domain"))
    assert any(grade in table for grade in ("Excellent", "Good", "Fair", "Poor"))
