"""Draws from joint distributions: whole functions rather than independent points."""

import numpy as np

from crashfuse.signals.pulse import FloatArray


def draw(mean: FloatArray, covariance: FloatArray, n_samples: int, rng: np.random.Generator) -> FloatArray:
    """Draw from a normal distribution whose covariance may be singular, shape (n_samples, m)."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(mean + rng.standard_normal((n_samples, mean.size)) @ root.T)


def student_draws(
    mean: FloatArray, covariance: FloatArray, freedom: int, n_samples: int, rng: np.random.Generator
) -> FloatArray:
    """Draw from Student's t distribution with this location, scale matrix and degrees of freedom, (n_samples, m)."""
    widening = np.sqrt(freedom / rng.chisquare(freedom, size=(n_samples, 1)))
    return np.asarray(mean + widening * draw(np.zeros_like(mean), covariance, n_samples, rng))
