"""The conditions to judge: the campaign's matrix, an uploaded one, or a grid."""

import numpy as np
import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.certification.matrix import Matrix
from crashfuse.errors import CrashfuseError, UsageError
from crashfuse.files.csv_output import without_formulas
from crashfuse.reporting.certification_tables import matrix_table
from crashfuse.ui import address
from crashfuse.ui.certify.files import show_wrong, uploaded
from crashfuse.ui.figures import choose
from crashfuse.ui.frame import View
from crashfuse.ui.text import plain
from crashfuse.units import LB, MPH

_FILE = "matrix.csv"
_OWN, _UPLOAD, _GRID = "The campaign's", "Upload", "Grid"
_MOST_VALUES = 1000  # of a range
_HELP = "Numbers separated by commas, or first:last:step, such as 20:35:5."


def choose_matrix(view: View) -> Matrix | None:
    """Ask for the conditions; None while there are none or some are wrong, which is said here."""
    own = view.folder / _FILE
    sources = [_OWN, _UPLOAD, _GRID] if own.is_file() else [_UPLOAD, _GRID]
    source = choose("Conditions from", sources, key="matrix", default=_OWN if own.is_file() else _GRID)
    try:
        matrix = _chosen(source, view)
    except CrashfuseError as error:
        show_wrong(error)
        return None
    if matrix is None:
        return None
    speeds = [condition.speed_mps / MPH for condition in matrix.conditions]
    n = f"{len(speeds):,} conditions" if len(speeds) > 1 else "1 condition"
    with st.expander(f"{n}, {min(speeds):.1f} to {max(speeds):.1f} mph", icon=":material/table:"):
        st.dataframe(without_formulas(matrix_table(matrix)).round(2), hide_index=True, alt="The conditions to judge")
    return matrix


def _chosen(source: str, view: View) -> Matrix | None:
    if source == _OWN:
        return Matrix.read(view.folder / _FILE, view.campaign.factors)
    return _uploaded(view.campaign) if source == _UPLOAD else _grid(view.campaign)


def _uploaded(campaign: Campaign) -> Matrix | None:
    key = f"matrix file {campaign.fingerprint[:8]}"
    kept = f"{key}: read"

    def take() -> None:
        if (file := st.session_state[key]) is None:
            return
        try:
            st.session_state[kept] = uploaded(file, _FILE, lambda path: Matrix.read(path, campaign.factors))
        except CrashfuseError as error:
            st.session_state[kept] = error

    columns = ", ".join(["id", "speed_mph", "front_weight_lb", "rear_weight_lb", *map(plain, campaign.factors)])
    st.file_uploader(f"Upload {_FILE}, with the columns {columns}", type="csv", key=key, on_change=take)
    found: Matrix | CrashfuseError | None = st.session_state.get(kept)
    if isinstance(found, CrashfuseError):
        raise found
    return found


def _grid(campaign: Campaign) -> Matrix:
    """A grid as typed in, at first over the tests' speeds at their middle weights."""
    tests = np.array([test.condition.vector for test in campaign.tests]) / (MPH, LB, LB)
    low, high = np.ceil(tests[:, 0].min() / 5) * 5, np.floor(tests[:, 0].max() / 5) * 5
    speeds = f"{low:.0f}:{high:.0f}:5" if low < high else f"{np.median(tests[:, 0]):.1f}"
    weights = [f"{weight:.0f}" for weight in np.median(tests[:, 1:], axis=0)]
    axes = (
        ("Speeds (mph)", "speeds", MPH, speeds),
        ("Front weights (lb)", "front_weights", LB, weights[0]),
        ("Rear weights (lb)", "rear_weights", LB, weights[1]),
    )
    values = []
    for column, (label, key, unit, usual) in zip(st.columns(3), axes, strict=True):
        address.default(key, usual)
        text = column.text_input(label, key=key, help=_HELP, persist_state="session")
        values.append([value * unit for value in _numbers(text, label)])
    factors = {}
    for column, (name, known) in zip(st.columns(max(len(campaign.factors), 3)), campaign.factors.items(), strict=False):
        key = f"grid_{name}"
        st.session_state[key] = [value for value in st.session_state.get(key) or () if value in known]
        chosen = column.multiselect(
            name.capitalize(), known, key=key, placeholder="not given", persist_state="session",
            help="Tests may differ by it; if it is not given, intervals cover every value.",
        )  # fmt: skip
        if chosen:
            factors[name] = chosen
    return Matrix.grid(values[0], values[1], values[2], factors)


def _numbers(text: str, label: str) -> list[float]:
    """Numbers that were typed in: a list, ranges in it included."""
    found: list[float] = []
    try:
        for part in text.replace(",", " ").replace(";", " ").split():
            found += _range(*map(float, part.split(":")))
    except (ValueError, TypeError):  # not a number, or one too few or too many of them
        found = []
    if not 0 < len(found) <= _MOST_VALUES:
        raise UsageError(f"{label}: expected numbers such as 20, 25, 30, or 20:35:5; found {text!r}.")
    return found


def _range(first: float, last: float | None = None, step: float = 0.0) -> list[float]:
    """One number, or those from first to last."""
    if last is None:
        return [first]
    if not step > 0 or not 0 <= (last - first) / step <= _MOST_VALUES:
        raise ValueError("no range")
    return [round(first + i * step, 9) for i in range(int((last - first) / step + 1e-9) + 1)]
