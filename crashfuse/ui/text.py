"""Text on a page: untrusted text, such as a file's name or a table cell, and sentences in the reader's units."""

import string
from dataclasses import replace

import streamlit as st

from crashfuse.wording import MPH_LB, SYSTEMS, UnitSystem, said, unbroken

_MARKS = {ord(char): f"\\{char}" for char in string.punctuation}


def plain(text: object) -> str:
    """Text that Markdown shows literally, on one line: no links, images, formulas, icons or HTML.

    A sentence, a condition or a quantity is said in the units that were chosen in the sidebar.
    """
    return unbroken(" ".join(said(text, chosen_units()).split())).translate(_MARKS)


def show_label(label: str) -> None:
    """Show the label of a field whose own is collapsed: that one is read out as it is written, Markdown's marks too."""
    st.markdown(f":small[{plain(label)}]")


def chosen_units() -> UnitSystem:
    """The units that were chosen in the sidebar, for the session as a whole."""
    system = SYSTEMS.get(st.session_state.get("system") or "", MPH_LB)
    return replace(system, acceleration=st.session_state.get("unit") or "g")
