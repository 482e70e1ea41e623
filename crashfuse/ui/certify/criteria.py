"""The acceptance criteria: those of the campaign, an uploaded file's, or typed in."""

from contextlib import suppress
from dataclasses import asdict, replace
from typing import Any, Literal

import streamlit as st

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.certification.criteria import (
    COSTS,
    RATING,
    Criteria,
    criteria_of,
    limits_of_tests,
    ratings_wanted,
    read_criteria,
    with_costs,
)
from crashfuse.errors import DataError
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_UNITS, metric_headings
from crashfuse.signals.rating import STANDARD
from crashfuse.ui.certify.entry import SEPARATOR, Field, edit_table, parts_of, require_few, show_wrong, upload, uploaded
from crashfuse.ui.kit import address
from crashfuse.ui.kit.address import kept
from crashfuse.ui.kit.campaigns import View

_FILE = "criteria.toml"
_FIELDS = ("metric", "window_ms", "at_least", "at_most", "name", "unit")  # of a criterion in session and address
_COSTS = {"cost_test": "Cost of a test", "cost_wrong": "Cost of a wrong answer"}
_COSTS_HELP = "In any currency. Both say from which confidence skipping a test pays, and what it saves."
_METRICS = {**metric_headings(), RATING: f"{STANDARD} rating against a test there"}


def criteria_asked(view: View) -> Criteria | None:
    """The criteria that are chosen, at first the campaign's, if any. A DataError says what is wrong."""
    state, path, wrong, declared = st.session_state, view.folder / _FILE, None, None
    try:
        declared = read_criteria(path) if path.is_file() else None
    except DataError as error:
        wrong = error
    address.default("criteria", _rows_of(declared) if declared else [])
    usual = declared or Criteria(())
    for key, cost in _costs_of(usual).items():
        address.default(key, cost)
    costs = {name: state[key] for name, key in zip(COSTS, _COSTS, strict=True) if state[key] is not None}
    with suppress(DataError):  # which the criteria tell below
        usual = with_costs(usual, costs)
    address.default("confidence", usual.confidence)
    if rows := [row for text in state["criteria"] if (row := _row(text))]:
        confidence = usual.declared if state["confidence"] == usual.confidence else state["confidence"]
        require_few(rows, "the criteria")
        return replace(criteria_of(rows, confidence, costs or None), tolerances=usual.tolerances)
    if wrong is not None:
        raise wrong
    return None


def choose_criteria(view: View) -> Criteria | None:
    """Ask for criteria, confidence and approach; None while there are none or they are wrong."""
    state, units = st.session_state, view.display.units
    try:
        criteria, wrong = criteria_asked(view), None
    except DataError as error:
        criteria, wrong = None, error
    labels = {name: view.display.title(label, METRIC_UNITS.get(name, "")) for name, label in _METRICS.items()}

    def factor(row: list[str]) -> float:
        return units.factor(METRIC_UNITS.get(row[0], ""))

    fields = {
        0: Field("Metric", options=labels),
        1: Field("Window (ms)", "Of a rating.", factor=lambda _: 1.0),
        2: Field("At least", "In the unit of the metric.", factor),
        3: Field("At most", "In the unit of the metric.", factor),
        4: Field("Name", "Yours to choose; else the metric’s."),
    }
    edit_table("criteria", fields, [""] * len(_FIELDS), units, deciding=0)

    def start(rows: list[dict[str, Any]]) -> None:
        state["criteria"] = [_text(row) for row in rows]

    with st.container(horizontal=True, vertical_alignment="bottom"):
        tip = "A criterion is met from this probability, not met from its complement."
        st.number_input("Confidence", step=0.01, format="%.6g", width=150, help=tip, **kept("confidence"))
        for key, label in _COSTS.items():
            look = {"format": "%.10g", "width": 170, "placeholder": "optional", "help": _COSTS_HELP}
            st.number_input(label, value=None, **kept(key, **look))
        judged = kept("approach", format_func=LABELS.__getitem__, width=210)
        st.selectbox("Approach that is judged", tuple(APPROACHES), **judged)
        kind: Literal["secondary", "primary"] = "secondary" if criteria else "primary"
        st.button("Limits of these tests", type=kind, on_click=lambda: start(limits_of_tests(view.campaign, units)))
        st.button("Good ratings", on_click=start, args=(ratings_wanted(),))
        with st.popover("From a file", icon=":material/upload:"):
            metrics = ", ".join(f"`{name}` ({METRIC_UNITS[name]})" for name in MAIN_METRICS)
            st.markdown(f"`{_FILE}` has the names and units of `metrics.csv`: {metrics} and others.")
            key = f"criteria file {view.campaign.fingerprint[:8]}"
            upload(f"Upload {_FILE}", _FILE, key, _take_file)
    if wrong is not None:
        show_wrong(wrong)
    elif criteria is None:
        st.info("No criteria yet: start with limits of these tests, or fill in the table.", icon=":material/edit:")
    return criteria


def take(criteria: Criteria) -> None:
    """Ask for these criteria; a callback."""
    st.session_state.update(criteria=_rows_of(criteria), confidence=criteria.confidence, **_costs_of(criteria))


def _rows_of(criteria: Criteria) -> list[str]:
    return [_text({**asdict(own), "unit": own.unit}) for own in criteria.items]  # stated: a small limit is meant


def _costs_of(criteria: Criteria) -> dict[str, float | None]:
    return {key: getattr(criteria.costs, name, None) for key, name in zip(_COSTS, COSTS, strict=True)}


def _text(row: dict[str, Any]) -> str:
    values = ("" if row.get(name) is None else row[name] for name in _FIELDS)
    return SEPARATOR.join(value if isinstance(value, str) else f"{value:.12g}" for value in values)


def _row(text: str) -> dict[str, Any]:
    metric, *numbers, name, unit = parts_of(text, len(_FIELDS))
    given = zip(_FIELDS, [metric, *map(_number, numbers), name, unit], strict=True)
    return {key: value for key, value in given if value != ""}


def _number(text: str) -> float | str:
    with suppress(ValueError):
        return float(text)
    return text  # which is said to be none


def _take_file(content: bytes | None) -> None:
    if content is not None:
        take(uploaded(content, _FILE, read_criteria))
