"""A folder that one process alone writes to."""

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from crashfuse.errors import CrashfuseError, printable

_NAME = ".in-use"


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Context in which no other process that asks may write to a folder, which is made if it is not there.

    The operating system frees the lock of a process that dies. Where files can't be locked, nobody is refused.

    Raises
    ------
    CrashfuseError
        If another process is writing to it: who, where that is known.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / _NAME
    lock = FileLock(path)
    try:
        with suppress(OSError, NotImplementedError):
            try:
                lock.acquire(blocking=False)
            except Timeout:
                raise CrashfuseError(
                    f"{_holder(path)} is writing to {folder}; wait until it has ended, or name another folder."
                ) from None
            path.write_text(f"process {os.getpid()} on {platform.node() or 'this machine'}", encoding="utf-8")
        yield
    finally:
        if lock.is_locked:
            with suppress(OSError):  # where open files can't be deleted, the next writer reuses it
                path.unlink(missing_ok=True)
        lock.release()
        for empty in made:
            with suppress(OSError):  # it holds something
                empty.rmdir()


def _holder(path: Path) -> str:
    """The process that has written its name into the lock file."""
    with suppress(OSError, UnicodeDecodeError):  # where a locked file can't be read
        if told := path.read_text(encoding="utf-8").strip():
            return f"Another command ({printable(told)})"
    return "Another command"
