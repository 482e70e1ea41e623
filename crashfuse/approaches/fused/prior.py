"""What is thought of the components before a vehicle's own left-out tests are heard.

``python benchmarks/fused_prior.py`` fits such numbers to random vehicles of many kinds, so that the mixture's score on
tests that were not learned from is best on average; these are rounded. Where their bands are equally wide both
approaches count about the same, with one test the displacement domain a little more; the raw CAE counts a tenth of
either.
"""

import numpy as np

from crashfuse.signals.pulse import FloatArray

_EQUAL: FloatArray = np.array([0.0, 0.25, -2.1])  # logits of time domain, displacement domain, raw CAE with one test
_BY_LOG_TESTS: FloatArray = np.array([0.0, -0.15, -0.3])
_SLOPES: FloatArray = np.array([-0.3, 0.3, 0.0])  # by the log ratio of the two approaches' spreads

SPREAD: FloatArray = np.array([1.0, 0.2])
"""Prior standard deviations of the logits and of their slopes: a handful of tests says little about a slope."""

STRENGTH = 10.0


def prior(n_tests: int) -> FloatArray:
    """Prior mean of logits and slopes with this many tests to learn from, shape (3, 2)."""
    return np.column_stack([_EQUAL + _BY_LOG_TESTS * np.log(n_tests), _SLOPES])
