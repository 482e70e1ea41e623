"""Uploads: what is of a campaign is laid out as one; all that is wrong with it is told in one pass."""

import random
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import lay_out, load_campaign, unread_files
from crashfuse.errors import DataError
from crashfuse.files.archive import Limits, zipped
from tests.archives import made_archive
from tests.campaign_folder.test_refusals import CAE, PULSE, TABLE, TESTS, edit, put
from tests.conftest import content_of, problems_of


@pytest.fixture
def content(campaign_on_disk: Path) -> dict[str, bytes]:
    """Every file of the small campaign."""
    return content_of(campaign_on_disk)


@pytest.mark.parametrize("top", ["", "Our car/", "data/2024/Our car/"])
def test_a_zipped_campaign_is_the_campaign(
    content: dict[str, bytes], campaign_on_disk: Path, tmp_path: Path, top: str
) -> None:
    files = {"__MACOSX/._tests.csv": b"x", f"{top}.DS_Store": b"x", f"{top}README.md": b"# Notes"}
    files |= {top + name: data for name, data in content.items()}
    folder = lay_out([("Our car.zip", zipped(files))], tmp_path)
    assert content_of(folder) == content
    assert folder.parent == tmp_path
    uploaded = load_campaign(folder)
    assert uploaded.name == "Our car"
    assert uploaded.fingerprint == load_campaign(campaign_on_disk).fingerprint


def test_loose_files_find_their_folder(content: dict[str, bytes], campaign: Campaign, tmp_path: Path) -> None:
    uploads = [(Path(name).name, data) for name, data in content.items()]
    assert not any("/" in name for name, _ in uploads)
    uploaded = load_campaign(lay_out(uploads, tmp_path))
    np.testing.assert_allclose(
        [test.pulse.accel_mps2 for test in uploaded.tests],
        [test.pulse.accel_mps2 for test in campaign.tests],
        atol=1e-4,
    )


@pytest.mark.parametrize("loose", [True, False], ids=["loose", "zipped"])
def test_what_is_asked_of_a_campaign_comes_with_it(content: dict[str, bytes], tmp_path: Path, loose: bool) -> None:
    """Criteria and matrix of a certification and past vehicles are no strays: they lie beside the tables."""
    asked = {"criteria.toml": b"confidence = 0.9", "matrix.csv": TABLE + b"M1,25,2000,1500\n"}
    asked["archive.cfa"] = made_archive().content
    files = [(Path(name).name if loose else name, data) for name, data in {**content, **asked}.items()]
    folder = lay_out(files if loose else [("Our car.zip", zipped(dict(files)))], tmp_path)
    assert {name: content_of(folder)[name] for name in asked} == asked
    assert load_campaign(folder).warnings == ()


def test_pulses_of_both_sources_are_told_apart_by_their_ids(tmp_path: Path) -> None:
    """Pulse files beside the tables go to tests/ or to cae/; an ending in capitals is read like any other."""
    uploads = [("tests.csv", TESTS), ("cae.csv", CAE), ("T1.csv", PULSE), ("T2.CSV", PULSE), ("C1.csv", PULSE)]
    folder = lay_out(uploads, tmp_path)
    assert set(content_of(folder)) == {"tests.csv", "cae.csv", "tests/T1.csv", "tests/T2.csv", "cae/C1.csv"}


def test_an_id_of_both_sources_goes_to_the_one_without_a_table_of_pulses(tmp_path: Path) -> None:
    """A paired run may be named after its test: where all CAE pulses are in a table, the loose one is the test's."""
    same = [("tests.csv", TESTS), ("cae.csv", TESTS), ("T1.csv", PULSE), ("cae_pulses.csv", PULSE)]
    assert (lay_out(same, tmp_path) / "tests" / "T1.csv").is_file()


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        (Limits(members=3), "at most 3 files"),
        (Limits(total_bytes=1000), "in all"),
        (Limits(member_bytes=1000), "a file, found more"),
        (Limits(rows=1000), "cae_pulses.parquet: expected at most 1000 rows, found 30000"),
    ],
)
@pytest.mark.parametrize("packed", [True, False])
def test_uploads_beyond_the_limits_are_refused_and_nothing_stays(
    content: dict[str, bytes], tmp_path: Path, limits: Limits, expected: str, packed: bool
) -> None:
    loose = [(Path(name).name, data) for name, data in content.items()]
    with pytest.raises(DataError, match=expected):
        lay_out([("c.zip", zipped(content))] if packed else loose, tmp_path, limits)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_damage_anywhere_is_a_sentence_and_writes_nothing_outside(content: dict[str, bytes], tmp_path: Path) -> None:
    """Cut off or with flipped bits at random, a zip is laid out or refused; no other error, no file elsewhere."""
    sound = zipped({f"car/{name}": data[:300] for name, data in content.items()})
    dice = random.Random(18571)  # noqa: S311  (no secret)
    (tmp_path / "in").mkdir()
    sentences: list[str] = []
    for _ in range(600):
        damaged = bytearray(sound)
        if dice.random() < 0.3:
            del damaged[dice.randrange(len(damaged)) :]
        for _ in range(dice.randrange(1, 6)):
            if damaged:
                damaged[dice.randrange(len(damaged))] = dice.randrange(256)
        into = tmp_path / "in" / "fresh"
        into.mkdir()
        try:
            folder = lay_out([("car.zip", bytes(damaged))], into)
        except DataError as error:
            sentences.extend(str(error).splitlines())
        else:
            shutil.rmtree(folder)
        into.rmdir()  # fails if anything is left
    assert len(sentences) > 200
    assert all(sentence.isprintable() for sentence in sentences)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


TOLD = {
    "a missing column": "tests.csv: expected one column rear_weight_lb or rear_weight_kg",
    "text for a number": "cae.csv, column front_weight_lb, row 5: expected a number, found 'heavy'",
    "an id twice": "cae.csv, column id, row 8: expected each id once, found 'C01' a second time",
    "a pulse that is missing": "tests.csv, column id: expected a pulse for T1",
    "a sample that is missing": "T2.csv, column acceleration_g, row 102: expected a number, found an empty cell",
    "a flipped sign": "flip the sign of the acceleration (deceleration is negative)",
    "a unit that is unknown": "expected one column acceleration_g or acceleration_mps2, found acceleration_ftps2",
    "damaged settings": "campaign.toml: expected a TOML file in UTF-8",
}


def spoil(campaign_folder: Path) -> dict[str, str]:
    """Spoil every file of the small campaign in another way; returns what is to be told of each."""
    for name, change in {
        "tests.csv": lambda t: t.drop(columns="rear_weight_lb"),
        "cae.csv": lambda t: t.assign(
            front_weight_lb=t.front_weight_lb.where(t.index != 3, "heavy"), id=t.id.where(t.index != 6, "C01")
        ),
        "tests/T2.csv": lambda t: t.assign(acceleration_g=t.acceleration_g.where(t.index != 100)),
        "tests/T3.csv": lambda t: t.assign(acceleration_g=-t.acceleration_g),
        "tests/T4.csv": lambda t: t.rename(columns={"acceleration_g": "acceleration_ftps2"}),
    }.items():
        edit(name, change)(campaign_folder)
    (campaign_folder / "tests" / "T1.csv").unlink()
    (campaign_folder / "campaign.toml").write_text("name = 'never closed\n")
    return TOLD


@pytest.fixture
def spoilt(campaign_folder: Path) -> Path:
    """A campaign with every file spoilt in another way."""
    spoil(campaign_folder)
    return campaign_folder


def loose(folder: Path) -> list[tuple[str, bytes]]:
    """All files of a folder."""
    return [(path.name, path.read_bytes()) for path in folder.rglob("*") if path.is_file()]


OPENED: dict[str, Callable[[Path, Path], Campaign]] = {
    "the folder": lambda folder, _: load_campaign(folder),
    "a zip": lambda folder, into: load_campaign(lay_out([("car.zip", zipped(content_of(folder)))], into)),
    "loose files": lambda folder, into: load_campaign(lay_out(loose(folder), into)),
}


@pytest.mark.parametrize("way", OPENED)
def test_a_campaign_with_every_file_spoilt_tells_it_all_at_once(spoilt: Path, tmp_path: Path, way: str) -> None:
    """Nobody has to upload eight times to hear of eight faults; and nothing else is told."""
    sentences = [str(problem) for problem in problems_of(lambda: OPENED[way](spoilt, tmp_path))]
    for fault, sentence in TOLD.items():
        assert sum(sentence in told for told in sentences) == 1, fault
    assert len(sentences) == len(TOLD)


@pytest.mark.parametrize("way", OPENED)
def test_what_does_not_belong_is_not_read_and_named(
    campaign_folder: Path, campaign_on_disk: Path, tmp_path: Path, way: str
) -> None:
    """In a folder, a zip of it and loose files alike: a text, a pulse that is nobody's, a photo among the tests."""
    (campaign_folder / "notes.docx").write_bytes(b"x")
    (campaign_folder / "T9.csv").write_bytes(b"time_ms,acceleration_g\n0,0\n")
    (campaign_folder / "tests" / "deep").mkdir()
    for name in ("T1.jpg", "deep/T8.csv"):
        (campaign_folder / "tests" / name).write_bytes(b"x")
    assert OPENED[way](campaign_folder, tmp_path).fingerprint == load_campaign(campaign_on_disk).fingerprint
    packed = tmp_path / "auto.zip"
    packed.write_bytes(zipped({f"auto/{name}": data for name, data in content_of(campaign_folder).items()}))
    laid_out = lay_out([("upload.zip", packed.read_bytes())], tmp_path)
    told = "Not read, as no file of a campaign is called so: T9.csv, notes.docx, tests/T1.jpg, tests/deep/."
    assert [unread_files(path) for path in (campaign_folder, packed, laid_out)] == [told] * 3
    assert (laid_out / "notes.docx").read_bytes() == b""  # nothing that nobody reads is unpacked


@pytest.mark.parametrize("gone", ["the file", "the ids", "the speeds"])
def test_pulses_are_checked_without_their_table(campaign_folder: Path, gone: str) -> None:
    """Without tests.csv, or a column of it, a damaged pulse is told; without speeds, one that does not brake, too."""
    if gone == "the file":
        (campaign_folder / "tests.csv").unlink()
    else:
        edit("tests.csv", lambda t: t.drop(columns="id" if gone == "the ids" else "speed_mph"))(campaign_folder)
    put("tests/T2.csv", 100, "acceleration_g", None)(campaign_folder)
    edit("tests/T3.csv", lambda t: t.assign(acceleration_g=-t.acceleration_g))(campaign_folder)
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    told = str(raised.value)
    assert told.startswith("tests.csv: ")
    assert "tests/T2.csv, column acceleration_g, row 102" in told
    assert ("expected a pulse that brakes" in told) is (gone == "the speeds")


def test_every_line_with_a_decimal_comma_is_told(campaign_folder: Path) -> None:
    table = campaign_folder / "tests.csv"
    lines = table.read_text().splitlines()
    damaged = [line.replace(".", ",", 1) if row > 1 else line for row, line in enumerate(lines)]
    table.write_text("\n".join(damaged))
    problems = problems_of(lambda: load_campaign(campaign_folder))
    rows = [problem.row for problem in problems if "write decimal points" in problem.advice]
    assert rows == [3, 4, 5]
