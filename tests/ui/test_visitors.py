"""Who is in front of a session, what others may see, and the log-in."""

import os
import tempfile
import threading
from pathlib import Path

import pytest

from crashfuse.errors import DataError
from crashfuse.execution.visitors import Visitor
from crashfuse.files.archive import zipped
from crashfuse.ui.kit import campaigns, uploads, visitors
from crashfuse.ui.kit.computation import jobs
from tests.conftest import content_of
from tests.ui.conftest import Visit
from tests.ui.test_past_results import kept

ANNA = Visitor("k1", "anna@example.com")


@pytest.mark.slow
def test_an_upload_is_in_nobody_elses_list_until_they_have_its_link(visit: Visit, campaign_folder: Path) -> None:
    """Its name can't be guessed; what was computed of it is for them alone, too, also once the server has ended."""
    first = visit().upload({"secret-car.zip": zipped(content_of(campaign_folder))})
    secret = str(first.app.sidebar.selectbox(key="campaign").value)
    kept(1, campaigns.load(secret).fingerprint, campaign="secret-car")
    assert len(secret) == len("secret-car-") + 16
    second = visit()
    assert second.app.sidebar.selectbox(key="campaign").options == ["sample"]
    for guess in ("secret-car", secret[:-1], campaigns.label(secret)):
        assert "You have not opened the campaign" in visit(campaign=guess).words
    assert visit(campaign=secret).app.title[0].value == r"secret\-car"
    assert len(visit("study", study_tab="Past results", campaign=secret).app.dataframe[0].value) == 1
    assert second.run().app.sidebar.selectbox(key="campaign").options == ["sample"]
    campaigns.opened_here.clear()  # another server


@pytest.mark.usefixtures("open_campaign")
@pytest.mark.slow
def test_others_learn_whose_a_computation_is_and_not_what(visit: Visit) -> None:
    """In the sidebar and on Train; there is nothing to cancel it with."""
    gate = threading.Event()
    jobs().start("a", "secret-car: predict test T1", lambda _: gate.wait(30), ANNA)
    try:
        session = visit("train")
        assert "A computation of anna@example.com" in session.words
        assert "secret-car" not in session.words
        assert "Cancel" not in session.buttons
    finally:
        gate.set()


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The one folder that pages may open and write to."""
    folder = tmp_path / "a:b"  # one folder, whatever its name
    folder.mkdir()
    monkeypatch.setenv(visitors.ROOTS, f"{folder}\n")
    return folder


def test_pages_open_what_is_inside_the_root_and_nothing_else(root: Path, campaign_folder: Path, tmp_path: Path) -> None:
    """Whether it exists or not, by whatever way it is named: the same sentence."""
    inside = campaign_folder.rename(root / "car")
    assert campaigns.allowed(inside) == inside.resolve()
    (tmp_path / "a:b-too").mkdir()
    (root / "link").symlink_to(tmp_path)
    ways = ["/", "/nowhere", str(tmp_path), f"{root}/..", f"{root}/car/../../a:b-too", f"{root}/link", "~"]
    for way in ways:
        with pytest.raises(DataError, match=rf"expected a path inside {root}, found one outside; this server opens"):
            campaigns.allowed(Path(way))


def test_a_folder_that_leads_elsewhere_by_a_link_is_refused(root: Path, campaign_folder: Path, tmp_path: Path) -> None:
    """A pulse outside is not read by a link; a link to another place inside is fine."""
    inside = campaign_folder.rename(root / "car")
    pulse = inside / "tests" / "T1.csv"
    pulse.rename(root / "T1.csv")
    pulse.symlink_to(root / "T1.csv")
    assert campaigns.open_folder(inside) == "car"
    pulse.unlink()
    (root / "T1.csv").rename(tmp_path / "T1.csv")
    pulse.symlink_to(tmp_path / "T1.csv")
    with pytest.raises(DataError, match=r"found T1\.csv, a link to elsewhere"):
        campaigns.open_folder(inside)


@pytest.mark.parametrize("leads_out", ["tests/T1.csv", "campaign.toml", "notes.csv", "criteria.toml", ""])
def test_a_link_made_after_opening_is_followed_by_no_read_and_no_write(
    leads_out: str, root: Path, campaign_folder: Path, tmp_path: Path, visit: Visit
) -> None:
    """A pulse, the settings, a table, or all of the folder: neither is read nor written, and the page says why."""
    inside, outside = campaign_folder.rename(root / "car"), tmp_path / "outside"
    for file in ("campaign.toml", "criteria.toml"):
        (inside / file).touch()
    (inside / "notes.csv").write_text("test,start_ms,end_ms,text\n")
    name = campaigns.open_folder(inside)
    session = visit(campaign=name)
    (inside / leads_out).rename(outside)
    (inside / leads_out).symlink_to(outside)
    before = content_of(tmp_path)
    session.fill({"Tests in use": ["T1", "T2", "T3"]})
    assert session.tables[0]["Found"].str.contains("a link to elsewhere|one outside").all()
    with pytest.raises(DataError, match="this server opens and writes nothing else"):
        campaigns.load(name)
    assert content_of(tmp_path) == before


def test_uploads_of_a_killed_server_are_deleted_as_the_next_one_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those without a lock, too; not those of one that runs, nor what is of somebody else."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    running = uploads._scratch()
    killed, other = tmp_path / "crashfuse-uploads-x", tmp_path / "crashfuse-y"
    for folder in (killed, other):
        folder.mkdir()
        folder.with_suffix(".lock").touch()
    for folder in (running, killed, other):
        os.utime(folder.with_suffix(".lock"), (0, 0))
    (unlocked := tmp_path / "crashfuse-uploads-z").mkdir()
    os.utime(unlocked, (0, 0))
    uploads.sweep_uploads()
    assert running.is_dir()
    assert other.is_dir()
    assert sorted(tmp_path.glob("crashfuse-uploads-*")) == [running, running.with_suffix(".lock")]


@pytest.mark.usefixtures("open_campaign")
def test_a_log_in_stays_required_if_its_file_is_lost(visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    """Streamlit would then know of no log-in, and let in everybody."""
    lost = threading.Event()
    lost.set()
    monkeypatch.setattr(visitors, "login_insisted", lost)
    session = visit("train")
    assert "Nobody can log in at the moment." in session.words
    assert not session.app.selectbox
    assert not session.charts
