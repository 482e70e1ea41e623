"""The frame in a real browser: links into a server that nobody has used, and Back."""

from collections.abc import Iterator
from urllib.parse import parse_qs, urlsplit

from tests.browser.conftest import FIGURE, LINK, MAIN, SIDEBAR, Server, User

VIEW = {"campaign": "sample", "test": "T03", "window": "40", "unit": "m/s²", "sign": "Deceleration", "seed": "3"}
SHOWN = ["sample", "T03 · 16.7 mph", "0–40 ms", "m/s²", "+"]
USUAL = ("The test", "mph, lb")  # what is left out and the units, where nobody chose: no part of the address

PAGES = ["Data", "Train", "Compare", "Study", "Predict", "Certify"]


def asked(user: User) -> dict[str, str]:
    """What the address says."""
    return {name: values[0] for name, values in parse_qs(urlsplit(user.browser.current_url).query).items()}


def shown(user: User) -> list[str]:
    """What is chosen in the sidebar."""
    pressed = [text for text in user.texts(f'{SIDEBAR} [aria-checked="true"]') if text not in USUAL]
    chosen = [str(element.get_attribute("value")) for element in user.all(f"{SIDEBAR} input")]
    return [*chosen[:3], *pressed]


def opened_at_once(user: User, server: Server, pages: tuple[str, ...], **view: str) -> Iterator[str]:
    """Open each page in a tab of its own before any has answered, then turn to one after the other."""
    tabs = [user.browser.current_window_handle]
    for page in pages:
        if page != pages[0]:
            user.browser.switch_to.new_window("tab")
            tabs.append(user.browser.current_window_handle)
        user.open(server, page, **view)
    for page, tab in zip(pages, tabs, strict=True):
        user.browser.switch_to.window(tab)
        yield page


def test_links_reproduce_their_view_on_a_cold_server_and_back_undoes_the_last_choice(
    cold_server: Server, small_server: Server, user: User
) -> None:
    """Six at once. Campaign, test, window, unit, sign; a reload and another page keep them, and Back leads to it.

    Back undoes two choices, of different kinds, one by one, Forward makes them again; a button that opens a page is
    one step.
    """

    def same(page: str) -> bool:
        path = urlsplit(user.browser.current_url).path
        return path == f"/{page}" and asked(user) == VIEW and shown(user) == SHOWN

    for page in opened_at_once(user, cold_server, ("data", "compare", "train", "study", "predict", "certify"), **VIEW):
        if page not in ("data", "compare"):  # the others do not show all of it
            user.wait(lambda: shown(user)[:1] == ["sample"])
            seed = None if page == "certify" else "3"  # verdicts have fixed seeds
            user.wait(lambda seed=seed: (asked(user)["campaign"], asked(user).get("seed")) == ("sample", seed))  # type: ignore[misc]
            assert urlsplit(user.browser.current_url).path == f"/{page}"
            continue
        user.wait(lambda page=page: same(page))  # type: ignore[misc]
        user.wait(lambda: [link.split()[-1] for link in user.texts(LINK)] == PAGES)
        user.browser.refresh()
        user.wait(lambda page=page: same(page))  # type: ignore[misc]
        other = {"data": "Compare"}.get(page, "Data")
        user.go(other)
        user.wait(lambda other=other: same(other.lower()))  # type: ignore[misc]
        user.browser.back()
        user.wait(lambda page=page: same(page))  # type: ignore[misc]
    user.becomes_another()
    user.open(cold_server, "compare", campaign="sample", test="T03")
    user.wait(lambda: "T03 · 16.7 mph" in shown(user))
    user.rates_over("20")
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
    user.wait(lambda: shown(user)[2:4] == ["0–20 ms", "All at its speed"] and asked(user)["window"] == "20")
    user.open(small_server, "train", campaign="campaign", test="T2", held_out=("T2", "T3"), approaches="cae")
    user.presses_until(lambda: user.all("button", "Compare T3"), "Train without them")
    user.press("Compare T3", f"{MAIN} button")
    user.wait(lambda: urlsplit(user.browser.current_url).path == "/compare" and asked(user)["test"] == "T3")
    user.find(FIGURE)
    user.browser.back()
    user.wait(lambda: urlsplit(user.browser.current_url).path == "/train")
    user.sees("Compare T3")
    assert asked(user)["test"] == "T2"
