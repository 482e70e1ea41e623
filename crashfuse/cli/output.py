"""Output of a command: its folder, which holds results of one kind, is checked before anything is computed.

Once new ones are written, what is left of older ones (speed groups, say) is removed.
"""

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import has_table
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.errors import CrashfuseError, UsageError
from crashfuse.execution.cache import resume
from crashfuse.files.atomic import sole_writer, written_together
from crashfuse.results.display import Display
from crashfuse.results.export.outgoing_pulses import PulseExport
from crashfuse.results.export.solver_curves import SOLVERS, UNIT_SYSTEMS, SolverCurve
from crashfuse.results.files import RESULT_FILES
from crashfuse.results.render import figure_files
from crashfuse.results.render.text import lines
from crashfuse.results.result import Result
from crashfuse.units import MS, SYSTEMS

_OF_CURVES = ("unit_system", "deceleration_sign", "start_ms", "scale", "curve_id")


def require_output(out: Path, campaign: Path, kind: str | None = None) -> None:
    """Refuse a folder in a campaign, with other results, or not writable."""
    if out.resolve().is_relative_to(campaign.resolve()) or has_table(out):
        raise UsageError(f"{out} is in a campaign folder, where no results belong; name another for --out.")
    for other, (*_, mark) in RESULT_FILES.items():
        if kind not in (None, other) and (out / mark).exists():
            raise UsageError(f"{out} holds a {other} ({mark}); name another folder for the {kind}.")
    require_writable(out)


def claim(arguments: argparse.Namespace, out: Path) -> None:
    """Keep a folder to this command until it ends; a DataError if another writes to it."""
    with suppress(OSError):  # where files can't be locked, two that write whole files are better than a refusal
        arguments.claims.enter_context(sole_writer(out.resolve()))


def opened(arguments: argparse.Namespace, kind: str) -> tuple[Campaign, Display]:
    """The campaign of a command, whose folder for this kind of result it claims, and how it is shown."""
    require_output(arguments.out, arguments.campaign, kind)
    claim(arguments, arguments.out)
    campaign = load_campaign(arguments.campaign, arguments.archive)
    return campaign, display_of(arguments, campaign)


def require_writable(out: Path, option: str = "--out") -> None:
    """Refuse what is no folder, or not writable, by the option that names it."""
    there = next(path for path in (out.resolve(), *out.resolve().parents) if path.exists())
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        what = "Nothing can be written to" if there.is_dir() else "Not a folder, but a file, is"
        raise UsageError(f"{what} {there}; name another folder for {option}.")


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Context that says what prevents writing."""
    try:
        yield
    except OSError as error:
        cause, advice = error.strerror or error, resume("the same command continues there")
        raise CrashfuseError(f"Nothing was written to {folder}: {cause}. {advice}.") from error


def say_written(out: Path, kind: str) -> None:
    """Print which files a folder has of this kind."""
    print(f"Written to {out}: {', '.join(name for name in RESULT_FILES[kind] if (out / name).exists())}")


def display_of(arguments: argparse.Namespace, campaign: Campaign) -> Display:
    """How results are shown: in the units asked for, else the campaign's."""
    return Display(system=campaign.units if arguments.units is None else SYSTEMS[arguments.units])


def say(result: Result, display: Display, out: Path) -> None:
    """Print what a result answers, and which files it wrote."""
    print(*lines(result, display), sep="\n")
    say_written(out, result.kind)


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
    """Write the figures of a report in each format."""
    if missing := figure_files.missing_for(arguments.format):
        raise UsageError(missing)
    require_writable(arguments.out)
    files = figure_files.figure_files(figure_files.read_figures(arguments.report), arguments.format)
    with writing(arguments.out), written_together(arguments.out, last=next(reversed(files))) as folder:
        for name, content in files.items():
            (folder / name).write_bytes(content)
    print(f"Written to {arguments.out}: {', '.join(files)}")
