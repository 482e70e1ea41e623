"""The command that writes the figures of a report as files."""

import argparse
from pathlib import Path

from crashfuse.cli.output import require_writable, writing
from crashfuse.errors import UsageError


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add its arguments to the parser of the command."""
    parser.add_argument("report", type=Path, metavar="REPORT.html", help="a report that another command has written")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the figures")
    parser.add_argument(
        "--format", nargs="+", choices=("svg", "png", "csv", "pptx"), default=["svg", "png"], help="default: svg png"
    )
    parser.set_defaults(run=figures)


def figures(arguments: argparse.Namespace) -> None:
    """Write every figure of a report in each format, its numbers as CSV, and all of them as slides."""
    from crashfuse.reporting.figure_files import figure_files, missing_for, read_figures

    if missing := missing_for(arguments.format):
        raise UsageError(missing)
    require_writable(arguments.out)
    files = figure_files(read_figures(arguments.report), arguments.format)
    with writing(arguments.out, last=next(reversed(files))) as folder:
        for name, content in files.items():
            (folder / name).write_bytes(content)
    print(f"Written to {arguments.out}: {', '.join(files)}")
