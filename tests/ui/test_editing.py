"""Notes on the tests of a campaign."""

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from crashfuse.campaign_folder.notes import FILE, MOST, Note, read_notes, write_notes


def _form(folder: str) -> None:
    """The fields of the form on a held-out test, and a button for each note."""
    from pathlib import Path
    from types import SimpleNamespace
    from typing import Any

    import streamlit as st

    from crashfuse.ui.kit import editing

    view: Any = SimpleNamespace(folder=Path(folder), held_out=SimpleNamespace(id="T1"))
    for note in editing.notes_of(view):
        st.button(f"Delete {note.text}", on_click=editing._delete_note, args=(view, note))
    st.text_input("Note", key="note_text")
    for key in ("note_start", "note_end"):
        st.number_input(key, 0.0, 100.0, None, key=key)
    st.button("Add", on_click=editing._add_note, args=(view,))
    if refused := st.session_state.pop("note refused", ""):
        st.error(refused)


def visit(folder: Path) -> AppTest:
    return AppTest.from_function(_form, args=(str(folder),)).run()


def press(reader: AppTest, label: str) -> AppTest:
    """Press a button; nothing may be raised."""
    next(button for button in reader.button if button.label == label).click().run()
    assert not reader.exception
    return reader


def test_what_two_readers_write_and_delete_is_all_kept(tmp_path: Path) -> None:
    """Each of them still sees what was there before the other wrote."""
    write_notes(tmp_path, [Note("T1", "first")])
    one, other = visit(tmp_path), visit(tmp_path)
    one.text_input[0].set_value("of one")
    press(one, "Add")
    other.text_input[0].set_value("of the other")
    press(other, "Add")
    assert [note.text for note in read_notes(tmp_path)] == ["first", "of one", "of the other"]
    assert other.text_input[0].value == ""
    press(one, "Delete first")
    press(other, "Delete first")  # which the page of the other still shows
    assert [note.text for note in read_notes(tmp_path)] == ["of one", "of the other"]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"test,start_ms,end_ms,text\nT1,,,T\xfcr\n", "UTF-8"),
        (b"test,start_ms,end_ms,text\n" + b"T1,,,x\n" * (MOST + 1), "at most 500 notes"),
    ],
)
def test_a_file_that_cannot_be_read_stays_as_it_is(tmp_path: Path, content: bytes, reason: str) -> None:
    """The note that was typed stays in its field, too, and why is said."""
    (tmp_path / FILE).write_bytes(content)
    reader = visit(tmp_path)
    reader.text_input[0].set_value("new")
    press(reader, "Add")
    assert (tmp_path / FILE).read_bytes() == content
    assert reader.text_input[0].value == "new"
    assert reason in reader.error[0].value
