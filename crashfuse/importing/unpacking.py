"""Uploaded foreign files, laid out on disk as an import source."""

import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from crashfuse.campaign_folder.upload import check_uploads, members_of_zip
from crashfuse.errors import DataError, Problem
from crashfuse.files.archive import DEFAULT_LIMITS, Budget, Limits, Member, in_memory


def lay_out_source(uploads: Sequence[tuple[str, bytes]], into: Path, limits: Limits = DEFAULT_LIMITS) -> Path:
    """Lay uploads out as a source that :func:`crashfuse.importing.read_records` reads.

    Parameters
    ----------
    uploads : sequence of (str, bytes)
        Files and zips; each zip is unpacked into a folder named after it.
    into : Path
        An existing folder, which the caller must delete. The return value is the single file or folder in it, or a
        folder with all of them.

    Raises
    ------
    DataError
        If a name is unsafe, a zip is invalid, or the limits are exceeded; nothing is left in ``into``.
    """
    check_uploads(uploads, limits)
    home = into / "upload"
    home.mkdir()
    try:
        for name, content in uploads:
            budget = Budget(limits, len(content))
            if name.lower().endswith(".zip"):
                folder = home / (PurePosixPath(name).stem.strip(". ") or "zip")
                for member in members_of_zip(name, content, limits):
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
