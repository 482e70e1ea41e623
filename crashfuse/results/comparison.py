"""Past results: the list of them, and two studies beside each other as a result."""

import json
import platform
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from crashfuse.approaches.registry import APPROACHES, LABELS, label_of
from crashfuse.certification.earlier import Earlier
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.files.csv_text import csv_bytes, read_csv_table
from crashfuse.results.plots.ratings import rating_differences
from crashfuse.results.result import Figure, Result
from crashfuse.results.table import Column, Table
from crashfuse.study.history import PastResult, Ratings, StudyComparison, parsed
from crashfuse.units import Sentence, counted, joined
from crashfuse.version import __version__

_LEFT_OUT = {"test": "alone", "speed group": "with all at its speed", "both": "both ways"}


def history_table(results: Iterable[PastResult | Earlier]) -> Table:
    """Results, one row each: what was asked, settings, and the outcome over the longest window."""
    table = Table.of("history", map(_row, results))
    return table if table.empty or table.frame["Note"].any() else table.without("Note")


def described(result: PastResult | Earlier) -> Sentence:
    """A result in a few words, to choose it by."""
    row = _row(result)
    named = (row[name] for name in ("Date (UTC)", "What", "Settings", "Campaign", "Note"))
    return joined([text for text in named if text], " · ")


def comparison_result(compared: StudyComparison, window_ms: float | None = None) -> Result:
    """Which study rates higher, in which tests, by how much; a part a way of leaving out."""
    first, second = compared.first, compared.second
    window = compared.longest_ms if window_ms is None else compared.window(window_ms)
    ways = tuple(_way_result(compared, window, way) for way in compared.ways)
    names = dict.fromkeys([first.campaign, second.campaign])
    return Result(
        kind="comparison",
        title=f"{' and '.join(names)}: two studies compared",
        answer=ways[0].answer,
        cautions=compared.cautions,
        shown=("means",),
        sentences={"basis": (f"Ratings by {first.basis}.",)},
        tables={"means": ways[0].tables["means"], "studies": studies_table(first, second)},
        parts={"ways": ways},
        values={
            "origin": {
                "Command": f"crashfuse compare {first.id} {second.id} --report FILE",
                "Campaign fingerprints (SHA-256)": " ".join(dict.fromkeys([first.fingerprint, second.fingerprint])),
                "Approaches": ", ".join(label_of(name) for name in compared.ratings["approach"].unique()),
                "crashfuse": __version__,
                "Python, platform": f"{platform.python_version()}, {platform.platform()}",
            }
        },
        files={"comparison.csv": lambda: csv_bytes(compared.ratings)},
    )


def _way_result(compared: StudyComparison, window: float, way: str) -> Result:
    means = f"{left_out_in_words(way)}: mean rating over 0–{window:g} ms"
    figure = Figure("Each test", lambda _: rating_differences(compared, window, way), is_answer=True)
    return Result(
        kind="comparison",
        title=means,
        answer=compared.sentences(window, way),
        shown=("means",),
        tables={"means": comparison_means(compared, window, way)},
        figures={"differences": figure},
    )


def left_out_in_words(way: str) -> str:
    """A way of leaving tests out of :attr:`StudyComparison.ways`."""
    first, *second = (_LEFT_OUT[own] for own in way.split(", "))
    return f"Each test left out {first}" + "".join(f" in the first, {own} in the second" for own in second)


_MEANS = (
    Column("Approach", source="label"),
    Column("Tests", "number", form=".0f", source="tests"),
    Column("First", "number", form=".3f", source="first"),
    Column("Second", "number", form=".3f", source="second"),
    Column("Difference", "difference", form=".3f", source="second", further=("first",)),
    Column("Standard error", "number", form=".3f", source="standard_error"),
    Column("Second higher in", "number", form=".0f", source="higher"),
    Column("Second lower in", "number", form=".0f", source="lower"),
)


def comparison_means(compared: StudyComparison, window_ms: float, left_out: str) -> Table:
    """Mean ratings of both studies by approach; of a single test its ratings alone."""
    frame = compared.means(window_ms, left_out)
    table = Table("compared means", frame.assign(label=frame["approach"].map(label_of)), _MEANS)
    alone = ("Tests", "Standard error", "Second higher in", "Second lower in")
    return table.without(*alone) if (frame["tests"] == 1).all() else table


def studies_table(first: PastResult, second: PastResult) -> Table:
    """What two studies are, one row for each property."""
    one, other = map(_row, (first, second))
    rows = ({"Study": name, "First": one[name], "Second": other[name]} for name in one)
    return Table.of("studies", (row for row in rows if row["Study"] != "Note" or first.note or second.note))


def _row(result: PastResult | Earlier) -> dict[str, str]:
    names = ("Date (UTC)", "Campaign", "What", "Note", "Recommended", "Mean rating", "Worst test", "Settings", "Data")
    row = dict.fromkeys(names, "–") | {"Date (UTC)": f"{result.date[:10]} {result.date[11:16]}", "Id": result.id}
    if isinstance(result, Earlier):
        n, given = len(result.matrix.ids), result.settings
        return row | {
            "Campaign": given["campaign"],
            "What": f"certification of {counted(n, 'condition')}",
            "Note": "",
            "Recommended": given.get("approach", "–"),
            "Mean rating": f"{len(result.waived)} of {n} need not be run",
            "Settings": ", ".join(filter(None, [given.get("preset"), given.get("seed") and f"seed {given['seed']}"])),
        }
    config, n = result.config, len(result.config.approaches)
    if result.tests:
        window = max(result.windows_ms)
        row["Mean rating"] = f"{result.mean(result.approach, window):.3f}"
        row["Worst test"] = "{} {:.3f}".format(*result.worst(result.approach, window))
    elif result.expected:
        row["Mean rating"] = f"{result.expected} (80 %)"
    if result.condition is not None:
        what: str = Sentence("at {}", result.condition.brief)
    else:
        tests = f"test {result.tests[0]}" if len(result.tests) == 1 else f"study of {len(result.tests)} tests, each"
        what = f"{tests} {_LEFT_OUT[config.leave_out]}"
    approaches = "" if n == len(APPROACHES) else f", {n} approach{'es' * (n > 1)}"
    return row | {
        "Campaign": result.campaign,
        "What": what,
        "Note": result.note,
        "Recommended": LABELS.get(result.approach, result.approach),
        "Settings": f"{config.preset}, seed {config.seed}{approaches}",
        "Data": result.fingerprint[:8],
    }


def read_study(folder: Path) -> PastResult:
    """What studies are compared by; a UsageError if there is no finished one, a DataError if damaged."""
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
                **{name: values[name] for name in ("campaign", "fingerprint", "config")},
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
    columns = ["held_out", "approach", "window_ms", "overall"]
    ratings: dict[str, dict[str, dict[float, float]]] = {}
    for test, approach, window, overall in read_csv_table(path, columns[2:])[columns].itertuples(index=False):
        ratings.setdefault(test, {}).setdefault(approach, {})[window] = overall
    return ratings
