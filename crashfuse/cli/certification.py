"""The command that judges acceptance criteria at conditions, and its own record."""

import argparse
import hashlib
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from crashfuse.cli.conditions import factor, units_of
from crashfuse.cli.models import settings
from crashfuse.cli.output import display_of, replacing, require_output, say_facts, say_written, writing
from crashfuse.errors import DataError, Problem, UsageError

if TYPE_CHECKING:
    from crashfuse.campaign import Campaign
    from crashfuse.certification.matrix import Matrix


def certify(arguments: argparse.Namespace) -> None:
    """Give a verdict on every criterion at every condition of a matrix."""
    from crashfuse.campaign_folder.load import load_campaign
    from crashfuse.campaign_folder.notes import read_notes
    from crashfuse.certification import file_store
    from crashfuse.certification.certify import APPROACH
    from crashfuse.certification.criteria import read_criteria
    from crashfuse.certification.earlier import FILE, read_earlier
    from crashfuse.reporting import verdicts
    from crashfuse.reporting.certification_facts import sentences
    from crashfuse.reporting.certification_tables import counts_table
    from crashfuse.reporting.training_progress import watching

    require_output(arguments.out, arguments.campaign, "certification")
    arguments.approach = [arguments.approach or APPROACH]
    config = settings(arguments)
    if arguments.since and arguments.out.resolve() in (arguments.since.resolve(), arguments.since.resolve().parent):
        raise UsageError(f"{arguments.out} holds the earlier certification; name another folder for --out.")
    earlier = read_earlier(arguments.since) if arguments.since else None
    campaign, notes = load_campaign(arguments.campaign), read_notes(arguments.campaign)
    criteria = read_criteria(arguments.criteria or arguments.campaign / "criteria.toml")
    if earlier is not None:
        earlier.require_of(campaign)  # or another vehicle's would be told only once all is computed
    matrix = _matrix(arguments, campaign)
    with watching() as watch:
        judged = verdicts.certify(
            campaign, criteria, matrix, approach=config.approaches[0], config=config,
            watch=watch, workers=arguments.workers, scheduler=arguments.scheduler,
        )  # fmt: skip
    display, certification = display_of(arguments, campaign), judged.certification
    if earlier is not None:
        certification = certification.beside(earlier)
    with replacing(arguments.out, "certification"), writing(arguments.out, FILE) as folder:
        replace(judged, certification=certification).write(folder, notes=notes, display=display)
    alone = "" if earlier is not None else file_store.beside_none(campaign)  # before this one is kept
    content = (arguments.out / FILE).read_bytes()
    with suppress(DataError):  # where nothing can be kept, the page does not list it
        file_store.keep_certification(content, campaign)
    before = say_facts(campaign, display)
    print(counts_table(certification, display.units).to_string(index=False))
    told = *sentences(certification, "summary"), *sentences(certification, "changes")
    print(*map(display.words, [own for own in dict.fromkeys(told) if own not in before]), sep="\n")
    if alone:
        print(f"{alone} --since holds one against them.")
    say_written(arguments.out, "certification")
    print(f"SHA-256 of {FILE}: {hashlib.sha256(content).hexdigest()}")


def _matrix(arguments: argparse.Namespace, campaign: "Campaign") -> "Matrix":
    """The conditions: of a grid if one is asked for, else of a file."""
    from crashfuse.certification.matrix import Matrix

    axes = (arguments.speed_mps, arguments.front_weight_kg, arguments.rear_weight_kg)
    if not any((*axes, arguments.factor)):
        path = arguments.matrix or arguments.campaign / "matrix.csv"
        if not path.is_file():
            advice = "list the conditions in it, or give a grid with --speed-mph and both weights"
            raise DataError(Problem(path.name, "this file", "no such file", advice))
        return Matrix.read(path, campaign.factors)
    if arguments.matrix is not None or not all(axes):
        raise UsageError(
            "A grid takes --speed-mph, --front-weight-lb and --rear-weight-lb, all three (or in kph and kg), and no "
            "--matrix."
        )
    factors: dict[str, dict[str, None]] = {}
    for text in arguments.factor or ():
        name, value = factor(text, campaign.factors)
        factors.setdefault(name, {})[value] = None
    return Matrix.grid(*axes, {name: tuple(values) for name, values in factors.items()}, units_of(arguments))
