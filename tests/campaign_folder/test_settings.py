"""The occupant model in campaign.toml: read, written, and refused in a sentence."""

from dataclasses import replace
from pathlib import Path

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.writer import write_campaign
from crashfuse.signals.occupant import USUAL_OCCUPANT, OccupantModel


def test_what_the_table_sets_is_read_and_written(campaign: Campaign, campaign_folder: Path, tmp_path: Path) -> None:
    """The rest stays as usual, 65 and 235 mm, 30 mm and 2500 N/m; the fingerprint is that of the content."""
    assert load_campaign(campaign_folder).occupant == USUAL_OCCUPANT == OccupantModel(65, 235, 30, 2500)
    (campaign_folder / "campaign.toml").write_text("[occupant]\nolc_restraint_mm = 200\nvpi_stiffness_npm = 3000\n")
    found = load_campaign(campaign_folder)
    assert found.occupant == OccupantModel(olc_restraint_mm=200.0, vpi_stiffness_npm=3000.0)
    write_campaign(found, tmp_path / "again")
    assert load_campaign(tmp_path / "again").fingerprint == found.fingerprint
    assert "occupant" not in (tmp_path / "again" / "tests.csv").read_text()
    write_campaign(replace(campaign, occupant=USUAL_OCCUPANT), tmp_path / "usual")
    assert "[occupant]" not in (tmp_path / "usual" / "campaign.toml").read_text()


def test_filter_class_of_the_import_is_that_of_all_tests(campaign_folder: Path) -> None:
    """Known if every test was imported with one class; else it is as supplied."""
    entries = [
        f'[[imported]]\nid = "{i}"\nas = "tests"\nchannel_filter_class = 60.0\n' for i in ("T1", "T2", "T3", "T4")
    ]
    (campaign_folder / "campaign.toml").write_text("\n".join(entries))
    assert load_campaign(campaign_folder).filter_class == "CFC 60"
    (campaign_folder / "campaign.toml").write_text("\n".join(entries[:3]))
    assert load_campaign(campaign_folder).filter_class == "filtered as supplied"
    (campaign_folder / "campaign.toml").write_text("\n".join([*entries[:3], entries[3].replace("60.0", '"none"')]))
    assert load_campaign(campaign_folder).filter_class == "filtered as supplied"
