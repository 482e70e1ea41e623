"""The paper's tables of ratings by test, approach and window, with the best in bold (Tables 3 and 5)."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from crashfuse.approaches.registry import LABELS
from crashfuse.signals.rating import graded
from crashfuse.study.study import Study

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
