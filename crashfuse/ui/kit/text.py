"""Text on a page: untrusted text, such as a table cell, sentences in the reader's units, and definitions of terms."""

import re
import string
from dataclasses import replace

import streamlit as st

from crashfuse.errors import Problem
from crashfuse.units import MPH_LB, SYSTEMS, UnitSystem, said, unbroken

_MARKS = {ord(char): f"\\{char}" for char in string.punctuation}
_ADDRESS = re.compile(r"(https?:(?=//)|www(?=\.)|@(?=[-\w]))", re.IGNORECASE)
_JOINER = "\u2060"  # takes no room: without it an address becomes a link, escaped or not
_INSIDE = r"(?:[^()]|\([^()]*\))*"  # of parentheses: a channel's name may have its own
_OPTION = re.compile(rf" \({_INSIDE}--{_INSIDE}\)")

TTZV = "Time of zero velocity (TTZV), from contact: crush is largest, rebound begins. The paper's t0."
TO_TTZV_HELP = "A column in the tables of ratings. Nothing is learned from it or recommended by it."
METRICS = {
    "peak": "Largest deceleration.",
    "peak_time": "From contact to the largest deceleration.",
    "delta_v": "Largest change of velocity, rebound included.",
    "t0": TTZV,
    "max_crush": "Displacement at zero velocity, the largest.",
    "mean": "Impact speed over the time of zero velocity.",
    "sm25": "Largest loss of velocity within 25 ms, over 25 ms.",
    "olc": "Deceleration of an occupant who moves freely, then is stopped evenly by the restraint.",
    "vpi": "Largest deceleration of an occupant on a spring with slack (ISO/TR 12353-3).",
}
PULSE_SHAPE = (
    "Equivalent square wave: constant deceleration with the same crush. Two-step pulse: G1, then G2, by least squares "
    "until TTZV. Centroid time: crush over impact speed. Front-to-back loading ratio: mean deceleration in the first "
    "half of TTZV over the second. Static crush, rebound velocity: on leaving the barrier. Restitution: rebound over "
    "impact velocity."
)
LF = "LF TCN: low-fidelity (LF) network, trained on CAE runs only."
TIME_DOMAIN = "Time domain: multi-fidelity (MF) network, the LF network fine-tuned on tests."
DRAWS = "95 % of the ratings of single pulses drawn from the band, which oscillate more and so rate lower."
RATING_PARTS = (
    "Overall = 0.4 corridor + 0.2 phase + 0.2 magnitude + 0.2 slope. Corridor: share of the curve near the test. "
    "Phase: how little it is moved in time. Magnitude: closeness once moved and warped. Slope: closeness of slopes "
    "once moved."
)
HUMPS = "Humps rise above their valleys by a tenth of the largest acceleration; time warping pairs them."


def plain(text: object) -> str:
    """Text in the units of the sidebar, which Markdown shows literally, on one line: no links, formulas, HTML."""
    shown = unbroken(" ".join(said(text, chosen_units()).split()))
    return _ADDRESS.sub(rf"\1{_JOINER}", shown).translate(_MARKS)


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
