"""The optimiser."""

from pathlib import Path

import pytest
import torch

from crashfuse.approaches.time_domain.adam import Adam
from tests.test_imports import loaded


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


@pytest.mark.slow
def test_a_training_does_not_load_the_compiler(campaign_on_disk: Path) -> None:
    """On CAE runs and on tests: nothing of torch.compile, which takes 1.6 CPU-seconds and 70 MB to load."""
    fit = (
        "import sys, crashfuse; from crashfuse.approaches.time_domain.approach import TimeDomain; "
        "from crashfuse.approaches.time_domain.config import TcnConfig; "
        "small = TcnConfig(channels=6, dilations=(1,), epochs=1, min_steps=2, members=2); "
        "TimeDomain(small).fit(crashfuse.load_campaign(sys.argv[1]))"
    )
    assert {"torch", "torch._dynamo"} & loaded(fit, str(campaign_on_disk)) == {"torch"}
