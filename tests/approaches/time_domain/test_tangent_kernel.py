"""The tangent kernel, taken by factors, is the product of gradients by automatic differentiation."""

import numpy as np
import pytest
import torch

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.tangent_kernel import tangent_kernel, tangents

N_TIMES = 9


@pytest.mark.parametrize("dilations", [(1,), (1, 2), (1, 2, 4)])
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
    ours, others = tangents(network, config, inputs), tangents(network, config, inputs[:, 1:2])
    np.testing.assert_allclose(tangent_kernel(network, ours, ours), expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(tangent_kernel(network, ours, others), expected[:, :, 1:2], rtol=1e-4, atol=1e-5)
