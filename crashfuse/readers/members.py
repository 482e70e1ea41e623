"""The files of a source (a folder, one of its files, or a zip), and the records in it."""

import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePath, PurePosixPath
from typing import TypeVar

import numpy as np

from crashfuse.errors import CHECK_PATH, Problem, collecting, refusal, refuse_all, refuse_if
from crashfuse.files.archive import Budget, Limits, Member, left_by_the_system, too_many, zip_members

Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def opened_members(
    path: Path, wanted: Callable[[PurePath], bool], kind: str, limits: Limits
) -> Iterator[tuple[list[Member], Budget]]:
    """Open the files of a folder, a zip, or beside a file that are ``wanted``; and the budget for reading them.

    ``kind`` is the expected source in messages ("an ISO-MME test (.mme)").
    """
    if path.suffix.lower() == ".zip" and path.is_file():
        with path.open("rb") as stream:
            members = [member for member in zip_members(stream, path.name, limits) if wanted(member.path)]
            yield members, Budget(limits, path.stat().st_size)
        return
    refuse_if(path.is_file() and not wanted(path), path.name, kind, "a file of another kind", "choose its folder")
    folder = path.parent if path.is_file() else path
    refuse_if(not folder.is_dir(), str(path), kind, "no such folder or file", CHECK_PATH)
    members, size = [], 0
    for file in sorted(files_below(folder)):
        if wanted(file) and file.is_file():
            members.append(_on_disk(file, folder))
            size += file.stat().st_size
            if len(members) > limits.members:
                raise too_many(path.name, len(members), limits)
    yield members, Budget(limits, size)


def read_all(items: Iterable[Item], read: Callable[[Item], Result], source: str) -> tuple[Result, ...]:
    """What is read of each item; a DataError with the problems of all that cannot be read."""
    results, problems = list[Result](), list[Problem]()
    for item in items:
        with collecting(problems), np.errstate(all="ignore"):  # damaged data may hold any number
            results.append(read(item))
    refuse_all(problems, source)
    return tuple(results)


def files_below(folder: Path) -> Iterator[Path]:
    """Yield the files in a folder and those in it but the system's; a DataError for an unreadable one."""

    def refuse(error: OSError) -> None:
        found = error.strerror or str(error)
        raise refusal(str(error.filename), "a readable folder", found, "ask for access") from error

    for home, folders, names in os.walk(folder, onerror=refuse):
        folders[:] = [name for name in folders if not left_by_the_system(name)]
        yield from (Path(home, name) for name in names if not left_by_the_system(name))


ONE_CLOCK = "export it with one time"
OTHER_KIND, CUT_SHORT = "another kind of file", "one that was cut short"
COPY_AGAIN, COPY_ALL = "copy it again", "copy all files"
ASK = "ask the solver (*DATABASE_NODOUT, *DATABASE_HISTORY_NODE)"
ONE_TEST = "choose one test"


def as_text(content: bytes) -> str:
    """Decode text in any of the usual Western encodings."""
    for encoding in ("utf-8-sig", "cp1252"):
        with suppress(UnicodeDecodeError):
            return content.decode(encoding)
    return content.decode("latin-1")


def _on_disk(path: Path, folder: Path) -> Member:
    inside = PurePosixPath(path.relative_to(folder).as_posix())
    return Member(inside, str(inside), lambda: path.open("rb"))


def is_numbered(path: PurePath) -> bool:
    """Whether a name ends in the number of a channel, as ``T1.001`` does."""
    return re.fullmatch(r"\.\d{3,}", path.suffix, re.ASCII) is not None
