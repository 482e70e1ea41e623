"""The frame in a real browser: links into a server that nobody has used, and both themes."""

from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

import pytest

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User

SIDEBAR = '[data-testid="stSidebar"]'
VIEW = {"campaign": "sample", "held_out": "T03 · 16.7 mph", "window": "0–40 ms", "unit": "m/s²", "sign": "Deceleration"}
OWN = ("SVG", "PNG")  # how a reader saves figures is no part of what a link shows
LIGHT, DARK = "rgba(255, 255, 255, 1)", "rgba(20, 24, 31, 1)"


@pytest.mark.parametrize("page", ["data", "train", "compare", "study", "predict", "certify"])
def test_a_link_reproduces_the_view_on_a_cold_server(server: "Server", user: "User", page: str) -> None:
    """Campaign, test, window, unit and sign, on whichever page; a reload and another page keep them."""

    def asked() -> bool:
        given = {name: values[0] for name, values in parse_qs(urlsplit(user.browser.current_url).query).items()}
        pressed = [element.text for element in user.all(f'{SIDEBAR} [aria-checked="true"]') if element.text not in OWN]
        chosen = [element.get_attribute("value") for element in user.all(f"{SIDEBAR} input")]
        return given == VIEW and [*chosen[:2], *pressed] == list(VIEW.values())

    user.open(server, page, **VIEW)
    user.wait(asked)
    pages = [link.text.split()[-1] for link in user.all('[data-testid="stSidebarNavLink"]')]
    assert pages == ["Data", "Train", "Compare", "Study", "Predict", "Certify"]
    user.browser.refresh()
    user.wait(asked)
    other = {"data": "Study"}.get(page, "Data")
    user.go(other)
    user.wait(lambda: urlsplit(user.browser.current_url).path == f"/{other.lower()}" and asked())


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
