"""What is chosen for all pages: campaign, held-out test, display; and how a page chooses otherwise."""

from dataclasses import dataclass
from pathlib import Path

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.reporting.plots.display import Display
from crashfuse.ui import address, campaigns

NOT_FOUND = "not found"
"""Session key: what the link asked for and was not found."""
ASKED = "campaign asked for"
"""Session key: the campaign of a link, while it is not open."""
REFUSED = "refused"
"""Session key: what is wrong with the campaign last tried."""


@dataclass(frozen=True)
class View:
    """The user's choices in the sidebar, and the name of the campaign in its list."""

    campaign: Campaign
    name: str
    held_out: CrashTest
    display: Display

    @property
    def folder(self) -> Path:
        """The folder of the campaign; a DataError if pages may not open it any more."""
        return campaigns.folder_of(self.name)


def choose_campaign(name: str) -> None:
    """Select one of the open campaigns; call it from a callback, before the sidebar is drawn."""
    if name not in (st.session_state["campaign"], st.session_state.pop(ASKED, None)):
        address.leave_campaign()
    st.session_state["campaign"] = name
    forget()


def choose_held_out(test: CrashTest) -> None:
    """Select the test to hold out; call it from a callback, before the sidebar is drawn."""
    st.session_state["test"] = test.id
    forget()


def note(sentence: str) -> None:
    """Tell something at the head of the next page, until the user chooses something else there."""
    st.session_state[NOT_FOUND] = sentence


def forget() -> None:
    """Clear the messages about what was not found or refused: the user has chosen something else."""
    st.session_state.pop(NOT_FOUND, None)
    st.session_state.pop(REFUSED, None)
