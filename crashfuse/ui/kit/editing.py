"""Editing the open campaign: tests in use, tests taken out, the last change undone, a copy to edit, notes on tests."""

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import streamlit as st

from crashfuse.campaign_folder.editing import copy_campaign, leave_out, remove_tests, say_why, set_archive, use_again
from crashfuse.campaign_folder.history import changed_by, changes, undo
from crashfuse.campaign_folder.notes import FILE, LATEST_MS, LONGEST_TEXT, Note, change_notes, read_notes
from crashfuse.campaign_folder.settings import LONGEST_REASON
from crashfuse.errors import DataError, UsageError
from crashfuse.execution.visitors import note_in_log
from crashfuse.ui.kit import address, campaigns
from crashfuse.ui.kit.address import choose_campaign, kept
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.results import refused_into, show_problems
from crashfuse.ui.kit.text import plain
from crashfuse.ui.kit.uploads import is_ours
from crashfuse.ui.kit.visitors import visitor

_USED, _COPY = "tests in use", "copy folder"  # widget keys
_REFUSED = "edit refused"  # session key
_KEPT_NOTES = "notes"  # session key: notes by folder, where they cannot be kept in the folder
_NOTE_REFUSED = "note refused"  # session key: why the last one was not added
_DELETED_NOTE = "note deleted"  # session key: the folder, and the last one that was
_LEFT_OUT_HELP = "A click leaves a test out of use: nothing learns from it, and it is not rated. Another uses it again."


def can_be_edited(folder: Path) -> bool:
    """True if a folder can be written, and is neither the sample nor an upload."""
    return not is_ours(folder) and os.access(folder, os.W_OK)


def show_last_change(view: View) -> None:
    """Show in a line what was changed last, with a button that undoes it."""
    last = next(iter(changes(view.folder)), None) if can_be_edited(view.folder) else None
    if last is not None:
        with st.container(horizontal=True, vertical_alignment="center", gap="small"):
            st.markdown(f":material/history: {plain(last.what)}.", width="content")
            args = view, lambda: f"Undone: {undo(view.folder, last).what}"
            st.button("Undo", icon=":material/undo:", on_click=edit, args=args, help=plain(str(last)))


def offer_leaving_out(view: View) -> None:
    """Offer to leave out of use the tests whose sensor failed."""
    if len(view.campaign.tests) > 1 and can_be_edited(view.folder):
        for test in [test for test in view.campaign.tests if test.faults]:
            why = "; ".join(fault.text for fault in test.faults)[:LONGEST_REASON]
            args = view, partial(leave_out, view.folder, [test.id], why)
            st.button(f"Leave {plain(test.id)} out of use", on_click=edit, args=args, key=f"leave out {test.id}")


def choose_tests_in_use(view: View) -> None:
    """Let the tests in use be changed, or offer a copy in which they can be."""
    if not can_be_edited(view.folder):
        with st.popover("Save a copy to edit", icon=":material/content_copy:"):
            st.markdown("Tests are left out of use, or added, in a copy.")
            st.text_input("Folder of the copy", placeholder=str(Path.home() / "my-campaign"), **kept(_COPY))
            st.button("Save the copy", type="primary", on_click=_save_copy, args=(view,))
        return
    used, unused = view.campaign.test_ids, [test_id for test_id, _ in view.campaign.unused]
    address.put(_USED, list(used))
    st.pills(
        "Tests in use", sorted((*used, *unused)), selection_mode="multi", format_func=plain, key=_USED,
        on_change=_change_use, args=(view, used), width="content", wrap=True, help=_LEFT_OUT_HELP,
    )  # fmt: skip


def show_refused() -> None:
    """Show why the last change was refused."""
    if problems := st.session_state.pop(_REFUSED, None):
        show_problems(problems, "Nothing was changed", "The campaign is as it was.", place="edit")


def show_tests_out_of_use(view: View) -> None:
    """Ask why tests are left out, offer to take them away, and show why a change was refused."""
    show_refused()
    for test_id, _ in view.campaign.unused if can_be_edited(view.folder) else ():
        key, label = f"why {test_id} of {view.folder} is left out", plain(f"Why is {test_id} left out?")
        address.put(key, view.campaign.why_unused.get(test_id, ""))
        with st.container(horizontal=True, vertical_alignment="center", gap="small"):
            st.markdown(f":small[{label}]", width="content")
            st.text_input(
                label, key=key, max_chars=LONGEST_REASON, on_change=edit,
                args=(view, lambda test=test_id, key=key: say_why(view.folder, test, st.session_state[key])),
                label_visibility="collapsed", placeholder="no reason given; it stands in every report",
            )  # fmt: skip
            args = view, partial(remove_tests, view.folder, [test_id])
            st.button(f"Take {plain(test_id)} out of the folder", icon=":material/delete:", on_click=edit, args=args)


def _change_use(view: View, used: tuple[str, ...]) -> None:
    chosen = set(st.session_state[_USED])
    if out := [test_id for test_id in used if test_id not in chosen]:
        edit(view, lambda: leave_out(view.folder, out))
    if again := sorted(chosen - {*used}):
        edit(view, lambda: use_again(view.folder, again))


def use_archive(view: View, content: bytes | None) -> None:
    """Put the file of an archive into the campaign's folder, or take it out; a callback."""
    edit(view, lambda: set_archive(view.folder, view.campaign, content))


def edit(view: View, change_it: Callable[[], str]) -> None:
    """Change the campaign's folder; a callback. :func:`show_refused` says what is refused."""
    expected, advice = "a change that can be made", "choose otherwise, or check your rights"
    with refused_into(_REFUSED, view.campaign.name, expected, advice):
        with changed_by(visitor().name):
            what = change_it()
        note_in_log(visitor(), f"{what}, in {view.folder}")
        st.toast(f"{plain(what)}.", icon=":material/check:")
        tests = {test.id for test in campaigns.load(view.name).tests}
        if st.session_state["test"] not in tests:  # another is then held out, without a warning
            st.session_state["test"] = None


def _save_copy(view: View) -> None:
    text = st.session_state.get(_COPY, "")
    with refused_into(_REFUSED, text.strip()):
        folder = campaigns.typed_folder(text, "folder of the copy", "a new or empty folder")
        copy_campaign(view.folder, folder)
        choose_campaign(campaigns.open_folder(folder))
        st.toast("Saved; the copy is open.", icon=":material/check:")


def notes_of(view: View) -> tuple[Note, ...]:
    """The notes on a campaign's tests; it is said if they cannot be read."""
    kept: dict[Path, tuple[Note, ...]] = st.session_state.get(_KEPT_NOTES, {})
    try:
        return kept[view.folder] if view.folder in kept else read_notes(view.folder)
    except DataError as error:
        st.warning(plain(str(error.problems[0])), icon=":material/warning:")
        return ()


def edit_notes(view: View, notes: Sequence[Note]) -> None:
    """Show the notes on the held-out test, to be deleted, and a form for another."""
    test = view.held_out.id
    folded = st.expander("Notes and marks", icon=":material/edit_note:", on_change="rerun")
    if not folded.open:  # as most readers leave it
        return
    with folded:
        for number, note in enumerate(note for note in notes if note.test == test):
            with st.container(horizontal=True, vertical_alignment="center", gap="small"):
                key = f"delete note {number} of {test}"
                st.button("Delete", on_click=_delete_note, args=(view, note), key=key, type="tertiary")
                st.markdown(f"**{note.when}** {plain(note.text)}" if note.when else plain(note.text), width="stretch")
        folder, deleted = st.session_state.get(_DELETED_NOTE, (None, None))
        if folder == view.folder and deleted.test == test:

            def put_back() -> None:
                if _change_notes(view, lambda notes: [*notes, deleted]):
                    del st.session_state[_DELETED_NOTE]

            label = f"Put back “{plain(deleted.text[:40])}”"
            st.button(label, icon=":material/undo:", type="tertiary", on_click=put_back)
        with st.form(f"note on {test}", border=False):
            left, middle, right = st.columns([4, 1, 1])
            left.text_input("Note", max_chars=LONGEST_TEXT, key="note_text")
            for column, label, key in ((middle, "From (ms)", "note_start"), (right, "To (ms)", "note_end")):
                column.number_input(label, 0.0, LATEST_MS, None, step=1.0, format="%.1f", key=key)
            st.form_submit_button("Add", icon=":material/add:", on_click=_add_note, args=(view,))
        if refused := st.session_state.pop(_NOTE_REFUSED, ""):
            st.warning(plain(refused), icon=":material/warning:")
        kept = f"kept in {FILE}" if can_be_edited(view.folder) else "lost when this tab is closed"
        st.caption(f"Notes go into the report; one with a time is a mark on the figures over time. They are {kept}.")


def _add_note(view: View) -> None:
    text, start, end = (st.session_state[key] for key in ("note_text", "note_start", "note_end"))
    try:
        note = Note(view.held_out.id, text, start, end)
    except UsageError as error:
        st.session_state[_NOTE_REFUSED] = str(error)
        return
    if _change_notes(view, lambda notes: [*notes, note]):
        st.session_state.update(note_text="", note_start=None, note_end=None)  # what is refused stays, to be corrected


def _delete_note(view: View, note: Note) -> None:
    def without(notes: tuple[Note, ...]) -> list[Note]:
        place = notes.index(note) if note in notes else len(notes)  # another reader may have deleted it
        return [*notes[:place], *notes[place + 1 :]]

    if _change_notes(view, without):
        st.session_state[_DELETED_NOTE] = view.folder, note


def _change_notes(view: View, change: Callable[[tuple[Note, ...]], Sequence[Note]]) -> bool:
    try:
        if can_be_edited(view.folder):
            change_notes(view.folder, change)
        else:
            st.session_state.setdefault(_KEPT_NOTES, {})[view.folder] = tuple(change(notes_of(view)))
    except DataError as error:
        st.session_state[_NOTE_REFUSED] = f"Nothing was changed. {error.problems[0]}"
    except OSError as error:
        st.session_state[_NOTE_REFUSED] = f"{FILE} was not written: {error.strerror or error}."
    return _NOTE_REFUSED not in st.session_state
