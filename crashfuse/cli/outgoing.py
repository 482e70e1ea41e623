"""Options of the pulses that go out to an occupant model, and what they ask for."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from crashfuse.cli.conditions import number
from crashfuse.cli.output import require_writable, writing
from crashfuse.errors import UsageError

if TYPE_CHECKING:
    from crashfuse.reporting.outgoing_pulses import PulseExport


_FORMATS = ("isomme", "lsdyna", "radioss")
_UNIT_SYSTEMS = ("mm-ms-kg", "mm-s-t", "m-s-kg")
_OF_CURVES = ("unit_system", "deceleration_sign", "start_ms", "scale", "curve_id")


def add_options(parser: argparse.ArgumentParser, *default: str) -> None:
    """Add the options to a command; without them it exports the default formats."""
    group = parser.add_argument_group("pulses for an occupant model")
    help_ = f"%(choices)s (default: {' '.join(default) or 'none'})"
    group.add_argument("--export", nargs="+", choices=_FORMATS, metavar="FORMAT", default=default, help=help_)
    group.add_argument("--draws", type=int, metavar="N", help="whole draws, beside the expected pulse (default: 0)")
    group.add_argument("--unit-system", choices=_UNIT_SYSTEMS, help="of the solver's model; has no default")
    group.add_argument("--deceleration-sign", choices=("negative", "positive"), help="in curves (default: negative)")
    group.add_argument("--start-ms", type=number, metavar="T", help="time of contact in curves (default: 0)")
    group.add_argument("--scale", type=number, metavar="X", help="factor on the accelerations of curves (default: 1)")
    group.add_argument("--curve-id", type=int, metavar="ID", help="id of the first curve; others count on (default: 1)")
    group.add_argument("--isomme-location", metavar="CODE", help="12 characters of codes (default: 10VEHC000000)")


def pulse_export(arguments: argparse.Namespace) -> "PulseExport":
    """What the options ask for."""
    from crashfuse.reporting.outgoing_pulses import PulseExport
    from crashfuse.reporting.solver_curves import SOLVERS, SolverCurve
    from crashfuse.units import MS

    formats = tuple(dict.fromkeys(arguments.export))
    given = {name: value for name in _OF_CURVES if (value := getattr(arguments, name)) is not None}
    curve = None
    if set(formats) & set(SOLVERS):
        if arguments.unit_system is None:
            raise UsageError(f"Name the units of the solver's model: --unit-system {', '.join(_UNIT_SYSTEMS)}.")
        names = {"start_ms": "start_s", "curve_id": "number"}
        if "start_ms" in given:
            given["start_ms"] *= MS
        curve = SolverCurve(**{names.get(name, name): value for name, value in given.items()})
    elif given:
        flag = f"--{next(iter(given)).replace('_', '-')}"
        raise UsageError(f"{flag} is about curves of a solver; add --export lsdyna or --export radioss.")
    if arguments.isomme_location is not None and "isomme" not in formats:
        raise UsageError("--isomme-location is about ISO-MME; add --export isomme.")
    if arguments.draws and not formats:
        raise UsageError("--draws is about exported pulses; name their format with --export.")
    more = {"draws": arguments.draws, "location": arguments.isomme_location, "seed": arguments.seed}
    return PulseExport(formats, curve=curve, **{name: value for name, value in more.items() if value is not None})


def add_figure_options(parser: argparse.ArgumentParser) -> None:
    """Add its arguments to the parser of the command."""
    parser.add_argument("report", type=Path, metavar="REPORT.html", help="a report that another command has written")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the figures")
    formats = ("svg", "png", "csv", "pptx")
    parser.add_argument("--format", nargs="+", choices=formats, default=["svg", "png"], help="default: svg png")
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
