"""Writing that loses nothing: no reader sees part of a file or set; one writer at a time, whose lock dies with it."""

import os
import platform
import re
import shutil
import stat
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from filelock import FileLock, Timeout

from crashfuse.errors import printable, refusal

NAME = ".in-use"  # the lock of a folder, in it: whoever can write to the folder sees it, whatever their cache

_GLANCE_S = 0.2
_FOR_ALL = 0o666  # the next user of a shared folder must be able to open what a killed process of this one left
_UNFINISHED = re.compile(r"\.unfinished-(.+-)?[0-9a-f]{32}")
_LONG_S = 86400.0  # no write takes that long


def write_atomically(path: Path, content: bytes) -> None:
    """Write to a temporary name in the same folder, then rename: readers see the old file or the new one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def replacing(path: Path, like: Path | None = None) -> Iterator[Path]:
    """A temporary path in the same folder to write to; it replaces the file once it is completely on the disk.

    Who could open that file can open the new one; if it is new, who can open ``like``.
    """
    temporary = _unfinished(path.parent)
    try:
        yield temporary
        flush(temporary)
        share(temporary, path if like is None or path.exists() else like)
        temporary.replace(path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        name_target(error, temporary, path)
        raise


def share(path: Path, like: Path) -> None:
    """Give a file or folder the mode of another and, where that is allowed, its group, whatever the umask is."""
    if sys.platform != "win32" and like.exists():
        with suppress(OSError):
            os.chown(path, -1, like.stat().st_gid)
        with suppress(OSError):  # somebody else's
            path.chmod(stat.S_IMODE(like.stat().st_mode))


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
            share(path, target)
            path.replace(target)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder to write into, renamed to ``folder`` once complete; an empty folder may already be there."""
    folder = folder.resolve()
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise refusal(str(folder), "a folder that holds nothing yet", "one that does", "choose another")
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
    """By age: machines that share a folder see only their own processes."""
    for path in folder.glob(".unfinished-*"):
        with suppress(OSError):
            if _UNFINISHED.fullmatch(path.name) and time.time() - path.stat().st_mtime > _LONG_S:
                shutil.rmtree(path) if path.is_dir() else path.unlink()


@contextmanager
def locked(path: Path, wait_s: float, on_wait: Callable[[], object] = lambda: None) -> Iterator[None]:
    """Context for one process or thread at a time; ``on_wait`` is called meanwhile, and a DataError ends the wait."""
    lock, end = FileLock(path, mode=_FOR_ALL), time.monotonic() + wait_s
    while not lock.is_locked:
        try:
            lock.acquire(timeout=min(_GLANCE_S, wait_s), poll_interval=0.02)
        except Timeout:
            if time.monotonic() >= end:
                trouble = f"{_holder(path)} writing to it", "wait until that has ended, or name another"
                raise refusal(str(path.parent), "a folder that nobody writes to", *trouble) from None
            on_wait()
    try:
        with suppress(OSError):  # where a locked file can't be written
            path.write_text(f"process {os.getpid()} on {platform.node() or 'this machine'}", encoding="utf-8")
        yield
    finally:
        # whoever waits for the file that goes here finds that it has no name any more, and tries again
        with suppress(OSError):  # where open files can't be deleted, the next one reuses it
            path.unlink(missing_ok=True)
        lock.release()


@contextmanager
def sole_writer(folder: Path, wait_s: float = 0.0) -> Iterator[None]:
    """Context for the only writer to a folder, which is made, and taken away again if it stays empty."""
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with locked(folder / NAME, wait_s):
            yield
    finally:
        for empty in made:
            with suppress(OSError):  # it holds something
                empty.rmdir()


def _holder(path: Path) -> str:
    with suppress(OSError, UnicodeDecodeError):  # where a locked file can't be read
        if holder := path.read_text(encoding="utf-8").strip():
            return printable(holder)
    return "another process"
