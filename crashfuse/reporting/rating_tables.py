"""What a rating is made of as tables for reading, and as plain JSON values."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.signals.rating import graded
from crashfuse.signals.rating_explanation import RatingExplanation
from crashfuse.signals.rating_sentences import rating_sentences
from crashfuse.study.study import Study
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


TABLE_3 = {"lf_tcn": "LF_TCN", "time_domain": "MF_TCN"}
"""What Table 3 compares: the network before and after it has seen the tests."""

TABLE_5 = {name: LABELS[name] for name in ("time_domain", "displacement_domain", "fused", "cae")}
"""What Table 5 compares, and our mixture."""

MEAN = "Mean"

REPEAT = "A repeat"
"""What a repeat of the test would rate: the last row of each test, where it is known."""


def rating_table(study: Study, rows: Mapping[str, str]) -> pd.DataFrame:
    """Overall ratings in the form of the paper's Tables 3 and 5, with the mean over several tests in the last rows.

    Under the approaches stands what a repeat of the test would rate, if it is known.

    Parameters
    ----------
    rows : mapping of str to str
        Labels by approach: :data:`TABLE_3` or :data:`TABLE_5`; those not in the study are left out.

    Returns
    -------
    DataFrame
        Indexed by test and approach, one column per window ("(0, 20) ms"), unrounded.
    """
    config = study.config
    columns = {window: f"(0, {window:g}) ms" for window in config.windows_ms}
    own = {name: label for name, label in rows.items() if name in config.approaches}
    found: dict[tuple[str, str], list[float]] = {}
    for fold in study.folds:
        for name, label in own.items():
            found[fold.held_out, label] = [fold.ratings[name][window].overall for window in columns]
        if own and fold.held_out in study.repeatability:
            repeats = study.repeatability[fold.held_out]
            found[fold.held_out, REPEAT] = [repeats[w].value if w in repeats else np.nan for w in columns]
    if len(study.folds) > 1:
        found |= {(MEAN, label): [study.mean_rating(name, window) for window in columns] for name, label in own.items()}
        if own and study.repeatability:
            found[MEAN, REPEAT] = [np.nan if (mean := study.mean_repeat(w)) is None else mean for w in columns]
    index = pd.MultiIndex.from_tuples(list(found), names=["Test", "Approach"])
    return pd.DataFrame([*found.values()], index=index, columns=list(columns.values()))


def mean_ratings(study: Study) -> pd.DataFrame:
    """Overall rating averaged over the held-out tests with its grade, as text, by approach and window.

    The last row is what repeats of the tests would rate, where it is known.
    """
    windows = {window: f"0–{window:g} ms" for window in study.config.windows_ms}
    rows = [
        {"Approach": LABELS[name], **{label: graded(study.mean_rating(name, w)) for w, label in windows.items()}}
        for name in study.config.approaches
    ]
    means = {label: study.mean_repeat(w) for w, label in windows.items()}
    if known := {label: graded(mean) for label, mean in means.items() if mean is not None}:
        rows.append({"Approach": REPEAT, **known})
    return pd.DataFrame(rows).fillna("–")


def best(table: pd.DataFrame) -> pd.DataFrame:
    """Mask of the best approach of each test and window, compared as shown, to three digits. Same shape, bool."""
    shown = table.round(3)
    shown.loc[table.index.get_level_values(1) == REPEAT] = np.nan
    return shown == shown.groupby(level=0, sort=False).transform("max")
