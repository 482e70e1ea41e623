"""The frame in a real browser: links into a server that nobody has used, and both themes."""

from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

import pytest

from tests.browser.conftest import LINK

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User

SIDEBAR = '[data-testid="stSidebar"]'
VIEW = {"campaign": "sample", "test": "T03", "window": "40", "unit": "m/s²", "sign": "Deceleration"}
SHOWN = ["sample", "T03 · 16.7 mph", "0–40 ms", "m/s²", "Deceleration"]
USUAL = ("The test", "mph, lb")  # what is left out and the units, where nobody chose: no part of the address
LIGHT, DARK = "rgba(255, 255, 255, 1)", "rgba(20, 24, 31, 1)"


def asked(user: "User") -> dict[str, str]:
    """What the address says."""
    return {name: values[0] for name, values in parse_qs(urlsplit(user.browser.current_url).query).items()}


def shown(user: "User") -> list[str]:
    """What is chosen in the sidebar."""
    pressed = [element.text for element in user.all(f'{SIDEBAR} [aria-checked="true"]') if element.text not in USUAL]
    chosen = [str(element.get_attribute("value")) for element in user.all(f"{SIDEBAR} input")]
    return [*chosen[:2], *pressed]


@pytest.mark.parametrize("page", ["data", "compare"])
def test_a_link_reproduces_the_view_on_a_cold_server(server: "Server", user: "User", page: str) -> None:
    """Campaign, test, window, unit and sign; a reload and another page keep them, and Back leads to it again."""

    def same() -> bool:
        return asked(user) == VIEW and shown(user) == SHOWN

    user.open(server, page, **VIEW)
    user.wait(same)
    pages = [link.text.split()[-1] for link in user.all(LINK)]
    assert pages == ["Data", "Train", "Compare", "Study", "Predict", "Certify", "History"]
    user.browser.refresh()
    user.wait(same)
    other = {"data": "Compare"}.get(page, "Data")
    user.go(other)
    user.wait(lambda: urlsplit(user.browser.current_url).path == f"/{other.lower()}" and same())
    user.browser.back()
    user.wait(lambda: urlsplit(user.browser.current_url).path == f"/{page}" and same())


@pytest.mark.parametrize("page", ["train", "study", "predict", "certify"])
def test_a_page_opens_by_its_link_on_a_cold_server(server: "Server", user: "User", page: str) -> None:
    """The campaign of the link is open, and its address holds no less than it did."""
    user.open(server, page, campaign="sample", seed="3")
    user.wait(lambda: shown(user)[:1] == ["sample"])
    user.wait(lambda: asked(user)["campaign"] == "sample" and asked(user)["seed"] == "3")


def test_back_undoes_the_last_choice_and_no_more(server: "Server", user: "User") -> None:
    """Two choices, of different kinds, are undone one by one, and made again by Forward."""
    user.open(server, "compare", campaign="sample", test="T03")
    user.wait(lambda: "T03 · 16.7 mph" in shown(user))
    user.press("0–20 ms", f"{SIDEBAR} button")
    user.wait(lambda: asked(user).get("window") == "20")
    user.press("All at its speed", f"{SIDEBAR} button")
    user.wait(lambda: asked(user).get("leave_out") == "speed group")
    user.browser.back()
    user.wait(lambda: shown(user)[1:3] == ["T03 · 16.7 mph", "0–20 ms"] and "leave_out" not in asked(user))
    user.browser.back()
    user.wait(lambda: shown(user)[1:3] == ["T03 · 16.7 mph", "0–60 ms"] and "window" not in asked(user))
    assert urlsplit(user.browser.current_url).path == "/compare"
    user.browser.forward()
    user.browser.forward()
    user.wait(lambda: shown(user)[2:4] == ["All at its speed", "0–20 ms"] and asked(user)["window"] == "20")


def test_the_page_and_its_figures_follow_the_theme(server: "Server", user: "User") -> None:
    """Dark from the first sight where the system is, light as soon as it becomes so: page, figures, no reload."""

    def grounds() -> tuple[str, str]:
        app, figure = (user.find(css) for css in ('[data-testid="stApp"]', ".js-plotly-plot .main-svg"))
        return app.value_of_css_property("background-color"), figure.value_of_css_property("background-color")

    user.prefers("dark")
    user.open(server, "data", campaign="sample")
    user.sees("CAE runs")
    user.wait(lambda: grounds() == (DARK, DARK))
    user.prefers("light")
    user.wait(lambda: grounds() == (LIGHT, LIGHT))
