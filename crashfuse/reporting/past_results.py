"""Tables and sentences on past results: the list of them, and two studies beside each other."""

import json
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.files.csv_text import read_csv_table
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.study.comparison import StudyComparison
from crashfuse.study.history import PastResult, Ratings, parsed
from crashfuse.wording import difference

_LEFT_OUT = {"test": "alone", "speed group": "with all at its speed", "both": "both ways"}


def history_table(results: Iterable[PastResult], display: Display = DEFAULT) -> pd.DataFrame:
    """One row per result: what was asked, with which settings, and how it rated over the longest window.

    Notes have a column if there are any.
    """
    table = pd.DataFrame([_row(result, display) for result in results])
    return table if table.empty or table["Note"].any() else table.drop(columns="Note")


def described(result: PastResult, display: Display = DEFAULT) -> str:
    """A result in a few words, to choose it by: date, what, settings, campaign."""
    note = f" · {result.note}" if result.note else ""
    return f"{_date(result)} · {_what(result, display)} · {_settings(result)} · {result.campaign}{note}"


def left_out_in_words(way: str) -> str:
    """A way of leaving tests out, as :class:`StudyComparison` has it: that of both, or of the first and the second."""
    words = [_LEFT_OUT[own] for own in way.split(", ")]
    return f"Each test left out {words[0] if len(words) == 1 else '{} in the first, {} in the second'.format(*words)}"


def comparison_table(compared: StudyComparison, approach: str, window_ms: float, left_out: str) -> pd.DataFrame:
    """Ratings of each test by one approach, as a table for readers: first, second, their difference; then the mean."""
    table = compared.over(window_ms, left_out)
    own = table[table["approach"] == approach]
    rows = own[["held_out", "first", "second"]].values.tolist()
    rows.append(["Mean", *own[["first", "second"]].mean()])
    return pd.DataFrame(
        {"Test": test, "First": f"{first:.3f}", "Second": f"{second:.3f}", "Difference": _gain(first, second)}
        for test, first, second in rows
    )


def comparison_means(compared: StudyComparison, window_ms: float, left_out: str) -> pd.DataFrame:
    """Mean ratings of both studies by approach, as a table for readers; of a single test its ratings alone."""
    table = pd.DataFrame(
        {
            "Approach": LABELS.get(row["approach"], row["approach"]),
            "Tests": f"{row['tests']}",
            "First": f"{row['first']:.3f}",
            "Second": f"{row['second']:.3f}",
            "Difference": _gain(row["first"], row["second"]),
            "Standard error": "–" if row["tests"] < 2 else f"{row['standard_error']:.3f}",
            "Second higher in": f"{row['higher']}",
            "Second lower in": f"{row['lower']}",
        }
        for row in compared.means(window_ms, left_out).to_dict("records")
    )
    return table[["Approach", "First", "Second", "Difference"]] if set(table["Tests"]) == {"1"} else table


def comparison_tests(compared: StudyComparison, window_ms: float, left_out: str) -> pd.DataFrame:
    """Every test by every approach, as a table for readers: its rating in the second study, and the difference."""
    table = compared.over(window_ms, left_out)
    cells = pd.DataFrame(
        {
            "Test": table["held_out"],
            "approach": [LABELS.get(name, name) for name in table["approach"]],
            "cell": [f"{b:.3f} ({_gain(a, b)})" for a, b in zip(table["first"], table["second"], strict=True)],
        }
    )
    wide = cells.pivot_table(index="Test", columns="approach", values="cell", aggfunc="first", sort=False)
    return wide.fillna("–").rename_axis(columns=None).reset_index()


def comparison_by_window(compared: StudyComparison, left_out: str) -> pd.DataFrame:
    """Mean ratings by approach and window, as a table for readers: first, second, and their difference."""
    cells: dict[str, dict[str, str]] = {}
    for window in compared.windows_ms:
        for row in compared.means(window, left_out).to_dict("records"):
            told = f"{row['first']:.3f}  {row['second']:.3f}  {_gain(row['first'], row['second'])}"
            cells.setdefault(LABELS.get(row["approach"], row["approach"]), {})[f"0–{window:g} ms"] = told
    return pd.DataFrame.from_dict(cells, orient="index").fillna("–").rename_axis("Approach").reset_index()


def _gain(first: float, second: float) -> str:
    return difference(second, first, 3)


def studies_table(first: PastResult, second: PastResult, display: Display = DEFAULT) -> pd.DataFrame:
    """What two studies are, one row for each property."""
    rows = history_table([first, second], display).T
    rows.loc["Id"] = [first.id, second.id]
    return rows.set_axis(["First", "Second"], axis=1).rename_axis("Study").reset_index()


def _row(result: PastResult, display: Display) -> dict[str, str]:
    rated = {"Mean rating": "–", "Worst test": "–"}
    if result.tests:
        window = max(result.windows_ms)
        worst, rating = result.worst(result.approach, window)
        rated = {
            "Mean rating": f"{result.mean(result.approach, window):.3f}",
            "Worst test": f"{worst} {rating:.3f}",
        }
    elif result.expected:
        rated["Mean rating"] = f"{result.expected.replace(' to ', '–')} (80 %)"
    return {
        "Date (UTC)": _date(result),
        "Campaign": result.campaign,
        "What": _what(result, display),
        "Note": result.note,
        "Recommended": LABELS.get(result.approach, result.approach),
        **rated,
        "Settings": _settings(result),
        "Data": result.fingerprint[:8],
    }


def _what(result: PastResult, display: Display) -> str:
    if result.condition is not None:
        return f"at {display.briefly(result.condition)}"
    left_out = _LEFT_OUT[result.config.leave_out]
    if len(result.tests) == 1:
        return f"test {result.tests[0]} {left_out}"
    return f"study of {len(result.tests)} tests, each {left_out}"


def _settings(result: PastResult) -> str:
    config = result.config
    n = len(config.approaches)
    some = "" if n == len(APPROACHES) else ", 1 approach" if n == 1 else f", {n} approaches"
    return f"{config.preset}, seed {config.seed}{some}"


def _date(result: PastResult) -> str:
    return result.date[:16].replace("T", " ")


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
