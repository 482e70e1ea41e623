"""Predictions in a real browser: at another speed at once, pinned, and handed on."""

import re

from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

from tests.browser.conftest import FIGURE, MAIN, PILL, QUICK, TABLE, Server, User, bands


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


def test_predict_answers_another_speed_at_once_and_what_is_pinned_stands_everywhere(
    small_server: Server, user: User
) -> None:
    """The figure follows number field and slider, and they each other; so do the links and Back.

    Pin one speed, pin another: figure, table, report and link have them; whoever opens it sees the same, may unpin one.
    """
    user.sits_at(1440, 1000)
    user.open(small_server, "predict", approaches=QUICK)
    user.starts("Predict", FIGURE)
    assert re.search(r": rating 0\.\d\d to 0\.\d\d expected \(80.%, [A-Z]", user.sees("Use the"))
    pulse, metrics = (user.find(where).rect for where in (FIGURE, TABLE))
    assert metrics["x"] >= pulse["x"] + pulse["width"]  # beside it
    assert abs(metrics["y"] - pulse["y"]) < 100
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
    user.press("More metrics", "summary")
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
    user.becomes_another()
    user.open(small_server, "predict", campaign="campaign", approaches="displacement_domain", speed_mph="30")
    user.starts("Predict", FIGURE)
    user.press("Pin this prediction")
    user.wait(lambda: "pins=30mph" in user.browser.current_url)
    user.fill("Impact speed (mph)", "34")
    user.find('[aria-label*="34.0 mph, front"]')
    user.press("Pin this prediction")
    user.wait(lambda: "pins=34mph" in user.browser.current_url)
    user.fill("Impact speed (mph)", "60")
    user.sees("Extrapolation: speed 60.0 mph lies outside")
    pinned = [f"Displacement domain at {speed} mph" for speed in ("30.0", "34.0")]
    assert [words in user.sees(words, FIGURE) for words in pinned] == [True, True]
    assert sorted(bands(user).values()) == [False, False, True]
    assert bands(user)["Displacement domain, representative pulse"]
    user.wait(lambda: "speed_mph=60" in user.browser.current_url)
    link = user.browser.current_url
    user.browser.switch_to.new_window("tab")
    user.becomes_another()
    user.browser.get(link)
    assert [words in user.sees(words, FIGURE) for words in pinned] == [True, True]
    user.wait(lambda: user.find('input[aria-label="Impact speed (mph)"]').get_attribute("value") == "60.0")
    user.sees("34.0 mph − 60.0 mph", f"{MAIN} {TABLE}")
    user.press("− 34.0 mph", f"{MAIN} {PILL}")
    user.sees("60.0 mph − 34.0 mph", f"{MAIN} {TABLE}")
    user.press("Export")
    report = user.downloads_file("report.html")
    assert "Beside other predictions: Displacement domain" in report
    assert "34.0 mph − 60.0 mph" in report
    assert "Method and settings" in report
    user.press("Short", PILL)
    user.wait(lambda: user.all(f'{PILL}[aria-checked="true"]', "Short"))
    user.press("report.html", '[data-testid="stDownloadButton"] button')
    short = user.arrived("-short_report.html").read_text(encoding="utf-8")
    assert "34.0 mph − 60.0 mph" in short
    assert "Method and settings" not in short
    user.press("", '[data-testid="stDialog"] [aria-label="Close"]')
    user.press_inside("2 pinned", "34.0 mph", "button")
    user.wait(lambda: "34mph" not in user.browser.current_url)
    user.find(f"{MAIN} button", "1 pinned")
    user.go("Compare")
    user.starts("Predict test T2", FIGURE)
    user.opens("Curves")
    user.find('input[aria-label^="Also show"]').send_keys("30.0 mph", Keys.ENTER)
    user.sees("Displacement domain at 30.0 mph", FIGURE)
    user.go("Study")
    user.open_tab("Past results")
    listed = "return document.querySelector('[data-testid=\"stDataFrame\"]')?.textContent ?? ''"
    user.wait(lambda: "at 34.0 mph" in user.browser.execute_script(listed), "Nothing listed the prediction.")
