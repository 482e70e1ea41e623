"""Uploads laid out safely: content kept to the byte, tricks refused."""

from pathlib import Path

import pytest

from crashfuse.errors import DataError
from crashfuse.files.archive import Limits, zipped
from crashfuse.importing.unpacking import lay_out_source


def test_uploads_become_a_file_a_folder_or_a_folder_of_all(tmp_path: Path) -> None:
    """A zip is unpacked under its own name; the content is kept to the byte."""
    for number, (uploads, inside) in enumerate(
        [
            ([("a.csv", b"1")], {"a.csv": b"1"}),
            ([("run 7.zip", zipped({"x/binout0000": b"2"}))], {"run 7/x/binout0000": b"2"}),
            ([("a.csv", b"1"), ("b.zip", zipped({"c": b"3"}))], {"a.csv": b"1", "b/c": b"3"}),
        ]
    ):
        home = tmp_path / str(number)
        home.mkdir()
        source = lay_out_source(uploads, home)
        assert source.name == ("upload" if len(uploads) > 1 else next(iter(inside)).partition("/")[0])
        found = {
            str(path.relative_to(home / "upload")): path.read_bytes() for path in home.rglob("*") if path.is_file()
        }
        assert found == inside


@pytest.mark.parametrize(
    ("uploads", "found"),
    [
        ([("x.zip", zipped({"../y": b""}))], "a path that leaves its folder"),
        ([("../x.csv", b"")], "a path that leaves its folder"),
        ([("a.csv", b""), ("a.csv", b"")], "another file of this name"),
        ([("a", b""), ("a.zip", zipped({"b": b""}))], "another file of this name"),
        ([("bomb.zip", zipped({"b": b"0" * 5_000_000}))], "zip bomb"),
        ([("broken.zip", b"PK")], "a damaged one"),
        ([(f"{i}.csv", b"") for i in range(9)], "9"),
        ([("a.csv", b"0" * 6_000_000)], "more"),
    ],
)
def test_tricks_are_refused_and_leave_nothing(tmp_path: Path, uploads: list[tuple[str, bytes]], found: str) -> None:
    """Names, sizes and damage, all before a reader sees anything."""
    home = tmp_path / "home"
    home.mkdir()
    with pytest.raises(DataError, match=found):
        lay_out_source(uploads, home, Limits(total_bytes=5 << 20, members=8))
    assert [path.name for path in tmp_path.rglob("*")] == ["home"]
