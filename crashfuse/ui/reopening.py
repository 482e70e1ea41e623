"""A past result opened again, and two of them put beside each other on the page of the first."""

from contextlib import suppress
from dataclasses import replace

import streamlit as st

from crashfuse.approaches.registry import APPROACHES
from crashfuse.errors import DataError
from crashfuse.study.history import PastResult
from crashfuse.ui import campaigns
from crashfuse.ui.chosen import choose_campaign, note
from crashfuse.ui.earlier import settings_text
from crashfuse.ui.navigation import open_next
from crashfuse.ui.pins import pin_all
from crashfuse.ui.predict.condition import fill_in
from crashfuse.ui.text import plain

_REFUSED = "refused result"  # session key


def say_refused() -> None:
    """Say what is in the way of opening a result, if that was just tried."""
    if refused := st.session_state.pop(_REFUSED, ""):
        st.warning(plain(refused), icon=":material/folder_off:")


def open_result(result: PastResult) -> bool:
    """Open a result; False if it cannot be, and why is recorded."""
    if not _choose(result):
        return False
    if len(result.tests) == 1:
        st.session_state["test"] = result.tests[0]
    if result.condition is not None:
        fill_in(campaigns.load(st.session_state["campaign"]), result.condition)
    open_next(_page(result))
    return True


def _choose(result: PastResult) -> bool:
    """Choose the data and the settings of a result; False if they are not there, and why is recorded."""
    names = [name for name in campaigns.open_campaigns() if fingerprint(name) == result.fingerprint]
    here = st.session_state["campaign"]
    name = here if here in names else next(iter(names), None)
    if name is None:
        st.session_state[_REFUSED] = _in_the_way(result)
        return False
    choose_campaign(name)
    if name != here:
        note(f"Opened in {campaigns.label(name)}, which has the data of this result.")
    config = result.config
    st.session_state.update(
        preset=config.preset, seed=config.seed, device=config.device,
        approaches=[approach for approach in APPROACHES if approach in config.approaches],
        leave_out="speed group" if config.leave_out == "speed group" else "test",
    )  # fmt: skip
    return True


def _in_the_way(result: PastResult) -> str:
    """Why no open campaign has the data of a result."""
    data = f"campaign {result.campaign} with the data {result.fingerprint[:8]}"
    of = f"The {data}"
    for name in campaigns.open_campaigns():
        with suppress(DataError):
            campaign = campaigns.load(name)
            unused = ", ".join(test for test, _ in campaign.unused)
            if campaign.name == result.campaign and unused:
                return f"{of} is open with other tests: use {unused} again on the page Data, then choose it again."
            if campaign.name == result.campaign:
                return (
                    f"{of} was changed since: undo that on the page Data, or open a copy of it, then choose it again."
                )
    return f"You have not opened the {data}: open its folder, or upload it, on the page Data, then choose it again."


def _page(result: PastResult) -> str:
    if result.condition is not None:
        return "predict"
    return "compare" if len(result.tests) == 1 else "study"


def fingerprint(name: str) -> str | None:
    """That of the data of an open campaign; None if it cannot be read any more."""
    try:
        return campaigns.fingerprint_of(name)
    except DataError:
        return None


def offer_pulses(first: PastResult, second: PastResult) -> None:
    """Offer to show the pulses of both on Compare, if they rest on the same data and have one test in common."""
    shared = [test for test in first.tests if test in second.tests]
    own, others = first.config.split_configs[0], second.config.split_configs
    other = next((config for config in others if config.leave_out == own.leave_out), others[0])
    beside = settings_text(other)
    if first.fingerprint == second.fingerprint and len(shared) == 1 and beside != settings_text(own):
        st.button(
            f"Show both on Compare, {plain(shared[0])}", icon=":material/stacked_line_chart:", on_click=_open_beside,
            args=(first, shared[0], beside), help="The pulses of the second stand beside those of the first.",
        )  # fmt: skip


def _open_beside(result: PastResult, test: str, beside: str) -> None:
    """Open a study at one of its tests on Compare, with the prediction of it by other settings beside its own."""
    if _choose(result):
        st.session_state["test"] = test
        _put_beside(beside)
        open_next("compare")


def _put_beside(settings: str) -> None:
    """Choose that predictions by other settings stand beside those of the page that is opened."""
    st.session_state["also"] = list(dict.fromkeys([*st.session_state["also"], settings]))


def offer_predictions(first: PastResult, second: PastResult) -> None:
    """Offer to show two predictions beside each other on the page Predict, which has both pulses and all metrics."""
    if first.fingerprint != second.fingerprint:
        told = "These predictions rest on different data; Predict shows those beside each other that rest on the same."
    elif _settings(first) != _settings(second) and first.condition != second.condition:
        told = (
            "These predictions differ in their condition and in their settings; Predict shows those beside each other "
            "that differ in only one of the two."
        )
    else:
        st.button(
            "Show both on Predict", icon=":material/keep:", type="primary", on_click=_open_both, args=(first, second)
        )
        return
    st.info(told, icon=":material/join_inner:")


def _open_both(first: PastResult, second: PastResult) -> None:
    """Open a prediction with another beside it: by its settings, or pinned if these are the same."""
    if not open_result(first):
        return
    if _settings(first) != _settings(second):
        _put_beside(settings_text(replace(second.config, leave_out=st.session_state["leave_out"])))
    else:
        pin_all([each.condition for each in (first, second) if each.condition is not None])


def _settings(result: PastResult) -> tuple[str, int]:
    return result.config.preset, result.config.seed
