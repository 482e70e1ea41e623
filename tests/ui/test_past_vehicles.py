"""The part of the page Train on past vehicles."""

import shutil
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from crashfuse.campaign import Campaign
from crashfuse.execution.progress import Watch
from crashfuse.vehicle_archive import VehicleArchive, load_archive
from tests.archives import made_archive
from tests.ui.conftest import SOON, Session, begin

LEARN = "Learn an archive"


def test_an_archive_is_put_in_shown_and_taken_out(open_campaign: Path) -> None:
    """What is in use stands on every page, which links here; Undo puts it back."""
    file, content = open_campaign / "archive.cfa", made_archive().content
    session = begin("train").give("past.cfa", content)
    assert file.read_bytes() == content
    assert "Archive of 3 vehicles" in session.go("data").answer
    session.press("Archive of 3 vehicles")
    assert "teaches this one as far as it is like them: Sedan, Van and Coupe." in session.words
    assert "the others changed the mean rating by +0.050" in session.words
    (record,) = [table for table in session.tables if "Vehicle left out" in table]
    assert len(record) == 6
    session.press("Use none")
    assert not file.exists()
    assert "Use none" not in session.buttons
    session.press("Undo")
    assert file.read_bytes() == content
    assert "Archive of 3 vehicles" in session.answer


def test_a_file_that_is_no_archive_changes_nothing(open_campaign: Path) -> None:
    session = begin("train").give("past.cfa", b"no archive")
    assert "Nothing was changed" in session.words
    assert session.tables[-1]["File"].tolist() == ["archive.cfa"]
    assert not (open_campaign / "archive.cfa").exists()


def test_the_sample_tells_where_an_archive_can_be_put() -> None:
    session = begin("train", campaign="sample")
    assert "crashfuse sample DIR" in session.words
    assert not session.app.file_uploader


@pytest.fixture
def three(open_campaign: Path, tmp_path: Path) -> Session:
    """A visitor who has opened three campaigns, and looks at the first."""
    session = begin("data")
    for name in ("van", "coupe"):
        session.open_folder(str(shutil.copytree(open_campaign, tmp_path / name)))
    session.app.sidebar.selectbox(key="campaign").set_value("campaign")
    return session.run().go("train")


@pytest.fixture
def going_on() -> Iterator[threading.Barrier]:
    """Where learning waits for the test twice: once it has begun, and before it ends."""
    barrier = threading.Barrier(2)
    yield barrier
    barrier.abort()


def test_an_archive_is_learned_from_open_campaigns(
    three: Session, open_campaign: Path, going_on: threading.Barrier, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A job with progress; what it learned is a file, and can be used here, where it is without this campaign."""

    def learn(campaigns: Sequence[Campaign], *, seed: int, watch: Watch) -> VehicleArchive:
        assert (seed, [campaign.name for campaign in campaigns]) == (0, ["campaign", "van", "coupe"])
        watch.report("Tuning of the pre-trained network", 1, 4)
        going_on.wait(SOON)
        going_on.wait(SOON)
        return made_archive(campaigns[0])

    monkeypatch.setattr("crashfuse.study.archive_learning.learn_archive", learn)
    assert "Choose 3 or more; 4 are open" in three.words
    assert LEARN not in three.buttons
    three.app.multiselect(key="past vehicles").set_value(["campaign", "van", "coupe"])
    three.run().press(LEARN)
    going_on.wait(SOON)
    assert "Tuning of the pre-trained network" in three.run().words
    assert "Cancel" in three.buttons
    going_on.wait(SOON)
    assert three.finish().downloads == ["archive.cfa"]
    three.press("Use it for this campaign")
    assert "campaign, which this is, was taken out of it" in three.words
    assert three.downloads == ["archive.cfa"]  # what was learned is still there
    assert load_archive(open_campaign / "archive.cfa").vehicles[-1].name == "campaign"
