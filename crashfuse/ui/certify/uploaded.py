"""Uploaded criteria, matrices and earlier certifications, and what is wrong with them."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import streamlit as st

from crashfuse.certification import file_store
from crashfuse.errors import CrashfuseError, DataError, UsageError, shortened
from crashfuse.ui.kit.text import plain

T = TypeVar("T")


def uploaded(content: bytes, name: str, read: Callable[[Path], T]) -> T:
    """Read an uploaded file's content by a function of the library, which takes a path; messages give it this name."""
    with tempfile.TemporaryDirectory(prefix="crashfuse-") as folder:
        path = Path(folder, name)
        path.write_bytes(content)
        return read(path)


def under_its_name(error: CrashfuseError, file: str, name: str) -> CrashfuseError:
    """What is wrong with a file that was read under its usual name, under the name that it was uploaded with."""
    if not isinstance(error, DataError):
        return error
    return DataError([replace(problem, where=problem.where.replace(file, name, 1)) for problem in error.problems])


def choose_kept(label: str, file: str, choice: str, key: str, read: Callable[[bytes], T]) -> T | None:
    """Ask for a file that is kept on the server under a name, which the address has; ``file`` is its usual name.

    A CrashfuseError says what is wrong with it, by ``read``, or that the file of a link is not on this server.
    """
    state, wrong = st.session_state, f"{key}: wrong"

    def take() -> None:
        state[wrong], state[choice] = None, None
        if (given := state[key]) is None:  # it was taken away
            return
        try:
            read(given.getvalue())
            state[choice] = file_store.keep(given.getvalue(), file)
        except CrashfuseError as error:
            state[wrong] = under_its_name(error, file, given.name)

    st.file_uploader(label, type=Path(file).suffix[1:], key=key, on_change=take)
    if (error := state.get(wrong)) is not None and state[choice] is None:
        raise error
    return find_kept(file, choice, read)


def find_kept(file: str, choice: str, read: Callable[[bytes], T]) -> T | None:
    """What the address has as this choice; None if it has none. Raises as :func:`choose_kept`."""
    if (name := st.session_state[choice]) is None:
        return None
    if (content := file_store.find(name)) is None:
        raise UsageError(f"The {file} of this link is not on this server any more. Upload it again.")
    return read(content)


def show_wrong(error: CrashfuseError) -> None:
    """Show what is wrong, a sentence each."""
    sentences = shortened(error.problems) if isinstance(error, DataError) else error.args[:1]
    st.error("  \n".join(plain(sentence) for sentence in sentences), icon=":material/error:")
