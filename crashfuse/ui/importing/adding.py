"""Last step of an import: choose the campaign and add the records to it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import streamlit as st

from crashfuse.campaign_folder.condition_tables import Role, has_table, read_conditions
from crashfuse.campaign_folder.editing import WHAT, counted
from crashfuse.campaign_folder.history import changed_by, is_vacant
from crashfuse.campaign_folder.settings import own_filter_class
from crashfuse.errors import DataError, Problem
from crashfuse.importing import Choices, Reading, Settled, add_settled
from crashfuse.ui import campaigns, journal, recent
from crashfuse.ui.chosen import choose_campaign
from crashfuse.ui.editing import can_be_edited
from crashfuse.ui.importing.session import NEXT_ROLE, REFUSED, UNFINISHED, Source, leave, settled_of
from crashfuse.ui.problems import show_problems
from crashfuse.ui.text import plain
from crashfuse.ui.uploads import is_ours
from crashfuse.ui.visitors import visitor

_FOLDER, _INTO = "import folder", "import into"  # session keys
_FACTOR_PX = 260


def show_add_form(
    source: Source,
    reading: Reading,
    choices: Choices,
    role: Role,
    cae: tuple[str, ...],
    settled: Sequence[Settled],
    notice: str,
) -> None:
    """Show the choice of target campaign, with the notice of the open one if it is that, and the Add button."""
    st.subheader("Add to a campaign")
    if refused := st.session_state.get(REFUSED):
        show_problems(refused, "Nothing was added", "The campaign is as it was.")
    if len(settled) == 1:
        left, right = st.columns([2, 3], gap="large")
        left.text_input(
            "Id in the campaign", placeholder=settled[0].id, key=f"{source.key} id", persist_state="session"
        )
        with right:
            _ask_folder(notice)
    else:
        _ask_folder(notice)
    _ask_factors(source, role, settled)
    several = counted_each(settled) if settled else WHAT[role][1]
    st.button(
        f"Add as {WHAT[settled[0].role][0]}" if len(settled) == 1 else f"Add {several}",
        type="primary",
        icon=":material/add:",
        disabled=not settled,
        on_click=_add,
        args=(source, reading, choices, role, cae),
    )


def counted_each(settled: Sequence[Settled]) -> str:
    """How many tests and CAE runs there are."""
    return " and ".join(counted(n, own) for own, n in Counter(one.role for one in settled).items())


def _ask_folder(notice: str) -> None:
    open_one = _open_folder()
    if open_one is not None:
        labels = {"open": f"{plain(st.session_state['campaign'])}, which is open", "folder": "Another folder"}
        st.radio(
            "Into",
            list(labels),
            format_func=labels.__getitem__,
            key=_INTO,
            persist_state="session",
            horizontal=True,
        )
    if open_one is None or st.session_state.get(_INTO) == "folder":
        st.text_input(
            "Campaign folder on this computer",
            key=_FOLDER,
            persist_state="session",
            placeholder=str((campaigns.roots() or [Path.home()])[0] / "my-campaign"),
            help="A new folder, which will be made, or a campaign that is there already.",
        )
    elif notice:
        said = f"{plain(st.session_state['campaign'])} says of itself: “{plain(notice)}”"
        st.info(f"{said} That would stand over what is added, too.", icon=":material/info:")


def _ask_factors(source: Source, role: Role, settled: Sequence[Settled]) -> None:
    """Ask for the factors, besides speed and weights, that distinguish the campaign's tests or runs."""
    known = _factors_of_target(role)
    row = st.container(horizontal=True)
    for name, values in known.items():
        found = sorted({value for one in settled if (value := dict(one.condition.factors).get(name))})
        row.selectbox(
            plain(name) + (", of all" if len(settled) > 1 else ""),
            values,
            index=None,
            accept_new_options=True,
            placeholder=", ".join(found) or "not given",
            key=f"{source.key} factor {name}",
            persist_state="session",
            help="A column of the campaign's table. Choose a value that it has, or type in another.",
            width=_FACTOR_PX,
        )


def _with_factors(settled: Settled, source: Source, role: Role) -> Settled:
    """The record with the factors that the user filled in."""
    keys = {name: f"{source.key} factor {name}" for name in _factors_of_target(role)}
    given = {name: str(value) for name, key in keys.items() if (value := st.session_state.get(key))}
    factors = tuple({**dict(settled.condition.factors), **given}.items())
    return replace(settled, condition=replace(settled.condition, factors=factors))


def _factors_of_target(role: Role) -> dict[str, list[str]]:
    """Factor columns of the target's table, and the values in them."""
    try:
        folder = _target()
        tables = [folder / f"{role}.csv", folder / "tests.csv", folder / "cae.csv"]
        table = next((path for path in tables if path.is_file()), None)
        return {} if table is None else _factors_in(table, campaigns.stamp(table))
    except (DataError, OSError):
        return {}


@st.cache_resource(max_entries=4, show_spinner=False)
def _factors_in(table: Path, stamp: tuple[int, ...]) -> dict[str, list[str]]:  # noqa: ARG001  (part of the key)
    pairs = [pair for condition in read_conditions(table, "cae").conditions for pair in condition.factors]
    return {
        name: sorted({value for own, value in pairs if own == name and value}) for name in dict.fromkeys(dict(pairs))
    }


def own_class() -> float | None:
    """Channel filter class that the target campaign applies to its records, as far as it is known yet."""
    try:
        return own_filter_class(_target())
    except (DataError, OSError):
        return None


def _add(source: Source, reading: Reading, choices: Choices, role: Role, cae: tuple[str, ...]) -> None:
    """Add every record that can be added, and switch to the campaign."""
    st.session_state.pop(REFUSED, None)
    try:
        folder = _target()
        own = own_filter_class(folder)
        settled, problems = settled_of(source, reading, choices, role, cae, raw=own is not None)
        if len(settled) == 1 and (new_id := st.session_state.get(f"{source.key} id", "").strip()):
            settled = (replace(settled[0], id=new_id),)
        if not settled:
            raise DataError(problems)
        settled = tuple(_with_factors(one, source, role) for one in settled)
        with changed_by(visitor().name):
            added = ". ".join(map(str, add_settled(folder, settled)))
        journal.note(visitor(), f"{added}, in {folder}")
    except DataError as error:
        st.session_state[REFUSED] = error.problems
        return
    except OSError as error:
        expected, found = "a folder that can be written", error.strerror or str(error)
        st.session_state[REFUSED] = (Problem("campaign", expected, found, "check the path and your rights"),)
        return
    leave()
    _turn_to(folder, plain(added))


def _turn_to(folder: Path, sentence: str) -> None:
    st.session_state.pop(NEXT_ROLE, None)
    try:
        choose_campaign(campaigns.open_folder(folder))
        recent.remember(folder)
        st.toast(f"{sentence}; campaign.toml tells how.", icon=":material/check:")
    except DataError as error:
        st.session_state[_FOLDER] = str(folder)  # the likely target of the next import
        if not (folder / "cae.csv").is_file():
            st.session_state[NEXT_ROLE] = "cae"
        st.session_state[UNFINISHED] = (f"{sentence}, in {plain(str(folder))}.", error.problems)


def _open_folder() -> Path | None:
    """The folder of the open campaign, if records can be added to it."""
    folder = campaigns.open_campaigns().get(st.session_state.get("campaign") or "")
    return folder if folder is not None and can_be_edited(folder) else None


def _target() -> Path:
    """The folder to add to; raises DataError if nothing may be added to it."""
    own = _open_folder()
    if own is not None and st.session_state.get(_INTO, "open") == "open":
        return campaigns.allowed(own)  # the server may have been started with one outside
    expected = "a new or empty folder, or a campaign"
    folder = campaigns.typed_folder(st.session_state.get(_FOLDER, ""), "campaign folder", expected)
    trouble = None
    try:
        if is_ours(folder):
            trouble = "one of crashfuse's own"
        elif folder.exists() and not folder.is_dir():
            trouble = "a file"
        elif not is_vacant(folder) and not has_table(folder):
            trouble = "a folder of other things"
    except OSError as error:
        raise DataError(Problem(str(folder), expected, str(error), "name another folder")) from error
    if trouble is not None:
        raise DataError(Problem(str(folder), expected, trouble, "name another folder"))
    return folder
