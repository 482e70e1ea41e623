"""The conditions to judge: the campaign's matrix, an uploaded one, or a grid."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.campaign import Campaign
from crashfuse.certification import file_store
from crashfuse.certification.matrix import Matrix
from crashfuse.errors import CrashfuseError, UsageError
from crashfuse.files.csv_text import without_formulas
from crashfuse.reporting.certification_tables import csv_as_given, matrix_table
from crashfuse.reporting.plots.display import Display
from crashfuse.ui.certify.uploaded import choose_kept, show_wrong, uploaded
from crashfuse.ui.kit import address, campaigns
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.figures import choose
from crashfuse.ui.kit.text import plain
from crashfuse.wording import IN_SI, speed

JUDGED = "judged"
"""Session key: whether the conditions that are chosen have verdicts."""
_FILE = "matrix.csv"
_OWN, _UPLOAD, _GRID = "The campaign's", "Upload", "Grid"
_STEPS = {"mph": 5, "km/h": 10}  # between speeds of a grid
_MOST_VALUES = 1000  # of a range
_NUMBER = re.compile(r"\d+\.?\d*|\.\d+")
_HELP = "Numbers separated by commas, or first:last:step, such as 20:35:5."


def choose_matrix(view: View) -> Matrix | None:
    """Ask for the conditions; None while there are none or some are wrong, which is said here."""
    own = view.folder / _FILE
    sources = [_OWN] * own.is_file() + [_UPLOAD, _GRID]
    left, right = st.columns([3, 4], vertical_alignment="bottom")
    with left:
        st.caption("Conditions from")
        source = choose("Conditions from", sources, key="matrix", default=_OWN if own.is_file() else _GRID)
    matrix: Matrix | None
    try:
        with right:
            if source == _OWN:
                matrix = _read(own, campaigns.stamp(own), view.campaign.fingerprint, view.campaign)
            else:
                matrix = _uploaded(view.campaign) if source == _UPLOAD else _grid(view.campaign, view.display)
    except CrashfuseError as error:
        show_wrong(error)
        return None
    if matrix is None:
        return None
    speeds = [condition.speed_mps for condition in matrix.conditions]
    n = f"{len(speeds):,} conditions" if len(speeds) > 1 else "1 condition"
    ends = view.display.words(speed(min(speeds), max(speeds), between=" to "))
    with st.expander(f"{n}, {ends}", icon=":material/table:"):
        rows = [{"Condition": i, **view.display.columns(c), **dict(c.factors)} for i, c in matrix.items]
        st.dataframe(without_formulas(pd.DataFrame(rows)), hide_index=True, alt="The conditions to judge")
    return matrix


def take(matrix: Matrix) -> None:
    """Ask for these conditions, as if they were uploaded; call it from a callback. A DataError if they are too many."""
    st.session_state.update(matrix=_UPLOAD, uploaded=file_store.keep(csv_as_given(matrix_table(matrix)), _FILE))


@st.cache_resource(max_entries=8, show_spinner=False)
def _read(path: Path, stamp: tuple[int, ...], fingerprint: str, _campaign: Campaign) -> Matrix:  # noqa: ARG001 - the key
    return Matrix.read(path, _campaign.factors)


def _uploaded(campaign: Campaign) -> Matrix | None:
    columns = ", ".join(["id", "speed_mph", "front_weight_lb", "rear_weight_lb", *map(plain, campaign.factors)])
    label, key = f"Upload {_FILE}, with the columns {columns}", f"matrix file {campaign.fingerprint[:8]}"
    return choose_kept(label, _FILE, "uploaded", key, lambda content: _checked(content, campaign.fingerprint, campaign))


@st.cache_resource(max_entries=8, show_spinner=False)
def _checked(content: bytes, fingerprint: str, _campaign: Campaign) -> Matrix:  # noqa: ARG001 - the key
    return uploaded(content, _FILE, lambda path: Matrix.read(path, _campaign.factors))


def _grid(campaign: Campaign, display: Display) -> Matrix:
    """A grid as typed in, at first over the tests' speeds at their middle weights, in round numbers."""
    units = display.units
    tests, step = display.vectors(np.array([test.condition.vector for test in campaign.tests])), _STEPS[units.speed]
    low, high = np.ceil(tests[:, 0].min() / step) * step, np.floor(tests[:, 0].max() / step) * step
    speeds = f"{low:.0f}:{high:.0f}:{step}" if low < high else f"{np.median(tests[:, 0]):.1f}"
    weights = [f"{weight:.0f}" for weight in np.median(tests[:, 1:], axis=0)]
    typed = {}
    axes = (
        ("Speeds", "speeds", speeds),
        *zip(("Front weights", "Rear weights"), ("front_weights", "rear_weights"), weights, strict=True),
    )
    for column, (label, key, usual) in zip(st.columns(3), axes, strict=True):
        unit = units.speed if key == "speeds" else units.weight
        address.default(key, f"{usual} {unit}", follow=not st.session_state.get(JUDGED))  # else verdicts would go
        typed[f"{label} ({unit})"] = _axis(column, label, key, unit)
    factors = {}
    columns = st.columns(max(len(campaign.factors), 3)) if campaign.factors else []
    for column, (name, known) in zip(columns, campaign.factors.items(), strict=False):
        key = f"grid_{name}"
        address.default(key, [])
        address.put(key, [value for value in st.session_state[key] if value in known])
        chosen = column.multiselect(
            plain(name.capitalize()), known, key=key, placeholder="not given", persist_state="session",
            help="Tests may differ by it; if it is not given, intervals cover every value.",
        )  # fmt: skip
        if chosen:
            factors[name] = chosen
    first, second, third = (
        [number * IN_SI[unit] for number in _numbers(text, label)] for label, (text, unit) in typed.items()
    )
    v0, front, rear = (unit.replace("km/h", "kph") for _, unit in typed.values())
    return Matrix.grid(first, second, third, factors, (v0, front, rear))


def _axis(column: DeltaGenerator, label: str, key: str, unit: str) -> tuple[str, str]:
    """What is typed for one axis, shown in the reader's unit; it is kept with the unit that it was typed in."""
    state, field = st.session_state, f"{key} in {unit}"
    typed, _, given = state[key].strip().rpartition(" ")
    if given not in IN_SI:  # of a link that was typed
        typed, given = state[key], unit
        state[key] = f"{typed} {unit}"
    factor = IN_SI[given] / IN_SI[unit]
    converted = _NUMBER.sub(lambda found: f"{float(found[0]) * factor:.6g}", typed)
    address.put(field, typed if given == unit else converted)
    column.text_input(
        f"{label} ({unit})", key=field, help=_HELP, on_change=lambda: state.update({key: f"{state[field]} {unit}"})
    )
    return typed, given


def _numbers(text: str, label: str) -> list[float]:
    """Numbers that were typed in: a list, ranges in it included."""
    found: list[float] = []
    try:
        for part in re.findall(r"[^,;\s]+", text):
            first, *others = map(float, part.split(":"))
            last, step = others or (first, 1.0)
            if not step > 0 or not 0 <= (last - first) / step <= _MOST_VALUES:
                raise ValueError("no range")
            found += [round(first + i * step, 9) for i in range(int((last - first) / step + 1e-9) + 1)]
    except ValueError:  # not a number, or one too few or too many of them
        found = []
    if not 0 < len(found) <= _MOST_VALUES:
        raise UsageError(f"{label}: expected numbers such as 20, 25, 30, or 20:35:5; found {text!r}.")
    return found
