"""Arguments of the command line."""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from crashfuse.cli import certification, data, imports, models, outgoing, ratings, studies
from crashfuse.cli.conditions import AXES, add_axes, number, whole
from crashfuse.version import __version__
from crashfuse.wording import SYSTEMS

T = TypeVar("T")
_SEVERAL = "; several separated by commas"


def parser() -> argparse.ArgumentParser:
    """The argparse parser of the command line."""
    root = argparse.ArgumentParser(
        prog="crashfuse",
        description="Fuse CAE crash pulses with physical full-frontal barrier tests; predict and rate pulses.",
    )
    root.add_argument("--version", action="version", version=f"crashfuse {__version__}")
    commands = root.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(
        name: str, run: Callable[[argparse.Namespace], None], about: str, campaign: str | None = "campaign"
    ) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=about)
        added.set_defaults(run=run)
        if campaign:
            added.add_argument(campaign, type=Path, metavar="CAMPAIGN")
        return added

    app = command("app", data.app, "start the dashboard on 127.0.0.1", None)
    app.add_argument("--port", type=whole(1, 65535), default=8501, help="port to listen on (default: %(default)s)")
    app.add_argument("--campaign", type=Path, metavar="DIR", help="campaign folder to open at the start")
    help_ = "the pages open and write to what is in it only; one option a folder"
    app.add_argument("--root", type=Path, action="append", default=[], metavar="DIR", help=help_)
    app.add_argument("--log", type=Path, metavar="FILE", help="append the log to it (default: standard error)")
    app.add_argument("--allow-host", action="append", default=[], metavar="NAME", help="its name at a reverse proxy")
    app.add_argument("--login", type=Path, metavar="FILE.toml", help="require the log-in of [auth] in FILE")

    sample = command("sample", data.sample, "write the synthetic sample campaign", None)
    sample.add_argument("folder", type=Path, metavar="DIR", help="a new or empty folder")

    command("check", data.check, "show what a campaign holds and what is wrong with it")
    data.add_edit_options(command("edit", data.edit, "leave tests out of use, take them out, undo the last change"))
    imports.add_options(commands.add_parser("import", help="import files of other formats into a campaign"))

    study = command("study", studies.study, "leave out each test in turn, predict it, rate the prediction", None)
    study.add_argument("campaigns", type=Path, nargs="+", metavar="CAMPAIGN")
    _add_out(study, "folder for the results; of several campaigns, presets or seeds each has a folder in it")
    study.add_argument("--held-out", nargs="+", metavar="ID", help="tests to leave out in turn (default: every test)")
    _add_model_options(study, several=True)
    _add_windows(study)
    help_ = "alone, with all at about its speed, or both (default: both; test with --held-out or --preset paper)"
    study.add_argument("--leave-out", choices=("test", "speed-group", "both"), help=help_)
    _add_report(study)
    _add_workers(study)
    _add_units(study)
    study.add_argument("--resume", action="store_true", help="continue the study in DIR")

    certify = command("certify", certification.certify, "say which criteria a test at each condition would meet")
    _add_out(certify)
    certify.add_argument("--criteria", type=Path, metavar="FILE.toml", help="default: CAMPAIGN/criteria.toml")
    certify.add_argument("--matrix", type=Path, metavar="FILE.csv", help="conditions (default: CAMPAIGN/matrix.csv)")
    price, help_ = ("TEST", "WRONG"), "costs of a test and of a wrong answer, in place of [costs]"
    certify.add_argument("--costs", type=number, nargs=2, metavar=price, help=help_)
    add_axes(certify, AXES, nargs="+", help="of a grid, not a file")
    _add_factor(certify, "of a grid; several values of a name, too")
    certify.add_argument("--approach", metavar="NAME", choices=_Approaches(), help="%(choices)s (default: fused)")
    certify.add_argument("--since", type=Path, metavar="DIR", help="an earlier one: tell what became of its verdicts")
    _add_settings(certify)
    tried = ("seed", "preset", "tests")
    help_ = "make all again with another seed, the other preset, each test left out"
    certify.add_argument("--robustness", nargs="+", choices=tried, default=(), metavar="|".join(tried), help=help_)
    _add_units(certify)
    _add_workers(certify)
    certify.add_argument("--seal", type=Path, metavar="KEY", help="sign it with this private key (crashfuse key)")

    key = command("key", certification.make_key, "make a pair of keys for seals", None)
    key.add_argument("key", type=Path, metavar="KEY", help="file of the private key; the public one is KEY.pub")
    verify = command("verify", certification.verify, "say what of a sealed certification was changed", "folder")
    verify.add_argument("--key", type=Path, metavar="PUB", help="the public key of its maker")
    verify.add_argument("--campaign", type=Path, metavar="CAMPAIGN", help="compare the files that it rests on, too")
    verify.add_argument("--seal", type=Path, metavar="KEY", help="sign as reviewer, if all is as it was sealed")

    curve = command("learning-curve", studies.learning_curve, "predict tests from 1, 2, 3 … of the others")
    _add_out(curve)
    _add_approaches(curve, "cae fused")
    curve.add_argument("--criteria", type=Path, metavar="FILE", help="default: criteria.toml of CAMPAIGN, if any")
    curve.add_argument("--cost-per-test", metavar="AMOUNT", help="cost of one test, such as 60000 or '60000 EUR'")
    curve.add_argument("--repeats", type=whole(0), metavar="N", help="random choices of each number (default: 3)")
    _add_windows(curve)
    _add_units(curve)
    _add_seed(curve)
    _add_device(curve)
    _add_workers(curve)

    predict = command("predict", models.predict, "predict the pulse at a condition that was never tested")
    add_axes(predict, AXES, required=True)
    _add_prediction_options(predict)
    _add_report(predict)
    outgoing.add_options(predict, "isomme")

    train = command("train", models.train, "learn from all tests and CAE runs and save the models")
    _add_out(train, "folder for the models")
    _add_model_options(train)

    sweep = command("sweep", models.sweep, "predict the pulse metrics over impact speed, at fixed weights")
    speed, *weights = AXES
    add_axes(sweep, [speed], nargs=2, metavar=("LOW", "HIGH"), help="default: where there are runs")
    add_axes(sweep, weights, required=True)
    _add_prediction_options(sweep)
    outgoing.add_options(sweep)

    next_test = command("next-test", models.rank_tests, "rank tests to run next by how much each would narrow the band")
    add_axes(next_test, AXES, nargs=2, metavar=("LOW", "HIGH"), help="range (default: the tests')")
    _add_factor(next_test, "the kind of vehicle (default: the usual)")
    next_test.add_argument("--candidates", type=Path, metavar="FILE.csv", help="like tests.csv (default: a grid)")
    _add_out(next_test)
    _add_units(next_test)
    _add_seed(next_test)

    outgoing.add_figure_options(commands.add_parser("figures", help="write a report's figures as files or slides"))
    studies.add_comparison_options(commands.add_parser("compare", help="say which of two studies rates better"))
    listing = commands.add_parser("studies", help="list the studies and predictions of this machine")
    listing.set_defaults(run=studies.past_studies)
    ratings.add_options(commands.add_parser("rate", help="rate pulses against each other by ISO/TS 18571"))
    return root


def _add_out(parser: argparse.ArgumentParser, what: str = "folder for the results") -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help=what)


def _add_windows(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--windows-ms", nargs="+", type=number, metavar="W", help="over 0 to W ms (default: 20 40 60)")


def _add_factor(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--factor", action="extend", nargs="+", metavar="NAME=VALUE", help=what)


def _add_report(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--report", choices=("whole", "short"), default="whole", help="whole, or on three pages")


def _add_units(parser: argparse.ArgumentParser) -> None:
    help_ = "of speeds and weights in the report (default: the campaign's); tables keep theirs"
    parser.add_argument("--units", type=_one_of(*SYSTEMS), metavar="|".join(SYSTEMS), help=help_)


def _add_prediction_options(parser: argparse.ArgumentParser) -> None:
    _add_factor(parser, "of the tests' table (powertrain=V6, say)")
    _add_out(parser)
    _add_units(parser)
    parser.add_argument("--models", type=Path, metavar="DIR", help="predict with the models that train saved there")
    _add_model_options(parser)


def _add_model_options(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    _add_approaches(parser, "all")
    _add_settings(parser, several=several)


def _add_approaches(parser: argparse.ArgumentParser, usual: str) -> None:
    help_ = f"%(choices)s (default: {usual})"
    parser.add_argument("--approach", nargs="+", metavar="NAME", choices=_Approaches(), help=help_)


def _add_settings(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    preset, more = _one_of("fast", "paper"), _SEVERAL if several else ""
    kind, help_ = _listed(preset) if several else preset, f"settings: ours (default) or the paper's{more}"
    parser.add_argument("--preset", type=kind, metavar="fast|paper", help=help_)
    _add_seed(parser, several=several)
    _add_device(parser)


def _add_seed(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    seed, more = whole(0, 2**32 - 1), _SEVERAL if several else ""
    parser.add_argument("--seed", type=_listed(seed) if several else seed, help=f"of all random (default: 0){more}")


def _add_device(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), help="of networks (default: auto, CUDA if any)")


def _add_workers(parser: argparse.ArgumentParser) -> None:
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=whole(1), metavar="N", help="processes (default: one for each core)")
    where.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="Dask cluster, which you trust, to compute on")


class _Approaches:
    """Names of all approaches, looked up only when the help is shown: that imports SciPy."""

    def __iter__(self) -> Iterator[str]:
        from crashfuse.approaches.registry import APPROACHES

        return iter(APPROACHES)

    def __contains__(self, name: object) -> bool:
        return True  # the library itself rejects an unknown name, in one sentence


def _listed(parse: Callable[[str], T]) -> Callable[[str], list[T]]:
    """Parser of comma-separated values; a space-separated list would swallow the campaign that follows it."""

    def values(text: str) -> list[T]:
        return [parse(part) for part in text.split(",")]

    return values


def _one_of(*choices: str) -> Callable[[str], str]:

    def choice(text: str) -> str:
        if text not in choices:
            raise argparse.ArgumentTypeError(f"must be {' or '.join(choices)}, not {text!r}")
        return text

    return choice
