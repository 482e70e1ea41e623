"""Before anything is added: uploads laid out safely, tables sorted by their headers, the good told from the bad."""

import io
import zipfile
from pathlib import Path

import pytest

from crashfuse.errors import DataError
from crashfuse.files.archive import Limits
from crashfuse.importing import Choices, ColumnChoice, add_settled, own_filter_class
from crashfuse.importing.draft import Reading, read_each, settle_each
from crashfuse.importing.sources import tables_of
from crashfuse.importing.table_forms import table_forms
from crashfuse.importing.unpacking import lay_out_source
from tests.importing.crashes import clock, half_sine_g
from tests.importing.test_import import GIVEN, german, library, write
from tests.readers.nhtsa_files import nhtsa_files


def zipped(files: dict[str, bytes]) -> bytes:
    """A zip of these files."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return stream.getvalue()


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


def test_tables_are_sorted_by_their_headers(tmp_path: Path) -> None:
    """Two of one form and one of conditions; what cannot be read is passed over."""
    write(library(tmp_path), {"a.csv": b"ID;v [km/h]\n1;2\n", "b.csv": b"ID;v [km/h]\n2;3\n3;4\n", "c.csv": b"\x00"})
    forms = {form.names: form for form in table_forms(tables_of(tmp_path))}
    assert set(forms) == {("a.csv", "b.csv"), ("conditions.csv",), ("runs.csv",)}
    assert forms["a.csv", "b.csv"].columns == ("ID", "v [km/h]")
    assert forms["runs.csv",].proposed.kind == "pulses"
    assert forms["runs.csv",].unit_of(["Run 0 [m/s^2]", "Run 1 [m/s^2]"]) == "m/s²"
    assert forms["runs.csv",].unit_of(["Time [s]", "Run 1 [m/s^2]"]) is None


def test_only_what_differs_from_the_proposal_is_a_choice(tmp_path: Path) -> None:
    """A column that is not picked any more is ignored; one whose unit is named otherwise keeps its role."""
    table = write(
        tmp_path, {"x.csv": german(clock(), half_sine_g(clock()), 0 * clock(), header="Zeit [ms];a [g];b [g]")}
    )
    (form,) = table_forms([table / "x.csv"])
    same = {"time": ["Zeit [ms]"], "acceleration": ["a [g]", "b [g]"], "id": ()}
    assert form.choices(same, {"time": None}) == ()  # type: ignore[arg-type]
    picked = {**same, "acceleration": ["a [g]"]}
    assert form.choices(picked, {"time": "s", "acceleration": "m/s²"}) == (  # type: ignore[arg-type]
        ColumnChoice("Zeit [ms]", "time", "s"),
        ColumnChoice("a [g]", "acceleration", "m/s²"),
        ColumnChoice("b [g]", "ignored"),
    )
    assert {choice.role for choice in form.nothing()} == {"ignored"}


def test_the_good_are_told_from_the_bad(tmp_path: Path) -> None:
    """One test without its speed, one table that is none: the rest can be added."""
    for number, speed in ((5, "56.0"), (6, "")):
        write(tmp_path / "in" / f"v{number}", nhtsa_files(number, speed=speed))
    records, unread = read_each(Reading(tmp_path / "in"))
    settled, refused = settle_each(records)
    assert [one.id for one in settled] == ["00005"]
    (problem,) = (*unread, *refused)
    assert "00006" in f"{problem.where} {problem.expected}"
    add_settled(tmp_path / "out", settled)
    assert [path.name for path in (tmp_path / "out" / "tests").iterdir()] == ["00005.csv"]
    assert own_filter_class(tmp_path / "out") is None
    nobody, why = settle_each(records[:1], Choices(channels=("7",)))
    assert nobody == ()
    assert "no channel 7" in why[0].found


def test_one_bad_table_among_good_ones_is_one_problem(tmp_path: Path) -> None:
    """The others are read."""
    good = german(clock(), half_sine_g(clock()))
    write(tmp_path, {"a.csv": good, "b.csv": good.replace(b"\n100,000000;", b"\nhundred;"), "c.csv": good})
    records, problems = read_each(Reading(tmp_path))
    assert [record.id for record in records] == ["a", "c"]
    assert [problem.found for problem in problems] == ["'hundred'"]
    assert len(settle_each(records, GIVEN)[0]) == 2
