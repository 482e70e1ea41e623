"""The humps of a pulse, and which hump of one pulse is which of another: by dynamic time warping, both ways."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.warping import warping_paths

_PROMINENCE = 0.1  # of the largest |a|: what rises less above its valleys is a ripple
_FARTHEST = 0.2  # of the samples: as far apart as the rating looks for a shift


@dataclass(frozen=True, slots=True)
class Hump:
    """A hump of a pulse, from valley to valley.

    Attributes
    ----------
    begin, peak, end : int
        Samples; the hump is ``[begin, end)``.
    """

    begin: int
    peak: int
    end: int

    @property
    def samples(self) -> slice:
        """Its samples."""
        return slice(self.begin, self.end)


def humps(curve: FloatArray) -> tuple[Hump, ...]:
    """The humps of a curve, shape (n,), on the side of zero where most of it lies, in order of time.

    A hump rises by at least a tenth of the largest value above the valleys beside it. Together they fill the curve; it
    may have none.
    """
    from scipy.signal import find_peaks  # half a second

    upright = curve if curve.sum() > 0 else -curve
    peaks, _ = find_peaks(upright, prominence=_PROMINENCE * np.abs(curve).max())
    valleys = [int(left + upright[left:right].argmin()) for left, right in pairwise(peaks)]
    ends = [0, *valleys, curve.size]
    return tuple(Hump(begin, peak, end) for peak, (begin, end) in zip(peaks.tolist(), pairwise(ends), strict=False))


def counterparts(reference: FloatArray, comparison: FloatArray) -> dict[int, Hump]:
    """The hump of the comparison that is each of the reference's, by number in :func:`humps`, where there is one.

    Both curves, shape (n,), are warped onto each other as they stand. Two humps are the same if the peak of each is
    aligned with a moment of the other.
    """
    (i, j), *_ = warping_paths(comparison[None], reference, band=_FARTHEST)
    found = {}
    others = humps(comparison)
    for number, hump in enumerate(humps(reference)):
        here = i[j == hump.peak]
        for other in others:
            there = j[i == other.peak]
            if _meets(here, other) and _meets(there, hump):
                found[number] = other
    return found


def _meets(samples: np.ndarray, hump: Hump) -> bool:
    return bool(((samples >= hump.begin) & (samples < hump.end)).any())
