"""Progress of a running job, and what a page shows until there is a result."""

import math
import time
from collections.abc import Sequence
from typing import Any, TypeVar

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.reporting.watched import Step
from crashfuse.ui.computation import Request, jobs
from crashfuse.ui.figures import show_figure
from crashfuse.ui.jobs import Job
from crashfuse.ui.navigation import end_page, show_link
from crashfuse.ui.text import plain
from crashfuse.ui.visitors import names, visitor

T = TypeVar("T")

_PART_S = 3.0  # between two parts of a result: each redraws the page
_OFTEN_S, _SELDOM_S = 0.5, 1.0  # between two looks at a job: until a part is shown, and then; each look costs the job


def result_of(request: Request[T], *, invitation: str, button: str) -> T:
    """The result of a request; until there is one, the page shows how to get it and stops.

    While the job runs it is what is known of the result so far, if anything: progress is then shown above it.
    """
    result = result_or_none(request, invitation=invitation, button=button)
    if result is None:
        end_page()
    return result


def result_or_none(request: Request[T], *, invitation: str, button: str) -> T | None:
    """Like :func:`result_of`, but the page continues without a result."""
    job = request.find()
    if job is not None and job.result is not None:
        return job.result
    if job is not None and job.active:
        part = job.part
        show_job(job, part, time.monotonic(), in_full=part is None)
        if part is not None:
            return part
    else:
        if job is not None:
            show_end(job)
        st.markdown(invitation)
        st.button(button, type="primary", icon=":material/play_arrow:", on_click=request.start, key=button)
    return None


def stop_with_a_single_test(campaign: Campaign) -> None:
    """If there is only one test, end a page that leaves tests out, with an explanation."""
    if len(campaign.tests) > 1:
        return
    st.info(
        f"{plain(campaign.test_ids[0])} is the only test of this campaign: left out, it would leave nothing to learn "
        "from. The page Predict works; how well it predicts cannot be checked before there is a second test.",
        icon=":material/looks_one:",
    )
    show_link("predict", "Predict another condition")
    end_page()


def show_end(job: Job[Any]) -> None:
    """Show in one line how a job ended."""
    if job.state == "failed":
        st.error(plain(job.message), icon=":material/error:")
    elif job.state == "cancelled":
        st.warning(
            "Cancelled. Whatever was finished is kept; starting again continues from there.", icon=":material/cancel:"
        )


def show_job(job: Job[T], shown: T | None = None, since: float = math.inf, *, in_full: bool = True) -> None:
    """Show the progress of a job; once it has ended, the page is redrawn.

    A page that shows parts of the result says which part it has ``shown``, and ``since`` when: it is redrawn when more
    is known, a first part at once.
    """
    every_s = _OFTEN_S if shown is None else _SELDOM_S
    st.fragment(_show_job, run_every=every_s)(job, shown, since, in_full=in_full)


def _show_job(job: Job[T], shown: T | None, since: float, *, in_full: bool) -> None:
    more = job.part is not shown and (shown is None or time.monotonic() - since > _PART_S)
    if not job.active or (more and since < math.inf):
        st.rerun()
    with st.container(border=True):
        with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
            st.markdown(f"**{plain(job.title)}**", width="content")
            _show_wanting(job)
        if job.cancelling:
            st.caption("Stopping at the next opportunity …")
        elif others := plain(names(job.wanted_by - {visitor()})):
            mine = visitor() in job.wanted_by
            st.caption(f"Also wanted by {others}: Cancel ends it only for you." if mine else f"Started by {others}.")
        elif job.state == "waiting":
            ahead = next((other for other in jobs().active if other is not job), None)
            st.caption("Waiting for its turn" + (f" behind: {title_of(ahead)}" if ahead else "") + ".")
        steps = list(job.steps.items())
        _show_bar(job, steps)
        if steps:
            with st.expander("Steps", icon=":material/checklist:"):
                for name, step in steps:
                    _show_step(name, step)
        told = [(name, step) for name, step in steps if in_full and step.learns]
        for column, (name, step) in zip(st.columns(max(len(told), 1)), told, strict=False):
            column.caption(plain(name))
            with column:
                show_figure(step.plot(), alt=f"{name}, so far", key=f"{name} {id(job)}")


def title_of(job: Job[Any]) -> str:
    """The title of a job to those who want it; to others, whose it is."""
    if visitor() in job.wanted_by:
        return plain(job.title)
    return f"A computation of {plain(names(job.wanted_by) or 'nobody now')}"


def _show_wanting(job: Job[Any]) -> None:
    """Let the visitor cancel a job, as far as they are concerned, or ask for one that another has started."""
    me = visitor()
    if me in job.wanted_by or job.cancelling:
        st.button(
            "Cancel", icon=":material/stop:", on_click=job.cancel, args=(me,), disabled=job.cancelling,
            key=f"cancel {id(job)}",
        )  # fmt: skip
    else:
        st.button(
            "I want it, too", icon=":material/add:", on_click=job.join, args=(me,), key=f"join {id(job)}",
            help="It then goes on for you if the other cancels it.",
        )  # fmt: skip


def _show_bar(job: Job[Any], steps: Sequence[tuple[str, Step]]) -> None:
    """A bar for what the job is doing, and for how long it has worked: how long it will nobody can know."""
    if not steps:
        return
    doing, step = next((pair for pair in reversed(steps) if not pair[1].finished), steps[-1])
    st.progress(step.progress.fraction, text=f"{plain(doing)} · {duration(job.elapsed_s)} so far")


def _show_step(name: str, step: Step) -> None:
    progress = step.progress
    if step.finished:
        st.caption(f":material/check: {plain(name)}, {duration(step.updated - step.started)}")
    else:
        st.caption(f":material/hourglass_top: {plain(name)}: {progress.done:,} of {progress.total:,}")


def duration(seconds: float) -> str:
    """A duration in everyday words."""
    if seconds < 120:  # 90 s are not yet 2 min
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
