"""The address holds every choice that decides what a page shows: one link, one view; Back undoes the last choice.

A widget keeps its value in the session under its key. Before a page is drawn the values that are not the default are
written to the address, which the browser remembers one by one; they are read back when a session begins and on Back and
Forward.
"""

import math
from collections.abc import Collection, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import streamlit as st
from streamlit.runtime.scriptrunner import get_script_run_ctx

from crashfuse.approaches.registry import APPROACHES
from crashfuse.approaches.settings import DEVICES, PRESETS
from crashfuse.certification.verdict import WORDS
from crashfuse.reporting.plots.curves import TEST
from crashfuse.reporting.report.page import REPORT_FORMS
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.study.config import WINDOWS_MS
from crashfuse.wording import SYSTEMS

Value = str | float | bool | tuple[str, ...] | None

_PAGE, _DEFAULTS = "page", "defaults"  # session keys: the open page; defaults that depend on the campaign
_WANTED = "units wanted"  # session key: the system of units that the user has chosen, in any campaign


@dataclass(frozen=True)
class Choice:
    """One choice.

    Parameters
    ----------
    kind : type
        What the address is read as: str, int, float, bool, or tuple for several texts.
    default : optional
        Its value if the address does not name it; None if it depends on the campaign (see :func:`default`).
    options : sequence, optional
        The values it can have; none where they depend on the campaign.
    pages : tuple of str, optional
        The pages on which it acts; none for all.
    of_campaign : bool
        Whether it means nothing in another campaign.
    """

    kind: type = str
    default: Value = None
    options: Sequence[Value] = ()
    pages: tuple[str, ...] = ()
    of_campaign: bool = False

    def acts_on(self, page: str | None) -> bool:
        """True if it decides what a page shows, or any page if none is given."""
        return page is None or not self.pages or page in self.pages

    def parse(self, texts: Sequence[str]) -> Value:
        """The value that these texts of an address stand for; the default if they stand for none."""
        if self.kind is tuple:
            return tuple(text for text in texts if text and (not self.options or text in self.options))
        try:
            value: Value = texts[-1] == "true" if self.kind is bool else self.kind(texts[-1])
        except ValueError:
            return self.default
        if isinstance(value, float) and not math.isfinite(value):
            return self.default
        return value if not self.options or value in self.options else self.default

    def texts(self, value: object) -> list[str]:
        """What stands for a value in the address."""
        if isinstance(value, tuple | list):
            return [str(item) for item in value] or [""]
        if isinstance(value, bool):
            return [str(value).lower()]
        return [f"{value:.12g}" if isinstance(value, float) else str(value)]


_ANY = "…"  # in a key: a factor of the campaign

CHOICES: dict[str, Choice] = {
    # what is looked at
    "campaign": Choice(),
    "test": Choice(pages=("data", "train", "compare"), of_campaign=True),
    "import": Choice(pages=("data",)),
    "held_out": Choice(tuple, None, pages=("train",), of_campaign=True),
    # how it is predicted
    "leave_out": Choice(str, "test", ("test", "speed group"), ("train", "compare")),
    "approaches": Choice(tuple, APPROACHES, APPROACHES),
    "preset": Choice(str, "fast", PRESETS),
    "seed": Choice(int, 0, range(2**32)),
    "device": Choice(str, "auto", DEVICES),
    # how it is shown
    "window": Choice(float, WINDOWS_MS[-1], WINDOWS_MS, ("data", "compare", "study", "predict", "history")),
    "system": Choice(options=tuple(SYSTEMS)),
    "unit": Choice(str, "g", ("g", "m/s²"), ("data", "compare", "study", "predict", "certify")),
    "sign": Choice(str, "Acceleration", ("Acceleration", "Deceleration"), ("data", "compare", "predict")),
    # what is shown on a page
    "data_tab": Choice(pages=("data",), of_campaign=True),
    "filter": Choice(pages=("data",)),
    "purpose": Choice(pages=("train",)),
    "compare_tab": Choice(pages=("compare",)),
    "compared": Choice(pages=("compare",)),
    "explained": Choice(pages=("compare",)),
    "corridors": Choice(bool, False, pages=("compare",)),
    "networks": Choice(pages=("compare",)),
    "over_displacement": Choice(pages=("compare",)),
    "study_tab": Choice(pages=("study",)),
    "ways": Choice(pages=("study",)),
    "cost": Choice(float, pages=("study",)),
    "report_form": Choice(str, "whole", REPORT_FORMS, ("compare", "study", "predict")),
    "report_tests": Choice(tuple, (), pages=("study",), of_campaign=True),
    "predict_tab": Choice(pages=("predict",)),
    "predicted": Choice(pages=("predict",)),
    "curves": Choice(tuple, (TEST, *APPROACHES), (TEST, *APPROACHES), ("compare", "predict")),
    "band": Choice(str, "recommended", ("recommended", *APPROACHES), ("compare", "predict")),
    "only": Choice(tuple, (), pages=("data",), of_campaign=True),
    "also": Choice(tuple, (), pages=("data", "compare", "predict"), of_campaign=True),
    "pins": Choice(tuple, (), pages=("data", "compare", "predict")),
    "speed_mph": Choice(float, pages=("predict",)),
    "front_weight_lb": Choice(float, pages=("predict",)),
    "rear_weight_lb": Choice(float, pages=("predict",)),
    "factor_…": Choice(pages=("predict",)),
    "sweep_metric": Choice(str, next(iter(METRIC_LABELS)), tuple(METRIC_LABELS), ("predict",)),
    "speed_range": Choice(pages=("predict",)),
    "front_range": Choice(pages=("predict",)),
    "rear_range": Choice(pages=("predict",)),
    "criteria": Choice(tuple, pages=("certify",), of_campaign=True),
    "confidence": Choice(float, pages=("certify",), of_campaign=True),
    "approach": Choice(pages=("certify",)),
    "matrix": Choice(pages=("certify",), of_campaign=True),
    "uploaded": Choice(pages=("certify",), of_campaign=True),
    "earlier": Choice(pages=("certify",), of_campaign=True),
    "speeds": Choice(pages=("certify",), of_campaign=True),
    "front_weights": Choice(pages=("certify",), of_campaign=True),
    "rear_weights": Choice(pages=("certify",), of_campaign=True),
    "grid_…": Choice(tuple, pages=("certify",)),
    "verdicts": Choice(tuple, WORDS, WORDS, pages=("certify",)),
    "listed": Choice(str, "this", ("this", "all"), pages=("history",)),
    "first": Choice(pages=("history",)),
    "second": Choice(pages=("history",)),
    "compared_way": Choice(pages=("history",)),
    "compared_approach": Choice(pages=("history",)),
    "certify_tab": Choice(pages=("certify",)),
    "cell": Choice(pages=("certify",), of_campaign=True),
    "record": Choice(pages=("certify",)),
}


def follow(page: str) -> None:
    """Take all choices from the address if a session begins, those of its page if the user goes back or forward.

    At no other time: a click may come from a browser that has not seen the latest address yet.
    """
    state, context = _state(), get_script_run_ctx()
    asked = given()
    began = _PAGE not in state
    state[_PAGE] = page
    if began or (context is not None and context.is_history_navigation and asked):
        _take(None if began else page, asked)
    if began:
        want_units()
    for key, choice in CHOICES.items():
        state.setdefault(key, list(choice.default) if isinstance(choice.default, tuple) else choice.default)


@dataclass(frozen=True)
class Place:
    """A page with what is chosen there."""

    page: str
    parameters: Mapping[str, list[str]]

    @property
    def is_here(self) -> bool:
        """True if this session shows it now."""
        return self == here()

    def take(self) -> None:
        """Choose what is chosen there; call it from a callback, before widgets are drawn, and then open the page."""
        _take(self.page, self.parameters)


def here(page: str | None = None) -> Place:
    """What this session shows now, or would show on another page."""
    page = page or str(_state().get(_PAGE) or "")
    return Place(page, parameters(page))


def default(key: str, value: Value | list[str], known: Sequence[Value] = (), *, follow: bool = True) -> None:
    """Give a choice its default for what is looked at, unless another was chosen that is ``known`` here.

    A choice that is not to ``follow`` keeps the default that it was given before.
    """
    state = _state()
    defaults = state.setdefault(_DEFAULTS, {})
    usual = state.get(key) is None or (follow and state[key] == defaults.get(key))
    if usual or (known and state[key] not in known):
        put(key, value)
    defaults[key] = value


def want_units() -> None:
    """Note that the system of units which is chosen now, if one is, is the user's choice for every campaign."""
    _state()[_WANTED] = _state().get("system")


def put(key: str, value: object) -> None:
    """Set what a widget shows, unless it does: what is set is sent to the browser, over what is chosen meanwhile."""
    state = _state()
    if key not in state or state[key] != value:
        state[key] = value


def leave_campaign() -> None:
    """Let another campaign decide what nobody has chosen, and what means nothing there; call it from a callback."""
    state = _state()
    usual = state.get(_DEFAULTS, {})
    if state.get("system") == state.get(_WANTED):  # the user's choice, if it is this campaign's as well
        usual.pop("system", None)
    for key, choice in CHOICES.items():
        if choice.of_campaign or (key in usual and state.get(key) == usual[key]):
            state[key] = list(choice.default) if isinstance(choice.default, tuple) else None


def publish() -> None:
    """Write the choices to the address of the open page, unless it says them, if with some that are the default.

    What is written is one step for Back.
    """
    state, page = _state(), _state()[_PAGE]
    shown, asked, known = parameters(page), given(), _of(page)
    said = {key: known[key].texts(value) for key in asked if key in known and (value := state.get(key)) is not None}
    if not shown.items() <= asked.items() or said != asked:
        st.query_params.from_dict(shown)


def parameters(page: str, keys: Collection[str] = ()) -> dict[str, list[str]]:
    """Parameters of a link to a page that shows what this session has chosen; ``keys`` are those of :func:`keys`."""
    state = _state()
    known = state.get(_DEFAULTS, {})
    shown = {}
    for key, choice in _of(page, keys).items():
        value, usual = state.get(key), choice.default
        if value is not None and value not in (known.get(key), list(usual) if isinstance(usual, tuple) else usual):
            shown[key] = choice.texts(value)
    return shown


def given() -> dict[str, list[str]]:
    """What the address says now."""
    return {key: st.query_params.get_all(key) for key in st.query_params}


def acts(key: str, page: str) -> bool:
    """True if a choice decides what a page shows."""
    return CHOICES[key].acts_on(page)


def keys() -> frozenset[str]:
    """All keys of the session and of the address; Streamlit takes milliseconds to list them."""
    return frozenset({*map(str, _state()), *st.query_params})


def _of(page: str | None, known: Collection[str] = ()) -> dict[str, Choice]:
    """The choices that act on a page, or on any, with those of a campaign's factors that are made or asked for."""
    here = {key: choice for key, choice in CHOICES.items() if choice.acts_on(page)}
    for family in [key for key in here if key.endswith(_ANY)]:
        choice, stem = here.pop(family), family.removesuffix(_ANY)
        here |= {key: choice for key in known or keys() if key.startswith(stem)}
    return here


def _take(page: str | None, asked: Mapping[str, Sequence[str]]) -> None:
    state = _state()
    if asked.get("campaign") != [state.get("campaign")]:  # of which other pages have choices, too
        leave_campaign()
    for key, choice in _of(page).items():
        value = choice.parse(asked[key]) if key in asked else choice.default
        state[key] = list(value) if isinstance(value, tuple) else value


def _state() -> MutableMapping[str, Any]:
    return cast("MutableMapping[str, Any]", st.session_state)
