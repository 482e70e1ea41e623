"""Locks: what one process or thread alone may write to; the operating system frees the lock of one that dies."""

import os
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from crashfuse.errors import DataError, Problem, printable

NAME = ".in-use"  # the lock of a folder, in it: whoever can write to the folder sees it, whatever their cache

_GLANCE_S = 0.2
_FOR_ALL = 0o666  # the next user of a shared folder must be able to open what a killed process of this one left


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
                raise DataError(Problem(str(path.parent), "a folder that nobody writes to", *trouble)) from None
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
