"""Results in a real browser: what a page shows first, figures that are switched, files that arrive, reasons."""

from urllib.parse import unquote_plus

from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tests.browser.conftest import (
    APPROACH,
    DIALOG,
    FIGURE,
    LINK,
    MAIN,
    PAIRED,
    POPOVER,
    STAR,
    TABLE,
    Server,
    User,
    press_tool,
    rows,
)

_CLIPBOARD = "navigator.clipboard.readText().then(arguments[0], () => arguments[0](''))"


def test_a_page_shows_one_thing_at_a_time_and_hands_out_whole_files(engineer: User) -> None:
    """On Compare reasons on demand, corridors, residuals; a table copied, scores and pulses as CSV, a whole report.

    The sidebar folds by itself in a narrow window; on Data the link has which figure is shown.
    """

    def has_links() -> bool:
        return any(0 <= link.rect["x"] < 300 for link in engineer.all(LINK))

    engineer.sees("Velocity (mph)", FIGURE)
    assert engineer.all(f"{APPROACH} {STAR}")
    assert not engineer.all(MAIN, "Single draws")
    engineer.opens("More")
    engineer.sees("rated", POPOVER)
    engineer.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    assert not engineer.all(FIGURE, "Corridor of the rating")
    engineer.press("Corridors", "label")
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
    engineer.find(APPROACH)
    engineer.wait(has_links)
    engineer.sits_at(900, 1000)
    engineer.wait(lambda: not has_links())
    engineer.press("", '[data-testid="stExpandSidebarButton"]')
    engineer.wait(has_links)
    engineer.browser.refresh()
    engineer.find(APPROACH)
    engineer.wait(lambda: not has_links())
    engineer.sits_at(1440, 1000)
    engineer.wait(has_links)
    engineer.go("Data")
    engineer.find(FIGURE, "Time (ms)")
    engineer.open_tab("Conditions")
    assert "extrapolation" not in engineer.sees("Front weight", FIGURE)
    engineer.sees("CAE pulse", TABLE)
    heads, cells = (engineer.texts(f"{TABLE} {kind}") for kind in ("th", "td"))
    by_column = {head: cells[place :: len(heads)] for place, head in enumerate(heads)}
    assert by_column["CAE pulse"] == [*PAIRED]
    assert len(engineer.all(FIGURE)) == 1
    assert "data_tab=Conditions" in engineer.browser.current_url
    engineer.browser.back()
    engineer.find(FIGURE, "rated:")
    engineer.go("Compare")
    engineer.browser.get(f"{engineer.browser.current_url}&compare_also=T99")
    engineer.sees("Not among the tests in use and the CAE runs: T99.")


def test_a_click_on_a_planned_test_says_why(small_server: Server, user: User) -> None:
    """Criteria from the tests, cells pasted into them; the reason stands beside the row, on the same screen."""
    user.sits_at(1440, 1000)
    planned = ("M1~20~2050~1500~mph-lb", "M2~30~2050~1500~mph-lb")
    link = {"approach": "displacement_domain", "matrix": "Typed in", "confidence": "0.9"}
    user.open(small_server, "certify", campaign="campaign", planned=planned, **link)
    user.sees("No criteria yet")
    user.press("Limits of these tests")
    user.wait(lambda: "max_crush" in user.browser.current_url)
    user.rests()
    user.clicks_row(1, 120)
    ActionChains(user.browser).send_keys(*[Keys.ARROW_RIGHT] * 3).perform()
    user.pastes("25,0\tmy peak\n49\tmy velocity change")
    user.wait(lambda: "peak~~~25~my peak" in unquote_plus(user.browser.current_url))
    assert "delta_v~~~78.857856~my velocity change" in unquote_plus(user.browser.current_url)
    user.browser.back()
    user.wait(lambda: "my peak" not in unquote_plus(user.browser.current_url))
    user.browser.forward()
    user.wait(lambda: "my peak" in unquote_plus(user.browser.current_url))
    user.presses_until(lambda: user.texts(MAIN, "the answer was skip"), "Certify", f"{MAIN} button")
    user.wait(lambda: not user.all('input[aria-label="Confidence"]'), "The criteria never folded away.")
    user.press(" · change", "summary")
    user.fill("Confidence", "0.85")
    user.wait(lambda: "confidence=0.85" in user.browser.current_url)
    user.press(" · change", "summary")
    user.press("would miss", ".st-key-planned_tests button")
    user.sees("at most 25 g is missed")
    assert "cell=M2" in user.browser.current_url
    places = [user.find(f'[class*="st-key-{key}"]').rect["y"] for key in ("planned_tests", "criterion")]
    assert abs(places[0] - places[1]) < 400
    user.clicks_cell("crush", lambda _, height: (0, -0.25 * height), "20.0 mph, front 2050 lb")  # of two rows
    user.press("Export")
    assert {row["id"] for row in rows(user.downloads_file("certification.csv"))} == {"M1", "M2"}
    user.browser.find_element(By.TAG_NAME, "body").send_keys(Keys.ESCAPE)
    user.press("See the predicted pulse there")
    user.wait(lambda: user.find('input[aria-label="Impact speed (mph)"]').get_attribute("value") == "20.0")
