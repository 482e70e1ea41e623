"""Uploads from the browser, in a temporary folder that is deleted when the server ends, else as the next one starts.

Beyond 8 GiB, those go that nobody has looked at for longest.
"""

import atexit
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path, PurePath
from typing import Protocol, TypeVar

import streamlit as st
from filelock import FileLock, Timeout

from crashfuse.campaign_folder.condition_tables import TABLES
from crashfuse.campaign_folder.history import is_sample
from crashfuse.campaign_folder.load import lay_out
from crashfuse.errors import DataError, Problem
from crashfuse.execution.cache import default_folder
from crashfuse.importing.sources import is_archive, lay_out_source, members_of
from crashfuse.readers.formats import formats_of
from crashfuse.ui import campaigns
from crashfuse.ui.importing.session import Source, source_at
from crashfuse.ui.visitors import visitor

T = TypeVar("T")

_SCRATCH, _LOCK = "crashfuse-uploads-", ".lock"  # of the folder, and beside it
_STARTING_S = 10  # between making a lock file and locking it
_MOST_BYTES = 8 << 30
_IN_USE_S = 4 * 3600.0  # since somebody looked at it; a session may pause over noon


class Upload(Protocol):
    """A file as Streamlit provides it."""

    name: str

    def getvalue(self) -> bytes:
        """The file's content."""


def open_uploads(files: Sequence[Upload]) -> str | Source:
    """Open the uploaded files if they are a valid campaign; returns its name.

    Files of a foreign format are stored to be imported instead. A DataError lists everything that is wrong; nothing is
    kept then.
    """
    if not files:  # none was dropped, or the browser refused those that are too large
        expected = f"files of at most {st.get_option('server.maxUploadSize')} MB each"
        advice = "choose the files, and open a larger campaign as a folder"
        raise DataError(Problem("upload", expected, "none", advice))
    uploads = [(file.name, file.getvalue()) for file in files]
    if _are_foreign(uploads):
        return _keep(lambda own: source_at(lay_out_source(uploads, own), scratch=own))
    digest = hashlib.sha256()
    for name, content in sorted(uploads):
        digest.update(f"{name}|{len(content)}|".encode())
        digest.update(content)
    opened = _opened()
    key = visitor().key, digest.hexdigest()
    if key not in opened:
        opened[key] = _keep(lambda own: campaigns.open_uploaded(lay_out(uploads, own)))
        _note(campaigns.fingerprint_of(opened[key]))
    return opened[key]


def uploaded() -> set[str]:
    """Fingerprints of all data that were ever uploaded: past results of them are not for everybody's list."""
    return {path.name for path in _noted().glob("*")}


def is_ours(folder: Path) -> bool:
    """True if a folder is not the user's own: the sample, or an upload, which goes when the server ends."""
    return is_sample(folder) or _scratch().resolve() in folder.parents


def _note(fingerprint: str) -> None:
    """Note that these data were uploaded, in the cache folder: results of them outlive the upload there."""
    with suppress(OSError):  # no result is kept there either
        _noted().mkdir(parents=True, exist_ok=True)
        (_noted() / fingerprint).touch()


def _noted() -> Path:
    return default_folder() / "uploaded"


def _are_foreign(uploads: Sequence[tuple[str, bytes]]) -> bool:
    """True if no campaign table is among the files, but something that can be imported."""
    names: list[PurePath] = []
    for name, content in uploads:
        if is_archive(name):
            names += [member.path for member in members_of(name, content)]
        else:
            names.append(PurePath(name))
    return {path.name for path in names}.isdisjoint(TABLES) and bool(formats_of(names))


def _keep(lay_out_in: Callable[[Path], T]) -> T:
    """Store uploads in a new folder, which is removed if that fails."""
    try:
        _make_room()
        own = Path(tempfile.mkdtemp(dir=_scratch()))
        try:
            return lay_out_in(own)
        except BaseException:
            shutil.rmtree(own, ignore_errors=True)
            raise
    except OSError as error:
        expected = "room to unpack it on the server's disk"
        raise DataError(Problem("upload", expected, error.strerror or "none", "free some space")) from error


def note_use(folder: Path) -> None:
    """Note that somebody looks at a campaign: an upload is kept as long as anybody does."""
    for path in (folder, *folder.parents):
        if path.parent == _scratch().resolve():
            with suppress(OSError):
                os.utime(path)


def _make_room() -> None:
    """Delete the uploads that nobody has looked at for longest until the rest fits, but none of the last hours."""
    uploads = sorted((own.stat().st_mtime, own) for own in _scratch().iterdir())
    sizes = {own: sum(path.stat().st_size for path in own.rglob("*") if path.is_file()) for _, own in uploads}
    excess = sum(sizes.values()) - _MOST_BYTES
    for used, own in uploads:
        if excess <= 0 or time.time() - used < _IN_USE_S:
            break
        for key, name in list(_opened().items()):
            if own.resolve() in campaigns.folder_of(name).parents:
                del _opened()[key]
                campaigns.close(name)
        shutil.rmtree(own, ignore_errors=True)
        excess -= sizes[own]


@st.cache_resource
def _opened() -> dict[tuple[str, str], str]:
    """Names of uploaded campaigns by visitor and content: a file dropped twice is one campaign."""
    return {}


@st.cache_resource(show_spinner=False)
def _scratch() -> Path:
    folder = Path(tempfile.mkdtemp(prefix=_SCRATCH))
    lock = FileLock(folder.with_suffix(_LOCK), thread_local=False)
    lock.acquire()
    atexit.register(_remove, folder, lock)
    return folder


def sweep() -> None:
    """Delete the uploads of servers that were killed: the system has freed their locks."""
    for file in Path(tempfile.gettempdir()).glob(f"{_SCRATCH}*{_LOCK}"):
        with suppress(OSError, Timeout):  # another user's, or of a server that runs
            if time.time() - file.stat().st_mtime > _STARTING_S:
                lock = FileLock(file, thread_local=False)
                lock.acquire(timeout=0)
                _remove(file.with_suffix(""), lock)


def _remove(folder: Path, lock: FileLock) -> None:
    lock.release()
    shutil.rmtree(folder, ignore_errors=True)
    folder.with_suffix(_LOCK).unlink(missing_ok=True)
