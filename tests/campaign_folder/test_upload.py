"""Uploads: what is of a campaign is laid out as one, everything else is refused and nothing of it stays."""

import io
import random
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.upload import lay_out
from crashfuse.errors import DataError
from crashfuse.files import archive
from crashfuse.files.archive import Limits
from tests.conftest import content_of

TABLE = b"id,speed_mph,front_weight_lb,rear_weight_lb\n"
TESTS, CAE = TABLE + b"T1,25,2000,1500\nT2,35,2000,1500\n", TABLE + b"C1,25,2000,1500\nB1,35,2000,1500\n"
PULSE = b"time_ms,acceleration_g\n0,0\n1,-1\n"


def zipped(*files: tuple[str, bytes]) -> bytes:
    """Pack files as a zip."""
    return archive.zipped(dict(files))


@pytest.fixture
def content(campaign_on_disk: Path) -> dict[str, bytes]:
    """Every file of the small campaign."""
    return content_of(campaign_on_disk)


@pytest.mark.parametrize("top", ["", "Our car/", "data/2024/Our car/"])
def test_a_zipped_campaign_is_the_campaign(
    content: dict[str, bytes], campaign_on_disk: Path, tmp_path: Path, top: str
) -> None:
    """With or without folders around it, and with what a Mac adds, a zip gives the campaign of the folder."""
    extra = [("__MACOSX/._tests.csv", b"x"), (f"{top}.DS_Store", b"x"), (f"{top}README.md", b"# Notes")]
    folder = lay_out(
        [("Our car.zip", zipped(*((top + name, data) for name, data in content.items()), *extra))], tmp_path
    )
    assert content_of(folder) == content
    assert folder.parent == tmp_path
    uploaded = load_campaign(folder)
    assert uploaded.name == "Our car"
    assert uploaded.fingerprint == load_campaign(campaign_on_disk).fingerprint


def test_loose_files_find_their_folder(content: dict[str, bytes], campaign: Campaign, tmp_path: Path) -> None:
    """Files without folders, as a browser sends them, give the campaign: each pulse goes where its id is."""
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
    """Criteria and the matrix of a certification are no strays: they lie beside the tables."""
    asked = {"criteria.toml": b"confidence = 0.9", "matrix.csv": TABLE + b"M1,25,2000,1500\n"}
    files = [(Path(name).name if loose else name, data) for name, data in {**content, **asked}.items()]
    folder = lay_out(files if loose else [("Our car.zip", zipped(*files))], tmp_path)
    assert {name: content_of(folder)[name] for name in asked} == asked
    assert load_campaign(folder).warnings == ()


def test_pulses_of_both_sources_are_told_apart_by_their_ids(tmp_path: Path) -> None:
    """Pulse files beside the tables go to tests/ or to cae/; an ending in capitals is read like any other."""
    uploads = [("tests.csv", TESTS), ("cae.csv", CAE), ("T1.csv", PULSE), ("T2.CSV", PULSE), ("C1.csv", PULSE)]
    folder = lay_out(uploads, tmp_path)
    assert set(content_of(folder)) == {"tests.csv", "cae.csv", "tests/T1.csv", "tests/T2.csv", "cae/C1.csv"}


def test_an_id_of_both_sources_goes_to_the_one_without_a_table_of_pulses(tmp_path: Path) -> None:
    """A paired run may be named after its test: where all CAE pulses are in a table, the loose one is the test's."""
    same = [("tests.csv", TESTS), ("cae.csv", TESTS), ("T1.csv", PULSE)]
    with pytest.raises(DataError, match="an id of both"):
        lay_out(same, tmp_path)
    assert (lay_out([*same, ("cae_pulses.csv", PULSE)], tmp_path) / "tests" / "T1.csv").is_file()


BOTH = (("tests.csv", TESTS), ("cae.csv", CAE))


@pytest.mark.parametrize(
    ("uploads", "expected"),
    [
        ([], "found nothing"),
        ([("c.zip", zipped(*BOTH)), ("T1.csv", PULSE)], "a zip among 2 files"),
        ([("c.zip", zipped(*BOTH, ("tests/more.zip", b"PK")))], "c.zip: tests/more.zip.*an archive in the upload"),
        ([("c.zip", zipped(*BOTH, ("run.exe", b"MZ")))], "run.exe.*found a file .exe"),
        ([("c.zip", zipped(*BOTH, ("model.pkl", b"x")))], "model.pkl.*found a file .pkl"),
        ([("c.zip", zipped(*BOTH, ("report.html", b"x")))], "found a file .html"),
        ([("c.zip", zipped(*BOTH, ("tests", b"x")))], "a file without an ending"),
        ([("c.zip", zipped(*BOTH, ("a.csv/cae.csv", CAE)))], "a file elsewhere"),
        ([("c.zip", zipped(*BOTH, ("tests/deep/T1.csv", PULSE)))], "a file elsewhere"),
        ([("c.zip", zipped(*BOTH, ("pyproject.toml", b"")))], "a file elsewhere"),
        ([("c.zip", zipped(("a/tests.csv", TESTS), ("b/tests.csv", TESTS)))], "b/tests.csv.*one campaign folder"),
        ([("c.zip", zipped(*BOTH, ("tests/T1.csv", PULSE), ("tests/t1.csv", PULSE)))], "more than capitals"),
        ([("c.zip", zipped(*BOTH, ("tests/Ä.csv", PULSE), ("tests/A\u0308.csv", PULSE)))], "more than capitals"),
        ([*BOTH, ("tests.csv", TESTS)], "2 of this name"),
        ([("c.zip", zipped(*BOTH, ("T1.csv", PULSE), ("tests/T1.csv", PULSE)))], "one in tests/ too"),
        ([*BOTH, ("T9.csv", PULSE)], "T9.csv: expected a pulse named after an id"),
        ([("tests.csv", TESTS), ("prog.exe", b"MZ")], "prog.exe.*\n(.*\n)*cae.csv: expected this file"),
        ([("T1.csv", PULSE)], "T1.csv: expected tests.csv and cae.csv, found neither"),
        ([("a.csv", PULSE), ("b.parquet", b"")], "upload: expected tests.csv and cae.csv, found neither"),
        ([("prog.exe", b"MZ")], "prog.exe: expected a file of a campaign .*, found a file .exe"),
        ([("a.pdf", b""), ("b.pdf", b"")], "a.pdf.*found a file .pdf.*\nb.pdf"),
        ([("c.zip", zipped(("inner.zip", zipped(*BOTH))))], "c.zip: inner.zip.*an archive in the upload; unpack it"),
        ([*BOTH, ("../T1.csv", PULSE)], "leaves its folder"),
        ([*BOTH, ("data.xlsx", PULSE)], "found a file .xlsx"),
        ([("..zip", zipped(*BOTH, ("x.exe", b"")))], "found a file .exe"),
        ([("c.zip", b"PK\x03\x04 not really")], "a sound zip"),
    ],
)  # fmt: skip
def test_what_is_no_campaign_is_refused_and_nothing_stays(
    uploads: list[tuple[str, bytes]], expected: str, tmp_path: Path
) -> None:
    """Every refusal is a sentence about the file, and leaves the folder as it was."""
    with pytest.raises(DataError, match=expected):
        lay_out(uploads, tmp_path)
    assert not list(tmp_path.iterdir())


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
    """Zip or loose files: neither may be larger than allowed."""
    loose = [(Path(name).name, data) for name, data in content.items()]
    with pytest.raises(DataError, match=expected):
        lay_out([("c.zip", zipped(*content.items()))] if packed else loose, tmp_path, limits)
    assert not list(tmp_path.iterdir())


def test_a_parquet_file_of_few_bytes_and_endless_rows_is_refused(tmp_path: Path) -> None:
    """Parquet packs a constant column to nothing, so its rows are counted too."""
    stream, column = io.BytesIO(), np.zeros(2_000_000)
    pq.write_table(pa.table({"time_ms": column, "acceleration_g": column}), stream)
    assert len(stream.getvalue()) < 100_000
    with pytest.raises(DataError, match="rows"):
        lay_out([*BOTH, ("cae_pulses.parquet", stream.getvalue())], tmp_path, Limits(rows=1_000_000))


@pytest.mark.slow
def test_damage_anywhere_is_a_sentence_and_writes_nothing_outside(content: dict[str, bytes], tmp_path: Path) -> None:
    """Cut off or with flipped bits at random, a zip is laid out or refused; no other error, no file elsewhere."""
    small = {name: data[:300] for name, data in content.items()}
    sound = zipped(*((f"car/{name}", data) for name, data in small.items()))
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
