"""From a source to a campaign: the format is found, all of it goes in or nothing, and where it came from is kept."""

import os
import random
import tomllib
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign_folder.folder import load_campaign
from crashfuse.errors import CrashfuseError, DataError, UsageError
from crashfuse.importing import Choices, ColumnChoice, Format, format_of, import_source, read_records
from crashfuse.readers.isomme import Channel, IsommeTest
from crashfuse.readers.record import PartialCondition
from crashfuse.reporting.isomme_writer import isomme_files
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.units import KPH, MS, G
from tests.conftest import SHARED, needs_shared
from tests.importing.crashes import CONDITION, SPEED_MPS, STOP_S, clock, half_sine_g, ringing_g
from tests.readers.lsdyna_files import MASS_KG, Run
from tests.readers.nhtsa_files import nhtsa_files

REAL = SHARED / "real/nhtsa_10146_camry2018"
GIVEN = Choices(condition=CONDITION)


def write(folder: Path, files: dict[str, bytes]) -> Path:
    """Write files into a folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def german(time_s: FloatArray, *pulses: FloatArray, header: str = "Zeit [ms];a_x [g]") -> bytes:
    """A table with semicolons and decimal commas."""
    rows = np.column_stack([time_s / MS, *pulses])
    lines = [header, *(";".join(f"{cell:.6f}" for cell in row) for row in rows.tolist())]
    return "\n".join(lines).replace(".", ",").encode("cp1252")


def isomme(name: str) -> dict[str, bytes]:
    """Files of an ISO-MME test."""
    descriptors = [("Velocity test object 1", f"{SPEED_MPS:.9g}"), ("Mass test object 1", "1700")]
    channel = Channel("10VEHC000000ACXP", "X", "g", half_sine_g(clock()), 1e-4, -0.05)
    return isomme_files(IsommeTest(name, descriptors, (channel,)))


def library(folder: Path) -> Path:
    """Twelve CAE runs in one foreign table, braking positive, and their conditions in another."""
    time_s = clock(0.0, 0.12)
    speeds = np.linspace(30, 60, 12)
    header = "Time [s];" + ";".join(f"Run {i} [m/s^2]" for i in range(12))
    pulses = [-G * half_sine_g(time_s) * v * KPH / SPEED_MPS for v in speeds]
    table = german(time_s * MS, *pulses, header=header)
    rows = [f"Run {i};{v:.6f};950;750".replace(".", ",") for i, v in enumerate(speeds.tolist())]
    conditions = "\n".join(["Lauf;v0 [km/h];Gewicht VA [kg];Gewicht HA [kg]", *rows])
    return write(folder, {"runs.csv": table, "conditions.csv": conditions.encode()})


def imported(folder: Path) -> list[dict[str, object]]:
    """What campaign.toml tells."""
    found: list[dict[str, object]] = tomllib.loads((folder / "campaign.toml").read_text())["imported"]
    return found


def test_a_campaign_grows_from_four_formats(tmp_path: Path) -> None:
    """NHTSA, ISO-MME and a German CSV as tests and a foreign table as CAE runs make a campaign without a warning."""
    write(tmp_path / "v00005", nhtsa_files())
    write(tmp_path / "mme", isomme("M1"))
    write(tmp_path, {"T7.csv": german(clock(), half_sine_g(clock()))})
    out = tmp_path / "campaign"
    import_source(tmp_path / "v00005", out)
    import_source(tmp_path / "mme", out, Choices(front_share=0.56))
    import_source(tmp_path / "T7.csv", out, GIVEN)
    import_source(library(tmp_path / "cae"), out, role="cae")
    campaign = load_campaign(out)
    assert campaign.test_ids == ("00005", "M1", "T7")
    assert campaign.cae.ids == tuple(f"Run {i}" for i in range(12))
    assert not campaign.warnings
    for test in campaign.tests:
        assert test.condition.speed_mps == pytest.approx(SPEED_MPS, rel=1e-6)
        assert test.pulse.kinematics(test.condition.speed_mps).t0_s == pytest.approx(STOP_S, abs=1e-3)
    assert [one["id"] for one in imported(out)][:3] == ["00005", "M1", "T7"]
    assert imported(out)[3]["braking"] == "positive"
    assert imported(out)[0]["channel_filter_class"] == 60
    assert all(one["steps"] for one in imported(out))


def test_a_record_goes_raw_into_a_campaign_that_filters(campaign_folder: Path, tmp_path: Path) -> None:
    """Filtered once, by the campaign, whole: as if it had been filtered on the way in."""
    raw = write(tmp_path, {"T9.csv": german(clock(), half_sine_g(clock()) + ringing_g(clock()))}) / "T9.csv"
    (campaign_folder / "campaign.toml").write_text("channel_filter_class = 60\n")
    import_source(raw, campaign_folder, GIVEN)
    import_source(raw, tmp_path / "other", GIVEN)
    once = load_campaign(campaign_folder).test("T9").pulse.accel_mps2
    table = np.loadtxt(tmp_path / "other" / "tests" / "T9.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(once, np.interp(GRID_S, *table.T), atol=0.02)
    with pytest.raises(UsageError, match="filters every record with CFC 60"):
        import_source(raw, campaign_folder, Choices(channel_filter_class=180), record_id="T10")


def test_all_of_a_source_or_nothing(tmp_path: Path) -> None:
    """One bad record among good ones keeps all out, and every problem is told."""
    bad = german(clock(), 0.1 * half_sine_g(clock()))
    write(tmp_path / "in", {"A.csv": german(clock(), half_sine_g(clock())), "B.csv": bad, "C.csv": bad})
    with pytest.raises(DataError) as caught:
        import_source(tmp_path / "in", tmp_path / "out", GIVEN)
    assert [problem.where for problem in caught.value.problems] == ["B.csv", "C.csv"]
    assert not (tmp_path / "out").exists()


def test_formats_are_found_by_their_names(tmp_path: Path) -> None:
    """In files, folders and zips; what is none of them is refused."""
    write(tmp_path / "n", nhtsa_files() | {"readme.csv": b"a"})
    write(tmp_path / "i", isomme("M1"))
    write(tmp_path / "d", {"binout0000": b"", "notes.txt": b""})
    write(tmp_path / "t", {"x.tdms": b""})
    write(tmp_path / "c", {"x.XLSX": b""})
    write(tmp_path / "e", {"x.pdf": b""})
    with zipfile.ZipFile(tmp_path / "i.zip", "w") as archive:
        for name, content in isomme("M1").items():
            archive.writestr(name, content)
    found = {name: format_of(tmp_path / name) for name in ("n", "i", "d", "t", "c", "i.zip")}
    assert found == {"n": "nhtsa", "i": "isomme", "d": "lsdyna", "t": "tdms", "c": "csv", "i.zip": "isomme"}
    for path, message in (("e", "none of these"), ("nowhere", "nothing there")):
        with pytest.raises(DataError, match=message):
            format_of(tmp_path / path)
    assert read_records(tmp_path / "i.zip")[0].id == "M1"


@pytest.mark.parametrize("fmt", ["nhtsa", "isomme", "lsdyna", "tdms"])
def test_a_file_of_another_kind_is_not_its_folder(tmp_path: Path, fmt: Format) -> None:
    """Whoever names a table as NHTSA gets no other test that lies somewhere below it."""
    files = {f"old test/{name}": content for name, content in nhtsa_files().items()}
    files |= {f"old mme/{name}": content for name, content in isomme("M1").items()}
    write(tmp_path, files | {"x.csv": german(clock(), half_sine_g(clock())), "run/binout": Run().binout()})
    with pytest.raises(DataError, match=r"x\.csv: expected .* found a file of another kind"):
        read_records(tmp_path / "x.csv", fmt)


@pytest.mark.parametrize("fmt", [None, "nhtsa", "csv", "tdms"])
def test_a_folder_that_cannot_be_read_is_not_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fmt: Format | None
) -> None:
    """Tests in it would silently lack."""
    write(tmp_path, {"x.csv": german(clock(), half_sine_g(clock())), "closed/y.csv": b"", "v/v00005.EV5": b""})
    listed = os.scandir

    def scandir(folder: str) -> object:
        if Path(folder).name == "closed":
            raise PermissionError(13, "Permission denied", folder)
        return listed(folder)

    monkeypatch.setattr(os, "scandir", scandir)
    with pytest.raises(DataError, match="closed: expected a folder that can be read, found Permission denied"):
        read_records(tmp_path, fmt)


def test_a_folder_of_tests_gives_them_all(tmp_path: Path) -> None:
    """One import for a whole download."""
    for number in (5, 6):
        write(tmp_path / "in" / f"v{number}", nhtsa_files(number))
    write(tmp_path / "mme", isomme("M1") | isomme("M2"))
    assert [record.id for record in read_records(tmp_path / "in")] == ["00005", "00006"]
    assert [record.id for record in read_records(tmp_path / "mme")] == ["M1", "M2"]
    assert len(import_source(tmp_path / "in", tmp_path / "out")) == 2


def test_a_folder_of_lsdyna_runs_is_a_library(tmp_path: Path) -> None:
    """Speed from the nodes, mass from the energy, the front axle's share from the user: runs become CAE runs."""
    runs = write(tmp_path / "lib", {"r1/binout0000": Run().binout(), "r2/binout": Run(direction=-1).binout()})
    settled = import_source(runs, tmp_path / "out", Choices(front_share=0.56), role="cae")
    assert [one.id for one in settled] == ["r1", "r2"]
    for one in settled:
        assert one.condition.mass_kg == pytest.approx(MASS_KG, rel=1e-3)
        assert one.pulse.kinematics(one.condition.speed_mps).t0_s == pytest.approx(STOP_S, abs=1e-4)


def test_conditions_are_joined_by_id(tmp_path: Path) -> None:
    """From a table beside the pulses or elsewhere; conditions that fit none of the pulses are a mistake."""
    table = "ID;speed [km/h];front [kg];rear [kg];drive\nt7;56;950;750;AWD\nT8;50;950;750;FWD\n"
    write(tmp_path, {"in/T7.csv": german(clock(), half_sine_g(clock())), "conditions.csv": table.encode()})
    (one,) = import_source(tmp_path / "in", tmp_path / "out", conditions=tmp_path / "conditions.csv")
    assert one.condition.factors == (("drive", "AWD"),)
    write(tmp_path, {"conditions.csv": table.replace("t7", "t6").encode()})
    with pytest.raises(DataError, match="conditions for T7, found those of t6, T8"):
        import_source(tmp_path / "in", tmp_path / "out2", conditions=tmp_path / "conditions.csv")


def test_many_who_add_at_once_lose_nothing(tmp_path: Path) -> None:
    """Eight imports into one campaign at the same time: each test has its row, its pulse and its history."""
    ids = [f"T{number}" for number in range(8)]
    for test_id in ids:
        write(tmp_path / "files", {f"{test_id}.csv": german(clock(), half_sine_g(clock()))})

    def add(test_id: str) -> None:
        import_source(tmp_path / "files" / f"{test_id}.csv", tmp_path / "campaign", GIVEN)

    with ThreadPoolExecutor(len(ids)) as pool:
        list(pool.map(add, ids))
    campaign = tmp_path / "campaign"
    assert sorted(path.stem for path in (campaign / "tests").iterdir()) == ids
    rows = (campaign / "tests.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert sorted(row.partition(",")[0].strip('"') for row in rows) == ids
    assert sorted(str(each["id"]) for each in imported(campaign)) == ids


def test_a_zip_of_several_gives_them_all(tmp_path: Path) -> None:
    """Tables, or tests of a format whose reader takes one: unpacked, read, and nothing of it stays."""
    tables = {f"{name}.csv": german(clock(), half_sine_g(clock())) for name in ("A", "B")}
    for name, files in (("tables", tables), ("isomme", {**isomme("C"), **isomme("D")})):
        with zipfile.ZipFile(tmp_path / f"{name}.zip", "w") as archive:
            for path, content in files.items():
                archive.writestr(path, content)
        import_source(tmp_path / f"{name}.zip", tmp_path / "campaign", GIVEN)
    assert [each["id"] for each in imported(tmp_path / "campaign")] == ["A", "B", "C", "D"]


def test_formats_are_not_mixed_without_a_word(tmp_path: Path) -> None:
    """A folder of two formats is refused, or read as the one that is named; tables may lie beside any."""
    write(tmp_path / "mixed", {**isomme("A"), "notes.csv": b"Name;Value\nA;B\n"})
    assert format_of(tmp_path / "mixed") == "isomme"
    write(tmp_path / "mixed" / "old", nhtsa_files())
    with pytest.raises(DataError, match="expected records of one format, found nhtsa and isomme"):
        import_source(tmp_path / "mixed", tmp_path / "campaign", GIVEN)
    (test,) = import_source(tmp_path / "mixed", tmp_path / "campaign", GIVEN, fmt="isomme")
    assert test.id == "A"


def test_an_id_is_the_one_in_the_table_of_conditions(tmp_path: Path) -> None:
    """The record is called what the user says before its conditions are looked up."""
    write(tmp_path, {"record 17.csv": german(clock(), half_sine_g(clock()))})
    write(tmp_path, {"conditions.csv": b"id,speed_kph,front_weight_kg,rear_weight_kg\nV7,56,950,700\n"})
    conditions = tmp_path / "conditions.csv"
    (test,) = import_source(tmp_path / "record 17.csv", tmp_path / "car", record_id="V7", conditions=conditions)
    assert (test.id, test.condition.front_weight_kg) == ("V7", 950)


@pytest.mark.slow
def test_a_damaged_source_never_gives_half_a_campaign(tmp_path: Path) -> None:
    """Whatever is cut off or flipped in a table or a test: our own error and no folder, or a campaign that is whole."""
    dice = random.Random(7)  # noqa: S311  (no secret)
    time_s = clock(0.0, 0.12, 2000)
    names = {"x.csv": german(time_s, half_sine_g(time_s)), "M1/Channel/M1.001": isomme("M1")["M1/Channel/M1.001"]}
    wholes = {**isomme("M1"), **names}
    refused = 0
    for round_ in range(120):
        name = dice.choice(list(names))
        content = bytearray(wholes[name])
        for _ in range(dice.choice([1, 3, 30])):
            content[dice.randrange(len(content))] = dice.randrange(256)
        source = write(tmp_path / str(round_), {**wholes, name: bytes(content[: dice.randrange(1, len(content) * 2)])})
        out = tmp_path / f"out{round_}"
        try:
            import_source(source / "x.csv" if name == "x.csv" else source / "M1", out, GIVEN)
            assert len(list((out / "tests").iterdir())) == len((out / "tests.csv").read_text().splitlines()) - 1
        except CrashfuseError:
            refused += 1
            assert not out.exists()
    assert refused > 20


def test_columns_are_mapped_by_the_user(tmp_path: Path) -> None:
    """COLUMN=ROLE:UNIT overrules the proposal; channels of one table are averaged under one id."""
    time_s = clock()
    source = write(tmp_path, {"x.csv": german(time_s, half_sine_g(time_s), half_sine_g(time_s), header="c1;c2;c3")})
    columns = [ColumnChoice.parsed(text) for text in ("c1=time:ms", "c2=acceleration:g", "c3=acceleration:g")]
    (one,) = import_source(source / "x.csv", tmp_path / "out", GIVEN, record_id="T1", columns=columns)
    assert (one.id, one.channels) == ("T1", ("c2", "c3"))
    table = (
        write(tmp_path, {"c.csv": b"id;speed [km/h];front [kg];rear [kg]\nc2;56;950;750\nc3;56;950;750\n"}) / "c.csv"
    )
    two = import_source(source / "x.csv", tmp_path / "out", columns=columns, conditions=table)
    assert [settled.id for settled in two] == ["c2", "c3"]
    with pytest.raises(UsageError, match="no column c9; there are c1, c2, c3"):
        read_records(source / "x.csv", columns=[ColumnChoice("c9", "time")])
    with pytest.raises(UsageError, match="COLUMN=ROLE or COLUMN=ROLE:UNIT, not 'c1'"):
        ColumnChoice.parsed("c1")
    with pytest.raises(UsageError, match="COLUMN=ROLE"):
        ColumnChoice.parsed("c1=colour")


def test_one_id_is_for_one_record(tmp_path: Path) -> None:
    """A source of two tests cannot share it."""
    for number in (5, 6):
        write(tmp_path / "in", nhtsa_files(number))
    with pytest.raises(UsageError, match="One id is not enough: in holds several"):
        import_source(tmp_path / "in", tmp_path / "out", record_id="T1")


def test_a_table_without_pulses_says_what_it_lacks(tmp_path: Path) -> None:
    """The columns that are there are named, and how to map them."""
    write(tmp_path, {"x.csv": b"p,q\n1,2\n1,5\n2,4\n"})
    with pytest.raises(DataError, match=r"x\.csv with the columns p, q; map the columns"):
        import_source(tmp_path / "x.csv", tmp_path / "out", GIVEN)


@needs_shared
@pytest.mark.parametrize("name", ["tidy_10kHz_raw_and_cfc60.csv", "tidy_cfc60_12p5kHz_0_100ms.csv"])
def test_a_real_test_as_a_table_is_what_it_is_in_its_own_format(tmp_path: Path, name: str) -> None:
    """Raw with what came before contact, or filtered and cut by somebody else: the same car stops alike."""
    whole = PartialCondition(57.09 * KPH, 1719.0)
    sensors = [
        f"floor_{side}_rear_xmember_X_{rank}_{'raw' if 'raw' in name else 'cfc60'}_g"
        for side in "LR"
        for rank in ("primary", "redundant")
    ]
    choices = Choices(channels=tuple(sensors), condition=whole, front_share=0.56)
    (table,) = import_source(REAL / name, tmp_path / "table", choices, record_id="camry")
    (own,) = import_source(REAL, tmp_path / "own")
    assert table.channel_filter_class == (60 if "raw" in name else None)
    mean = [one.pulse.kinematics(one.condition.speed_mps) for one in (table, own)]
    assert mean[0].t0_s == pytest.approx(mean[1].t0_s, abs=2e-5)
    assert mean[0].displacement_m.max() == pytest.approx(mean[1].displacement_m.max(), abs=5e-4)
