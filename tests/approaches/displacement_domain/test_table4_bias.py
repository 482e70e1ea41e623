"""The paper's bias model at Table 4."""

import json

import numpy as np
import pytest

from crashfuse.approaches.displacement_domain.bias import BiasPoints, CaeForce, CaeStop
from crashfuse.approaches.displacement_domain.table4_bias import Table4Bias
from crashfuse.condition import Condition
from crashfuse.errors import Cancelled
from crashfuse.execution.progress import Progress
from crashfuse.signals.pulse import FloatArray
from tests.conftest import cancelled_after


def points(bias: FloatArray, k: int) -> BiasPoints:
    """A test's bias at 15 displacements."""
    s = np.linspace(0, 0.5, 15)
    condition = Condition.of_vector([8.0 + k, 950.0 + 10 * k, 700.0 - 7 * k])
    return BiasPoints(condition, s, np.sqrt(1 - s / 0.5), CaeForce(0 * s, 0 * s), bias)


def smooth(k: int) -> FloatArray:
    return -30 * np.sin(2 * np.pi * np.linspace(0, 1, 15)) * (1 + 0.1 * k)


def test_its_settings_are_those_of_table_4() -> None:
    """Constant times Matérn-3/2, start 2, bounds 1e-5 to 2e3, alpha 1e-5, 10 restarts."""
    process = Table4Bias().fit([points(smooth(k), k) for k in range(3)]).process_
    assert process.alpha == 1e-5
    assert process.n_restarts_optimizer == 10
    np.testing.assert_allclose(np.exp(process.kernel.theta), 2.0)
    np.testing.assert_allclose(np.exp(process.kernel.bounds), np.tile([1e-5, 2e3], (5, 1)))
    assert process.kernel.k2.nu == 1.5


def test_it_learns_a_smooth_bias_and_passes_through_it() -> None:
    """With alpha 1e-5 the points come back, and between tests the bias lies between theirs."""
    model = Table4Bias(restarts=3).fit([points(smooth(k), k) for k in (0, 2, 4)])
    s = np.linspace(0, 0.5, 15)
    shares = np.linspace(0, 1, 5)
    new = BiasPoints(Condition.of_vector([10.0, 970.0, 686.0]), s, 0 * s + 1, CaeForce(0 * s, 0 * s))
    draws = model.sample(new, CaeStop(shares, 0 * shares, 0.5), 50, np.random.default_rng(0))
    np.testing.assert_allclose(draws.over_displacement_mps2[0], smooth(2), atol=0.5)
    assert draws.over_displacement_mps2.shape == (51, 15)
    assert not draws.over_speed_mps2.any()
    assert not model.dead_
    assert model.notes == ()


def test_a_dead_optimum_is_found_out() -> None:
    """Where the fit explains no more than noise would, state and notes say so; the result stays."""
    rng = np.random.default_rng(0)
    model = Table4Bias(restarts=0).fit([points(30 * rng.normal(size=15), k) for k in range(4)])
    assert model.dead_
    assert model.state["dead"] is True
    assert "explains no more than noise" in model.notes[0]
    json.dumps(model.state)


def test_the_same_seed_gives_the_same_fit() -> None:
    tests = [points(smooth(k), k) for k in range(3)]
    first, second = (Table4Bias(restarts=2, seed=1).fit(tests) for _ in range(2))
    np.testing.assert_array_equal(first.process_.kernel_.theta, second.process_.kernel_.theta)


def test_it_can_be_stopped_while_it_climbs() -> None:
    """Its fit takes minutes on a whole campaign: cancelling takes effect at once, not at the end."""
    seen: list[Progress] = []
    with pytest.raises(Cancelled):
        Table4Bias().fit([points(smooth(k), k) for k in range(3)], cancelled_after(lambda _: True, seen))
    assert [progress.total for progress in seen] == [11]
