"""An archive of vehicles: whom it teaches, who is taken out, and its file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import lognorm

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain, _alike_by_cae
from crashfuse.approaches.fused import Fused
from crashfuse.approaches.mixture import PRIOR
from crashfuse.approaches.pretrained import Pretrained, _network
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.errors import DataError, UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.study.estimate import Fit, estimates_at
from crashfuse.vehicle_archive import load_archive
from tests.archives import NAMES, made_archive, prior
from tests.conftest import not_none


@pytest.fixture(scope="module")
def errs(campaign: Campaign) -> dict[str, Any]:
    """What the bias of the small campaign teaches, and its CAE model, from which others differ by a tenth."""
    bias, cae = DisplacementDomain().fit(campaign).to_teach()
    return {"bias": bias, "cae": np.array([cae, 0.1 * cae])}


def test_an_archive_is_read_as_it_was_saved(tmp_path: Path, campaign: Campaign) -> None:
    saved = made_archive(campaign)
    saved.save(tmp_path / "a.cfa")
    read = load_archive(tmp_path / "a.cfa")
    assert read.vehicles == saved.vehicles
    assert [p.fingerprint for p in (read.whole, *read.without)] == [
        p.fingerprint for p in (saved.whole, *saved.without)
    ]
    assert len({p.fingerprint for p in (read.whole, *read.without)}) == 4
    pd.testing.assert_frame_equal(read.record, saved.record)
    assert "+0.050" in read.sentence


@pytest.mark.parametrize("what", ["nothing", "cut", "other", "changed"])
def test_another_file_is_a_sentence(what: str, tmp_path: Path) -> None:
    path = tmp_path / "a.cfa"
    if what != "nothing":
        made_archive().save(path)
        content = path.read_bytes()
        path.write_bytes({"cut": content[:-9], "other": b"x" * 99, "changed": content[:-1] + b"\x01"}[what])
    with pytest.raises(DataError, match=r"a\.cfa: expected an archive"):
        load_archive(path)


def test_a_vehicle_of_the_archive_is_taken_out_of_it(campaign: Campaign) -> None:
    """Known by one of its tests, whatever its name, or by its CAE runs; with others' it may not be mixed."""
    known = made_archive(campaign)
    taught = not_none(replace(campaign, name="Renamed", tests=campaign.tests[:1]).with_archive(known).prior)
    assert (taught.vehicles, taught.taken_out) == (NAMES[:2], campaign.name)
    assert taught.fingerprint == known.without[2].fingerprint  # as if it had never been in
    cae = CaeLibrary(campaign.cae.ids, campaign.cae.conditions, campaign.cae.accel_mps2 * np.float32(1.01))
    other = replace(campaign, cae=cae, tests=())
    assert not_none(other.with_archive(known).prior).fingerprint == known.whole.fingerprint
    with pytest.raises(UsageError, match="shares tests or CAE runs with A and B"):
        campaign.with_archive(made_archive(replace(campaign, name="A"), replace(campaign, name="B")))


def test_what_is_taught_is_part_of_a_campaigns_fingerprint(campaign: Campaign) -> None:
    """Or the cache would give predictions of another archive."""
    taught = replace(campaign, prior=prior("a", "b"))
    assert len({c.fingerprint for c in (campaign, taught, replace(campaign, prior=prior("a", "b", shift=0.5)))}) == 3
    assert taught.without(["T1"]).prior is taught.prior


@pytest.mark.usefixtures("quick_networks")
def test_the_displacement_domain_is_taught_alone(campaign: Campaign, errs: dict[str, Any], tmp_path: Path) -> None:
    """Within the mixture it is not: beside it or alone, the mixture predicts the same; what is restored, too."""
    few, condition = campaign.without(["T3", "T4"]), campaign.test("T3").condition
    taught = replace(few, prior=prior("a", "b", "c", **errs))
    names = ("displacement_domain", "fused", "displacement_domain")
    domain, fused, again = (Fit.of(taught, name, run=Run(Cache(tmp_path))) for name in names)
    together = [estimate.accel_mps2 for estimate in estimates_at([domain, fused], condition)]
    np.testing.assert_array_equal(together[1], fused.estimate(condition).accel_mps2)
    np.testing.assert_array_equal(together[0], again.estimate(condition).accel_mps2)
    without = Fit.of(few, "displacement_domain", run=Run(Cache(tmp_path))).estimate(condition).accel_mps2
    measured = campaign.test("T3").pulse.accel_mps2[: len(without)]
    assert 0.1 < np.abs(together[0] - measured).mean() < np.abs(without - measured).mean()


@pytest.mark.usefixtures("quick_networks")
def test_an_archive_counts_where_the_vehicle_is_like_its_own(
    campaign: Campaign, errs: dict[str, Any], tmp_path: Path
) -> None:
    """Then weights, errors and the network are the archive's; else all is as without one, and a sentence says why."""
    cache = Cache(tmp_path)
    few = campaign.without(["T3", "T4"])
    condition = campaign.test("T3").condition
    without = Fused().fit(few, Run(cache))
    few_taught = replace(few, prior=prior("a", "b", "c", **errs, shift=0.2))
    taught = Fused().fit(few_taught, Run(cache))
    np.testing.assert_allclose(taught.pool_.prior, PRIOR + 0.2 * taught.alike_)
    assert list(taught.usual_errors) == ["peak"]
    assert np.abs(taught.predict(condition).accel_mps2 - without.predict(condition).accel_mps2).max() > 0.1
    assert any("Taught by an archive of 3 past vehicles" in note for note in taught.predict(condition).notes)
    again = Fused().restore(few_taught, taught.learned(), Run(cache))
    np.testing.assert_array_equal(again.predict(condition).accel_mps2, taught.predict(condition).accel_mps2)
    assert 0.9 < taught.alike_ <= 1
    other = {name: 3 * own for name, own in errs.items()}
    for unlike in (prior("a", "b", **other, shift=0.2), prior("a", "b", **errs, shift=0.2, helps=False)):
        alone = Fused().fit(replace(few, prior=unlike), Run(cache))
        np.testing.assert_array_equal(alone.predict(condition).accel_mps2, without.predict(condition).accel_mps2)
        assert not alone.usual_errors
        assert any("is not used" in note for note in alone.predict(condition).notes)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_between_kinds_an_archive_counts_in_proportion(share: float) -> None:
    """The network lies in between, linearly; errors count by number, with the mean and the size of theirs."""
    errors, taught = np.array([-2.0, 1.0, 4.0, 2.0]), replace(prior("a", "b", shift=0.4), share=share)
    fused, usual, between = Fused(), _network(None).state_dict(), _network(taught).state_dict()
    fused.pretrained_ = Pretrained()
    fused.pretrained_.prior_ = replace(taught, errors={"peak": errors})
    counted = fused.usual_errors["peak"]
    assert counted.size == 8 * share
    assert not share or (counted.mean(), counted.std()) == pytest.approx((errors.mean(), errors.std()))
    np.testing.assert_allclose(between["last.bias"], (1 - share) * usual["last.bias"] + share * 0.4, atol=1e-4)


def test_cae_models_are_alike_as_those_of_a_kind_are() -> None:
    """By SciPy's log-normal densities; a mean nearer than theirs is no evidence against them, nor is a loose kind."""
    away = np.array([0.15, 0.3, 0.9])
    odds = lognorm.logpdf(away, 0.25, scale=0.125) - lognorm.logpdf(away, 0.42, scale=0.34)
    assert [_alike_by_cae(2 * one, 2.0, 0.2) for one in away.tolist()] == pytest.approx(odds)
    assert _alike_by_cae(0.0, 1.0, 0.1) == _alike_by_cae(0.125, 1.0, 0.1) > 2
    assert abs(_alike_by_cae(0.34, 1.0, 0.8)) < 0.6
