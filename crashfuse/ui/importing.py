"""The step between foreign files and a campaign: what was recognised, what comes of it, and adding it."""

import shutil
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd
import streamlit as st

from crashfuse.errors import DataError, Problem
from crashfuse.formats.record import Record
from crashfuse.importing import Choices, Role, Settled, add_settled, own_filter_class
from crashfuse.importing.draft import Reading
from crashfuse.plots.canvas import Unit
from crashfuse.plots.imports import imported_pulse
from crashfuse.pulse import kinematics
from crashfuse.ui import campaigns, evidence, frame
from crashfuse.ui.foreign import Source, records_of, settled_of
from crashfuse.ui.import_fields import choices_of, reading_of
from crashfuse.ui.problems import show_problems
from crashfuse.ui.text import plain
from crashfuse.ui.uploads import is_scratch
from crashfuse.units import KPH, MS, G

_SOURCE, _REFUSED, _UNFINISHED = "import", "import refused", "import unfinished"  # in the session
_FOLDER, _INTO = "import folder", "import into"
_FORMATS = {
    "csv": "tables",
    "nhtsa": "a test of the NHTSA database",
    "isomme": "ISO-MME",
    "lsdyna": "LS-DYNA",
    "tdms": "TDMS",
}
_WHAT: dict[Role, tuple[str, str]] = {"tests": ("test", "tests"), "cae": ("CAE run", "CAE runs")}
_MOST_ROWS = 100
_adding = threading.Lock()


def begin(source: Source) -> None:
    """Turn the page Data to the import of a source; to be called from a callback."""
    leave()
    st.session_state[_SOURCE] = source


def leave() -> None:
    """End the import, and delete what was laid out for it."""
    source: Source | None = st.session_state.pop(_SOURCE, None)
    for key in (_REFUSED, _UNFINISHED):
        st.session_state.pop(key, None)
    if source is not None and source.scratch is not None:
        shutil.rmtree(source.scratch, ignore_errors=True)


def running() -> Source | None:
    """The source that is being imported in this session, if any."""
    source: Source | None = st.session_state.get(_SOURCE)
    return source


def show_unfinished() -> None:
    """Say what a campaign that was begun by an import still needs before it can be opened."""
    if _UNFINISHED in st.session_state:
        sentence, problems = st.session_state[_UNFINISHED]
        needs = "\n".join(f"- {plain(str(problem))}" for problem in problems)
        st.info(f"{sentence} Before it can be opened:\n\n{needs}", icon=":material/check:")


def show(source: Source, view: frame.View | None) -> None:
    """Show the step."""
    st.title(f"Import {plain(source.path.name)}")
    st.button("Back without importing", icon=":material/arrow_back:", on_click=leave)
    left, right = st.columns([2, 3], gap="large")
    with left:
        role = _role(source)
        reading = reading_of(source)
        records, unread = records_of(source, reading)
    with right:
        first = _looked_at(source, records)
    if first is None:
        show_problems(unread, "Nothing of it can be read", "Correct the fields or the files.")
        return
    with left:
        st.caption("In grey: what was found. What is filled in overrules it" + _for_all(records) + ".")
        own_class = _own_class(view)
        choices = choices_of(source, records, first, role, own_class)
    settled, problems = settled_of(source, reading, choices, role)
    with right:
        _preview(first, choices, next((one for one in settled if one.id == first.id), None), view)
        if len(records) > 1 and settled:
            _table(settled)
        if problems:
            result = f"{_counted(len(settled), role)} can be added without." if settled else "Fill in what is missing."
            show_problems(problems, "Not everything can be added" if settled else "It cannot be added yet", result)
    _door(source, reading, choices, role, settled, view)


def _role(source: Source) -> Role:
    role: Role = st.segmented_control(
        f"{_FORMATS[source.fmt].capitalize() if source.fmt == 'csv' else _FORMATS[source.fmt]}, taken as",
        list(_WHAT),
        default="cae" if source.fmt == "lsdyna" else "tests",
        required=True,
        format_func=lambda name: _WHAT[name][1].capitalize() if name == "tests" else _WHAT[name][1],
        key=f"{source.key} role",
        persist_state="session",
    )
    return role


def _for_all(records: Sequence[Record]) -> str:
    return f", for all {len(records)} records" if len(records) > 1 else ""


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


def _preview(record: Record, choices: Choices, settled: Settled | None, view: frame.View | None) -> None:
    known = {channel.name: channel for channel in record.channels}
    names = settled.channels if settled is not None else choices.channels or record.proposed
    channels = [known[name] for name in names if name in known] or list(record.channels)
    unit: Unit = "g" if view is None else view.unit
    evidence.show_figure(
        imported_pulse(channels, settled, unit=unit, deceleration=view is not None and view.deceleration),
        alt=f"The pulse that comes of {record.id}, over its channels as recorded",
    )
    if settled is not None:
        st.markdown(f"**{plain(settled.id)}**: {settled.condition}")
        st.markdown("\n".join(f"- {plain(step)}" for step in settled.steps))


def _table(settled: Sequence[Settled]) -> None:
    """What comes of many records."""
    rows = []
    for one in settled[:_MOST_ROWS]:
        motion = kinematics(one.pulse.accel_mps2, one.condition.speed_mps, one.pulse.dt_s)
        rows.append(
            {
                "Id": one.id,
                "Speed (km/h)": round(one.condition.speed_mps / KPH, 1),
                "Front (kg)": round(one.condition.front_weight_kg),
                "Rear (kg)": round(one.condition.rear_weight_kg),
                "Peak (g)": round(float(abs(one.pulse.accel_mps2).max()) / G, 1),
                "Stops (ms)": round(float(motion.t0_s) / MS, 1),
                "Crush (mm)": round(float(motion.displacement_m.max()) / MS),
            }
        )
    st.dataframe(pd.DataFrame(rows), hide_index=True)
    if len(settled) > _MOST_ROWS:
        st.caption(f"The first {_MOST_ROWS} of {len(settled)}.")


def _door(
    source: Source,
    reading: Reading,
    choices: Choices,
    role: Role,
    settled: Sequence[Settled],
    view: frame.View | None,
) -> None:
    """Where to, and the button."""
    st.subheader("Add to a campaign")
    if refused := st.session_state.get(_REFUSED):
        show_problems(refused, "Nothing was added", "The campaign is as it was.")
    left, right = st.columns([2, 3], gap="large", vertical_alignment="bottom")
    own_folder = _open_folder()
    with left:
        new_id = None
        if len(settled) == 1:
            new_id = st.text_input("Id", placeholder=settled[0].id, key=f"{source.key} id", persist_state="session")
        st.button(
            f"Add as {_WHAT[role][0]}" if len(settled) == 1 else f"Add {_counted(len(settled), role)}",
            type="primary",
            icon=":material/add:",
            disabled=not settled,
            on_click=_add,
            args=(source, reading, choices, role),
        )
    with right:
        if own_folder is not None and view is not None:
            st.radio(
                "Into",
                ["open", "folder"],
                format_func={"open": f"{view.campaign.name}, which is open", "folder": "Another folder"}.__getitem__,
                key=_INTO,
                persist_state="session",
            )
        if own_folder is None or st.session_state.get(_INTO) == "folder":
            st.text_input(
                "Campaign folder on this computer",
                key=_FOLDER,
                persist_state="session",
                placeholder=str(Path.home() / "my-campaign"),
                help="A new folder, which will be made, or a campaign that is there already.",
            )


def _add(source: Source, reading: Reading, choices: Choices, role: Role) -> None:
    """Add all that can be added, and turn to the campaign."""
    st.session_state.pop(_REFUSED, None)
    try:
        folder = _target()
        own = own_filter_class(folder)
        raw = own is not None
        settled, problems = settled_of(source, reading, _left_to(own, choices), role, raw=raw)
        if len(settled) == 1 and (new_id := st.session_state.get(f"{source.key} id", "").strip()):
            settled = (replace(settled[0], id=new_id),)
        if not settled:
            raise DataError(problems)
        with _adding:
            add_settled(folder, settled, role=role)
    except DataError as error:
        st.session_state[_REFUSED] = error.problems
        return
    except OSError as error:
        expected, found = "a folder that can be written", error.strerror or str(error)
        st.session_state[_REFUSED] = (Problem("campaign", expected, found, "check the path and your rights"),)
        return
    leave()
    _turn_to(folder, f"{_counted(len(settled), role)} added")


def _turn_to(folder: Path, sentence: str) -> None:
    try:
        frame.choose_campaign(campaigns.open_folder(folder))
        st.toast(f"{sentence}; campaign.toml tells how.", icon=":material/check:")
    except DataError as error:
        st.session_state[_FOLDER] = str(folder)  # where the rest is likely to go
        st.session_state[_UNFINISHED] = (f"{sentence} to {plain(str(folder))}.", error.problems)


def _own_class(view: frame.View | None) -> float | None:
    """With what the campaign that is added to filters its records, as far as it is known yet."""
    try:
        return own_filter_class(_target())
    except (DataError, OSError):
        return None


def _left_to(own: float | None, choices: Choices) -> Choices:
    return choices if own is None else replace(choices, channel_filter_class=None)


def _open_folder() -> Path | None:
    """The folder of the open campaign, if it is one that can be added to."""
    folder = campaigns.shelf().get(st.session_state.get("campaign") or "")
    return None if folder is None or is_scratch(folder) or campaigns.is_sample(folder) else folder


def _target() -> Path:
    """The folder to add to.

    Raises
    ------
    DataError
        If it is none that anything should be added to.
    """
    own = _open_folder()
    if own is not None and st.session_state.get(_INTO, "open") == "open":
        return own
    text = st.session_state.get(_FOLDER, "").strip().strip('"')  # as file managers copy a path
    expected, advice = "a new or empty folder, or a campaign", "name a folder by its whole path"
    try:
        folder = Path(text).expanduser()
        if not folder.is_absolute():
            raise DataError(Problem("campaign folder", expected, text or "none", advice))
        folder = folder.resolve()
        trouble = None
        if campaigns.is_sample(folder) or is_scratch(folder):
            trouble = "one of crashfuse's own"
        elif folder.exists() and not folder.is_dir():
            trouble = "a file"
        elif folder.is_dir() and not any((folder / name).is_file() for name in ("tests.csv", "cae.csv")):
            trouble = "a folder of other things" if any(folder.iterdir()) else None
    except (OSError, RuntimeError, ValueError) as error:  # no such home, a name that no folder can have
        raise DataError(Problem("campaign folder", expected, str(error), advice)) from error
    if trouble is not None:
        raise DataError(Problem(str(folder), expected, trouble, "name another folder"))
    return folder


def _counted(number: int, role: Role) -> str:
    return f"{number} {_WHAT[role][number != 1]}"
