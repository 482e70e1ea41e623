"""What has which colour: approaches, grades, and tests by their speed."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd  # noqa: F401  (before Plotly, which otherwise imports it half-way, in several threads at once)
from plotly.colors import sample_colorscale

from crashfuse.campaign import CrashTest
from crashfuse.units import MPH

MEASURED_COLOUR = "#000000"
COLOURS: Mapping[str, str] = {  # Okabe & Ito's palette, which colour-blind readers can tell apart
    "cae": "#7f7f7f",
    "lf_tcn": "#CC79A7",
    "time_domain": "#0072B2",
    "displacement_domain": "#D55E00",
    "fused": "#009E73",
}
DASHES: Mapping[str, str] = {"cae": "dash", "lf_tcn": "dot"}  # what has not seen a test is not drawn solid

GRADE_COLOURS: Mapping[str, str] = {
    "Poor": "#F4B183",
    "Fair": "#FBE3D0",
    "Good": "#CFE3F2",
    "Excellent": "#7FB6DC",
}
"""Colour behind each grade word of ISO/TS 18571; black text reads on all of them."""


def speed_lines(tests: Sequence[CrashTest]) -> dict[str, dict[str, str]]:
    """A line for each test: dark for slow, on a scale for colour-blind readers too; dashes tell repeats apart."""
    if not tests:
        return {}
    speeds = np.array([test.condition.speed_mps for test in tests])
    share = (speeds - speeds.min()) / max(float(np.ptp(speeds)), 1e-9)
    colours = sample_colorscale("Viridis", (0.88 * share).tolist())  # the bright end is lost on white
    rounded = np.round(speeds / MPH)
    repeats = [int((rounded[:i] == rounded[i]).sum()) for i in range(len(tests))]
    return {
        test.id: {"color": colour, "dash": ("solid", "dash", "dot", "dashdot")[repeat % 4]}
        for test, colour, repeat in zip(tests, colours, repeats, strict=True)
    }
