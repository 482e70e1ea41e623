"""What is computed once is kept on disk: checksummed, written atomically, safe to delete at any time."""

import hashlib
import io
import json
import logging
import os
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import platformdirs

from crashfuse.files import write_atomically
from crashfuse.version import __version__

log = logging.getLogger(__name__)

Entry = dict[str, npt.NDArray[Any]]


def default_folder() -> Path:
    """``$CRASHFUSE_CACHE``, else the platform's cache folder for crashfuse."""
    return Path(os.environ.get("CRASHFUSE_CACHE") or platformdirs.user_cache_dir("crashfuse", appauthor=False))


class Cache:
    """A folder of named arrays, each entry one file: a SHA-256 line, then an ``.npz`` that is never unpickled.

    Parameters
    ----------
    folder : Path, optional
        Default: :func:`default_folder`. It is made at the first write.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = default_folder() if folder is None else folder

    def path(self, kind: str, key: Mapping[str, object]) -> Path:
        """File of the entry of this kind whose parts (strings, numbers, frozen configs) are these."""
        parts = json.dumps({**key, "version": __version__, "code": _code()}, sort_keys=True, default=_plain)
        return self.folder / kind / f"{hashlib.sha256(parts.encode()).hexdigest()[:40]}.bin"

    def get(self, kind: str, key: Mapping[str, object]) -> Entry | None:
        """The arrays kept under this key, or None if there are none or the file is damaged (it is then removed)."""
        path = self.path(kind, key)
        try:
            checksum, _, payload = path.read_bytes().partition(b"\n")
        except OSError:
            return None
        if hashlib.sha256(payload).hexdigest().encode() != checksum:
            path.unlink(missing_ok=True)
            return None
        try:
            with np.load(io.BytesIO(payload), allow_pickle=False) as arrays:
                return {name: arrays[name] for name in arrays.files}
        except (ValueError, zipfile.BadZipFile):  # written by something else under our name
            path.unlink(missing_ok=True)
            return None

    def put(self, kind: str, key: Mapping[str, object], entry: Mapping[str, npt.ArrayLike]) -> None:
        """Keep these arrays under this key, if the folder can be written."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **{name: np.asarray(value) for name, value in entry.items()})
        payload = buffer.getvalue()
        try:
            write_atomically(self.path(kind, key), hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload)
        except OSError as error:  # a full disk must not cost what was computed
            log.warning("A result could not be kept in %s: %s", self.folder, error)

    def drop(self, kind: str, key: Mapping[str, object]) -> None:
        """Forget what was kept under this key."""
        with suppress(OSError):
            self.path(kind, key).unlink(missing_ok=True)


@cache
def _code() -> str:
    """Digest of the modules that compute: what other code made is not taken for what this one would make."""
    package = Path(__file__).parent
    modules = sorted(path for path in package.rglob("*.py") if "ui" not in path.relative_to(package).parts)
    return hashlib.sha256(b"".join(path.read_bytes() for path in modules)).hexdigest()


def _plain(value: object) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        return {"": type(value).__name__, **asdict(value)}
    raise TypeError(f"{type(value).__name__} cannot be part of a cache key")
