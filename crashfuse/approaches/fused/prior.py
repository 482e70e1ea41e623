"""What is thought of the components before a vehicle's own left-out tests are heard.

``python benchmarks/fused_prior.py`` fits such numbers to random vehicles of many kinds, so that the mixture's score on
tests that were not learned from is best on average; for both approaches they are rounded here. What the raw CAE should
count these vehicles leave open: a fifth to a quarter of either is assumed where all bands are equally wide, and the
less in proportion to how much narrower both approaches' bands are.
"""

import numpy as np

from crashfuse.signals.pulse import FloatArray

_EQUAL: FloatArray = np.array([-0.15, 0.25, -1.4])  # logits of time domain, displacement domain, raw CAE with one test
_BY_LOG_TESTS: FloatArray = np.array([0.0, 0.0, -0.1])
_SLOPES: FloatArray = np.array([-0.3, 0.3, 0.0])  # by the log ratio of the two approaches' spreads: for two or three
_AGAINST_CAE: FloatArray = np.array([0.0, 0.0, -1.0])  # by the log ratio of the raw CAE's spread to theirs

SPREAD: FloatArray = np.array([1.0, 0.2, 0.2])
"""Prior standard deviations of the logits and of their slopes: a handful of tests says little about a slope."""

STRENGTH = 10.0


def prior(n_tests: int) -> FloatArray:
    """Prior mean of logits and slopes with this many tests to learn from, shape (3, 3)."""
    return np.column_stack([_EQUAL + _BY_LOG_TESTS * np.log(n_tests), _SLOPES, _AGAINST_CAE])
