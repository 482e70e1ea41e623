"""Results in a real browser: figures that are switched and clicked, files that arrive, answers at once."""

import csv
import io
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest
from selenium.common.exceptions import TimeoutException
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from selenium.webdriver.remote.webelement import WebElement

    from tests.browser.conftest import Server, User

FIGURE = ".js-plotly-plot"


@pytest.fixture
def engineer(small_server: "Server", user: "User") -> "User":
    """Someone who has the small campaign open, and has chosen two quick approaches."""
    user.open(small_server, "train", test="T1")
    user.choose_approaches("CAE", "Displacement domain")
    return user


def rows(text: str) -> list[dict[str, str]]:
    """A CSV file's rows by column."""
    return list(csv.DictReader(io.StringIO(text)))


def test_compare_switches_its_figure_and_hands_out_whole_files(engineer: "User") -> None:
    """Corridors, residuals; scores and pulses as CSV; a report from its first to its last line."""
    engineer.go("Compare")
    engineer.press("Predict test T1")
    engineer.sees("Velocity (mph)", FIGURE)
    assert "Corridor of the rating" not in engineer.find(FIGURE).text
    engineer.press("Corridors of the rating", "label")
    engineer.sees("Corridor of the rating, inner", FIGURE)
    engineer.press("Residuals")
    engineer.sees("Prediction − test", FIGURE)
    engineer.press("Motion")
    engineer.sees("Corridor of the rating, inner", FIGURE)  # the choice has held
    engineer.open_tab("Ratings and metrics")
    shown = engineer.sees("Corridor", '[data-testid="stTable"]')
    engineer.open_tab("Files and report")
    scores = rows(engineer.downloads_file("scores.csv"))
    assert {(row["held_out"], row["approach"]) for row in scores} == {("T1", "cae"), ("T1", "displacement_domain")}
    assert all(f"{float(row['overall']):.3f} {row['grade']}" in shown for row in scores)
    assert len(rows(engineer.downloads_file("pulses.csv"))) == 2 * 1250
    report = engineer.downloads_file("report.html")
    assert report.startswith("<!doctype html>")
    assert report.rstrip().endswith("</html>")
    assert "Test T1" in report


def test_a_click_on_a_cell_of_the_study_opens_its_test_on_compare(engineer: "User") -> None:
    """Anywhere in the cell, not only on the words; the frame then holds that test out."""
    engineer.go("Study")
    engineer.press("Leave out each of 4 tests")
    engineer.sees("Mean over the tests")  # the end of the page: until then the figures move

    def opened() -> bool:
        figure = engineer.find(FIGURE, "Test T3")
        engineer.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", figure)
        cells = figure.find_element(By.CSS_SELECTOR, ".nsewdrag")  # 2 columns; 5 rows: the tests, and their mean
        right, down = round(0.15 * cells.rect["width"]), round((2.3 / 5 - 0.5) * cells.rect["height"])  # of the centre
        ActionChains(engineer.browser).move_to_element_with_offset(cells, right, down).pause(0.5).click().perform()
        with suppress(TimeoutException):
            return bool(engineer.sees("Test T3: 26.0 mph", timeout_s=15))
        return False

    engineer.wait(opened)
    assert "test=T3" in engineer.browser.current_url


def test_a_click_on_a_cell_of_the_matrix_says_why(engineer: "User", small_server: "Server") -> None:
    """Conditions of a grid, criteria from a file; the cell is in the address, and its condition on Predict."""
    criteria = engineer.downloads.parent / "criteria.toml"
    criteria.write_text('confidence = 0.9\n[[criterion]]\nmetric = "peak"\nat_most = 25\n', encoding="utf-8")
    link = {"approach": "displacement_domain", "matrix": "Grid", "speeds": "20, 30"}
    engineer.open(small_server, "certify", campaign="campaign", **link)
    engineer.sees("No criteria yet")
    engineer.press("How criteria are declared", "summary")
    engineer.wait(lambda: engineer.browser.find_elements(By.CSS_SELECTOR, 'input[type="file"]'))[0].send_keys(
        str(criteria)
    )
    engineer.press("Certify", '[data-testid="stMain"] button')
    engineer.sees("report.html")

    def told() -> bool:
        figure = engineer.find(FIGURE, "M002 · 30.0 mph")
        engineer.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", figure)
        cells = figure.find_element(By.CSS_SELECTOR, ".nsewdrag")  # a column of two rows
        down = round(0.2 * cells.rect["height"])
        ActionChains(engineer.browser).move_to_element_with_offset(cells, 200, down).pause(0.5).click().perform()
        with suppress(TimeoutException):
            return bool(engineer.sees("M002 | peak: not met", timeout_s=15))
        return False

    engineer.wait(told)
    assert "cell=M002" in engineer.browser.current_url
    assert "criteria=peak%7E%7E%7E25" in engineer.browser.current_url.replace("~", "%7E")
    assert {row["verdict"] for row in rows(engineer.downloads_file("certification.csv"))} == {"met", "not met"}
    engineer.press("See the predicted pulse there")
    engineer.wait(lambda: engineer.find('input[aria-label="Impact speed (mph)"]').get_attribute("value") == "30.0")


def test_predict_answers_another_speed_at_once(engineer: "User") -> None:
    """Number field and slider follow each other, and the figure follows both; sweep and next test lie in tabs."""
    engineer.go("Predict")
    engineer.press("Predict", '[data-testid="stMain"] button')
    engineer.sees("Use the")
    field = engineer.find('input[aria-label="Impact speed (mph)"]')
    field.send_keys(Keys.CONTROL, "a")
    field.send_keys("31.5", Keys.ENTER)
    engineer.sees("31.5 mph, front")
    slider = engineer.browser.find_element(By.CSS_SELECTOR, '[data-testid="stSlider"] input')
    engineer.wait(lambda: slider.get_attribute("value") == "31.5")
    slider.send_keys(Keys.ARROW_LEFT)
    engineer.sees("31.4 mph, front")
    engineer.wait(lambda: field.get_attribute("value") == "31.4")
    engineer.open_tab("Over speed")
    engineer.press("Predict over speed")
    engineer.sees("Impact speed", FIGURE)
    engineer.open_tab("Next test")
    engineer.sees("The best 5")

    def slowest() -> "WebElement":
        return engineer.browser.find_element(By.CSS_SELECTOR, 'input[aria-label^="Speeds (mph)"]')  # the thumb is drawn

    usual = slowest().get_attribute("value")
    slowest().send_keys(Keys.ARROW_RIGHT)
    engineer.wait(lambda: "speed_range=" in engineer.browser.current_url)
    engineer.browser.back()
    engineer.wait(lambda: "speed_range=" not in engineer.browser.current_url)
    engineer.wait(lambda: slowest().get_attribute("value") == usual)
