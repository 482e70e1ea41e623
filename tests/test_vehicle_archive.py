"""An archive of vehicles: who is like whom, who is taken out, and its file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from crashfuse.approaches.fused import Fused
from crashfuse.approaches.mixture import PRIOR
from crashfuse.approaches.pretrained import Pretrained
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.errors import DataError, UsageError
from crashfuse.execution.cache import Cache
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.vehicle_archive import (
    _BETWEEN,
    _USUAL_MEAN,
    _WITHIN,
    PastVehicle,
    Prior,
    VehicleArchive,
    differences,
    load_archive,
)
from tests.conftest import not_none

NAMES = ("Amber", "Birch", "Cedar")


def prior(*names: str, at: FloatArray = _USUAL_MEAN, shift: float = 0.0, helps: bool = True) -> Prior:
    """What vehicles teach whose CAE models err by ``at``, a little more from one to the next."""
    off = at + 0.1 * np.arange(len(names))[:, None]
    network = {"last.bias": np.full(50, shift, np.float16)}
    return Prior(names, network, PRIOR + shift, {"peak": np.tile([-1.0, 1.0], len(names))}, off, helps)


def archive(*vehicles: PastVehicle, at: FloatArray = _USUAL_MEAN) -> VehicleArchive:
    """An archive of these vehicles, and of others of which nothing is known."""
    all_of = (*vehicles, *(PastVehicle(name, name, (name,)) for name in NAMES[len(vehicles) :]))
    names = [vehicle.name for vehicle in all_of]
    without = [
        prior(*(name for name in names if name != out), at=at, shift=0.1 * n) for n, out in enumerate(names, start=1)
    ]
    sizes = {"n_tests": [1, 2] * len(names), "vehicle": np.repeat(names, 2).tolist()}
    record = pd.DataFrame({**sizes, "rating": 0.9, "rating_without": 0.8})
    return VehicleArchive(all_of, prior(*names, at=at), tuple(without), record)


def past(campaign: Campaign, name: str = "Amber") -> PastVehicle:
    """A campaign as a vehicle of an archive."""
    return PastVehicle(name, campaign.cae.fingerprint, tuple(test.digest for test in campaign.tests))


def test_likeness_is_the_ratio_of_two_normal_densities() -> None:
    """By the parts of a crash, with one vehicle of any kind among those that the deviation is taken from."""
    known, found = prior("a", "b", at=np.array([1.0, -2.0, 0.0])), np.array([[0.9, -1.0, 0.5], [1.3, -2.0, 0.7]])
    mean, n = known.differences.mean(axis=0), 2
    between = (_BETWEEN**2 + ((known.differences - mean) ** 2).sum(axis=0)) / n
    alike = norm.logpdf(found.mean(axis=0), mean, np.sqrt(between * (1 + 1 / n) + _WITHIN**2 / 2))
    of_any = norm.logpdf(found.mean(axis=0), _USUAL_MEAN, np.sqrt(_BETWEEN**2 + _WITHIN**2 / 2))
    assert known.likeness(found) == pytest.approx(np.log(20) + (alike - of_any).sum())


def test_a_vehicle_is_like_those_whose_cae_models_err_alike() -> None:
    """The sign and the size of what is wrong count; more tests are surer."""
    known = prior("a", "b", "c", "d", at=np.array([3.0, 3.0, 3.0]))
    alike, otherwise = (np.full((4, 3), off) for off in (3.1, -5.0))
    assert known.likeness(alike) > known.likeness(alike[:1]) > 0 > known.likeness(otherwise[:1])
    assert known.likeness(otherwise[:1]) > known.likeness(otherwise)


@pytest.mark.parametrize("stride", [1, 10])
def test_differences_are_means_over_twenty_ms(stride: int) -> None:
    """A measured pulse that is one more from 20 to 40 ms, two more after, per impact speed of 10 m/s."""
    cae = np.zeros((2, 1250 // stride))
    measured = np.floor(GRID_S / 0.02 + 1e-9)[None, ::stride] + cae
    np.testing.assert_allclose(differences(measured, cae, np.array([10.0, 20.0])), [[0, 0.1, 0.2], [0, 0.05, 0.1]])


def test_an_archive_is_read_as_it_was_saved(tmp_path: Path, campaign: Campaign) -> None:
    """To the bit, by all that predictions depend on."""
    saved = archive(past(campaign))
    saved.save(tmp_path / "a.cfa")
    read = load_archive(tmp_path / "a.cfa")
    assert read.vehicles == saved.vehicles
    assert [p.fingerprint for p in (read.whole, *read.without)] == [
        p.fingerprint for p in (saved.whole, *saved.without)
    ]
    assert len({p.fingerprint for p in (read.whole, *read.without)}) == 4
    pd.testing.assert_frame_equal(read.record, saved.record)
    assert "+0.100" in read.sentence


@pytest.mark.parametrize("what", ["nothing", "cut", "other", "changed"])
def test_another_file_is_a_sentence(what: str, tmp_path: Path) -> None:
    """No traceback, whatever it is."""
    path = tmp_path / "a.cfa"
    if what != "nothing":
        archive().save(path)
        content = path.read_bytes()
        path.write_bytes({"cut": content[:-9], "other": b"x" * 99, "changed": content[:-1] + b"\x01"}[what])
    with pytest.raises(DataError, match=r"a\.cfa: expected an archive"):
        load_archive(path)


def test_a_vehicle_of_the_archive_is_taken_out_of_it(campaign: Campaign) -> None:
    """Known by one of its tests, whatever its name, or by its CAE runs; with others' it may not be mixed."""
    known = archive(past(campaign))
    one = replace(campaign, name="Renamed", tests=campaign.tests[:1])
    taught = not_none(one.with_archive(known).prior)
    assert (taught.vehicles, taught.taken_out) == (NAMES[1:], "Amber")
    assert taught.fingerprint == known.without[0].fingerprint  # as if it had never been in
    other = replace(campaign, cae=_another(campaign.cae), tests=())
    assert other.with_archive(known).prior is known.whole
    with pytest.raises(UsageError, match="shares tests or CAE runs with Amber and Birch"):
        campaign.with_archive(archive(past(campaign), past(campaign, "Birch")))


def _another(cae: CaeLibrary) -> CaeLibrary:
    return CaeLibrary(cae.ids, cae.conditions, cae.accel_mps2 * np.float32(1.01))


def test_what_is_taught_is_part_of_a_campaigns_fingerprint(campaign: Campaign) -> None:
    """Or the cache would give predictions of another archive."""
    taught = replace(campaign, prior=prior("a", "b"))
    assert len({c.fingerprint for c in (campaign, taught, replace(campaign, prior=prior("a", "b", shift=0.5)))}) == 3
    assert taught.without(["T1"]).prior is taught.prior


@pytest.mark.usefixtures("quick_networks")
def test_an_archive_counts_where_the_vehicle_is_like_its_own(campaign: Campaign, tmp_path: Path) -> None:
    """Then weights, errors and the network are the archive's; else all is as without one, and a sentence says why."""
    cache = Cache(tmp_path)
    model = Pretrained(cache=cache).fit(campaign).model_
    measured = np.array([test.pulse.accel_mps2 for test in campaign.tests])
    cae = np.array([model.pulse(test.condition).accel_mps2 for test in campaign.tests])
    at = differences(measured, cae, np.array([test.condition.speed_mps for test in campaign.tests])).mean(axis=0)
    few = campaign.without(["T3", "T4"])
    condition = campaign.test("T3").condition
    without = Fused(cache=cache).fit(few)
    taught = Fused(cache=cache).fit(replace(few, prior=prior("a", "b", "c", at=at, shift=0.2)))
    assert taught.pool_.prior is not without.pool_.prior
    assert list(taught.usual_errors) == ["peak"]
    assert np.abs(taught.predict(condition).accel_mps2 - without.predict(condition).accel_mps2).max() > 0.1
    assert any("Taught by an archive of 3 past vehicles" in note for note in taught.predict(condition).notes)
    for unlike in (prior("a", "b", at=at + 20.0, shift=0.2), prior("a", "b", at=at, shift=0.2, helps=False)):
        alone = Fused(cache=cache).fit(replace(few, prior=unlike))
        np.testing.assert_array_equal(alone.predict(condition).accel_mps2, without.predict(condition).accel_mps2)
        assert not alone.usual_errors
        assert any("is not used" in note for note in alone.predict(condition).notes)
