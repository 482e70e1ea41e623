"""A study as ``crashfuse study`` wrote it into a folder, read back as a record of its ratings."""

import json
from datetime import UTC, datetime
from pathlib import Path

from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.files.csv_output import read_csv_table
from crashfuse.study.history import PastResult, Ratings, parsed

_COLUMNS = ["held_out", "approach", "window_ms", "overall"]


def read_study(folder: Path) -> PastResult:
    """Read what two studies are compared by from ``study.json``, ``scores.csv`` and ``speed_groups.csv``.

    Raises
    ------
    UsageError
        If the folder holds no finished study.
    DataError
        If one of the files is damaged.
    """
    path = folder / "study.json"
    if not path.is_file():
        raise UsageError(f"There is no study in {folder}: it has no study.json.")
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        if not values["finished"]:
            raise UsageError(f"The study in {folder} is not finished; continue it with --resume.")
        groups = folder / "speed_groups.csv"
        return parsed(
            {
                "campaign": values["campaign"],
                "fingerprint": values["fingerprint"],
                "config": values["config"],
                "basis": values["rating"],
                "approach": values["recommendation"]["campaign"]["approach"],
                "date": datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds"),
                "ratings": _ratings(folder / "scores.csv"),
                "speed_groups": _ratings(groups) if groups.is_file() else {},
                "condition": None,
                "expected": None,
            }
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DataError(Problem(str(folder), "the files of a finished study", f"{error!r}", "run it again")) from error


def _ratings(path: Path) -> Ratings:
    table = read_csv_table(path, ("window_ms", "overall"))
    ratings: dict[str, dict[str, dict[float, float]]] = {}
    for test, approach, window, overall in table[_COLUMNS].itertuples(index=False):
        ratings.setdefault(test, {}).setdefault(approach, {})[window] = overall
    return ratings
