"""Atomic writing: no reader ever sees part of a file, or part of a set of files."""

import os
import re
import shutil
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from crashfuse.errors import DataError, Problem

_UNFINISHED = re.compile(r"\.unfinished-(.+-)?[0-9a-f]{32}")
_LONG_S = 86400.0  # no write takes that long


def write_atomically(path: Path, content: bytes) -> None:
    """Write to a temporary name in the same folder, then rename: readers see the old file or the new one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder to write to; it replaces the file once it is completely on the disk."""
    temporary = _unfinished(path.parent)
    try:
        yield temporary
        flush(temporary)
        temporary.replace(path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        name_target(error, temporary, path)
        raise


def flush(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk for good."""
    is_folder, windows = path.is_dir(), sys.platform == "win32"
    if is_folder and windows:
        return  # it keeps names by itself, and opens no folder
    descriptor = os.open(path, os.O_RDWR if windows else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError:
        if not is_folder:  # some shares cannot
            raise
    finally:
        os.close(descriptor)


@contextmanager
def written_together(folder: Path, last: str) -> Iterator[Path]:
    """A folder to write files into that move to ``folder`` together, ``last`` last, as it makes them complete."""
    folder.mkdir(parents=True, exist_ok=True)
    staging = _unfinished(folder)
    try:
        staging.mkdir()
        yield staging
        for path in sorted((p for p in staging.rglob("*") if p.is_file()), key=lambda p: p.name == last):
            target = folder / path.relative_to(staging)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder to write into, renamed to ``folder`` once complete; an empty folder may already be there."""
    folder = folder.resolve()
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise DataError(Problem(str(folder), "a folder that holds nothing yet", "one that does", "choose another"))
    folder.parent.mkdir(parents=True, exist_ok=True)
    home = _unfinished(folder.parent)
    try:
        home.mkdir()
        yield home
        if folder.exists():
            folder.rmdir()
        home.rename(folder)
    except BaseException as error:
        shutil.rmtree(home, ignore_errors=True)
        name_target(error, home, folder)
        raise


def name_target(error: BaseException, temporary: Path, target: Path) -> None:
    """Let a system error name what was to be written, not a temporary name."""
    if isinstance(error, OSError) and error.errno and str(error.filename or temporary).startswith(str(temporary)):
        error.filename = str(target)


def _unfinished(folder: Path) -> Path:
    _sweep(folder)
    return folder / f".unfinished-{uuid.uuid4().hex}"


@cache  # once per process is enough
def _sweep(folder: Path) -> None:
    """Remove what killed processes left long ago, told by its age: machines that share a folder see only their own."""
    for path in folder.glob(".unfinished-*"):
        with suppress(OSError):
            if _UNFINISHED.fullmatch(path.name) and time.time() - path.stat().st_mtime > _LONG_S:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
