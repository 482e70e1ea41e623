"""The step between foreign files and a campaign: what was recognised, the resulting records, and adding them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import streamlit as st

from crashfuse.campaign_folder.condition_tables import Role, listed
from crashfuse.campaign_folder.editing import WHAT
from crashfuse.errors import Problem
from crashfuse.importing import Choices, Settled
from crashfuse.importing.campaign_import import Label, parts_of, role_of
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.record import Record
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.previews import Preview
from crashfuse.signals.pulse import kinematics
from crashfuse.ui.chosen import View
from crashfuse.ui.figures import show_figure
from crashfuse.ui.importing.adding import counted_each, own_class, show_add_form
from crashfuse.ui.importing.condition import Units
from crashfuse.ui.importing.fields import choices_of, reading_of
from crashfuse.ui.importing.session import NEXT_ROLE, UNFINISHED, Source, leave, left_aside, records_of, settled_of
from crashfuse.ui.problems import advice_on_page, show_problems, without_options
from crashfuse.ui.text import plain
from crashfuse.units import MS
from crashfuse.wording import said

_MOST_ROWS = 100
_KEY = "import-step"
# fields and figure sit side by side only where both fit; Streamlit considers the window, not the space left
_STACKED = f"""<style>
.st-key-{_KEY} > [data-testid="stLayoutWrapper"] > [data-testid="stHorizontalBlock"] > [data-testid="stColumn"] {{
    min-width: min(100%, 23rem);
}}
</style>"""


def show_unfinished() -> None:
    """Say what a campaign started by an import still needs before it can be opened."""
    if UNFINISHED in st.session_state:
        sentence, problems = st.session_state[UNFINISHED]
        needs = "\n".join(f"- {plain(str(problem))}" for problem in problems)
        then = "Drop them on the field above: what is imported next goes to the same folder, unless you name another."
        st.info(f"{sentence} Before it can be opened:\n\n{needs}\n\n{then}", icon=":material/check:")


def show(source: Source, view: View | None) -> None:
    """Show the import step."""
    st.html(_STACKED)
    with st.container(key=_KEY):
        _show_step(source, view)


def _show_step(source: Source, view: View | None) -> None:
    st.title("Import files" if source.several else f"Import {plain(source.path.name)}")
    st.caption(f"Recognised: {FORMATS[source.fmt].label}. Nothing is added before you say so.")
    st.button("Back without importing", icon=":material/arrow_back:", on_click=leave)
    left, right = st.columns([2, 3], gap="large")
    with left:
        taken_as = st.container()  # what files look like is known once all are read
        reading = reading_of(source)
        records, unread = records_of(source, reading)
        with taken_as:
            role, cae = _roles(source, records)
            if aside := left_aside(source):
                st.caption(
                    f"Left aside, as {'they are no tables' if len(aside) > 1 else 'it is no table'}: "
                    f"{plain(listed(aside))}."
                )
    with right:
        first = _looked_at(source, records)
    if first is None:
        show_problems(unread, "Nothing of it can be read", "Correct the fields or the files.")
        return
    with left:
        for_all = f", for all {len(records)} records" if len(records) > 1 else ""
        st.caption(f"In grey: what was found. What is filled in overrules it{for_all}.")
        if len(records) > 1 and any(
            None in (one.condition.speed_mps, *one.condition.weights.axles()) for one in records
        ):
            st.caption("A table of conditions, dropped along with the files, gives each record its own: one row an id.")
        choices, units = choices_of(source, records, first, role_of(first, role, cae), own_class())
    settled, refused = settled_of(source, reading, choices, role, cae)
    problems = [_in_units(problem, units) for problem in refused]
    with right:
        display = DEFAULT if view is None else view.display
        _preview(first, choices, next((one for one in settled if one.id == first.id), None), display, units)
        if len(records) > 1 and settled:
            _table(settled, display, units)
        if problems and not settled and (len(records) == 1 or {problem.found for problem in problems} == {"none"}):
            several = len({problem.where for problem in problems}) > 1
            needs = dict.fromkeys(_need(problem, with_file=several) for problem in problems)
            st.warning("Before it can be added:\n\n" + "\n".join(f"- {need}" for need in needs), icon=":material/edit:")
        elif problems:
            can = f"{counted_each(settled)} can be added without." if settled else ""
            show_problems(problems, "Not everything can be added" if settled else "It cannot be added yet", can)
    notice = "" if view is None else view.campaign.notice
    show_add_form(source, reading, choices, role, cae, settled, notice)


def _roles(source: Source, records: Sequence[Record]) -> tuple[Role, tuple[str, ...]]:
    """Ask what the records are, and which files with tests are CAE runs; what looks like it is filled in, and said."""
    parts = parts_of(map(Label.of, records))
    found = [name for name, is_cae in parts.items() if is_cae]
    usual: Role = "cae" if parts and len(found) == len(parts) else FORMATS[source.fmt].role
    role: Role = st.segmented_control(
        "Take it as",
        list(WHAT),
        default=st.session_state.get(NEXT_ROLE) or usual,
        required=True,
        format_func={"tests": "Tests", "cae": "CAE runs"}.__getitem__,
        key=f"{source.key} role",
        persist_state="session",
    )
    chosen: list[str] = []
    if role == "tests" and len(parts) > 1:
        chosen = st.multiselect(
            "Of these, CAE runs are", list(parts), default=found if len(found) < len(parts) else [],
            placeholder="none", key=f"{source.key} cae", persist_state="session",
        )  # fmt: skip
    if found and (role == "tests" or len(found) == len(parts)):
        by, look = ("their names or numbers", "look") if len(found) > 1 else ("its name or number", "looks")
        by = (
            "what the files say of themselves" if any(record.is_simulated for record in records) else f"{by} of records"
        )
        st.caption(f"By {by} {plain(listed(found))} {look} like CAE runs; change it if that is wrong.")
    return role, tuple(chosen)


def _looked_at(source: Source, records: Sequence[Record]) -> Record | None:
    if len(records) < 2:
        return records[0] if records else None
    number = st.selectbox(
        f"{len(records)} records; this is",
        range(len(records)),
        format_func=lambda number: f"{number + 1}: {records[number].id}",
        key=f"{source.key} record {len(records)}",
        persist_state="session",
    )
    return records[number]


def _preview(record: Record, choices: Choices, settled: Settled | None, display: Display, units: Units) -> None:
    show_figure(
        Preview(record, choices, settled).plot(display=display),
        alt=f"The pulse that comes of {record.id}, over its channels as recorded",
    )
    if settled is not None:
        st.markdown(f"**{plain(settled.id)}**: {units.told(settled.condition)}")
        st.markdown("\n".join(f"- {plain(without_options(said(step, units.system)))}" for step in settled.steps))


def _table(settled: Sequence[Settled], display: Display, units: Units) -> None:
    """Table of the results for many records."""
    rows, both = [], len({one.role for one in settled}) > 1
    for one in settled[:_MOST_ROWS]:
        motion = kinematics(one.pulse.accel_mps2, one.condition.speed_mps, one.pulse.dt_s)
        stop_s = float(motion.t0_s)
        rows.append(
            {
                "Id": one.id,
                **({"Taken as": WHAT[one.role][0]} if both else {}),
                f"Speed ({units.speed})": round(one.condition.speed_mps / units.speed_mps, 1),
                f"Front ({units.weight})": round(one.condition.front_weight_kg / units.weight_kg),
                f"Rear ({units.weight})": round(one.condition.rear_weight_kg / units.weight_kg),
                f"Peak ({display.unit})": round(float(abs(one.pulse.accel_mps2 * display.accel_scale).max()), 1),
                "Zero velocity, TTZV (ms)": f"{stop_s / MS:.1f}" if np.isfinite(stop_s) else "not in the record",
                "Crush (mm)": round(float(motion.displacement_m.max()) / MS),
            }
        )
    st.dataframe(pd.DataFrame(rows), hide_index=True)
    if len(settled) > _MOST_ROWS:
        st.caption(f"The first {_MOST_ROWS} of {len(settled)}.")


def _in_units(problem: Problem, units: Units) -> Problem:
    """The problem in the units of the fields."""
    expected, found, advice = (said(text, units.system) for text in (problem.expected, problem.found, problem.advice))
    return replace(problem, expected=expected, found=found, advice=advice)


def _need(problem: Problem, *, with_file: bool) -> str:
    told = f"{problem.where}: {advice_on_page(problem)}" if with_file else advice_on_page(problem)
    return plain(
        f"{told}." if problem.found == "none" else f"{told}: expected {problem.expected}, found {problem.found}."
    )
