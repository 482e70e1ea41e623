"""Training step after step: whatever stops it, it goes on to the same bits."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from crashfuse.approaches.time_domain import training
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.lf_tcn import LfTcn
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.training import Adam, LfTraining, weights_of
from crashfuse.campaign import Campaign
from crashfuse.errors import Cancelled
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import Progress, Watch
from crashfuse.execution.run import Run
from tests.conftest import cancelled_after

pytestmark = pytest.mark.slow

SMALL = TcnConfig(channels=6, dilations=(1, 2), dropout=0.1, epochs=1, min_steps=40, members=3)
BY_ADAM = replace(SMALL, tuning="gradient", min_steps=2, tuning_steps=30)


def test_the_steps_are_those_of_torchs_own() -> None:
    """Weights after 30 steps on random gradients, with a rate that changes, some gradients zero for a while."""
    generator = torch.Generator().manual_seed(0)
    ours = [torch.randn(4, 3, generator=generator, dtype=torch.float64), torch.ones(5, dtype=torch.float64)]
    theirs = [torch.nn.Parameter(weight.clone()) for weight in ours]
    adam, reference = Adam(ours), torch.optim.Adam(theirs, betas=(0.9, 0.95))
    for number in range(30):
        gradients = [torch.randn(w.shape, generator=generator, dtype=w.dtype) * (number > 4) for w in ours]
        rate = 1e-2 / (1 + number)
        for parameter, gradient in zip(theirs, gradients, strict=True):
            parameter.grad = gradient.clone()
        reference.param_groups[0]["lr"] = rate
        reference.step()
        adam.step(gradients, rate)
    for weight, parameter in zip(ours, theirs, strict=True):
        torch.testing.assert_close(weight, parameter.detach())


class Killed(BaseException):
    """What ends a process."""


def _dies_at(step: str, done: int) -> Callable[[Progress], None]:
    def watch(progress: Progress) -> None:
        if progress.step == step and progress.done >= done:
            raise Killed

    return watch


def _bits(network: Tcn) -> dict[str, bytes]:
    return {name: weight.tobytes() for name, weight in weights_of(network).items()}


def _checkpoints() -> int:
    return len(list((Cache().folder / "checkpoints").glob("*.bin")))


@pytest.fixture(scope="module")
def undisturbed(campaign: Campaign) -> LfTcn:
    return LfTcn(SMALL).fit(campaign)


@pytest.fixture
def every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "_REPORT_S", 0.0)
    monkeypatch.setattr(training, "_CHECKPOINT_S", 0.0)
    monkeypatch.setattr(training, "_SHARE", 1e9)


@pytest.mark.usefixtures("every_step")
def test_a_training_that_was_killed_goes_on_from_its_last_checkpoint(campaign: Campaign, undisturbed: LfTcn) -> None:
    """In mid-epoch, with dropout: no step is done twice, weights and curve are those of an undisturbed run."""
    with pytest.raises(Killed):
        LfTcn(SMALL).fit(campaign, Run(watch=Watch(_dies_at("Training LF TCN", 17))))
    assert _checkpoints() == 1
    reports: list[Progress] = []
    resumed = LfTcn(SMALL).fit(campaign, Run(watch=Watch(reports.append)))
    assert reports[0].done == 17
    assert _bits(resumed.network_) == _bits(undisturbed.network_)
    np.testing.assert_array_equal(resumed.losses_, undisturbed.losses_)
    assert _checkpoints() == 0


@pytest.mark.usefixtures("every_step")
def test_a_fine_tuning_that_was_killed_goes_on_as_well(campaign: Campaign) -> None:
    undisturbed = TimeDomain(BY_ADAM).fit(campaign)
    with pytest.raises(Killed):
        TimeDomain(BY_ADAM).fit(campaign, Run(watch=Watch(_dies_at("Fine-tuning on tests", 11))))
    resumed = TimeDomain(BY_ADAM).fit(campaign, Run())
    assert _bits(resumed.network_) == _bits(undisturbed.network_)
    np.testing.assert_array_equal(resumed.losses_, undisturbed.losses_)
    assert _checkpoints() == 0


def test_a_training_that_is_cancelled_leaves_what_it_had(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "_REPORT_S", 0.0)
    with pytest.raises(Cancelled):
        LfTcn(SMALL).fit(campaign, Run(watch=cancelled_after(lambda progress: progress.done == 5)))
    reports: list[Progress] = []
    LfTcn(SMALL).fit(campaign, Run(watch=Watch(reports.append)))
    assert reports[0].done == 6


@pytest.mark.parametrize("changed", ["seed", "data", "checkpoint"])
def test_a_checkpoint_of_other_data_or_seed_or_a_damaged_one_is_not_taken(campaign: Campaign, changed: str) -> None:
    with pytest.raises(Cancelled):
        LfTcn(SMALL).fit(campaign, Run(watch=cancelled_after(lambda _: True)))
    if changed == "data":
        campaign = replace(campaign, cae=replace(campaign.cae, accel_mps2=1.1 * campaign.cae.accel_mps2))
    if changed == "checkpoint":
        (kept,) = (Cache().folder / "checkpoints").glob("*.bin")
        damaged = bytearray(kept.read_bytes())
        damaged[-200] ^= 1
        kept.write_bytes(damaged)
    reports: list[Progress] = []
    LfTcn(SMALL, seed=int(changed == "seed")).fit(campaign, Run(watch=Watch(reports.append)))
    assert reports[0].done == 0


def test_members_train_as_they_would_alone() -> None:
    """The loss of an ensemble is a sum, so each member's gradient is that of its own loss."""
    inputs = torch.randn(20, 30, SMALL.n_inputs, generator=torch.Generator().manual_seed(0))
    targets = torch.randn(20, 30, generator=torch.Generator().manual_seed(1))
    config = replace(SMALL, dropout=0.0)
    network = Tcn(config, torch.Generator().manual_seed(2))
    total, losses = LfTraining(inputs, targets, config, 3, 3, torch.Generator()).loss(network, 0)
    whole = torch.autograd.grad(total, list(network.parameters()), retain_graph=True)
    own = torch.autograd.grad(losses[1], list(network.parameters()))
    for one, other in zip(whole, own, strict=True):
        torch.testing.assert_close(one[1], other[1])
        assert other[0].abs().max() == 0
