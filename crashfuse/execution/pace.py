"""How long a computation takes on this machine as it is now."""

import time
from collections import deque
from statistics import median

_LOOPS, _USUAL_S = 500_000, 0.0155  # of the processor that expected seconds are of
_LEAST, _MOST = 0.7, 1.5  # times what is expected; once more than that where others compute, whose work may end or grow
_LATEST = 3  # jobs that tell how fast this machine is; more would tell how it was
_SKIPPED = 0.2  # of what is expected: it was read rather than computed
_BUSY = 1.5


def slowness() -> float:
    """How many times longer than on a quiet usual core a fixed piece of work takes now."""
    begun = time.perf_counter()
    for _ in range(_LOOPS):
        pass
    return (time.perf_counter() - begun) / _USUAL_S


class Pace:
    """What the latest jobs took for what was expected of them."""

    def __init__(self) -> None:
        self._ratios = deque[float](maxlen=_LATEST)

    def learn(self, expected_s: float, took_s: float) -> None:
        """Take a finished job into account."""
        if took_s > _SKIPPED * expected_s > 0:
            self._ratios.append(took_s / expected_s)

    def range_s(self, usual_s: float, slow: float) -> tuple[float, float]:
        """Seconds from–to of what takes ``usual_s`` on two quiet usual cores, if all is now this many times slower."""
        expected = usual_s * slow * (median(self._ratios) if self._ratios else 1.0)
        return _LEAST * expected, _MOST * expected * (_MOST if slow > _BUSY else 1.0)
