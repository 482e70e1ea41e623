"""The first screen in a real browser: what stands above the fold, narrow windows, the keyboard, zoom, contrast."""

import re
import time
from typing import TYPE_CHECKING

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tests.browser.conftest import DARK, FIGURE, LIGHT, LINK, MAIN, PAIRED, QUICK, SIDEBAR, TABLE, drawn_again, top_of

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User

LEGIBLE_PX, TEXT, LARGE = 11, 4.5, 3.0

# Of every visible word: its size, and its contrast (WCAG 2.1) to what lies under it. Words of an SVG that stand on a
# coloured cell or band are left to the tests of the palette.
_WORDS = """
const numbers = c => (c.match(/[\\d.]+/g) ?? []).map(Number);
const parts = c => numbers(c).length > 2 ? [...numbers(c), 1].slice(0, 4) : null;
const over = (a, b) => [0, 1, 2].map(i => a[3] * a[i] + (1 - a[3]) * b[i]).concat(1);
const luminance = c => [0.2126, 0.7152, 0.0722].reduce((sum, weight, i) => {
  const v = c[i] / 255; return sum + weight * (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4); }, 0);
const above = e => { const line = []; for (; e; e = e.parentElement) line.push(getComputedStyle(e)); return line; };
const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let node; node = walker.nextNode();) {
  const e = node.parentElement, text = node.textContent.trim(), box = e.getBoundingClientRect();
  const drawn = e.checkVisibility({ opacityProperty: true, visibilityProperty: true });
  const seen = drawn && box.width > 1 && box.height > 1;
  if (!text || !seen || e.closest('[aria-hidden="true"], [role="img"], [disabled], [data-testid="stSlider"]')) continue;
  const style = getComputedStyle(e), svg = e.closest("svg"), size = parseFloat(style.fontSize);
  if (svg && e.closest(".plot")) { found.push([text, size, 21, 0]); continue; }
  const lines = above(svg ? svg.parentElement : e);
  const ground = lines.map(s => parts(s.backgroundColor)).reverse().reduce((under, c) => c ? over(c, under) : under,
                                                                            [255, 255, 255, 1]);
  const ink = parts(svg ? style.fill : style.color), opacity = lines.reduce((all, s) => all * s.opacity, 1);
  const [dim, bright] = [luminance(over([...ink.slice(0, 3), ink[3] * opacity], ground)), luminance(ground)].sort();
  found.push([text, size, (bright + 0.05) / (dim + 0.05), size >= 24]);
}
return found;
"""


@pytest.fixture
def predicted(engineer: "User") -> "User":
    """Someone before the comparison of the small campaign's first test."""
    engineer.find(".cf-ratings")
    return engineer


def test_compare_shows_its_figure_on_the_first_screen_and_one_tab_at_a_time(predicted: "User") -> None:
    """Ratings in one row, the recommended one marked; a sentence, its reasons on demand; the figure within 350 px.

    Its margins are wide enough from the start: Plotly would draw it once more. Its titles are no larger than its other
    words. In tables numbers stand at the right, their intervals lighter.
    """
    predicted.sees("Velocity (mph)", FIGURE)
    assert not drawn_again(predicted)
    assert {words.value_of_css_property("font-size") for words in predicted.all(f"{FIGURE} svg text")} <= {
        "14px",
        "12px",
    }
    predicted.wait(lambda: top_of(predicted, FIGURE) <= 350, "The figure began below 350 px.", 10)
    tops = {element.rect["y"] for element in predicted.all(".cf-ratings > div")}
    assert len(tops) == 1
    assert predicted.texts(".cf-best")[0].startswith(("CAE", "Displacement domain"))
    assert not predicted.all(MAIN, "The raw CAE model rated")
    assert not predicted.all(MAIN, "Single draws")
    predicted.press("More", '[data-testid="stPopover"] button')
    predicted.sees("rated", '[data-testid="stPopoverBody"]')
    predicted.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    predicted.open_tab("Ratings and metrics")
    predicted.sees("Single draws", TABLE)  # among the details
    crush = predicted.find(f"{MAIN} {TABLE} td", " [")  # the details are drawn before the metrics
    interval = crush.find_element(By.TAG_NAME, "span")
    assert crush.value_of_css_property("text-align") == "right"
    assert interval.value_of_css_property("color") != crush.value_of_css_property("color")
    predicted.wait(lambda: not predicted.all(FIGURE))
    predicted.open_tab("Networks")
    predicted.sees("No approach with a network")
    predicted.wait(lambda: not predicted.all(TABLE))


def test_the_sidebar_folds_in_a_narrow_window_and_comes_back_in_a_wide_one(predicted: "User") -> None:
    """By itself; a narrow window can open it, over the page."""

    def shown() -> bool:
        links = predicted.all(LINK)
        return any(0 <= link.rect["x"] < 300 for link in links)

    predicted.wait(shown)
    predicted.sits_at(900, 1000)
    predicted.wait(lambda: not shown())
    left = predicted.find(".cf-ratings").rect["x"]
    predicted.press("", '[data-testid="stExpandSidebarButton"]')
    predicted.wait(shown)
    assert predicted.find(".cf-ratings").rect["x"] == left
    predicted.browser.refresh()
    predicted.find(".cf-ratings")
    predicted.wait(lambda: not shown())
    predicted.sits_at(700, 1000)
    time.sleep(1)
    predicted.sits_at(900, 1000)  # Streamlit itself would open it again
    time.sleep(2)
    assert not shown()
    predicted.sits_at(1440, 1000)
    predicted.wait(shown)


def test_every_word_can_be_read_at_900_px(predicted: "User") -> None:
    """Nothing below 11 px, in figures neither; contrast of 4.5, of large words 3, in both themes; no grade glares.

    What is chosen above a figure lies in one row.
    """
    predicted.sits_at(900, 1000)
    predicted.open_tab("Over displacement")
    ends = [predicted.find("button", words) for words in ("Check of the integration", "Nearest tests")]
    predicted.wait(lambda: abs(ends[0].rect["y"] - ends[1].rect["y"]) < 10, "One lies below the other.", 10)
    for tab, shown in (("Pulses", "Corridors of the rating"), ("Ratings and metrics", "Pulse metrics")):
        predicted.open_tab(tab)
        predicted.sees(shown)
        for theme, ground in (("dark", DARK), ("light", LIGHT)):
            predicted.prefers(theme)
            app = predicted.find('[data-testid="stApp"]')
            predicted.wait(lambda app=app, ground=ground: app.value_of_css_property("background-color") == ground)  # type: ignore[misc]
            predicted.wait(lambda: not unreadable(predicted), f"Words that cannot be read: {unreadable(predicted)}", 10)
            predicted.wait(lambda theme=theme: glares(predicted) == [theme == "light"] * len(QUICK))  # type: ignore[misc]


def test_the_heat_map_can_be_read_at_900_px(small_server: "Server", user: "User") -> None:
    """As large as all other words. The sidebar asks for nothing that does not act on the page."""
    user.sits_at(900, 1000)
    user.open(small_server, "study", approaches=QUICK)
    user.starts("Leave out each of 4 tests", FIGURE)
    user.sees("Mean over the tests")
    user.wait(lambda: not unreadable(user), f"Words that cannot be read: {unreadable(user)}", 10)
    user.press("", '[data-testid="stExpandSidebarButton"]')
    assert "Held-out test" not in user.sees("Rated time window", SIDEBAR)


def glares(user: "User") -> list[bool]:
    """Whether the fill of each grade word is bright."""
    fills = [chip.value_of_css_property("background-color") for chip in user.all(".cf-grade")]
    return [max(map(int, re.findall(r"\d+", colour)[:3])) > 170 for colour in fills]


def unreadable(user: "User") -> list[str]:
    """Words that are too small or too dim."""
    return [
        f"{text[:30]}: {size:.0f} px, {contrast:.1f}"
        for text, size, contrast, large in user.browser.execute_script(_WORDS)
        if size < LEGIBLE_PX or contrast < (LARGE if large else TEXT)
    ]


def test_a_page_can_be_used_at_twice_its_size(predicted: "User") -> None:
    """Nothing lies beyond the edge, and every tab is reached."""
    predicted.sits_at(1440, 1000, zoom=2.0)
    for tab in ("Over displacement", "Ratings and metrics", "Files and report", "Pulses"):
        predicted.open_tab(tab)
    predicted.sees("Velocity (mph)", FIGURE)
    beyond = (
        "const main = document.querySelector('[data-testid=\"stMain\"]'); return main.scrollWidth - main.clientWidth"
    )
    assert predicted.browser.execute_script(beyond) <= 0


# Of every visible field for which nothing is chosen: the words in it, and by how many pixels they are cut.
_CUT = """
const pen = document.createElement("canvas").getContext("2d");
return [...document.querySelectorAll("[data-testid='stMain'] input[placeholder]")].map(field => {
  const { font, paddingLeft, paddingRight } = getComputedStyle(field);
  pen.font = font;
  const room = field.clientWidth - parseFloat(paddingLeft) - parseFloat(paddingRight);
  return [field.placeholder, pen.measureText(field.placeholder).width - room];
}).filter(([words]) => words);
"""


def test_what_is_not_given_can_be_read_at_twice_its_size(server: "Server", user: "User") -> None:
    """In the fields for the factors, the narrowest of the page."""
    user.sits_at(1440, 1000, zoom=2.0)
    user.open(server, "predict", campaign="sample")
    cut = user.wait(lambda: user.browser.execute_script(_CUT), "No field is without a choice.")
    assert [words for words, too_wide_px in cut if too_wide_px > 0] == []
    assert "not given" in dict(cut)


_COUNT_DRAWN = """
window.drawn = 0;
new MutationObserver(changes => { window.drawn += changes.some(each => each.target.matches("path.js-line")); })
  .observe(document.body, { subtree: true, attributes: true, attributeFilter: ["d"] });
"""
_TOLD_ITS_WIDTH = "return document.querySelector('.js-plotly-plot')?.layout.width && window.drawn"


def test_a_figure_is_drawn_once(predicted: "User") -> None:
    """Streamlit hands it to Plotly a second time, with its width: nothing changes by that."""
    predicted.go("Train")
    predicted.find('[data-testid="stRadio"]')
    predicted.browser.execute_script(_COUNT_DRAWN)
    predicted.go("Compare")
    predicted.wait(lambda: predicted.browser.execute_script(_TOLD_ITS_WIDTH))
    time.sleep(1)
    assert predicted.browser.execute_script("return window.drawn") == 1


def test_data_shows_one_figure_at_a_time_and_the_link_has_which(engineer: "User") -> None:
    """The tests first; conditions with the ratings, and the CAE model, in tabs of their own.

    A test with a CAE run at its condition is in range, in the table and in the figure; the report says the same. What
    a link asks for in vain is said below the choices, which stay in their row at 900 px.
    """
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
    engineer.sits_at(900, 1000)
    engineer.browser.get(f"{engineer.browser.current_url}&also=T99")
    engineer.sees("Not among the tests in use and the CAE runs: T99.")
    field = engineer.find(f'{MAIN} [data-testid="stMultiSelect"]').rect
    button = engineer.find(f"{MAIN} button", "Add curves").rect
    assert abs(field["y"] + field["height"] - button["y"] - button["height"]) < 10
