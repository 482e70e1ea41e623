"""The figure of calibration shows what bands promise against what they held."""

import numpy as np

from crashfuse.reporting.plots.calibration import calibration_curves


def test_levels_run_along_x_and_shares_along_y_in_percent() -> None:
    """Half the time inside the 90 % band is drawn at (90, 50); the diagonal is there to compare."""
    figure = calibration_curves(np.array([0.5, 0.9]), {"fused": np.array([0.4, 0.5])})
    promised, fused = figure.data
    assert (list(promised.x), list(promised.y)) == ([0, 100], [0, 100])
    np.testing.assert_allclose(fused.x, [50, 90])
    np.testing.assert_allclose(fused.y, [40, 50])
    assert fused.name == "Fused"
