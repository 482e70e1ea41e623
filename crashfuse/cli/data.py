"""Commands on data: start the dashboard, write the sample, check a campaign, rate two pulses."""

import argparse
import json
from dataclasses import asdict

from crashfuse.errors import UsageError


def app(arguments: argparse.Namespace) -> None:
    """Start the dashboard."""
    from crashfuse.ui.launch import launch

    if arguments.campaign is not None and not arguments.campaign.is_dir():
        raise UsageError(f"There is no folder {arguments.campaign}.")
    launch(arguments.port, arguments.campaign)


def sample(arguments: argparse.Namespace) -> None:
    """Write the sample campaign."""
    from crashfuse.synthetic import write_sample

    write_sample(arguments.folder)
    print(f"The sample campaign is in {arguments.folder}. It is synthetic: simulated, no real vehicle.")


def check(arguments: argparse.Namespace) -> None:
    """Print what a campaign contains."""
    from crashfuse.cae.quality import judge_quality
    from crashfuse.campaign_folder.folder import load_campaign

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
    verdict = judge_quality(campaign.cae, campaign.quality_limits)
    for sentence in verdict.sentences:
        print(sentence)
    print(f"Fingerprint {campaign.fingerprint}")
    used = verdict.failing and not verdict.left_out
    print("Nothing is wrong with the files; see the CAE runs that fail." if used else "Nothing is wrong.")


def rate(arguments: argparse.Namespace) -> None:
    """Rate one pulse against another."""
    from crashfuse.campaign_folder.sample_tables import read_pulse
    from crashfuse.signals.rating import rate_windows

    reference, comparison = read_pulse(arguments.reference), read_pulse(arguments.comparison)
    ratings = rate_windows(reference, comparison, arguments.windows_ms or (20.0, 40.0, 60.0))
    if arguments.json:
        print(json.dumps([{"window_ms": window, **asdict(rating)} for window, rating in ratings.items()], indent=2))
        return
    print("ISO/TS 18571   overall  corridor   phase  magnitude   slope  grade")
    for window, r in ratings.items():
        scores = f"{r.overall:>9.3f}{r.corridor:>10.3f}{r.phase:>8.3f}{r.magnitude:>11.3f}{r.slope:>8.3f}"
        print(f"{f'0–{window:g} ms':<13}{scores}  {r.grade}")
