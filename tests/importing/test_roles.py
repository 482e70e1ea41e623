"""Tests and CAE runs in one source are told apart before anything is written."""

from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign_folder.history import undo
from crashfuse.errors import DataError, UsageError
from crashfuse.importing import Choices, import_source
from crashfuse.importing.roles import Label, parts_of
from crashfuse.readers.record import PartialCondition
from tests.importing.crash_files import german, write
from tests.importing.crashes import clock, half_sine_g, scatter_g
from tests.readers.lsdyna_files import Run


@pytest.mark.parametrize(
    ("files", "found"),
    [
        ({"CAE_wide.csv": 3, "T1.csv": 1}, ("CAE_wide.csv",)),
        ({"sim 12.csv": 1, "run07.csv": 1, "Versuch_3.csv": 1}, ("sim 12.csv", "run07.csv")),
        ({"export.csv": 72, "a.xlsx: Sheet1": 1, "a.xlsx: Sheet2": 1}, ("export.csv",)),
        ({"simca test.csv": 1, "CAE test 3.csv": 30, "B.csv": 1}, ()),
        ({"run1.csv": 1, "run2.csv": 1}, ("run1.csv", "run2.csv")),
    ],
)
def test_a_name_or_a_number_of_records_looks_like_cae(files: dict[str, int], found: tuple[str, ...]) -> None:
    """Beside others that do not, or alone; a name that says test is none."""
    labels = [Label(source, f"V{number}") for source, n in files.items() for number in range(n)]
    assert tuple(name for name, is_cae in parts_of(labels).items() if is_cae) == found


@pytest.mark.parametrize(
    ("labels", "parts"),
    [
        (
            [("V8.xlsx: Versuch 8", "Versuch 8"), ("V8.xlsx: Simulation 8", "Simulation 8")],
            {"Versuch 8": False, "Simulation 8": True},
        ),
        ([("V8.xlsx: Test", "V8"), ("V8.xlsx: CAE", "V8")], {"V8.xlsx: Test": False, "V8.xlsx: CAE": True}),
        ([("cae.csv", "Test7"), ("cae.csv", "CAE7"), ("cae.csv", "V9")], {"Test7": False, "CAE7": True, "V9": True}),
        ([("both.csv", "Versuch"), ("both.csv", "FE-Modell")], {"Versuch": False, "FE-Modell": True}),
        ([("x.csv", "sim1"), ("x.csv", "sim2")], {"x.csv": True}),
        ([("x.csv", "left"), ("x.csv", "right")], {"x.csv": False}),
    ],
)
def test_sheets_and_ids_tell_records_of_one_file_apart(labels: list[tuple[str, str]], parts: dict[str, bool]) -> None:
    """Named by their ids, or by their sheets where both have one id; what is alike stays one file."""
    assert parts_of(Label(*label) for label in labels) == parts


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """Two tests and two CAE runs with the conditions of each."""
    time_s = clock()
    names = {"T1": 1.5, "T2": -1.5, "CAE_1": 0.8, "CAE_2": -0.8}
    files = {f"{name}.csv": german(time_s, half_sine_g(time_s) + scatter_g(time_s, s)) for name, s in names.items()}
    table = "\n".join(["id,speed [km/h],front [kg],rear [kg]", *(f"{i},56,900,700" for i in names)])
    return write(tmp_path / "mixed", files | {"conditions.csv": table.encode()})


def test_a_mixture_is_asked_about_and_nothing_written(mixed: Path, tmp_path: Path) -> None:
    """The one sentence names the files, and the options that settle it."""
    with pytest.raises(DataError) as caught:
        import_source(mixed, tmp_path / "out")
    assert str(caught.value) == (
        "mixed: expected tests, found what looks like CAE runs (CAE_1.csv, CAE_2.csv) beside T1.csv, T2.csv; name "
        "those that are CAE runs (--cae CAE_1.csv CAE_2.csv), or say that all are tests (--as tests)."
    )
    assert not (tmp_path / "out").exists()
    assert len(import_source(mixed, tmp_path / "all tests", role="tests")) == 4


def test_where_all_look_like_cae_runs_it_is_asked(tmp_path: Path) -> None:
    """By name, or by a format of solvers: nothing is written before they are said to be CAE runs, or tests."""
    time_s = clock()
    content = {"sim_1.csv": german(time_s, half_sine_g(time_s)), "sim_2.csv": german(time_s, half_sine_g(time_s))}
    runs, solver = write(tmp_path / "sims", content), write(tmp_path / "lib", {"r1/binout": Run().binout()})
    for source, names in ((runs, "sim_1.csv, sim_2.csv"), (solver, "lib")):
        with pytest.raises(DataError) as caught:
            import_source(source, tmp_path / "out")
        assert str(caught.value) == (
            f"{source.name}: expected tests, found nothing but what looks like CAE runs ({names}); "
            "say that they are (--as cae), or that they are tests (--as tests)."
        )
    assert not (tmp_path / "out").exists()
    given = Choices(condition=PartialCondition(speed_mps=56 / 3.6, front_weight_kg=900.0, rear_weight_kg=700.0))
    assert {one.role for one in import_source(runs, tmp_path / "out", given, role="cae")} == {"cae"}


def test_files_that_are_cae_runs_go_where_they_belong_in_one_change(mixed: Path, tmp_path: Path) -> None:
    """Tests and CAE runs are added together, and taken back together; a file that is not there is refused."""
    out = tmp_path / "out"
    added = import_source(mixed, out, cae=("CAE_1.csv", "CAE_2.csv"))
    assert {(one.id, one.role) for one in added} == {
        ("T1", "tests"), ("T2", "tests"), ("CAE_1", "cae"), ("CAE_2", "cae"),
    }  # fmt: skip
    assert sorted(path.relative_to(out).as_posix() for path in out.glob("*/*.csv")) == [
        "cae/CAE_1.csv", "cae/CAE_2.csv", "tests/T1.csv", "tests/T2.csv",
    ]  # fmt: skip
    assert np.loadtxt(out / "cae" / "CAE_1.csv", delimiter=",", skiprows=1).shape[1] == 2
    undo(out)
    assert not list(out.glob("*.csv"))
    with pytest.raises(UsageError, match=r"no file CAE_3\.csv with records; there are CAE_1\.csv, CAE_2\.csv, T1\.csv"):
        import_source(mixed, out, cae=("CAE_3.csv",))


def test_nothing_is_added_if_either_kind_cannot_be(mixed: Path, tmp_path: Path) -> None:
    """A CAE run whose id is taken by another pulse leaves the tests out, too."""
    out = tmp_path / "out"
    import_source(mixed / "T1.csv", out, role="cae", record_id="CAE_1", conditions=mixed / "conditions.csv")
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    with pytest.raises(DataError, match="expected an id that is not there yet, found 'CAE_1'"):
        import_source(mixed, out, cae=("CAE_1.csv", "CAE_2.csv"))
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
