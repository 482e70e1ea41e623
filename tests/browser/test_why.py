"""From a rating to its parts, and from the worst test to what sets it apart, in a real browser."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from tests.browser.conftest import SOON, serve
from tests.conftest import write_campaign
from tests.study.test_departure import at_one_speed

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from crashfuse.campaign import Campaign
    from tests.browser.conftest import Server, User

FIGURE = ".js-plotly-plot"
TAB = '[data-testid="stButtonGroup"] button'


@pytest.fixture(scope="module")
def odd_server(campaign: "Campaign", tmp_path_factory: pytest.TempPathFactory) -> Iterator["Server"]:
    """A dashboard with a campaign of six tests, four of them at one speed, of which S4 lasts 30 % longer."""
    group = at_one_speed(campaign, [1.0, 1.02, 0.95, 1.3])
    tests = (campaign.test("T1"), *group.tests, campaign.test("T4"))
    folder = write_campaign(replace(campaign, tests=tests), tmp_path_factory.mktemp("odd") / "campaign")
    with serve(tmp_path_factory.mktemp("server"), folder) as started:
        yield started


def test_a_rating_leads_to_its_parts_and_the_worst_test_to_what_sets_it_apart(
    odd_server: "Server", user: "User"
) -> None:
    """The study names the odd test, Compare how its expectation came out; one click on Why: scores, shift, curves."""
    user.browser.get(f"{odd_server.address}/study?test=S4&approaches=cae&approaches=displacement_domain")
    user.press("Leave out each of 6 tests")
    said = user.sees("without its neighbours and", timeout_s=4 * SOON)  # known last, after twelve fits
    assert "S4, 25.0 mph: expected " in said
    assert "far below what was expected. S4 differs from the tests at its speed more than they do from each" in said
    assert "Check its record and its condition, or expect bifurcation" in said
    user.go("Compare")
    user.sees("far below what was expected.")
    user.press("Why", TAB)
    told = user.sees("costs most")
    assert "S4 differs from the tests at its speed" in told
    assert all(f"{part} 0." in told for part in ("Corridor", "Phase", "Magnitude", "Slope"))
    user.sees("Corridor (40 %)", FIGURE)
    curves = user.find(FIGURE, "curves as they stand").text
    assert "moved" in curves
    user.press("CAE", TAB)
    user.sees("CAE 0.")
    user.wait(lambda: "explained=cae" in user.browser.current_url)
    user.browser.refresh()
    user.sees("CAE 0.")
    assert "explained=cae" in user.browser.current_url
