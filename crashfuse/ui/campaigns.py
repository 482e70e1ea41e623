"""Campaigns open on this server, each read once and shared by all sessions."""

import os
import tempfile
import threading
from pathlib import Path

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.folder import load_campaign
from crashfuse.errors import DataError, Problem
from crashfuse.execution.cache import default_folder
from crashfuse.synthetic import write_sample

SAMPLE = "sample"
_SHIPPED = Path(__file__).parents[2] / "sample_data"
_opening = threading.Lock()


@st.cache_resource
def open_campaigns() -> dict[str, Path | None]:
    """Folders to choose from, by name: the sample, the campaign given at start-up, and those opened since.

    A link can ask for one of these names, never for a path.
    """
    folders: dict[str, Path | None] = {SAMPLE: None}
    if at_start := os.environ.get("CRASHFUSE_CAMPAIGN"):
        _put(Path(at_start).resolve(), folders)
    return folders


def at_start() -> str | None:
    """Name of the campaign that the server was started with, if any."""
    return list(open_campaigns())[1] if os.environ.get("CRASHFUSE_CAMPAIGN") else None


def open_folder(folder: Path) -> str:
    """Read a folder and, if it holds a valid campaign, open it; returns its name."""
    try:
        folder = folder.expanduser().resolve()
    except (OSError, RuntimeError, ValueError) as error:  # no such home directory, or an invalid folder name
        raise _unreadable(folder, error) from error
    read(folder)
    with _opening:
        return _put(folder, open_campaigns())


def load(name: str) -> Campaign:
    """The open campaign of this name, read again only if its files have changed."""
    return read(folder_of(name))


def folder_of(name: str) -> Path:
    """The folder of the open campaign of this name."""
    return open_campaigns()[name] or _sample_folder()


def read(folder: Path) -> Campaign:
    """The campaign in this folder, its arrays read-only and shared by all sessions; a DataError says what is wrong."""
    try:
        return _read(folder, _stamp(folder))
    except OSError as error:
        raise _unreadable(folder, error) from error


def is_sample(folder: Path) -> bool:
    """True if a folder is the sample's or lies inside it: nothing may be added there."""
    return bool({folder, *folder.parents} & {_SHIPPED.resolve(), (default_folder() / SAMPLE).resolve()})


def _put(folder: Path, folders: dict[str, Path | None]) -> str:
    """Register a folder under its own name, numbered if that name is taken; returns the name."""
    for name, other in folders.items():
        if other == folder:
            return name
    name, number = folder.name or "campaign", 2
    while name in folders:
        name, number = f"{folder.name} ({number})", number + 1
    folders[name] = folder
    return name


def _unreadable(folder: Path, error: Exception) -> DataError:
    return DataError(Problem(str(folder), "a folder that can be read", str(error), "check the path and your rights"))


@st.cache_resource(max_entries=4, show_spinner="Reading the campaign …")
def _read(folder: Path, stamp: tuple[object, ...]) -> Campaign:  # noqa: ARG001  (part of the key)
    return load_campaign(folder)


def _stamp(folder: Path) -> tuple[object, ...]:
    """Name, size and time of every file that can belong to a campaign: changes whenever one of them does."""
    patterns = ("tests.csv", "cae.csv", "campaign.toml", "*_pulses.*", "tests/*", "cae/*")
    files = sorted(path for pattern in patterns for path in folder.glob(pattern))
    return tuple((path.name, stat.st_size, stat.st_mtime_ns) for path in files for stat in [path.stat()])


@st.cache_resource(show_spinner="Preparing the sample campaign …")
def _sample_folder() -> Path:
    if (_SHIPPED / "tests.csv").is_file():
        return _SHIPPED
    folder = default_folder() / "sample"
    if not (folder / "tests.csv").is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
            write_sample(Path(scratch) / "sample")
            (Path(scratch) / "sample").rename(folder)  # all or nothing
    return folder
