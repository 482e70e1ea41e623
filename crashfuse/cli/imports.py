"""The command that imports foreign files into a campaign."""

import argparse
from pathlib import Path

from crashfuse.cli.numbers import filter_class, number
from crashfuse.readers.axes import TRAVELS
from crashfuse.readers.formats import BROKEN_FORMATS, FORMATS

UNITS = {"mps2": "m/s²", "mmps2": "mm/s²", "mmpms2": "mm/ms²"}
_WEIGHTS = {"mass": "of the whole vehicle", "front-weight": "on the front axle", "rear-weight": "on the rear axle"}


def import_(arguments: argparse.Namespace) -> None:
    """Add a source to a campaign, and print how its records were read."""
    from crashfuse.campaign_folder.history import changes
    from crashfuse.importing import Choices, ColumnChoice, import_source
    from crashfuse.readers.record import PartialCondition
    from crashfuse.units import KPH, LB, MPH, MS

    condition = PartialCondition(
        speed_mps=_in_si(arguments, "speed", {"mph": MPH, "kph": KPH}),
        mass_kg=_in_si(arguments, "mass", {"lb": LB, "kg": 1.0}),
        front_weight_kg=_in_si(arguments, "front_weight", {"lb": LB, "kg": 1.0}),
        rear_weight_kg=_in_si(arguments, "rear_weight", {"lb": LB, "kg": 1.0}),
    )
    choices = Choices(
        channels=tuple(arguments.channel),
        unit=UNITS.get(arguments.unit, arguments.unit),
        deceleration_sign=arguments.deceleration_sign,
        time_zero_s=None if arguments.time_zero_ms is None else arguments.time_zero_ms * MS,
        channel_filter_class=arguments.channel_filter_class,
        condition=condition,
        front_share=arguments.front_share,
    )
    added = import_source(
        arguments.source,
        arguments.out,
        choices,
        role=arguments.role,
        fmt=arguments.format,
        record_id=arguments.id,
        columns=[ColumnChoice.parsed(text) for text in arguments.column],
        conditions=arguments.conditions,
        travel=arguments.travel,
    )
    for one in added:
        print(f"{one.id}: {one.condition}")
        for step in one.steps:
            print(f"  {step}")
    print(f"{changes(arguments.out)[0].what}. {arguments.out / 'campaign.toml'} tells how.")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    parser.add_argument("source", type=Path, metavar="SOURCE", help="a file, folder or archive, of one record or many")
    parser.add_argument("--out", type=Path, required=True, metavar="CAMPAIGN", help="campaign folder, made if need be")
    parser.add_argument("--format", choices=(*FORMATS, *BROKEN_FORMATS), help="default: by the files' names")
    parser.add_argument("--as", dest="role", choices=("tests", "cae"), default="tests", help="default: %(default)s")
    parser.add_argument("--id", metavar="ID", help="id for a source of one record")
    parser.add_argument(
        "--channel", nargs="+", default=(), metavar="NAME", help="channels to average (default: proposed)"
    )
    parser.add_argument(
        "--column", nargs="+", default=(), metavar="COLUMN=ROLE[:UNIT]", help="what a table's columns are: Zeit=time:ms"
    )
    parser.add_argument("--conditions", type=Path, metavar="TABLE", help="a table with the conditions by id")
    parser.add_argument("--unit", choices=("g", *UNITS), help="of the acceleration (default: detected)")
    parser.add_argument(
        "--deceleration-sign", choices=("negative", "positive"), help="in the source (default: detected)"
    )
    parser.add_argument("--travel", choices=TRAVELS, help="direction of travel in the source's axes (default: found)")
    parser.add_argument("--time-zero-ms", type=number, metavar="T", help="first contact, in the source's own time")
    parser.add_argument("--channel-filter-class", type=filter_class, metavar="CFC", help='60, 180 or so, or "none"')
    speed = parser.add_mutually_exclusive_group()
    for unit in ("mph", "kph"):
        speed.add_argument(f"--speed-{unit}", type=number, metavar="V", help=f"impact speed in {unit}")
    for name, what in _WEIGHTS.items():
        group = parser.add_mutually_exclusive_group()
        for unit in ("lb", "kg"):
            group.add_argument(f"--{name}-{unit}", type=number, metavar="W", help=f"weight {what} in {unit}")
    parser.add_argument("--front-share", type=number, metavar="S", help="share of the mass on the front axle, 0 to 1")
    parser.set_defaults(run=import_)


def _in_si(arguments: argparse.Namespace, name: str, units: dict[str, float]) -> float | None:
    for unit, factor in units.items():
        value: float | None = getattr(arguments, f"{name}_{unit}")
        if value is not None:
            return value * factor
    return None
