"""Text on a page: untrusted text, such as a file's name or a table cell, and sentences in the reader's units."""

import re
import string
from dataclasses import replace

import streamlit as st

from crashfuse.errors import Problem
from crashfuse.wording import MPH_LB, SYSTEMS, UnitSystem, said, unbroken

_MARKS = {ord(char): f"\\{char}" for char in string.punctuation}
_ADDRESS = re.compile(r"(https?:(?=//)|www(?=\.)|@(?=[-\w]))", re.IGNORECASE)
_JOINER = "\u2060"  # takes no room: without it an address becomes a link, escaped or not
_ESCAPED = re.compile(rf"\\([{re.escape(string.punctuation)}])")
_INSIDE = r"(?:[^()]|\([^()]*\))*"  # of parentheses: a channel's name may have its own
_OPTION = re.compile(rf" \({_INSIDE}--{_INSIDE}\)")


def plain(text: object) -> str:
    """Text in the units of the sidebar, which Markdown shows literally, on one line: no links, formulas, HTML."""
    shown = unbroken(" ".join(said(text, chosen_units()).split()))
    return _ADDRESS.sub(rf"\1{_JOINER}", shown).translate(_MARKS)


def as_read(markdown: str) -> str:
    """The text of which :func:`plain` made this."""
    return _ESCAPED.sub(r"\1", markdown).replace(_JOINER, "").replace("\N{NO-BREAK SPACE}", " ")


def chosen_units() -> UnitSystem:
    """The units that were chosen in the sidebar, for the session as a whole."""
    system = SYSTEMS.get(st.session_state.get("system") or "", MPH_LB)
    return replace(system, acceleration=st.session_state.get("unit") or "g")


def advice_on_page(problem: Problem) -> str:
    """Advice without the command line's options, which are fields on the page."""
    advice = without_options(problem.advice)
    return advice[:1].upper() + advice[1:]


def without_options(text: str) -> str:
    """A sentence without the command line's options, which stand in parentheses."""
    return _OPTION.sub("", text)
