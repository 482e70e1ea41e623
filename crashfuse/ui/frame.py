"""The frame around every page: navigation, the choices in the sidebar, the notice of a synthetic campaign."""

from contextvars import ContextVar
from dataclasses import dataclass

import streamlit as st
from streamlit.navigation.page import Page

from crashfuse.campaign import Campaign, CrashTest
from crashfuse.config import WINDOWS_MS
from crashfuse.errors import DataError, Problem
from crashfuse.plots.canvas import Unit
from crashfuse.ui import campaigns
from crashfuse.ui.computation import jobs
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
_LOGO = (
    f'<svg viewBox="0 0 156 32" width="156" height="32">{_PULSE % "#0B5CAD"}<text x="40" y="23" font-size="23" '
    'font-weight="600" font-family="Helvetica, Arial, sans-serif" fill="#262A33">crashfuse</text></svg>'
)


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
    if choice.problems:
        show_problems(choice.problems)
    if choice.view is not None and choice.view.campaign.notice:
        st.info(choice.view.campaign.notice, icon=":material/science:")
    return choice.view


def enter_with_campaign(title: str) -> View:
    """Begin a page that can do nothing without a campaign: without one it says what to do, and ends there."""
    view = enter()
    st.title(title)
    if view is None:
        st.markdown("No campaign is open yet. Open one on the page **Data**, or look around with the sample.")
        offer_sample()
        st.page_link(pages()["data"], label="Open a campaign folder", icon=":material/folder_open:")
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
    """Select a campaign of the shelf; to be called from a callback, before the sidebar is drawn."""
    st.session_state["campaign"] = name


def show_problems(problems: tuple[Problem, ...]) -> None:
    """List everything that is wrong with the data."""
    count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
    st.error(f"**This campaign cannot be used: {count}.**", icon=":material/error:")
    with st.container(border=True, height=320 if len(problems) > 8 else "content"):
        for problem in problems:
            st.text(f"• {problem}")


def _navigate() -> Page:
    st.set_page_config(page_title="crashfuse", page_icon=_ICON, layout="wide")
    st.logo(_LOGO, size="large")
    home = st.Page(_open_first_page, title="crashfuse", default=True, visibility="hidden")
    return st.navigation([home, *pages().values()])


def _open_first_page() -> None:
    st.switch_page(pages()["data"], query_params=st.query_params.to_dict())


def _sidebar() -> _Choice:
    choice = _Choice()
    with st.sidebar:
        names = list(campaigns.shelf())
        first = campaigns.at_start()
        name = st.selectbox(
            "Campaign",
            names,
            index=names.index(first) if first else None,
            placeholder="none open",
            key="campaign",
            bind="query-params",
        )
        if name is None:
            return choice
        try:
            campaign = campaigns.load(name)
        except DataError as error:
            choice.problems = error.problems
            return choice
        labels = {f"{test.id} · {test.condition.speed_mps / MPH:.1f} mph": test for test in campaign.tests}
        held_out = labels[
            st.selectbox(
                "Held-out test",
                list(labels),
                key="held_out",
                bind="query-params",
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
        _show_jobs()
    choice.view = View(campaign, held_out, float(window), unit, sign == "Deceleration")
    return choice


@st.fragment(run_every=2.0)
def _show_jobs() -> None:
    """What the server computes right now, wherever it was started."""
    for job in jobs().active:
        st.caption(f":material/hourglass_top: {job.title}" + (" (waiting)" if job.state == "waiting" else ""))
