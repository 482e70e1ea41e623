"""Sources: the format is told by the names, and every record in a file, folder or zip is read."""

import os
import tarfile
from pathlib import Path
from tempfile import mkdtemp
from typing import Literal

import pytest

from crashfuse.errors import DataError, UsageError
from crashfuse.files.archive import Limits, zipped
from crashfuse.importing import ColumnChoice, Reading, format_of, import_source, read_records
from crashfuse.importing.sources import lay_out_source
from crashfuse.testing.readers import written
from tests.importing.crash_files import german, imported, isomme
from tests.importing.crashes import GIVEN, clock, half_sine_g, scatter_g
from tests.readers.nhtsa_files import nhtsa_files


def test_formats_are_found_by_their_names(tmp_path: Path) -> None:
    sources = {"nhtsa": nhtsa_files() | {"readme.csv": b"a"}, "isomme": isomme("M1"), "tdms": {"x.tdms": b""}}
    sources |= {"lsdyna": {"binout0000": b"", "notes.txt": b""}, "csv": {"x.XLSX": b""}}
    for fmt, files in sources.items():
        assert format_of(written(tmp_path / fmt, files)) == fmt
    written(tmp_path, {"i.zip": zipped(isomme("M1")), "e/x.pdf": b""})
    assert format_of(tmp_path / "i.zip") == "isomme"
    for path, message in (("e", "none of these"), ("nowhere", "nothing there")):
        with pytest.raises(DataError, match=message):
            format_of(tmp_path / path)
    assert read_records(Reading(tmp_path / "i.zip"))[0].id == "M1"
    written(tmp_path / "mixed", {**isomme("A"), "notes.csv": b"Name;Value\nA;B\n"})
    assert format_of(tmp_path / "mixed") == "isomme"
    written(tmp_path / "mixed" / "old", nhtsa_files())
    with pytest.raises(DataError, match="expected records of one format, found nhtsa and isomme"):
        import_source(tmp_path / "mixed", tmp_path / "campaign", GIVEN)
    (test,) = import_source(tmp_path / "mixed", tmp_path / "campaign", GIVEN, fmt="isomme")
    assert test.id == "A"


def test_what_systems_leave_in_folders_is_passed_over(tmp_path: Path) -> None:
    left = ("~$T1.xlsx", "._T1.csv", ".DS_Store", "__MACOSX/._T1.mme", "x/Thumbs.db", "x/.~lock.T1.csv#", "._T1.EV5")
    source = written(tmp_path / "in", {"T1.csv": german(clock(), half_sine_g(clock())), **dict.fromkeys(left, b"\0")})
    assert [record.id for record in read_records(Reading(source))] == ["T1"]


@pytest.mark.parametrize(("ending", "mode"), [("tar.gz", "w:gz"), ("TGZ", "w:gz"), ("tar", "w")])
def test_tar_archives_are_read_as_zips_are(tmp_path: Path, ending: str, mode: Literal["w", "w:gz"]) -> None:
    written(tmp_path / "one", isomme("M1"))
    written(tmp_path / "two", isomme("M1") | isomme("M2"))
    written(tmp_path / "table", {"T1.csv": german(clock(), half_sine_g(clock()))})
    for name, fmt, ids in (("one", "isomme", ["M1"]), ("two", "isomme", ["M1", "M2"]), ("table", "csv", ["T1"])):
        source = tmp_path / f"{name}.{ending}"
        with tarfile.open(source, mode) as archive:
            archive.add(tmp_path / name, ".")
        assert format_of(source) == fmt
        assert [record.id for record in read_records(Reading(source))] == ids
    whole = source.read_bytes()
    source.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match="expected a sound tar archive"):
        format_of(source)


@pytest.mark.parametrize("fmt", [None, "nhtsa", "csv", "tdms"])
def test_a_folder_that_cannot_be_read_is_not_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fmt: str | None
) -> None:
    written(tmp_path, {"x.csv": german(clock(), half_sine_g(clock())), "closed/y.csv": b"", "v/v00005.EV5": b""})
    listed = os.scandir

    def scandir(folder: str) -> object:
        if Path(folder).name == "closed":
            raise PermissionError(13, "Permission denied", folder)
        return listed(folder)

    monkeypatch.setattr(os, "scandir", scandir)
    with pytest.raises(DataError, match="closed: expected a readable folder, found Permission denied"):
        read_records(Reading(tmp_path, fmt))


def test_a_folder_of_tests_gives_them_all(tmp_path: Path) -> None:
    for number in (5, 6):
        written(tmp_path / "in" / f"v{number}", nhtsa_files(number))
    written(tmp_path / "mme", isomme("M1") | isomme("M2"))
    written(tmp_path / "downloads", {"notes.pdf": b"", **{f"{i}.zip": zipped(isomme(i)) for i in ("M1", "M2")}})
    for name, ids in (("in", ["00005", "00006"]), ("mme", ["M1", "M2"]), ("downloads", ["M1", "M2"])):
        assert [record.id for record in read_records(Reading(tmp_path / name))] == ids
    assert format_of(tmp_path / "downloads") == "isomme"
    assert len(import_source(tmp_path / "in", tmp_path / "out")) == 2
    pulses = {"A.csv": half_sine_g(clock()), "B.csv": half_sine_g(clock()) + scatter_g(clock(), 2)}
    tables = {name: german(clock(), pulse) for name, pulse in pulses.items()}
    for name, files in (("tables", tables), ("isomme", {**isomme("C", 4.0), **isomme("D", 6.0)})):
        (tmp_path / f"{name}.zip").write_bytes(zipped(files))
        import_source(tmp_path / f"{name}.zip", tmp_path / "campaign", GIVEN)
    assert [each["id"] for each in imported(tmp_path / "campaign")] == ["A", "B", "C", "D"]


def test_columns_are_mapped_by_the_user(tmp_path: Path) -> None:
    time_s = clock()
    other_g = half_sine_g(time_s) + scatter_g(time_s, 6.0)
    source = written(tmp_path, {"x.csv": german(time_s, half_sine_g(time_s), other_g, header="c1;c2;c3")})
    columns = [ColumnChoice.parsed(text) for text in ("c1=time:ms", "c2=acceleration:g", "c3=acceleration:g")]
    (one,) = import_source(source / "x.csv", tmp_path / "out", GIVEN, record_id="T1", columns=columns)
    assert (one.id, one.channels) == ("T1", ("c2", "c3"))
    written(tmp_path, {"c.csv": b"id;speed [km/h];front [kg];rear [kg]\nc2;56;950;750\nc3;56;950;750\n"})
    two = import_source(source / "x.csv", tmp_path / "out", columns=columns, conditions=tmp_path / "c.csv")
    assert [settled.id for settled in two] == ["c2", "c3"]
    with pytest.raises(UsageError, match="no column c9; there are c1, c2, c3"):
        read_records(Reading(source / "x.csv", columns=(ColumnChoice("c9", "time"),)))
    for text in ("c1", "c1=colour"):
        with pytest.raises(UsageError, match=rf"mapped as COLUMN=ROLE\[:UNIT\], not '{text}'"):
            ColumnChoice.parsed(text)


def test_a_table_without_pulses_says_what_it_lacks(tmp_path: Path) -> None:
    written(tmp_path, {"x.csv": b"p,q\n1,2\n1,5\n2,4\n"})
    with pytest.raises(DataError, match=r"x\.csv with the columns p, q; map the columns"):
        import_source(tmp_path / "x.csv", tmp_path / "out", GIVEN)


def test_tables_beside_another_format_are_not_passed_over_in_silence(tmp_path: Path) -> None:
    written(tmp_path, nhtsa_files())
    written(tmp_path, {"T7.csv": b"time;a", "conditions.csv": b"id,speed [km/h]\n00005,56"})
    (record,) = read_records(Reading(tmp_path, conditions=tmp_path / "conditions.csv"))
    assert "Careful: tables in the source are left out, T7.csv; import them by themselves." in record.steps
    assert not any("conditions.csv;" in step for step in record.steps)


def test_uploads_become_a_file_a_folder_or_a_folder_of_all(tmp_path: Path) -> None:
    for uploads, inside in (
        ([("a.csv", b"1")], {"a.csv": b"1"}),
        ([("run 7.zip", zipped({"x/binout0000": b"2"}))], {"run 7/x/binout0000": b"2"}),
        ([("a.csv", b"1"), ("b.zip", zipped({"c": b"3"}))], {"a.csv": b"1", "b/c": b"3"}),
    ):
        home = Path(mkdtemp(dir=tmp_path))
        source = lay_out_source(uploads, home)
        assert source.name == ("upload" if len(uploads) > 1 else next(iter(inside)).partition("/")[0])
        files = (path for path in home.rglob("*") if path.is_file())
        assert {path.relative_to(home / "upload").as_posix(): path.read_bytes() for path in files} == inside


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
    home = tmp_path / "home"
    home.mkdir()
    with pytest.raises(DataError, match=found):
        lay_out_source(uploads, home, Limits(total_bytes=5 << 20, members=8))
    assert [path.name for path in tmp_path.rglob("*")] == ["home"]
