"""When deceleration begins."""

from typing import NamedTuple

import numpy as np

from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import G

_PASSED_MPS2, _BEGUN_MPS2, _CALM_MPS2, _STAYS_S = 0.5 * G, 0.1 * G, 0.05 * G, 1e-3
_SOFT = 1.5  # times as late as 0.05 g comes 0.5 g


class Onset(NamedTuple):
    """When deceleration was last below 0.05 g, and when it exceeds 0.5 g to stay, in s."""

    calm_s: float
    passed_s: float

    def is_sudden(self, begin_s: float) -> bool:
        """Whether a vehicle meets something after moving freely; a soft contact grows slowly from the beginning."""
        return self.passed_s - begin_s <= _SOFT * (self.calm_s - begin_s)


def onset(time_s: FloatArray, accel: FloatArray) -> Onset | None:
    """When deceleration at CFC 60 first exceeds 0.5 g and stays above it for 1 ms; None if it never does.

    A bumper is soft: in a barrier test at 57 km/h it begins 2 ms after the bumper contact switch closes.
    """
    step = float((time_s[-1] - time_s[0]) / (time_s.size - 1))
    smooth = smoothed(time_s, accel)
    above = -smooth > _PASSED_MPS2
    run = max(round(_STAYS_S / step), 1)
    stays = np.convolve(above, np.ones(run), "valid") > run - 0.5
    if not stays.any():
        return None
    passed = int(np.argmax(stays))
    calm = np.flatnonzero(-smooth[:passed] <= _CALM_MPS2)
    return Onset(float(time_s[calm[-1] if calm.size else 0]), float(time_s[passed]))


def smoothed(time_s: FloatArray, accel: FloatArray) -> FloatArray:
    """A record at CFC 60, if it is long and dense enough for the filter."""
    step = float((time_s[-1] - time_s[0]) / (time_s.size - 1))
    return cfc_filter(accel, cfc=60, dt_s=step) if step <= 1 / 600 and time_s[-1] - time_s[0] > 0.02 else accel


def free_travel_s(time_s: FloatArray, accel: FloatArray) -> float:
    """For how long a vehicle moves before it decelerates by 0.1 g, from the first sample; infinite if it never does.

    A filter lets it begin too early: of 200 mm, 200 to 202 are found in CAE pulses as they are, 182 to 194 with CFC 60.
    """
    begins = onset(time_s, accel)
    if begins is None:
        return float(np.inf)
    hit = (time_s >= begins.calm_s) & (-accel > _BEGUN_MPS2)  # what is not filtered yet begins later
    return float(time_s[max(int(hit.argmax()) - 1, 0)] - time_s[0])
