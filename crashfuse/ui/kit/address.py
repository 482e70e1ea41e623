"""What is chosen on the pages, and the address that holds it: one link, one view; Back undoes the last choice.

A widget keeps its value in the session under its key. What is not the default is written to the address before a page
is drawn, and read back when a session begins and on Back and Forward.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import streamlit as st
from streamlit.runtime.scriptrunner import get_script_run_ctx

from crashfuse.approaches.base import DEVICES, PRESETS
from crashfuse.approaches.registry import APPROACHES
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError
from crashfuse.results.plots.curves import TEST
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.study.config import WINDOWS_MS, StudyConfig, require_window
from crashfuse.units import IN_SI, SYSTEMS

DECIMALS = 9  # of speeds and weights in the session: 56 km/h come back as 56
_CONDITION = {"speed_mph": "mph", "front_weight_lb": "lb", "rear_weight_lb": "lb"}
MOST_PINS = 6  # each takes ten megabytes, and a column of the table
Value = str | float | bool | tuple[str, ...] | None
_PAGE, _DEFAULTS = "page", "defaults"  # session keys: the open page; defaults that depend on the campaign
_WANTED = "units wanted"  # session key: the system of units that the user has chosen, in any campaign
_ANY = "…"  # in a key: a factor of the campaign
NOT_FOUND = "not found"  # session key: what the link asked for and was not found
ASKED = "campaign asked for"  # session key: the campaign of a link, while it is not open
REFUSED = "refused"  # session key: what is wrong with the campaign last tried
_APPROACHES = tuple(APPROACHES)


@dataclass(frozen=True)
class Choice:
    """One choice."""

    kind: Callable[[str], Any] = str  # what the address is read by: str, int, float, bool, or tuple for several texts
    default: Value = None  # None if it depends on the campaign, see :func:`default`
    options: Sequence[Value] = ()  # none where they depend on the campaign
    pages: tuple[str, ...] = ()  # on which it acts; none for all
    of_campaign: bool = False  # whether it means nothing in another campaign

    def acts_on(self, page: str | None) -> bool:
        """True if it decides what a page shows, or any page if none is given."""
        return page is None or not self.pages or page in self.pages

    def parse(self, texts: Sequence[str]) -> Value:
        """The value that these texts of an address stand for; the default if they stand for none."""
        if self.kind is tuple:
            return tuple(text for text in texts if text and (not self.options or text in self.options))
        try:
            value: Value = texts[-1] == "true" if self.kind is bool else self.kind(texts[-1])
        except (ValueError, UsageError):
            return self.default
        sound = value in self.options if self.options else not isinstance(value, float) or math.isfinite(value)
        return value if sound else self.default

    def texts(self, value: object) -> list[str]:
        """What stands for a value in the address."""
        if isinstance(value, tuple | list):
            return [str(item) for item in value] or [""]
        if isinstance(value, bool):
            return [str(value).lower()]
        return [f"{value:.12g}" if isinstance(value, float) else str(value)]


def window_of(text: str) -> float:
    """The rated window that was typed, such as 50 or 0–50 ms; a UsageError if nothing can be rated over it."""
    numbers = re.findall(r"\d+(?:\.\d+)?", text)
    require_window(float(numbers[-1]) if numbers else text)
    return float(numbers[-1])


CHOICES: dict[str, Choice] = {
    # what is looked at
    "campaign": Choice(),
    "test": Choice(pages=("data", "train", "compare"), of_campaign=True),
    "held_out": Choice(tuple, None, pages=("train",), of_campaign=True),
    # how it is predicted
    "leave_out": Choice(str, "test", ("test", "speed group"), ("train", "compare")),
    "approaches": Choice(tuple, _APPROACHES, _APPROACHES),
    "preset": Choice(str, "fast", PRESETS),
    "seed": Choice(int, 0, range(2**32), ("data", "train", "compare", "study", "predict")),
    "device": Choice(str, "auto", DEVICES),
    # how it is shown
    "window": Choice(window_of, WINDOWS_MS[-1], (), ("data", "train", "compare", "study", "predict")),
    "to_ttzv": Choice(bool, False, pages=("data", "train", "compare", "study")),
    "system": Choice(options=tuple(SYSTEMS)),
    "unit": Choice(str, "g", ("g", "m/s²"), ("data", "train", "compare", "study", "predict", "certify")),
    "sign": Choice(str, "Acceleration", ("Acceleration", "Deceleration"), ("data", "train", "compare", "predict")),
    # what is shown on a page
    "overlaid": Choice(tuple, (), pages=("data",), of_campaign=True),  # tests drawn alone
    "opening": Choice(str, None, ("add", "open"), ("data",), of_campaign=True),
    "corridors": Choice(bool, False, pages=("compare",)),
    "cost": Choice(float, pages=("study",)),
    "compare_curves": Choice(tuple, None, (TEST, *_APPROACHES), ("compare",)),
    "predict_approach": Choice(options=_APPROACHES, pages=("predict",)),
    "predict_curves": Choice(tuple, None, (*_APPROACHES, "average"), ("predict",)),
    **{f"{page}_also": Choice(tuple, (), pages=(page,), of_campaign=True) for page in ("compare", "predict")},
    **{f"{page}_nearest": Choice(bool, False, pages=(page,)) for page in ("compare", "predict")},
    "pins": Choice(tuple, (), pages=("compare", "predict")),
    **dict.fromkeys(_CONDITION, Choice(float, pages=("predict",))),
    "sweep_metric": Choice(str, next(iter(METRIC_LABELS)), tuple(METRIC_LABELS), ("predict",)),
    "criteria": Choice(tuple, pages=("certify",), of_campaign=True),
    **dict.fromkeys(("confidence", "cost_test", "cost_wrong"), Choice(float, pages=("certify",), of_campaign=True)),
    "planned": Choice(tuple, pages=("certify",), of_campaign=True),
    "what_if": Choice(tuple, (), pages=("certify",), of_campaign=True),
    "ticked": Choice(tuple, (), pages=("study",), of_campaign=True),
}
_ON_PAGE = {
    "data": ("import", "filter"),
    "train": ("train_tab", "diagnostics"),
    "compare": ("compare_tab", "compared", "explained"),
    "study": ("study_tab", "ways", "compared_way"),
    "predict": ("predict_tab", "predicted", "subtracted", "factor_…", "speed_range", "front_range", "rear_range"),
    "certify": ("approach", "certify_tab", "record"),
}
_ON_PAGE_OF_CAMPAIGN = {"data": ("data_tab",), "certify": ("matrix", "uploaded", "earlier", "cell")}
CHOICES |= {key: Choice(pages=(page,)) for page, keys in _ON_PAGE.items() for key in keys}
CHOICES |= {key: Choice(pages=(page,), of_campaign=True) for page, keys in _ON_PAGE_OF_CAMPAIGN.items() for key in keys}


def follow(page: str, wanted: Callable[[], Mapping[str, list[str]]] = dict) -> None:
    """Take all choices from the address as a session begins, the page's on Back: else a browser may not know it yet."""
    state, context, asked = st.session_state, get_script_run_ctx(), given()
    began = _PAGE not in state
    state[_PAGE] = page
    if began or (context is not None and context.is_history_navigation and asked):
        _take(None if began else page, {**wanted(), **asked} if began else asked)
    if began:
        want_units()
    for key in [key for key in CHOICES if state.get(key) is None]:  # new, or cleared by a browser not yet up to date
        put(key, _in_session(CHOICES[key].default))


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
        """Choose what is chosen there; a callback, after which to open the page."""
        _take(self.page, self.parameters)


def here(page: str | None = None) -> Place:
    """What this session shows now, or would show on another page."""
    page = page or str(st.session_state.get(_PAGE) or "")
    return Place(page, parameters(page))


def default(key: str, value: Value | list[str], known: Sequence[Value] = (), *, follow: bool = True) -> None:
    """Give a choice its default, unless a ``known`` one was chosen, or it does not ``follow`` a new default."""
    state, defaults = st.session_state, st.session_state.setdefault(_DEFAULTS, {})
    usual = state.get(key) is None or (follow and state[key] == defaults.get(key))
    if usual or (known and state[key] not in known):
        put(key, value)
    defaults[key] = value


def want_units() -> None:
    """Note that the units chosen now are the user's for every campaign."""
    st.session_state[_WANTED] = st.session_state.get("system")


def put(key: str, value: object) -> None:
    """Set what a widget shows, unless it does: what is set is sent to the browser, over what is chosen meanwhile."""
    state = st.session_state
    if key not in state or state[key] != value:
        state[key] = value


def kept(key: str, **look: Any) -> dict[str, Any]:  # noqa: ANN401 - of any widget
    """A widget's key, under which the session keeps its value also while another page is open, and its look."""
    return {"key": key, "persist_state": "session", **look}


def leave_campaign() -> None:
    """Let another campaign decide what nobody has chosen, and what means nothing there; a callback."""
    state, usual = st.session_state, st.session_state.get(_DEFAULTS, {})
    if state.get("system") == state.get(_WANTED):  # the user's choice, if it is this campaign's as well
        usual.pop("system", None)
    for key, choice in CHOICES.items():
        if choice.of_campaign or (key in usual and state.get(key) == usual[key]):
            state[key] = list(choice.default) if isinstance(choice.default, tuple) else None


def publish() -> None:
    """Write the choices to the address of the open page, one step for Back, unless it says them already."""
    state, page = st.session_state, st.session_state[_PAGE]
    shown, asked, known = parameters(page), given(), _of(page)
    said = {key: known[key].texts(value) for key in asked if key in known and (value := state.get(key)) is not None}
    if not shown.items() <= asked.items() or said != asked:
        st.query_params.from_dict(shown)


def parameters(page: str) -> dict[str, list[str]]:
    """Parameters of a link to a page that shows what this session has chosen."""
    state, defaults = st.session_state, st.session_state.get(_DEFAULTS, {})
    return {
        key: choice.texts(value)
        for key, choice in _of(page).items()
        if (value := state.get(key)) is not None and value not in (defaults.get(key), _in_session(choice.default))
    }


def given() -> dict[str, list[str]]:
    """What the address says now."""
    return {key: st.query_params.get_all(key) for key in st.query_params}


def acts(key: str, page: str) -> bool:
    """True if a choice decides what a page shows."""
    return CHOICES[key].acts_on(page)


def _of(page: str | None) -> dict[str, Choice]:
    here = {key: choice for key, choice in CHOICES.items() if choice.acts_on(page)}
    for family in [key for key in here if key.endswith(_ANY)]:
        choice, stem = here.pop(family), family.removesuffix(_ANY)
        here |= {key: choice for key in map(str, (*st.session_state, *st.query_params)) if key.startswith(stem)}
    return here


def _take(page: str | None, asked: Mapping[str, Sequence[str]]) -> None:
    state = st.session_state
    if asked.get("campaign") != [state.get("campaign")]:  # of which other pages have choices, too
        leave_campaign()
    for key, choice in _of(page).items():
        state[key] = _in_session(choice.parse(asked[key]) if key in asked else choice.default)


def _in_session(value: Value) -> Value | list[str]:
    return list(value) if isinstance(value, tuple) else value


def page_config() -> StudyConfig:
    """The settings that act on what the open page shows."""
    return chosen_config(st.session_state.get("approach") if here().page == "certify" else None)


def chosen_config(approach: str | None = None) -> StudyConfig:
    """The settings made on Train that act on an approach, or on those chosen there; also for a wrong seed."""
    state, chosen = st.session_state, (approach,) if approach else st.session_state.get("approaches") or APPROACHES
    seed = int(state.get("seed", 0))
    windows = {*WINDOWS_MS, float(state.get("window", WINDOWS_MS[-1]))}
    return StudyConfig(
        approaches=tuple(name for name in _APPROACHES if name in chosen),
        preset=state.get("preset", "fast"),
        seed=seed if seed in CHOICES["seed"].options else 0,
        windows_ms=tuple(sorted(windows)),
        leave_out=state.get("leave_out", "test"),
        device=state.get("device", "auto"),
        to_ttzv=bool(state.get("to_ttzv")),
    ).effective


def choose_campaign(name: str) -> None:
    """Select one of the open campaigns; a callback."""
    if name not in (st.session_state["campaign"], st.session_state.pop(ASKED, None)):
        leave_campaign()
    st.session_state["campaign"] = name
    forget()


def choose_held_out(test: CrashTest) -> None:
    """Select the test to hold out; a callback."""
    st.session_state["test"] = test.id
    forget()


def choose_condition(campaign: Campaign, condition: Condition) -> None:
    """Choose a condition on the page Predict; a callback."""
    given, numbers = dict(condition.factors), zip(_CONDITION.items(), condition.vector, strict=True)
    st.session_state.update({key: round(float(value) / IN_SI[unit], DECIMALS) for (key, unit), value in numbers})
    st.session_state.update({f"factor_{name}": given.get(name) or None for name in campaign.factors})


def forget() -> None:
    """Clear messages about what was not found or refused."""
    st.session_state.pop(NOT_FOUND, None)
    st.session_state.pop(REFUSED, None)


def kept_choice(
    key: str, options: Sequence[str], widget: Callable[..., object], label: str, **look: object
) -> list[str]:
    """What is chosen of these options, in that order; a widget of this key would lose what the page does not offer."""
    state, shown = st.session_state, f"{key} shown"
    before, widgets = state.get(shown, (None, 0))
    if before != (chosen := [name for name in state[key] if name in options]):
        # Set by a link, a button or another page. A widget in a closed popover would not hear of it, and would send
        # what it showed before with the next click. Another widget begins with it.
        widgets += 1
    state[shown] = chosen, widgets
    here = f"{key} {widgets} in {state['system']} here"  # a browser keeps what is chosen by its label, with its unit
    # with every run: in a closed popover there is nothing yet that would keep what is sent
    state[here] = chosen

    def keep() -> None:
        if state[shown][1] == widgets:
            now = state[here]
            kept = [name for name in state[key] if name in now or name not in options]
            state[key] = [*kept, *(name for name in now if name not in kept)]
            state[shown] = [name for name in state[key] if name in options], widgets

    widget(label, options, key=here, on_change=keep, **look)
    return [name for name in state[key] if name in options]


def pinned() -> dict[str, Condition]:
    """The pinned conditions by their texts, the oldest first."""
    pins = {}
    for text in st.session_state["pins"]:
        with suppress(UsageError):  # the link has been cut or changed
            pins[text] = Condition.parse(text)
    return dict(list(pins.items())[:MOST_PINS])


def pin_all(conditions: Sequence[Condition]) -> None:
    """Pin conditions; if they are too many, the oldest go."""
    new = [condition.text for condition in conditions]
    st.session_state["pins"] = [*(text for text in pinned() if text not in new), *new][-MOST_PINS:]
