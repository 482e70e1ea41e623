"""Campaign folders that are written: nothing is lost, nothing is half there, nothing is overwritten."""

from dataclasses import replace
from pathlib import Path

import pytest

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder import writer
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.writer import write_campaign
from crashfuse.errors import DataError
from tests.conftest import content_of


def test_a_campaign_survives_the_round_trip(campaign_on_disk: Path, tmp_path: Path) -> None:
    """Loaded, written and loaded again it has the same fingerprint, name, notice and factors."""
    loaded = replace(load_campaign(campaign_on_disk), name='Our "car" №1', notice="synthetic: «one»")
    write_campaign(loaded, str(tmp_path / "again"))
    again = load_campaign(tmp_path / "again")
    assert again.fingerprint == loaded.fingerprint
    assert (again.name, again.notice, again.factors) == (loaded.name, loaded.notice, loaded.factors)
    assert not again.warnings
    write_campaign(again, tmp_path / "third")
    assert content_of(tmp_path / "third") == content_of(tmp_path / "again")


def test_awkward_texts_survive(campaign: Campaign, tmp_path: Path) -> None:
    """Commas, quotes, spaces at the ends and other scripts, in ids and factors."""
    factors = (("drive, kind", ' "all" '), ("größe", "x;y"))
    tests = tuple(
        replace(test, id=f"{test.id}, n° «{i}»", condition=replace(test.condition, factors=factors))
        for i, test in enumerate(campaign.tests)
    )
    write_campaign(replace(campaign, tests=tests), tmp_path / "c")
    again = load_campaign(tmp_path / "c")
    assert again.test_ids == tuple(test.id for test in tests)
    assert again.tests[0].condition == tests[0].condition


def test_filtered_pulses_are_not_filtered_again(campaign_folder: Path, tmp_path: Path) -> None:
    """A campaign that was filtered when it was read is written filtered, and says so."""
    (campaign_folder / "campaign.toml").write_text("channel_filter_class = 60\n")
    loaded = load_campaign(campaign_folder)
    write_campaign(loaded, tmp_path / "again")
    again = load_campaign(tmp_path / "again")
    assert again.fingerprint == loaded.fingerprint
    assert again.channel_filter_class == 60
    with (tmp_path / "again" / "campaign.toml").open("a") as stream:
        stream.write("channel_filter_class = 60\n")
    with pytest.raises(DataError, match="or pulses are filtered twice"):
        load_campaign(tmp_path / "again")


def test_a_folder_that_holds_something_is_left_alone(campaign: Campaign, tmp_path: Path) -> None:
    """Writing refuses it; an empty one is fine."""
    (tmp_path / "c").mkdir()
    write_campaign(campaign, tmp_path / "c")
    before = content_of(tmp_path)
    with pytest.raises(DataError, match="a folder that holds nothing yet"):
        write_campaign(campaign, tmp_path / "c")
    assert content_of(tmp_path) == before


def test_an_interrupted_writer_leaves_nothing(
    campaign: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither the folder nor a trace beside it."""

    def fails(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(writer, "_write_runs", fails)
    with pytest.raises(OSError, match="disk full"):
        write_campaign(campaign, tmp_path / "c")
    assert not list(tmp_path.iterdir())
