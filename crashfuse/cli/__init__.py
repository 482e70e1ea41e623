"""The command line: parse, call the library, print. Nothing is computed here."""

import argparse
import sys
from collections.abc import Callable, Sequence

from crashfuse.cli.arguments import parser
from crashfuse.errors import CrashfuseError, DataError, UsageError

__all__ = ["main", "parser"]

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


def _say(*lines: str) -> None:
    for line in lines:
        print(line, file=sys.stderr)
