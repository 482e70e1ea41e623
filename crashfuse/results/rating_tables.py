"""Ratings, and what a rating is made of, as tables for reading and as plain JSON values."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pandas as pd

from crashfuse.approaches.registry import LABELS, label_of
from crashfuse.errors import require_a
from crashfuse.results.table import Column, Table
from crashfuse.signals.rating_explanation import RatingExplanation, rating_sentences
from crashfuse.study.study import Fold, Study
from crashfuse.units import MS, G

_HUMPS = (
    Column("Hump", "number", form=".0f", source="hump"),
    Column("From–to", "range", "ms", further=("begin_ms", "end_ms")),
    Column("Peak, test", "number", "ms", source="peak_ms"),
    Column("Peak, prediction", "number", "ms", source="counterpart_ms", missing="none"),
    Column("Late", "difference", "ms", source="counterpart_ms", further=("peak_ms",)),
    Column("Correlation gained by the shift", "number", form="+.3f", source="shift_gain"),
    Column("Share of magnitude's error", "share", "%", ".0f", source="magnitude_share"),
    Column("Share of slope's error", "share", "%", ".0f", source="slope_share"),
    Column("Stronger than the test, shifted and warped", "number", "g", "+.1f", source="too_strong_g"),
)
_EXCURSIONS = (
    Column("Outside from", "number", "ms", source="begin_ms"),
    Column("to", "number", "ms", source="end_ms"),
    Column("Prediction minus test, largest", "number", "g", "+.1f", source="difference_g", flips=True),
    Column("Beyond the outer corridor", source="beyond_outer"),
    Column("Costs of the overall rating", "number", form=".3f", source="loss"),
)


def humps_table(explanation: RatingExplanation) -> Table:
    """One row a hump: its times in test and prediction, and its share in what the scores lost."""
    require_a(RatingExplanation, explanation, "crashfuse.explain_rating(reference, comparison)")
    numbers = range(1, len(explanation.humps) + 1)
    there = [np.nan if hump.counterpart_s is None else hump.counterpart_s / MS for hump in explanation.humps]
    frame = pd.DataFrame(_humps(explanation)).assign(hump=numbers, counterpart_ms=there)
    return Table("humps", frame, _HUMPS)


def excursions_table(explanation: RatingExplanation) -> Table:
    """One row a stretch outside the inner corridor, in order of time, with its cost."""
    require_a(RatingExplanation, explanation, "crashfuse.explain_rating(reference, comparison)")
    return Table("excursions", pd.DataFrame(_excursions(explanation)), _EXCURSIONS)


def explanation_record(explanation: RatingExplanation, comparison: str = "prediction") -> dict[str, Any]:
    """As plain JSON values, times in ms and accelerations in g, with sentences that call the curve ``comparison``."""
    return {
        "sentences": {part: str(text) for part, text in rating_sentences(explanation, comparison).items()},
        "losses": explanation.losses,
        "late_ms": explanation.shift_s / MS,
        "inner_corridor_g": explanation.inner_mps2 / G,
        "outer_corridor_g": explanation.outer_mps2 / G,
        "outside_inner_corridor": _excursions(explanation),
        "humps": _humps(explanation),
    }


def _excursions(explanation: RatingExplanation) -> list[dict[str, Any]]:
    return [
        {
            "begin_ms": excursion.begin_s / MS,
            "end_ms": excursion.end_s / MS,
            "difference_g": excursion.difference_mps2 / G,
            "beyond_outer": excursion.beyond_outer,
            "loss": excursion.loss,
        }
        for excursion in explanation.excursions
    ]


def _humps(explanation: RatingExplanation) -> list[dict[str, Any]]:
    return [
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
    ]


TABLE_3 = {"lf_tcn": "LF_TCN", "time_domain": "MF_TCN"}  # the network before and after it has seen the tests
TABLE_5 = {name: LABELS[name] for name in ("time_domain", "displacement_domain", "fused", "cae")}
"""What Table 5 compares, and our mixture."""
MEAN = "Mean"
TTZV_COLUMN = "0–TTZV"  # the column of ratings up to each test's time of zero velocity

_FURTHER = {
    "sg_magnitude": "Sprague–Geers magnitude",
    "sg_phase": "phase",
    "sg_comprehensive": "comprehensive",
    "anova_mean": "Residuals, mean",
    "anova_deviation": "deviation",
}


def further_table(study: Study, fold: Fold, window_ms: float) -> Table:
    """Measures beside the rating that were asked for, one row an approach; empty if none were."""
    measured = {LABELS[name]: fold.further(name, window_ms, study.config.also) for name in fold.ratings}
    rows = ({"Approach": name, **values} for name, values in measured.items() if values)
    numbers = (Column(title, "number", form=".3f", source=name) for name, title in _FURTHER.items())
    return Table.of("further measures", rows, *numbers)


def rating_table(study: Study, rows: Mapping[str, str]) -> pd.DataFrame:
    """Overall ratings as in the paper's tables, unrounded: :data:`TABLE_3` or :data:`TABLE_5`, as far as in the study.

    Indexed by test and approach, one column a window; means come last.
    """
    windows = study.config.windows_ms
    labels = {name: label for name, label in rows.items() if name in study.config.approaches}
    table = {
        (fold.held_out, label): [fold.ratings[name][window].overall for window in windows]
        for fold in study.folds
        for name, label in labels.items()
    }
    if labels and len(study.folds) > 1:
        means = mean_values(study).drop(columns=TTZV_COLUMN, errors="ignore").rename(index=labels)
        table |= {(MEAN, label): means.loc[label].tolist() for label in labels.values()}
    index = pd.MultiIndex.from_tuples(list(table), names=["Test", "Approach"])
    return pd.DataFrame([*table.values()], index=index, columns=[f"(0, {window:g}) ms" for window in windows])


def mean_values(study: Study) -> pd.DataFrame:
    """Overall rating averaged over the held-out tests by approach and window, unrounded."""
    windows = {window: f"0–{window:g} ms" for window in study.config.windows_ms}
    rows = {
        name: {label: study.mean_rating(name, window) for window, label in windows.items()}
        for name in study.config.approaches
    }
    for name, by_window in rows.items() if study.config.to_ttzv else ():
        by_window[TTZV_COLUMN] = float(np.mean([fold.overall_to_ttzv(name) for fold in study.folds]))
    return pd.DataFrame.from_dict(rows, orient="index")


def ratings_shown(ratings: pd.DataFrame, kind: Literal["grade", "number"] = "grade") -> Table:
    """Ratings by approach, or by test and approach: with their grades or as numbers, the best marked."""
    ratings = ratings.rename(index=label_of, level=-1)
    frame, keys = ratings.rename_axis([*ratings.index.names[:-1], "Approach"]).reset_index(), ratings.index.nlevels
    columns = (
        *(Column(name) for name in frame.columns[:keys]),
        *(Column(name, kind, form=".3f", marks=f"{name} best") for name in ratings),
    )
    return Table("ratings", frame.join(best(ratings).reset_index(drop=True).add_suffix(" best")), columns)


def best(table: pd.DataFrame) -> pd.DataFrame:
    """Mask of the best approach of each test and window, to three digits. Same shape, bool."""
    shown = table.round(3)
    by_test = shown.groupby(level=0, sort=False).transform("max") if table.index.nlevels > 1 else shown.max()
    return shown == by_test
