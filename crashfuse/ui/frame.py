"""The frame around every page: how it begins, the choices in the sidebar, the notice of a synthetic campaign."""

from collections.abc import Iterable
from contextvars import ContextVar
from dataclasses import dataclass

import streamlit as st

from crashfuse.campaign import Campaign, CrashTest
from crashfuse.errors import DataError, Problem
from crashfuse.reporting.plots.display import Display, Unit
from crashfuse.study.config import WINDOWS_MS
from crashfuse.ui import campaigns
from crashfuse.ui.computation import jobs
from crashfuse.ui.navigation import navigate, pages
from crashfuse.ui.problems import show_problems
from crashfuse.ui.text import plain
from crashfuse.units import MPH

_NOT_FOUND = "not found"  # in the session: what its link asked for in vain
REFUSED = "refused"  # in the session: what is wrong with the campaign that was last tried


@dataclass(frozen=True)
class View:
    """What the user has chosen in the sidebar."""

    campaign: Campaign
    held_out: CrashTest
    display: Display


class _Choice:
    """What the sidebar found out in this run of the script: a view, or why there is none."""

    view: View | None = None
    problems: tuple[Problem, ...] = ()


_choice: ContextVar[_Choice | None] = ContextVar("choice", default=None)


def route() -> None:
    """Set up the frame and run the page that the address names; app.py does nothing else."""
    page = navigate()
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
    """Begin a page that can do nothing without a campaign: without one it says what to do, and ends there."""
    view = enter()
    st.title(title)
    if view is None:
        st.markdown("No campaign is open yet. Open one on the page **Data**, or look around with the sample.")
        offer_sample()
        st.page_link(pages()["data"], label="Open a campaign of your own", icon=":material/folder_open:")
        st.stop()
    return view


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
    """Select one of the open campaigns; to be called from a callback, before the sidebar is drawn."""
    st.session_state["campaign"] = name
    _forget()


def choose_held_out(test: CrashTest) -> None:
    """Select the test to be held out; to be called from a callback, before the sidebar is drawn."""
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
        _keep_up(st.context.theme.type)
    choice.view = View(campaign, held_out, Display(float(window), unit, sign == "Deceleration"))
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
