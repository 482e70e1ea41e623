"""Commands that fit approaches to all tests of a campaign: train, predict, sweep, next-test."""

import argparse
from dataclasses import replace
from functools import partial
from typing import Any

from crashfuse.approaches.registry import CLASSES
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import read_candidates
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.cli import output
from crashfuse.cli.conditions import AXES, condition_of, factor, require_positive
from crashfuse.errors import UsageError
from crashfuse.execution.run import Run
from crashfuse.execution.training_progress import watching
from crashfuse.results.files import replaced, write_files, write_pulses, write_result
from crashfuse.results.planning import next_tests_result, sweep_result
from crashfuse.results.prediction import prediction_result
from crashfuse.study import archive_learning
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.history import PastResult, keep
from crashfuse.study.planning import ConditionRange, next_test, speeds_between, sweep_speed, usual_speeds
from crashfuse.study.prediction import predict as predict_pulse
from crashfuse.study.saved_models import load_model, model_file, save_model


def train(arguments: argparse.Namespace) -> None:
    """Fit to all tests and save the models."""
    output.require_output(arguments.out, arguments.campaign)
    output.claim(arguments, arguments.out)
    campaign, config = load_campaign(arguments.campaign, arguments.archive), settings(arguments)
    with watching() as watch:
        for name in config.approaches:
            fit = Fit.of(campaign, name, config, Run.of(campaign, watch=watch))
            save_model(fit, campaign, arguments.out / model_file(name))
    print(f"Learned from {len(campaign.tests)} tests and {len(campaign.cae)} CAE runs of {campaign.name}.")
    print(f"Written to {arguments.out}: {', '.join(model_file(name) for name in config.approaches)}")


def learn_archive(arguments: argparse.Namespace) -> None:
    """Learn from past vehicles what teaches the next one."""
    if arguments.out.suffix != ".cfa":
        raise UsageError(f"An archive is a file that ends in .cfa, not {arguments.out}.")
    output.require_writable(arguments.out.parent)
    campaigns = [load_campaign(folder) for folder in arguments.campaigns]
    with watching() as watch:
        seed, workers = arguments.seed or 0, arguments.workers
        archive = archive_learning.learn_archive(campaigns, seed=seed, watch=watch, workers=workers)
    archive.save(arguments.out)
    record = archive.record.to_string(index=False, float_format="{:.3f}".format)
    print("Each vehicle left out, its rating over 0–60 ms by the fused prediction with the others and without:")
    print(record, archive.sentence, f"Written to {arguments.out}", sep="\n")


def predict(arguments: argparse.Namespace) -> None:
    """Predict the pulse at a new condition."""
    require_positive(arguments)
    export = output.pulse_export(arguments)
    campaign, display = output.opened(arguments, "prediction")
    condition = condition_of(arguments, campaign, arguments.speed_mps)
    prediction = predict_pulse(campaign, condition, _fits(arguments, campaign))
    result = prediction_result(prediction, (), arguments.report or "whole", export)
    write_result(result, arguments.out, display)
    keep(PastResult.of_prediction(campaign, prediction.estimates, prediction.config))
    output.say(result, display, arguments.out)


def sweep(arguments: argparse.Namespace) -> None:
    """Predict the metrics over speed."""
    require_positive(arguments)
    export = output.pulse_export(arguments)
    campaign, display = output.opened(arguments, "sweep")
    speeds = usual_speeds(campaign)
    if arguments.speed_mps is not None:
        low, high = arguments.speed_mps
        if not low < high:
            raise UsageError("A sweep takes a speed and a higher one.")
        speeds = speeds_between(low, high)
    condition = condition_of(arguments, campaign, speeds[0])
    condition = replace(condition, units=("mph", *condition.units[1:]))  # of its steps
    fits = _fits(arguments, campaign)
    with output.writing(arguments.out), replaced("sweep", arguments.out) as folder:
        with watching() as watch:
            write = partial(write_pulses, campaign, folder, export, display.system)
            swept = sweep_speed(campaign, fits, condition, speeds, watch, each=write)
        write_files(result := sweep_result(swept), folder, display)
    output.say(result, display, arguments.out)


def rank_tests(arguments: argparse.Namespace) -> None:
    """Rank tests to run next."""
    campaign, display = output.opened(arguments, "ranking of next tests")
    over = ConditionRange.of(campaign.tests)
    for name in AXES:
        if (limits := getattr(arguments, name)) is not None:
            ends = [replace(end, **{name: x}) for end, x in zip((over.low, over.high), limits, strict=True)]
            over = ConditionRange(*ends)
    if arguments.factor:
        factors = tuple(factor(text, campaign.factors) for text in arguments.factor)
        over = ConditionRange(replace(over.low, factors=factors), replace(over.high, factors=factors))
    candidates = read_candidates(arguments.candidates) if arguments.candidates else None
    config = settings(arguments, StudyConfig(approaches=("displacement_domain",)))  # by which tests are ranked
    with watching() as watch:
        ranking = next_test(campaign, over.low, over.high, candidates=candidates, config=config, watch=watch)
    write_result(result := next_tests_result(ranking), arguments.out, display)
    output.say(result, display, arguments.out)


def _fits(arguments: argparse.Namespace, campaign: Campaign) -> list[Fit]:
    if arguments.models is None:
        config = settings(arguments)
        with watching() as watch:
            return [Fit.of(campaign, name, config, Run.of(campaign, watch=watch)) for name in config.approaches]
    if any(value is not None for value in (arguments.preset, arguments.seed, arguments.device)):
        raise UsageError("Saved models have preset and seed in them; leave out --preset, --seed and --device.")
    saved = tuple(name for name in CLASSES.declared if (arguments.models / model_file(name)).is_file())
    if not saved:
        raise UsageError(f"There is no saved model in {arguments.models}; make some with crashfuse train.")
    names = dict.fromkeys(arguments.approach or saved)
    fits = [load_model(arguments.models / model_file(name), campaign) for name in names]
    if len({(fit.config.preset, fit.config.seed) for fit in fits}) > 1:
        raise UsageError(f"The models in {arguments.models} were trained with different presets or seeds.")
    return fits


def settings(arguments: argparse.Namespace, usual: StudyConfig | None = None) -> StudyConfig:
    """What the options ask for, else the usual, checked."""
    config = replace(usual or StudyConfig(), **given_settings(arguments))
    config.check()
    return config


def given_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """What the options name, as in a :class:`StudyConfig`."""
    options = {"approach": "approaches", "windows_ms": "windows_ms", "leave_out": "leave_out"}
    options |= {name: name for name in ("preset", "seed", "device", "also")}
    given = {name: getattr(arguments, option, None) for option, name in options.items()}
    if given["leave_out"] is not None:
        given["leave_out"] = given["leave_out"].replace("-", " ")
    return {name: tuple(v) if isinstance(v, list) else v for name, v in given.items() if v not in (None, ())}
