"""Other measures of how two curves agree, beside ISO/TS 18571, which decides: Sprague and Geers, and NCHRP 179's ANOVA.

Both are of the curves as they are, neither shifted nor warped; 0 is a perfect match, and they are no grades.
"""

from collections.abc import Callable, Mapping

import numpy as np

from crashfuse.signals.pulse import FloatArray


def sprague_geers(reference: FloatArray, comparison: FloatArray) -> dict[str, float]:
    """Errors of magnitude and phase, each blind to the other, and both together (Geers 1984; Sprague and Geers 2003).

    The magnitude's is relative, positive where the comparison is the stronger; that of the phase is 0 to 1, as a share
    of half a period. NaN of the phase of a comparison that is zero throughout.
    """
    of_reference, of_comparison, of_both = (
        float(np.trapezoid(product)) for product in (reference**2, comparison**2, reference * comparison)
    )
    magnitude = float(np.sqrt(of_comparison / of_reference)) - 1
    phase = float("nan")
    if of_comparison:
        phase = float(np.arccos(np.clip(of_both / np.sqrt(of_reference * of_comparison), -1, 1)) / np.pi)
    together = float(np.hypot(magnitude, phase))
    return {"sg_magnitude": magnitude, "sg_phase": phase, "sg_comprehensive": together}


def residual_anova(reference: FloatArray, comparison: FloatArray) -> dict[str, float]:
    """Mean and standard deviation of the differences, as shares of the largest value of the reference (Ray 1996)."""
    residuals = (comparison - reference) / np.abs(reference).max()
    return {"anova_mean": float(residuals.mean()), "anova_deviation": float(residuals.std(ddof=1))}


FURTHER_METRICS: Mapping[str, Callable[[FloatArray, FloatArray], dict[str, float]]] = {
    "sprague-geers": sprague_geers,
    "anova": residual_anova,
}
"""By the names that ``crashfuse rate --also`` knows; each gives columns."""
