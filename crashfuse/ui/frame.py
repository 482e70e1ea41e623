"""The frame around every page: navigation, the choices in the sidebar, the notice of a synthetic campaign."""

from collections.abc import Iterable
from contextvars import ContextVar
from dataclasses import dataclass

import streamlit as st
from streamlit.navigation.page import Page

from crashfuse.campaign import Campaign, CrashTest
from crashfuse.errors import DataError, Problem
from crashfuse.reporting.plots.canvas import Unit
from crashfuse.study.config import WINDOWS_MS
from crashfuse.ui import campaigns
from crashfuse.ui.computation import jobs
from crashfuse.ui.problems import show_problems
from crashfuse.ui.text import plain
from crashfuse.units import MPH

_PAGES = {
    "data": ("Data", ":material/folder_open:"),
    "train": ("Train", ":material/model_training:"),
    "compare": ("Compare", ":material/stacked_line_chart:"),
    "study": ("Study", ":material/grid_on:"),
    "predict": ("Predict", ":material/trending_up:"),
}

# drawn here, for Streamlit would fetch an icon of its own font from the internet for the browser's tab
_PULSE = '<path d="M3 7h5c3 0 3 12 6 17s3-9 5-9 3 9 5 9 2-17 5-17" fill="none" stroke="%s" stroke-width="3"/>'
_ICON = f'<svg viewBox="0 0 32 32"><rect width="32" height="32" rx="6" fill="#0B5CAD"/>{_PULSE % "#FFFFFF"}</svg>'
_BLUE = "#2B7CCB"  # reads on the light and on the dark page
_LOGO = (
    f'<svg viewBox="0 0 156 32" width="156" height="32">{_PULSE % _BLUE}<text x="40" y="23" font-size="23" '
    f'font-weight="600" font-family="Helvetica, Arial, sans-serif" fill="{_BLUE}">crashfuse</text></svg>'
)
# Streamlit writes white on the accent colour, which in the dark is too light for it; on the first visit of a browser
# its sidebar is narrower than asked for, and three windows would not stand side by side
_STYLE = (
    '<style>button[data-testid^="stBaseButton-primary"] { color: light-dark(#FFFFFF, #14181F) }'
    '[data-testid="stSidebar"] [data-testid="stButtonGroup"] button { padding-inline: 0.6rem }</style>'
)
_SIDEBAR_PX = 320
_NOT_FOUND = "not found"  # in the session: what its link asked for in vain
REFUSED = "refused"  # in the session: what is wrong with the campaign that was last tried


@dataclass(frozen=True)
class View:
    """What the user has chosen in the sidebar.

    Parameters
    ----------
    campaign : Campaign
    held_out : CrashTest
    window_ms : float
    unit : {"g", "m/s²"}
    deceleration : bool
    """

    campaign: Campaign
    held_out: CrashTest
    window_ms: float
    unit: Unit
    deceleration: bool


class _Choice:
    """What the sidebar found out in this run of the script: a view, or why there is none."""

    view: View | None = None
    problems: tuple[Problem, ...] = ()


_choice: ContextVar[_Choice | None] = ContextVar("choice", default=None)


def route() -> None:
    """Set up the frame and run the page that the address names; app.py does nothing else."""
    page = _navigate()
    if not page.url_path:  # the bare address
        page.run()
    token = _choice.set(_sidebar())
    try:
        page.run()
    finally:
        _choice.reset(token)


def enter() -> View | None:
    """Begin a page: its view, or None while no campaign is open.

    On a server that nobody has used yet, Streamlit runs the page that a link names without app.py; it is sent through
    app.py then.
    """
    choice = _choice.get()
    if choice is None:
        _navigate()
        st.rerun()
    if missing := st.session_state.get(_NOT_FOUND):
        st.warning(plain(missing), icon=":material/link_off:")
    if choice.problems:
        show_problems(choice.problems)
    if choice.view is not None and choice.view.campaign.notice:
        st.info(plain(choice.view.campaign.notice), icon=":material/science:")
    return choice.view


def enter_with_campaign(title: str) -> View:
    """Begin a page that can do nothing without a campaign: without one it says what to do, and ends there."""
    view = enter()
    st.title(title)
    if view is None:
        st.markdown("No campaign is open yet. Open one on the page **Data**, or look around with the sample.")
        offer_sample()
        st.page_link(pages()["data"], label="Open a campaign of your own", icon=":material/folder_open:")
        st.stop()
    return view


def pages() -> dict[str, Page]:
    """The five pages by the name in their address."""
    return {
        name: st.Page(f"pages/{name}.py", title=title, icon=icon, url_path=name)
        for name, (title, icon) in _PAGES.items()
    }


def offer_sample() -> None:
    """The one button that a newcomer needs."""
    st.button(
        "Load the sample campaign",
        type="primary",
        icon=":material/play_arrow:",
        on_click=choose_campaign,
        args=(campaigns.SAMPLE,),
    )


def choose_campaign(name: str) -> None:
    """Select an open campaign; to be called from a callback, before the sidebar is drawn."""
    st.session_state["campaign"] = name
    _forget()


def choose_held_out(test: CrashTest) -> None:
    """Select the test to be held out; to be called from a callback, before the sidebar is drawn."""
    st.session_state["held_out"] = _label(test)
    _forget()


def _navigate() -> Page:
    # before the navigation, which would have the browser fetch the page's icon for its tab from the internet
    st.set_page_config(page_icon=_ICON, layout="wide", initial_sidebar_state=_SIDEBAR_PX)
    home = st.Page(_open_first_page, title="Data", default=True, visibility="hidden")
    page = st.navigation([home, *pages().values()])
    st.set_page_config(page_title=f"{page.title} · crashfuse")
    st.logo(_LOGO, size="large")
    st.html(_STYLE)
    return page


def _open_first_page() -> None:
    st.switch_page(pages()["data"], query_params=st.query_params.to_dict())


def _sidebar() -> _Choice:
    choice = _Choice()
    with st.sidebar:
        names = list(campaigns.open_campaigns())
        first = campaigns.at_start()
        _note_if_missing("campaign", names, "The campaign {} of this link is not open on this server. "
                 "Open its folder, or upload it, on the page Data.")  # fmt: skip
        name = st.selectbox(
            "Campaign",
            names,
            index=names.index(first) if first else None,
            placeholder="none open",
            key="campaign",
            bind="query-params",
            on_change=_forget,
        )
        if name is None:
            return choice
        try:
            campaign = campaigns.load(name)
        except DataError as error:
            choice.problems = error.problems
            return choice
        labels = {_label(test): test for test in campaign.tests}
        _note_if_missing("held_out", labels, "This link holds out {}, but no test here has that name and speed.")
        held_out = labels[
            st.selectbox(
                "Held-out test",
                list(labels),
                key="held_out",
                bind="query-params",
                on_change=_forget,
                help="The test to be predicted. Nothing that predicts it sees its pulse.",
            )
        ]
        for note in campaign.cae.extrapolation(held_out.condition):
            st.caption(f":material/warning: {note}")
        window = st.segmented_control(
            "Rated time window",
            list(WINDOWS_MS),
            default=WINDOWS_MS[-1],
            required=True,
            format_func=lambda ms: f"0–{ms:g} ms",
            key="window",
            bind="query-params",
        )
        units: list[Unit] = ["g", "m/s²"]
        unit = st.segmented_control("Unit", units, default="g", required=True, key="unit", bind="query-params")
        sign = st.segmented_control(
            "Show as", ["Acceleration", "Deceleration"], default="Acceleration", required=True, key="sign",
            bind="query-params", help="Braking is negative as an acceleration (SAE J1733), positive as a deceleration.",
        )  # fmt: skip
        _keep_up(st.context.theme.type)
    choice.view = View(campaign, held_out, float(window), unit, sign == "Deceleration")
    return choice


def _label(test: CrashTest) -> str:
    return f"{test.id} · {test.condition.speed_mps / MPH:.1f} mph"


def _note_if_missing(parameter: str, known: Iterable[str], sentence: str) -> None:
    """Note if the link that began this session asks for what is not there.

    Streamlit drops from an address what no widget has an option for, so this comes before the widget.
    """
    asked, noted = st.query_params.get(parameter), f"{parameter} of the link"
    if asked and noted not in st.session_state and asked not in known:
        st.session_state.setdefault(_NOT_FOUND, sentence.format(f"“{asked[:80]}”"))
    st.session_state[noted] = asked


def _forget() -> None:
    """Drop what could not be had: the user has chosen something else."""
    st.session_state.pop(_NOT_FOUND, None)
    st.session_state.pop(REFUSED, None)


@st.fragment(run_every=2.0)
def _keep_up(theme: str | None) -> None:
    """Follow what changes without a click: what the server computes, wherever it was started, and the theme.

    Figures are drawn on the server, in the colours of the theme that the browser had then.
    """
    if st.context.theme.type != theme:
        st.rerun()
    for job in jobs().active:
        st.caption(f":material/hourglass_top: {plain(job.title)}" + (" (waiting)" if job.state == "waiting" else ""))
