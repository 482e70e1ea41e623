"""Frame of every page: page set-up, the sidebar's choices, and the notice that a campaign is synthetic."""

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import streamlit as st
from streamlit.navigation.page import Page

from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem
from crashfuse.reporting.plots.display import Display
from crashfuse.study.config import WINDOWS_MS, StudyConfig
from crashfuse.study.telling_test import telling_test
from crashfuse.ui import address, campaigns, login
from crashfuse.ui.computation import chosen_config, jobs
from crashfuse.ui.figures import load_early
from crashfuse.ui.folding import fold_when_narrow
from crashfuse.ui.going_back import keep_views
from crashfuse.ui.look import STYLE
from crashfuse.ui.navigation import navigate, open_asked, show_link, show_links
from crashfuse.ui.panel import forget_panels
from crashfuse.ui.problems import show_problems
from crashfuse.ui.running import show_running
from crashfuse.ui.settings import choose_left_out
from crashfuse.ui.text import chosen_units, plain
from crashfuse.ui.theme import follow_theme
from crashfuse.wording import SYSTEMS, said, speed

_OFTEN_S, _SELDOM_S = 2.0, 5.0  # between two looks at what changes: while something is computed, and else
_NOT_FOUND = "not found"  # session key: what the link asked for and was not found
_ASKED = "campaign asked for"  # session key: the one of a link, while it is not open
_HELD_OUT = "held-out chooser"  # session keys: whether the page had it, and the test that it showed
_SHOWN_TEST = "test shown"
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


def route(page: Page) -> None:
    """Set up the frame and run the page given in the address; this is all that app.py does."""
    st.html(STYLE)
    login.require(page.url_path)
    if not page.url_path:  # the address without a page
        page.run()
    open_asked()
    address.follow(page.url_path)
    token = _choice.set(_sidebar(page.url_path))
    if _ASKED not in st.session_state:  # else the link stays as it was given
        address.publish()
    forget_panels()
    try:
        page.run()
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
    if missing := st.session_state.get(_NOT_FOUND):
        st.warning(plain(missing), icon=":material/link_off:")
    if choice.problems:
        show_problems(choice.problems)
    return choice.view


def enter_with_campaign(
    title: str, detail: Callable[[View], str] | None = None, *, by_group: bool | None = None
) -> View:
    """Start a page that needs a campaign; without one, say what to do and stop.

    A page with results gives what they are of as a ``detail`` of its title; their settings stand beside it. A badge
    says if tests are left out ``by_group``, as is chosen in the sidebar if the page does not say.
    """
    view = enter()
    if view is not None:
        config = chosen_config() if detail else None
        if by_group is None:
            by_group = st.session_state["leave_out"] == "speed group" and address.acts("leave_out", address.here().page)
        show_head(view, title, "" if detail is None else detail(view), config, by_group=by_group)
        if detail is not None:
            _require_a_seed()
    else:
        st.title(title)
        st.markdown("No campaign is open yet. Open one on the page **Data**, or look around with the sample.")
        offer_sample()
        show_link("data", "Open a campaign of your own", ":material/folder_open:")
        st.stop()
    return view


def _require_a_seed() -> None:
    """Say where it is chosen if there is no such seed, instead of starting what can only fail."""
    seed, seeds = chosen_config().seed, address.CHOICES["seed"].options
    if seed not in seeds:
        st.error(f"There is no seed {seed}: it is from {seeds[0]} to {seeds[-1]}.", icon=":material/error:")
        show_link("train", "Choose another seed", ":material/tune:")
        st.stop()


def show_head(
    view: View, title: str, detail: str = "", config: StudyConfig | None = None, *, by_group: bool = False
) -> None:
    """Show in a line the title of a page, what it shows, the settings behind it, and the campaign's notice.

    Of the notice, where there are settings, only the words before its colon: the rest unfolds from them.
    """
    with st.container(horizontal=True, vertical_alignment="center", key="head"):
        st.title(title, width="content", anchor=False)
        if detail:
            st.subheader(detail, width="content", anchor=False)
        if config is not None:
            colour: Literal["gray", "orange"] = "gray" if config.preset == "fast" else "orange"
            label = f"{config.preset.capitalize()} settings, seed {config.seed}"
            st.badge(label, color=colour, help="As chosen on the page Train.")
            if view.campaign.unused:
                names = ", ".join(test for test, _ in view.campaign.unused)
                st.badge(f"without {plain(names)}", color="orange", help=plain(view.campaign.remarks[0]))
            if by_group:
                st.badge("All at its speed left out", color="orange")
        if (notice := view.campaign.notice) and config is not None:
            st.badge(plain(notice.partition(":")[0]), icon=":material/science:", color="gray", help=plain(notice))
        elif notice:
            st.caption(f":material/science: {plain(notice)}", width="content")


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
    if name not in (st.session_state["campaign"], st.session_state.pop(_ASKED, None)):
        address.leave_campaign()
    st.session_state["campaign"] = name
    _forget()


def choose_held_out(test: CrashTest) -> None:
    """Select the test to hold out; call it from a callback, before the sidebar is drawn."""
    st.session_state["test"] = test.id
    _forget()


def _sidebar(page: str) -> _Choice:
    """Links to the pages, and the choices that act on the open one."""
    choice, state = _Choice(), st.session_state
    with st.sidebar:
        links = st.container(gap=None)
        names = list(campaigns.open_campaigns())
        if state["campaign"] not in (None, *names):
            _note("You have not opened the campaign {} of this link. Open its folder, or upload it, on the page Data; "
                  "the link then shows what it stands for.", state["campaign"])  # fmt: skip
            state[_ASKED], state["campaign"] = state["campaign"], None
        if state["campaign"] is None and _ASKED not in state:
            state["campaign"] = campaigns.at_start()
        name = st.selectbox(
            "Campaign", names, index=None, placeholder="none open", key="campaign", persist_state="session",
            format_func=campaigns.label, on_change=_turn_to_campaign,
        )  # fmt: skip
        if name is not None:
            try:
                choice.view = _choose_view(page, name, campaigns.load(name))
            except DataError as error:
                choice.problems = error.problems
            every_s = _OFTEN_S if jobs().active else _SELDOM_S
            st.fragment(_keep_up, run_every=every_s)(address.here())
        login.show_account()
        fold_when_narrow()
        follow_theme()
        keep_views()
        if choice.view is None:  # nor is there a figure
            load_early()
    with links:
        show_links()
    return choice


def _choose_view(page: str, name: str, campaign: Campaign) -> View:
    """The choices for an open campaign; those that do not act on this page are kept, and not asked for."""
    state = st.session_state
    was_drawn, state[_HELD_OUT] = state.get(_HELD_OUT), False
    address.default("system", next(name for name, system in SYSTEMS.items() if system == campaign.units))
    units = chosen_units()
    tests = {test.id: test for test in campaign.tests}
    unused = dict(campaign.unused)
    if state["test"] not in (None, *tests):
        why = "left out of use" if state["test"] in unused else "not among the tests"
        asked = "This link holds out {}, but that test is" if state["test"] != state.get(_SHOWN_TEST) else "{} is now"
        _note(f"{asked} {why}; another is held out instead.", state["test"])
        state["test"] = None
    if state["test"] is None:
        state["test"] = telling_test(campaign).id
    state[_SHOWN_TEST] = state["test"]
    if unused:
        names = ", ".join(map(plain, unused))
        st.caption(f":material/block: Left out of use: {names}")
    importing = page == "data" and bool(state["import"])
    if address.acts("test", page) and page != "train" and not importing:  # there it is chosen among the settings
        shown = f"test in {state['system']}"  # a browser keeps what is chosen by its label, which has a unit
        if not was_drawn:  # the browser has forgotten it, which Streamlit does not know of a page that ended early
            state.pop(shown, None)
        address.put(shown, state["test"])
        state[_HELD_OUT] = True
        st.selectbox(
            "Held-out test",
            list(tests),
            format_func=lambda test_id: f"{test_id} · {said(speed(tests[test_id].condition.speed_mps), units)}",
            key=shown,
            on_change=lambda: choose_held_out(tests[state[shown]]),
            help="The test to be predicted. Nothing that predicts it sees its pulse.",
        )
        for note in campaign.cae.extrapolation(tests[state["test"]].condition):
            st.caption(f":material/warning: {plain(note)}")
    if page == "compare":  # the page Train has it among its settings
        choose_left_out()
    if address.acts("window", page) and not importing:
        st.segmented_control(
            "Rated time window", list(WINDOWS_MS), required=True, format_func=lambda ms: f"0–{ms:g} ms", key="window",
            persist_state="session",
        )  # fmt: skip
    st.segmented_control(
        "Units", list(SYSTEMS), required=True, format_func={"mph-lb": "mph, lb", "kph-kg": "km/h, kg"}.__getitem__,
        key="system", persist_state="session", help="Of speeds and weights everywhere; files keep their own.",
    )  # fmt: skip
    if address.acts("unit", page):
        st.segmented_control(
            "Accelerations in", address.CHOICES["unit"].options, required=True, key="unit", persist_state="session"
        )
    if address.acts("sign", page):
        st.segmented_control(
            "Show as", address.CHOICES["sign"].options, required=True, key="sign", persist_state="session",
            help="Braking is negative as an acceleration (SAE J1733), positive as a deceleration.",
        )  # fmt: skip
    display = Display(float(state["window"]), state["unit"], state["sign"] == "Deceleration", SYSTEMS[state["system"]])
    return View(campaign, campaigns.folder_of(name), tests[state["test"]], display)


def note(sentence: str) -> None:
    """Tell something at the head of the next page, until the user chooses something else there."""
    st.session_state[_NOT_FOUND] = sentence


def _note(sentence: str, asked: str) -> None:
    """Record that the link that began this session asks for something that does not exist."""
    st.session_state.setdefault(_NOT_FOUND, sentence.format(f"“{asked[:80]}”"))


def _turn_to_campaign() -> None:
    """Begin with another campaign's own defaults: a test's name may mean another condition there."""
    st.session_state.pop(_ASKED, None)
    address.leave_campaign()
    _forget()


def _forget() -> None:
    """Clear the messages about what was not found or refused: the user has chosen something else."""
    st.session_state.pop(_NOT_FOUND, None)
    st.session_state.pop(REFUSED, None)


def _keep_up(shown: address.Place) -> None:
    """Update what changes without a click: computations on the server, and what was chosen by itself."""
    if not shown.is_here:
        st.rerun()
    show_running()
