"""The optimiser."""

import pytest
import torch

from crashfuse.approaches.time_domain.adam import Adam


@pytest.mark.slow
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
