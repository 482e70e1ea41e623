"""After t0 the vehicle bounces back: a pulse is continued along the CAE model's own unloading branch."""

import numpy as np

from crashfuse.loading import LoadingPhase
from crashfuse.pulse import DT_S, FloatArray, kinematics

_JOIN_S = 0.005  # time constant with which a step at t0 fades
_SCALES = (1 / 3, 3.0)  # how much the branch may be scaled to meet the pulse at t0


def follow_unloading(
    accel_mps2: FloatArray, speed_mps: float, cae: FloatArray, cae_loading: LoadingPhase
) -> FloatArray:
    """Replace what comes after t0 by the CAE pulse's unloading, shifted to t0 and scaled to join without a jump.

    Parameters
    ----------
    accel_mps2 : ndarray, shape (n_draws, n)
        Pulses on the study grid; one that does not stop the vehicle within it is left as it is.
    speed_mps : float
    cae : ndarray, shape (n,)
        The CAE pulse at this condition; beyond its end it keeps its last value.
    cae_loading : LoadingPhase
        Of that pulse. One that never stops the vehicle has no unloading: the acceleration then just fades.

    Returns
    -------
    ndarray, shape (n_draws, n)
    """
    time = np.arange(accel_mps2.shape[-1]) * DT_S
    t0 = kinematics(accel_mps2, speed_mps, DT_S).t0_s[:, None]
    after = np.maximum(time - t0, 0.0)  # NaN where there is no t0
    at_t0 = np.array([np.interp(t, time, accel) for t, accel in zip(t0[:, 0], accel_mps2, strict=True)])[:, None]
    if np.isnan(cae_loading.t0_s):
        branch, end = np.zeros_like(accel_mps2), 0.0
    else:
        branch, end = np.interp(cae_loading.t0_s + after, time, cae), cae_loading.accel_mps2[-1]
    scale = np.clip(at_t0 / end, *_SCALES) if end < 0 else np.ones_like(at_t0)
    unloading = scale * branch + (at_t0 - scale * end) * np.exp(-after / _JOIN_S)
    return np.where(time > t0, unloading, accel_mps2)
