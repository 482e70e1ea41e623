"""Notes on the tests of a campaign: kept in its folder if it may be written, else for the session."""

from collections.abc import Callable, Sequence
from pathlib import Path

import streamlit as st

from crashfuse.campaign_folder.notes import FILE, LATEST_MS, LONGEST_TEXT, Note, change_notes, read_notes
from crashfuse.errors import DataError, UsageError
from crashfuse.ui.chosen import View
from crashfuse.ui.editing import can_be_edited
from crashfuse.ui.text import plain

_KEPT = "notes"  # session key: notes by folder, where they cannot be kept in the folder
_REFUSED = "note refused"  # session key: why the last one was not added
_DELETED = "note deleted"  # session key: the folder, and the last one that was
_HERE = "A note with a time is a mark on this test's figures over time. Notes and marks go into the report. "


def notes_of(view: View) -> tuple[Note, ...]:
    """The notes on a campaign's tests; none while the file in its folder cannot be read, which is said."""
    kept: dict[Path, tuple[Note, ...]] = st.session_state.get(_KEPT, {})
    try:
        return kept[view.folder] if view.folder in kept else read_notes(view.folder)
    except DataError as error:
        st.warning(plain(str(error.problems[0])), icon=":material/warning:")
        return ()


def edit_notes(view: View, notes: Sequence[Note]) -> None:
    """Show the notes on the held-out test, each with a button that deletes it, and a form for another, if unfolded."""
    test = view.held_out.id
    own = [note for note in notes if note.test == test]
    folded = st.expander(f"Notes and marks on {plain(test)}", icon=":material/edit_note:", on_change="rerun")
    if not folded.open:  # as most readers leave it
        return
    with folded:
        for number, note in enumerate(own):
            with st.container(horizontal=True, vertical_alignment="center", gap="small"):
                st.button(
                    "Delete", icon=":material/close:", key=f"delete note {number} of {test}", type="tertiary",
                    on_click=_delete, args=(view, note),
                )  # fmt: skip
                st.markdown(f"**{note.when}** {plain(note.text)}" if note.when else plain(note.text), width="stretch")
        folder, deleted = st.session_state.get(_DELETED, (None, None))
        if folder == view.folder and deleted.test == test:
            st.button(
                f"Put back “{plain(deleted.text[:40])}”", icon=":material/undo:", type="tertiary", on_click=_put_back,
                args=(view, deleted),
            )  # fmt: skip
        with st.form(f"note on {test}", border=False):
            left, middle, right = st.columns([4, 1, 1])
            left.text_input("Note", max_chars=LONGEST_TEXT, key="note_text")
            for column, label, key in ((middle, "From (ms)", "note_start"), (right, "To (ms)", "note_end")):
                column.number_input(label, 0.0, LATEST_MS, None, step=1.0, format="%.1f", key=key)
            st.form_submit_button("Add", icon=":material/add:", on_click=_add, args=(view,))
        if refused := st.session_state.pop(_REFUSED, ""):
            st.warning(plain(refused), icon=":material/warning:")
        st.caption(_HERE + _where(view.folder))


def _add(view: View) -> None:
    """Add what was typed in."""
    text, start, end = (st.session_state[key] for key in ("note_text", "note_start", "note_end"))
    try:
        note = Note(view.held_out.id, text, start, end)
    except UsageError as error:
        st.session_state[_REFUSED] = str(error)
        return
    if _change(view, lambda notes: [*notes, note]):
        st.session_state.update(note_text="", note_start=None, note_end=None)  # what is refused stays, to be corrected


def _delete(view: View, note: Note) -> None:
    """Delete a note, which can be put back until another is deleted."""
    if _change(view, lambda notes: _without(notes, note)):
        st.session_state[_DELETED] = view.folder, note


def _put_back(view: View, note: Note) -> None:
    if _change(view, lambda notes: [*notes, note]):
        del st.session_state[_DELETED]


def _without(notes: Sequence[Note], note: Note) -> list[Note]:
    """The notes without the first that is equal; another reader may have deleted it."""
    place = notes.index(note) if note in notes else len(notes)
    return [*notes[:place], *notes[place + 1 :]]


def _change(view: View, change: Callable[[tuple[Note, ...]], Sequence[Note]]) -> bool:
    """Change the notes that are kept in the folder, else those of the session; False if that was refused."""
    try:
        if can_be_edited(view.folder):
            change_notes(view.folder, change)
        else:
            st.session_state.setdefault(_KEPT, {})[view.folder] = tuple(change(notes_of(view)))
    except DataError as error:
        st.session_state[_REFUSED] = f"Nothing was changed. {error.problems[0]}"
    except OSError as error:
        st.session_state[_REFUSED] = f"{FILE} was not written: {error.strerror or error}."
    return _REFUSED not in st.session_state


def _where(folder: Path) -> str:
    if can_be_edited(folder):
        return f"They are kept in {FILE} of the campaign folder, for everyone who opens it."
    return "This campaign's folder is not written to: they last until this tab is closed."
