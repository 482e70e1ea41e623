"""The contracts of an approach and of a reader, for the tests of a package that adds one; what they test with.

>>> from crashfuse.testing import ApproachContract, ReaderContract
>>> class TestScaledCae(ApproachContract):
...     approach = ScaledCae
>>> class TestPolar(ReaderContract):
...     format = "polar"
...     files = {"P1.polar": SOUND}

pytest then runs every test of the contract on it. The package's own approaches and readers are held to the same tests.
"""

from crashfuse.testing.approaches import ApproachContract, small_campaign
from crashfuse.testing.readers import ReaderContract

__all__ = ["ApproachContract", "ReaderContract", "small_campaign"]
