"""Results in a real browser: what a page shows first, figures that are switched, files that arrive, answers at once."""

import re

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

from tests.browser.conftest import (
    DIALOG,
    FIGURE,
    LINK,
    MAIN,
    PAIRED,
    POPOVER,
    QUICK,
    TABLE,
    Server,
    User,
    press_tool,
    rows,
)

pytestmark = pytest.mark.slow

_CLIPBOARD = "navigator.clipboard.readText().then(arguments[0], () => arguments[0](''))"


def test_a_page_shows_one_thing_at_a_time_and_hands_out_whole_files(engineer: User) -> None:
    """On Compare reasons on demand, corridors, residuals; a table copied, scores and pulses as CSV, a whole report.

    The sidebar folds by itself in a narrow window; on Data the link has which figure is shown.
    """

    def has_links() -> bool:
        return any(0 <= link.rect["x"] < 300 for link in engineer.all(LINK))

    engineer.sees("Velocity (mph)", FIGURE)
    assert engineer.texts(".cf-best")[0].startswith(("CAE", "Displacement domain"))
    assert not engineer.all(MAIN, "Single draws")
    engineer.opens("More")
    engineer.sees("rated", POPOVER)
    engineer.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    assert not engineer.all(FIGURE, "Corridor of the rating")
    engineer.press("Corridors of the rating", "label")
    engineer.sees("Corridor of the rating, inner", FIGURE)
    engineer.press("Residuals")
    engineer.sees("Prediction − test", FIGURE)
    engineer.press("Motion")
    engineer.sees("Corridor of the rating, inner", FIGURE)  # the choice has held
    engineer.open_tab("Ratings and metrics")
    engineer.sees("Single draws", TABLE)
    engineer.wait(lambda: not engineer.all(FIGURE))
    shown = engineer.sees("Corridor", TABLE)
    engineer.browser.execute_cdp_cmd("Browser.grantPermissions", {"permissions": ["clipboardReadWrite"]})
    press_tool(engineer, '[title^="Copy this table"]')
    copied = engineer.wait(lambda: engineer.browser.execute_async_script(_CLIPBOARD))
    assert copied.splitlines()[0].split("\t")[:2] == ["Approach", "0–20 ms"]
    engineer.open_tab("Why")
    engineer.sees("costs most", MAIN)
    engineer.wait(lambda: not engineer.all(TABLE))
    engineer.press("Export")
    scores = rows(engineer.downloads_file("scores.csv"))
    assert {(row["held_out"], row["approach"]) for row in scores} == {("T1", "cae"), ("T1", "displacement_domain")}
    assert all(f"{float(row['overall']):.3f} {row['grade']}" in shown for row in scores)
    assert len(rows(engineer.downloads_file("pulses.csv"))) == 3 * 1250  # the test, and two predictions
    report = engineer.downloads_file("report.html")
    assert report.startswith("<!doctype html>")
    assert report.rstrip().endswith("</html>")
    assert "Test T1" in report
    engineer.press("", f'{DIALOG} [aria-label="Close"]')
    engineer.open_tab("Pulses")
    engineer.find(".cf-ratings")
    engineer.wait(has_links)
    engineer.sits_at(900, 1000)
    engineer.wait(lambda: not has_links())
    engineer.press("", '[data-testid="stExpandSidebarButton"]')
    engineer.wait(has_links)
    engineer.browser.refresh()
    engineer.find(".cf-ratings")
    engineer.wait(lambda: not has_links())
    engineer.sits_at(1440, 1000)
    engineer.wait(has_links)
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
    engineer.go("Compare")
    engineer.browser.get(f"{engineer.browser.current_url}&compare_also=T99")
    engineer.sees("Not among the tests in use and the CAE runs: T99.")


def test_a_click_on_a_planned_test_says_why(small_server: Server, user: User) -> None:
    """Criteria from the tests, changed by the keyboard; the reason stands beside the row, on the same screen."""
    user.sits_at(1440, 1000)
    planned = ("M1~20~2050~1500~mph-lb", "M2~30~2050~1500~mph-lb")
    link = {"approach": "displacement_domain", "matrix": "Typed in", "confidence": "0.9"}
    user.open(small_server, "certify", campaign="campaign", planned=planned, **link)
    user.sees("No criteria yet")
    user.press("Limits of these tests")
    user.fill("At most, row 2", "25")
    user.wait(lambda: "peak%7E%7E%7E25" in user.browser.current_url.replace("~", "%7E"))
    user.presses_until(lambda: user.texts(MAIN, "Of left-out tests"), "Certify", f"{MAIN} button")
    user.wait(lambda: not user.all('input[aria-label="Confidence"]'), "The criteria never folded away.")
    user.press(" · change", "summary")
    user.fill("Confidence", "0.85")
    user.wait(lambda: "confidence=0.85" in user.browser.current_url)
    user.press(" · change", "summary")
    user.press("would miss", ".st-key-planned_tests button")
    user.sees("Peak deceleration, at most 25")
    assert "cell=M2" in user.browser.current_url
    places = [user.find(f'[class*="st-key-{key}"]').rect["y"] for key in ("planned_tests", "criterion")]
    assert abs(places[0] - places[1]) < 400
    user.press("By criterion")
    user.clicks_cell("M2 · 30.0 mph", lambda width, height: (0.05 * width, -0.25 * height), "M1: ")  # two rows
    user.press("Export")
    assert {row["id"] for row in rows(user.downloads_file("certification.csv"))} == {"M1", "M2"}
    user.browser.find_element(By.TAG_NAME, "body").send_keys(Keys.ESCAPE)
    user.press("See the predicted pulse there")
    user.wait(lambda: user.find('input[aria-label="Impact speed (mph)"]').get_attribute("value") == "20.0")


def presses(user: User, slider: "WebElement", key: str) -> None:
    """Press a key on a slider, whose thumb is drawn over a field that cannot be seen."""
    user.browser.execute_script("arguments[0].focus()", slider)
    ActionChains(user.browser).send_keys(key).perform()


def steps_of(user: User, slider: "WebElement", name: str, values: tuple[str, ...]) -> int:
    """How many steps the browser remembers of moves of a slider, each written to the address as Streamlit writes it.

    All at one moment, whatever else this machine does.
    """
    presses(user, slider, Keys.SHIFT)
    moves = (
        "const [name, values] = arguments, before = history.length, here = new URL(location.href);"
        "for (const value of values) {"
        "  here.searchParams.set(name, value);"
        "  history.pushState(history.state, '', here.search);"
        "}"
        "return history.length - before"
    )
    return int(user.browser.execute_script(moves, name, values))


_WATCH_FADING = """
window.fading = 0;
const replaced = '.st-key-alone [data-stale="true"]';
const look = () => {
  window.fading += document.getAnimations().filter(own => own.effect.target.matches(replaced)).length;
  requestAnimationFrame(look);
};
look();
"""


def test_predict_answers_another_speed_at_once(small_server: Server, user: User) -> None:
    """The figure follows number field and slider, and they each other; so do the links and Back."""
    user.sits_at(1440, 1000)
    user.open(small_server, "predict", approaches=QUICK)
    user.starts("Predict", FIGURE)
    assert re.search(r"Expected over 0–60 ms: 0\.\d\d to 0\.\d\d \(80.%, [A-Z]", user.sees("Use the"))
    field = user.find('input[aria-label="Impact speed (mph)"]')
    field.send_keys(Keys.CONTROL, "a")
    field.send_keys("31.5", Keys.ENTER)
    user.find('[aria-label*="31.5 mph, front"]')
    thumb = '[data-testid="stSlider"] input'
    user.wait(lambda: user.browser.find_element(By.CSS_SELECTOR, thumb).get_attribute("value") == "31.5")
    slider = user.browser.find_element(By.CSS_SELECTOR, thumb)
    user.browser.execute_script(_WATCH_FADING)
    presses(user, slider, Keys.ARROW_LEFT)
    user.find('[aria-label*="31.4 mph, front"]')
    assert not user.browser.execute_script("return window.fading")  # what is replaced, while it waits
    user.wait(lambda: user.find('input[aria-label="Impact speed (mph)"]').get_attribute("value") == "31.4")
    user.find('[data-testid="stSidebar"] a[href*="speed_mph=31.4"]')  # to be opened beside this one
    user.browser.back()
    user.find('[aria-label*="31.5 mph, front"]')
    user.fill("Impact speed (mph)", "5")
    table = user.sees("[≤ ", TABLE)
    assert "[open]" in table  # of whose ends neither is known
    assert "open, " not in table
    user.press("More: ", "summary")
    assert "which leaves open: OLC" in user.sees("OLC's restraint is over")
    user.open_tab("Over speed")
    user.press("Predict over speed")
    user.sees("Impact speed", FIGURE)
    user.open_tab("Next test")
    user.sees("The best 5")

    def slowest() -> "WebElement":
        return user.browser.find_element(By.CSS_SELECTOR, 'input[aria-label^="Speeds (mph)"]')  # the thumb is drawn

    usual = slowest().get_attribute("value")
    presses(user, slowest(), Keys.ARROW_RIGHT)
    user.wait(lambda: "speed_range=" in user.browser.current_url)
    user.browser.back()
    user.wait(lambda: "speed_range=" not in user.browser.current_url)
    user.wait(lambda: slowest().get_attribute("value") == usual)
    user.becomes_another()  # moves of a slider in a row are one step for Back, of another slider another
    user.open(small_server, "predict", approaches=QUICK)
    user.starts("Predict", FIGURE)
    user.fill("Impact speed (mph)", "31.5")
    user.wait(lambda: "speed_mph=31.5" in user.browser.current_url)
    user.find('[aria-label*="31.5 mph, front"]')
    speed, weight = user.browser.find_elements(By.CSS_SELECTOR, '[data-testid="stSlider"] input')[:2]
    assert steps_of(user, speed, "speed_mph", ("31.6", "31.7", "31.8")) == 1
    assert steps_of(user, weight, "front_weight_lb", ("2010", "2020")) == 1
    for seen in ("speed_mph=31.8", "speed_mph=31.5", ""):
        user.browser.back()
        user.wait(lambda seen=seen: seen in user.browser.current_url)  # type: ignore[misc]
        user.wait(lambda: "front_weight_lb" not in user.browser.current_url)
    user.wait(lambda: "speed_mph" not in user.browser.current_url)
