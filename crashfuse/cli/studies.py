"""The command that leaves tests out."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crashfuse.cli.output import replacing, require_output
from crashfuse.errors import CrashfuseError, UsageError
from crashfuse.files import written_together

if TYPE_CHECKING:
    import pandas as pd

_LEFT_OUT = {"test": "each left out alone", "speed group": "each left out with all tests at about its speed"}


def study(arguments: argparse.Namespace) -> None:
    """Leave tests out, predict and rate them."""
    from crashfuse.config import StudyConfig
    from crashfuse.formats.folder import load_campaign
    from crashfuse.progress import Watch
    from crashfuse.progress_bar import ProgressBar
    from crashfuse.recommendation import recommend
    from crashfuse.results import begin_study, read_record, write_study
    from crashfuse.study import check_study, run_study
    from crashfuse.tables import scores_table

    require_output(arguments.out, arguments.campaign, "study")
    campaign = load_campaign(arguments.campaign)
    given: dict[str, Any] = {
        name: value
        for name, value in (
            ("approaches", arguments.approach and tuple(arguments.approach)),
            ("preset", arguments.preset),
            ("seed", arguments.seed),
            ("windows_ms", arguments.windows_ms and tuple(arguments.windows_ms)),
            ("hold_out", arguments.hold_out and arguments.hold_out.replace("-", " ")),
            ("device", arguments.device),
        )
        if value is not None
    }
    whole = not arguments.held_out and arguments.preset != "paper"  # a paper fit takes minutes, or a GPU
    config = StudyConfig(**{"hold_out": "both" if whole else "test", **given})
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
    with _writing(arguments.out) as folder:
        begin_study(folder, campaign, held_out, config)
    with ProgressBar() as bar:
        study = run_study(
            campaign,
            config,
            held_out=held_out,
            watch=Watch(bar.show),
            workers=arguments.workers,
            scheduler=arguments.scheduler,
        )
    with replacing(arguments.out, "study"), _writing(arguments.out) as folder:
        write_study(study, folder)
    print("Mean ISO/TS 18571 rating over the held-out tests, " + _LEFT_OUT[config.each[0].hold_out])
    _print_means(scores_table(study))
    if study.speed_groups is not None:
        print(f"The same, {_LEFT_OUT['speed group']}")
        _print_means(scores_table(study.speed_groups))
    print(*recommend(study).sentences, sep="\n")
    if campaign.notice:
        print(campaign.notice)
    groups = "" if study.speed_groups is None else "speed_groups.csv, "
    print(f"Written to {arguments.out}: scores.csv, {groups}pulses.csv, metrics.csv, study.json, report.html")


@contextmanager
def _writing(folder: Path) -> Iterator[Path]:
    """Where to write a set of results, which get to their folder together or not at all."""
    try:
        with written_together(folder, last="study.json") as staging:
            yield staging
    except OSError as error:
        raise CrashfuseError(
            f"Nothing was written to {folder}: {error.strerror or error}. "
            "What was computed is in the cache: once there is room, the same command goes on from there."
        ) from error


def _print_means(scores: "pd.DataFrame") -> None:
    """Print the mean overall rating of each approach over each window."""
    from crashfuse.approaches import LABELS

    means = scores.groupby(["approach", "window_ms"], sort=False)["overall"].mean().unstack(sort=False)
    means.index = [LABELS[name] for name in means.index]
    means.columns = [f"0–{window:g} ms" for window in means.columns]
    print(means.to_string(float_format="{:.3f}".format))
