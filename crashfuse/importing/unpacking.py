"""Foreign files that were uploaded, laid out as a source on disk."""

import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from crashfuse.campaign_folder.upload import check_uploads, members_of_zip
from crashfuse.errors import DataError, Problem
from crashfuse.files.archive import DEFAULT_LIMITS, Budget, Limits


def lay_out_source(uploads: Sequence[tuple[str, bytes]], into: Path, limits: Limits = DEFAULT_LIMITS) -> Path:
    """Lay uploads out as a source that :func:`crashfuse.importing.read_records` reads.

    Parameters
    ----------
    uploads : sequence of (str, bytes)
        Files and zips; each zip is unpacked into a folder of its name.
    into : Path
        An existing folder, which is the caller's to delete. Returned is the one file or folder in it, or the folder of
        all of them.

    Raises
    ------
    DataError
        If a name is a trick, a zip is unsound, or there is more than the limits allow; nothing is left in ``into``.
    """
    check_uploads(uploads, limits)
    home = into / "upload"
    home.mkdir()
    try:
        for name, content in uploads:
            if name.lower().endswith(".zip"):
                _unpack(name, content, home / (PurePosixPath(name).stem.strip(". ") or "zip"), limits)
            else:
                _write(home / name, name, content)
    except BaseException:
        shutil.rmtree(home)
        raise
    single = list(home.iterdir())
    return single[0] if len(single) == 1 else home


def _unpack(name: str, content: bytes, folder: Path, limits: Limits) -> None:
    budget = Budget(limits, len(content))
    for member in members_of_zip(name, content, limits):
        _write(folder.joinpath(*member.path.parts), member.where, b"")
        with folder.joinpath(*member.path.parts).open("wb") as stream:
            for chunk in member.chunks(budget):
                stream.write(chunk)


def _write(path: Path, where: str, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as stream:
            stream.write(content)
    except (FileExistsError, NotADirectoryError):
        raise DataError(Problem(where, "names that differ", "another file of this name", "rename one")) from None
