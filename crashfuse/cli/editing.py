"""The command that edits a campaign folder."""

import argparse
import shlex
from functools import partial

from crashfuse.errors import UsageError


def edit(arguments: argparse.Namespace) -> None:
    """Edit a campaign, or list the changes that can be undone."""
    from crashfuse.campaign_folder.editing import leave_out, remove_tests, use_again
    from crashfuse.campaign_folder.history import changes, undo

    folder = arguments.campaign
    if arguments.undo:
        print(f"Undone: {undo(folder).what}.")
        return
    if arguments.because and not arguments.leave_out:
        raise UsageError("--because is the reason of --leave-out.")
    leaving = partial(leave_out, why=arguments.because or "")
    asked = ((leaving, arguments.leave_out), (use_again, arguments.use), (remove_tests, arguments.remove))
    for change_it, ids in asked:
        if ids:
            print(f"{change_it(folder, ids)}. crashfuse edit {shlex.quote(str(folder))} --undo takes it back.")
            return
    kept = changes(folder)
    print("Changes that --undo takes back, the last one first:" if kept else "There is no change that can be undone.")
    for change in kept:
        print(f"  {change.when}  {change.what}")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--leave-out", nargs="+", metavar="ID", help="tests that nothing learns from or rates; they stay in the folder"
    )
    parser.add_argument("--because", metavar="WHY", help="why they are left out; it stands in every report")
    what.add_argument("--use", nargs="+", metavar="ID", help="tests to use again")
    what.add_argument("--remove", nargs="+", metavar="ID", help="tests to take out of the folder")
    what.add_argument("--undo", action="store_true", help="undo the last change: an import or one of these")
