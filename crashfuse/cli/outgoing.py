"""Pulses that go out to an occupant model, as options ask for them, and the figures of a report as files."""

import argparse

from crashfuse.cli.output import require_writable, writing
from crashfuse.errors import UsageError
from crashfuse.reporting import figure_files
from crashfuse.reporting.outgoing_pulses import PulseExport
from crashfuse.reporting.solver_curves import SOLVERS, UNIT_SYSTEMS, SolverCurve
from crashfuse.units import MS

_OF_CURVES = ("unit_system", "deceleration_sign", "start_ms", "scale", "curve_id")


def pulse_export(arguments: argparse.Namespace) -> PulseExport:
    """What the options ask for."""
    formats = tuple(dict.fromkeys(arguments.export))
    given = {name: value for name in _OF_CURVES if (value := getattr(arguments, name)) is not None}
    curve = None
    if set(formats) & set(SOLVERS):
        if arguments.unit_system is None:
            raise UsageError(f"Name the units of the solver's model: --unit-system {', '.join(UNIT_SYSTEMS)}.")
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


def figures(arguments: argparse.Namespace) -> None:
    """Write every figure of a report in each format, its numbers as CSV, and all of them as slides."""
    if missing := figure_files.missing_for(arguments.format):
        raise UsageError(missing)
    require_writable(arguments.out)
    files = figure_files.figure_files(figure_files.read_figures(arguments.report), arguments.format)
    with writing(arguments.out, last=next(reversed(files))) as folder:
        for name, content in files.items():
            (folder / name).write_bytes(content)
    print(f"Written to {arguments.out}: {', '.join(files)}")
