"""Campaigns open on this server, each read once; visitors see their own, the server's, and those linked to."""

import os
import secrets
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.history import sample_folder
from crashfuse.campaign_folder.load import ARCHIVE, read_folder
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem
from crashfuse.execution.visitors import note_in_log
from crashfuse.results.display import Display
from crashfuse.ui.kit import visitors
from crashfuse.ui.kit.visitors import keep_for_visitor, kept_for_visitor, visitor

SAMPLE = "sample"
HASHED: dict[str | type, Callable[[Any], object]] = {Campaign: lambda campaign: campaign.fingerprint}  # in caches
_sample = st.cache_resource(show_spinner="Preparing the sample campaign …")(sample_folder)
_opening = threading.Lock()  # with the list in hand: to make it takes the lock
_FOLDERS, _MOST_RECENT = "folders", 8  # opened before, kept for the visitor


@dataclass(frozen=True)
class _Opened:
    folder: Path | None
    label: str = ""
    for_all: bool = False
    visitors: set[str] = field(default_factory=set)  # in whose lists it stands


@dataclass(frozen=True)
class View:
    """The user's choices in the sidebar, and the name of the campaign in its list."""

    campaign: Campaign
    name: str
    held_out: CrashTest
    display: Display

    @property
    def folder(self) -> Path:
        """The folder of the campaign, see :func:`folder_of`."""
        return folder_of(self.name)


@st.cache_resource
def opened_here() -> dict[str, _Opened]:
    """All that is open on this server, by name."""
    opened = {SAMPLE: _Opened(None, for_all=True)}
    if at_start := os.environ.get("CRASHFUSE_CAMPAIGN"):
        _put(Path(at_start).resolve(), opened, for_all=True)
    return opened


def open_campaigns() -> dict[str, Path | None]:
    """Folders that the visitor may choose, by name: the server's, those they opened, and that of their link."""
    me, opened = visitor().key, opened_here()
    # a link can ask for one of these names, never for a path; that of an upload cannot be guessed
    linked = opened.get(name := st.session_state.get("campaign") or "")
    if linked is not None and not linked.for_all and me not in linked.visitors:
        linked.visitors.add(me)
        note_in_log(visitor(), f"followed a link to {label(name)}")
    with _opening:  # another visitor may be opening one
        return {name: one.folder for name, one in opened.items() if one.for_all or me in one.visitors}


def at_start() -> str | None:
    """Name of the campaign that the server was started with, if any."""
    return list(opened_here())[1] if os.environ.get("CRASHFUSE_CAMPAIGN") else None


def allowed(path: Path) -> Path:
    """The path with links resolved, if pages may open or write to it by ``CRASHFUSE_ROOT``; else a DataError."""
    asked = path
    try:
        path = path.expanduser().resolve()
        outside = [] if may_open(path) else [path]
        if roots() and not outside and path.is_dir():
            outside = [link for link in _links_in(path) if not may_open(link.resolve())]
    except (OSError, RuntimeError, ValueError) as error:  # no such home directory, or an invalid folder name
        raise _unreadable(path, error) from error
    if outside:
        note_in_log(visitor(), f"was refused {outside[0]}, outside {' and '.join(map(str, roots()))}")
        expected = f"a path inside {' or '.join(map(str, roots()))}"
        found = "one outside" if outside[0] == path else f"{outside[0].name}, a link to elsewhere"
        raise DataError(Problem(str(asked), expected, found, "this server opens and writes nothing else"))
    return path


def unquoted(text: str) -> str:
    """A path as typed in, without the quotes that file managers add."""
    return text.strip().strip('"')


def typed_folder(text: str, where: str, expected: str) -> Path:
    """The folder that was typed in by its whole path, checked by :func:`allowed`."""
    typed = unquoted(text)
    if not typed.startswith("~") and not Path(typed).is_absolute():
        raise DataError(Problem(where, expected, typed or "none", "name a folder by its whole path"))
    return allowed(Path(typed))


def roots() -> list[Path]:
    """The folders that pages may open and write to, with all in them; none for no restriction."""
    return [Path(root).resolve() for root in os.environ.get(visitors.ROOTS, "").splitlines() if root]


def may_open(path: Path) -> bool:
    """True if a path, links resolved, lies where pages may open and write."""
    return not roots() or any(path.is_relative_to(root) for root in roots())


def folders_in(folder: Path) -> list[str]:
    """Names of the folders in one, as far as pages may open them; none of one that cannot be read."""
    try:
        inside = [path for path in folder.iterdir() if not path.name.startswith(".") and path.is_dir()]
        return sorted((path.name for path in inside if may_open(path.resolve())), key=str.casefold)
    except OSError:
        return []


def still_allowed(path: Path) -> Path:
    """The same path; a DataError if a link now leads out of the roots. What lay outside from the start may."""
    if roots() and may_open(path):
        allowed(path)
    return path


def _links_in(folder: Path) -> Iterator[Path]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_symlink():
                yield Path(entry.path)
            elif entry.is_dir():
                yield from _links_in(Path(entry.path))


def open_folder(folder: Path) -> str:
    """Read a folder and, if it holds a valid campaign, open it, to be offered again; returns its name."""
    folder = allowed(folder)
    read(folder)
    note_in_log(visitor(), f"opened {folder}")
    remember(folder)
    return _put(folder, opened_here(), visitor().key)


def open_uploaded(folder: Path) -> str:
    """Open a folder made of a visitor's upload, under a name that only their link tells."""
    read(folder)
    token = secrets.token_urlsafe(12)
    name = f"{folder.name}-{token}"
    opened, by = opened_here(), {visitor().key}
    with _opening:
        opened[name] = _Opened(folder.resolve(), f"{folder.name} (upload {token[:4]})", visitors=by)
    note_in_log(visitor(), f"uploaded {label(name)}")
    return name


def label(name: str) -> str:
    """What the open campaign of this name is called where others may read it."""
    return opened_here()[name].label or name


def load(name: str) -> Campaign:
    """The open campaign of this name, read again only if its files have changed."""
    return read(folder_of(name))


def folder_of(name: str) -> Path:
    """The folder of the open campaign of this name; a DataError if pages may not open it any more."""
    folder = opened_here()[name].folder
    return _sample() if folder is None else still_allowed(folder)


def read(folder: Path) -> Campaign:
    """The campaign in this folder, shared by all sessions; a DataError says what is wrong."""
    try:
        return _read(folder, (data_stamp(folder), *(stamp(path) for path in folder.glob(ARCHIVE))))
    except OSError as error:
        raise _unreadable(folder, error) from error


def stamp(path: Path) -> tuple[int, ...]:
    """Changes whenever a file does, even for another of equal size and time."""
    stat = path.stat()
    return stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino


def _put(folder: Path, opened: dict[str, _Opened], *visitors: str, for_all: bool = False) -> str:
    with _opening:
        for name, one in opened.items():
            if one.folder == folder:
                one.visitors.update(visitors)
                return name
        name, number = folder.name or "campaign", 2
        while name in opened:
            name, number = f"{folder.name} ({number})", number + 1
        opened[name] = _Opened(folder, for_all=for_all, visitors=set(visitors))
        return name


def _unreadable(folder: Path, error: Exception) -> DataError:
    return DataError(Problem(str(folder), "a folder that can be read", str(error), "check the path and your rights"))


@st.cache_resource(max_entries=4, show_spinner="Reading the campaign …")
def _read(folder: Path, stamp: tuple[object, ...]) -> Campaign:  # noqa: ARG001  (part of the key)
    return read_folder(folder)


def data_stamp(folder: Path) -> tuple[object, ...]:
    """Changes whenever tests, CAE runs or settings of a campaign do."""
    patterns = ("tests.csv", "cae.csv", "campaign.toml", "*_pulses.*", "*_wall.*", "tests/*", "cae/*")
    files = sorted(path for pattern in patterns for path in folder.glob(pattern))
    return tuple((path.name, *stamp(path)) for path in files)


def recent_folders() -> tuple[Path, ...]:
    """The folders that the visitor opened, the last one first, as far as they are there and pages may open them."""
    there = []
    for folder in map(Path, kept_for_visitor().get(_FOLDERS, ())):
        with suppress(OSError, ValueError):
            there += [folder] * (folder.is_absolute() and may_open(folder) and folder.is_dir())
    return tuple(there)


def remember(folder: Path) -> None:
    """Put a folder first."""
    others = (other for other in kept_for_visitor().get(_FOLDERS, ()) if other != str(folder))
    keep_for_visitor(_FOLDERS, *[str(folder), *others][:_MOST_RECENT])


def folder_labels(folders: tuple[Path, ...]) -> list[str]:
    """Their names, where two are equal with the parent's."""
    names = [path.name for path in folders]
    return [path.name if names.count(path.name) == 1 else f"{path.parent.name}/{path.name}" for path in folders]
