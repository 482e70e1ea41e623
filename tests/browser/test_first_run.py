"""A newcomer's first steps in a real browser."""

from tests.browser.conftest import DARK, FIGURE, LIGHT, TABLE, Server, User

WATCH = """
const seen = window.seen = new Set();
new MutationObserver(() => {
  for (const link of document.querySelectorAll('[data-testid="stSidebarNavLink"]')) seen.add(link.innerText.trim());
  const main = document.querySelector('[data-testid="stMain"]');
  if (main && main.innerText.includes("Starting")) seen.add("Starting");
  if (main && main.querySelector("h1")) seen.add(main.querySelector("h1").innerText.trim());
}).observe(document, {childList: true, subtree: true, characterData: true});
"""


def test_a_newcomer_gets_from_a_cold_link_to_a_rated_comparison(cold_server: Server, user: User) -> None:
    """Open /compare, load the sample, train without the networks, see the table.

    Dark from the first sight where the system is, light as soon as it becomes so: page, figures, no reload.
    """

    def grounds() -> set[str]:
        shown = (user.find(css) for css in ('[data-testid="stApp"]', f"{FIGURE} .main-svg"))
        return {element.value_of_css_property("background-color") for element in shown}

    user.prefers("dark")
    script = user.browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": WATCH})
    user.open(cold_server, "compare")
    user.sees("No campaign is open yet")
    seen = user.browser.execute_script("return [...window.seen]")
    user.browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)
    assert "Compare" in seen
    assert not {"app", "compare", "data", "predict", "study", "train"} & set(seen)
    user.press("Load the sample campaign")  # the first click counts
    user.sees("has not been predicted yet")
    user.sees("Synthetic")
    user.go("Train")
    user.choose_approaches("CAE", "Displacement domain")
    user.press("Train without them")
    user.sees("Rated, ")
    user.press("Compare T")
    user.sees("Displacement (mm)", FIGURE)
    user.wait(lambda: grounds() == {DARK})
    user.prefers("light")
    user.wait(lambda: grounds() == {LIGHT})
    user.open_tab("Ratings and metrics")
    table = user.sees("Corridor", TABLE)
    assert all(approach in table for approach in ("CAE", "Displacement domain"))
    assert any(grade in table for grade in ("Excellent", "Good", "Fair", "Poor"))
