"""Uploaded tables of conditions on the server's disk."""

import os
from pathlib import Path

import pytest

from crashfuse.errors import DataError
from crashfuse.ui.certify import kept_tables


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where they are kept."""
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path))
    return tmp_path / "matrices"


def test_a_table_is_found_by_its_name_until_it_is_changed(home: Path) -> None:
    """Another content is not what the link means, whoever wrote it."""
    name = kept_tables.keep(b"id\n")
    assert kept_tables.find(name) == b"id\n"
    assert kept_tables.keep(b"id\n") == name
    (home / f"{name}.csv").write_bytes(b"id,\n")
    assert kept_tables.find(name) is None


@pytest.mark.parametrize("name", ["", "../secret", "/etc/passwd", "0" * 24, "0" * 23 + "g", "0" * 25, "0" * 24 + "\n"])
def test_a_link_reads_no_other_file(home: Path, name: str) -> None:
    """A name is 24 hexadecimal digits, or it is none."""
    home.mkdir()
    (home.parent / "secret.csv").write_bytes(b"x")
    assert kept_tables.find(name) is None


def test_the_least_recently_used_makes_room(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By number, by size of all, and after a year; what a link asked for counts as used."""
    monkeypatch.setattr(kept_tables, "_MOST", 3)
    names = [kept_tables.keep(bytes([number])) for number in range(3)]
    os.utime(home / f"{names[0]}.csv", (0, 0))
    kept_tables.find(names[0])
    used = (home / f"{names[0]}.csv").stat().st_mtime
    for seconds, name in zip((20, 10), names[1:], strict=True):  # within the year
        os.utime(home / f"{name}.csv", (used - seconds,) * 2)
    new = kept_tables.keep(b"new")
    assert {path.stem for path in home.iterdir()} == {names[0], names[2], new}
    os.utime(home / f"{names[2]}.csv", (0, 0))
    kept_tables.keep(b"newer")
    assert kept_tables.find(names[2]) is None
    monkeypatch.setattr(kept_tables, "_MOST_BYTES", 8)
    assert kept_tables.find(last := kept_tables.keep(b"1234567")) is not None
    assert [path.stem for path in home.iterdir()] == [last]


def test_too_large_a_table_is_refused_and_a_full_disk_is_told(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one sentence each; nothing is written."""
    with pytest.raises(DataError, match=r"matrix\.csv: expected at most 8 MB, found 8\.0 MB"):
        kept_tables.keep(b"x" * (kept_tables.LARGEST + 1))

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(kept_tables, "write_atomically", full)
    with pytest.raises(DataError, match="room to keep it on the server's disk, found No space left on device"):
        kept_tables.keep(b"x")
    assert not home.exists()
