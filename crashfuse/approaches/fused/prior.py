"""What is thought of the components before a vehicle's own left-out tests are heard.

Round numbers with which mixtures learned from one or two tests rate well on others, on random vehicles
(``benchmarks/fused_prior.py``) and on campaigns of other kinds. By the random vehicles alone the pre-trained network
would count for more, but it was trained on similar ones.
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
