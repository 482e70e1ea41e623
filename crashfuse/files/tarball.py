"""Untrusted tar archives, packed by gzip or not: names and sizes are checked as those of a zip.

A tar has no directory: its members are found by walking through all of it. What is read, and how much of it at once, is
bounded on the way, because headers may claim any size, a negative one included.
"""

import gzip
import tarfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import PurePosixPath
from typing import IO, cast

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.archive import HARMLESS, Limits, Member, left_by_the_system, name_trouble, refuse, too_many

ENDINGS = (".tar.gz", ".tgz", ".tar")
"""Endings of the names of tar archives."""

_LONGEST_HEADER, _LONGEST_READ = 1 << 16, 1 << 21  # bytes at once
_BROKEN = (tarfile.TarError, gzip.BadGzipFile, zlib.error, EOFError, ValueError, OverflowError, OSError, RecursionError)


def is_tar(name: str) -> bool:
    """Whether a file is a tar archive, by its name."""
    return name.lower().endswith(ENDINGS)


def tar_members(stream: IO[bytes], name: str, limits: Limits) -> list[Member]:
    """List the files of a tar, without folders and files that systems leave behind.

    The members read from the stream, so it must stay open; in order they are read in one pass.

    Raises
    ------
    DataError
        If it is not a valid tar, has too many files or bytes, or has a link, a device or an unsafe name.
    """
    packed = stream.seek(0, 2)
    stream.seek(0)
    gzipped = stream.read(2) == b"\x1f\x8b"
    stream.seek(0)
    plain = cast(IO[bytes], gzip.GzipFile(fileobj=stream)) if gzipped else stream
    walk = _Walk(plain, name, min(limits.total_bytes, max(int(limits.ratio * packed), HARMLESS)))
    problems: list[Problem] = []
    members: list[Member] = []
    count = 0
    with _readable(name):
        archive = tarfile.open(fileobj=cast(IO[bytes], walk), mode="r:")  # noqa: SIM115 - members read from it later
        for entry in archive:
            count += 1
            if count > limits.members:
                raise too_many(name, count, limits)
            path = entry.name.removeprefix("./").rstrip("/")
            where = f"{name}: {printable(entry.name)}"
            if entry.size < 0:
                raise tarfile.ReadError("a header of negative size")
            if entry.isdir() or (left_by_the_system(path) and not name_trouble(path)):
                continue
            if entry.type not in (tarfile.REGTYPE, tarfile.AREGTYPE):
                problems.append(Problem(where, "files", "a link or a device", "pack the files themselves"))
            elif trouble := name_trouble(path):
                problems.append(Problem(where, *trouble))
            else:
                members.append(Member(PurePosixPath(path), where, partial(_opened, archive, entry, walk)))
        walk.finish(archive.offset)
    refuse(problems, name)
    return members


def _opened(archive: tarfile.TarFile, entry: tarfile.TarInfo, walk: "_Walk") -> IO[bytes]:
    walk.listing = False
    return cast(IO[bytes], _Content(archive.extractfile(entry), walk.where))


@contextmanager
def _readable(where: str) -> Iterator[None]:
    """Turn what tarfile and gzip raise on damaged data into a DataError."""
    try:
        yield
    except _BROKEN as error:
        found = f"a damaged one ({printable(str(error)) or type(error).__name__})"
        raise DataError(Problem(where, "a sound tar archive", found, "pack the folder anew")) from error


class _Content:
    """One file of a tar, as a stream."""

    def __init__(self, stream: IO[bytes] | None, where: str) -> None:
        self._stream, self._where = stream, where

    def __enter__(self) -> "_Content":
        return self

    def __exit__(self, *_: object) -> None:
        if self._stream is not None:
            self._stream.close()

    def read(self, size: int) -> bytes:
        with _readable(self._where):
            return b"" if self._stream is None else self._stream.read(size)


class _Walk:
    """The bytes of a tar as tarfile reads them, within bounds; while it lists the members, only onwards."""

    def __init__(self, stream: IO[bytes], where: str, most: int) -> None:
        self.where, self.listing = where, True
        self._stream, self._most = stream, most

    def tell(self) -> int:
        return self._stream.tell()

    def seek(self, to: int) -> int:
        if self.listing and to < self.tell() - 1:
            raise tarfile.ReadError("a header of negative size")
        self._check(to)
        return self._stream.seek(to)

    def read(self, size: int) -> bytes:
        if not 0 <= size <= (_LONGEST_HEADER if self.listing else _LONGEST_READ):
            raise tarfile.ReadError("a header that claims to be too long")
        self._check(self.tell() + size)
        return self._stream.read(size)

    def finish(self, at: int) -> None:
        """Check that the archive ends where tarfile stopped, which a damaged header makes it do, too, and in full."""
        self.listing = False
        self.seek(at)
        if self.read(tarfile.BLOCKSIZE).strip(b"\0"):
            raise tarfile.ReadError("a header that makes no sense")
        while self.read(_LONGEST_HEADER):  # gzip keeps its checksum at the end
            pass

    def _check(self, end: int) -> None:
        if end > self._most + _LONGEST_READ:
            expected = f"at most {self._most >> 20} MiB unpacked"
            raise DataError(Problem(self.where, expected, "more", "pack the files of one test alone"))
