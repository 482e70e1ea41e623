"""The command line: parse, call the library, print. Nothing is computed here."""

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crashfuse.errors import CrashfuseError, DataError, UsageError
from crashfuse.version import __version__

if TYPE_CHECKING:
    import pandas as pd

    from crashfuse.campaign import Campaign
    from crashfuse.config import StudyConfig
    from crashfuse.estimate import Fit

DONE, WRONG_DATA, WRONG_USAGE, INTERRUPTED = 0, 1, 2, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 1 the data are wrong, 2 wrong usage)."""
    arguments = parser().parse_args(argv)
    command: Callable[[argparse.Namespace], None] = arguments.run
    try:
        command(arguments)
    except DataError as error:
        count = len(error.problems)
        _say(*map(str, error.problems), f"{count} problem{'s' if count > 1 else ''} found.")
        return WRONG_DATA
    except UsageError as error:
        _say(f"crashfuse: {error}")
        return WRONG_USAGE
    except (CrashfuseError, OSError) as error:
        _say(f"crashfuse: {error}")
        return WRONG_DATA
    except KeyboardInterrupt:
        _say("Stopped. What was finished is in the cache: the same command goes on from there (a study with --resume).")
        return INTERRUPTED
    return DONE


def _app(arguments: argparse.Namespace) -> None:
    from crashfuse.ui.launch import launch

    if arguments.campaign is not None and not arguments.campaign.is_dir():
        raise UsageError(f"There is no folder {arguments.campaign}.")
    launch(arguments.port, arguments.campaign)


def _sample(arguments: argparse.Namespace) -> None:
    from crashfuse.synthetic import write_sample

    write_sample(arguments.folder)
    print(f"The sample campaign is in {arguments.folder}. It is synthetic: simulated, no real vehicle.")


def _check(arguments: argparse.Namespace) -> None:
    from crashfuse.formats.folder import load_campaign

    campaign = load_campaign(arguments.campaign)
    print(f"{campaign.name}: {len(campaign.tests)} tests, {len(campaign.cae)} CAE runs.")
    if campaign.notice:
        print(campaign.notice)
    for test in campaign.tests:
        pair = campaign.cae.paired_run(test.condition)
        source = "no paired run" if pair is None else f"paired with {campaign.cae.ids[pair]}"
        print(f"  {test.id}: {test.condition}; {source}")
        for note in campaign.cae.extrapolation(test.condition):
            print(f"    {note}")
    for warning in campaign.warnings:
        print(f"Note: {warning}")
    print(f"Fingerprint {campaign.fingerprint}")
    print("Nothing is wrong.")


def _study(arguments: argparse.Namespace) -> None:
    from crashfuse.config import StudyConfig
    from crashfuse.formats.folder import load_campaign
    from crashfuse.progress import Watch
    from crashfuse.progress_bar import ProgressBar
    from crashfuse.results import begin_study, read_record, scores_table, write_study
    from crashfuse.study import check_study, run_study

    campaign = load_campaign(arguments.campaign)
    given: dict[str, Any] = {
        name: value
        for name, value in (
            ("approaches", arguments.approach and tuple(arguments.approach)),
            ("preset", arguments.preset),
            ("seed", arguments.seed),
            ("windows_ms", arguments.windows_ms and tuple(arguments.windows_ms)),
            ("hold_out", "speed group" if arguments.speed_groups else None),
            ("device", arguments.device),
        )
        if value is not None
    }
    config = StudyConfig(**given)
    held_out = arguments.held_out or campaign.test_ids
    if arguments.resume:
        record = read_record(arguments.out)
        differing = [name for name, value in given.items() if getattr(record.config, name) != value]
        if arguments.held_out and tuple(arguments.held_out) != record.held_out:
            differing.append("held_out")
        if record.fingerprint != campaign.fingerprint:
            differing.append("the campaign's data")
        if differing:
            raise UsageError(
                f"The study in {arguments.out} was begun with other settings ({', '.join(differing)}); "
                "resume it with its own, or start another without --resume."
            )
        config, held_out = record.config, record.held_out
    check_study(campaign, config, held_out)
    begin_study(arguments.out, campaign, held_out, config)
    with ProgressBar() as bar:
        study = run_study(campaign, config, held_out=held_out, watch=Watch(bar.show), workers=arguments.workers)
    write_study(study, arguments.out)
    _print_means(scores_table(study))
    if config.hold_out == "speed group":
        print("Each test was left out together with all tests within 2 mph of it.")
    if campaign.notice:
        print(campaign.notice)
    print(f"Written to {arguments.out}: scores.csv, pulses.csv, metrics.csv, study.json, report.html")


def _train(arguments: argparse.Namespace) -> None:
    from crashfuse.estimate import Fit
    from crashfuse.formats.folder import load_campaign
    from crashfuse.models import save_model
    from crashfuse.progress import Watch
    from crashfuse.progress_bar import ProgressBar

    campaign = load_campaign(arguments.campaign)
    config = _config(arguments)
    with ProgressBar() as bar:
        for name in config.approaches:
            fit = Fit.of(campaign, name, config, watch=Watch(bar.show))
            save_model(fit, campaign, _model_path(arguments.out, name))
    print(f"Learned from {len(campaign.tests)} tests and {len(campaign.cae)} CAE runs of {campaign.name}.")
    print(f"Written to {arguments.out}: {', '.join(_model_path(Path(), name).name for name in config.approaches)}")


def _model_path(folder: Path, approach: str) -> Path:
    return folder / f"{approach}.safetensors"


def _fits(arguments: argparse.Namespace, campaign: "Campaign") -> Iterator["Fit"]:
    """The approaches that are asked for, from saved models if there is a folder of them, else trained."""
    from crashfuse.approaches import APPROACHES
    from crashfuse.cache import Cache
    from crashfuse.estimate import Fit
    from crashfuse.models import load_model
    from crashfuse.progress import Watch
    from crashfuse.progress_bar import ProgressBar

    if arguments.models is None:
        config = _config(arguments)
        with ProgressBar() as bar:
            for name in config.approaches:
                yield Fit.of(campaign, name, config, watch=Watch(bar.show))
        return
    if any(value is not None for value in (arguments.preset, arguments.seed, arguments.device)):
        raise UsageError("Saved models have their preset and seed in them; leave out --preset, --seed and --device.")
    saved = tuple(name for name in APPROACHES if _model_path(arguments.models, name).is_file())
    if not saved:
        raise UsageError(f"There is no saved model in {arguments.models}; make some with crashfuse train.")
    for name in dict.fromkeys(arguments.approach or saved):
        yield load_model(_model_path(arguments.models, name), campaign, cache=Cache())


def _predict(arguments: argparse.Namespace) -> None:
    from crashfuse.formats.folder import load_campaign
    from crashfuse.pulse import Condition
    from crashfuse.results import write_prediction
    from crashfuse.units import LB, MPH

    for flag in ("speed_mph", "front_weight_lb", "rear_weight_lb"):
        if not 0 < getattr(arguments, flag) < float("inf"):
            raise UsageError(f"--{flag.replace('_', '-')} must be a number above 0.")
    campaign = load_campaign(arguments.campaign)
    factors = tuple(_factor(text, campaign.factors) for text in arguments.factor or ())
    weights = (arguments.front_weight_lb * LB, arguments.rear_weight_lb * LB)
    condition = Condition(arguments.speed_mph * MPH, *weights, factors)
    fits = list(_fits(arguments, campaign))
    if len({(fit.config.preset, fit.config.seed) for fit in fits}) > 1:
        raise UsageError(f"The models in {arguments.models} were trained with different presets or seeds.")
    estimates, config = [fit.estimate(condition) for fit in fits], fits[0].config
    metrics = write_prediction(campaign, estimates, config, arguments.out)
    print(metrics.drop(columns="held_out").to_string(index=False, na_rep="", float_format="{:.4g}".format))
    for note in dict.fromkeys(note for estimate in estimates for note in estimate.prediction.notes):
        print(note)
    if campaign.notice:
        print(campaign.notice)
    print(f"Written to {arguments.out}: pulses.csv, metrics.csv, report.html, prediction.json")


def _config(arguments: argparse.Namespace) -> "StudyConfig":
    from crashfuse.config import StudyConfig

    given = {name: getattr(arguments, name) for name in ("preset", "seed", "device")}
    if arguments.approach:
        given["approaches"] = tuple(dict.fromkeys(arguments.approach))
    config = StudyConfig(**{name: value for name, value in given.items() if value is not None})
    config.check()
    return config


def _factor(text: str, known: Mapping[str, Sequence[str]]) -> tuple[str, str]:
    name, _, value = text.partition("=")
    if value not in known.get(name, ()):
        choices = "; ".join(f"{name}={value}" for name, values in known.items() for value in values) or "none"
        raise UsageError(f"No test has the factor {text!r}; the tests have: {choices}.")
    return name, value


def _rate(arguments: argparse.Namespace) -> None:
    from crashfuse.formats.pulses import read_pulse
    from crashfuse.rating import rate_windows

    reference, comparison = read_pulse(arguments.reference), read_pulse(arguments.comparison)
    ratings = rate_windows(reference, comparison, arguments.windows_ms or (20.0, 40.0, 60.0))
    if arguments.json:
        print(json.dumps([{"window_ms": window, **asdict(rating)} for window, rating in ratings.items()], indent=2))
        return
    print("ISO/TS 18571   overall  corridor   phase  magnitude   slope  grade")
    for window, r in ratings.items():
        scores = f"{r.overall:>9.3f}{r.corridor:>10.3f}{r.phase:>8.3f}{r.magnitude:>11.3f}{r.slope:>8.3f}"
        print(f"{f'0–{window:g} ms':<13}{scores}  {r.grade}")


def _print_means(scores: "pd.DataFrame") -> None:
    """Print the mean overall rating of each approach over each window."""
    from crashfuse.approaches import LABELS

    means = scores.groupby(["approach", "window_ms"], sort=False)["overall"].mean().unstack(sort=False)
    means.index = [LABELS[name] for name in means.index]
    means.columns = [f"0–{window:g} ms" for window in means.columns]
    print("Mean ISO/TS 18571 rating over the held-out tests")
    print(means.to_string(float_format="{:.3f}".format))


def _say(*lines: str) -> None:
    for line in lines:
        print(line, file=sys.stderr)


def parser() -> argparse.ArgumentParser:
    """The command line as argparse knows it."""
    root = argparse.ArgumentParser(
        prog="crashfuse",
        description="Fuse CAE crash pulses with physical full-frontal barrier tests; predict and rate pulses.",
    )
    root.add_argument("--version", action="version", version=f"crashfuse {__version__}")
    commands = root.add_subparsers(title="commands", required=True, metavar="COMMAND")

    app = commands.add_parser("app", help="start the dashboard on 127.0.0.1")
    app.add_argument("--port", type=_whole(1, 65535), default=8501, help="port to listen on (default: %(default)s)")
    app.add_argument("--campaign", type=Path, metavar="DIR", help="campaign folder to open at the start")
    app.set_defaults(run=_app)

    sample = commands.add_parser("sample", help="write the synthetic sample campaign")
    sample.add_argument("folder", type=Path, metavar="DIR", help="folder to make; it must not hold anything yet")
    sample.set_defaults(run=_sample)

    check = commands.add_parser("check", help="say what a campaign holds and what is wrong with it")
    check.add_argument("campaign", type=Path, metavar="CAMPAIGN")
    check.set_defaults(run=_check)

    study = commands.add_parser("study", help="leave out each test in turn, predict it, rate the prediction")
    study.add_argument("campaign", type=Path, metavar="CAMPAIGN")
    study.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    study.add_argument("--held-out", nargs="+", metavar="ID", help="tests to leave out in turn (default: every test)")
    _add_model_options(study)
    study.add_argument(
        "--windows-ms", nargs="+", type=float, metavar="W", help="rate over 0 to W ms (default: 20 40 60)"
    )
    study.add_argument(
        "--speed-groups", action="store_true", help="leave each test out together with all tests at about its speed"
    )
    study.add_argument("--workers", type=_whole(1), metavar="N", help="processes (default: one a core)")
    study.add_argument("--resume", action="store_true", help="go on with the study that was begun in DIR")
    study.set_defaults(run=_study)

    predict = commands.add_parser("predict", help="predict the pulse at a condition that was never tested")
    predict.add_argument("campaign", type=Path, metavar="CAMPAIGN")
    for name, unit in (("speed", "mph"), ("front-weight", "lb"), ("rear-weight", "lb")):
        predict.add_argument(f"--{name}-{unit}", type=float, required=True, metavar=name[0].upper())
    predict.add_argument("--factor", nargs="+", metavar="NAME=VALUE", help="of the tests' table (powertrain=V6, say)")
    predict.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    predict.add_argument("--models", type=Path, metavar="DIR", help="predict with the models that train saved there")
    _add_model_options(predict)
    predict.set_defaults(run=_predict)

    train = commands.add_parser("train", help="learn from all tests and CAE runs, and save the models")
    train.add_argument("campaign", type=Path, metavar="CAMPAIGN")
    train.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the models")
    _add_model_options(train)
    train.set_defaults(run=_train)

    rate = commands.add_parser("rate", help="rate one pulse against another by ISO/TS 18571")
    rate.add_argument("reference", type=Path, metavar="REFERENCE.csv", help="time_ms or _s, acceleration_g or _mps2")
    rate.add_argument("comparison", type=Path, metavar="COMPARISON.csv")
    rate.add_argument("--windows-ms", nargs="+", type=float, metavar="W", help="over 0 to W ms (default: 20 40 60)")
    rate.add_argument("--json", action="store_true", help="print JSON instead of a table")
    rate.set_defaults(run=_rate)
    return root


def _add_model_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--approach",
        nargs="+",
        metavar="NAME",
        help="cae, lf_tcn, time_domain, displacement_domain, fused (default: all)",
    )
    parser.add_argument("--preset", choices=("fast", "paper"), help="settings: ours (default) or the paper's")
    parser.add_argument("--seed", type=_whole(0, 2**32 - 1), help="seed of everything random (default: 0)")
    parser.add_argument(
        "--device", choices=("auto", "cpu", "cuda"), help="where networks are trained (default: auto, CUDA if any)"
    )


def _whole(low: int, high: int | None = None) -> Callable[[str], int]:
    """Parser of a whole number within bounds, for argparse."""

    def whole_number(text: str) -> int:
        number = int(text)
        if number < low or (high is not None and number > high):
            raise argparse.ArgumentTypeError(f"must be {low} or more" if high is None else f"must be {low} to {high}")
        return number

    return whole_number
