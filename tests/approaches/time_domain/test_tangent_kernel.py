"""The tangent kernel, taken by factors, is the product of gradients by automatic differentiation."""

import itertools

import numpy as np
import pytest
import torch

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.tangent_kernel import Tangent

N_TIMES = 9


@pytest.mark.parametrize("dilations", [(1,), (1, 2), (1, 2, 4), (2, 3, 3)])
@pytest.mark.parametrize("members", [1, 2])
def test_the_tangent_kernel_is_the_product_of_gradients(dilations: tuple[int, ...], members: int) -> None:
    """By the weights of first and last block and head, mean over members, between conditions and others or themselves.

    The sequence is shorter than the last block looks back.
    """
    config = TcnConfig(channels=4, dilations=dilations, members=members)
    network = Tcn(config, torch.Generator().manual_seed(1))
    inputs = torch.randn(N_TIMES, 3, config.n_inputs, generator=torch.Generator().manual_seed(5))
    tuned = [
        weight
        for name, weight in network.named_parameters()
        if name.startswith(("head.", "blocks.0.", f"blocks.{len(dilations) - 1}."))
    ]

    def gradient(time: int, pulse: int) -> torch.Tensor:
        gradients = torch.autograd.grad(network(inputs)[:, time, pulse].sum(), tuned)
        return torch.cat([g.flatten() for g in gradients])

    jacobian = torch.stack([torch.stack([gradient(t, i) for t in range(N_TIMES)]) for i in range(3)])
    expected = torch.einsum("itp,jup->itju", jacobian, jacobian).numpy() / members
    for one, two in itertools.product(range(3), repeat=2):
        ours, theirs = (Tangent.of(network, inputs[:, i : i + 1]) for i in (one, two))
        kernel = ours.kernel_with(theirs).mean(dim=0).numpy()
        np.testing.assert_allclose(kernel, expected[one, :, two], rtol=1e-4, atol=1e-5)
