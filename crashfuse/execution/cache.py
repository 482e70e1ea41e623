"""Disk cache of computed results: checksummed, written atomically, limited in size, safe to delete at any time."""

import hashlib
import io
import json
import logging
import os
import platform
import tempfile
import time
import warnings
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, is_dataclass
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar, cast
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
import platformdirs

from crashfuse.errors import Cancelled, DataError, UsageError, as_path, out_of_memory
from crashfuse.execution.code_digest import code_digest, sources_digest
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.files.atomic import locked, write_atomically
from crashfuse.version import versions

log = logging.getLogger(__name__)

Entry = dict[str, npt.NDArray[Any]]
T = TypeVar("T")
D = TypeVar("D")
P = ParamSpec("P")

_PATIENCE_S = 3600.0  # wait for another process computing the same entry; then compute it here, too
_WAITING = "Waiting for another process that computes the same"
_MOST_GIB = "10"
_IN_USE_S = 3600.0  # since its last use; whoever needs it longer computes it again
_SWEEP_SHARE = 1 / 32  # of the limit: how much is written between two looks at the size of all entries
_TRIED = 1 << 20  # bytes written to see whether anything can be kept
_written: dict[Path, float] = {}  # since the last look, by folder
_lost: dict[Path, str] = {}  # why something could not be kept, by folder
_digests: dict[tuple[Path, str], str] = {}  # of the modules that compute, some twenty, by folder of their entry


def default_folder() -> Path:
    """``$CRASHFUSE_CACHE``, else the platform's cache folder for crashfuse."""
    return Path(os.environ.get("CRASHFUSE_CACHE") or platformdirs.user_cache_dir("crashfuse", appauthor=False))


def not_kept(folder: Path | None = None) -> str:
    """Why something could not be kept in a folder (:func:`default_folder`), or cannot be; empty if all is."""
    folder = folder or default_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_TRIED))
    except OSError as error:
        _lost[folder] = error.strerror or str(error)
    return f"{folder} cannot be written ({_lost[folder]})" if folder in _lost else ""


def resume(how: str, folder: Path | None = None) -> str:
    """What became of what was finished before a computation ended, and how to go on with it."""
    if reason := not_kept(folder):
        return f"What was finished is lost: {reason}; free some space, or name another folder by CRASHFUSE_CACHE"
    return f"What was finished is in the cache: {how}"


@dataclass(frozen=True, slots=True)
class Code:
    """In a key: the module that computes the result, which stands there by its :func:`code_digest`."""

    module: str


class Cache:
    """A folder of named arrays, one file per entry: a SHA-256 line, then an ``.npz`` that is never unpickled.

    Beyond ``$CRASHFUSE_CACHE_GIB`` (10), the entries that were not used for longest go, but none of the last hour. The
    folder, by default :func:`default_folder`, is created at the first write.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = default_folder() if folder is None else as_path(folder, "the cache")
        self.most_bytes = _most_bytes()
        self.used: set[str] = set()  # names of the entries found or stored through this object

    def path(self, kind: str, key: Mapping[str, object]) -> Path:
        """File of the entry of this kind with this key, made of strings, numbers and frozen configs, and of versions.

        The key of a computed result includes the :class:`Code` that computes it.
        """
        parts = json.dumps({**key, "versions": versions()}, sort_keys=True, default=self._plain)
        return self.folder / kind / f"{hashlib.sha256(parts.encode()).hexdigest()[:40]}.bin"

    def is_cached(self, kind: str, key: Mapping[str, object]) -> bool:
        """Whether there is an entry under this key."""
        return self.path(kind, key).is_file()

    def get_or_compute(
        self,
        kind: str,
        key: Mapping[str, object],
        compute: Callable[[], tuple[T, Mapping[str, npt.ArrayLike]]],
        restore: Callable[[Entry], T],
        watch: Watch = SILENT,
    ) -> T:
        """Restore a result from the cache, or compute and store it; of several concurrent callers, only one computes.

        ``compute`` returns the result, not None, and the arrays from which ``restore`` rebuilds it.
        """
        result = self.find(kind, key, restore)
        if result is None:
            with self.alone(kind, key, watch):
                result = self.find(kind, key, restore)  # another process may have stored it meanwhile
                if result is None:
                    result, entry = compute()
                    self.put(kind, key, entry)
        return result

    def find(self, kind: str, key: Mapping[str, object], restore: Callable[[Entry], T]) -> T | None:
        """A result from the cache; None if there is none, or it cannot be restored (a warning)."""
        entry = self.get(kind, key)
        if entry is None:
            return None
        try:
            return restore(entry)
        except Cancelled:
            raise
        except Exception as error:
            if out_of_memory(error):
                raise
            self.discard(kind, key, error)
            return None

    def discard(self, kind: str, key: Mapping[str, object], error: Exception) -> None:
        """Delete an entry that is whole, and yet not what it should be: a fault of ours, so it warns."""
        warnings.warn(f"A result ({kind}) could not be read back and is computed again: {error!r}", stacklevel=2)
        self.drop(kind, key)

    def get(self, kind: str, key: Mapping[str, object]) -> Entry | None:
        """The arrays stored under this key, or None if there are none or the file is damaged."""
        path = self.path(kind, key)
        try:
            checksum, _, payload = path.read_bytes().partition(b"\n")
        except OSError:
            return None
        try:
            if self._checksum(path, payload) != checksum:
                raise ValueError("damaged")
            with np.load(io.BytesIO(payload), allow_pickle=False) as arrays:
                entry = {name: arrays[name] for name in arrays.files}
        except Exception:  # whatever a damaged archive of arrays raises, or what something else wrote
            self.drop(kind, key)
            return None
        self.used.add(self._name(path))
        with suppress(OSError):  # of a cache that can only be read
            os.utime(path)
        return entry

    def put(self, kind: str, key: Mapping[str, object], entry: Mapping[str, npt.ArrayLike]) -> None:
        """Store these arrays under this key, if the folder is writable."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **{name: np.asarray(value) for name, value in entry.items()})
        payload = buffer.getvalue()
        path = self.path(kind, key)
        self._write(path, self._checksum(path, payload) + b"\n" + payload)

    def drop(self, kind: str, key: Mapping[str, object]) -> None:
        """Delete the entry under this key."""
        with suppress(OSError):
            self.path(kind, key).unlink(missing_ok=True)

    @contextmanager
    def alone(self, kind: str, key: Mapping[str, object], watch: Watch = SILENT) -> Iterator[None]:
        """Context that only one process or thread at a time can hold for an entry; look for it again inside.

        Where files can't be locked, or the lock is held for an hour, the same result may be computed twice.
        """
        path, waited = self.path(kind, key).with_suffix(".lock"), False

        def wait() -> None:
            nonlocal waited
            waited = True
            watch.report(_WAITING, 0, 1)

        with ExitStack() as lock:
            with suppress(OSError, DataError):
                path.parent.mkdir(parents=True, exist_ok=True)
                lock.enter_context(locked(path, _PATIENCE_S, wait))
            if waited:
                watch.report(_WAITING, 1, 1)
            yield

    def pack(self, names: Iterable[str]) -> dict[str, bytes]:
        """The raw files of these entries, for another cache."""
        files = {}
        for name in sorted(names):
            with suppress(OSError):
                files[name] = (self.folder / name).read_bytes()
        return files

    def unpack(self, files: Mapping[str, bytes]) -> None:
        """Store what another cache packed, if the folder is writable."""
        for name, content in files.items():
            if not (self.folder / name).exists():
                self._write(self.folder / name, content)

    def anew(self) -> "Cache":
        """The same cache, of which nothing was used."""
        return Cache(self.folder)

    @property
    def lost(self) -> str:
        """Why a result could not be kept here; empty if all were."""
        return _lost.get(self.folder, "")

    def report_loss(self, reason: str) -> None:
        """Log, once, that results cannot be kept here: this process could not write them, or a worker."""
        if reason:
            level = logging.DEBUG if self.lost else logging.WARNING
            _lost[self.folder] = reason
            log.log(level, "Results cannot be kept in %s: %s", self.folder, reason)

    def digest(self, module: str) -> str:
        """The :func:`code_digest` of a module: to parse the package takes a second, so it is kept here, too."""
        if (self.folder, module) not in _digests:
            key = {"module": module, "sources": sources_digest(), "python": platform.python_version()}

            def compute() -> tuple[str, dict[str, str]]:
                digest = code_digest(module)
                return digest, {"digest": digest}

            found = self.get_or_compute("code", key, compute, lambda entry: str(entry["digest"]))
            _digests[self.folder, module] = found
        return _digests[self.folder, module]

    def _plain(self, value: object) -> object:
        if isinstance(value, Code):
            return self.digest(value.module)
        if is_dataclass(value) and not isinstance(value, type):
            return {"": type(value).__name__, **asdict(value)}
        raise TypeError(f"{type(value).__name__} cannot be part of a cache key")

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()

    def _checksum(self, path: Path, payload: bytes) -> bytes:
        # with the name: an entry in the place of another is damaged
        return hashlib.sha256(self._name(path).encode() + b"\n" + payload).hexdigest().encode()

    def _write(self, path: Path, content: bytes) -> None:
        self._make_room(len(content))
        try:
            write_atomically(path, content)
        except OSError as error:  # a full disk must not lose the computed result
            self.report_loss(error.strerror or str(error))
        else:
            self.used.add(self._name(path))

    def _make_room(self, size: int) -> None:
        written = _written.get(self.folder, self.most_bytes) + size
        _written[self.folder] = written if written < self.most_bytes * _SWEEP_SHARE else 0
        if _written[self.folder]:
            return
        entries = []
        for path in self.folder.glob("*/*.bin"):
            with suppress(OSError):  # another process has deleted it
                stat = path.stat()
                entries.append((stat.st_mtime, stat.st_size, path))
        excess = sum(size for _, size, _ in entries) + size - self.most_bytes
        for used, taken, path in sorted(entries):
            if excess <= 0 or time.time() - used < _IN_USE_S:
                break
            if self._name(path) not in self.used:
                with suppress(OSError):
                    path.unlink()
                    excess -= taken


class NoCache(Cache):
    """Keeps nothing."""

    def __init__(self) -> None:
        self.folder, self.used = Path(os.devnull), set()

    def get(self, kind: str, key: Mapping[str, object]) -> None:
        """Nothing is there."""

    def put(self, kind: str, key: Mapping[str, object], entry: Mapping[str, npt.ArrayLike]) -> None:
        """Forget it."""

    def drop(self, kind: str, key: Mapping[str, object]) -> None:
        """Nothing is there."""

    @contextmanager
    def alone(self, kind: str, key: Mapping[str, object], watch: Watch = SILENT) -> Iterator[None]:  # noqa: ARG002
        """Everyone computes."""
        yield


_remembered: WeakKeyDictionary[object, dict[Hashable, Any]] = WeakKeyDictionary()


def remembered(function: Callable[Concatenate[D, P], T]) -> Callable[Concatenate[D, P], T]:
    """Decorator: what it returned of data in this process, for as long as the data are there. It must not hold them."""

    @wraps(function)
    def once(data: D, /, *args: P.args, **kwargs: P.kwargs) -> T:
        try:
            results = _remembered.setdefault(data, {})
        except TypeError:  # no data, but what someone gave in their place
            return function(data, *args, **kwargs)
        key = function, args, tuple(kwargs.items())
        if key not in results:
            results[key] = function(data, *args, **kwargs)
        return cast(T, results[key])

    return once


def _most_bytes() -> float:
    text = os.environ.get("CRASHFUSE_CACHE_GIB") or _MOST_GIB
    with suppress(ValueError):
        if (most := float(text)) > 0:
            return most * 2**30
    raise UsageError(f"CRASHFUSE_CACHE_GIB is a size in GiB above 0, not {text!r}.")


def numbers(entry: Entry, name: str, *shape: int | None) -> npt.NDArray[Any]:
    """The real numbers of an entry under a name; raises if they are not of this shape (None: any length)."""
    array = entry[name]
    is_of_shape = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if array.dtype.kind != "f" or not is_of_shape:
        raise ValueError(f"{name}: {array.dtype} of shape {array.shape} instead of numbers of shape {shape}")
    return array


def finite(entry: Entry, name: str, *shape: int | None) -> npt.NDArray[Any]:
    """As :func:`numbers`; raises also if one of them is infinite or NaN."""
    array = numbers(entry, name, *shape)
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: numbers without a value")
    return array
