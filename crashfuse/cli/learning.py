"""The command that predicts tests from fewer of the others."""

import argparse
from pathlib import Path

from crashfuse.cli.models import settings
from crashfuse.cli.output import display_of, replacing, require_output, say_facts, say_written, writing


def learning_curve(arguments: argparse.Namespace) -> None:
    """Predict tests from 1, 2, 3 … of the others, and say what one more test would buy."""
    from crashfuse.campaign_folder.load import load_campaign
    from crashfuse.certification.criteria import read_criteria
    from crashfuse.reporting.result_tables import gains_table
    from crashfuse.reporting.watched import watching
    from crashfuse.study import learning_curve as curves
    from crashfuse.study.one_more_test import Cost, sentences

    require_output(arguments.out, arguments.campaign, "learning curve")
    cost = None if arguments.cost_per_test is None else Cost.of(arguments.cost_per_test)
    config = settings(arguments, curves.CURVE_CONFIG)
    own = Path(arguments.campaign, "criteria.toml")
    criteria = read_criteria(arguments.criteria or own) if arguments.criteria or own.is_file() else None
    campaign = load_campaign(arguments.campaign)
    repeats = curves.REPEATS if arguments.repeats is None else arguments.repeats
    with watching() as watch:
        curve = curves.learning_curve(
            campaign, config, repeats=repeats, watch=watch, workers=arguments.workers, scheduler=arguments.scheduler
        )
    if criteria is not None:
        curve = curve.decided(criteria)
    display = display_of(arguments, campaign)
    with replacing(arguments.out, "learning curve"), writing(arguments.out, "learning_curve.json") as folder:
        curve.write(folder, cost=arguments.cost_per_test, display=display)
    say_facts(campaign, display)
    if not (table := gains_table(curve, cost)).empty:
        print(table.to_string(index=False))
    print(*sentences(curve, cost), sep="\n")
    say_written(arguments.out, "learning curve")
