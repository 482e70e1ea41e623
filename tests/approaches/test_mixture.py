"""The mixture's score is the one it says, and trust goes to who earned it on left-out tests."""

import numpy as np
import pytest
from scipy.stats import norm

from crashfuse.approaches import mixture
from crashfuse.approaches.mixture import PRIOR, SPREAD, Pool, Scores
from crashfuse.signals.pulse import FloatArray

EVEN = np.zeros((2, 3))


def test_the_distance_between_draws_is_the_mean_over_all_pairs() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((7, 3)), rng.standard_normal((5, 3)) + 1
    between = Scores.of(np.zeros(3), [a, b]).apart
    np.testing.assert_allclose(between[[0, 1], [1, 0]], np.mean([np.abs(x - y).mean() for x in a for y in b]))
    own = [np.abs(a[i] - a[j]).mean() for i in range(7) for j in range(7) if i != j]
    assert between[0, 0] == pytest.approx(np.mean(own))
    assert mixture.spread(a) == pytest.approx(np.mean(own))
    assert mixture.spread(a[:1]) == 0


def test_the_score_of_normal_draws_is_its_closed_form(monkeypatch: pytest.MonkeyPatch) -> None:
    """CRPS of N(0, 1) at y is y(2Φ(y) - 1) + 2φ(y) - 1/√π (Gneiting & Raftery 2007, Eq. 5)."""
    monkeypatch.setattr(mixture, "_PAIRS", 4000)
    draws = np.random.default_rng(0).standard_normal((4000, 1))
    for y in (0.0, 0.7, -2.0):
        expected = y * (2 * norm.cdf(y) - 1) + 2 * norm.pdf(y) - 1 / np.sqrt(np.pi)
        assert Scores.of(np.array([y]), [draws]).crps(np.array([1.0])) == pytest.approx(expected, abs=0.02)


def test_the_score_of_a_mixture_is_that_of_its_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the quadratic form in the weights, and by drawing from the mixture itself."""
    monkeypatch.setattr(mixture, "_PAIRS", 3000)
    rng = np.random.default_rng(1)
    a, b, y = rng.standard_normal((3000, 2)), 2 + 0.5 * rng.standard_normal((3000, 2)), np.array([0.5, 1.5])
    by_weights = Scores.of(y, [a, b]).crps(np.array([0.3, 0.7]))
    mixed = np.concatenate([a[:900], b[:2100]])
    assert Scores.of(y, [mixed]).crps(np.array([1.0])) == pytest.approx(by_weights, rel=0.02)


def _scores(rng: np.random.Generator, *offsets: float) -> Scores:
    return Scores.of(np.zeros(5), [offset + 0.1 * rng.standard_normal((50, 5)) for offset in offsets])


EQUAL = np.ones(2)


def test_the_narrower_band_counts_for_more_where_that_proved_right() -> None:
    """In each test the one with the narrower band was right; next time the band tells whom to trust."""
    rng, measured = np.random.default_rng(3), np.zeros(5)
    sure, unsure = 0.1 * rng.standard_normal((50, 5)), 1.0 + 0.4 * rng.standard_normal((50, 5))
    scores = [Scores.of(measured, [sure, unsure]), Scores.of(measured, [unsure, sure])] * 5
    fitted = Pool(EVEN, spread=1.0, strength=10.0).fit(scores)
    assert fitted.weights(np.array([0.1, 0.4]))[0] > 0.8
    assert fitted.weights(np.array([0.4, 0.1]))[1] > 0.8
    assert fitted.weights(EQUAL)[0] == pytest.approx(0.5, abs=0.05)


def test_the_weights_are_the_best_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    scores = [_scores(rng, *offsets) for offsets in ((0.2, 0.5, 0.9), (0.6, 0.1, 0.4), (0.3, 0.3, 0.2))]
    prior, scale, strength = rng.standard_normal((3, 4)), 0.7, 10.0
    fitted = Pool(prior, spread=scale, strength=strength).fit(scores)
    best = fitted.logits_

    def loss(logits: FloatArray) -> float:
        monkeypatch.setattr(fitted, "logits_", logits)
        found = [score.crps(fitted.weights(score.spreads)) / score.crps(np.full(3, 1 / 3)) for score in scores]
        return float(strength * np.sum(found) + 0.5 * np.sum(((logits - prior) / scale) ** 2))

    least = loss(best)
    for step in 0.02 * rng.standard_normal((20, 3, 4)):
        assert loss(best + step) > least


def test_without_left_out_tests_the_prior_decides() -> None:
    prior = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert Pool(prior, spread=1.0, strength=10.0).fit([]).weights(EQUAL)[0] == pytest.approx(1 / (1 + np.exp(-1)))
    one = Pool(prior, spread=0.1, strength=1.0).fit([_scores(np.random.default_rng(4), 1.0, 0.0)])
    assert one.weights(EQUAL)[0] == pytest.approx(1 / (1 + np.exp(-1)), abs=0.02)


def test_before_tests_are_heard_weights_are_those_of_the_method() -> None:
    """Equally wide 1 : 1.8 : 2.7 : 1/7 (docs/method/fused.md); twice as wide 2^-0.6 of that, the raw CAE half."""
    pool = Pool(PRIOR, spread=1.0, strength=10.0).fit([])
    assert SPREAD.tolist() == [1.0, 0.4, 0.4, 0.4, 0.2]  # by which tests may move logits and slopes
    equal = pool.weights(np.full(4, 3.0))
    np.testing.assert_allclose(equal[1:] / equal[0], [1.8, 2.7, 1 / 7], rtol=0.06)
    for wider, (other, slope) in enumerate([(1, -0.6), (2, -0.6), (0, -0.6), (0, -1.0)]):
        weights = pool.weights(np.where(np.arange(4) == wider, 6.0, 3.0))
        assert weights[wider] / weights[other] == pytest.approx(2**slope * equal[wider] / equal[other])
