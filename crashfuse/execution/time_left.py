"""The time that a computation of several steps has left, from what it was expected to take and how fast it went."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from crashfuse.execution.progress import Progress

_PRIOR_S = 3.0  # time that passes before the pace is believed more than what was expected
_PRIOR_SHARE = 0.1  # share of a step that is done before its own pace is believed more than that of all
_LAST_SHARE = 0.1  # of a step that takes longer than expected, this share is left
_OWN_S = 5.0  # time after which less than that share is enough
_SETTLING_SHARE = 0.1  # of what is left, in which most of a rise is believed: an estimate jumps where a step begins


@dataclass(eq=False)
class _Step:
    expected_s: float
    done: float = 0.0  # share
    started: bool = False
    known: float = 0.0  # share that was done at the first report: known from earlier
    mark_s: float = 0.0  # since then it is the only step that moves
    mark_done: float = 0.0

    def done_s(self, now_s: float, *, alone: bool) -> float:
        """What is done of the time expected; of a step that runs alone and says nothing, what probably is."""
        if alone and self.done == self.mark_done:
            done = min(self.mark_done + max(now_s - self.mark_s, 0.0) / self.expected_s, 1 - _LAST_SHARE)
            return self.expected_s * max(done - self.known, 0.0)
        return self.expected_s * (self.done - self.known)

    def left_s(self, whole_s: float, now_s: float) -> float:
        """Time left of a step that runs alone and was expected to take ``whole_s``."""
        for_s, moved = max(now_s - self.mark_s, 0.0), self.done - self.mark_done
        expected_s = max(whole_s * (1 - self.mark_done) - for_s, _LAST_SHARE * whole_s)
        if not moved:
            return expected_s
        trust = moved / (moved + _PRIOR_SHARE / (1 + for_s / _OWN_S))
        return trust * for_s * (1 - self.done) / moved + (1 - trust) * expected_s


class TimeLeft:
    """Time left of a whole computation.

    Steps take turns or run side by side, and each is expected to take some time on a usual computer. The pace of what
    is done so far tells how much longer the rest takes here; a step that runs alone also has a pace of its own. A step
    that never begins although a later one has is taken to be known from earlier.

    Parameters
    ----------
    expected_s : mapping of str to float
        Duration of each step on a usual computer in s, by name, in order; other steps are parts of these.
    now_s : float
        Time of the start, in s, of any clock that the other methods use as well.
    """

    def __init__(self, expected_s: Mapping[str, float], now_s: float) -> None:
        self._steps = {name: _Step(seconds) for name, seconds in expected_s.items()}
        self._start_s = now_s
        self._shown = 0.0
        self._told: tuple[float, float] | None = None  # what was told last, and when

    def take(self, progress: Progress, now_s: float) -> None:
        """Note how far a step is."""
        step = self._steps.get(progress.step)
        if step is None:
            return
        running = self._running()
        if not step.started:
            step.started, step.done, step.known = True, progress.fraction, progress.fraction
        step.done = max(step.done, progress.fraction)  # it may start again, for the next test
        if self._running() != running:
            for other in self._running():
                other.mark_s, other.mark_done = now_s, other.done

    def left_s(self, now_s: float) -> float | None:
        """Time left in s: an estimate that rises is believed bit by bit; None if nothing is known about the steps."""
        if not self._steps:
            return None
        left_s = self._estimate_s(now_s)
        if self._told is not None:
            for_s = now_s - self._told[1]
            risen_s = left_s - max(self._told[0] - for_s, 0.0)
            if risen_s > 0:
                left_s -= risen_s * math.exp(-for_s / (_SETTLING_SHARE * left_s))
        self._told = left_s, now_s
        return left_s

    def _estimate_s(self, now_s: float) -> float:
        steps = list(self._steps.values())
        last = max((number for number, step in enumerate(steps) if step.done), default=-1)
        pending = [step for number, step in enumerate(steps) if step.done < 1 and (step.started or number > last)]
        running = self._running()
        alone = running[0] if len(running) == 1 else None
        done_s = sum(step.done_s(now_s, alone=step is alone) for step in steps)
        pace = (now_s - self._start_s + _PRIOR_S) / (done_s + _PRIOR_S)
        left_s = 0.0
        for step in pending:
            whole_s = step.expected_s * pace
            if step is alone:
                left_s += step.left_s(whole_s, now_s)
            else:
                left_s += whole_s * (1 - step.done)
        return left_s

    def share(self, now_s: float) -> float:
        """Share of the whole time that is over, 0 to 1; it never falls."""
        left_s, over_s = self.left_s(now_s), now_s - self._start_s
        if left_s is not None and left_s + over_s > 0:
            self._shown = max(self._shown, over_s / (left_s + over_s))
        return self._shown

    def _running(self) -> list[_Step]:
        return [step for step in self._steps.values() if step.started and step.done < 1]


def rounded(seconds: float) -> float:
    """A time left to the precision that it deserves: full seconds below 20, then steps of about a tenth."""
    if seconds < 20:
        return max(math.ceil(seconds), 1)
    step: float = 10.0 ** math.floor(math.log10(seconds)) / 2
    return math.ceil(seconds / step) * step
