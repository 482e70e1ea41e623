"""Arguments of the command line; the modules of the commands are imported when they run."""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from crashfuse.cli.conditions import ACCELERATION_UNITS, AXES, add_axes, in_si, number, number_or, whole
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.vocabulary import TRAVELS
from crashfuse.units import LB, MS, SYSTEMS
from crashfuse.version import __version__

T = TypeVar("T")
_SEVERAL = "; several separated by commas"
_UNIT_SYSTEMS = ("mm-ms-kg", "mm-s-t", "m-s-kg")  # of solvers
CONDITION = {
    "speed_mps": "impact speed",
    "mass_kg": "weight of the whole vehicle",
    "front_weight_kg": "weight on the front axle",
    "rear_weight_kg": "weight on the rear axle",
}
"""What of an imported record's condition can be given, by the name of what it is in SI."""


def parser() -> argparse.ArgumentParser:
    """The argparse parser of the command line."""
    root = argparse.ArgumentParser(
        prog="crashfuse",
        description="Fuse CAE crash pulses with physical full-frontal barrier tests; predict and rate pulses.",
    )
    root.set_defaults(archive=None)
    root.add_argument("--version", action="version", version=f"crashfuse {__version__}")
    commands = root.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, run: str, about: str, campaign: str | None = "campaign") -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=about)
        added.set_defaults(run=run)
        if campaign:
            added.add_argument(campaign, type=Path, metavar="CAMPAIGN")
        return added

    app = command("app", "data.app", "start the dashboard on 127.0.0.1", None)
    app.add_argument("--port", type=whole(1, 65535), default=8501, help="default: %(default)s")
    app.add_argument("--campaign", type=Path, metavar="DIR", help="campaign to open")
    help_ = "pages open and write to what is in it only; one option a folder"
    app.add_argument("--root", type=Path, action="append", default=[], metavar="DIR", help=help_)
    app.add_argument("--log", type=Path, metavar="FILE", help="append the log to it (default: standard error)")
    app.add_argument("--allow-host", action="append", default=[], metavar="NAME", help="its name at a reverse proxy")
    app.add_argument("--login", type=Path, metavar="FILE.toml", help="require the log-in of [auth] in FILE")

    sample = command("sample", "data.sample", "write the synthetic sample campaign", None)
    sample.add_argument("folder", type=Path, metavar="DIR", help="a new or empty folder")

    command("check", "data.check", "show what a campaign holds, and what is wrong")
    _add_edit_options(command("edit", "data.edit", "leave tests out of use, take them out, undo the last change"))
    _add_import_options(command("import", "data.import_", "import files of other formats into a campaign", None))

    study = command("study", "studies.study", "leave out each test in turn, predict it, rate the prediction", None)
    study.add_argument("campaigns", type=Path, nargs="+", metavar="CAMPAIGN")
    _add_out(study, "folder for the results; of several studies each has a folder in it")
    study.add_argument("--held-out", nargs="+", metavar="ID", help="tests to leave out in turn (default: every test)")
    _add_model_options(study, several=True)
    _add_windows(study, number_or("ttzv"), "; ttzv: to each test's zero velocity, too")
    _add_also(study)
    help_ = "default: both; with --held-out or --preset paper: test"
    study.add_argument("--leave-out", choices=("test", "speed-group", "both"), help=help_)
    _add_report(study)
    _add_workers(study)
    _add_units(study)
    study.add_argument("--resume", action="store_true", help="continue the study in DIR")

    certify = command("certify", "certification.certify", "say which criteria a test at each condition would meet")
    _add_out(certify)
    certify.add_argument("--criteria", type=Path, metavar="FILE.toml", help="default: CAMPAIGN/criteria.toml")
    certify.add_argument("--matrix", type=Path, metavar="FILE.csv", help="conditions (default: CAMPAIGN/matrix.csv)")
    price, help_ = ("TEST", "WRONG"), "costs, in place of [costs]"
    certify.add_argument("--costs", type=number, nargs=2, metavar=price, help=help_)
    add_axes(certify, AXES, nargs="+", help="of a grid, not a file")
    _add_factor(certify, "of a grid; several values of a name, too")
    certify.add_argument("--approach", metavar="NAME", choices=_Approaches(), help="%(choices)s (default: fused)")
    certify.add_argument("--since", type=Path, metavar="DIR", help="an earlier one, held against tests run since")
    _add_settings(certify)
    certify.add_argument("--seed", type=_no_seed, help=argparse.SUPPRESS)
    certify.add_argument("--robustness", action="store_true", help="judge without each test, too")
    _add_units(certify)
    _add_workers(certify)
    certify.add_argument("--seal", type=Path, metavar="KEY", help="sign it with this private key (crashfuse key)")

    key = command("key", "certification.make_key", "make a pair of keys for seals", None)
    key.add_argument("key", type=Path, metavar="KEY", help="private key; the public one is KEY.pub")
    verify = command("verify", "certification.verify", "say what of a sealed certification was changed", "folder")
    verify.add_argument("--key", type=Path, metavar="PUB", help="the public key of its maker")
    verify.add_argument("--campaign", type=Path, metavar="CAMPAIGN", help="compare its files, too")
    verify.add_argument("--seal", type=Path, metavar="KEY", help="sign as reviewer")
    verify.add_argument("--recompute", type=Path, metavar="CAMPAIGN", help="compute it again, and compare")
    _add_archive(verify)
    _add_workers(verify)

    curve = command("learning-curve", "studies.learning_curve", "predict tests from 1, 2, 3 … of the others")
    _add_out(curve)
    _add_approaches(curve, "cae fused")
    curve.add_argument("--criteria", type=Path, metavar="FILE", help="default: criteria.toml of CAMPAIGN, if any")
    curve.add_argument("--cost-per-test", metavar="AMOUNT", help="cost of one test, such as 60000 or '60000 EUR'")
    curve.add_argument("--repeats", type=whole(0), metavar="N", help="random choices of each number (default: 3)")
    _add_windows(curve)
    _add_units(curve)
    _add_archive(curve)
    _add_seed(curve)
    _add_device(curve)
    _add_workers(curve)

    predict = command("predict", "models.predict", "predict the pulse at a condition that was never tested")
    add_axes(predict, AXES, required=True)
    _add_prediction_options(predict)
    _add_report(predict)
    _add_export_options(predict, "isomme")

    train = command("train", "models.train", "learn from all tests and CAE runs and save the models")
    _add_out(train, "folder for the models")
    _add_model_options(train)

    sweep = command("sweep", "models.sweep", "predict the pulse metrics over impact speed, at fixed weights")
    speed, *weights = AXES
    add_axes(sweep, [speed], nargs=2, metavar=("LOW", "HIGH"), help="default: where there are runs")
    add_axes(sweep, weights, required=True)
    _add_prediction_options(sweep)
    _add_export_options(sweep)

    about = "rank tests to run next by how much each would narrow the band"
    next_test = command("next-test", "models.rank_tests", about)
    add_axes(next_test, AXES, nargs=2, metavar=("LOW", "HIGH"), help="range (default: the tests')")
    _add_factor(next_test, "the kind of vehicle (default: the usual)")
    next_test.add_argument("--candidates", type=Path, metavar="FILE.csv", help="like tests.csv (default: a grid)")
    _add_out(next_test)
    _add_units(next_test)
    _add_seed(next_test)

    figures = command("figures", "output.figures", "write a report's figures as files or slides", None)
    figures.add_argument("report", type=Path, metavar="REPORT.html", help="a report that another command has written")
    _add_out(figures, "folder for the figures")
    formats = ("svg", "png", "csv", "pptx")
    figures.add_argument("--format", nargs="+", choices=formats, default=["svg", "png"], help="default: svg png")

    compare = command("compare", "studies.compare", "say which of two studies rates better", None)
    for name in ("first", "second"):
        compare.add_argument(name, metavar=name.upper(), help="a study's folder, or its id in crashfuse studies")
    instead = compare.add_mutually_exclusive_group()
    instead.add_argument("--csv", action="store_true", help="print every rating as CSV instead")
    instead.add_argument("--report", type=Path, metavar="FILE.html", help="write a report of both instead")

    learn = command("learn-archive", "models.learn_archive", "learn from past vehicles what teaches the next one", None)
    learn.add_argument("campaigns", type=Path, nargs="+", metavar="CAMPAIGN")
    learn.add_argument("--out", type=Path, required=True, metavar="FILE.cfa", help="file of the archive")
    _add_seed(learn)
    learn.add_argument("--workers", type=whole(1), metavar="N", help="processes (default: one for each core)")

    command("studies", "studies.past_studies", "list the studies and predictions of this machine", None)
    _add_rating_options(command("rate", "ratings.rate", "rate pulses against each other by ISO/TS 18571", None))
    return root


def _add_edit_options(parser: argparse.ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--leave-out", nargs="+", metavar="ID", help="tests that nothing learns from or rates")
    parser.add_argument("--because", metavar="WHY", help="why, for the reports")
    what.add_argument("--use", nargs="+", metavar="ID", help="tests to use again")
    what.add_argument("--remove", nargs="+", metavar="ID", help="tests to take out of the folder")
    what.add_argument("--cae-tuned", nargs="+", metavar="ID", help="tests that the CAE model was tuned to")
    what.add_argument("--not-cae-tuned", nargs="+", metavar="ID", help="tests that it was not tuned to")
    what.add_argument("--about", nargs="+", metavar="ID|NAME=VALUE", help="a test's id, then laboratory=…, date=…")
    what.add_argument("--undo", action="store_true", help="undo the last change")


def _add_import_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", type=Path, metavar="SOURCE", help="a file, folder or archive")
    parser.add_argument("--out", type=Path, required=True, metavar="CAMPAIGN", help="campaign folder, made if need be")
    parser.add_argument("--format", choices=FORMATS.declared, help="default: by the files' names")
    parser.add_argument("--as", dest="role", choices=("tests", "cae"), help="default: tests, asked if it is doubtful")
    parser.add_argument("--cae", nargs="+", default=(), metavar="NAME", help="CAE runs among them, by file or id")
    parser.add_argument("--cae-tuned", choices=("yes", "no"), help="was the CAE model tuned to these tests?")
    parser.add_argument("--id", metavar="ID", help="id for a source of one record")
    _add_channel_options(parser)
    parser.add_argument("--column", nargs="+", default=(), metavar="COLUMN=ROLE[:UNIT]", help="such as Zeit=time:ms")
    parser.add_argument("--conditions", type=Path, metavar="TABLE", help="a table with the conditions by id")
    parser.add_argument("--deceleration-sign", choices=("negative", "positive"), help="default: detected")
    parser.add_argument("--travel", choices=TRAVELS, help="direction in the source's axes (default: found)")
    parser.add_argument("--time-zero-ms", type=number, metavar="T", help="first contact, in the source's own time")
    parser.add_argument("--gap-mm", type=in_si(MS), metavar="G", help="to the barrier at the start of CAE runs")
    axes = {**AXES, "mass_kg": {"--mass-lb": LB, "--mass-kg": 1.0}}
    for name, what in CONDITION.items():
        group, metavar = parser.add_mutually_exclusive_group(), "V" if name == "speed_mps" else "W"
        for flag, factor in axes[name].items():
            help_ = f"{what} in {flag.rpartition('-')[2]}"
            group.add_argument(flag, dest=name, type=in_si(factor), metavar=metavar, help=help_)
    parser.add_argument("--front-share", type=number, metavar="S", help="share of the mass, 0 to 1")


def _add_export_options(parser: argparse.ArgumentParser, *default: str) -> None:
    group = parser.add_argument_group("pulses for an occupant model")
    help_ = f"%(choices)s (default: {' '.join(default) or 'none'})"
    formats = ("isomme", "lsdyna", "radioss")
    group.add_argument("--export", nargs="+", choices=formats, metavar="FORMAT", default=default, help=help_)
    group.add_argument("--draws", type=int, metavar="N", help="whole draws, too (default: 0)")
    group.add_argument("--unit-system", choices=_UNIT_SYSTEMS, help="of the solver's model; has no default")
    group.add_argument("--deceleration-sign", choices=("negative", "positive"), help="in curves (default: negative)")
    group.add_argument("--start-ms", type=number, metavar="T", help="of contact in curves (default: 0)")
    group.add_argument("--scale", type=number, metavar="X", help="factor on curves (default: 1)")
    group.add_argument("--curve-id", type=int, metavar="ID", help="of the first curve (default: 1)")
    group.add_argument("--isomme-location", metavar="CODE", help="12 characters of codes (default: 10VEHC000000)")


def _add_rating_options(parser: argparse.ArgumentParser) -> None:
    files = "a table (time_ms, acceleration_g), or what import reads"
    parser.add_argument("reference", type=Path, nargs="?", metavar="REFERENCE", help=files)
    parser.add_argument("comparison", type=Path, nargs="?", metavar="COMPARISON", help="the same")
    parser.add_argument("--pairs", type=Path, metavar="FILE.csv", help="a table with columns reference and comparison")
    parser.add_argument("--each-channel", action="store_true", help="of two ISO-MME tests, by channel code")
    parser.add_argument("--explain", action="store_true", help="what ratings are made of")
    _add_windows(parser)
    _add_also(parser)
    _add_channel_options(parser)
    parser.add_argument("--comparison-channel", nargs="+", default=(), metavar="NAME", help="if named otherwise")
    parser.add_argument("--as-given", action="store_true", help="move, turn and filter nothing")
    printed = parser.add_mutually_exclusive_group()
    printed.add_argument("--json", action="store_true", help="no table, but JSON")
    printed.add_argument("--csv", action="store_true", help="no table, but CSV")


def _add_channel_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--channel", nargs="+", default=(), metavar="NAME", help="to be averaged (default: proposed)")
    parser.add_argument("--unit", choices=("g", *ACCELERATION_UNITS), help="of the acceleration (default: detected)")
    parser.add_argument("--channel-filter-class", type=number_or("none"), metavar="CFC", help="60, 180 or so, or none")


def _add_out(parser: argparse.ArgumentParser, what: str = "folder for the results") -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help=what)


def _add_windows(parser: argparse.ArgumentParser, window: Callable[[str], object] = number, also: str = "") -> None:
    usual = "over 0 to W ms (default: 20 40 60)"
    parser.add_argument("--windows-ms", nargs="+", type=window, metavar="W", help=usual + also)


def _add_also(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--also", nargs="+", default=(), metavar="NAME", help="beside ratings: sprague-geers, anova")


def _add_factor(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--factor", action="extend", nargs="+", metavar="NAME=VALUE", help=what)


def _add_report(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--report", choices=("whole", "short"), default="whole", help="whole, or on three pages")


def _add_units(parser: argparse.ArgumentParser) -> None:
    help_ = "of speeds and weights in the report (default: the campaign's)"
    parser.add_argument("--units", type=_one_of(*SYSTEMS), metavar="|".join(SYSTEMS), help=help_)


def _add_prediction_options(parser: argparse.ArgumentParser) -> None:
    _add_factor(parser, "of the tests' table (powertrain=V6, say)")
    _add_out(parser)
    _add_units(parser)
    parser.add_argument("--models", type=Path, metavar="DIR", help="models that train has saved")
    _add_model_options(parser)


def _add_model_options(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    _add_approaches(parser, "all")
    _add_settings(parser, several=several)
    _add_seed(parser, several=several)


def _add_approaches(parser: argparse.ArgumentParser, usual: str) -> None:
    help_ = f"%(choices)s (default: {usual})"
    parser.add_argument("--approach", nargs="+", metavar="NAME", choices=_Approaches(), help=help_)


def _add_settings(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    preset, more = _one_of("fast", "paper"), _SEVERAL if several else ""
    kind, help_ = _listed(preset) if several else preset, f"settings: ours (default) or the paper's{more}"
    parser.add_argument("--preset", type=kind, metavar="fast|paper", help=help_)
    _add_device(parser)
    _add_archive(parser)


def _add_archive(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--archive", type=Path, metavar="FILE.cfa", help="past vehicles (crashfuse learn-archive)")


def _add_seed(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    seed, more = whole(0, 2**32 - 1), _SEVERAL if several else ""
    parser.add_argument("--seed", type=_listed(seed) if several else seed, help=f"of all random (default: 0){more}")


def _no_seed(_: str) -> None:
    raise argparse.ArgumentTypeError("verdicts rest on fixed seeds, the same for everyone; leave it out")


def _add_device(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), help="of networks (default: auto, CUDA if any)")


def _add_workers(parser: argparse.ArgumentParser) -> None:
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=whole(1), metavar="N", help="processes (default: one for each core)")
    where.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="Dask cluster that you trust")


class _Approaches:
    """Names of all approaches, looked up for the help alone: that imports much."""

    def __iter__(self) -> Iterator[str]:
        from crashfuse.approaches.registry import APPROACHES

        return iter(APPROACHES)

    def __contains__(self, name: object) -> bool:
        return True  # the library itself rejects an unknown name, in one sentence


def _listed(parse: Callable[[str], T]) -> Callable[[str], list[T]]:
    """By commas, as a list by spaces would swallow the campaign that follows it."""
    return lambda text: [parse(part) for part in text.split(",")]


def _one_of(*choices: str) -> Callable[[str], str]:
    def choice(text: str) -> str:
        if text not in choices:
            raise argparse.ArgumentTypeError(f"must be {' or '.join(choices)}, not {text!r}")
        return text

    return choice
