"""The command that imports foreign files into a campaign."""

import argparse
from pathlib import Path

from crashfuse.cli.conditions import AXES, filter_class, in_si, number
from crashfuse.readers.formats import BROKEN_FORMATS, FORMATS
from crashfuse.readers.vocabulary import TRAVELS
from crashfuse.units import LB, MS

UNITS = {"mps2": "m/s²", "mmps2": "mm/s²", "mmpms2": "mm/ms²"}
_AXES = {**AXES, "mass_kg": {"--mass-lb": LB, "--mass-kg": 1.0}}
_CONDITION = {
    "speed_mps": "impact speed",
    "mass_kg": "weight of the whole vehicle",
    "front_weight_kg": "weight on the front axle",
    "rear_weight_kg": "weight on the rear axle",
}


def import_(arguments: argparse.Namespace) -> None:
    """Add a source to a campaign, and print how its records were read."""
    from crashfuse.campaign_folder.history import changes
    from crashfuse.importing import Choices, ColumnChoice, import_source
    from crashfuse.readers.record import PartialCondition

    choices = Choices(
        channels=tuple(arguments.channel),
        unit=UNITS.get(arguments.unit, arguments.unit),
        deceleration_sign=arguments.deceleration_sign,
        time_zero_s=None if arguments.time_zero_ms is None else arguments.time_zero_ms * MS,
        gap_m=arguments.gap_mm,
        channel_filter_class=arguments.channel_filter_class,
        condition=PartialCondition(**{name: getattr(arguments, name) for name in _CONDITION}),
        front_share=arguments.front_share,
    )
    added = import_source(
        arguments.source,
        arguments.out,
        choices,
        role=arguments.role,
        cae=arguments.cae,
        fmt=arguments.format,
        record_id=arguments.id,
        columns=[ColumnChoice.parsed(text) for text in arguments.column],
        conditions=arguments.conditions,
        travel=arguments.travel,
        cae_tuned=None if arguments.cae_tuned is None else arguments.cae_tuned == "yes",
    )
    for one in added:
        print(f"{one.id}: {one.condition}")
        for step in one.steps:
            print(f"  {step}")
    print(f"{changes(arguments.out)[0].what}. {arguments.out / 'campaign.toml'} tells how.")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    parser.add_argument("source", type=Path, metavar="SOURCE", help="a file, folder or archive")
    parser.add_argument("--out", type=Path, required=True, metavar="CAMPAIGN", help="campaign folder, made if need be")
    parser.add_argument("--format", choices=(*FORMATS, *BROKEN_FORMATS), help="default: by the files' names")
    parser.add_argument("--as", dest="role", choices=("tests", "cae"), help="default: tests, asked if it is doubtful")
    parser.add_argument(
        "--cae", nargs="+", default=(), metavar="NAME", help="files or ids of records that are CAE runs"
    )
    parser.add_argument("--cae-tuned", choices=("yes", "no"), help="whether the CAE model was tuned to these tests")
    parser.add_argument("--id", metavar="ID", help="id for a source of one record")
    parser.add_argument("--channel", nargs="+", default=(), metavar="NAME", help="to be averaged (default: proposed)")
    parser.add_argument("--column", nargs="+", default=(), metavar="COLUMN=ROLE[:UNIT]", help="such as Zeit=time:ms")
    parser.add_argument("--conditions", type=Path, metavar="TABLE", help="a table with the conditions by id")
    parser.add_argument("--unit", choices=("g", *UNITS), help="of the acceleration (default: detected)")
    parser.add_argument("--deceleration-sign", choices=("negative", "positive"), help="default: detected")
    parser.add_argument("--travel", choices=TRAVELS, help="direction in the source's axes (default: found)")
    parser.add_argument("--time-zero-ms", type=number, metavar="T", help="first contact, in the source's own time")
    parser.add_argument("--gap-mm", type=in_si(MS), metavar="G", help="to the barrier at the start of CAE runs")
    parser.add_argument("--channel-filter-class", type=filter_class, metavar="CFC", help='60, 180 or so, or "none"')
    for name, what in _CONDITION.items():
        group, metavar = parser.add_mutually_exclusive_group(), "V" if name == "speed_mps" else "W"
        for flag, factor in _AXES[name].items():
            told = f"{what} in {flag.rpartition('-')[2]}"
            group.add_argument(flag, dest=name, type=in_si(factor), metavar=metavar, help=told)
    parser.add_argument("--front-share", type=number, metavar="S", help="share of the mass on the front axle, 0 to 1")
    parser.set_defaults(run=import_)
