"""Uploaded criteria and matrices, and what is wrong with them."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import streamlit as st

from crashfuse.errors import CrashfuseError, DataError
from crashfuse.ui.text import plain

T = TypeVar("T")

_MOST = 10  # sentences


def uploaded(content: bytes, name: str, read: Callable[[Path], T]) -> T:
    """Read an uploaded file's content by a function of the library, which takes a path; messages give it this name."""
    with tempfile.TemporaryDirectory(prefix="crashfuse-") as folder:
        path = Path(folder, name)
        path.write_bytes(content)
        return read(path)


def show_wrong(error: CrashfuseError) -> None:
    """Show what is wrong, a sentence each."""
    sentences = [str(problem) for problem in error.problems] if isinstance(error, DataError) else [error.args[0]]
    more = [f"{len(sentences) - _MOST} more like these."] if len(sentences) > _MOST else []
    st.error("  \n".join(plain(sentence) for sentence in [*sentences[:_MOST], *more]), icon=":material/error:")
