"""Frame of every page: page set-up, the sidebar's choices, and the notice that a campaign is synthetic."""

from collections.abc import Iterable
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

import streamlit as st

from crashfuse.campaign import Campaign, CrashTest
from crashfuse.errors import DataError, Problem
from crashfuse.reporting.plots.display import Display, Unit
from crashfuse.study.config import WINDOWS_MS
from crashfuse.ui import campaigns
from crashfuse.ui.computation import jobs
from crashfuse.ui.figures import choose_image_format
from crashfuse.ui.navigation import navigate, pages
from crashfuse.ui.problems import show_problems
from crashfuse.ui.text import plain
from crashfuse.units import MPH

_NOT_FOUND = "not found"  # session key: what the link asked for and was not found
REFUSED = "refused"  # session key: what is wrong with the campaign last tried


@dataclass(frozen=True)
class View:
    """The user's choices in the sidebar, and the folder of the campaign."""

    campaign: Campaign
    folder: Path
    held_out: CrashTest
    display: Display


class _Choice:
    """Outcome of the sidebar in this script run: a view, or the reason why there is none."""

    view: View | None = None
    problems: tuple[Problem, ...] = ()


_choice: ContextVar[_Choice | None] = ContextVar("choice", default=None)


def route() -> None:
    """Set up the frame and run the page given in the address; this is all that app.py does."""
    page = navigate()
    if not page.url_path:  # the address without a page
        page.run()
    token = _choice.set(_sidebar())
    try:
        page.run()
    finally:
        _choice.reset(token)


def enter() -> View | None:
    """Start a page and return its view, or None while no campaign is open.

    On a server that nobody has used yet, Streamlit runs a linked page without app.py; the page is then routed through
    app.py.
    """
    choice = _choice.get()
    if choice is None:
        navigate()
        st.rerun()
    if missing := st.session_state.get(_NOT_FOUND):
        st.warning(plain(missing), icon=":material/link_off:")
    if choice.problems:
        show_problems(choice.problems)
    if choice.view is not None and choice.view.campaign.notice:
        st.info(plain(choice.view.campaign.notice), icon=":material/science:")
    return choice.view


def enter_with_campaign(title: str) -> View:
    """Start a page that needs a campaign; without one, say what to do and stop."""
    view = enter()
    st.title(title)
    if view is None:
        st.markdown("No campaign is open yet. Open one on the page **Data**, or look around with the sample.")
        offer_sample()
        st.page_link(pages()["data"], label="Open a campaign of your own", icon=":material/folder_open:")
        st.stop()
    return view


def offer_sample() -> None:
    """Show the one button that a newcomer needs: load the sample."""
    st.button(
        "Load the sample campaign",
        type="primary",
        icon=":material/play_arrow:",
        on_click=choose_campaign,
        args=(campaigns.SAMPLE,),
    )


def choose_campaign(name: str) -> None:
    """Select one of the open campaigns; call it from a callback, before the sidebar is drawn."""
    st.session_state["campaign"] = name
    _forget()


def choose_held_out(test: CrashTest) -> None:
    """Select the test to hold out; call it from a callback, before the sidebar is drawn."""
    st.session_state["held_out"] = _label(test)
    _forget()


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
        choose_image_format()
        _keep_up(st.context.theme.type)
    choice.view = View(
        campaign, campaigns.folder_of(name), held_out, Display(float(window), unit, sign == "Deceleration")
    )
    return choice


def _label(test: CrashTest) -> str:
    return f"{test.id} · {test.condition.speed_mps / MPH:.1f} mph"


def _note_if_missing(parameter: str, known: Iterable[str], sentence: str) -> None:
    """Record that the link that started this session asks for something that does not exist.

    Streamlit removes from the address any value that a widget has no option for, so this runs before the widget.
    """
    asked, noted = st.query_params.get(parameter), f"{parameter} of the link"
    if asked and noted not in st.session_state and asked not in known:
        st.session_state.setdefault(_NOT_FOUND, sentence.format(f"“{asked[:80]}”"))
    st.session_state[noted] = asked


def _forget() -> None:
    """Clear the messages about what was not found or refused: the user has chosen something else."""
    st.session_state.pop(_NOT_FOUND, None)
    st.session_state.pop(REFUSED, None)


@st.fragment(run_every=2.0)
def _keep_up(theme: str | None) -> None:
    """Update what changes without a click: computations on the server, whoever started them, and the theme.

    Figures are drawn on the server, in the colours of the theme that the browser had at the time.
    """
    if st.context.theme.type != theme:
        st.rerun()
    for job in jobs().active:
        st.caption(f":material/hourglass_top: {plain(job.title)}" + (" (waiting)" if job.state == "waiting" else ""))
