"""Atomic writing: no reader ever sees part of a file, or part of a set of files."""

import os
import platform
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

_UNFINISHED = re.compile(r"\.unfinished-(?P<host>.+)-(?P<process>\d+)-[0-9a-f]{32}")
_HOST = re.sub(r"[^\w.-]", "_", platform.node()) or "here"
_LONG_S = 3600.0  # no write takes that long


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
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        _name(error, temporary, path)
        raise


@contextmanager
def written_together(folder: Path, last: str) -> Iterator[Path]:
    """A folder to write a set of files into: all of them move to ``folder`` once each is complete, or none does.

    The file named ``last`` moves last. Until it lists the others, the set is incomplete, so a crash between two moves
    can be detected.
    """
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
        _name(error, home, folder)
        raise


def _name(error: BaseException, temporary: Path, target: Path) -> None:
    """Let a system error name what was to be written: a full disk names nothing, and temporary names say nothing."""
    if isinstance(error, OSError) and error.errno and str(error.filename or temporary).startswith(str(temporary)):
        error.filename = str(target)


def _unfinished(folder: Path) -> Path:
    """A temporary name for what this process is about to write there."""
    _sweep(folder)
    return folder / f".unfinished-{_HOST}-{os.getpid()}-{uuid.uuid4().hex}"


@cache  # once per process is enough
def _sweep(folder: Path) -> None:
    """Remove temporary files left by killed processes."""
    for path in folder.glob(".unfinished-*"):
        name = _UNFINISHED.fullmatch(path.name)
        with suppress(OSError):
            if name and (
                (name["host"] == _HOST and not _is_alive(int(name["process"])))
                or time.time() - path.stat().st_mtime > _LONG_S
            ):
                shutil.rmtree(path) if path.is_dir() else path.unlink()


def _is_alive(process: int) -> bool:
    """Whether a process with this id exists; True where that cannot be checked."""
    if sys.platform != "win32":  # on Windows os.kill would end it
        with suppress(PermissionError):
            try:
                os.kill(process, 0)
            except ProcessLookupError:
                return False
    return True
