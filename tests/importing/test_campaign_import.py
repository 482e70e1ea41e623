"""From a source to a campaign: all of it goes in or nothing, and where it came from is kept."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign_folder.condition_tables import read_conditions
from crashfuse.campaign_folder.history import undo
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.settings import sound_settings
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.importing import Choices, Reading, add_settled, import_source, read_each, settle_each
from crashfuse.importing.campaign_import import Label, parts_of
from crashfuse.readers.record import PartialCondition
from crashfuse.signals.pulse import GRID_S
from crashfuse.testing.readers import written
from crashfuse.units import KPH, MS
from tests.conftest import SHARED, content_of, needs_shared, problems_of
from tests.importing.crash_files import german, imported, isomme, library
from tests.importing.crashes import GIVEN, SPEED_MPS, STOP_S, clock, half_sine_g, ringing_g, scatter_g
from tests.readers.lsdyna_files import Run
from tests.readers.nhtsa_files import nhtsa_files

REAL = SHARED / "real/nhtsa_10146_camry2018"


def test_a_campaign_grows_from_four_formats(tmp_path: Path) -> None:
    written(tmp_path / "v00005", nhtsa_files())
    written(tmp_path / "mme", isomme("M1", scatter=1.5))
    written(tmp_path, {"T7.csv": german(clock(), half_sine_g(clock()) + scatter_g(clock(), -1.5))})
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
    assert imported(out)[3]["deceleration_sign"] == "positive"
    assert imported(out)[0]["channel_filter_class"] == 60
    assert all(one["steps"] for one in imported(out))


def test_a_record_goes_raw_into_a_campaign_that_filters(campaign_folder: Path, tmp_path: Path) -> None:
    raw = written(tmp_path, {"T9.csv": german(clock(), half_sine_g(clock()) + ringing_g(clock()))}) / "T9.csv"
    (campaign_folder / "campaign.toml").write_text("channel_filter_class = 60\n")
    import_source(raw, campaign_folder, GIVEN)
    import_source(raw, tmp_path / "other", GIVEN)
    once = load_campaign(campaign_folder).test("T9").pulse.accel_mps2
    table = np.loadtxt(tmp_path / "other" / "tests" / "T9.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(once, np.interp(GRID_S, *table.T), atol=0.02)
    with pytest.raises(UsageError, match="filters every record with CFC 60"):
        import_source(raw, campaign_folder, Choices(channel_filter_class=180), record_id="T10")


def test_all_of_a_source_or_nothing(tmp_path: Path) -> None:
    bad = german(clock(), 0.1 * half_sine_g(clock()))
    written(tmp_path / "in", {"A.csv": german(clock(), half_sine_g(clock())), "B.csv": bad, "C.csv": bad})
    problems = problems_of(lambda: import_source(tmp_path / "in", tmp_path / "out", GIVEN))
    assert [problem.where for problem in problems] == ["B.csv", "C.csv"]
    assert not (tmp_path / "out").exists()


def test_conditions_are_joined_by_id(tmp_path: Path) -> None:
    table = "ID;speed [km/h];front [kg];rear [kg];drive\nt7;56;950;750;AWD\nT8;50;950;750;FWD\n"
    written(tmp_path, {"in/T7.csv": german(clock(), half_sine_g(clock())), "conditions.csv": table.encode()})
    (one,) = import_source(tmp_path / "in", tmp_path / "out", conditions=tmp_path / "conditions.csv")
    assert one.condition.factors == (("drive", "AWD"),)
    (one,) = import_source(tmp_path / "in", tmp_path / "car", record_id="T8", conditions=tmp_path / "conditions.csv")
    assert one.id == "T8"
    assert one.condition.speed_mps == pytest.approx(50 * KPH)
    written(tmp_path, {"conditions.csv": table.replace("t7", "t6").encode()})
    with pytest.raises(DataError, match="conditions for T7, found those of t6, T8"):
        import_source(tmp_path / "in", tmp_path / "out2", conditions=tmp_path / "conditions.csv")


def test_what_the_cae_model_has_seen_is_said_on_import(tmp_path: Path) -> None:
    out = tmp_path / "campaign"
    for number, tuned in enumerate((None, True, False)):
        record = german(clock(), (1 + 0.1 * number) * half_sine_g(clock()) + scatter_g(clock(), 0.5 * number))
        source = written(tmp_path, {f"T{number}.csv": record}) / f"T{number}.csv"
        import_source(source, out, GIVEN, cae_tuned=tuned)
    table = read_conditions(out / "tests.csv")
    assert table.tuned == (None, True, False)
    assert not any("cae_tuned" in dict(own.factors) for own in table.conditions)


def test_many_who_add_at_once_lose_nothing(tmp_path: Path) -> None:
    ids = [f"T{number}" for number in range(8)]
    for number, test_id in enumerate(ids):
        pulse = half_sine_g(clock()) + scatter_g(clock(), 2.0 * number)
        written(tmp_path / "files", {f"{test_id}.csv": german(clock(), pulse)})

    def add(test_id: str) -> None:
        import_source(tmp_path / "files" / f"{test_id}.csv", tmp_path / "campaign", GIVEN)

    with ThreadPoolExecutor(len(ids)) as pool:
        list(pool.map(add, ids))
    campaign = tmp_path / "campaign"
    assert sorted(path.stem for path in (campaign / "tests").iterdir()) == ids
    assert sorted(read_conditions(campaign / "tests.csv").ids) == ids
    assert sorted(str(each["id"]) for each in imported(campaign)) == ids


@needs_shared
@pytest.mark.parametrize("name", ["tidy_10kHz_raw_and_cfc60.csv", "tidy_cfc60_12p5kHz_0_100ms.csv"])
def test_a_real_test_as_a_table_is_what_it_is_in_its_own_format(tmp_path: Path, name: str) -> None:
    whole = PartialCondition(57.09 * KPH, 1719.0)
    ranks, form = ("primary", "redundant"), "raw" if "raw" in name else "cfc60"
    sensors = [f"floor_{side}_rear_xmember_X_{rank}_{form}_g" for side in "LR" for rank in ranks]
    choices = Choices(channels=tuple(sensors), condition=whole, front_share=0.56)
    (table,) = import_source(REAL / name, tmp_path / "table", choices, record_id="camry")
    (own,) = import_source(REAL, tmp_path / "own")
    assert table.channel_filter_class == (60 if "raw" in name else None)
    mean = [one.pulse.kinematics(one.condition.speed_mps) for one in (table, own)]
    assert mean[0].t0_s == pytest.approx(mean[1].t0_s, abs=2e-5)
    assert mean[0].displacement_m.max() == pytest.approx(mean[1].displacement_m.max(), abs=5e-4)


def crash(folder: Path, name: str, slower: float, scatter: float) -> None:
    """A table with the pulse of one crash, slower by a share, without its condition."""
    written(folder, {name: german(clock(), half_sine_g(clock()) * (1 - slower) + scatter_g(clock(), scatter))})


def test_what_many_records_lack_is_asked_for_once_with_the_table_that_gives_each_its_own(tmp_path: Path) -> None:
    """An option would give all the same speed. One row that is missing is asked for, too; a record alone by option."""
    for name in ("A.csv", "B.csv"):
        crash(tmp_path / "in", name, 0.0, 1.0)

    def asked(conditions: Path | None = None) -> list[str]:
        problems = problems_of(lambda: import_source(tmp_path / "in", tmp_path / "out", conditions=conditions))
        return [str(problem) for problem in problems]

    speed, weights, *_ = asked()
    assert speed.startswith("A.csv to B.csv: expected the impact speed of A, B, found none; give a table")
    assert "the weights on both axles of A, B, found none; give a table" in weights
    table = tmp_path / "conditions.csv"
    for ids, told in (
        (["A"], "B.csv: expected the impact speed of B, found none; give a table"),
        (["A-1"], "conditions: expected conditions for A, B, found those of A-1; make the ids the same."),
        (["A", "V_B"], "B.csv: expected the impact speed of B, found conditions without a record, of V_B"),
    ):
        table.write_text("\n".join(["id;v [km/h];VA [kg];HA [kg]", *(f"{one};56;950;750" for one in ids)]))
        assert asked(table)[0].startswith(told)
    with pytest.raises(DataError, match="give the speed"):
        import_source(tmp_path / "in" / "A.csv", tmp_path / "out")


def test_one_speed_for_records_of_several_is_told_with_care(tmp_path: Path) -> None:
    """Changes of velocity that differ by 10 % are of two speeds; by 2 %, of repeats whose rebounds differ."""
    for name, slower, scatter in (("A.csv", 0.0, 1.5), ("B.csv", 1.0, -1.5)):
        crash(tmp_path / "in", name, 0.1 * slower, scatter)
        crash(tmp_path / "alike", name, 0.02 * slower, scatter)
    told = [one.steps[-1] for one in import_source(tmp_path / "in", tmp_path / "a", GIVEN)]
    assert len(told) == 2
    assert all("one speed for all 2 records" in step for step in told)
    alike = import_source(tmp_path / "alike", tmp_path / "b", GIVEN)
    assert not any("one speed" in step for one in alike for step in one.steps)


@pytest.mark.parametrize(
    ("names", "differs_g", "is_told"),
    [
        (("V7_SillLeft", "V7_SillRight"), 1.5, True),
        (("V7 B-Säule li", "V7 Tunnel"), 4.0, True),
        (("v7_acc1", "v7_acc2"), 4.0, True),
        (("93", "94"), 1.5, True),
        (("93", "94"), 6.0, False),
    ],
)
def test_sensors_of_one_crash_a_file_each_are_told(
    tmp_path: Path, names: tuple[str, str], differs_g: float, is_told: bool
) -> None:
    """By their names, or as one condition was given for records that are alike; repeats differ by more."""
    waves_g = (half_sine_g(clock()) + scatter_g(clock(), by) for by in (0.0, differs_g))
    files = {f"{name}.csv": german(clock(), wave) for name, wave in zip(names, waves_g, strict=True)}
    settled = import_source(written(tmp_path / "lab", files), tmp_path / "campaign", GIVEN)
    told = [step for one in settled for step in one.steps if step.startswith("Careful: at one condition with ")]
    assert len(told) == 2 * is_told


@needs_shared
def test_sills_of_another_crash_are_told(tmp_path: Path) -> None:
    source = SHARED / "real" / "formats" / "one_file_per_sensor" / "V7"
    choices = Choices(condition=PartialCondition(51.12 * KPH, front_weight_kg=905, rear_weight_kg=655))
    settled = import_source(source, tmp_path / "campaign", choices)
    assert [one.steps[-1].split(";")[0] for one in settled] == [
        f"Careful: at one condition with V7_{other} (alike to 7 %)" for other in ("SillRight", "SillLeft")
    ]


def test_the_good_are_told_from_the_bad(tmp_path: Path) -> None:
    for number, speed in ((5, "56.0"), (6, "")):
        written(tmp_path / "in" / f"v{number}", nhtsa_files(number, speed=speed))
    records, unread = read_each(Reading(tmp_path / "in"))
    refused: list[Problem] = []
    settled = settle_each(records, refused)
    assert [one.id for one in settled] == ["00005"]
    (problem,) = (*unread, *refused)
    assert "00006" in f"{problem.where} {problem.expected}"
    add_settled(tmp_path / "out", settled)
    assert [path.name for path in (tmp_path / "out" / "tests").iterdir()] == ["00005.csv"]
    assert sound_settings(tmp_path / "out").channel_filter_class is None
    misled = Choices(channels=("7",))
    with pytest.raises(UsageError, match="no channel 7"):
        settle_each(records[:1], [], misled)
    why: list[Problem] = []
    assert settle_each(records[:1], why, misled, tolerant=True) == ()
    assert "no channel 7" in why[0].found


def test_the_unit_that_a_slow_run_leaves_open_is_that_of_the_others(tmp_path: Path) -> None:
    """A creeping CAE run fits any unit; the other columns of its table tell, and the record says so."""
    time_s = np.arange(0, 0.12, 1e-4)
    speeds_kph = {"R1": 3.0, "R2": 30.0, "R3": 50.0}
    hump = np.pi / 0.14 * np.sin(np.pi * time_s / 0.07) * (time_s < 0.07)
    columns = np.column_stack([time_s / MS, *(v * KPH * hump for v in speeds_kph.values())])
    rows = [",".join(["time", *speeds_kph]), *(",".join(f"{x:.6g}" for x in row) for row in columns)]
    table = ["id,speed [km/h],front [kg],rear [kg]", *(f"{i},{v},900,700" for i, v in speeds_kph.items())]
    written(tmp_path / "runs", {"runs.csv": "\n".join(rows).encode(), "conditions.csv": "\n".join(table).encode()})
    settled = import_source(tmp_path / "runs", tmp_path / "campaign", role="cae")
    assert [(one.id, one.unit) for one in settled] == [("R1", "m/s²"), ("R2", "m/s²"), ("R3", "m/s²")]
    assert "Unit m/s², from 2 records beside it." in settled[0].steps
    slow = {"R1.csv": [",".join(row.split(",")[:2]) for row in rows], "conditions.csv": table[:2]}
    written(tmp_path / "alone", {name: "\n".join(of).encode() for name, of in slow.items()})
    with pytest.raises(DataError, match="a unit that neither file nor speed tells"):
        import_source(tmp_path / "alone", tmp_path / "other", role="cae")


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
    labels = [Label(source, f"V{number}") for source, n in files.items() for number in range(n)]
    assert tuple(name for name, is_cae in parts_of(labels).items() if is_cae) == found


@pytest.mark.parametrize(
    ("labels", "parts"),
    [
        ([("V.xlsx: Versuch", "Versuch"), ("V.xlsx: CAE", "CAE")], {"Versuch": False, "CAE": True}),
        ([("V8.xlsx: Test", "V8"), ("V8.xlsx: CAE", "V8")], {"V8.xlsx: Test": False, "V8.xlsx: CAE": True}),
        ([("cae.csv", "Test7"), ("cae.csv", "CAE7"), ("cae.csv", "V9")], {"Test7": False, "CAE7": True, "V9": True}),
        ([("both.csv", "Versuch"), ("both.csv", "FE-Modell")], {"Versuch": False, "FE-Modell": True}),
        ([("x.csv", "sim1"), ("x.csv", "sim2")], {"x.csv": True}),
        ([("x.csv", "left"), ("x.csv", "right")], {"x.csv": False}),
    ],
)
def test_sheets_and_ids_tell_records_of_one_file_apart(labels: list[tuple[str, str]], parts: dict[str, bool]) -> None:
    assert parts_of(Label(*label) for label in labels) == parts


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """Two tests and two CAE runs with the conditions of each."""
    time_s = clock()
    names = {"T1": 1.5, "T2": -1.5, "CAE_1": 0.8, "CAE_2": -0.8}
    files = {f"{name}.csv": german(time_s, half_sine_g(time_s) + scatter_g(time_s, s)) for name, s in names.items()}
    table = "\n".join(["id,speed [km/h],front [kg],rear [kg]", *(f"{i},56,900,700" for i in names)])
    return written(tmp_path / "mixed", files | {"conditions.csv": table.encode()})


def test_a_mixture_is_asked_about_and_nothing_written(mixed: Path, tmp_path: Path) -> None:
    (problem,) = problems_of(lambda: import_source(mixed, tmp_path / "out"))
    assert problem.found == "what looks like CAE runs (CAE_1.csv, CAE_2.csv) beside T1.csv, T2.csv"
    assert "(--cae CAE_1.csv CAE_2.csv)" in problem.advice
    assert not (tmp_path / "out").exists()
    assert len(import_source(mixed, tmp_path / "all tests", role="tests")) == 4


def test_where_all_look_like_cae_runs_it_is_asked(tmp_path: Path) -> None:
    content = dict.fromkeys(("sim_1.csv", "sim_2.csv"), german(clock(), half_sine_g(clock())))
    runs, solver = written(tmp_path / "sims", content), written(tmp_path / "lib", {"r1/binout": Run().binout()})
    for source, names in ((runs, "sim_1.csv, sim_2.csv"), (solver, "lib")):
        (problem,) = problems_of(partial(import_source, source, tmp_path / "out"))
        assert problem.found == f"what looks like CAE runs ({names})"
        assert "(--as cae)" in problem.advice
    assert not (tmp_path / "out").exists()
    given = Choices(condition=PartialCondition(speed_mps=56 / 3.6, front_weight_kg=900.0, rear_weight_kg=700.0))
    assert {one.role for one in import_source(runs, tmp_path / "out", given, role="cae")} == {"cae"}


def test_files_that_are_cae_runs_go_where_they_belong_in_one_change(mixed: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    added = import_source(mixed, out, cae=("CAE_1.csv", "CAE_2.csv"))
    roles = {"CAE_1": "cae", "CAE_2": "cae", "T1": "tests", "T2": "tests"}
    assert {one.id: one.role for one in added} == roles
    paths = sorted(path.relative_to(out).as_posix() for path in out.glob("*/*.csv"))
    assert paths == [f"{role}/{name}.csv" for name, role in roles.items()]
    assert np.loadtxt(out / "cae" / "CAE_1.csv", delimiter=",", skiprows=1).shape[1] == 2
    undo(out)
    assert not list(out.glob("*.csv"))
    import_source(mixed / "T1.csv", out, role="cae", record_id="CAE_1", conditions=mixed / "conditions.csv")
    before = content_of(out)
    with pytest.raises(DataError, match="expected an id that is not there yet, found 'CAE_1'"):
        import_source(mixed, out, cae=("CAE_1.csv", "CAE_2.csv"))
    assert content_of(out) == before  # its id is taken by another pulse: the tests are left out, too
    with pytest.raises(UsageError, match=r"no file CAE_3\.csv with records; there are CAE_1\.csv, CAE_2\.csv, T1\.csv"):
        import_source(mixed, out, cae=("CAE_3.csv",))
