"""Settings of the fits: approaches, preset, seed and device; other pages use the same settings."""

from dataclasses import replace

import streamlit as st

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.approaches.settings import DEVICES, PRESETS
from crashfuse.crash_test import SPEED_STEP_MPS
from crashfuse.errors import UsageError
from crashfuse.reporting import glossary
from crashfuse.study.config import StudyConfig
from crashfuse.ui import address
from crashfuse.ui.computation import chosen_config
from crashfuse.ui.text import chosen_units
from crashfuse.wording import said, speed


def choose_settings(*, leaving_out: bool) -> tuple[StudyConfig, str]:
    """Ask for the settings, including what else is left out if tests are; second is what is wrong with them, if any."""
    chosen = st.pills(
        "Approaches", APPROACHES, selection_mode="multi", format_func=LABELS.__getitem__,
        key="approaches", persist_state="session",
    )  # fmt: skip
    st.caption(f"{glossary.LF} {glossary.TIME_DOMAIN}")
    left, right = st.columns(2, gap="large")
    left.radio(
        "Settings",
        PRESETS,
        captions=["Ours: minutes on a laptop.", "As published (Zeng et al. 2023), for comparison."],
        format_func={"fast": "Fast", "paper": "Paper"}.__getitem__,
        key="preset",
        persist_state="session",
    )
    with right.expander("Advanced", icon=":material/tune:"):
        st.number_input(  # without bounds, within which a browser would keep the last one and say nothing to the page
            "Seed", step=1, key="seed", persist_state="session",
            help="Of all random numbers. The same seed gives the same results.",
        )  # fmt: skip
        if leaving_out:
            choose_left_out("train")
        from torch import cuda  # imported while the first pages are read

        st.radio(
            "Networks are trained on",
            DEVICES if cuda.is_available() or st.session_state["device"] == "cuda" else ("auto", "cpu"),
            format_func={"auto": "A GPU if there is one", "cpu": "The CPU", "cuda": "The GPU"}.__getitem__,
            key="device",
            persist_state="session",
            help="GPU means CUDA. Results of different devices differ in their last digits.",
        )
    config = chosen_config()
    if config.preset == "paper":
        st.warning(
            "The paper's settings take many hours without a GPU. You can cancel at any time.", icon=":material/timer:"
        )
    if not chosen:
        return config, "Choose at least one approach."
    try:
        replace(config, seed=int(st.session_state["seed"])).check()
    except UsageError as error:
        return config, str(error)
    return config, ""


def choose_left_out(page: str) -> None:
    """Ask what is left out with a test, on a page that has this in a place of its own.

    A widget of the same key in another place, first drawn, would have no value and not that of the session.
    """
    state, shown = st.session_state, f"leave_out on {page}"
    address.put(shown, state["leave_out"])
    st.segmented_control(
        "Left out",
        address.CHOICES["leave_out"].options,
        required=True,
        format_func={"test": "The test", "speed group": "All at its speed"}.__getitem__,
        key=shown,
        persist_state="session",
        on_change=lambda: state.update(leave_out=state[shown]),
        help="Without any test at about its speed the prediction is a step to a new speed: the harder question. Tests "
        f"less than {said(speed(SPEED_STEP_MPS, form='.2g'), chosen_units())} apart are at about one speed.",
    )
