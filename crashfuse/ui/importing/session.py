"""A source of foreign files that is being imported, and reading it once for all that is drawn of it."""

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
from crashfuse.importing.sources import tables_of
from crashfuse.importing.table_forms import TableForm, table_forms
from crashfuse.readers.formats import TABLES
from crashfuse.readers.record import Record

_SOURCE = "import"  # in the session, as the next two
REFUSED, UNFINISHED = "import refused", "import unfinished"
NEXT_ROLE = "import next"  # what the campaign that was begun still lacks
_MOST_FILES = 20_000


@dataclass(frozen=True, slots=True)
class Source:
    """Foreign files on the server's disk.

    Parameters
    ----------
    key : str
        Of this import: begins the keys of its widgets.
    scratch : Path, optional
        What to delete when the import is over; None for files of the user's own.
    """

    path: Path
    fmt: str
    key: str
    scratch: Path | None = None

    @property
    def several(self) -> bool:
        """Whether these are several uploads, which have no name in common."""
        return self.scratch is not None and self.path.parent == self.scratch


def source_at(path: Path, scratch: Path | None = None) -> Source:
    """Begin an import of this file or folder; a DataError if nothing there is of a known format, or far too much."""
    if path.is_dir() and sum(1 for _ in islice(path.rglob("*"), _MOST_FILES + 1)) > _MOST_FILES:
        advice = "name the folder of the tests or runs itself, or use crashfuse import"
        raise DataError(Problem(str(path), f"at most {_MOST_FILES} files", "more", advice))
    fmt = format_of(path)
    if fmt == TABLES and path.suffix.lower() == ".zip":  # its tables' columns are asked for one by one
        advice = "upload it, or unpack it and name its folder"
        raise DataError(Problem(path.name, "a file or folder to import", "tables in a zip", advice))
    return Source(path, fmt, uuid.uuid4().hex, scratch)


def begin(source: Source) -> None:
    """Turn the page Data to the import of a source; to be called from a callback."""
    leave()
    st.session_state[_SOURCE] = source
    st.query_params[_SOURCE] = source.key


def leave() -> None:
    """End the import, and delete what was laid out for it."""
    source = st.session_state.get(_SOURCE)
    st.query_params.pop(_SOURCE, None)
    for key in (_SOURCE, REFUSED, UNFINISHED):
        st.session_state.pop(key, None)
    if source is None:
        return
    _begun().pop(source.key, None)
    if source.scratch is not None:
        shutil.rmtree(source.scratch, ignore_errors=True)


def running() -> Source | None:
    """The source that is being imported in this session, or was before the browser loaded its page anew."""
    source: Source | None = st.session_state.get(_SOURCE)
    if source is None:
        source, filled_in = _begun().get(st.query_params.get(_SOURCE, ""), (None, {}))
        if source is None:
            return None
        st.session_state[_SOURCE] = source
        st.session_state.update(filled_in)
    if st.query_params.get(_SOURCE) != source.key:
        st.query_params[_SOURCE] = source.key
    state = st.session_state.to_dict()
    _begun()[source.key] = source, {key: state[key] for key in state if key.startswith((source.key, f"{_SOURCE} "))}
    return source


@st.cache_resource
def _begun() -> dict[str, tuple[Source, dict[str, Any]]]:
    """Imports that are under way, by their keys, with what is filled in: a new session may go on with one."""
    return {}


@st.cache_resource(max_entries=4, show_spinner="Looking at the tables …")
def forms_of(source: Source) -> tuple[TableForm, ...]:
    """Tables in a source by their headers."""
    return table_forms(tables_of(source.path))


@st.cache_resource(max_entries=4, show_spinner="Reading …")
def records_of(source: Source, reading: Reading) -> tuple[tuple[Record, ...], tuple[Problem, ...]]:  # noqa: ARG001
    """Records of a source, as :func:`read_each` has them; the source is part of the key, so each import reads anew."""
    return read_each(reading)


@st.cache_resource(max_entries=8, show_spinner="Settling …")
def settled_of(
    source: Source, reading: Reading, choices: Choices, role: Role, *, raw: bool = False
) -> tuple[tuple[Settled, ...], tuple[Problem, ...]]:
    """What comes of the records of a source, as :func:`settle_each` has it."""
    records, problems = records_of(source, reading)
    refused: list[Problem] = []
    settled = settle_each(records, refused, choices, role=role, raw=raw, tolerant=True)
    return settled, (*problems, *refused)
