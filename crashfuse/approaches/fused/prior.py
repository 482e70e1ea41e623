"""What is thought of the components before a vehicle's own left-out tests are heard.

``python benchmarks/fused_prior.py`` fits such numbers to random vehicles of many kinds, so that the mixture learned
from one or two tests rates best on the others; they are rounded here.
"""

import numpy as np

from crashfuse.signals.pulse import FloatArray

_EQUAL: FloatArray = np.array([0.0, 0.6, 1.0, -2.0])  # logits, in the order of the components
_SLOPES: FloatArray = np.array([-0.6, -0.6, -0.6, -1.0])  # of each by the log ratio of its own spread

PRIOR: FloatArray = np.column_stack([_EQUAL, np.diag(_SLOPES)])
"""Prior mean of logits and slopes, shape (4, 5)."""

SPREAD: FloatArray = np.array([1.0, 0.4, 0.4, 0.4, 0.2])
"""Prior standard deviations of the logits and of their slopes: a handful of tests says little about a slope."""

STRENGTH = 10.0
