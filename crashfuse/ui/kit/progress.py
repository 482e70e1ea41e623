"""Progress of running jobs, on the page that waits for one and in the sidebar."""

import math
import time
from collections.abc import Collection
from typing import Any, TypeVar

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.execution.jobs import Job, slowness
from crashfuse.execution.visitors import names
from crashfuse.study.config import StudyConfig
from crashfuse.ui.kit.computation import Request, jobs
from crashfuse.ui.kit.figures import show_figure
from crashfuse.ui.kit.navigation import end_page, open_page, show_link
from crashfuse.ui.kit.text import plain
from crashfuse.ui.kit.visitors import visitor

T = TypeVar("T")
_slowness = st.cache_resource(ttl=5, show_spinner=False)(slowness)
_PART_S = 3.0  # between two parts of a result: each redraws the page
_OFTEN_S, _SELDOM_S = 0.5, 1.0  # between two looks at a job: until a part is shown, and then; each look costs the job
_WORTH_A_WORD_S = 10.0
_WAITED_FOR, _ENDED = "waited for", "ended"  # session keys: jobs that run for the visitor; those to tell about


def result_of(request: Request[T], *, invitation: str, button: str) -> T:
    """The result of a request, or what is known of it; without either the page shows how to get it and ends."""
    if (result := result_or_none(request, invitation=invitation, button=button)) is None:
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
        return part
    if job is not None:
        show_end(job)
    st.markdown(f"{invitation} {_patience(request)}")
    st.button(plain(button), type="primary", icon=":material/play_arrow:", on_click=request.start, key=button)
    return None


def stop_with_a_single_test(campaign: Campaign) -> None:
    """End a page that leaves tests out if there is only one."""
    if len(campaign.tests) > 1:
        return
    only = f"{plain(campaign.test_ids[0])} is the only test: without it there is nothing to learn from."
    st.info(only, icon=":material/looks_one:")
    show_link("predict", "Predict another condition")
    end_page()


def show_end(job: Job[Any]) -> None:
    """Show in one line how a job ended."""
    if job.state == "failed":
        st.error(plain(job.message), icon=":material/error:")
    elif job.state == "cancelled":
        st.warning("Cancelled. What was finished is kept.", icon=":material/cancel:")


def show_job(job: Job[T], shown: T | None = None, since: float = math.inf, *, in_full: bool = True) -> None:
    """Show the progress of a job; the page is redrawn once more is known than was ``shown``."""
    every_s = _OFTEN_S if shown is None else _SELDOM_S
    st.fragment(_show_job, run_every=every_s)(job, shown, since, in_full=in_full)


def _show_job(job: Job[T], shown: T | None, since: float, *, in_full: bool) -> None:
    more = job.part is not shown and (shown is None or time.monotonic() - since > _PART_S)
    if not job.active or (more and since < math.inf):
        st.rerun()
    me, others, steps = visitor(), plain(names(job.wanted_by - {visitor()})), list(job.steps.items())
    wanted = me in job.wanted_by
    with st.container(border=True):
        with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
            st.markdown(f"**{plain(job.title)}**", width="content")
            if wanted or job.cancelling:
                st.button("Cancel", on_click=job.cancel, args=(me,), disabled=job.cancelling, key=f"cancel {id(job)}")
            else:
                st.button("I want it, too", on_click=job.join, args=(me,), key=f"join {id(job)}")
        if job.cancelling:
            st.caption("Stopping at the next opportunity …")
        elif others:
            st.caption(f"Also wanted by {others}: Cancel ends it only for you." if wanted else f"Started by {others}.")
        elif job.state == "waiting":
            ahead = next((other for other in jobs().active if other is not job), None)
            st.caption("Waiting for its turn" + (f" behind: {title_of(ahead)}" if ahead else "") + ".")
        if not steps:
            return
        doing, step = next((pair for pair in reversed(steps) if not pair[1].finished), steps[-1])
        of = f" of {expected}" if job.expected_s and (expected := _range(*job.expected_s)) else ""
        st.progress(step.progress.fraction, text=f"{plain(doing)} · {duration(job.elapsed_s)} so far{of}")
        with st.expander("Steps", icon=":material/checklist:"):
            for name, step in steps:
                took, icon = f": {step.progress.done:,} of {step.progress.total:,}", "hourglass_top"
                if step.finished:
                    took, icon = f", {duration(step.updated - step.started)}", "check"
                st.caption(f":material/{icon}: {plain(name)}{took}")
        learning = [(name, step) for name, step in steps if in_full and step.learns]
        for column, (name, step) in zip(st.columns(max(len(learning), 1)), learning, strict=False):
            with column:
                st.caption(plain(name))
                show_figure(step.draw(), alt=f"{name}, so far", key=f"{name} {id(job)}")


def title_of(job: Job[Any]) -> str:
    """The title of a job to those who want it; to others, whose it is."""
    if visitor() in job.wanted_by:
        return plain(job.title)
    return f"A computation of {plain(names(job.wanted_by) or 'nobody now')}"


def _patience(request: Request[Any]) -> str:
    if (usual_s := request.expected_s) == math.inf:
        return "The paper's settings take many hours without a GPU."
    expected = _range(*jobs().pace.range_s(usual_s, _slowness()))
    return expected and f"On this machine now: {expected}."


def _range(lower_s: float, upper_s: float) -> str:
    if upper_s < _WORTH_A_WORD_S:
        return ""
    per, unit, step = (1.0, "s", 5) if upper_s < 120 else (60.0, "min", 1) if upper_s < 5400 else (3600.0, "h", 1)
    lower, upper = (max(step * round(seconds / per / step), step) for seconds in (lower_s, upper_s))
    return f"{lower} to {max(upper, lower + step)} {unit}"


def show_training(config: StudyConfig, ready: Collection[str]) -> None:
    """Say which approaches are missing because their networks are still training."""
    if missing := [name for name in config.approaches if name not in ready]:
        st.info(f"{', '.join(LABELS[name] for name in missing)}: still training.", icon=":material/hourglass_top:")


def duration(seconds: float) -> str:
    """A duration in everyday words."""
    if seconds < 120:  # 90 s are not yet 2 min
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def show_running() -> None:
    """Show the server's running jobs, and those of the visitor that have ended since they last looked."""
    me, state = visitor(), st.session_state
    ended: list[Job[Any]] = state.setdefault(_ENDED, [])
    for job in state.get(_WAITED_FOR, []):
        if not job.active and job.state != "cancelled" and not job.places[me].is_here:
            ended.append(job)
            st.toast(_outcome(job), icon=":material/notifications:")
    active = jobs().active
    state[_WAITED_FOR] = [job for job in active if me in job.wanted_by and me in job.places]
    state[_ENDED] = ended = [job for job in ended if not job.places[me].is_here]
    for job in ended:
        _link(job, _outcome(job), ":material/check_circle:" if job.state == "done" else ":material/error:")
    for job in active:
        title, icon = title_of(job) + (" (waiting)" if job.state == "waiting" else ""), ":material/hourglass_top:"
        if job in state[_WAITED_FOR]:
            _link(job, title, icon)
        else:
            st.caption(f"{icon} {title}")


def _outcome(job: Job[Any]) -> str:
    return f"{'Ready' if job.state == 'done' else 'Failed'}: {plain(job.title)}"


def _link(job: Job[Any], label: str, icon: str) -> None:
    place, meaning = job.places[visitor()], "Open the page that asked"
    if st.button(label, icon=icon, type="tertiary", on_click=place.take, key=f"open {id(job)}", help=meaning):
        open_page(place.page)
