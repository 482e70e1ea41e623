"""An archive is learned from campaigns, and a vehicle of it is judged as if it had never been in."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.execution.cache import Cache
from crashfuse.signals.pulse import Pulse
from crashfuse.study.archive_learning import carried_over, learn_archive
from crashfuse.vehicle_archive import VehicleArchive

pytestmark = pytest.mark.usefixtures("quick_networks")


def vehicle(campaign: Campaign, name: str, stiffer: float) -> Campaign:
    """A vehicle whose tests are this much stiffer; its CAE model has a weakness of its own."""
    tests = tuple(
        replace(test, pulse=Pulse(test.pulse.time_s, stiffer * test.pulse.accel_mps2)) for test in campaign.tests
    )
    accel = campaign.cae.accel_mps2 * np.float32(2 - stiffer)
    return replace(campaign, name=name, tests=tests, cae=CaeLibrary(campaign.cae.ids, campaign.cae.conditions, accel))


@pytest.fixture
def vehicles(campaign: Campaign) -> list[Campaign]:
    return [vehicle(campaign, name, by) for name, by in zip("ABCD", (1.0, 1.02, 1.05, 1.08), strict=True)]


@pytest.mark.slow
def test_a_vehicle_of_the_archive_is_judged_as_if_it_had_never_been_in(
    vehicles: list[Campaign], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What all four teach one of them is to the bit what the other three teach it; what was learned is kept."""
    monkeypatch.setattr("crashfuse.approaches.pretrained_tuning._STEPS", 2)
    monkeypatch.setattr("crashfuse.study.archive_learning.SIZES", (2,))
    cache, last = Cache(tmp_path), vehicles[-1]

    def learned(*campaigns: Campaign) -> VehicleArchive:
        return learn_archive(campaigns, cache=cache, workers=1)

    with_it, without_it = learned(*vehicles), learned(*vehicles[:-1])
    taught = [last.with_archive(archive).prior for archive in (with_it, without_it)]
    assert [prior.taken_out for prior in taught if prior is not None] == ["D", ""]
    assert len({prior.fingerprint for prior in taught if prior is not None}) == 1
    assert with_it.whole.fingerprint != without_it.whole.fingerprint
    assert sorted({*with_it.record["vehicle"]}) == list("ABCD")
    assert with_it.record[["rating", "rating_without", "width"]].gt(0).all(axis=None)
    monkeypatch.setattr("crashfuse.study.archive_learning.tuned", None)  # called again, it would fail
    assert learned(*reversed(vehicles)).whole.fingerprint == with_it.whole.fingerprint


def test_what_cannot_be_learned_from_is_refused(vehicles: list[Campaign]) -> None:
    with pytest.raises(UsageError, match="takes 3 campaigns or more, not 2"):
        learn_archive(vehicles[:2])
    with pytest.raises(UsageError, match="with 4 tests or more; B has 3"):
        learn_archive([vehicles[0], vehicles[1].without(["T1"]), vehicles[2]])
    with pytest.raises(UsageError, match="'A' and 'Z', share their name, tests or CAE runs"):
        learn_archive([*vehicles, replace(vehicles[0], name="Z")])


@pytest.mark.parametrize(
    ("biases", "share"),
    [([1.0], 0.5), ([1.0, 1.0, 1.0], 1.0), ([1.0, -1.0], 0.0), ([3.0, 1.0], 2 * 0.6 / 1.6)],
    ids=["one", "equal", "opposite", "alike"],
)
def test_as_much_of_a_mean_bias_carries_over_as_vehicles_share(biases: list[float], share: float) -> None:
    """Of a constant bias with mean 1, 1, 0 and 2; ρ of 3 and 1 is 3 / ((9 + 1) / 2) = 0.6."""
    of_all = np.array(biases)[:, None, None] * np.ones((6, 60))
    np.testing.assert_allclose(carried_over(of_all), share * np.mean(biases))
