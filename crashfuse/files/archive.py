"""Zip and tar archives, also untrusted: unpacked bytes are counted, names must be valid on every platform."""

import gzip
import io
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO, cast

from crashfuse.errors import DataError, Problem, printable, refusal, refuse_all

_CHUNK = 1 << 20
_HARMLESS = 1 << 20  # bytes that any archive may unpack to, whatever its ratio
_LONGEST_NAME, _LONGEST_PATH = 200, 1000  # bytes in UTF-8; file systems allow 255 per name
_DEVICES = {"CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"}
_DEVICES |= {f"{port}{number}" for port in ("COM", "LPT") for number in "0123456789¹²³"}
_SYSTEM_FILES = {"thumbs.db", "ehthumbs.db", "desktop.ini", "__macosx", "$recycle.bin", "@eadir"}
_SYSTEM_FILES |= {"system volume information"}
_SYSTEM_NAMES = (".", "~$")  # beginnings, of hidden files and of locks of open documents
_ENCRYPTED = 0x1 | 0x40 | 0x2000  # flag bits of an entry: classic, strong, directory too
_NO_FILE = "files", "a link or a device", "pack the files themselves"
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # other methods may demand any amount of memory
_UNSOUND = (zipfile.BadZipFile, tarfile.TarError, zlib.error, struct.error)
_BROKEN = (*_UNSOUND, EOFError, RuntimeError, ValueError, OverflowError, OSError)  # what damaged ones raise
_TAR, _NEGATIVE = ("a sound tar archive", "pack the folder anew"), "a header of negative size"
_LONGEST_HEADER, _LONGEST_READ = 1 << 16, 1 << 21  # bytes of a tar at once
ENDINGS = (".tar.gz", ".tgz", ".tar")  # endings of the names of tar archives


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits on the unpacked content of an upload."""

    total_bytes: int = 2 << 30  # all files together: 100,000 CAE runs as Parquet
    member_bytes: int = 1 << 30  # any one of them
    members: int = 20_000  # entries or files: twice a library of 10,000 runs with one file each
    ratio: float = 100.0  # unpacked over packed bytes: tables of numbers reach 5 to 20, a zip bomb 1000 and more
    rows: int = 200_000_000  # of a Parquet table, which its size does not bound: 100,000 runs of 2000 samples


DEFAULT_LIMITS = Limits()


class Budget:
    """Remaining allowance for unpacking one upload of ``packed`` bytes."""

    def __init__(self, limits: Limits, packed: int) -> None:
        self.limits, self.total = limits, 0
        self._by_ratio = max(limits.ratio * packed, _HARMLESS)

    def spend(self, count: int, member_bytes: int, where: str) -> None:
        """Count a chunk of a member of so many bytes by now; a DataError beyond the limits."""
        self.total += count
        if self.total > self._by_ratio:
            expected = f"at most {self.limits.ratio:g} times the size of the archive"
            raise refusal(where, expected, "more: it is a zip bomb", "zip the folder anew")
        if member_bytes > self.limits.member_bytes:
            expected = f"at most {_size(self.limits.member_bytes)} a file"
            raise refusal(where, expected, "more", "split it, or save it as Parquet")
        if self.total > self.limits.total_bytes:
            raise too_much(where, self.limits)


@dataclass(frozen=True, slots=True)
class Member:
    """One file of an upload: its path there, its name in messages, and how to open it."""

    path: PurePosixPath
    where: str
    opened: Callable[[], AbstractContextManager[IO[bytes]]]

    def chunks(self, budget: Budget) -> Iterator[bytes]:
        """Yield the unpacked content in chunks of at most 1 MiB; a DataError if it is damaged or too large."""
        size = 0
        with _readable(self.where), self.opened() as stream:
            while chunk := stream.read(_CHUNK):
                size += len(chunk)
                budget.spend(len(chunk), size, self.where)
                yield chunk

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
    """The files of a zip without folders and system files, all safe by name and kind; the stream must stay open."""
    with _readable(name):
        archive = zipfile.ZipFile(stream)
        entries = archive.infolist()
    if len(entries) > limits.members:
        raise too_many(name, len(entries), limits)
    problems, members = [], []
    for entry in entries:
        where = f"{name}: {printable(entry.orig_filename)}"
        path = entry.filename.replace("\\", "/")  # as some programs of Windows write them
        if trouble := _entry_trouble(entry):
            problems.append(Problem(where, *trouble))
        elif not path.endswith("/") and not left_by_the_system(path):
            members.append(Member(PurePosixPath(path), where, partial(archive.open, entry)))
    refuse_all(problems, name)
    return members


def name_trouble(name: str) -> tuple[str, str, str] | None:
    """Expected, found and advice for a relative path that is not safe on every platform."""
    parts = name.split("/")
    troubles = {
        "a character that cannot be printed": not name.isprintable(),
        "a backslash": "\\" in name,
        "an absolute path": name.startswith("/"),
        "a drive letter or a colon": ":" in name,
        "a path that leaves its folder": any(part in ("", ".", "..") for part in parts),
        "a name that ends in a dot or a space": any(part != part.strip(" ").rstrip(".") for part in parts),
        "a name that Windows keeps for a device": any(one.split(".")[0].rstrip().upper() in _DEVICES for one in parts),
        "a name that is too long": max(map(_length, parts)) > _LONGEST_NAME or _length(name) > _LONGEST_PATH,
    }
    found = next((trouble for trouble, is_there in troubles.items() if is_there), None)
    return None if found is None else ("a plain name in a folder", found, "rename it")


def _length(name: str) -> int:
    return len(name.encode(errors="replace"))


def left_by_the_system(name: str) -> bool:
    """Whether a path is one of the files that file managers leave behind."""
    return any(part.startswith(_SYSTEM_NAMES) or part.lower() in _SYSTEM_FILES for part in name.split("/"))


def too_many(where: str, found: int, limits: Limits) -> DataError:
    """The error for more files than allowed."""
    return refusal(where, f"at most {limits.members} files", f"{found}", "put pulses into one table")


def too_much(where: str, limits: Limits) -> DataError:
    """The error for more bytes than allowed."""
    return refusal(where, f"at most {_size(limits.total_bytes)} in all", "more", "save pulses as Parquet")


def _entry_trouble(entry: zipfile.ZipInfo) -> tuple[str, str, str] | None:
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return _NO_FILE
    if entry.flag_bits & _ENCRYPTED:
        return "files without a password", "an encrypted one", "zip them without a password"
    if entry.compress_type not in _METHODS:
        return "files packed by deflate", f"packing method {entry.compress_type}", "make an ordinary zip"
    return name_trouble(entry.orig_filename.replace("\\", "/").removesuffix("/"))


@contextmanager
def _readable(where: str, sound: str = "a sound zip", advice: str = "zip the folder anew") -> Iterator[None]:
    try:
        yield
    except _BROKEN as error:
        found = f"a damaged one ({printable(str(error)) or type(error).__name__})"
        raise refusal(where, sound, found, advice) from error


def _size(count: int) -> str:
    return f"{count / (1 << 30):.3g} GiB" if count >= 1 << 30 else f"{count / (1 << 20):.3g} MiB"


def is_tar(name: str) -> bool:
    """Whether a file is a tar archive, by its name."""
    return name.lower().endswith(ENDINGS)


def tar_members(stream: IO[bytes], name: str, limits: Limits) -> list[Member]:
    """List the files of a tar, as :func:`zip_members` does; in order they are read in one pass."""
    packed = stream.seek(0, 2)
    stream.seek(0)
    gzipped = stream.read(2) == b"\x1f\x8b"
    stream.seek(0)
    plain = cast(IO[bytes], gzip.GzipFile(fileobj=stream)) if gzipped else stream
    walk = _Walk(plain, name, min(limits.total_bytes, max(int(limits.ratio * packed), _HARMLESS)))
    problems, members = list[Problem](), list[Member]()
    with _readable(name, *_TAR):
        archive = tarfile.open(fileobj=cast(IO[bytes], walk), mode="r:")  # noqa: SIM115 - members read from it later
        for count, entry in enumerate(archive, start=1):
            if count > limits.members:
                raise too_many(name, count, limits)
            path = entry.name.removeprefix("./").rstrip("/")
            where = f"{name}: {printable(entry.name)}"
            if entry.size < 0:
                raise tarfile.ReadError(_NEGATIVE)
            if entry.isdir() or (left_by_the_system(path) and not name_trouble(path)):
                continue
            if entry.type not in (tarfile.REGTYPE, tarfile.AREGTYPE):
                problems.append(Problem(where, *_NO_FILE))
            elif trouble := name_trouble(path):
                problems.append(Problem(where, *trouble))
            else:
                members.append(Member(PurePosixPath(path), where, partial(_opened, archive, entry, walk)))
        walk.finish(archive.offset)
    refuse_all(problems, name)
    return members


@contextmanager
def _opened(archive: tarfile.TarFile, entry: tarfile.TarInfo, walk: "_Walk") -> Iterator[IO[bytes]]:
    walk.listing = False
    with _readable(walk.where, *_TAR), cast(IO[bytes], archive.extractfile(entry)) as stream:
        yield stream


class _Walk:
    """The bytes of a tar as tarfile reads them, within bounds; while it lists the members, only onwards."""

    def __init__(self, stream: IO[bytes], where: str, most: int) -> None:
        self.where, self.listing = where, True
        self._stream, self._most = stream, most

    def tell(self) -> int:
        return self._stream.tell()

    def seek(self, to: int) -> int:
        if self.listing and to < self.tell() - 1:
            raise tarfile.ReadError(_NEGATIVE)
        self._check(to)
        return self._stream.seek(to)

    def read(self, size: int) -> bytes:
        if not 0 <= size <= (_LONGEST_HEADER if self.listing else _LONGEST_READ):
            raise tarfile.ReadError("a header that claims to be too long")
        self._check(self.tell() + size)
        return self._stream.read(size)

    def finish(self, at: int) -> None:
        """Tarfile stops at a damaged header as at the end."""
        self.listing = False
        self.seek(at)
        if self.read(tarfile.BLOCKSIZE).strip(b"\0"):
            raise tarfile.ReadError("a header that makes no sense")
        while self.read(_LONGEST_HEADER):  # gzip keeps its checksum at the end
            pass

    def _check(self, end: int) -> None:
        if end > self._most + _LONGEST_READ:
            raise refusal(self.where, f"at most {self._most >> 20} MiB unpacked", "more", "pack fewer files")
