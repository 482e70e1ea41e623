"""What the solver says of CAE runs, in a campaign folder: read, checked, written, and used to leave runs out."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.additions import Addition, add_to_campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.writer import write_campaign
from crashfuse.errors import DataError
from crashfuse.run_quality import NAMED_LIMITS, RunQuality
from crashfuse.signals.pulse import GRID_S, Pulse


def with_columns(folder: Path, **columns: Mapping[str, object]) -> Path:
    """Write columns of cae.csv, of the runs that are named."""
    table = pd.read_csv(folder / "cae.csv")
    for name, by_run in columns.items():
        table[name] = table.id.map(by_run)
    table.to_csv(folder / "cae.csv", index=False)
    return folder


def test_shares_are_read_and_empty_cells_are_not_recorded(campaign_folder: Path) -> None:
    """Any of the three columns may be there; none is a factor of the condition."""
    before = load_campaign(campaign_folder)
    with_columns(campaign_folder, energy_change={"C00": -0.012, "C01": 0.0}, added_mass_share={"C01": 1e-17})
    cae = load_campaign(campaign_folder).cae
    assert before.cae.quality == ()
    assert cae.quality[:3] == (RunQuality(-0.012), RunQuality(0.0, None, 1e-17), RunQuality())
    assert cae.conditions[0].factors == before.cae.conditions[0].factors
    assert cae.fingerprint == before.cae.fingerprint


def test_columns_without_a_number_say_nothing(campaign_folder: Path) -> None:
    """An empty column is the same as none."""
    with_columns(campaign_folder, hourglass_share={})
    assert load_campaign(campaign_folder).cae.quality == ()


@pytest.mark.parametrize(
    ("column", "cell", "expected", "advice"),
    [
        ("hourglass_share", "3.2", "0 to 1", "give a share: 5 % is 0.05"),
        ("hourglass_share", "-0.01", "0 to 1", "correct the cell"),
        ("added_mass_share", "n/a", "0 to 1", "correct the cell"),
        ("added_mass_share", "nan", "0 to 1", "correct the cell"),
        ("energy_change", "-1.5", "-1 to 1", "give a share: 5 % is 0.05"),
        ("energy_change", "inf", "-1 to 1", "correct the cell"),
        ("energy_change", "2 %", "-1 to 1", "correct the cell"),
    ],
)
def test_what_is_no_share_is_refused(campaign_folder: Path, column: str, cell: str, expected: str, advice: str) -> None:
    """Text, a negative share and what looks like per cent are named with their row."""
    with_columns(campaign_folder, **{column: {"C03": cell}})
    with pytest.raises(DataError) as caught:
        load_campaign(campaign_folder)
    assert str(caught.value) == (
        f"cae.csv, column {column}, row 5: expected a share from {expected}, or an empty cell where it is not "
        f"recorded, found '{cell}'; {advice}."
    )


def test_quality_and_limits_survive_the_round_trip(campaign_on_disk: Path, tmp_path: Path) -> None:
    """To the last digit, with what is not recorded left open."""
    campaign = load_campaign(campaign_on_disk)
    quality = tuple(RunQuality(0.1 * i / 3, None if i % 2 else i / 7e3) for i in range(len(campaign.cae)))
    limits = replace(NAMED_LIMITS["nchrp-179"], name="limits of this campaign", energy_change=1 / 3)
    for given in (limits, NAMED_LIMITS["euro-ncap-vt-2025"]):
        told = replace(campaign, cae=replace(campaign.cae, quality=quality), quality_limits=given)
        write_campaign(told, folder := tmp_path / given.name)
        again = load_campaign(folder)
        assert again.cae.quality == quality
        assert again.quality_limits == given
        assert again.fingerprint == campaign.fingerprint


@pytest.mark.parametrize("settings", ['limits = "euro-ncap-vt-2025"', "hourglass_share = 0.1"])
def test_runs_that_fail_are_left_out_where_that_is_asked_for(campaign_folder: Path, settings: str) -> None:
    """They change the fingerprint, for less is learned from; runs of which nothing is recorded stay."""
    before = load_campaign(campaign_folder)
    with_columns(campaign_folder, hourglass_share={"C02": 0.1, "C03": 0.0999, "C22": 0.4})
    toml = campaign_folder / "campaign.toml"
    toml.write_text(f"[cae_quality]\n{settings}\n")
    assert load_campaign(campaign_folder).fingerprint == before.fingerprint
    toml.write_text(f"[cae_quality]\n{settings}\nleave_out_failing = true\n")
    after = load_campaign(campaign_folder)
    assert set(before.cae.ids) - set(after.cae.ids) == {"C02", "C22"}
    assert after.cae.left_out == (("C02", RunQuality(None, 0.1)), ("C22", RunQuality(None, 0.4)))
    assert len(after.cae.quality) == len(after.cae.accel_mps2) == len(after.cae) == len(before.cae) - 2
    assert after.fingerprint != before.fingerprint
    assert before.cae.paired_run(before.tests[2].condition) == 22
    assert after.cae.paired_run(before.tests[2].condition) is None
    write_campaign(after, campaign_folder.parent / "again")
    assert load_campaign(campaign_folder.parent / "again").fingerprint == after.fingerprint


def test_too_few_runs_that_pass_are_told_as_such(campaign_folder: Path) -> None:
    """What is missing is not files but runs within the limits."""
    with_columns(campaign_folder, energy_change={f"C{i:02d}": -0.2 for i in range(15)})
    (campaign_folder / "campaign.toml").write_text('[cae_quality]\nlimits = "nchrp-179"\nleave_out_failing = true\n')
    with pytest.raises(DataError, match="at least 10 CAE runs, found 9, and 15 left out for their quality"):
        load_campaign(campaign_folder)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ('[cae_quality]\nlimits = "din"', "expected one of euro-ncap-vt-2025, nchrp-179, found 'din'"),
        ('[cae_quality]\nlimits = "nchrp-179"\nenergy_change = 0.1', "a named set or limits of its own, found both"),
        ("[cae_quality]\nhourglass_share = 10", "a share between 0 and 1 (0.05 for 5 %), found 10"),
        ("[cae_quality]\nhourglass_share = true", "a share between 0 and 1 (0.05 for 5 %), found True"),
        ("[cae_quality]\nleave_out_failing = true", "limits in [cae_quality], found none"),
        ('[cae_quality]\nlimits = "nchrp-179"\nleave_out_failing = 1', "expected true or false, found 1"),
        ("[cae_quality]\nhourglass = 0.1", "leave_out_failing, found hourglass"),
        ("cae_quality = 3", "a table [cae_quality] with limits, energy_change"),
    ],
)
def test_limits_that_make_no_sense_are_refused(campaign_folder: Path, settings: str, told: str) -> None:
    """Each in one sentence."""
    (campaign_folder / "campaign.toml").write_text(settings + "\n")
    with pytest.raises(DataError) as caught:
        load_campaign(campaign_folder)
    assert "\n" not in str(caught.value)
    assert told in str(caught.value)


def test_columns_are_added_to_a_table_that_lacks_them(campaign_folder: Path, campaign: Campaign) -> None:
    """The rows that were there count as not recorded; a second addition finds the columns."""
    condition, accel = campaign.cae.conditions[3], campaign.cae.accel_mps2[3].astype(float)
    told = (RunQuality(0.01, 0.02), RunQuality(added_mass_share=0.03), RunQuality())
    for run_id, quality in zip("ABC", told, strict=True):
        add_to_campaign(campaign_folder, "cae", [Addition(run_id, condition, Pulse(GRID_S, accel), quality=quality)])
    cae = load_campaign(campaign_folder).cae
    assert cae.quality[0] == RunQuality()
    assert cae.quality[-3:] == told
