"""Zips and tar archives of foreign files, and uploads, laid out on disk as an import source."""

import io
import re
import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from crashfuse.campaign_folder.upload import check_uploads, members_of_zip
from crashfuse.errors import DataError, Problem
from crashfuse.files.archive import DEFAULT_LIMITS, Budget, Limits, Member, in_memory
from crashfuse.files.tarball import ENDINGS, is_tar, tar_members

_ARCHIVE = re.compile(f"(.*)({'|'.join(map(re.escape, ('.zip', *ENDINGS)))})", re.IGNORECASE | re.DOTALL)


def is_archive(name: str) -> bool:
    """Whether a file is a zip or a tar archive, by its name."""
    return _ARCHIVE.fullmatch(name) is not None


def members_of(name: str, content: bytes, limits: Limits = DEFAULT_LIMITS) -> list[Member]:
    """List the files of an archive in memory; a DataError if it is invalid, unsafe or exceeds the limits."""
    if is_tar(name):
        return tar_members(io.BytesIO(content), name, limits)
    return members_of_zip(name, content, limits)


def lay_out_source(uploads: Sequence[tuple[str, bytes]], into: Path, limits: Limits = DEFAULT_LIMITS) -> Path:
    """Lay uploads out as a source that :func:`crashfuse.importing.read_records` reads.

    Parameters
    ----------
    uploads : sequence of (str, bytes)
        Files and archives; each archive is unpacked into a folder named after it.
    into : Path
        An existing folder, which the caller must delete. The return value is the single file or folder in it, or a
        folder with all of them.

    Raises
    ------
    DataError
        If a name is unsafe, an archive is invalid, or the limits are exceeded; nothing is left in ``into``.
    """
    check_uploads(uploads, limits)
    home = into / "upload"
    home.mkdir()
    try:
        for name, content in uploads:
            budget = Budget(limits, len(content))
            if archive := _ARCHIVE.fullmatch(PurePosixPath(name).name):
                folder = home / (archive[1].strip(". ") or "archive")
                for member in members_of(name, content, limits):
                    _unpack(member, folder, budget)
            else:
                _unpack(in_memory(name, content), home, budget)
    except BaseException:
        shutil.rmtree(home)
        raise
    single = list(home.iterdir())
    return single[0] if len(single) == 1 else home


def _unpack(member: Member, folder: Path, budget: Budget) -> None:
    try:
        member.write_to(folder / member.path, budget)
    except (FileExistsError, NotADirectoryError):
        found = "another file of this name"
        raise DataError(Problem(member.where, "names that differ", found, "rename one")) from None
