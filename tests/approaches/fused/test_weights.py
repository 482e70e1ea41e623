"""The mixture's score is the one it says, and trust goes to who earned it on left-out tests."""

import numpy as np
import pytest
from scipy.stats import norm

from crashfuse.approaches.fused import weights as pool
from crashfuse.approaches.fused.weights import Pool, Scores

EVEN = np.zeros((2, 2))


def test_the_distance_between_draws_is_the_mean_over_all_pairs() -> None:
    """Written out pair by pair, for two components and for one with itself."""
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((7, 3)), rng.standard_normal((5, 3)) + 1
    assert pool._apart(a, b) == pytest.approx(np.mean([np.abs(x - y).mean() for x in a for y in b]))
    own = [np.abs(a[i] - a[j]).mean() for i in range(7) for j in range(7) if i != j]
    assert pool._apart(a, a) == pytest.approx(np.mean(own))
    assert pool._apart(a[:1], a[:1]) == 0


def test_the_score_of_normal_draws_is_its_closed_form(monkeypatch: pytest.MonkeyPatch) -> None:
    """CRPS of N(0, 1) at y is y(2Φ(y) - 1) + 2φ(y) - 1/√π (Gneiting & Raftery 2007, Eq. 5)."""
    monkeypatch.setattr(pool, "_PAIRS", 4000)
    draws = np.random.default_rng(0).standard_normal((4000, 1))
    for y in (0.0, 0.7, -2.0):
        expected = y * (2 * norm.cdf(y) - 1) + 2 * norm.pdf(y) - 1 / np.sqrt(np.pi)
        score = Scores.of(np.array([y]), [draws]).crps(np.array([1.0]))
        assert score == pytest.approx(expected, abs=0.02)


def test_the_score_of_a_mixture_is_that_of_its_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the quadratic form in the weights, and by drawing from the mixture itself."""
    monkeypatch.setattr(pool, "_PAIRS", 3000)
    rng = np.random.default_rng(1)
    a, b, y = rng.standard_normal((3000, 2)), 2 + 0.5 * rng.standard_normal((3000, 2)), np.array([0.5, 1.5])
    by_weights = Scores.of(y, [a, b]).crps(np.array([0.3, 0.7]))
    mixed = np.concatenate([a[:900], b[:2100]])
    assert Scores.of(y, [mixed]).crps(np.array([1.0])) == pytest.approx(by_weights, rel=0.02)


def _scores(rng: np.random.Generator, *offsets: float) -> Scores:
    """Voices whose draws lie this far off the measured pulse."""
    measured = np.zeros(5)
    return Scores.of(measured, [offset + 0.1 * rng.standard_normal((50, 5)) for offset in offsets])


def test_who_predicts_left_out_tests_better_is_trusted_more() -> None:
    """Ten tests in a row: nearly all of the weight."""
    rng = np.random.default_rng(2)
    weights = Pool(EVEN, spread=1.0, strength=10.0).fit([_scores(rng, 0.0, 1.0)] * 10, np.full(10, 0.5)).weights(0.5)
    assert weights.sum() == pytest.approx(1)
    assert weights[0] > 0.9


def test_trust_depends_on_how_near_the_tests_are() -> None:
    """The first is right beside a test, the second far from all: each is trusted where it was right."""
    rng = np.random.default_rng(3)
    scores = [_scores(rng, 0.0, 1.0), _scores(rng, 1.0, 0.0)] * 5
    fitted = Pool(EVEN, spread=1.0, strength=10.0).fit(scores, np.array([1.0, 0.0] * 5))
    assert fitted.weights(1.0)[0] > 0.8
    assert fitted.weights(0.0)[1] > 0.8
    assert fitted.weights(0.5)[0] == pytest.approx(0.5, abs=0.2)


def test_without_left_out_tests_the_prior_decides() -> None:
    """Its logits, as they are; and one test alone moves them only so far."""
    prior = np.array([[1.0, 1.0], [0.0, 0.0]])
    assert Pool(prior, spread=1.0, strength=10.0).fit([], np.array([])).weights(0.3)[0] == pytest.approx(
        1 / (1 + np.exp(-1))
    )
    one = Pool(prior, spread=0.1, strength=1.0).fit([_scores(np.random.default_rng(4), 1.0, 0.0)], np.array([0.3]))
    assert one.weights(0.3)[0] == pytest.approx(1 / (1 + np.exp(-1)), abs=0.02)
