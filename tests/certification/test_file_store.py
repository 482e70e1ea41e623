"""Matrices and certifications kept on this machine."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from crashfuse.campaign import Campaign
from crashfuse.certification import file_store
from crashfuse.certification.earlier import FILE, Earlier
from crashfuse.errors import DataError
from tests.certification.test_earlier import RECORD


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where they are kept."""
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path))
    return tmp_path / "uploads"


def test_a_file_is_found_by_its_name_until_it_is_changed(home: Path) -> None:
    """Another content is not what the link means, whoever wrote it."""
    name = file_store.keep(b"id\n", "matrix.csv")
    assert file_store.find(name) == b"id\n"
    assert file_store.keep(b"id\n", "matrix.csv") == name
    (home / name).write_bytes(b"id,\n")
    assert file_store.find(name) is None


@pytest.mark.parametrize("name", ["", "../secret", "/etc/passwd", "0" * 24, "0" * 23 + "g", "0" * 25, "0" * 24 + "\n"])
def test_a_link_reads_no_other_file(home: Path, name: str) -> None:
    """A name is 24 hexadecimal digits, or it is none."""
    home.mkdir()
    (home.parent / "secret.csv").write_bytes(b"x")
    assert file_store.find(name) is None


def test_the_least_recently_used_makes_room(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By number, by size of all, and after a year; what a link asked for counts as used."""
    monkeypatch.setattr(file_store, "_MOST", 3)
    names = [file_store.keep(bytes([number]), "matrix.csv") for number in range(3)]
    os.utime(home / names[0], (0, 0))
    file_store.find(names[0])
    used = (home / names[0]).stat().st_mtime
    for seconds, name in zip((20, 10), names[1:], strict=True):  # within the year
        os.utime(home / name, (used - seconds,) * 2)
    new = file_store.keep(b"new", "matrix.csv")
    assert {path.name for path in home.iterdir()} == {names[0], names[2], new}
    os.utime(home / names[2], (0, 0))
    file_store.keep(b"newer", "matrix.csv")
    assert file_store.find(names[2]) is None
    monkeypatch.setattr(file_store, "_MOST_BYTES", 8)
    assert file_store.find(last := file_store.keep(b"1234567", "matrix.csv")) is not None
    assert [path.name for path in home.iterdir()] == [last]


def test_too_large_a_file_is_refused_and_a_full_disk_is_told(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one sentence each; nothing is written."""
    with pytest.raises(DataError, match=r"matrix\.csv: expected at most 8 MB, found 8\.0 MB"):
        file_store.keep(b"x" * (file_store.LARGEST + 1), "matrix.csv")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(file_store, "write_atomically", full)
    with pytest.raises(DataError, match="room on the server, found No space left on device"):
        file_store.keep(b"x", "matrix.csv")
    assert not home.exists()


def test_the_certifications_of_a_vehicle_are_found_by_having_one_of_their_tests(campaign: Campaign) -> None:
    """The latest first; not another vehicle's, no matrix, none that was changed; what says the same is kept once."""
    digests = {test.id: test.digest for test in campaign.tests}
    one, *_ = digests

    def kept(day: int, tests: dict[str, str], **changed: Any) -> Earlier:
        record = {**RECORD, "date": f"2026-11-{day}T12:00:00+00:00", "tests_sha256": tests, **changed}
        return file_store.keep_certification(json.dumps(record).encode(), campaign)

    whole = kept(22, digests)
    fewer = kept(20, {"renamed": digests[one]})
    assert kept(23, digests).date == whole.date
    kept(21, {one: "0" * 64})
    file_store.keep(b"id,speed_mph\n", "matrix.csv")
    spoilt = file_store.keep(json.dumps({**RECORD, "tests_sha256": digests, "run": {}}).encode(), FILE)
    (file_store._home() / spoilt).write_bytes(json.dumps(RECORD).encode())
    found = file_store.certifications(campaign)
    assert [own.digest for own in found.values()] == [whole.digest, fewer.digest]
    assert [name == own.digest[:24] for name, own in found.items()] == [True, True]
