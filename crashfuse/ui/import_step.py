"""The step between foreign files and a campaign: what was recognised, the resulting records, and adding them."""

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import streamlit as st

from crashfuse.campaign_folder.condition_tables import Role, has_table, listed, read_conditions
from crashfuse.campaign_folder.editing import WHAT
from crashfuse.campaign_folder.history import changed_by, is_vacant
from crashfuse.campaign_folder.settings import sound_settings
from crashfuse.errors import DataError, Problem
from crashfuse.execution.visitors import note_in_log
from crashfuse.importing import Settled, add_settled
from crashfuse.importing.campaign_import import Label, parts_of, role_of
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.record import Record
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.previews import Preview
from crashfuse.results.table import CONDITION, Column, Table, frame_of, of_condition
from crashfuse.signals.pulse import kinematics
from crashfuse.ui.import_fields import choices_of, reading_of
from crashfuse.ui.kit import campaigns, uploads
from crashfuse.ui.kit.address import choose_campaign, kept
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.editing import can_be_edited
from crashfuse.ui.kit.figures import show_figure
from crashfuse.ui.kit.frame import show_title
from crashfuse.ui.kit.results import refused_into, show_problems
from crashfuse.ui.kit.text import advice_on_page, plain, without_options
from crashfuse.ui.kit.uploads import Source
from crashfuse.ui.kit.visitors import visitor
from crashfuse.units import MS, G, counted, said

_FOLDER, _INTO = "import folder", "import into"  # session keys
_FACTOR_PX, _FOLDER_PX = 170, 380
_MOST_ROWS = 100
_Settle = Callable[..., tuple[tuple[Settled, ...], tuple[Problem, ...]]]


def _show_add_form(source: Source, role: Role, settle: _Settle, settled: Sequence[Settled], notice: str) -> None:
    if refused := st.session_state.get(uploads.IMPORT_REFUSED):
        show_problems(refused, "Nothing was added", "The campaign is as it was.")
    what = f"as {WHAT[settled[0].role][0]}" if len(settled) == 1 else _counts_of(settled) or WHAT[role][1]
    with st.container(border=True, horizontal=True, vertical_alignment="bottom"):
        _ask_folder()
        if len(settled) == 1:
            look = kept(f"{source.key} id", placeholder=settled[0].id, width=_FACTOR_PX)
            st.text_input("Id in the campaign", **look)
        for name, values in _factors_of_target(role).items():
            known = sorted({value for one in settled if (value := dict(one.condition.factors).get(name))})
            label = plain(name) + (", of all" if len(settled) > 1 else "")
            look = {"accept_new_options": True, "placeholder": ", ".join(known) or "not given", "width": _FACTOR_PX}
            st.selectbox(label, values, index=None, **kept(f"{source.key} factor {name}", **look))
        add = partial(_add, source, role, settle)
        st.button(f"Add {what}", type="primary", icon=":material/add:", disabled=not settled, on_click=add)
    if notice and st.session_state.get(_INTO) == "open":
        st.info(f"The campaign says of all in it: “{plain(notice)}”", icon=":material/info:")


def _counts_of(settled: Sequence[Settled]) -> str:
    return " and ".join(counted(n, WHAT[role][0]) for role, n in Counter(record.role for record in settled).items())


def _ask_folder() -> None:
    open_one = _open_folder()
    if open_one is not None:
        labels = {"open": f"{plain(st.session_state['campaign'])}, which is open", "folder": "Another folder"}
        look = {"horizontal": True, "width": "content", "format_func": labels.__getitem__}
        st.radio("Add to the campaign", list(labels), **kept(_INTO, **look))
    if open_one is None or st.session_state.get(_INTO) == "folder":
        usual = str((campaigns.roots() or [Path.home()])[0] / "my-campaign")
        look = {"placeholder": usual, "help": "A new folder, or a campaign.", "width": _FOLDER_PX}
        st.text_input("Campaign folder on this computer", **kept(_FOLDER, **look))


def _with_factors(settled: Settled, source: Source, role: Role) -> Settled:
    keys = {name: f"{source.key} factor {name}" for name in _factors_of_target(role)}
    given = {name: str(value) for name, key in keys.items() if (value := st.session_state.get(key))}
    factors = tuple({**dict(settled.condition.factors), **given}.items())
    return replace(settled, condition=replace(settled.condition, factors=factors))


def _factors_of_target(role: Role) -> dict[str, list[str]]:
    with suppress(DataError, OSError):
        folder = _target()
        for table in (folder / f"{role}.csv", folder / "tests.csv", folder / "cae.csv"):
            if table.is_file():
                return _factors_in(table, campaigns.stamp(table))
    return {}


@st.cache_resource(max_entries=4, show_spinner=False)
def _factors_in(table: Path, stamp: tuple[int, ...]) -> dict[str, list[str]]:  # noqa: ARG001  (part of the key)
    pairs = [pair for condition in read_conditions(table, "cae").conditions for pair in condition.factors]
    names = dict.fromkeys(dict(pairs))
    return {name: sorted({value for factor, value in pairs if factor == name and value}) for name in names}


def _add(source: Source, role: Role, settle: _Settle) -> None:
    st.session_state.pop(uploads.IMPORT_REFUSED, None)
    with refused_into(uploads.IMPORT_REFUSED, "campaign"):
        folder = _target()
        settled, problems = settle(raw=sound_settings(folder).channel_filter_class is not None)
        if len(settled) == 1 and (new_id := st.session_state.get(f"{source.key} id", "").strip()):
            settled = (replace(settled[0], id=new_id),)
        if not settled:
            raise DataError(problems)
        settled = tuple(_with_factors(one, source, role) for one in settled)
        with changed_by(visitor().name):
            added = ". ".join(map(str, add_settled(folder, settled)))
        note_in_log(visitor(), f"{added}, in {folder}")
        uploads.leave_import()
        _open(folder, plain(added))


def _open(folder: Path, sentence: str) -> None:
    st.session_state.pop(uploads.NEXT_ROLE, None)
    try:
        choose_campaign(campaigns.open_folder(folder))
        st.toast(f"{sentence}; campaign.toml tells how.", icon=":material/check:")
    except DataError as error:
        st.session_state[_FOLDER] = str(folder)  # the likely target of the next import
        if not (folder / "cae.csv").is_file():
            st.session_state[uploads.NEXT_ROLE] = "cae"
        st.session_state["opening"] = "add"
        st.session_state[uploads.IMPORT_UNFINISHED] = (f"{sentence}, in {plain(str(folder))}.", error.problems)


def _open_folder() -> Path | None:
    folder = campaigns.open_campaigns().get(st.session_state.get("campaign") or "")
    return folder if folder is not None and can_be_edited(folder) else None


def _target() -> Path:
    opened = _open_folder()
    if opened is not None and st.session_state.get(_INTO, "open") == "open":
        return campaigns.allowed(opened)  # the server may have been started with one outside
    expected = "a new or empty folder, or a campaign"
    folder = campaigns.typed_folder(st.session_state.get(_FOLDER, ""), "campaign folder", expected)
    try:
        if uploads.is_ours(folder):
            trouble = "one of crashfuse's own"
        elif folder.exists() and not folder.is_dir():
            trouble = "a file"
        elif is_vacant(folder) or has_table(folder):
            return folder
        else:
            trouble = "a folder of other things"
    except OSError as error:
        trouble = str(error)
    raise DataError(Problem(str(folder), expected, trouble, "name another folder"))


def show_unfinished() -> None:
    """Say what a campaign started by an import still needs before it can be opened."""
    if uploads.IMPORT_UNFINISHED in st.session_state:
        sentence, problems = st.session_state[uploads.IMPORT_UNFINISHED]
        needs = "\n".join(f"- {plain(str(problem))}" for problem in problems)
        then = "The next import goes there, too, unless you name another folder."
        st.info(f"{sentence} Before it can be opened:\n\n{needs}\n\n{then}", icon=":material/check:")


def show_import(source: Source, view: View | None) -> None:
    """Show the import step."""
    several = source.scratch is not None and source.path.parent == source.scratch  # uploads without a common name
    with show_title("Import files" if several else f"Import {plain(source.path.name)}"):
        st.caption(f"Recognised: {FORMATS[source.fmt].label}. Nothing is added yet.", width="content")
        st.button("Back without importing", icon=":material/arrow_back:", on_click=uploads.leave_import)
    above = st.container()  # what adds is on the first screen, however long what was read
    left, right = st.columns([2, 3], gap="large")
    with left:
        taken_as = st.container()  # what files look like is known once all are read
        reading = reading_of(source)
        records, unread = uploads.records_of(source, reading)
        with taken_as:
            role, cae = _roles(source, records)
            if aside := uploads.left_aside(source):
                st.caption(f"Left aside, as no table: {plain(listed(aside))}.")
    with right:
        first = _looked_at(source, records)
    if first is None:
        show_problems(unread, "Nothing of it can be read", "Correct the fields or the files.")
        return
    with left:
        for_all = ", for all records; a table of conditions gives each its own" if len(records) > 1 else ""
        st.caption(f"Grey: found. What is filled in overrules it{for_all}.")
        own_class = None
        with suppress(DataError, OSError):
            own_class = sound_settings(_target()).channel_filter_class
        choices, units = choices_of(source, records, first, role_of(first, role, cae), own_class)
    settle = partial(uploads.settled_of, source, reading, choices, role, cae)
    settled, refused = settle()
    problems = [
        replace(p, expected=said(p.expected, units), found=said(p.found, units), advice=said(p.advice, units))
        for p in refused
    ]
    with right:
        display = DEFAULT if view is None else view.display
        shown = next((one for one in settled if one.id == first.id), None)
        alt = f"The pulse that comes of {first.id}, over its channels as recorded"
        show_figure(Preview(first, choices, shown).draw(display=display), alt=alt)
        if shown is not None:
            st.markdown(f"**{plain(shown.id)}**: {plain(shown.condition.in_units(units))}")
            st.caption("  \n".join(plain(without_options(said(step, units))) for step in shown.steps))
        if len(records) > 1 and settled:
            _table(settled, replace(display, system=units))
        if problems and not settled and (len(records) == 1 or {problem.found for problem in problems} == {"none"}):
            with_file = len({problem.where for problem in problems}) > 1
            needs = dict.fromkeys(_need(problem, with_file=with_file) for problem in problems)
            st.warning("Before it can be added:\n\n" + "\n".join(f"- {need}" for need in needs), icon=":material/edit:")
        elif problems:
            can = f"{_counts_of(settled)} can be added without." if settled else ""
            show_problems(problems, "Not everything can be added" if settled else "It cannot be added yet", can)
    with above:
        _show_add_form(source, role, settle, settled, "" if view is None else view.campaign.notice)


def _roles(source: Source, records: Sequence[Record]) -> tuple[Role, tuple[str, ...]]:
    parts = parts_of(map(Label.of, records))
    look_simulated = [name for name, is_cae in parts.items() if is_cae]
    usual: Role = "cae" if parts and len(look_simulated) == len(parts) else FORMATS[source.fmt].role
    names = {"tests": "Tests", "cae": "CAE runs"}
    look = {"default": st.session_state.get(uploads.NEXT_ROLE) or usual, "format_func": names.__getitem__}
    role: Role = st.segmented_control("Take it as", [*WHAT], required=True, **kept(f"{source.key} role", **look))
    chosen: list[str] = []
    if role == "tests" and len(parts) > 1:
        look = {"default": look_simulated if len(look_simulated) < len(parts) else [], "placeholder": "none"}
        chosen = st.multiselect("Of these, CAE runs are", list(parts), **kept(f"{source.key} cae", **look))
    if look_simulated and (role == "tests" or len(look_simulated) == len(parts)):
        is_stated = any(record.is_simulated for record in records)
        by = "what the files say" if is_stated else "name or number of records"
        st.caption(f"Like CAE runs, by {by}: {plain(listed(look_simulated))}. Change it if that is wrong.")
    return role, tuple(chosen)


def _looked_at(source: Source, records: Sequence[Record]) -> Record | None:
    if len(records) < 2:
        return records[0] if records else None
    named = [f"{number}: {record.id}" for number, record in enumerate(records, start=1)]
    look = kept(f"{source.key} record {len(records)}", format_func=named.__getitem__)
    return records[int(st.selectbox(f"{len(records)} records; this is", range(len(records)), **look))]


_RECORDS = (
    *(Column("Id"), Column("Taken as"), *CONDITION),
    Column("Peak", "number", "g", source="peak"),
    Column("Zero velocity, TTZV", "number", "ms", source="stop", missing="not in the record"),
    Column("Crush", "number", "mm", ".0f", source="crush"),
)


def _table(settled: Sequence[Settled], display: Display) -> None:
    rows = []
    for one in settled[:_MOST_ROWS]:
        row = {"Id": one.id, "Taken as": WHAT[one.role][0], **of_condition(one.condition)}
        motion = kinematics(one.pulse.accel_mps2, one.condition.speed_mps, one.pulse.dt_s)
        peak_g = float(abs(one.pulse.accel_mps2).max()) / G
        rows.append(row | {"peak": peak_g, "stop": motion.t0_s / MS, "crush": motion.displacement_m.max() / MS})
    st.dataframe(Table("records", frame_of(rows), _RECORDS).texts(display), hide_index=True)
    if len(settled) > _MOST_ROWS:
        st.caption(f"The first {_MOST_ROWS} of {len(settled)}.")


def _need(problem: Problem, *, with_file: bool) -> str:
    where = f"{problem.where}: " if with_file else ""
    found = "" if problem.found == "none" else f": expected {problem.expected}, found {problem.found}"
    return plain(f"{where}{advice_on_page(problem)}{found}.")
