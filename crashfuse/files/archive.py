"""Zip archives: our own, and untrusted ones, with safe names and sizes counted while unpacking.

The sizes that an archive declares are not trusted: unpacked bytes are counted chunk by chunk, and every name is checked
before the first byte is read. Names must be valid on every platform, so that accepted files can be copied anywhere.
"""

import io
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO

from crashfuse.errors import DataError, Problem, printable

_CHUNK = 1 << 20
HARMLESS = 1 << 20  # bytes that any archive may unpack to, whatever its ratio
_MOST_PROBLEMS = 20  # listed; the rest are counted
_LONGEST_NAME, _LONGEST_PATH = 200, 1000  # bytes in UTF-8; file systems allow 255 per name
_DEVICES = {"CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"}
_DEVICES |= {f"{port}{number}" for port in ("COM", "LPT") for number in "0123456789¹²³"}
_SYSTEM_FILES = {"thumbs.db", "desktop.ini", "__macosx"}  # and any name that starts with a dot
_ENCRYPTED = 0x1 | 0x40 | 0x2000  # flag bits of an entry: classic, strong, directory too
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # other methods may demand any amount of memory
_BROKEN = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, RuntimeError, ValueError, OverflowError, OSError)


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits on the unpacked content of an upload.

    Parameters
    ----------
    total_bytes, member_bytes : int
        All files together (2 GiB: 100,000 CAE runs as Parquet), and any one of them (1 GiB).
    members : int
        Archive entries or files (20,000: twice a library of 10,000 runs with one file each).
    ratio : float
        Unpacked bytes per byte of the archive (100: tables of numbers reach 5 to 20, a zip bomb 1000 and more).
    rows : int
        Rows of a Parquet table, which its file size does not bound (200 million: 100,000 runs of 2000 samples).
    """

    total_bytes: int = 2 << 30
    member_bytes: int = 1 << 30
    members: int = 20_000
    ratio: float = 100.0
    rows: int = 200_000_000


DEFAULT_LIMITS = Limits()


class Budget:
    """Remaining allowance for unpacking one upload of ``packed`` bytes."""

    def __init__(self, limits: Limits, packed: int) -> None:
        self.limits = limits
        self.total = 0
        self._by_ratio = max(limits.ratio * packed, HARMLESS)

    def spend(self, count: int, member_bytes: int, where: str) -> None:
        """Count a chunk of a member that has now reached ``member_bytes``; raise a DataError beyond the limits."""
        self.total += count
        limits = self.limits
        if self.total > self._by_ratio:
            expected, found = f"at most {limits.ratio:g} times the size of the archive", "more: it is a zip bomb"
            raise DataError(Problem(where, expected, found, "zip the folder anew"))
        if member_bytes > limits.member_bytes:
            expected, advice = f"at most {_size(limits.member_bytes)} a file", "split it, or save it as Parquet"
            raise DataError(Problem(where, expected, "more", advice))
        if self.total > limits.total_bytes:
            raise too_much(where, limits)


@dataclass(frozen=True, slots=True)
class Member:
    """One file of an upload: its path there, its name in messages, and how to open it."""

    path: PurePosixPath
    where: str
    opened: Callable[[], IO[bytes]]

    def chunks(self, budget: Budget) -> Iterator[bytes]:
        """Yield the unpacked content in chunks of at most 1 MiB; raise a DataError if it is damaged or too large."""
        size = 0
        try:
            with self.opened() as stream:
                while chunk := stream.read(_CHUNK):
                    size += len(chunk)
                    budget.spend(len(chunk), size, self.where)
                    yield chunk
        except _BROKEN as error:
            raise _damaged(self.where, error) from error

    def content(self, budget: Budget) -> bytes:
        """The whole unpacked content; raises as :meth:`chunks` does."""
        return b"".join(self.chunks(budget))

    def write_to(self, path: Path, budget: Budget) -> None:
        """Unpack it to a path that does not exist yet."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as stream:
            for chunk in self.chunks(budget):
                stream.write(chunk)


def zipped(files: Mapping[str, bytes]) -> bytes:
    """A zip of files given by relative path."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return stream.getvalue()


def in_memory(name: str, content: bytes) -> Member:
    """An uploaded file as a member."""
    return Member(PurePosixPath(name), name, partial(io.BytesIO, content))


def zip_members(stream: IO[bytes], name: str, limits: Limits = DEFAULT_LIMITS) -> list[Member]:
    """List the files of a zip, without folders and system files (``__MACOSX``, ``.DS_Store``).

    The members read from the stream, so it must stay open.

    Raises
    ------
    DataError
        If it is not a valid zip, has too many entries, or has one that is encrypted, a link, compressed by an
        unsupported method, or unsafely named.
    """
    try:
        archive = zipfile.ZipFile(stream)
        entries = archive.infolist()
    except _BROKEN as error:
        raise _damaged(name, error) from error
    if len(entries) > limits.members:
        raise too_many(name, len(entries), limits)
    problems, members = [], []
    for entry in entries:
        where = f"{name}: {printable(entry.orig_filename)}"
        trouble = _entry_trouble(entry)
        if trouble is not None:
            problems.append(Problem(where, *trouble))
        elif not entry.is_dir() and not left_by_the_system(entry.filename):
            members.append(Member(PurePosixPath(entry.filename), where, partial(archive.open, entry)))
    refuse(problems, name)
    return members


def name_trouble(name: str) -> tuple[str, str, str] | None:
    """Expected, found and advice for a relative path that is not safe on every platform."""
    parts = name.split("/")
    found = None
    if not name.isprintable():
        found = "a character that cannot be printed"
    elif "\\" in name:
        found = "a backslash"
    elif name.startswith("/"):
        found = "an absolute path"
    elif ":" in name:
        found = "a drive letter or a colon"
    elif any(part in ("", ".", "..") for part in parts):
        found = "a path that leaves its folder"
    elif any(part != part.strip(" ").rstrip(".") for part in parts):
        found = "a name that ends in a dot or a space"
    elif any(part.split(".")[0].rstrip().upper() in _DEVICES for part in parts):
        found = "a name that Windows keeps for a device"
    elif max(len(part.encode()) for part in parts) > _LONGEST_NAME or len(name.encode()) > _LONGEST_PATH:
        found = "a name that is too long"
    return None if found is None else ("a plain name in a folder", found, "rename it")


def left_by_the_system(name: str) -> bool:
    """Whether a path is one of the files that file managers leave behind."""
    return any(part.startswith(".") or part.lower() in _SYSTEM_FILES for part in name.split("/"))


def refuse(problems: list[Problem], name: str) -> None:
    """Raise a DataError with the first problems and the count of the rest, if there are any."""
    if len(problems) > _MOST_PROBLEMS:
        rest = f"{len(problems) - _MOST_PROBLEMS} more like these"
        problems = [*problems[:_MOST_PROBLEMS], Problem(name, "none", rest, "correct them too")]
    if problems:
        raise DataError(problems)


def too_many(where: str, found: int, limits: Limits) -> DataError:
    """The error for more files than allowed."""
    advice = "leave out what is not needed, or put all pulses of a source into one table"
    return DataError(Problem(where, f"at most {limits.members} files", f"{found}", advice))


def too_much(where: str, limits: Limits) -> DataError:
    """The error for more bytes than allowed."""
    advice = "leave out what is not needed, or save the pulses as Parquet"
    return DataError(Problem(where, f"at most {_size(limits.total_bytes)} in all", "more", advice))


def _entry_trouble(entry: zipfile.ZipInfo) -> tuple[str, str, str] | None:
    """Expected, found and advice for an entry of a zip that is not acceptable."""
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "files", "a link or a device", "zip the files themselves"
    if entry.flag_bits & _ENCRYPTED:
        return "files without a password", "an encrypted one", "zip them without a password"
    if entry.compress_type not in _METHODS:
        return "files packed by deflate", f"packing method {entry.compress_type}", "make an ordinary zip"
    return name_trouble(entry.orig_filename.removesuffix("/"))


def _damaged(where: str, error: Exception) -> DataError:
    found = f"a damaged one ({printable(str(error)) or type(error).__name__})"
    return DataError(Problem(where, "a sound zip", found, "zip the folder anew"))


def _size(count: int) -> str:
    return f"{count / (1 << 30):.3g} GiB" if count >= 1 << 30 else f"{count / (1 << 20):.3g} MiB"
