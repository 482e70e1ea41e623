"""Archives from strangers: each trick is refused with a sentence, and nothing is believed that one says of itself."""

import gzip
import io
import random
import re
import struct
import tarfile
import tracemalloc
import zipfile
from collections.abc import Callable

import pytest

from crashfuse.errors import DataError
from crashfuse.files.archive import DEFAULT_LIMITS, Budget, Limits, is_tar, tar_members, zip_members

SYMLINK, FIFO = 0o120777 << 16, 0o010644 << 16


def zipped(*files: tuple[str | zipfile.ZipInfo, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Pack files as a zip, names as they are given."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, content in files:
            archive.writestr(name, content)
    return stream.getvalue()


def unpacked(content: bytes, limits: Limits = DEFAULT_LIMITS) -> dict[str, bytes]:
    """Read all of a zip through the module under test."""
    budget = Budget(limits, len(content))
    members = zip_members(io.BytesIO(content), "up.zip", limits)
    return {str(member.path): b"".join(member.chunks(budget)) for member in members}


def entry(name: str, attributes: int = 0) -> zipfile.ZipInfo:
    """An entry whose name is taken as it is, with a Unix file mode."""
    info = zipfile.ZipInfo()
    info.filename = name
    info.external_attr = attributes
    return info


def patched(content: bytes, at_file: int, form: str, change: Callable[[int], int]) -> bytes:
    """The same zip with a number of its first entry changed, in the directory and at the file."""
    changed = bytearray(content)
    for signature, offset in ((b"PK\x03\x04", at_file), (b"PK\x01\x02", at_file + 2)):
        at = content.index(signature) + offset
        struct.pack_into(form, changed, at, change(*struct.unpack_from(form, content, at)))
    return bytes(changed)


def test_what_is_in_a_zip_comes_out_of_it() -> None:
    left = ("campaign/.DS_Store", "__MACOSX/campaign/._tests.csv", "campaign/Thumbs.db", "campaign/~$tests.xlsx")
    files = {"campaign/tests/Prüfung 1.csv": b"a,b\n" * 1000, "empty.csv": b""}
    content = zipped(
        ("campaign/", b""), (entry("campaign\\cae\\a.csv"), b"b"), *((name, b"x") for name in left), *files.items()
    )
    assert unpacked(content) == {"campaign/cae/a.csv": b"b", **files}


TRICKS = {
    "an absolute path": ("/etc/passwd.csv", "\\\\server\\share\\out.csv"),
    "a path that leaves its folder": ("../out.csv", "a/../../out.csv", "a/./b.csv", "a//b.csv", "../", "..\\out.csv"),
    "a drive letter or a colon": ("C:/out.csv", "tests.csv:hidden"),
    "cannot be printed": ("a\x00.csv", "a\n.csv", "vsc.\u202egpj.csv"),
    "a device": ("CON.csv", "tests/lpt1.csv", "nul .csv"),
    "a dot or a space": ("tests./T1.csv", "T1.csv ", " T1.csv"),
    "too long": ("n" * 250 + ".csv", "/".join(["n"] * 600)),
}


@pytest.mark.parametrize(
    ("content", "limits", "found"),
    [
        *((zipped((entry(name), b"x")), Limits(), found) for found, names in TRICKS.items() for name in names),
        (zipped((entry("tests.csv", SYMLINK), b"/etc/passwd")), Limits(), "a link or a device"),
        (zipped((entry("tests.csv", FIFO), b"")), Limits(), "a link or a device"),
        (patched(zipped(("a.csv", b"x")), 6, "<H", lambda flags: flags | 1), Limits(), "an encrypted one"),
        (zipped(("a.csv", b"x"), method=zipfile.ZIP_LZMA), Limits(), "packing method 14"),
        (b"", Limits(), "a damaged one"),
        (b"id,speed_mph\n1,2\n", Limits(), "a damaged one"),
        (zipped(("a.csv", b"abc" * 999))[:-30], Limits(), "a damaged one"),
        (zipped(("a.csv", b"x" * 50), method=zipfile.ZIP_STORED).replace(b"x" * 50, b"y" * 50), Limits(), "CRC"),
        (zipped(("a.csv", bytes(20 << 20))), Limits(), "at most 100 times the size of the archive, found more"),
        (zipped(("a.csv", bytes(3 << 20))), Limits(member_bytes=2 << 20, ratio=1e4), "at most 2 MiB a file"),
        (zipped(*((f"{i}.csv", bytes(1 << 20)) for i in range(3))), Limits(2 << 20, ratio=1e4), "at most 2 MiB in all"),
        (zipped(*((f"{i}.csv", b"") for i in range(11))), Limits(members=10), "at most 10 files, found 11"),
        (patched(zipped(("a.csv", bytes(20 << 20))), 22, "<I", lambda _: 10), Limits(), "a sound zip"),
    ],
)
def test_a_trick_damage_or_a_bomb_is_refused(content: bytes, limits: Limits, found: str) -> None:
    """Names that some platform reads otherwise, links, passwords; bombs by what is counted, not what is said."""
    with pytest.raises(DataError, match=found) as refused:
        unpacked(content, limits)
    message = str(refused.value)
    assert message.startswith("up.zip")
    assert message.isprintable()


def test_files_that_share_their_bytes_are_counted_each_time() -> None:
    """A thousand directory entries that all point at one packed megabyte are a bomb, though no single one is."""
    single = zipped(("a.csv", bytes(1 << 20)))
    directory, end = single.index(b"PK\x01\x02"), single.index(b"PK\x05\x06")
    header = single[directory:end]
    tail = struct.pack("<4sHHHHIIH", b"PK\x05\x06", 0, 0, 1000, 1000, 1000 * len(header), directory, 0)
    with pytest.raises(DataError, match=r"zip bomb|a sound zip"):  # newer zipfile modules see the overlap themselves
        unpacked(single[:directory] + header * 1000 + tail)


def test_many_problems_are_counted_not_all_listed() -> None:
    with pytest.raises(DataError) as refused:
        unpacked(zipped(*((entry(f"../{i}.csv"), b"") for i in range(1000))))
    assert len(refused.value.problems) == 21
    assert "980 more" in str(refused.value)


def tarred(*files: tuple[str | tarfile.TarInfo, bytes], form: int = tarfile.PAX_FORMAT, packed: bool = True) -> bytes:
    """Pack files as a tar, names as they are given."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=form) as archive:
        for name, content in files:
            info = tarfile.TarInfo(name) if isinstance(name, str) else name
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return gzip.compress(stream.getvalue(), mtime=0) if packed else stream.getvalue()


def untarred(content: bytes, limits: Limits = DEFAULT_LIMITS) -> dict[str, bytes]:
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
CUT = tarred(("a", NOISE))[:-2000], tarred(("a", NOISE), packed=False)[:200_000]
NO_FILES = tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.GNUTYPE_SPARSE


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("form", [tarfile.PAX_FORMAT, tarfile.GNU_FORMAT, tarfile.USTAR_FORMAT])
def test_files_come_back_to_the_byte(packed: bool, form: int) -> None:
    """Packed or not, in every form of tar, with long names; what systems leave behind and folders are not there."""
    content = NOISE * 10
    long = "Channel/" + "x" * 90 + ".001"
    entries = ((special("T1", tarfile.DIRTYPE), b""), ("./T1/T1.mme", b"1"), (f"T1/{long}", content))
    found = untarred(tarred(*entries, ("T1/._T1.mme", b"2"), form=form, packed=packed))
    assert found == {"T1/T1.mme": b"1", f"T1/{long}": content}
    assert all(map(is_tar, ("a.tar.gz", "A.TGZ", "a.tar")))
    assert not any(map(is_tar, ("a.gz", "tar", "a.tar.zip")))


@pytest.mark.parametrize(
    ("content", "limits", "found"),
    [
        (tarred(("../x", b"")), Limits(), "a path that leaves its folder"),
        (tarred(("/etc/x", b"")), Limits(), "an absolute path"),
        (tarred(("CON", b"")), Limits(), "keeps for a device"),
        *((tarred((special("a", kind, "/etc/passwd"), b"")), Limits(), "a link or a device") for kind in NO_FILES),
        (tarred(*((f"{n}", b"") for n in range(11))), Limits(members=10), "at most 10 files"),
        (tarred(("a", b"0" * 5_000_000)), Limits(), "at most 1 MiB unpacked, found more"),
        (tarred(("a", bytes(range(250)) * 9000), packed=False), Limits(total_bytes=1 << 20), "at most 1 MiB in all"),
        (tarred(("a", b"1"))[:-8] + bytes(8), Limits(), "a damaged one (CRC"),
        (broken_header(), Limits(), "a header that makes no sense"),
        (claiming(b"\xff" * 12), Limits(), "a header of negative size"),
        (claiming(b"\xff" * 10 + b"\xfa\x00"), Limits(), "a header of negative size"),
        (claiming(b"77777777777\0"), Limits(), "at most 1 MiB unpacked, found more"),
        *((content, Limits(), "a damaged one") for content in (b"\x1f\x8bno gzip", b"no tar at all", b"", *CUT)),
    ],
)
def test_tricks_and_damage_are_refused(content: bytes, limits: Limits, found: str) -> None:
    with pytest.raises(DataError, match=re.escape(found)) as caught:
        untarred(content, limits)
    assert all(problem.where.startswith("up.tgz") for problem in caught.value.problems)


def test_long_headers_take_no_memory() -> None:
    """An extended header of 64 MiB that packs to nothing is never held."""
    bomb = tarred(("x" * (64 << 20), b""), form=tarfile.GNU_FORMAT)
    tracemalloc.start()
    try:
        with pytest.raises(DataError, match="claims to be too long"):
            untarred(bomb)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()
