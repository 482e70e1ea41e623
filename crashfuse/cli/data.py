"""Commands on data, and that of the dashboard; each imports what it needs: the dashboard is to start at once."""

import argparse
import shlex
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from crashfuse.cli.arguments import CONDITION
from crashfuse.cli.conditions import ACCELERATION_UNITS
from crashfuse.errors import UsageError
from crashfuse.units import MS


def app(arguments: argparse.Namespace) -> None:
    """Start the dashboard."""
    from crashfuse.ui.server import launch

    for folder in (arguments.campaign, *arguments.root):
        if folder is not None and not folder.is_dir():
            raise UsageError(f"There is no folder {folder}.")
    places = {"secrets": arguments.login, "log": arguments.log}
    launch(arguments.port, arguments.campaign, roots=arguments.root, hosts=arguments.allow_host, **places)


def sample(arguments: argparse.Namespace) -> None:
    """Write the sample campaign."""
    from crashfuse.synthetic.sample import write_sample

    write_sample(arguments.folder)
    print(f"The sample campaign is in {arguments.folder}. It is synthetic: simulated, no real vehicle.")


def check(arguments: argparse.Namespace) -> None:
    """Print what a campaign contains."""
    from crashfuse.approaches.neighbours import nearest_run
    from crashfuse.campaign_folder.load import load_campaign, unread_files
    from crashfuse.study.facts import campaign_facts

    campaign = load_campaign(arguments.campaign)
    tests = f"{n} tests" if (n := len(campaign.tests)) > 1 else "1 test"
    print(f"{campaign.name}: {tests}, {len(campaign.cae)} CAE runs.")
    for test in campaign.tests:
        pair = campaign.cae.paired_run(test.condition)
        near = nearest_run(campaign, test.condition).differences(test.condition)
        source = f"no paired run, the nearest is {near}" if pair is None else f"paired with {campaign.cae.ids[pair]}"
        print(f"  {test.id}: {test.condition}; {source}")
        for note in campaign.cae.extrapolation(test.condition):
            print(f"    {note}")
    for fact in campaign_facts(campaign):
        print(f"Note: {fact.sentence}")
    if unread := unread_files(arguments.campaign):
        print(unread)
    verdict = campaign.quality
    for sentence in verdict.sentences:
        print(sentence)
    print(f"Fingerprint {campaign.fingerprint}")
    failing = bool(verdict.failing) and not verdict.left_out
    see = ["the notes"] * bool(campaign.remarks) + ["the CAE runs that fail"] * failing
    print(f"Nothing is wrong with the files; see {' and '.join(see)}." if see else "Nothing is wrong.")


def edit(arguments: argparse.Namespace) -> None:
    """Edit a campaign, or list the changes that can be undone."""
    from crashfuse.campaign_folder.editing import leave_out, remove_tests, say_tuned, set_about, use_again
    from crashfuse.campaign_folder.history import changes, undo

    def describe(folder: Path, given: Sequence[str]) -> str:
        test_id, *pairs = given
        about = {name: value for name, is_given, value in (pair.partition("=") for pair in pairs) if name and is_given}
        if not about or len(about) < len(pairs):
            raise UsageError("--about takes a test and NAME=VALUE, such as T09 laboratory=MGA.")
        return set_about(folder, test_id, about)

    folder = arguments.campaign
    if arguments.undo:
        print(f"Undone: {undo(folder).what}.")
        return
    if arguments.because and not arguments.leave_out:
        raise UsageError("--because is the reason of --leave-out.")
    asked = (
        (partial(leave_out, why=arguments.because or ""), arguments.leave_out),
        (use_again, arguments.use),
        (remove_tests, arguments.remove),
        (partial(say_tuned, tuned=True), arguments.cae_tuned),
        (partial(say_tuned, tuned=False), arguments.not_cae_tuned),
        (describe, arguments.about),
    )
    for change_it, ids in asked:
        if ids:
            print(f"{change_it(folder, ids)}. crashfuse edit {shlex.quote(str(folder))} --undo takes it back.")
            return
    kept = changes(folder)
    print("Changes that --undo takes back, the last one first:" if kept else "There is no change that can be undone.")
    for change in kept:
        print(f"  {change.when}  {change.what}")


def import_(arguments: argparse.Namespace) -> None:
    """Add a source to a campaign, and print how it was read."""
    from crashfuse.campaign_folder.history import changes
    from crashfuse.importing import Choices, ColumnChoice, import_source
    from crashfuse.readers.record import PartialCondition

    same = {name: getattr(arguments, name) for name in ("deceleration_sign", "channel_filter_class", "front_share")}
    choices = Choices(
        channels=tuple(arguments.channel),
        unit=ACCELERATION_UNITS.get(arguments.unit, arguments.unit),
        time_zero_s=None if arguments.time_zero_ms is None else arguments.time_zero_ms * MS,
        gap_m=arguments.gap_mm,
        condition=PartialCondition(**{name: getattr(arguments, name) for name in CONDITION}),
        **same,
    )
    how = {name: getattr(arguments, name) for name in ("role", "cae", "conditions", "travel")}
    tuned = None if arguments.cae_tuned is None else arguments.cae_tuned == "yes"
    how |= {"columns": [*map(ColumnChoice.parsed, arguments.column)], "fmt": arguments.format, "cae_tuned": tuned}
    for one in import_source(arguments.source, arguments.out, choices, record_id=arguments.id, **how):
        print(f"{one.id}: {one.condition}")
        for step in one.steps:
            print(f"  {step}")
    print(f"{changes(arguments.out)[0].what}. {arguments.out / 'campaign.toml'} tells how.")
