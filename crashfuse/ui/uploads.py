"""Campaigns that come through the browser: laid out in a folder of the server's own, which goes when it ends."""

import atexit
import hashlib
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import streamlit as st

from crashfuse.errors import DataError, Problem
from crashfuse.formats.upload import lay_out
from crashfuse.ui import campaigns


class Upload(Protocol):
    """A file as Streamlit hands it over."""

    name: str

    def getvalue(self) -> bytes:
        """All that it holds."""


def open_uploads(files: Sequence[Upload]) -> str:
    """Put what was uploaded on the shelf if it is a sound campaign; returns its name there.

    Raises
    ------
    DataError
        With everything that is wrong with it; nothing of it is kept.
    """
    if not files:  # none was dropped, or the browser kept back what is too large
        expected = f"files of at most {st.get_option('server.maxUploadSize')} MB each"
        advice = "choose the files, and open a larger campaign as a folder"
        raise DataError(Problem("upload", expected, "none", advice))
    uploads = [(file.name, file.getvalue()) for file in files]
    digest = hashlib.sha256()
    for name, content in sorted(uploads):
        digest.update(f"{name}|{len(content)}|".encode())
        digest.update(content)
    opened = _opened()
    key = digest.hexdigest()
    if key not in opened:
        opened[key] = _open(uploads)
    return opened[key]


def _open(uploads: Sequence[tuple[str, bytes]]) -> str:
    try:
        own = Path(tempfile.mkdtemp(dir=_scratch()))
        try:
            return campaigns.open_folder(lay_out(uploads, own))
        except BaseException:
            shutil.rmtree(own, ignore_errors=True)
            raise
    except OSError as error:
        expected = "room to unpack it on the server's disk"
        raise DataError(Problem("upload", expected, error.strerror or "none", "free some space")) from error


@st.cache_resource
def _opened() -> dict[str, str]:
    """Names on the shelf of what was uploaded, by its content: a file dropped twice is one campaign."""
    return {}


@st.cache_resource(show_spinner=False)
def _scratch() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="crashfuse-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
