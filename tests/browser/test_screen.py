"""The screen in a real browser: what Compare and Data show first, and a sidebar that folds in a narrow window."""

import pytest
from selenium.webdriver.common.keys import Keys

from tests.browser.conftest import FIGURE, LINK, MAIN, PAIRED, POPOVER, TABLE, User

pytestmark = pytest.mark.slow


def test_compare_shows_ratings_a_sentence_and_one_tab_at_a_time(engineer: User) -> None:
    """The recommended approach is marked; reasons are there on demand."""
    engineer.sees("Velocity (mph)", FIGURE)
    assert engineer.texts(".cf-best")[0].startswith(("CAE", "Displacement domain"))
    assert not engineer.all(MAIN, "Single draws")
    engineer.opens("More")
    engineer.sees("rated", POPOVER)
    engineer.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    engineer.open_tab("Ratings and metrics")
    engineer.sees("Single draws", TABLE)
    engineer.wait(lambda: not engineer.all(FIGURE))
    engineer.open_tab("Why")
    engineer.sees("costs most", MAIN)
    engineer.wait(lambda: not engineer.all(TABLE))


def test_the_sidebar_folds_in_a_narrow_window_and_comes_back_in_a_wide_one(engineer: User) -> None:
    """By itself; a narrow window can open it."""

    def shown() -> bool:
        return any(0 <= link.rect["x"] < 300 for link in engineer.all(LINK))

    engineer.find(".cf-ratings")
    engineer.wait(shown)
    engineer.sits_at(900, 1000)
    engineer.wait(lambda: not shown())
    engineer.press("", '[data-testid="stExpandSidebarButton"]')
    engineer.wait(shown)
    engineer.browser.refresh()
    engineer.find(".cf-ratings")
    engineer.wait(lambda: not shown())
    engineer.sits_at(1440, 1000)
    engineer.wait(shown)


def test_data_shows_one_figure_at_a_time_and_the_link_has_which(engineer: User) -> None:
    """The tests first; conditions with the ratings, and the CAE model, in tabs of their own."""
    engineer.go("Data")
    engineer.find(FIGURE, "Time (ms)")
    engineer.open_tab("Conditions")
    assert "extrapolation" not in engineer.sees("Front weight", FIGURE)
    engineer.sees("In CAE range", TABLE)
    heads, cells = (engineer.texts(f"{TABLE} {kind}") for kind in ("th", "td"))
    by_column = {head: cells[place :: len(heads)] for place, head in enumerate(heads)}
    assert by_column["Paired run"] == [*PAIRED]
    assert by_column["In CAE range"] == ["yes"] * len(PAIRED)
    assert len(engineer.all(FIGURE)) == 1
    assert "data_tab=Conditions" in engineer.browser.current_url
    engineer.browser.back()
    engineer.find(FIGURE, "rated:")
    engineer.browser.get(f"{engineer.browser.current_url}&data_also=T99")
    engineer.sees("Not among the tests in use and the CAE runs: T99.")
