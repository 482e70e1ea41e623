"""Frame of every page: set-up, the sidebar, the settings, and the line above."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.navigation.page import Page
from streamlit.runtime.scriptrunner import StopException

from crashfuse.approaches.base import DEVICES, PRESETS
from crashfuse.approaches.registry import APPROACHES, LABELS, uses_preset
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.execution.cache import not_kept
from crashfuse.results.display import Display
from crashfuse.study.config import WINDOWS_MS, StudyConfig, telling_test
from crashfuse.study.facts import campaign_facts
from crashfuse.ui.kit import address, campaigns, navigation, visitors
from crashfuse.ui.kit.address import ASKED, NOT_FOUND, choose_campaign, choose_held_out, chosen_config, forget, kept
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import jobs
from crashfuse.ui.kit.navigation import end_page, navigate, open_next, show_link
from crashfuse.ui.kit.progress import show_running
from crashfuse.ui.kit.results import show_problems
from crashfuse.ui.kit.text import LF, TIME_DOMAIN, TO_TTZV_HELP, chosen_units, plain
from crashfuse.units import SYSTEMS, counted, read_out, said, speed

_OFTEN_S, _SELDOM_S = 2.0, 5.0  # between two looks at what changes: while something is computed, and else
_DRAWN = "drawn page"  # session key
_HELD_OUT = "held-out chooser"  # session key: whether the page had it
_PLACE_OF: Mapping[str, tuple[str, Mapping[str, object]]] = {  # of facts that stand above every page: where they lead
    "test.stands_apart": ("data", {"data_tab": "Tests"}),
    "campaign.archive": ("train", {"train_tab": "Train"}),
    "cae.runs_fail": ("data", {"data_tab": "CAE model"}),
    "tests.left_out_of_use": ("data", {"data_tab": "Tests"}),
    "campaign.notice": ("data", {"data_tab": "Tests"}),
}
_opened: ContextVar[View | Sequence[Problem]] = ContextVar("opened")


def choose_settings() -> tuple[StudyConfig, str]:
    """Ask for the settings; returns them, and what is wrong with them."""
    look = {"selection_mode": "multi", "format_func": LABELS.__getitem__, "help": f"{LF} {TIME_DOMAIN}"}
    chosen = st.pills("Approaches", tuple(APPROACHES), **kept("approaches", **look))
    left, right = st.columns(2, gap="large")
    acts_on = read_out([LABELS[name] for name in filter(uses_preset, APPROACHES)])
    tip = f"Fast: ours, minutes on a laptop. Paper: {acts_on} as published (Zeng et al. 2023)."
    left.radio("Settings", PRESETS, format_func=str.capitalize, horizontal=True, **kept("preset", help=tip))
    with right.expander("Advanced", icon=":material/tune:"):
        # without bounds, within which a browser would keep the last one and say nothing to the page
        st.number_input("Seed", step=1, help="The same seed gives the same results.", **kept("seed"))
        choose_left_out("train")
        from torch import cuda  # imported while the first pages are read

        names = {"auto": "A GPU if there is one", "cpu": "The CPU", "cuda": "The GPU"}
        devices = DEVICES if cuda.is_available() or st.session_state["device"] == "cuda" else ("auto", "cpu")
        st.radio("Networks are trained on", devices, format_func=names.__getitem__, **kept("device"))
    config = chosen_config()
    if config.preset != st.session_state["preset"]:
        st.warning("The paper's settings act on none of these approaches.", icon=":material/info:")
    if config.preset == "paper":
        st.warning("The paper's settings take many hours without a GPU.", icon=":material/timer:")
    trouble = "" if chosen else "Choose at least one approach."
    try:
        replace(config, seed=int(st.session_state["seed"])).check()
    except UsageError as error:
        trouble = trouble or str(error)
    return config, trouble


def choose_left_out(page: str) -> None:
    """Ask what is left out with a test, by one widget a page: one key at two places loses its value."""
    state, shown = st.session_state, f"leave_out on {page}"
    address.put(shown, state["leave_out"])
    names = {"test": "The test", "speed group": "All at its speed"}
    tip = "Other speeds are three times as far away, at least."
    look = kept(shown, on_change=lambda: state.update(leave_out=state[shown]), format_func=names.__getitem__, help=tip)
    st.segmented_control("Left out", list(names), required=True, **look)


def sidebar(page: str) -> View | Sequence[Problem]:
    """Show links to the pages, and the choices on the open one; returns these, or what is wrong."""
    opened: View | Sequence[Problem] = ()
    state = st.session_state

    def turn_to_campaign() -> None:
        if state["campaign"] != state.pop(ASKED, ""):
            address.leave_campaign()
        forget()

    with st.sidebar:
        links = st.container(gap=None)
        names = list(campaigns.open_campaigns())
        if state["campaign"] in names:
            state.pop(ASKED, None)  # by Forward, or opened elsewhere: the address is written again
        elif state["campaign"] is not None:
            _note("You have not opened the campaign {} of this link. Do so on the page Data.", state["campaign"])
            state[ASKED], state["campaign"] = state["campaign"], None
        if state["campaign"] is None and ASKED not in state:
            state["campaign"] = campaigns.at_start()
        first = None if state["campaign"] is None else 0  # None: Escape would clear the choice
        look = {"placeholder": "none open", "format_func": campaigns.label, "on_change": turn_to_campaign}
        name = st.selectbox("Campaign", names, first, **kept("campaign", **look))
        if name is not None:
            try:
                opened = _choose_view(page, name, campaigns.load(name))
            except DataError as error:
                opened = error.problems
            every_s = _OFTEN_S if jobs().active else _SELDOM_S
            st.fragment(_keep_up, run_every=every_s)(address.here())
        visitors.show_account()
        navigation.watch_browser()
    with links:
        navigation.show_links()
    return opened


def _choose_view(page: str, name: str, campaign: Campaign) -> View:
    state, tests = st.session_state, {test.id: test for test in campaign.tests}
    address.default("system", next(name for name, system in SYSTEMS.items() if system == campaign.units))
    if state["test"] not in (None, *tests):
        why = "is left out of use" if state["test"] in dict(campaign.unused) else "is not among the tests"
        _note(f"{{}} {why}; another is held out instead.", state["test"])
        state["test"] = None
    if state["test"] is None:
        state["test"] = telling_test(campaign).id
    adding = _is_adding(page)
    was_drawn, state[_HELD_OUT] = state.get(_HELD_OUT), False
    if address.acts("test", page) and page != "train" and not adding:  # there it is chosen among the settings
        _choose_held_out(tests, was_drawn=bool(was_drawn))
        for note in campaign.cae.extrapolation(tests[state["test"]].condition):
            st.caption(f":material/warning: {plain(note)}")
    if page == "compare":  # the page Train has it among its settings
        choose_left_out(page)
    if address.acts("window", page) and not adding:
        _choose_window(page)
    _choose_units(page)
    display = Display(float(state["window"]), state["unit"], state["sign"] == "Deceleration", SYSTEMS[state["system"]])
    return View(campaign, name, tests[state["test"]], display)


def _choose_window(page: str) -> None:
    state = st.session_state
    shown = float(state["window"])

    def take() -> None:
        try:
            state["window"] = address.window_of(str(state["window"]))
        except UsageError as error:
            state["window"] = shown
            st.toast(plain(error), icon=":material/edit:")

    look = {"format_func": "0–{:g} ms".format, "accept_new_options": True, "help": "Type any from 10 to 100 ms."}
    st.selectbox("Rated time window", sorted({*WINDOWS_MS, shown}), **kept("window", on_change=take, **look))
    if page in ("compare", "study"):
        st.checkbox("Also to zero velocity (TTZV)", **kept("to_ttzv", help=TO_TTZV_HELP))


def _choose_units(page: str) -> None:
    labels = {
        "system": ("Units of speeds and weights", {"mph-lb": "mph, lb", "kph-kg": "km/h, kg"}),
        "unit": ("Unit of accelerations", {"g": "g", "m/s²": "m/s²"}),
        "sign": ("Sign of braking (SAE J1733: negative)", {"Acceleration": "−", "Deceleration": "+"}),
    }

    def keep(key: str) -> None:
        address.want_units()
        visitors.keep_for_visitor(key, st.session_state[key])

    st.markdown(f":small[Units{', sign of braking' if address.acts('sign', page) else ''}]")
    with st.container(horizontal=True, gap="xxsmall", key="units"):
        for key, (label, words) in labels.items():
            if address.acts(key, page):
                look = {"format_func": words.__getitem__, "label_visibility": "collapsed", "width": "content"}
                change = partial(keep, key)
                st.segmented_control(label, list(words), required=True, **kept(key, on_change=change, **look))


def _is_adding(page: str) -> bool:
    return page == "data" and bool(st.session_state["import"] or st.session_state["opening"])


def _choose_held_out(tests: Mapping[str, CrashTest], *, was_drawn: bool) -> None:
    state, units = st.session_state, chosen_units()
    shown = f"test in {state['system']}"  # a browser keeps what is chosen by its label, which has a unit
    if not was_drawn:  # the browser has forgotten it, which Streamlit does not know of a page that ended early
        state.pop(shown, None)
    address.put(shown, state["test"])
    state[_HELD_OUT] = True
    named = {name: f"{name} · {said(speed(test.condition.speed_mps), units)}" for name, test in tests.items()}
    look: dict[str, Any] = {"key": shown, "on_change": lambda: choose_held_out(tests[state[shown]])}
    tip, label = "Nothing that predicts it sees its pulse.", named.__getitem__
    st.selectbox("Held-out test", list(tests), format_func=label, help=tip, **look)


def _note(sentence: str, asked: str) -> None:
    st.session_state.setdefault(NOT_FOUND, sentence.replace("{}", f"“{asked[:80]}”", 1))


def _keep_up(shown: address.Place) -> None:
    if not shown.is_here:
        st.rerun()
    show_running()


def route(page: Page) -> None:
    """Set up the frame and run the page given in the address."""
    st.html(navigation.STYLE)
    visitors.require_login(page.url_path)
    if not page.url_path:  # the address without a page
        page.run()
    navigation.open_asked()
    address.follow(page.url_path, visitors.kept_for_visitor)
    opened = sidebar(page.url_path)
    token = _opened.set(opened)
    view = opened if isinstance(opened, View) and not _is_adding(page.url_path) else None
    if view is not None:
        row = st.container(horizontal=True, key="answer")
    slot = st.empty() if st.session_state.get(_DRAWN) != page.url_path else st  # what the page that is left showed goes
    st.session_state[_DRAWN] = page.url_path
    if ASKED not in st.session_state:  # else the link stays as it was given
        address.publish()
    try:
        with slot.container(key="page"), suppress(StopException):  # of end_page
            page.run()
        if view is not None:
            _show_answer(row, view)
    finally:
        _opened.reset(token)


@st.fragment
def by_itself(show: Callable[[], None]) -> None:
    """Show the rest of a page, redrawn without what stands around it."""
    address.publish()
    with st.container(key="alone"):
        show()


def enter() -> View | None:
    """Start a page and return its view, or None while no campaign is open."""
    opened = _opened.get(None)
    if opened is None:  # run without app.py, as Streamlit does before the first call of navigate on other servers
        navigate()
        st.rerun()
    if missing := st.session_state.get(NOT_FOUND):
        st.warning(plain(missing), icon=":material/link_off:")
    if isinstance(opened, View):
        return opened
    if opened:
        show_problems(opened)
    return None


def enter_with_campaign(title: str, detail: Callable[[View], str] | None = None) -> View:
    """Start a page that needs a campaign; one with results gives what they are of as a ``detail``."""
    view = enter()
    if view is None:
        st.title(title)
        st.markdown("No campaign is open yet. Open one on **Data**, or look around with the sample.")
        offer_sample()
        show_link("data", "Open a campaign of your own", ":material/folder_open:")
        end_page()
    row = show_title(title)
    if detail is None:
        return view
    config = address.page_config()
    colour: Literal["gray", "orange"] = "gray" if config.preset == "fast" else "orange"
    seeded = f", seed {config.seed}" if config.seed and address.acts("seed", address.here().page) else ""
    with row:
        if text := detail(view):
            st.subheader(text, width="content", anchor=False)
        st.badge(f"{config.preset.capitalize()} settings{seeded}", color=colour, help="As chosen on the page Train.")
        if address.acts("leave_out", address.here().page) and config.leave_out == "speed group":
            st.badge("All at its speed left out", color="orange")
    seed, seeds = st.session_state.get("seed", 0), address.CHOICES["seed"].options
    if seed not in seeds:
        st.error(f"There is no seed {seed}: it is from {seeds[0]} to {seeds[-1]}.", icon=":material/error:")
        show_link("train", "Choose another seed", ":material/tune:")
        end_page()
    return view


def show_title(title: str) -> DeltaGenerator:
    """Show the title of a page; what is returned stands in its row."""
    if lost := _not_kept():
        st.warning(plain(lost), icon=":material/save:")
    row = st.container(horizontal=True, vertical_alignment="center", key="head")
    row.title(title, width="content", anchor=False)
    return row


def _show_answer(row: DeltaGenerator, view: View) -> None:
    from crashfuse.ui.certify.results import last_verdicts  # whose figures and reports take a while

    campaign, words = view.campaign, view.display.words
    _link(row, "tests", counted(len(campaign.tests), "test"), "On Data.", "data", data_tab="Tests")
    _link(row, "cae", counted(len(campaign.cae), "CAE run"), "On Data.", "data", data_tab="CAE model")
    if address.here().page != "certify":  # which has it larger
        verdicts, told = last_verdicts(view)
        meaning = "Which planned tests need not be run?"
        if verdicts is not None:
            n, of = verdicts.saved
            told = f"{n:,} of {counted(of, 'planned test')} need not be run"
            meaning = "A test there would meet all criteria at once."
        _link(row, "certify", f"**{plain(told)}**", meaning, "certify")
    for fact in campaign_facts(campaign):
        page, chosen = _PLACE_OF.get(fact.code, ("", {}))
        label = plain(fact.label)
        if fact.code == "test.stands_apart":  # over the others at its speed
            test = fact.about[0]
            chosen = {**chosen, "test": test, "overlaid": list(campaign.speed_group(test))}
            label += f" at {words(speed(campaign.test(test).condition.speed_mps, form='.0f'))}"
        if page:
            label = label if fact.code in ("campaign.archive", "campaign.notice") else f":orange[{label}]"
            _link(row, f"{fact.code} {fact.label}", label, words(fact.sentence), page, **chosen)


def _link(row: DeltaGenerator, key: str, label: str, meaning: str, page: str, **chosen: object) -> None:
    args, help_ = (page, chosen), plain(meaning)
    row.button(label, key=f"answer {key}", type="tertiary", help=help_, on_click=_open_with, args=args)


def _open_with(page: str, chosen: Mapping[str, object]) -> None:
    st.session_state.update({"overlaid": []} | dict(chosen), opening=None)
    forget()
    open_next(page)


@st.cache_data(ttl=60, show_spinner=False)
def _not_kept() -> str:
    reason = not_kept()
    return reason and f"Results are lost when the server ends: {reason}. Name another by CRASHFUSE_CACHE."


def offer_sample() -> None:
    """Offer to load the sample."""
    st.button("Load the sample campaign", type="primary", on_click=choose_campaign, args=(campaigns.SAMPLE,))
