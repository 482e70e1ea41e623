"""The files of a source, whether it is a folder, one of its files, or a zip of it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath, PurePosixPath

from crashfuse.errors import DataError, Problem
from crashfuse.formats.archive import Budget, Limits, Member, too_many, zip_members


@contextmanager
def opened_members(
    path: Path, wanted: Callable[[PurePath], bool], kind: str, limits: Limits
) -> Iterator[tuple[list[Member], Budget]]:
    """Open the files of a source that are wanted, and what may be read from them.

    Parameters
    ----------
    path : Path
        A folder, a file in it, or a zip.
    wanted : callable
        From a file's path to whether it is one of the format; nothing else is opened.
    kind : str
        What messages call it ("an ISO-MME folder or zip").
    limits : Limits

    Raises
    ------
    DataError
        If there is no such folder or file, or it has more files than allowed.
    """
    if path.suffix.lower() == ".zip" and path.is_file():
        with path.open("rb") as stream:
            members = [member for member in zip_members(stream, path.name, limits) if wanted(member.path)]
            yield members, Budget(limits, path.stat().st_size)
        return
    folder = path.parent if path.is_file() else path
    if not folder.is_dir():
        raise DataError(Problem(str(path), kind, "no such folder or file", "check the path"))
    files = []
    for file in sorted(folder.rglob("*")):
        if wanted(file) and file.is_file():
            files.append(file)
            if len(files) > limits.members:
                raise too_many(path.name, len(files), limits)
    yield [_on_disk(file, folder) for file in files], Budget(limits, sum(file.stat().st_size for file in files))


def _on_disk(path: Path, folder: Path) -> Member:
    inside = PurePosixPath(path.relative_to(folder).as_posix())
    return Member(inside, str(inside), lambda: path.open("rb"))
