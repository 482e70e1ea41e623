"""Campaign folders opened before, to be offered again: a small file in the cache folder that holds their paths only.

Where people log in, each has a list of their own.
"""

import hashlib
import json
from contextlib import suppress
from pathlib import Path

from crashfuse.errors import DataError
from crashfuse.execution.cache import default_folder
from crashfuse.files.atomic import write_atomically
from crashfuse.files.locks import sole_writer
from crashfuse.ui import campaigns
from crashfuse.ui.visitors import logged_in, visitor

_MOST = 8
_LARGEST = 64 << 10  # bytes of the file
_PATIENCE_S = 5.0  # to wait for another who writes it


def recent_folders() -> tuple[Path, ...]:
    """The folders, the last one first; not those that are gone, or that pages may not open."""
    return tuple(folder for folder in _listed() if campaigns.may_open(folder) and _is_there(folder))


def remember(folder: Path) -> None:
    """Put a folder first; whatever goes wrong, it is only not offered again."""
    with suppress(OSError, DataError), sole_writer(default_folder(), _PATIENCE_S):
        kept = [folder, *(other for other in _listed() if other != folder)][:_MOST]
        write_atomically(_file(), json.dumps([str(each) for each in kept], indent=1).encode())


def labels(folders: tuple[Path, ...]) -> list[str]:
    """Their names, with the folder that holds them where two have the same."""
    names = [folder.name for folder in folders]
    return [
        folder.name if names.count(folder.name) == 1 else f"{folder.parent.name}/{folder.name}" for folder in folders
    ]


def _listed() -> list[Path]:
    """All folders in the file; none if it is not what this module has written."""
    try:
        if _file().stat().st_size > _LARGEST:
            return []
        paths = json.loads(_file().read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return []
    listed = paths[:_MOST] if isinstance(paths, list) else []
    return [Path(path) for path in listed if isinstance(path, str) and Path(path).is_absolute()]


def _is_there(folder: Path) -> bool:
    with suppress(OSError, ValueError):
        return folder.is_dir()
    return False


def _file() -> Path:
    if not logged_in():
        return default_folder() / "recent.json"
    return default_folder() / f"recent-{hashlib.sha256(visitor().key.encode()).hexdigest()[:16]}.json"
