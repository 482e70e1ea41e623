"""The acceptance criteria: those of the campaign, an uploaded file's, or typed into a table."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

import pandas as pd
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.certification.criteria import CONFIDENCE, RATING, Criteria, criteria_of, read_criteria
from crashfuse.errors import DataError
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_UNITS, metric_headings
from crashfuse.signals.rating import STANDARD
from crashfuse.ui.certify.uploaded import show_wrong, under_its_name, uploaded
from crashfuse.ui.kit import address
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.text import plain

_FILE, _EDITOR = "criteria.toml", "editor of criteria"
_LIMIT_HELP = "In the unit beside the metric; shown to four digits."
_COLUMNS = {"name": "str", "metric": "str", "window_ms": "float", "at_least": "float", "at_most": "float"}
_METRICS = {**metric_headings(), RATING: f"{STANDARD} rating against a test there"}
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
class _Editor:
    """The table as the browser's editor began with it, and what it said last; another one begins anew."""

    begun: pd.DataFrame
    said: list[str] | None = None
    round: int = 0


def choose_criteria(view: View, beside: DeltaGenerator, help_in: DeltaGenerator) -> Criteria | None:
    """Ask for criteria and confidence; None while there are none or some cannot be judged, which is said here."""
    state, display, wrong = st.session_state, view.display, _take_declared(view)
    labels = {name: display.heading(label) for name, label in _METRICS.items()}
    editor: _Editor = state.setdefault(_EDITOR, _Editor(_rows(())))
    if state["criteria"] != editor.said:
        editor.round += 1
    key = f"criteria {editor.round} {display.units}"
    if key not in state:  # another round, or back from another page, which forgets the editor's changes, or other units
        editor.begun = _converted(_rows(state["criteria"]), display.units.factor)
    edited = st.data_editor(
        editor.begun,
        key=key,
        num_rows="dynamic",
        hide_index=True,
        placeholder="",
        column_config={
            "name": st.column_config.TextColumn("Name", help="Any; or else the metric's own.", max_chars=100),
            "metric": st.column_config.SelectboxColumn(
                "Metric",
                options=list(_METRICS),
                format_func=lambda name: labels[str(name)],
                width=280,  # its longest name; with more, a limit is cut off at 900 px
                required=True,
            ),
            "window_ms": st.column_config.NumberColumn("Window (ms)", help="Of a rating alone; 60 if it is empty."),
            "at_least": st.column_config.NumberColumn("At least", help=_LIMIT_HELP, format="%.4g"),
            "at_most": st.column_config.NumberColumn("At most", help=_LIMIT_HELP, format="%.4g"),
        },
        alt="Acceptance criteria: name, metric, window, and limits",
    )
    rows = _converted(edited, lambda unit: 1 / display.units.factor(unit))
    state["criteria"] = editor.said = _texts(rows)
    address.publish()
    confidence = beside.number_input(
        "Confidence", step=0.01, format="%.6g", key="confidence", persist_state="session",
        help="A criterion counts as met from this probability, as not met from its complement, and is open between.",
    )  # fmt: skip
    with help_in.popover("How criteria are declared, or brought as a file", icon=":material/help:"):
        st.markdown(
            f"One row a criterion, with limits in the unit beside its metric. `{_FILE}`, in the campaign folder or "
            "uploaded here, has the names and units of `metrics.csv`: "
            f"{', '.join(f'`{name}` ({METRIC_UNITS[name]})' for name in MAIN_METRICS)} and others."
        )
        _show_upload(view)
        st.code(_EXAMPLE, language="toml")
    declared = _declared(_rows(state["criteria"]))
    if not declared:
        if wrong is not None:
            show_wrong(wrong)
        st.info("No criteria yet: add a row above, with a metric and its limit.", icon=":material/edit:")
        return None
    try:
        criteria = criteria_of(declared, confidence)
    except DataError as error:
        show_wrong(error)
        return None
    other_units = [own for own in criteria.items if view.display.units.unit(own.unit) != own.unit]
    if other_units:
        limits = "; ".join(f"{own.name} {own.limits}" for own in other_units)
        st.caption(f"In the units of files: {plain(limits)}.")
    return criteria


def take(criteria: Criteria) -> None:
    """Ask for these criteria; call it from a callback."""
    st.session_state.update(criteria=_texts(_table(criteria)), confidence=criteria.confidence)


def _take_declared(view: View) -> DataError | None:
    """Make the criteria in the campaign's folder the default; returns what is wrong with them, if anything is."""
    path, declared, wrong = view.folder / _FILE, None, None
    try:
        declared = read_criteria(path) if path.is_file() else None
    except DataError as error:
        wrong = error
    address.default("criteria", _texts(_table(declared)))
    address.default("confidence", declared.confidence if declared else CONFIDENCE)
    return wrong


def _table(criteria: Criteria | None) -> pd.DataFrame:
    return pd.DataFrame([asdict(own) for own in criteria.items] if criteria else [], columns=list(_COLUMNS))


def _texts(rows: pd.DataFrame) -> list[str]:
    """The criteria of a table as they stand in the session and the address: metric, window, limits, name."""
    known = rows[rows["metric"].notna()].astype(object)
    return [
        "~".join([metric, *("" if pd.isna(number) else f"{number:.12g}" for number in numbers), str(name)])
        for name, metric, *numbers in known.fillna({"name": ""}).itertuples(index=False)
    ]


def _rows(texts: Sequence[str]) -> pd.DataFrame:
    """The table of criteria that these texts stand for; what is no criterion, of a link that was cut, is left out."""
    rows = []
    for metric, *numbers, name in (text.split("~", 4) for text in texts if text.count("~") >= 4):
        with suppress(ValueError):
            if metric in _METRICS:
                rows.append([name, metric, *(float(number or "nan") for number in numbers)])
    return pd.DataFrame(rows, columns=list(_COLUMNS)).astype(_COLUMNS)


def _converted(rows: pd.DataFrame, factor: Callable[[str], float]) -> pd.DataFrame:
    """The same table with its limits times a factor for the unit of their metric."""
    factors = rows["metric"].map(lambda name: factor(METRIC_UNITS.get(name, "")))
    limits = rows[["at_least", "at_most"]].mul(factors.astype(float), axis=0)
    return rows.assign(**limits)


def _declared(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows in which anything was entered, as mappings of what was."""
    entered = [
        {str(name): value for name, value in row.items() if not pd.isna(value) and value != ""}
        for row in rows.to_dict("records")
    ]
    return [row for row in entered if row]


def _show_upload(view: View) -> None:
    key = f"criteria file {view.campaign.fingerprint[:8]}"
    wrong = f"{key}: wrong"

    def take_file() -> None:
        st.session_state.pop(wrong, None)
        if (file := st.session_state[key]) is None:
            return
        try:
            criteria = uploaded(file.getvalue(), _FILE, read_criteria)
        except DataError as error:
            st.session_state[wrong] = under_its_name(error, _FILE, file.name)
            return
        take(criteria)

    st.file_uploader(f"Upload {_FILE}", type="toml", key=key, on_change=take_file)
    if wrong in st.session_state:
        show_wrong(st.session_state[wrong])
