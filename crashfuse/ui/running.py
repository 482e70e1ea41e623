"""Computations in the sidebar: what runs and what is ready, each leading to the page that asked for it."""

from typing import Any

import streamlit as st

from crashfuse.ui.computation import jobs
from crashfuse.ui.jobs import Job
from crashfuse.ui.navigation import open_page
from crashfuse.ui.panel import title_of
from crashfuse.ui.text import plain
from crashfuse.ui.visitors import visitor

_WAITED_FOR, _ENDED = "waited for", "ended"  # session keys: jobs that run for the visitor; those to tell about


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
        title = title_of(job) + (" (waiting)" if job.state == "waiting" else "")
        if job not in state[_WAITED_FOR]:
            st.caption(f":material/hourglass_top: {title}")
        else:
            _link(job, title, ":material/hourglass_top:")


def _outcome(job: Job[Any]) -> str:
    return f"{'Ready' if job.state == 'done' else 'Failed'}: {plain(job.title)}"


def _link(job: Job[Any], label: str, icon: str) -> None:
    """A button that opens the page which asked for the job, with what was chosen there."""
    place = job.places[visitor()]
    if st.button(
        label, icon=icon, type="tertiary", on_click=place.take, key=f"open {id(job)}", help="Open the page that asked"
    ):
        open_page(place.page)
