"""The commands that list what was computed on this machine, and that compare two studies."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from crashfuse.cli.output import require_writable
from crashfuse.errors import UsageError

if TYPE_CHECKING:
    from crashfuse.study.comparison import StudyComparison
    from crashfuse.study.history import PastResult

_SHOWN = ["Date (UTC)", "Campaign", "What", "Note", "Settings", "Recommended", "Mean rating", "Worst test"]


def studies(arguments: argparse.Namespace) -> None:  # noqa: ARG001 - it has none
    """List studies and predictions of this machine, the latest first."""
    from crashfuse.reporting.past_results import history_table
    from crashfuse.study.history import past_results

    results = past_results()
    if not results:
        print("Nothing was computed on this machine yet.")
        return
    table = history_table(results)
    table = table[[name for name in _SHOWN if name in table]]
    table.insert(0, "Id", [result.id for result in results])
    print(table.to_string(index=False))


def compare(arguments: argparse.Namespace) -> None:
    """Say which of two studies rates better, and by how much."""
    from crashfuse.files.csv_text import csv_bytes
    from crashfuse.reporting.past_results import comparison_means
    from crashfuse.study.comparison import StudyComparison

    compared = StudyComparison(_study(arguments.first), _study(arguments.second))
    if arguments.report is not None:
        _write_report(compared, arguments.report)
        return
    if arguments.csv:
        print(csv_bytes(compared.ratings).decode(), end="")
        return
    for way in compared.ways:
        print(f"Over 0–{compared.longest_ms:g} ms, left out: {way}")
        print(comparison_means(compared, compared.longest_ms, way).to_string(index=False))
        print(*compared.sentences(left_out=way), sep="\n")
    for caution in compared.cautions:
        print(caution)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the comparison to its parser."""
    for name in ("first", "second"):
        parser.add_argument(
            name, metavar=name.upper(), help="a folder written by crashfuse study, or an id from crashfuse studies"
        )
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument("--csv", action="store_true", help="print every rating as CSV instead")
    instead.add_argument("--report", type=Path, metavar="FILE.html", help="write a report of both instead")
    parser.set_defaults(run=compare)


def _write_report(compared: "StudyComparison", path: Path) -> None:
    from crashfuse.files.atomic import write_atomically
    from crashfuse.reporting.report import comparison_report

    if path.is_dir():
        raise UsageError(f"{path} is a folder; name a file for --report.")
    require_writable(path.parent, "--report")
    write_atomically(path, comparison_report(compared).encode())
    print(f"Written to {path}")


def _study(name: str) -> "PastResult":
    from crashfuse.reporting.past_results import read_study
    from crashfuse.study.history import past_results

    if Path(name).is_dir():
        return read_study(Path(name))
    found = next((result for result in past_results() if result.id == name and result.tests), None)
    if found is None:
        raise UsageError(f"{name} is neither a folder with a study nor the id of one: crashfuse studies lists them.")
    return found
