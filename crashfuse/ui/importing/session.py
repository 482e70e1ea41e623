"""The source of foreign files being imported in a session; it is read once for everything drawn from it."""

import shutil
import uuid
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import streamlit as st

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import DataError, Problem
from crashfuse.importing import Choices, Reading, Settled, format_of, read_each, settle_each
from crashfuse.importing.sources import is_archive, tables_of
from crashfuse.importing.tables import TableForm, table_forms
from crashfuse.readers.formats import TABLES
from crashfuse.readers.record import Record
from crashfuse.ui import campaigns
from crashfuse.ui.visitors import visitor

_KEY, _SOURCE = "import", "import source"  # session keys, like the next; the first stands in the address
REFUSED, UNFINISHED = "import refused", "import unfinished"
NEXT_ROLE = "import next"  # what the campaign started by an import still lacks
_MOST_FILES = 20_000


@dataclass(frozen=True, slots=True)
class Source:
    """Foreign files on the server's disk.

    Parameters
    ----------
    key : str
        Identifies this import: prefix of the keys of its widgets.
    owner : str
        Key of the visitor who began it; whoever follows their link may continue it as well.
    scratch : Path, optional
        Folder to delete when the owner's import is over; None for the user's own files.
    """

    path: Path
    fmt: str
    key: str
    owner: str
    scratch: Path | None = None

    @property
    def several(self) -> bool:
        """True if these are several uploads, which have no common name."""
        return self.scratch is not None and self.path.parent == self.scratch


def source_at(path: Path, scratch: Path | None = None) -> Source:
    """Start the import of this file or folder; a DataError if it has no known format, or far too many files."""
    if path.is_dir() and sum(1 for _ in islice(path.rglob("*"), _MOST_FILES + 1)) > _MOST_FILES:
        advice = "name the folder of the tests or runs itself, or use crashfuse import"
        raise DataError(Problem(str(path), f"at most {_MOST_FILES} files", "more", advice))
    fmt = format_of(path)
    if fmt == TABLES and is_archive(path.name):  # so that the columns of each table can be asked for
        advice = "upload it, or unpack it and name its folder"
        raise DataError(Problem(path.name, "a file or folder to import", "tables in an archive", advice))
    return Source(path, fmt, uuid.uuid4().hex, visitor().key, scratch)


def begin(source: Source) -> None:
    """Switch the Data page to the import of a source; call it from a callback."""
    leave()
    st.session_state[_SOURCE] = source
    st.session_state[_KEY] = source.key


def leave() -> None:
    """End the import; whoever began it deletes its temporary files, too."""
    source = st.session_state.get(_SOURCE)
    st.session_state[_KEY] = None
    for key in (_SOURCE, REFUSED, UNFINISHED):
        st.session_state.pop(key, None)
    if source is None or source.owner != visitor().key:
        return
    _begun().pop(source.key, None)
    if source.scratch is not None:
        shutil.rmtree(source.scratch, ignore_errors=True)


def left_aside(source: Source) -> list[str]:
    """Names of files among the tables of an import that are none, and that nothing is read from."""
    if source.fmt != TABLES or not source.path.is_dir():
        return []
    known = {path.resolve() for path in tables_of(source.path)}
    files = (path for path in sorted(source.path.rglob("*")) if path.is_file())
    return [path.name for path in files if path.resolve() not in known]


def running() -> Source | None:
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
    """Imports in progress by key, with the fields filled in, so that a new session can continue one."""
    return {}


@st.cache_resource(max_entries=4, show_spinner="Looking at the tables …")
def forms_of(source: Source) -> tuple[TableForm, ...]:
    """Tables of a source, grouped by header."""
    return table_forms(tables_of(campaigns.still_allowed(source.path)))


@st.cache_resource(max_entries=4, show_spinner="Reading …")
def records_of(source: Source, reading: Reading) -> tuple[tuple[Record, ...], tuple[Problem, ...]]:
    """Records of a source, from :func:`read_each`; the source is part of the key, so each import reads anew."""
    campaigns.still_allowed(source.path)
    return read_each(reading)


@st.cache_resource(max_entries=8, show_spinner="Settling …")
def settled_of(
    source: Source, reading: Reading, choices: Choices, role: Role, cae: tuple[str, ...], *, raw: bool = False
) -> tuple[tuple[Settled, ...], tuple[Problem, ...]]:
    """Settled records of a source, from :func:`settle_each`."""
    records, problems = records_of(source, reading)
    refused: list[Problem] = []
    settled = settle_each(records, refused, choices, role=role, cae=cae, raw=raw, tolerant=True)
    return settled, (*problems, *refused)
