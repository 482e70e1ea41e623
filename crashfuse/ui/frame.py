"""Frame of every page: page set-up, the sidebar's choices, and the notice that a campaign is synthetic."""

import tempfile
from collections.abc import Callable
from contextlib import suppress
from contextvars import ContextVar
from typing import Literal

import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.navigation.page import Page
from streamlit.runtime.scriptrunner import StopException

from crashfuse.execution.cache import default_folder
from crashfuse.study.config import StudyConfig
from crashfuse.study.facts import campaign_facts
from crashfuse.ui import address, campaigns, login, uploads
from crashfuse.ui.chosen import ASKED, NOT_FOUND, View, choose_campaign
from crashfuse.ui.computation import chosen_config
from crashfuse.ui.look import STYLE
from crashfuse.ui.navigation import end_page, navigate, open_asked, show_link
from crashfuse.ui.problems import show_problems
from crashfuse.ui.sidebar import Choice, sidebar
from crashfuse.ui.text import plain

_choice: ContextVar[Choice | None] = ContextVar("choice", default=None)
_facts: ContextVar[tuple[View, bool, DeltaGenerator] | None] = ContextVar("facts", default=None)
_IN_HEAD = {"test.stands_apart", "cae.runs_fail", "tests.left_out_of_use"}


def route(page: Page) -> None:
    """Set up the frame and run the page given in the address; this is all that app.py does."""
    st.html(STYLE)
    login.require(page.url_path)
    if not page.url_path:  # the address without a page
        page.run()
    open_asked()
    address.follow(page.url_path)
    token = _choice.set(sidebar(page.url_path))
    if ASKED not in st.session_state:  # else the link stays as it was given
        address.publish()
    try:
        with suppress(StopException):  # of end_page
            page.run()
        _show_facts()
    finally:
        _choice.reset(token)


@st.fragment
def by_itself(show: Callable[[], None]) -> None:
    """Show the rest of a page, so that a choice made in it is answered without all that stands around it.

    The address follows at once, the rest of the page, with its links to others, when the user is at rest.
    """
    address.publish()
    with st.container(key="alone"):
        show()


def enter() -> View | None:
    """Start a page and return its view, or None while no campaign is open."""
    choice = _choice.get()
    if choice is None:  # run without app.py, as Streamlit does before the first call of navigate on other servers
        navigate()
        st.rerun()
    if missing := st.session_state.get(NOT_FOUND):
        st.warning(plain(missing), icon=":material/link_off:")
    if choice.problems:
        show_problems(choice.problems)
    if choice.view is not None:
        uploads.note_use(choice.view.folder)
    return choice.view


def enter_with_campaign(
    title: str, detail: Callable[[View], str] | None = None, *, by_group: Callable[[View], bool] | None = None
) -> View:
    """Start a page that needs a campaign; without one, say what to do and stop.

    A page with results gives what they are of as a ``detail`` of its title; their settings stand beside it. A badge
    says if tests are left out ``by_group``, as is chosen in the sidebar if the page does not say.
    """
    view = enter()
    if view is not None:
        config = chosen_config() if detail else None
        grouped = (by_group or _chosen_by_group)(view)
        show_head(view, title, "" if detail is None else detail(view), config, by_group=grouped)
        if detail is not None:
            _require_a_seed()
    else:
        st.title(title)
        st.markdown("No campaign is open yet. Open one on the page **Data**, or look around with the sample.")
        offer_sample()
        show_link("data", "Open a campaign of your own", ":material/folder_open:")
        end_page()
    return view


def _chosen_by_group(_: View) -> bool:
    return st.session_state["leave_out"] == "speed group" and address.acts("leave_out", address.here().page)


def _require_a_seed() -> None:
    """Say where it is chosen if there is no such seed, instead of starting what can only fail."""
    seed, seeds = st.session_state.get("seed", 0), address.CHOICES["seed"].options
    if seed not in seeds:
        st.error(f"There is no seed {seed}: it is from {seeds[0]} to {seeds[-1]}.", icon=":material/error:")
        show_link("train", "Choose another seed", ":material/tune:")
        end_page()


def show_head(
    view: View, title: str, detail: str = "", config: StudyConfig | None = None, *, by_group: bool = False
) -> None:
    """Show in a line the title of a page, what it shows, the settings behind it, and the campaign's notice.

    Of the notice, where there are settings, only the words before its colon: the rest unfolds from them.
    """
    if lost := _not_kept():
        st.warning(plain(lost), icon=":material/save:")
    with st.container(horizontal=True, vertical_alignment="center", key="head"):
        st.title(title, width="content", anchor=False)
        if detail:
            st.subheader(detail, width="content", anchor=False)
        if config is not None:
            colour: Literal["gray", "orange"] = "gray" if config.preset == "fast" else "orange"
            label = f"{config.preset.capitalize()} settings, seed {config.seed}"
            st.badge(label, color=colour, help="As chosen on the page Train.")
            if by_group:
                st.badge("All at its speed left out", color="orange")
        if (notice := view.campaign.notice) and config is None:
            st.caption(f":material/science: {plain(notice)}", width="content")
        _facts.set((view, config is None, st.container(horizontal=True, width="content")))


def _show_facts() -> None:
    """Show what has to be known of the campaign as badges in the head, once the page is there: it may take a moment."""
    if (asked := _facts.get()) is None:
        return
    view, notice_is_shown, slot = asked
    _facts.set(None)
    for fact in campaign_facts(view.campaign):
        label, text = _in_badge(fact.label), plain(view.display.words(fact.sentence))
        if fact.code in _IN_HEAD:
            slot.badge(label, color="orange", help=text)
        elif fact.code == "campaign.notice" and not notice_is_shown:
            slot.badge(label, icon=":material/science:", color="gray", help=text)


def _in_badge(text: str) -> str:
    """Text that a badge shows literally: it escapes brackets itself."""
    return plain(text).replace(r"\[", "[").replace(r"\]", "]")


@st.cache_data(ttl=60, show_spinner=False)
def _not_kept() -> str:
    """A sentence if nothing can be kept in the cache folder; empty if it can."""
    folder = default_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return (
            f"Results are not kept: {folder} cannot be written ({error.strerror or error}). They are lost when the "
            "server ends. Make the folder writable, or name another by CRASHFUSE_CACHE."
        )


def offer_sample() -> None:
    """Show the one button that a newcomer needs: load the sample."""
    st.button(
        "Load the sample campaign",
        type="primary",
        icon=":material/play_arrow:",
        on_click=choose_campaign,
        args=(campaigns.SAMPLE,),
    )
