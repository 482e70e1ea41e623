"""The page Data takes foreign files: it shows what comes of them, and adds them to a campaign when told to."""

import io
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from openpyxl import Workbook

from crashfuse.campaign_folder.history import sample_folder
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.files.archive import zipped
from crashfuse.readers.isomme import Channel, IsommeTest
from crashfuse.results.export.isomme import isomme_files
from crashfuse.ui.kit import visitors
from crashfuse.units import KPH, MPH, G
from tests.files.test_archive import tarred
from tests.importing.crash_files import german, isomme, library
from tests.importing.crashes import SPEED_MPS, STOP_S, clock, half_sine_g, scatter_g
from tests.readers.lsdyna_files import Run
from tests.readers.nhtsa_files import nhtsa_files
from tests.ui.conftest import Session, begin
from tests.ui.test_data import kept

CONDITION = {"Speed (": 56.0, "Front weight": 950.0, "Rear weight": 750.0}
"""What a table does not say."""


def table() -> dict[str, bytes]:
    """A table as a German laboratory writes it."""
    return {"t1.csv": german(clock(), half_sine_g(clock()))}


def tables(n: int) -> dict[str, bytes]:
    """Several of them, each with other noise."""
    return {f"t{i}.csv": german(clock(), half_sine_g(clock()) + scatter_g(clock(), 1.5 * i)) for i in range(n)}


def curves(session: Session) -> dict[str, np.ndarray]:
    """Ordinates of the preview by the names of its curves; the last of a name."""
    (figure,) = session.app.get("plotly_chart")
    return {curve["name"]: np.array(curve["y"]) for curve in json.loads(figure.proto.spec)["data"]}


def into(session: Session, folder: Path) -> Session:
    session.app.text_input(key="import folder").set_value(str(folder))
    return session.run()


def added(folder: Path) -> list[str]:
    return [one["id"] for one in tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))["imported"]]


@pytest.mark.slow
def test_an_nhtsa_zip_needs_nothing_but_a_folder(tmp_path: Path) -> None:
    """Condition and channels are found and shown; the peak of the preview is that of the crash."""
    session = begin().upload({"v5.zip": zipped(nhtsa_files())})
    assert "NHTSA" in session.words
    assert session.field("Channels").value == ["93", "94", "99"]
    assert session.field("Speed (km/h)").placeholder == "56"
    assert session.field("Filter").placeholder == "CFC 60"
    assert session.charts == 1
    assert abs(curves(session)["00005"]).max() == pytest.approx(abs(half_sine_g(clock())).max(), rel=0.03)
    assert abs(curves(session)["As recorded"]).max() > 1.3 * abs(curves(session)["00005"]).max()
    session = into(session, tmp_path / "nova").press("Add as test")
    assert added(tmp_path / "nova") == ["00005"]
    assert "Added: 1 test (00005), in" in session.words
    assert "cae.csv" in session.words
    assert kept() == []
    session = session.upload(table())
    assert session.field("Take it as").value == "cae"
    assert session.field("Campaign folder").value == str(tmp_path / "nova")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "content"),
    [("m.zip", zipped(isomme("M1"))), ("m.tar.gz", tarred(*isomme("M1").items()))],
    ids=["zip", "tar.gz"],
)
def test_an_isomme_archive_says_what_it_lacks(tmp_path: Path, name: str, content: bytes) -> None:
    """It knows the mass alone; the front axle's share completes it."""
    session = begin().upload({name: content})
    assert "Before it can be added" in session.words
    assert "found the mass alone" in session.words
    assert "--front-share" not in session.words
    (button,) = [button for button in session.app.button if button.label.startswith("Add")]
    assert button.disabled
    session = into(session.fill({"Front share": 56.0}), tmp_path / "m").press("Add as test")
    assert added(tmp_path / "m") == ["M1"]
    assert "952" in (tmp_path / "m" / "tests.csv").read_text()  # 56 % of 1700 kg


def test_what_was_typed_and_cannot_be_is_named_in_the_units_of_the_fields() -> None:
    """A speed below 0 and one of a comet, a weight of nothing, a share alone: never as if nothing had been typed."""
    session = begin().upload(table())
    session.fill({"Speed in": "mph", "Weights in": "lb"})
    for speed, found in ((-5.0, "−5 mph"), (1e9, "1e+09 mph")):
        session.fill({"Speed (mph)": speed})
        assert f"above 0, and at most 224 mph, found {found}" in session.words
    assert "found the front share alone" in session.fill({"Front share": 58.0, "Speed (mph)": 35.0}).words
    assert "of 661 to 132277 lb, found −3 lb" in session.fill({"Mass": -3.0}).words
    session.fill({"Mass": 3637.0})
    assert "Front weight 2109 lb: 58 % of 3637 lb." in session.words
    assert "change of velocity is −" in session.words
    assert "km/h" not in session.words.partition("Time zero at")[0].rpartition("Sign ")[2]
    assert not any(re.search(r"\d (km/h|kg)\b", one.value) for one in session.app.markdown)


@pytest.mark.slow
def test_the_direction_of_travel_is_found_or_chosen(tmp_path: Path) -> None:
    """A model that drives along −y: the steps say so, a wrong direction is refused, the right one is kept."""
    session = begin().upload({"run.zip": zipped({"r1/binout0000": Run(step_s=5e-4, axis="y", direction=-1).binout()})})
    assert "Travel along -y, as the nodes set out." in session.fill({"Front share": 56.0}).words
    assert "Nothing of it can be read: 1 problem" in session.fill({"Direction of travel": "y"}).words
    assert "Travel along -y, given by the user." in session.fill({"Direction of travel": "-y"}).words
    session = into(session, tmp_path / "c").press("Add as CAE run")
    assert added(tmp_path / "c") == ["r1"]


@pytest.mark.slow
def test_every_sheet_of_the_table_of_conditions_is_read_as_chosen(tmp_path: Path) -> None:
    """Another sheet with other columns does not take the choice back."""
    book = Workbook()
    listed, remarks = book.active, book.create_sheet("Other lab")
    assert listed is not None
    for cells in (["Test", "front [kg]", "rear [kg]", "Typ"], ["M1", 950, 750, "A"]):
        listed.append(cells)
    for cells in (["Test", "v [km/h]"], ["M9", 56]):
        remarks.append(cells)
    stream = io.BytesIO()
    book.save(stream)
    session = begin().upload({"m.zip": zipped(isomme("M1")), "conditions.xlsx": stream.getvalue()})
    columns = session.fill({"Table of conditions": "conditions.xlsx"}).app.multiselect[0]
    assert columns.value == ["Typ"]
    columns.set_value([])
    into(session.run(), tmp_path / "m").press("Add as test")
    assert "Typ" not in (tmp_path / "m" / "tests.csv").read_text()


@pytest.mark.slow
def test_columns_without_names_are_mapped(tmp_path: Path) -> None:
    """Time, unit and acceleration are said by the user; the preview follows."""
    time_s = clock()
    session = begin().upload({"x.csv": german(time_s, 0 * time_s, half_sine_g(time_s), header="p;q;r")})
    session.fill({"Acceleration": ["r"], "Unit of time": "ms", "Unit of acceleration": "g", **CONDITION})
    session = into(session, tmp_path / "x")
    assert "Read as acceleration in g: r (chosen by the user)." in session.words
    session.press("Add as test")
    assert added(tmp_path / "x") == ["x"]
    assert load_stop(tmp_path / "x" / "tests" / "x.csv") == pytest.approx(STOP_S, abs=1e-4)


def load_stop(path: Path) -> float:
    """When the velocity is gone, by a plain sum."""
    time_s, accel = np.loadtxt(path, delimiter=",", skiprows=1).T
    velocity = SPEED_MPS + np.cumsum(accel) * (time_s[1] - time_s[0])
    return float(time_s[np.argmax(velocity <= 0)])


@pytest.mark.slow
def test_what_is_filled_in_overrules_what_was_found(tmp_path: Path) -> None:
    session = begin().upload({"v5.zip": zipped(nhtsa_files())})
    session.fill({"Channels": ["93"], "Filter": "CFC 180", "Time zero": 1.0, "Speed in": "mph"})
    session = into(session.fill({"Speed (mph)": 36.0, "Id in": "Nova"}), tmp_path / "n")
    assert "Filtered with CFC 180" in session.words
    assert "Time zero at 1 ms of the file: given by the user" in session.words
    session.press("Add as test")
    (told,) = tomllib.loads((tmp_path / "n" / "campaign.toml").read_text(encoding="utf-8"))["imported"]
    assert (told["id"], told["channels"], told["channel_filter_class"]) == ("Nova", ["93"], 180)
    row = (tmp_path / "n" / "tests.csv").read_text().splitlines()[1]
    assert float(row.split(",")[1]) == pytest.approx(36.0 * MPH / KPH)


@pytest.mark.parametrize("share", [0.0, 0.57, 100.0, 150.0])
def test_a_front_share_that_no_vehicle_has_breaks_nothing(share: float) -> None:
    """0 and 100 % of the mass, more than all of it, and 0.57 for 57: none can be added, each is said."""
    session = begin().upload({"m.zip": zipped(isomme("M1"))})
    session.fill({"Front share": share})
    assert "It cannot be added yet" in session.words or "Before it can be added" in session.words
    (button,) = [button for button in session.app.button if button.label.startswith("Add")]
    assert button.disabled
    assert f"({share:g} %)" in session.words


def test_another_unit_converts_what_is_typed_in() -> None:
    """Numbers stay what they mean: 90 km/h are 25 m/s, 1000 lb are 453.59 kg; the preview is in units of the pages."""
    session = begin().upload(table())
    session.fill({"Weights in": "lb"}).fill({"Speed (": 90.0, "Front weight": 1000.0, "Rear weight": 1000.0})
    session.fill({"Speed in": "m/s", "Weights in": "kg"})
    assert session.field("Speed (m/s)").value == pytest.approx(25.0)
    assert session.field("Front weight (kg)").value == pytest.approx(453.592, abs=1e-3)
    session.fill({"Speed (m/s)": SPEED_MPS})
    assert f"{SPEED_MPS / KPH:.1f} km/h, front 454 kg, rear 454 kg" in session.words


@pytest.mark.usefixtures("open_campaign")
def test_the_units_of_an_import_follow_those_of_the_pages() -> None:
    """Switched in the sidebar while it goes on, until another unit is chosen here."""
    session = begin().upload(table())
    session.fill({"Units of speeds": "mph-lb"}).fill({"Speed (mph)": 30.0}).fill({"Units of speeds": "kph-kg"})
    assert (session.field("Speed in").value, session.field("Weights in").value) == ("km/h", "kg")
    assert session.field("Speed (km/h)").value == pytest.approx(48.28, abs=0.01)
    session.fill({"Speed in": "mph"})
    assert (session.field("Speed in").value, session.field("Weights in").value) == ("mph", "kg")
    assert session.field("Speed (mph)").value == pytest.approx(30.0, abs=0.01)


@pytest.mark.slow
def test_a_new_session_goes_on_with_an_import(monkeypatch: pytest.MonkeyPatch) -> None:
    """The browser loads the page anew: files and what was filled in are still there, until it is left."""
    monkeypatch.setattr(visitors, "browser", lambda: "the same")
    session = begin().upload(table())
    key = session.fill({"Speed (": 56.0, "Take it as": "cae"}).go("train").go("data").app.query_params["import"]
    assert session.field("Speed (").value == 56.0
    again = begin(**{"import": key})
    assert "Nothing is added yet" in again.words
    assert again.field("Speed (").value == 56.0
    assert again.field("Take it as").value == "cae"
    again.press("Back without importing")
    assert "import" not in again.app.query_params
    assert "Nothing is added" not in begin(**{"import": key}).words


@pytest.mark.slow
def test_who_follows_the_link_of_an_import_ends_it_for_themselves_only() -> None:
    """Another browser goes back without importing; for the one who began it all is still there."""
    session = begin().upload(table())
    key = session.app.query_params["import"]
    begin(**{"import": key}).press("Back without importing")
    assert "Nothing is added yet" in session.run().words
    assert "Nothing is added yet" in begin(**{"import": key}).words


@pytest.mark.slow
def test_many_tables_are_mapped_once_and_the_bad_one_is_left_out(tmp_path: Path) -> None:
    """Three CSVs of one form and one with a word amid its numbers: three are added, of the fourth it is said why."""
    files = tables(4)
    files["t3.csv"] = files["t3.csv"].replace(b"\n100,000000;", b"\nhundred;")
    session = begin().upload(files)
    assert len([one for one in session.app.selectbox if one.label == "Time"]) == 1
    session = into(session.fill(CONDITION), tmp_path / "many")
    assert "Not everything can be added: 1 problem" in session.words
    assert "'hundred'" in session.tables[0]["Found"].tolist()
    session.press("Add 3 tests")
    assert added(tmp_path / "many") == ["t0", "t1", "t2"]


@pytest.mark.usefixtures("open_campaign")
def test_the_table_of_many_records_is_in_the_unit_of_the_page() -> None:
    """As the figure beside it is; while none can be added, the button counts none."""
    session = begin(unit="m/s²").upload(tables(2))
    assert "Add tests" in session.buttons
    session.fill({"Speed (": SPEED_MPS / MPH, "Front weight": 2100.0, "Rear weight": 1600.0})
    peak = abs(half_sine_g(clock())).max() * G
    shown = session.app.dataframe[-1].value["Peak (m/s²)"]
    assert shown.astype(float).tolist() == pytest.approx([peak, peak], rel=0.1)
    assert "Add 2 tests" in session.buttons


@pytest.mark.slow
def test_a_library_and_a_test_make_a_campaign_that_is_opened(tmp_path: Path) -> None:
    """CAE runs from a wide table with a table of conditions, then tests into the same folder: then it is open."""
    out = tmp_path / "campaign"
    session = begin().upload({path.name: path.read_bytes() for path in library(tmp_path / "cae").iterdir()})
    session = into(session.fill({"Take it as": "cae"}), out).press("Add 12 CAE runs")
    assert "Added: 12 CAE runs (" in session.words
    session = session.upload(tables(2)).fill(CONDITION).press("Add 2 tests")
    assert session.numbers["CAE runs"] == "12"
    assert session.numbers["Tests"] == "2"
    assert session.press("Open another campaign").app.text_input(key="folder")
    assert session.app.sidebar.selectbox(key="campaign").value == "campaign"
    assert load_campaign(out).test_ids == ("t0", "t1")


@pytest.mark.usefixtures("open_campaign")
def test_the_open_campaign_is_added_to(open_campaign: Path) -> None:
    """It is proposed, asks for the drive by which its tests are told apart, and shows the new test at once."""
    with (open_campaign / "campaign.toml").open("a", encoding="utf-8") as settings:
        settings.write('\nnotice = "All of it is simulated."\n')
    session = begin().upload({"v5.zip": zipped(nhtsa_files())})
    assert "“All of it is simulated.”" in session.words
    drive = session.field("drive")
    assert set(drive.options) == set(load_campaign(open_campaign).factors["drive"])
    assert session.fill({"drive": drive.options[0]}).press("Add as test").numbers["Tests"] == "5"
    added_test = load_campaign(open_campaign).tests[-1]
    assert (added_test.id, added_test.condition.factors) == ("00005", (("drive", drive.options[0]),))


@pytest.mark.slow
def test_a_campaign_that_filters_gets_the_record_raw(open_campaign: Path) -> None:
    """The preview is filtered as the campaign will; what is added is whole, with what came before contact."""
    (open_campaign / "campaign.toml").write_text("channel_filter_class = 60\n")
    session = begin().upload({"v5.zip": zipped(nhtsa_files())})
    assert session.field("Filter").value == "CFC 60, by the campaign"
    assert session.field("Filter").disabled
    assert abs(curves(session)["00005"]).max() == pytest.approx(abs(half_sine_g(clock())).max(), rel=0.03)
    session.press("Add as test")
    time_s, _ = np.loadtxt(open_campaign / "tests" / "00005.csv", delimiter=",", skiprows=1).T
    assert time_s[0] == pytest.approx(-0.05)


@pytest.mark.slow
def test_nothing_is_added_to_the_sample_or_among_other_things(tmp_path: Path) -> None:
    """Nor to a path that is none; the import stays as it is."""
    session = begin().press("Load the sample campaign")
    session = session.upload({"v5.zip": zipped(nhtsa_files())})
    assert not [one for one in session.app.radio if one.label == "Into"]
    (tmp_path / "letter.txt").write_text("Dear")
    sample = sample_folder()
    before = sorted(sample.iterdir())
    for text, found in (
        (sample, "one of crashfuse's own"),
        (sample / "new", "one of crashfuse's own"),
        (tmp_path, "a folder of other things"),
        (tmp_path / "letter.txt", "a file"),
        (Path("here"), "here"),
        (Path(), "."),
    ):
        assert into(session, text).press("Add as test").tables[-1]["Found"].tolist() == [found]
    assert sorted(sample.iterdir()) == before
    session.press("Back without importing")
    assert kept() == []
    assert session.numbers["Tests"] == "11"


def test_a_folder_of_foreign_files_is_imported_from_where_it_is(tmp_path: Path) -> None:
    (tmp_path / "v5").mkdir()
    for name, content in nhtsa_files().items():
        (tmp_path / "v5" / name).write_bytes(content)
    session = begin().open_folder(str(tmp_path / "v5"))
    assert "NHTSA" in session.words
    session.press("Back without importing")
    assert len(list((tmp_path / "v5").iterdir())) == len(nhtsa_files())


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("x.csv", b"a;b\n1;2\n"),
        ("x.csv", b"\x00\x01\x02" * 50),
        ("x.xlsx", b"no workbook"),
        ("x.tdms", b"TDSm" + b"\xff" * 60),
        ("binout", b"\x08\x08\x08\x01\x01\x01" + b"\xff" * 50),
        ("x.zip", zipped({"v1.EV5": b"----- EV5 -----\n"})),
        ("x.zip", zipped({"x.mme": b"0" * 5_000_000})),
    ],
)
@pytest.mark.slow
def test_bad_files_are_said_and_leave_nothing(name: str, content: bytes) -> None:
    """No traceback, nothing to add, and the way back leaves no file."""
    session = begin().upload({name: content})
    assert session.tables or "Before it can be added" in session.words
    assert "COLUMN=ROLE" not in session.words + "".join(table.to_string() for table in session.tables)  # no command
    assert not [one for one in session.app.button if one.label.startswith("Add") and not one.disabled]
    if "Back without importing" in session.buttons:
        session.press("Back without importing")
    assert kept() == []


@pytest.mark.slow
def test_cae_files_dropped_beside_tests_are_told_apart(tmp_path: Path) -> None:
    """Which files are CAE runs is proposed, said, and can be changed; both kinds are added at once."""
    names = {"T1": 1.5, "T2": -1.5, "CAE1": 0.8}
    files = {f"{i}.csv": german(clock(), half_sine_g(clock()) + scatter_g(clock(), s)) for i, s in names.items()}
    conditions = "\n".join(["id,speed [km/h],front [kg],rear [kg]", *(f"{i},56,900,700" for i in names)])
    session = begin().upload({**files, "conditions.csv": conditions.encode()})
    assert session.field("Of these").value == ["CAE1.csv"]
    assert "Like CAE runs, by name or number of records: CAE1.csv." in session.words
    session = into(session, tmp_path / "both")
    session.press("Add 1 CAE run and 2 tests")
    assert (tmp_path / "both" / "cae" / "CAE1.csv").is_file()
    assert sorted(path.name for path in (tmp_path / "both" / "tests").iterdir()) == ["T1.csv", "T2.csv"]


@pytest.mark.slow
def test_what_says_that_it_is_simulated_is_proposed_as_a_cae_run() -> None:
    """A prediction in ISO-MME, say; taken as a test, it cannot be added, and the page says why."""
    channel = Channel("10VEHC000000ACXP", "X", "g", half_sine_g(clock()), 1e-4, -0.05, (), "simulation")
    weights = [(f".{axle} weight test object 1", "850") for axle in ("Front", "Rear")]
    test = IsommeTest("P1", [("Velocity test object 1", "15.5"), *weights], (channel,))
    session = begin().upload({"own.zip": zipped(isomme_files(test))})
    assert session.field("Take it as").value == "cae"
    assert "Like CAE runs, by what the files say: own." in session.words
    assert "Add as CAE run" in session.buttons
    session.fill({"Take it as": "tests"})
    assert "by its own account 10VEHC000000ACXP (simulation)" in session.words
