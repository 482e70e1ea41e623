"""Studies in a real browser: a test opened by mouse and by keyboard, two studies compared, a worst test explained."""

import re
from dataclasses import replace
from pathlib import Path

from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from crashfuse.campaign import Campaign
from tests.browser.conftest import APPROACH, DIALOG, FIGURE, MAIN, PILL, QUICK, SIDEBAR, SOON, Server, User
from tests.conftest import write_campaign
from tests.study.test_outliers import at_one_speed

_LOOKS = """
return document.querySelector(".js-plotly-plot").data.map(
  each => [each.name, each.line.color, each.line.dash, each.marker?.symbol ?? "none"]);
"""


def study(user: User, server: Server, **view: str) -> None:
    """The study of the small campaign by two quick approaches; the first test that asks for it has it made."""
    user.open(server, "study", approaches=QUICK, **view)
    user.starts("Leave out each of 4 tests", FIGURE)
    user.wait(lambda: not user.all("button", "Cancel"), "The study never ended.", 4 * SOON)
    user.sees("Mean over the tests")  # the end of the page: until then the figures move
    user.rests()  # with the last result drawn


def test_a_cell_opens_its_test_and_studies_are_reported_compared_and_opened_again(
    small_server: Server, user: User
) -> None:
    """Arrows move from cell to cell, Enter does what a click anywhere in the cell does, as does a field below.

    Back leads to the study with all at about a test's speed left out; Space opens a rating. The report is short, of
    one test, in kg and m/s². Two ticks: means, differences, a table to take along; a button opens one. Escape closes
    the dialog of files, and Back does not open it again.
    """
    study(user, small_server)
    heat_map = f'{FIGURE}[tabindex="0"]'
    user.types(heat_map, Keys.ARROW_UP)
    user.sees("Test T2", f"{FIGURE} .hoverlayer")  # one row above the middle one of five
    ring = "return getComputedStyle(document.activeElement, '::after').borderTopStyle"  # above what is drawn
    assert user.browser.execute_script(ring) == "solid"
    user.types(heat_map, Keys.ESCAPE)
    user.wait(lambda: not user.all(f"{FIGURE} .hoverlayer", "Test T2"), "Escape did not take the cursor away.")
    user.types(heat_map, Keys.ENTER)
    user.sees("Test T2: 25.0 mph")
    user.wait(lambda: user.browser.switch_to.active_element.tag_name == "h1", "The focus was lost with the figure.")
    user.browser.back()
    user.sees("Mean over the tests")
    asked = "With all tests at about its speed"
    user.press(asked, '[data-testid="stButtonGroup"] button')
    user.wait(lambda: "ways=" in user.browser.current_url)
    # 2 columns; 5 rows: the tests, and their mean
    user.clicks_cell("Test T3", lambda width, height: (0.15 * width, (2.3 / 5 - 0.5) * height), "Test T3: 26.0 mph")
    user.wait(lambda: "Displacement domain" in user.chosen_approach, "Why would be of another approach.")
    assert "test=T3" in user.browser.current_url
    user.browser.back()
    chosen = '[data-testid="stButtonGroup"] button[aria-checked="true"]'
    user.wait(lambda: asked in user.texts(chosen), "Back led to another question.")
    study(user, small_server)
    user.browser.execute_script("document.activeElement.blur(); window.focus()")
    keyboard = ActionChains(user.browser)

    focused = (
        "const e = document.activeElement;"
        "return [e.tagName, getComputedStyle(e).outlineStyle, e.getAttribute('aria-label')]"
    )

    def reached(label: str) -> bool:
        keyboard.send_keys(Keys.TAB).perform()
        kind, outline, name = user.browser.execute_script(focused)
        assert kind != "A" or outline == "solid"
        return bool(name == label)

    assert any(reached("Open a test on Compare") for _ in range(80))
    keyboard.send_keys("T3").perform()
    user.find('[role="option"]', "T3")
    keyboard.send_keys(Keys.ENTER).perform()
    user.sees("Test T3: 26.0 mph")

    def explained() -> bool:
        user.find(f"{APPROACH} button", "CAE 0.").send_keys(Keys.SPACE)
        return "explained=cae" in user.browser.current_url

    user.wait(explained, "Space chose no approach.")
    assert user.browser.execute_script("return document.querySelector('[data-testid=stMain]').scrollTop") == 0
    user.becomes_another()
    user.sits_at(1440, 1000)
    study(user, small_server)
    user.press("km/h, kg", f"{SIDEBAR} button")
    user.press("m/s²", f"{SIDEBAR} button")
    user.open_tab("Bands")
    user.sees("Above the dotted line")
    user.press("Export")
    user.press("Short", PILL)
    user.find('input[aria-label^="Tests shown one by one"]').send_keys("T3", Keys.ENTER, Keys.TAB)
    user.wait(lambda: user.all(DIALOG, "T3"))
    report = user.downloads_file("report.html")
    assert re.findall("<h2>Test (T.): ([^<]*), front", report) == [("T3", "41.8 km/h")]
    assert "Method and settings" not in report
    assert "<td>Peak deceleration (m/s²)</td>" in report
    study(user, small_server, seed="4")
    user.sees("Fast settings, seed 4", ".st-key-head")
    user.open_tab("Past results")
    for row, found in enumerate(("Open 20", "The two compared")):
        user.clicks_row(row, 18)  # the box
        user.sees(found)
    user.sees("mean", f"{MAIN} li")
    user.press("Export")
    written = user.downloads_file("comparison.csv")
    assert written.startswith("left_out,held_out,approach,window_ms,first,second,difference")
    user.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    user.wait(lambda: not user.all(DIALOG))
    user.browser.back()
    user.wait(lambda: not user.all(MAIN, "The two compared"))
    assert not user.all(DIALOG)
    user.press("Open 20", f"{MAIN} button")
    user.sees("Mean over the tests")
    assert "seed=4" in user.browser.current_url


def test_a_rating_leads_to_its_parts_and_the_worst_test_to_what_sets_it_apart(
    server: Server, user: User, campaign: "Campaign", tmp_path: "Path"
) -> None:
    """The study names the odd test, Compare how its expectation came out; one click on Why: scores, shift, curves."""
    group = at_one_speed(campaign, [1.0, 1.02, 0.95, 1.3])
    tests = (campaign.test("T1"), *group.tests)
    user.open_folder(server, write_campaign(replace(campaign, tests=tests), tmp_path / "odd"))
    user.sees("S4 · 25.0 mph", FIGURE)
    looks = [look for name, *look in user.browser.execute_script(_LOOKS) if name.startswith("S")]
    assert [len({*kind}) for kind in zip(*looks, strict=True)] == [1, 4, 4]  # the colour is that of the speed
    user.open(server, "study", campaign="odd", test="S4", approaches=QUICK)
    user.press("Leave out each of 5 tests")
    user.sees("A speed left out", timeout_s=4 * SOON)  # known last, after ten fits
    user.press("The worst test, S4", "summary")
    said = user.sees("it rates 0.")
    assert "We left out S4 (25.0 mph) and rated it over 0–60 ms. Rated 0." in said
    assert re.search(r"far below what we expected: 0\.\d\d to 0\.\d\d \(80.%\)\. S4 differs from the other ", said)
    user.go("Compare")
    user.sees("far below what we expected (0.")
    user.press("Why", PILL)
    user.sees("Corridor (40 %)", FIGURE)
    told = user.sees("curves as they stand")
    assert "costs most" in told
    assert "S4 differs from the other " in told
    user.press("The other three scores", "summary")
    for part in ("Corridor", "Phase", "Magnitude", "Slope"):
        user.sees(f"{part} 0.")
    drawn = user.sees("curves as they stand", FIGURE)
    assert "moved" in drawn
    assert "Outside the inner corridor" in drawn
    user.chooses_approach("CAE 0.")
    user.sees("CAE 0.")
    user.wait(lambda: "explained=cae" in user.browser.current_url)
    user.browser.refresh()
    user.sees("CAE 0.")
    assert "explained=cae" in user.browser.current_url
