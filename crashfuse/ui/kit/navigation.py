"""The window: pages, moves between them, what the browser is asked to do; painted while all else is imported."""

from functools import cache
from pathlib import Path
from typing import NoReturn

import streamlit as st
from streamlit.components.v2.types import ComponentRenderer
from streamlit.navigation.page import Page
from streamlit.runtime.scriptrunner import StopException, get_script_run_ctx

_PAGES = {
    "data": ("Data", ":material/folder_open:"),
    "train": ("Train", ":material/model_training:"),
    "compare": ("Compare", ":material/stacked_line_chart:"),
    "study": ("Study", ":material/grid_on:"),
    "predict": ("Predict", ":material/trending_up:"),
    "certify": ("Certify", ":material/fact_check:"),
}
# drawn here: an icon from Streamlit's own font would make the browser fetch the tab's icon from the internet
_PULSE = '<path d="M3 7h5c3 0 3 12 6 17s3-9 5-9 3 9 5 9 2-17 5-17" fill="none" stroke="%s" stroke-width="3"/>'
_ICON = f'<svg viewBox="0 0 32 32"><rect width="32" height="32" rx="6" fill="#0B5CAD"/>{_PULSE % "#FFFFFF"}</svg>'
_BLUE = "#2B7CCB"  # legible on light and dark pages
_LOGO = (
    f'<svg viewBox="0 0 156 32" width="156" height="32">{_PULSE % _BLUE}<text x="40" y="23" font-size="23" '
    f'font-weight="600" font-family="Helvetica, Arial, sans-serif" fill="{_BLUE}">crashfuse</text></svg>'
)
_SIDEBAR_PX = 320
_TO_OPEN = "page to open"  # session key
_BROWSER = Path(__file__).parent / "browser"
STYLE = _BROWSER / "style.css"  # look beyond the theme: density, tabs, focus


def pages() -> dict[str, Page]:
    """The pages by the name in their address."""
    looks = _PAGES.items()
    return {name: st.Page(f"pages/{name}.py", title=title, icon=icon, url_path=name) for name, (title, icon) in looks}


def navigate() -> Page:
    """Set up the window; returns the page given in the address."""
    # before the navigation, which would otherwise make the browser fetch the tab's icon from the internet
    st.set_page_config(page_icon=_ICON, layout="wide", initial_sidebar_state=_SIDEBAR_PX)
    home = st.Page(_open_first_page, title="Data", default=True, visibility="hidden")
    page = st.navigation([home, *pages().values()], position="hidden")
    st.set_page_config(page_title=f"{page.title} · crashfuse")
    st.logo(_LOGO, size="large")
    return page


def show_links() -> None:
    """Links to all pages. Streamlit's own would drop this session's choices from the address."""
    for name, (title, icon) in _PAGES.items():
        show_link(name, title, icon)


def show_link(name: str, label: str, icon: str = ":material/arrow_forward:") -> None:
    """A link to a page that shows what this session has chosen."""
    from crashfuse.ui.kit import address

    st.page_link(pages()[name], label=label, icon=icon, query_params=address.parameters(name))


def end_page() -> NoReturn:
    """End a page; after ``st.stop`` a field that the browser has forgotten would come back empty."""
    raise StopException


def open_page(name: str) -> None:
    """Switch to a page that shows what this session has chosen."""
    from crashfuse.ui.kit import address

    context = get_script_run_ctx()
    if context is not None and context.fragment_ids_this_run:
        # from a fragment Streamlit would keep what widgets showed that the browser has forgotten since, and not send it
        st.session_state[_TO_OPEN] = name
        st.rerun()
    st.switch_page(pages()[name], query_params=address.parameters(name))


def open_next(name: str) -> None:
    """Open a page after a callback: drawn once more, the one that is left would add a step for Back."""
    st.session_state[_TO_OPEN] = name


def open_asked() -> None:
    """Open the page that a fragment or a callback has asked for, if one has."""
    if name := st.session_state.pop(_TO_OPEN, None):
        open_page(name)


def _open_first_page() -> None:
    from crashfuse.ui.kit import address

    st.switch_page(pages()["data"], query_params=address.given())


def watch_browser() -> None:
    """Follow the browser's width and theme, in which cells and figures are coloured, and let Back return to views."""
    for name in ("folding", "theme", "going_back"):
        component(name)(key=name)


@cache
def component(name: str, css: str = "", **values: str) -> ComponentRenderer:
    """What the browser does and shows, by the files of this name in ``browser/``; ``values`` stand for $NAME."""
    script = (_BROWSER / f"{name}.js").read_text(encoding="utf-8")
    for key, value in values.items():
        script = script.replace(f"${key}", value)
    style = (_BROWSER / css).read_text(encoding="utf-8") if css else None
    page = _BROWSER / f"{name}.html"
    html = page.read_text(encoding="utf-8") if page.is_file() else None
    return st.components.v2.component(f"crashfuse_{name}", html=html, css=style, js=script)
