"""The campaign: holding out, fingerprints."""

from dataclasses import replace

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError
from crashfuse.signals.occupant import OccupantModel
from crashfuse.signals.pulse import Pulse


def test_holding_out_takes_the_test_and_leaves_the_rest(campaign: Campaign) -> None:
    rest = campaign.without(["T2"])
    assert rest.test_ids == ("T1", "T3", "T4")
    assert rest.cae is campaign.cae

    with pytest.raises(UsageError, match="no test 'T7' in Tiny; it has T1, T2, T3, T4"):
        campaign.without(["T7"])


def test_one_changed_sample_changes_the_fingerprint(campaign: Campaign) -> None:
    """Every sample of every run and test counts; name and notice do not."""
    accel = campaign.cae.accel_mps2.copy()
    accel[3, 700] = np.nextafter(accel[3, 700], np.float32(1))
    assert replace(campaign, cae=replace(campaign.cae, accel_mps2=accel)).fingerprint != campaign.fingerprint
    first = campaign.tests[0]
    moved = first.pulse.accel_mps2.copy()
    moved[17] += 1e-12
    changed = CrashTest(first.id, first.condition, Pulse(first.pulse.time_s, moved))
    assert replace(campaign, tests=(changed, *campaign.tests[1:])).fingerprint != campaign.fingerprint

    assert replace(campaign, name="other", notice="x").fingerprint == campaign.fingerprint


def test_an_occupant_model_of_its_own_changes_the_fingerprint(campaign: Campaign) -> None:
    """Metrics and their errors depend on it, and what is kept of them; the usual one changes nothing."""
    assert replace(campaign, occupant=OccupantModel()).fingerprint == campaign.fingerprint
    own = replace(campaign, occupant=OccupantModel(olc_restraint_mm=200.0))
    assert own.fingerprint != campaign.fingerprint
    test = campaign.tests[-1]
    usual, other = ({m.name: m.value for m in each.metrics_of(test)} for each in (campaign, own))
    assert (other["olc"] or 0) > (usual["olc"] or 0) > 0
    assert [name for name in usual if usual[name] != other[name]] == ["olc"]


def test_filter_class_beside_ratings_is_that_of_the_campaign_or_of_the_import(campaign: Campaign) -> None:
    assert campaign.rating_basis == "ISO/TS 18571:2024, 10 kHz, filtered as supplied"
    imported = replace(campaign, tests_filtered_with=180.0)
    assert imported.rating_basis == "ISO/TS 18571:2024, 10 kHz, CFC 180"
    assert replace(imported, channel_filter_class=60.0).filter_class == "CFC 60"
