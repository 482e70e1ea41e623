"""The planned tests: of the campaign, of a file, or typed in; saved into the campaign with the criteria."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.history import changing, taking_turns
from crashfuse.certification import file_store
from crashfuse.certification.criteria import Criteria, criteria_text, read_criteria
from crashfuse.certification.matrix import Matrix
from crashfuse.errors import CrashfuseError, DataError, Problem
from crashfuse.files.csv_text import without_formulas
from crashfuse.results.certification_tables import csv_as_given, matrix_table
from crashfuse.results.table import CONDITION, Table, of_condition
from crashfuse.signals.pulse import FloatArray
from crashfuse.ui.certify import entry
from crashfuse.ui.certify.entry import SEPARATOR, Field, choose_kept, edit_table, find_kept, parts_of, show_wrong
from crashfuse.ui.kit import address, campaigns
from crashfuse.ui.kit.campaigns import HASHED, View
from crashfuse.ui.kit.editing import can_be_edited, edit, show_refused
from crashfuse.ui.kit.figures import choose
from crashfuse.ui.kit.text import plain
from crashfuse.units import IN_SI, SYSTEMS, UnitSystem, counted, speed

_CHOICES = "criteria", "confidence", "cost_test", "cost_wrong", "matrix", "planned", "uploaded"  # session keys
JUDGED = "judged"  # session key: what is chosen, in a line, if it has verdicts
_FILE = "matrix.csv"
_OWN, _UPLOAD, _TYPED = "The campaign’s", "Upload", "Typed in"
_STEPS = {"mph": 5, "km/h": 10}  # between speeds to start with
_NUMBERS = ("Speed", "Front weight", "Rear weight")
_SYSTEM = 4  # place in a row of the name of its units, in which numbers are kept; after it, the factors


def matrix_asked(view: View) -> Matrix | None:
    """The planned tests that are chosen, at first the campaign's, if any. Raises as :class:`Matrix`."""
    state, own = st.session_state, view.folder / _FILE
    address.default("matrix", _OWN if own.is_file() else _TYPED, _sources(view))
    address.default("planned", _usual(view), follow=not state.get(JUDGED))  # verdicts would go
    if state["matrix"] == _OWN:
        return read_own(own, campaigns.stamp(own), view.campaign)
    if state["matrix"] == _UPLOAD:
        return find_kept(_FILE, "uploaded", partial(_checked, campaign=view.campaign))
    return _typed(tuple(state["planned"]), view.campaign) if state["planned"] else None


def choose_matrix(view: View) -> Matrix | None:
    """Ask for the planned tests; None while there are none or some are wrong."""
    matrix, wrong = None, None
    try:
        matrix = matrix_asked(view)
    except CrashfuseError as error:
        wrong = error
    with st.container(horizontal=True, vertical_alignment="center"):
        st.markdown("Planned tests from", width="content")
        source = choose("Planned tests from", _sources(view), key="matrix")
    if source == _UPLOAD:
        campaign = view.campaign
        columns = ", ".join(["id", "speed_mph", "front_weight_lb", "rear_weight_lb", *map(plain, campaign.factors)])
        label, key = f"Upload {_FILE}, with the columns {columns}", f"matrix file {campaign.fingerprint[:8]}"
        choose_kept(label, _FILE, "uploaded", key, partial(_checked, campaign=campaign))
    if source == _TYPED:
        _edit(view)
    elif matrix is not None:
        n = counted(len(matrix.ids), "planned test")
        speeds = [condition.speed_mps for condition in matrix.conditions]
        ends = view.display.words(speed(min(speeds), max(speeds), between=" to "))
        with st.expander(f"{n}, {ends}", icon=":material/table:"):
            rows = ({"Id": i, **of_condition(condition)} for i, condition in matrix.items)
            table = Table.of("planned tests", rows, *CONDITION).texts(view.display)
            st.dataframe(without_formulas(table), hide_index=True, alt="The planned tests")
    if wrong is not None:
        show_wrong(wrong)
    return matrix


def _sources(view: View) -> list[str]:
    return [_OWN] * (view.folder / _FILE).is_file() + [_TYPED, _UPLOAD]


def take(matrix: Matrix) -> None:
    """Ask for these conditions, as if uploaded; a callback. A DataError if they are too many."""
    st.session_state.update(matrix=_UPLOAD, uploaded=file_store.keep(csv_as_given(matrix_table(matrix)), _FILE))


@st.cache_resource(max_entries=8, show_spinner=False, hash_funcs=HASHED)
def read_own(path: Path, stamp: tuple[int, ...], campaign: Campaign) -> Matrix:  # noqa: ARG001 - part of the key
    """The planned tests of a campaign's folder."""
    return Matrix.read(path, campaign.factors)


@st.cache_resource(max_entries=8, show_spinner=False, hash_funcs=HASHED)
def _checked(content: bytes, campaign: Campaign) -> Matrix:
    return entry.uploaded(content, _FILE, lambda path: Matrix.read(path, campaign.factors))


@st.cache_resource(max_entries=32, show_spinner=False, hash_funcs=HASHED)
def _typed(texts: tuple[str, ...], campaign: Campaign) -> Matrix:
    entry.require_few(texts, "Planned tests")
    rows = [_parts(text, campaign) for text in texts]
    system = SYSTEMS[rows[0][_SYSTEM]]
    if mixed := [row[0] for row in rows if row[_SYSTEM] != rows[0][_SYSTEM]]:  # of a link, a page writes none
        raise DataError(Problem("Planned tests", "one system of units", f"another in {mixed[0]}", "remove that row"))
    quantities = zip(("speed", "front_weight", "rear_weight"), system.endings, strict=True)
    names = ["id", *(f"{name}_{unit}" for name, unit in quantities), *campaign.factors]
    table = pd.DataFrame([row[:_SYSTEM] + row[_SYSTEM + 1 :] for row in rows], columns=names)
    try:
        return Matrix.of(table, campaign.factors)
    except DataError as error:  # with rows as a reader counts them
        counted_anew = [(own, None if own.row is None else own.row + 1) for own in error.problems]
        raise DataError([replace(own, where="Planned tests", row=row) for own, row in counted_anew]) from error


def _parts(text: str, campaign: Campaign) -> list[str]:
    parts = parts_of(text, _SYSTEM + 1 + len(campaign.factors))
    return parts if parts[_SYSTEM] in SYSTEMS else [*parts[:_SYSTEM], "mph-lb", *parts[_SYSTEM + 1 :]]


def _text(i: str, vector: FloatArray, system: UnitSystem, factors: Sequence[str]) -> str:
    numbers = [f"{value / IN_SI[unit]:.12g}" for value, unit in zip(vector, _units(system), strict=True)]
    name = next(name for name, own in SYSTEMS.items() if own == system)
    return SEPARATOR.join([i.replace(SEPARATOR, "-"), *numbers, name, *factors])


def _units(system: UnitSystem) -> tuple[str, str, str]:
    return system.speed, system.weight, system.weight


def _usual(view: View) -> list[str]:
    campaign, system, own = view.campaign, view.display.system, view.folder / _FILE
    with suppress(CrashfuseError):
        if own.is_file():
            items = read_own(own, campaigns.stamp(own), campaign).items
            kept = next((known for known in SYSTEMS.values() if known.endings == items[0][1].units), system)
            given = [(i, at.vector, [dict(at.factors).get(name, "") for name in campaign.factors]) for i, at in items]
            return [_text(i, vector, kept, factors) for i, vector, factors in given]
    step, factors = _STEPS[system.speed], [IN_SI[unit] for unit in _units(system)]
    tests = np.array([test.condition.vector for test in campaign.tests]) / factors
    low, high = np.ceil(tests[:, 0].min() / step) * step, np.floor(tests[:, 0].max() / step) * step
    speeds = np.arange(low, high + step / 2, step) if low <= high else [round(float(np.median(tests[:, 0])), 1)]
    front, rear = np.median(tests[:, 1:], axis=0).round()
    return [
        _text(f"P{number:02d}", np.array([v, front, rear]) * factors, system, [""] * len(campaign.factors))
        for number, v in enumerate(speeds, start=1)
    ]


def _edit(view: View) -> None:
    campaign, state = view.campaign, st.session_state
    rows = [_parts(text, campaign) for text in state["planned"]]
    address.put("planned", [SEPARATOR.join(row) for row in rows])
    fields = {0: Field("Id")}
    for place, unit in enumerate(_units(view.display.system)):

        def factor(row: list[str], place: int = place, unit: str = unit) -> float:
            return IN_SI[_units(SYSTEMS[row[_SYSTEM]])[place]] / IN_SI[unit]

        fields[place + 1] = Field(f"{_NUMBERS[place]} ({unit})", factor=factor)
    for place, (name, known) in enumerate(campaign.factors.items(), start=_SYSTEM + 1):
        fields[place] = Field(name.capitalize(), options={text: text for text in known})
    system = rows[0][_SYSTEM] if rows else state["system"]
    edit_table("planned", fields, _parts(SEPARATOR * _SYSTEM + system, campaign), view.display.units)


def question_files(criteria: Criteria | None, matrix: Matrix | None) -> dict[str, bytes]:
    """What is asked, as files of a campaign folder."""
    files = {} if criteria is None else {"criteria.toml": criteria_text(criteria).encode()}
    return files if matrix is None else {**files, "matrix.csv": csv_as_given(matrix_table(matrix))}


def offer_saving(view: View, criteria: Criteria | None, matrix: Matrix | None) -> None:
    """Offer to save what the folder does not have."""
    folder, known = view.folder, dict[str, bytes]()
    with suppress(DataError):
        known |= question_files(read_criteria(folder / "criteria.toml"), None)
    with suppress(DataError, OSError):
        path = folder / "matrix.csv"
        known |= question_files(None, read_own(path, campaigns.stamp(path), view.campaign))
    files = {name: own for name, own in question_files(criteria, matrix).items() if known.get(name) != own}

    def save() -> str:
        what = _save(folder, files)
        st.session_state.update(dict.fromkeys(_CHOICES))  # now those of the folder
        return what

    with st.container(horizontal=True):
        if can_be_edited(folder):
            tip = "Into criteria.toml and matrix.csv of the campaign; Undo on Data takes it back."
            st.button("Save in the campaign", on_click=edit, args=(view, save), disabled=not files, help=tip)
        else:
            for name, content in files.items():
                st.download_button(name, content, file_name=name, icon=":material/download:", on_click="ignore")
    show_refused()


def _save(folder: Path, files: dict[str, bytes]) -> str:
    what = f"Saved: {' and '.join(files)}"
    with taking_turns(folder), changing(folder, what) as new:
        for name, content in files.items():
            new(folder / name).write_bytes(content)
    return what
