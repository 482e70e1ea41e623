"""Anything beside anything in a real browser: curves that stay as chosen, pins, the nearest tests."""

from selenium.webdriver.common.keys import Keys

from crashfuse.results.plots.curves import POINTWISE, WHOLE
from tests.browser.conftest import FIGURE, MAIN, PILL, TABLE, Server, User

ONE = {"campaign": "campaign", "approaches": "displacement_domain"}


def legend(user: User) -> list[str]:
    """The names in the legend of the page's first figure."""
    return user.texts(f"{MAIN} :nth-child(1 of {FIGURE}) .legendtext")


def shows(user: User, *names: str) -> None:
    """Wait until the figure shows exactly these curves."""
    user.wait(lambda: sorted(legend(user)) == sorted(names), f"The figure never showed {names}.")


def shows_speed(user: User, value: str, unit: str) -> None:
    """Wait until the field of the speed has this value."""
    field = f'input[aria-label="Impact speed ({unit})"]'
    user.wait(lambda: user.find(field).get_attribute("value") == value, f"The speed was never {value} {unit}.")


def test_curves_and_conditions_stay_as_chosen_whatever_else_is(small_server: Server, user: User) -> None:
    """A hidden curve in another window, another figure and after a reload; the nearest tests come in one click.

    What is beside a held-out test in other units; 56 km/h come back as 56.0, not as 34.8 mph rounded twice.
    """
    shown = ("Displacement domain", POINTWISE, WHOLE)
    user.open(small_server, "compare", **ONE, test="T2")
    user.starts("Predict test T2", FIGURE)
    shows(user, "Test", *shown)
    user.press_inside("Curves", "Test", PILL)
    shows(user, *shown)
    user.press("Corridors", "label")
    user.sees("Corridor of the rating, inner", FIGURE)
    assert "Test" not in legend(user)
    user.rates_over("40")
    user.wait(lambda: "window=40" in user.browser.current_url)
    user.opens("Curves")
    user.find('input[aria-label^="Also show"]').send_keys("C01", Keys.ENTER)
    user.sees("C01 · ", FIGURE)
    user.press("Nearest tests", "label")
    user.sees("T3 · 26.0 mph", FIGURE)
    user.sees("T4 · 35.0 mph", FIGURE)
    user.press("Over displacement", f"{MAIN} {PILL}")
    user.sees("Displacement (mm)", FIGURE)
    user.sees("T3 · 26.0 mph", FIGURE)
    user.sees("C01 · ", FIGURE)
    assert "Test" not in legend(user)
    user.browser.refresh()
    user.sees("T1 · 15.0 mph", FIGURE)
    user.sees("C01 · ", FIGURE)
    assert "Test" not in legend(user)
    user.press("Nearest tests", "label")
    user.wait(lambda: "T1 · 15.0 mph" not in legend(user))
    assert "C01 · " in "".join(legend(user))
    user.open(small_server, "compare", **ONE, test="T2", compare_also=("T3", "T4"))
    user.sees("T4 · 35.0 mph", FIGURE)
    for units, named in (("km/h, kg", "T4 · 56.3 km/h"), ("mph, lb", "T4 · 35.0 mph")):
        user.press(units)
        user.sees(named, FIGURE)
        user.opens("Curves")
        user.rates_over("40")
        user.wait(lambda: "window=40" in user.browser.current_url)
        user.rates_over("60")
        user.wait(lambda: "window=40" not in user.browser.current_url)
        user.sees(named, FIGURE)
        assert "Test T2: " in user.sees("Compare")
        assert "test=T2" in user.browser.current_url
        assert "compare_also=T3&compare_also=T4" in user.browser.current_url
    user.open(small_server, "predict", campaign="campaign", approaches="cae")
    user.starts("Predict", FIGURE)
    user.sees("Velocity (mph)", FIGURE)
    user.press("km/h, kg")
    user.sees("Velocity (km/h)", FIGURE)
    user.fill("Impact speed (km/h)", "56")
    shows_speed(user, "56.0", "km/h")
    user.press("More metrics", "summary")
    assert " lb" not in user.sees("kg in all")
    assert "(mph)" not in user.sees("ΔV (km/h)", TABLE)
    user.press("Export")
    report = user.downloads_file("report.html")
    assert "prediction at 56.0 km/h, front" in report
    assert "--speed-kph 56 --front-weight-kg" in report
    user.press("", '[data-testid="stDialog"] [aria-label="Close"]')
    user.press("mph, lb")
    shows_speed(user, "34.8", "mph")
    assert "km/h" not in user.sees("ΔV (mph)", TABLE)
    user.browser.refresh()
    shows_speed(user, "34.8", "mph")
    user.press("km/h, kg")
    shows_speed(user, "56.0", "km/h")
