"""Train: choose what to predict and how, start it, watch it, stop it."""

import streamlit as st
import torch

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.approaches.settings import DEVICES
from crashfuse.ui import frame
from crashfuse.ui.computation import StudyRequest, chosen_config, jobs
from crashfuse.ui.panel import show_end, show_job, stop_with_a_single_test
from crashfuse.ui.text import plain

view = frame.enter_with_campaign("Train")
campaign = view.campaign
stop_with_a_single_test(campaign)
st.markdown("Leave a test out, let every approach learn from all the others, and see how well it predicts that test.")

held_out = st.multiselect(
    "Held-out tests, each in turn",
    campaign.test_ids,
    default=[view.held_out.id],
    key=f"train {campaign.fingerprint[:8]} {view.held_out.id}",
    persist_state="session",
    help="While one is predicted, all others train, those in this list included.",
)
chosen = st.pills(
    "Approaches",
    APPROACHES,
    selection_mode="multi",
    default=APPROACHES,
    format_func=LABELS.__getitem__,
    key="approaches",
    persist_state="session",
)
left, right = st.columns(2, gap="large")
left.radio(
    "Settings",
    ["fast", "paper"],
    captions=["Ours: minutes on a laptop.", "As published (Zeng et al. 2023), for comparison."],
    format_func={"fast": "Fast", "paper": "Paper"}.__getitem__,
    key="preset",
    persist_state="session",
)
with right.expander("Advanced", icon=":material/tune:"):
    st.number_input(
        "Seed", min_value=0, max_value=2**31 - 1, value=0, step=1, key="seed", persist_state="session",
        help="Of all that is random. Same seed, same numbers.",
    )  # fmt: skip
    st.radio(
        "Leave out with a test",
        ["test", "speed group"],
        format_func={"test": "Nothing else", "speed group": "All tests at about its speed"}.__getitem__,
        key="leave_out",
        persist_state="session",
        help="Without any test at about its speed the prediction is a step to a new speed: the harder question. "
        "Tests less than 2 mph apart are at about one speed.",
    )
    st.radio(
        "Networks are trained on",
        DEVICES if torch.cuda.is_available() else ("auto", "cpu"),
        format_func={"auto": "A GPU if there is one", "cpu": "The CPU", "cuda": "The GPU"}.__getitem__,
        key="device",
        persist_state="session",
        help="GPU means CUDA. Numbers of different devices differ in their last digits.",
    )
config = chosen_config()
if config.preset == "paper":
    st.warning(
        "The paper's settings take many hours without a GPU. You can cancel at any time.", icon=":material/timer:"
    )

request = StudyRequest(campaign, tuple(test for test in campaign.test_ids if test in held_out), config)
ready = bool(request.held_out and chosen)
if not ready:
    st.info("Choose at least one test and one approach.")
job = request.find() if ready else None
if job is None or not job.active:
    st.button(
        "Start", type="primary", icon=":material/play_arrow:", on_click=request.start,
        disabled=not ready or (job is not None and job.state == "done"),
    )  # fmt: skip
if job is not None:
    if job.active:
        show_job(job)
    elif job.state == "done":
        st.success("The predictions are ready, and kept for next time.", icon=":material/check_circle:")
        with st.container(horizontal=True):
            for test_id in request.held_out:
                if st.button(
                    f"Compare {plain(test_id)}", icon=":material/arrow_forward:", on_click=frame.choose_held_out,
                    args=(campaign.test(test_id),),
                ):  # fmt: skip
                    st.switch_page(frame.pages()["compare"], query_params={})
    else:
        show_end(job)

if others := [other for other in jobs().active if other is not job]:
    st.subheader("Also running or waiting")
    for other in others:
        show_job(other)
