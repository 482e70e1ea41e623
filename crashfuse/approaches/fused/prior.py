"""What is thought of the components before a vehicle's own left-out tests are heard.

``python benchmarks/fused_prior.py`` fits such numbers to random vehicles of many kinds, so that the mixture learned
from one or two tests rates best on the others; they are rounded here.
"""

import numpy as np

from crashfuse.signals.pulse import FloatArray

_EQUAL: FloatArray = np.array([-0.4, 0.4, -2.9])  # logits of time domain, displacement domain, raw CAE
_SLOPES: FloatArray = np.array([-0.3, 0.3, 0.0])  # by the log ratio of the two approaches' spreads
_AGAINST_CAE: FloatArray = np.array([0.0, 0.0, -1.5])  # by the log ratio of the raw CAE's spread to theirs

PRIOR: FloatArray = np.column_stack([_EQUAL, _SLOPES, _AGAINST_CAE])
"""Prior mean of logits and slopes, shape (3, 3)."""

SPREAD: FloatArray = np.array([1.0, 0.2, 0.2])
"""Prior standard deviations of the logits and of their slopes: a handful of tests says little about a slope."""

STRENGTH = 10.0
