"""The LF TCN: it learns the CAE model and nothing else; seeds, members and cache behave."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.lf_tcn import LfTcn
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.training import load_weights, weights_of
from crashfuse.campaign import Campaign
from crashfuse.execution.run import Run
from tests.approaches.time_domain.test_approach import relative_error

pytestmark = pytest.mark.slow

SMALL = TcnConfig(channels=12, epochs=1, min_steps=250, members=2)


@pytest.fixture(scope="module")
def lf(campaign: Campaign) -> LfTcn:
    return LfTcn(SMALL).fit(campaign)


def test_the_lf_network_learns_the_cae_runs(campaign: Campaign, lf: LfTcn) -> None:
    """Its loss falls to a hundredth, and it gives the CAE pulses back to within 15 % at the tests' conditions."""
    assert lf.losses_.shape[0] == 2
    assert (lf.losses_[:, -1, 0] < 0.01 * lf.losses_[:, 0, 0]).all()
    runs = [*zip(campaign.cae.conditions, campaign.cae.accel_mps2, strict=True)][20:24]
    assert max(relative_error(lf.predict(at).accel_mps2, accel) for at, accel in runs) < 0.15


def test_a_kept_network_is_not_trained_again(campaign: Campaign, lf: LfTcn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Trained again, whatever torch's own seed is, it has the same bits."""
    torch.manual_seed(77)
    LfTcn(SMALL).fit(campaign, Run())
    monkeypatch.setattr("crashfuse.approaches.time_domain.lf_tcn.train", None)
    again = LfTcn(SMALL).fit(campaign, Run())
    condition = campaign.tests[0].condition
    assert again.predict(condition).accel_mps2.tobytes() == lf.predict(condition).accel_mps2.tobytes()
    np.testing.assert_array_equal(again.losses_, lf.losses_)
    LfTcn(replace(SMALL, tuning="gradient", penalty=1.0, n_draws=3)).fit(campaign, Run())
    TimeDomain(SMALL).fit(campaign, Run())


def test_members_differ_and_their_mean_predicts(campaign: Campaign, lf: LfTcn) -> None:
    condition = campaign.tests[0].condition
    singles = []
    for member in range(2):
        alone = LfTcn(replace(SMALL, members=1))
        alone.scaling_, alone._library = lf.scaling_, campaign.cae
        alone.network_ = Tcn(alone.config, torch.Generator())
        load_weights(alone.network_, {k: v[member : member + 1] for k, v in weights_of(lf.network_).items()})
        singles.append(alone.predict(condition).accel_mps2)
    assert np.abs(singles[0] - singles[1]).max() > 0
    np.testing.assert_allclose(np.mean(singles, axis=0), lf.predict(condition).accel_mps2, atol=1e-3)
    other = LfTcn(replace(SMALL, min_steps=2), seed=1).fit(campaign)
    quick = LfTcn(replace(SMALL, min_steps=2)).fit(campaign)
    heads = [head for lf in (other, quick) for head in lf.network_.head.weight]
    assert len({tuple(head.flatten().tolist()) for head in heads}) == 4


def test_of_a_large_library_evenly_spaced_runs_are_learned_from(campaign: Campaign) -> None:
    """Of 24 runs five: the first, the last, and three between; any other may be anything."""
    config = TcnConfig(members=1, channels=4, epochs=1, min_steps=3, max_runs=5)
    used = {0, 5, 11, 17, 23}
    accel = campaign.cae.accel_mps2.copy()
    accel[[i for i in range(len(accel)) if i not in used]] *= 3
    other = replace(campaign, cae=replace(campaign.cae, accel_mps2=accel))
    first, second = (LfTcn(config).fit(c).learned().arrays for c in (campaign, other))
    assert all(np.array_equal(first[name], second[name]) for name in first)
    accel[23] *= 3
    third = LfTcn(config).fit(replace(campaign, cae=replace(campaign.cae, accel_mps2=accel))).learned().arrays
    assert any(not np.array_equal(first[name], third[name]) for name in first)
