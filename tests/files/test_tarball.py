"""Tar archives from strangers: each trick is refused with a sentence, and no header is believed."""

import gzip
import io
import random
import re
import tarfile
import time
import tracemalloc

import pytest

from crashfuse.errors import DataError
from crashfuse.files.archive import DEFAULT_LIMITS, Budget, Limits
from crashfuse.files.tarball import is_tar, tar_members


def tarred(*files: tuple[str | tarfile.TarInfo, bytes], form: int = tarfile.PAX_FORMAT, packed: bool = True) -> bytes:
    """Pack files as a tar, names as they are given."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=form) as archive:
        for name, content in files:
            info = tarfile.TarInfo(name) if isinstance(name, str) else name
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return gzip.compress(stream.getvalue(), mtime=0) if packed else stream.getvalue()


def unpacked(content: bytes, limits: Limits = DEFAULT_LIMITS) -> dict[str, bytes]:
    """Read all of a tar through the module under test."""
    budget = Budget(limits, len(content))
    members = tar_members(io.BytesIO(content), "up.tgz", limits)
    return {str(member.path): member.content(budget) for member in members}


def special(name: str, kind: bytes, target: str = "") -> tarfile.TarInfo:
    """An entry that is not a file."""
    info = tarfile.TarInfo(name)
    info.type, info.linkname = kind, target
    return info


def claiming(size: bytes) -> bytes:
    """A tar whose first header claims a size, its checksum right."""
    header = bytearray(tarred(("a", b"1"), form=tarfile.USTAR_FORMAT, packed=False))
    header[124:136] = size
    header[148:156] = b" " * 8
    header[148:156] = b"%06o\0 " % sum(header[:512])
    return bytes(header)


def broken_header() -> bytes:
    """A tar of three files, the header of the second damaged: tarfile itself takes it for the end."""
    content = bytearray(tarred(("a", b"1"), ("b", b"2"), ("c", b"3"), packed=False, form=tarfile.USTAR_FORMAT))
    content[1024] ^= 1
    return bytes(content)


NOISE = random.Random(7).randbytes(300_000)  # noqa: S311 - no secret


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("form", [tarfile.PAX_FORMAT, tarfile.GNU_FORMAT, tarfile.USTAR_FORMAT])
def test_files_come_back_to_the_byte(packed: bool, form: int) -> None:
    """Packed or not, in every form of tar, with long names; what systems leave behind and folders are not there."""
    content = NOISE * 10
    long = "Channel/" + "x" * 90 + ".001"
    folder = special("T1", tarfile.DIRTYPE)
    entries: list[tuple[str | tarfile.TarInfo, bytes]] = [
        (folder, b""),
        ("./T1/T1.mme", b"1"),
        (f"T1/{long}", content),
        ("T1/._T1.mme", b"2"),
    ]
    assert unpacked(tarred(*entries, form=form, packed=packed)) == {"T1/T1.mme": b"1", f"T1/{long}": content}
    assert all(map(is_tar, ("a.tar.gz", "A.TGZ", "a.tar")))
    assert not any(map(is_tar, ("a.gz", "tar", "a.tar.zip")))


@pytest.mark.parametrize(
    ("content", "limits", "found"),
    [
        (tarred(("../x", b"")), Limits(), "a path that leaves its folder"),
        (tarred(("/etc/x", b"")), Limits(), "an absolute path"),
        (tarred(("CON", b"")), Limits(), "keeps for a device"),
        (tarred((special("a", tarfile.SYMTYPE, "/etc/passwd"), b"")), Limits(), "a link or a device"),
        (tarred((special("a", tarfile.LNKTYPE, "b"), b"")), Limits(), "a link or a device"),
        (tarred((special("a", tarfile.CHRTYPE), b"")), Limits(), "a link or a device"),
        (tarred((special("a", tarfile.GNUTYPE_SPARSE), b"")), Limits(), "a link or a device"),
        (tarred(*((f"{n}", b"") for n in range(11))), Limits(members=10), "at most 10 files"),
        (tarred(("a", b"0" * 5_000_000)), Limits(), "at most 1 MiB unpacked, found more"),
        (tarred(("a", bytes(range(250)) * 9000), packed=False), Limits(total_bytes=1 << 20), "at most 1 MiB in all"),
        (tarred(("a", NOISE))[:-2000], Limits(), "a damaged one"),
        (tarred(("a", NOISE), packed=False)[:200_000], Limits(), "a damaged one"),
        (tarred(("a", b"1"))[:-8] + bytes(8), Limits(), "a damaged one (CRC"),
        (broken_header(), Limits(), "a header that makes no sense"),
        (claiming(b"\xff" * 12), Limits(), "a header of negative size"),
        (claiming(b"\xff" * 10 + b"\xfa\x00"), Limits(), "a header of negative size"),
        (claiming(b"77777777777\0"), Limits(), "at most 1 MiB unpacked, found more"),
        (b"\x1f\x8bno gzip", Limits(), "a damaged one"),
        (b"no tar at all", Limits(), "a damaged one"),
        (b"", Limits(), "a damaged one"),
    ],
)
def test_tricks_and_damage_are_refused(content: bytes, limits: Limits, found: str) -> None:
    """Paths that leave, links, devices, too many, too large, cut short, sizes below zero or beyond all."""
    began = time.monotonic()
    with pytest.raises(DataError, match=re.escape(found)) as caught:
        unpacked(content, limits)
    assert all(problem.where.startswith("up.tgz") for problem in caught.value.problems)
    assert time.monotonic() - began < 2


def test_long_headers_take_no_memory() -> None:
    """An extended header of 64 MiB that packs to nothing is never held."""
    bomb = tarred(("x" * (64 << 20), b""), form=tarfile.GNU_FORMAT)
    tracemalloc.start()
    try:
        with pytest.raises(DataError, match="claims to be too long"):
            unpacked(bomb)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()
