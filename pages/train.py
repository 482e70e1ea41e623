"""Train: fit to all tests, to predict new conditions; or leave tests out, to see how good such predictions are."""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import TypeVar

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.crash_test import CrashTest
from crashfuse.study.study import Study
from crashfuse.ui.kit import address, frame, results
from crashfuse.ui.kit.address import choose_held_out
from crashfuse.ui.kit.computation import FitRequest, Fitted, Request, StudyRequest, jobs
from crashfuse.ui.kit.figures import choose
from crashfuse.ui.kit.files import download_bytes
from crashfuse.ui.kit.frame import choose_settings
from crashfuse.ui.kit.navigation import open_next, show_link
from crashfuse.ui.kit.progress import show_end, show_job, show_training, stop_with_a_single_test, title_of
from crashfuse.ui.kit.text import plain
from crashfuse.ui.kit.visitors import visitor

T = TypeVar("T")
FIT, LEAVE_OUT = "Fit on all tests", "Leave tests out"

view = frame.enter_with_campaign("Train")
campaign = view.campaign


def choose_tests() -> tuple[str, ...]:
    """Ask which tests to leave out, at first the one chosen for all pages."""
    address.default("held_out", [view.held_out.id])
    asked = st.session_state["held_out"]
    if missing := [test for test in asked if test not in campaign.test_ids]:
        st.caption(f":material/link_off: No test here is named {plain(', '.join(missing))[:80]}.")
        st.session_state["held_out"] = [test for test in asked if test not in missing]
    chosen = st.multiselect(
        "Held-out tests, each in turn", campaign.test_ids, key="held_out", persist_state="session",
        help="While one is predicted, all others train, those in this list included.",
    )  # fmt: skip
    return tuple(test for test in campaign.test_ids if test in chosen)


def compute(
    request: Request[T], show_result: Callable[[T], None], show_part: Callable[[T], None] | None = None, *, trouble: str
) -> None:
    """Offer to start a computation, show its progress and result."""
    if trouble:
        st.info(plain(trouble))
    job = None if trouble else request.find()
    if job is None or job.state in ("failed", "cancelled"):
        st.button("Start", type="primary", icon=":material/play_arrow:", on_click=request.start, disabled=bool(trouble))
    if job is not None and job.active:
        part = job.part if show_part is not None else None
        if part is not None and show_part is not None:
            show_part(part)
        show_job(job, part, time.monotonic() if show_part is not None else math.inf)
    elif job is not None and job.result is not None:
        show_result(job.result)
    elif job is not None:
        show_end(job)
    if others := [other for other in jobs().active if other is not job]:
        st.subheader("Also running or waiting")
        for other in others:
            if visitor() in other.wanted_by:
                show_job(other)
            else:
                st.caption(f":material/hourglass_top: {title_of(other)}")


def show_models(fitted: Fitted) -> None:
    """Say what the models are for, and offer them for download."""
    st.success(
        f"Learned from {len(campaign.tests)} tests and {len(campaign.cae):,} CAE runs. The models are kept for next "
        "time; the page Predict answers any condition at once.",
        icon=":material/check_circle:",
    )
    show_link("predict", "Predict a new condition")
    download_bytes("models.zip", partial(fitted.models, campaign), campaign.name)


def show_predicted_so_far(study: Study) -> None:
    """Say which approaches have predicted already; their tests can be compared by them."""
    show_training(config, study.config.approaches)
    window_ms, n = view.display.window_ms, len(study.folds)
    rated = ", ".join(f"{LABELS[name]} {study.mean_rating(name, window_ms):.3f}" for name in study.config.approaches)
    of = plain(study.folds[0].held_out) if n == 1 else f"mean of {n} tests"
    st.markdown(f"Rated already, {of}, {results.window_label(window_ms)}: {rated}.")
    link_to_tests(study)


def show_predicted(study: Study) -> None:
    """Say that the predictions are ready, and link to each."""
    st.success("The predictions are ready, and kept for next time.", icon=":material/check_circle:")
    link_to_tests(study)


def link_to_tests(study: Study) -> None:
    """Link to each test of a study on the page Compare."""
    with st.container(horizontal=True):
        for fold in study.folds:
            st.button(
                f"Compare {plain(fold.held_out)}", icon=":material/arrow_forward:", on_click=open_test,
                args=(campaign.test(fold.held_out),),
            )  # fmt: skip


def open_test(test: CrashTest) -> None:
    """Turn to a test on the page Compare."""
    choose_held_out(test)
    open_next("compare")


purpose = choose("What for", [LEAVE_OUT, FIT], key="purpose", default=LEAVE_OUT if len(campaign.tests) > 1 else FIT)
if purpose == FIT:
    st.markdown(
        "Fit every approach on all tests, as `crashfuse train` does, to predict conditions that were not tested."
    )
    config, trouble = choose_settings(leaving_out=False)
    compute(FitRequest(campaign, config), show_models, trouble=trouble)
else:
    stop_with_a_single_test(campaign)
    st.markdown(
        "Leave a test out, fit every approach on all others, as `crashfuse study` does, and see how well that test is "
        "predicted."
    )
    held_out = choose_tests()
    config, trouble = choose_settings(leaving_out=True)
    if not held_out:
        trouble = "Choose at least one test and one approach."
    request = StudyRequest(campaign, held_out, config)
    compute(request, show_predicted, show_predicted_so_far, trouble=trouble)
