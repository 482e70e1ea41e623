"""What a rating is made of as tables for reading, and as plain JSON values."""

from typing import Any

import pandas as pd

from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.signals.rating_explanation import RatingExplanation
from crashfuse.signals.rating_sentences import rating_sentences
from crashfuse.units import MS, G
from crashfuse.wording import difference, signed


def humps_table(explanation: RatingExplanation, display: Display = DEFAULT) -> pd.DataFrame:
    """One row a hump of the test: its time, that in the prediction, and its share in what the scores lost."""
    scale = abs(display.accel_scale)
    return pd.DataFrame(
        {
            "Hump": f"{number}",
            "From–to (ms)": f"{hump.begin_s / MS:.1f}–{hump.end_s / MS:.1f}",
            "Peak, test (ms)": f"{hump.peak_s / MS:.1f}",
            "Peak, prediction (ms)": "none" if hump.counterpart_s is None else f"{hump.counterpart_s / MS:.1f}",
            "Late (ms)": "–" if (there := hump.counterpart_s) is None else difference(there / MS, hump.peak_s / MS, 1),
            "Correlation gained by the shift": signed(hump.shift_gain, 3),
            "Share of magnitude's error (%)": f"{100 * hump.magnitude_share:.0f}",
            "Share of slope's error (%)": f"{100 * hump.slope_share:.0f}",
            f"Stronger than the test, shifted and warped ({display.unit})": signed(hump.difference_mps2 * scale, 1),
        }
        for number, hump in enumerate(explanation.humps, start=1)
    )


def excursions_table(explanation: RatingExplanation, display: Display = DEFAULT) -> pd.DataFrame:
    """One row a stretch of time outside the inner corridor, in order of time, with what it costs of the rating."""
    columns = [
        "Outside from (ms)", "to (ms)", f"Prediction minus test, largest ({display.unit})", "Beyond the outer corridor",
        "Costs of the overall rating",
    ]  # fmt: skip
    rows = [
        (
            f"{own.begin_s / MS:.1f}",
            f"{own.end_s / MS:.1f}",
            signed(own.difference_mps2 * display.accel_scale, 1),
            "yes" if own.beyond_outer else "no",
            f"{own.loss:.3f}",
        )
        for own in explanation.excursions
    ]
    return pd.DataFrame(rows, columns=columns)


def explanation_record(explanation: RatingExplanation, comparison: str = "prediction") -> dict[str, Any]:
    """As plain JSON values, times in ms and accelerations in g, with the sentences.

    Parameters
    ----------
    comparison : str
        What the curve that is compared with the test is called in the sentences, in a word.
    """
    return {
        "sentences": {part: str(text) for part, text in rating_sentences(explanation, comparison).items()},
        "losses": explanation.losses,
        "late_ms": explanation.shift_s / MS,
        "inner_corridor_g": explanation.inner_mps2 / G,
        "outer_corridor_g": explanation.outer_mps2 / G,
        "outside_inner_corridor": [
            {
                "begin_ms": own.begin_s / MS,
                "end_ms": own.end_s / MS,
                "difference_g": own.difference_mps2 / G,
                "beyond_outer": own.beyond_outer,
                "loss": own.loss,
            }
            for own in explanation.excursions
        ],
        "humps": [
            {
                "begin_ms": hump.begin_s / MS,
                "peak_ms": hump.peak_s / MS,
                "end_ms": hump.end_s / MS,
                "late_ms": None if hump.late_s is None else hump.late_s / MS,
                "shift_gain": hump.shift_gain,
                "magnitude_share": hump.magnitude_share,
                "slope_share": hump.slope_share,
                "too_strong_g": hump.difference_mps2 / G,
            }
            for hump in explanation.humps
        ],
    }
