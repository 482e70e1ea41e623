"""Ratings, and what a rating is made of, as tables for reading and as plain JSON values."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from crashfuse.approaches.registry import LABELS, label_of
from crashfuse.errors import require_a
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.signals.rating import graded
from crashfuse.signals.rating_explanation import RatingExplanation, rating_sentences
from crashfuse.study.study import Fold, Study
from crashfuse.units import MS, G, difference, number, signed


def humps_table(explanation: RatingExplanation, display: Display = DEFAULT) -> pd.DataFrame:
    """One row a hump of the test: its time, that in the prediction, and its share in what the scores lost."""
    require_a(RatingExplanation, explanation, "crashfuse.explain_rating(reference, comparison)")
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
    require_a(RatingExplanation, explanation, "crashfuse.explain_rating(reference, comparison)")
    columns = [
        "Outside from (ms)", "to (ms)", f"Prediction minus test, largest ({display.unit})", "Beyond the outer corridor",
        "Costs of the overall rating",
    ]  # fmt: skip
    rows = [
        (
            f"{excursion.begin_s / MS:.1f}",
            f"{excursion.end_s / MS:.1f}",
            signed(excursion.difference_mps2 * display.accel_scale, 1),
            "yes" if excursion.beyond_outer else "no",
            f"{excursion.loss:.3f}",
        )
        for excursion in explanation.excursions
    ]
    return pd.DataFrame(rows, columns=columns)


def explanation_record(explanation: RatingExplanation, comparison: str = "prediction") -> dict[str, Any]:
    """As plain JSON values, times in ms and accelerations in g, with sentences that call the curve ``comparison``."""
    return {
        "sentences": {part: str(text) for part, text in rating_sentences(explanation, comparison).items()},
        "losses": explanation.losses,
        "late_ms": explanation.shift_s / MS,
        "inner_corridor_g": explanation.inner_mps2 / G,
        "outer_corridor_g": explanation.outer_mps2 / G,
        "outside_inner_corridor": [
            {
                "begin_ms": excursion.begin_s / MS,
                "end_ms": excursion.end_s / MS,
                "difference_g": excursion.difference_mps2 / G,
                "beyond_outer": excursion.beyond_outer,
                "loss": excursion.loss,
            }
            for excursion in explanation.excursions
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


TABLE_3 = {"lf_tcn": "LF_TCN", "time_domain": "MF_TCN"}  # the network before and after it has seen the tests
TABLE_5 = {name: LABELS[name] for name in ("time_domain", "displacement_domain", "fused", "cae")}
"""What Table 5 compares, and our mixture."""
MEAN = "Mean"
TTZV_COLUMN = "0–TTZV"  # the column of ratings up to each test's time of zero velocity
REPEAT = "A repeat"  # what a repeat of the test would rate: the last row of each test, where it is known


_FURTHER = {
    "sg_magnitude": "Sprague–Geers magnitude",
    "sg_phase": "phase",
    "sg_comprehensive": "comprehensive",
    "anova_mean": "Residuals, mean",
    "anova_deviation": "deviation",
}


def further_table(study: Study, fold: Fold, window_ms: float) -> pd.DataFrame:
    """Measures beside the rating that were asked for, one row an approach; empty if none were."""
    measured = {name: fold.further(name, window_ms, study.config.also) for name in fold.ratings}
    return pd.DataFrame(
        {"Approach": LABELS[name], **{_FURTHER[column]: number(value, ".3f") for column, value in values.items()}}
        for name, values in measured.items()
        if values
    )


def rating_table(study: Study, rows: Mapping[str, str]) -> pd.DataFrame:
    """Overall ratings as in the paper's tables, unrounded: :data:`TABLE_3` or :data:`TABLE_5`, as far as in the study.

    Indexed by test and approach, one column a window. Under the approaches stands what a repeat of the test would rate,
    if it is known; in the last rows the mean over several tests.
    """
    windows = study.config.windows_ms
    labels = {name: label for name, label in rows.items() if name in study.config.approaches}
    table: dict[tuple[str, str], list[float]] = {}
    for fold in study.folds if labels else ():
        for name, label in labels.items():
            table[fold.held_out, label] = [fold.ratings[name][window].overall for window in windows]
        if fold.held_out in study.repeatability:
            repeats = study.repeatability[fold.held_out]
            table[fold.held_out, REPEAT] = [repeats[w].value if w in repeats else np.nan for w in windows]
    if labels and len(study.folds) > 1:
        means = mean_values(study).drop(columns=TTZV_COLUMN, errors="ignore").rename(index=labels)
        table |= {(MEAN, label): means.loc[label].tolist() for label in labels.values()}
        if study.repeatability:
            table[MEAN, REPEAT] = means.loc[REPEAT].tolist() if REPEAT in means.index else [np.nan] * len(windows)
    index = pd.MultiIndex.from_tuples(list(table), names=["Test", "Approach"])
    return pd.DataFrame([*table.values()], index=index, columns=[f"(0, {window:g}) ms" for window in windows])


def mean_values(study: Study) -> pd.DataFrame:
    """Overall rating averaged over the held-out tests by approach and window, unrounded; last that of repeats."""
    windows = {window: f"0–{window:g} ms" for window in study.config.windows_ms}
    rows = {
        name: {label: study.mean_rating(name, window) for window, label in windows.items()}
        for name in study.config.approaches
    }
    for name, by_window in rows.items() if study.config.to_ttzv else ():
        by_window[TTZV_COLUMN] = float(np.mean([fold.overall_to_ttzv(name) for fold in study.folds]))
    repeats = {label: mean for window, label in windows.items() if (mean := study.mean_repeat(window)) is not None}
    return pd.DataFrame.from_dict(rows | ({REPEAT: repeats} if repeats else {}), orient="index")


def mean_ratings(study: Study) -> pd.DataFrame:
    """Mean ratings with their grades, as text, by approach and window."""
    means = mean_values(study).rename(index=label_of).rename_axis("Approach")
    return means.map(lambda mean: "–" if np.isnan(mean) else graded(mean)).reset_index()


def best(table: pd.DataFrame) -> pd.DataFrame:
    """Mask of the best approach of each test and window, compared as shown, to three digits. Same shape, bool."""
    shown = table.round(3)
    shown.loc[table.index.get_level_values(-1) == REPEAT] = np.nan
    by_test = shown.groupby(level=0, sort=False).transform("max") if table.index.nlevels > 1 else shown.max()
    return shown == by_test
