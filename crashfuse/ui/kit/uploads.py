"""Files from the browser, deleted when the server ends or as the next one starts, and foreign files imported."""

import atexit
import hashlib
import shutil
import tempfile
import time
import uuid
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePath
from typing import Any, TypeVar

import streamlit as st
from filelock import FileLock, Timeout
from streamlit.runtime.uploaded_file_manager import UploadedFile

from crashfuse.campaign_folder.condition_tables import TABLES as CAMPAIGN_TABLES
from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.campaign_folder.history import is_sample
from crashfuse.campaign_folder.load import lay_out
from crashfuse.errors import DataError, Problem
from crashfuse.execution.cache import default_folder
from crashfuse.importing import Choices, Reading, Settled, format_of, read_each, settle_each
from crashfuse.importing.sources import TableForm, is_archive, lay_out_source, members_of, table_forms, tables_of
from crashfuse.readers.formats import TABLES, formats_of
from crashfuse.readers.record import Record
from crashfuse.ui.kit import campaigns
from crashfuse.ui.kit.visitors import visitor

_KEY, _SOURCE = "import", "import source"  # session keys, like the next; the first stands in the address
IMPORT_REFUSED, IMPORT_UNFINISHED = "import refused", "import unfinished"
NEXT_ROLE = "import next"  # what the campaign started by an import still lacks
_MOST_FILES = 20_000
T = TypeVar("T")
_SCRATCH, _LOCK = "crashfuse-uploads-", ".lock"  # of the folder, and beside it
_STARTING_S = 10  # between making a lock file and locking it
_UNLOCKED_S = 86400.0  # a folder without its lock file may be of a server whose lock a cleaner of old files took


@dataclass(frozen=True, slots=True)
class Source:
    """Foreign files on the server's disk."""

    path: Path
    fmt: str
    key: str  # identifies this import: prefix of the keys of its widgets
    owner: str  # key of the visitor who began it; whoever follows their link may continue it as well
    scratch: Path | None = None  # folder to delete when the owner's import is over; None for the user's own files


def source_at(path: Path, scratch: Path | None = None) -> Source:
    """Start the import of a file or folder; a DataError if it has no known format, or too many files."""
    if path.is_dir() and sum(1 for _ in islice(path.rglob("*"), _MOST_FILES + 1)) > _MOST_FILES:
        advice = "name the folder of the tests or runs itself, or use crashfuse import"
        raise DataError(Problem(str(path), f"at most {_MOST_FILES} files", "more", advice))
    fmt = format_of(path)
    if fmt == TABLES and is_archive(path.name):  # so that the columns of each table can be asked for
        advice = "upload it, or unpack it and name its folder"
        raise DataError(Problem(path.name, "a file or folder to import", "tables in an archive", advice))
    return Source(path, fmt, uuid.uuid4().hex, visitor().key, scratch)


def begin_import(source: Source) -> None:
    """Switch the Data page to the import of a source; call it from a callback."""
    leave_import()
    st.session_state[_SOURCE] = source
    st.session_state[_KEY] = source.key


def leave_import() -> None:
    """End the import; whoever began it deletes its temporary files, too."""
    source = st.session_state.get(_SOURCE)
    st.session_state[_KEY] = None
    for key in (_SOURCE, IMPORT_REFUSED, IMPORT_UNFINISHED):
        st.session_state.pop(key, None)
    if source is None or source.owner != visitor().key:
        return
    _begun().pop(source.key, None)
    if source.scratch is not None:
        shutil.rmtree(source.scratch, ignore_errors=True)


def left_aside(source: Source) -> list[str]:
    """Names of files among the tables of an import that are none."""
    if source.fmt != TABLES or not source.path.is_dir():
        return []
    known = {path.resolve() for path in tables_of(source.path)}
    files = (path for path in sorted(source.path.rglob("*")) if path.is_file())
    return [path.name for path in files if path.resolve() not in known]


def running_import() -> Source | None:
    """The source being imported in this session, or before the browser reloaded the page."""
    source: Source | None = st.session_state.get(_SOURCE)
    if source is None or source.key != st.session_state[_KEY]:  # never begun here, or left by Back
        source, filled_in = _begun().get(st.session_state[_KEY] or "", (None, {}))
        st.session_state[_KEY] = None if source is None else source.key
        if source is None:
            return None
        st.session_state[_SOURCE] = source
        st.session_state.update(filled_in)
    state = st.session_state.to_dict()
    _begun()[source.key] = source, {key: state[key] for key in state if key.startswith((source.key, f"{_KEY} "))}
    return source


@st.cache_resource
def _begun() -> dict[str, tuple[Source, dict[str, Any]]]:
    return {}


@st.cache_resource(max_entries=4, show_spinner="Looking at the tables …")
def forms_of(source: Source) -> tuple[TableForm, ...]:
    """Tables of a source, grouped by header."""
    return table_forms(tables_of(campaigns.still_allowed(source.path)))


@st.cache_resource(max_entries=4, show_spinner="Reading …")
def records_of(source: Source, reading: Reading) -> tuple[tuple[Record, ...], tuple[Problem, ...]]:
    """Records of a source, which each import reads anew."""
    campaigns.still_allowed(source.path)
    return read_each(reading)


@st.cache_resource(max_entries=8, show_spinner="Settling …")
def settled_of(
    source: Source, reading: Reading, choices: Choices, role: Role, cae: tuple[str, ...], *, raw: bool = False
) -> tuple[tuple[Settled, ...], tuple[Problem, ...]]:
    """Settled records of a source."""
    records, problems = records_of(source, reading)
    refused: list[Problem] = []
    settled = settle_each(records, refused, choices, role=role, cae=cae, raw=raw, tolerant=True)
    return settled, (*problems, *refused)


def open_uploads(files: Sequence[UploadedFile]) -> str | Source:
    """Open uploads as a campaign, whose name is returned, or keep them to be imported."""
    if not files:  # none was dropped, or the browser refused those that are too large
        expected = f"files of at most {st.get_option('server.maxUploadSize')} MB each"
        advice = "choose the files, and open a larger campaign as a folder"
        raise DataError(Problem("upload", expected, "none", advice))
    uploads = [(file.name, file.getvalue()) for file in files]
    if _are_foreign(uploads):
        return _keep(lambda own: source_at(lay_out_source(uploads, own), scratch=own))
    opened = _opened()
    key = visitor().key, tuple(sorted((name, hashlib.sha256(content).hexdigest()) for name, content in uploads))
    if key not in opened:
        opened[key] = _keep(lambda own: campaigns.open_uploaded(lay_out(uploads, own)))
        fingerprint = campaigns.load(opened[key]).fingerprint
        with suppress(OSError):  # in the cache folder, as results outlive uploads; none is kept there either
            _noted().mkdir(parents=True, exist_ok=True)
            (_noted() / fingerprint).touch()
    return opened[key]


def uploaded_data() -> set[str]:
    """Fingerprints of uploaded data, whose past results are not for everybody."""
    return {path.name for path in _noted().glob("*")}


def is_ours(folder: Path) -> bool:
    """True if a folder is not the user's own: the sample or an upload."""
    return is_sample(folder) or _scratch().resolve() in folder.parents


def _noted() -> Path:
    return default_folder() / "uploaded"


def _are_foreign(uploads: Sequence[tuple[str, bytes]]) -> bool:
    names: list[PurePath] = []
    for name, content in uploads:
        names += [member.path for member in members_of(name, content)] if is_archive(name) else [PurePath(name)]
    return {path.name for path in names}.isdisjoint(CAMPAIGN_TABLES) and bool(formats_of(names))


def _keep(lay_out_in: Callable[[Path], T]) -> T:
    try:
        sweep_uploads()  # of servers that were killed too shortly before this one started
        folder = Path(tempfile.mkdtemp(dir=_scratch()))
        try:
            return lay_out_in(folder)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
    except OSError as error:
        expected = "room to unpack it on the server's disk"
        raise DataError(Problem("upload", expected, error.strerror or "none", "free some space")) from error


@st.cache_resource
def _opened() -> dict[Hashable, str]:
    return {}


@st.cache_resource(show_spinner=False)
def _scratch() -> Path:
    folder = Path(tempfile.mkdtemp(prefix=_SCRATCH))
    lock = FileLock(folder.with_suffix(_LOCK), thread_local=False)
    lock.acquire()
    atexit.register(_remove, folder, lock)
    return folder


def sweep_uploads() -> None:
    """Delete the uploads of servers that were killed: the system has freed their locks."""
    for folder in {path.with_suffix("") for path in Path(tempfile.gettempdir()).glob(f"{_SCRATCH}*")}:
        file = folder.with_suffix(_LOCK)
        with suppress(OSError, Timeout):  # another user's, or of a server that runs
            age_s = time.time() - (file if file.exists() else folder).stat().st_mtime
            if age_s > (_STARTING_S if file.exists() else _UNLOCKED_S):
                lock = FileLock(file, thread_local=False)
                lock.acquire(timeout=0)
                _remove(folder, lock)


def _remove(folder: Path, lock: FileLock) -> None:
    lock.release()
    shutil.rmtree(folder, ignore_errors=True)
    folder.with_suffix(_LOCK).unlink(missing_ok=True)
