"""The acceptance criteria: those of the campaign, an uploaded file's, or typed into a table."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd
import streamlit as st

from crashfuse.certification.criteria import CONFIDENCE, RATING, Criteria
from crashfuse.certification.criteria_file import criteria_of, read_criteria
from crashfuse.errors import DataError
from crashfuse.signals.metrics import METRIC_UNITS, metric_headings
from crashfuse.signals.rating import STANDARD
from crashfuse.ui.certify.files import show_wrong, uploaded
from crashfuse.ui.frame import View

_FILE = "criteria.toml"
_COLUMNS = {"name": "str", "metric": "str", "window_ms": "float", "at_least": "float", "at_most": "float"}
_METRICS = {
    **metric_headings(),
    RATING: f"{STANDARD} rating against a test there",
}
_EXAMPLE = f"""confidence = {CONFIDENCE}

[[criterion]]
name = "crush"           # yours to choose
metric = "max_crush"
at_most = …              # your limit, in mm

[[criterion]]
name = "rating"          # of the prediction, 0 to 1
metric = "rating"
window_ms = 60
at_least = …"""


@dataclass
class _Draft:
    """The table as edited last, and as the editor began with it; another round begins the editor anew."""

    rows: pd.DataFrame
    begun: pd.DataFrame
    round: int = 0


def choose_criteria(view: View) -> Criteria | None:
    """Ask for criteria and confidence; None while there are none or some cannot be judged, which is said here."""
    draft = _draft(view)
    display = view.display
    labels = {name: display.heading(label) for name, label in _METRICS.items()}
    editor = f"criteria {view.campaign.fingerprint[:8]} {draft.round} {display.units}"
    # at first, or back from another page, which forgets the editor's changes, or in other units
    if editor not in st.session_state:
        draft.begun = _converted(draft.rows, display.units.factor)
    edited = st.data_editor(
        draft.begun,
        key=editor,
        num_rows="dynamic",
        hide_index=True,
        placeholder="",
        column_config={
            "name": st.column_config.TextColumn(
                "Name", help="Any; the metric's own if it is left empty.", max_chars=100
            ),
            "metric": st.column_config.SelectboxColumn(
                "Metric",
                options=list(_METRICS),
                format_func=lambda name: labels[str(name)],
                width="large",
                required=True,
            ),
            "window_ms": st.column_config.NumberColumn(
                "Window (ms)", help="Of a rating, from first contact; 60 if it is left empty. Not of other metrics."
            ),
            "at_least": st.column_config.NumberColumn("At least", help="In the metric's unit."),
            "at_most": st.column_config.NumberColumn("At most", help="In the metric's unit."),
        },
        alt="Acceptance criteria: name, metric, window, and limits",
    )
    draft.rows = _converted(edited, lambda unit: 1 / display.units.factor(unit)).map(_rounded)
    left, right = st.columns([1, 2], gap="large")
    confidence = left.number_input(
        "Confidence", min_value=0.5, max_value=0.999, step=0.01, format="%.3f", key="confidence",
        persist_state="session",
        help="A criterion counts as met from this probability, as not met from its complement, and is open between.",
    )  # fmt: skip
    with right.expander("How criteria are declared, or brought as a file", icon=":material/help:"):
        st.markdown(
            "One row a criterion: a metric with its limit, `at least`, `at most`, or both, in the unit beside the "
            f"metric. In a file, `{_FILE}` in the campaign folder or uploaded here, with limits in place of the dots, "
            "always in the units of `metrics.csv`:"
        )
        st.code(_EXAMPLE, language="toml")
        _show_upload(view, draft)
    rows = _declared(draft.rows)
    if not rows:
        st.info("No criteria yet: add a row above, with a metric and your limit for it.", icon=":material/edit:")
        return None
    try:
        return criteria_of(rows, confidence)
    except DataError as error:
        show_wrong(error)
        return None


def _draft(view: View) -> _Draft:
    """The session's table of this campaign, at first that of its folder; problems of the file are said."""
    key, current = f"draft {view.campaign.fingerprint[:8]}", "campaign of the criteria"
    declared = None
    if key not in st.session_state or st.session_state.get(current) != key:
        path = view.folder / _FILE
        try:
            declared = read_criteria(path) if path.is_file() else None
        except DataError as error:
            show_wrong(error)
    if key not in st.session_state:
        rows = _rows(declared)
        st.session_state[key] = _Draft(rows, rows)
    if (before := st.session_state.get(current)) != key:
        if before is not None or st.session_state["confidence"] is None:  # else a link gives it
            st.session_state["confidence"] = declared.confidence if declared else CONFIDENCE
        st.session_state[current] = key
    draft: _Draft = st.session_state[key]
    return draft


def _rows(criteria: Criteria | None) -> pd.DataFrame:
    rows = [[getattr(own, name) for name in _COLUMNS] for own in criteria.items] if criteria else []
    return pd.DataFrame(rows, columns=list(_COLUMNS)).astype(_COLUMNS)


def _converted(rows: pd.DataFrame, factor: Callable[[str], float]) -> pd.DataFrame:
    """The same table with its limits times a factor for the unit of their metric."""
    factors = rows["metric"].map(lambda name: factor(METRIC_UNITS.get(name, "")))
    limits = rows[["at_least", "at_most"]].mul(factors.astype(float), axis=0)
    return rows.assign(**limits)


def _rounded(cell: object) -> object:
    """A number to twelve digits, so that a limit of 60 that was shown in other units comes back as 60."""
    return float(f"{cell:.12g}") if isinstance(cell, float) else cell


def _declared(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows in which anything was entered, as mappings of what was."""
    entered = [_entered(row) for row in rows.to_dict("records")]
    return [row for row in entered if row]


def _entered(row: Mapping[Hashable, Any]) -> dict[str, Any]:
    return {str(name): value for name, value in row.items() if not pd.isna(value) and value != ""}


def _show_upload(view: View, draft: _Draft) -> None:
    key = f"criteria file {view.campaign.fingerprint[:8]}"
    wrong = f"{key}: wrong"

    def take() -> None:
        st.session_state.pop(wrong, None)
        if (file := st.session_state[key]) is None:
            return
        try:
            criteria = uploaded(file, _FILE, read_criteria)
        except DataError as error:
            st.session_state[wrong] = error
            return
        draft.rows, draft.round = _rows(criteria), draft.round + 1
        st.session_state["confidence"] = criteria.confidence

    st.file_uploader(f"Upload {_FILE}", type="toml", key=key, on_change=take)
    if wrong in st.session_state:
        show_wrong(st.session_state[wrong])
