"""Units in a real browser: one choice, which condition, figure, table and report follow."""

import pytest

from tests.browser.conftest import FIGURE, TABLE, Server, User

pytestmark = pytest.mark.slow


def shows_speed(user: User, value: str, unit: str) -> None:
    """Wait until the field of the speed has this value."""
    field = f'input[aria-label="Impact speed ({unit})"]'
    user.wait(lambda: user.find(field).get_attribute("value") == value, f"The speed was never {value} {unit}.")


def test_all_of_predict_follows_the_units(small_server: Server, user: User) -> None:
    """The condition stays the very same: 56 km/h come back as 56.0, not as 34.8 mph rounded twice."""
    user.open(small_server, "predict", campaign="campaign", approaches="cae")
    user.starts("Predict", FIGURE)
    user.sees("Velocity (mph)", FIGURE)
    user.press("km/h, kg")
    user.sees("Velocity (km/h)", FIGURE)
    user.fill("Impact speed (km/h)", "56")
    shows_speed(user, "56.0", "km/h")
    user.press("More: ", "summary")
    assert " lb" not in user.sees("kg in all")
    assert "(mph)" not in user.sees("ΔV, rebound included (km/h)", TABLE)
    user.press("Export")
    report = user.downloads_file("report.html")
    assert "prediction at 56.0 km/h, front" in report
    assert "--speed-kph 56 --front-weight-kg" in report
    user.press("", '[data-testid="stDialog"] [aria-label="Close"]')
    user.press("mph, lb")
    shows_speed(user, "34.8", "mph")
    assert "km/h" not in user.sees("ΔV, rebound included (mph)", TABLE)
    user.browser.refresh()
    shows_speed(user, "34.8", "mph")
    user.press("km/h, kg")
    shows_speed(user, "56.0", "km/h")


def test_other_units_change_neither_the_held_out_test_nor_what_is_beside_it(small_server: Server, user: User) -> None:
    """A browser keeps a choice by its label, which has the speed in it: it must not come back as another test."""
    link = {"campaign": "campaign", "approaches": "displacement_domain", "test": "T3"}
    user.open(small_server, "compare", **link, compare_also=("T2", "T4"))
    user.starts("Predict test T3", FIGURE)
    user.sees("T4 · 35.0 mph", FIGURE)
    for units, beside in (("km/h, kg", "T4 · 56.3 km/h"), ("mph, lb", "T4 · 35.0 mph")):
        user.press(units)
        user.sees(beside, FIGURE)
        user.opens("Curves")
        user.rates_over("40")
        user.wait(lambda: "window=40" in user.browser.current_url)
        user.rates_over("60")
        user.wait(lambda: "window=40" not in user.browser.current_url)
        user.sees(beside, FIGURE)
        assert "Test T3: " in user.sees("Compare")
        assert "test=T3" in user.browser.current_url
        assert "compare_also=T2&compare_also=T4" in user.browser.current_url
