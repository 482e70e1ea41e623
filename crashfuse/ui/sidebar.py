"""The sidebar: links to the pages, and the choices that act on the open one."""

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.errors import DataError, Problem
from crashfuse.reporting.plots.display import Display
from crashfuse.study.config import WINDOWS_MS, telling_test
from crashfuse.ui import address, campaigns, login
from crashfuse.ui.chosen import ASKED, NOT_FOUND, View, choose_held_out, forget
from crashfuse.ui.computation import jobs
from crashfuse.ui.figures import load_early
from crashfuse.ui.folding import fold_when_narrow
from crashfuse.ui.going_back import keep_views
from crashfuse.ui.navigation import show_links
from crashfuse.ui.running import show_running
from crashfuse.ui.settings import choose_left_out
from crashfuse.ui.text import chosen_units, plain
from crashfuse.ui.theme import follow_theme
from crashfuse.wording import SYSTEMS, said, speed

_OFTEN_S, _SELDOM_S = 2.0, 5.0  # between two looks at what changes: while something is computed, and else
_HELD_OUT = "held-out chooser"  # session keys: whether the page had it, and the test that it showed
_SHOWN_TEST = "test shown"


class Choice:
    """Outcome of the sidebar in a script run: a view, or the reason why there is none."""

    view: View | None = None
    problems: tuple[Problem, ...] = ()


def sidebar(page: str) -> Choice:
    """Links to the pages, and the choices that act on the open one."""
    choice, state = Choice(), st.session_state
    with st.sidebar:
        links = st.container(gap=None)
        names = list(campaigns.open_campaigns())
        if state["campaign"] in names:
            state.pop(ASKED, None)  # by Forward, or opened elsewhere: the address is written again
        elif state["campaign"] is not None:
            _note("You have not opened the campaign {} of this link. Open its folder, or upload it, on the page Data; "
                  "the link then shows what it stands for.", state["campaign"])  # fmt: skip
            state[ASKED], state["campaign"] = state["campaign"], None
        if state["campaign"] is None and ASKED not in state:
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
        choose_left_out(page)
    if address.acts("window", page) and not importing:
        st.segmented_control(
            "Rated time window", list(WINDOWS_MS), required=True, format_func=lambda ms: f"0–{ms:g} ms", key="window",
            persist_state="session",
        )  # fmt: skip
    st.segmented_control(
        "Units", list(SYSTEMS), required=True, format_func={"mph-lb": "mph, lb", "kph-kg": "km/h, kg"}.__getitem__,
        key="system", persist_state="session", on_change=address.want_units,
        help="Of speeds and weights everywhere; files keep their own.",
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
    return View(campaign, name, tests[state["test"]], display)


def _note(sentence: str, asked: str) -> None:
    """Record that the link that began this session asks for something that does not exist."""
    st.session_state.setdefault(NOT_FOUND, sentence.replace("{}", f"“{asked[:80]}”", 1))


def _turn_to_campaign() -> None:
    """Begin with another campaign's own defaults, a test's name may mean another condition there; but for a link's."""
    if st.session_state["campaign"] != st.session_state.pop(ASKED, ""):
        address.leave_campaign()
    forget()


def _keep_up(shown: address.Place) -> None:
    """Update what changes without a click: computations on the server, and what was chosen by itself."""
    if not shown.is_here:
        st.rerun()
    show_running()
