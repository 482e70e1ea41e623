"""The command line: parses arguments, calls the library and prints results; it computes nothing itself."""

import io
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from importlib import import_module

from crashfuse.cli.arguments import parser
from crashfuse.errors import OUT_OF_MEMORY, CrashfuseError, DataError, UsageError, out_of_memory, printable
from crashfuse.execution.run import share_one_heap
from crashfuse.readers.vocabulary import TRAVELS

__all__ = ["main", "parser"]

DONE, WRONG_DATA, WRONG_USAGE, INTERRUPTED, CUT_OFF = 0, 1, 2, 130, 141
_LONGEST_LINE = 2000


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 1 errors in the data, 2 wrong usage)."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name with characters that the terminal lacks
    argv = _with_directions(sys.argv[1:] if argv is None else argv)
    arguments = parser().parse_args(argv)
    if any(argument == "" or (argument.startswith("--") and argument.endswith("=")) for argument in argv):
        _say("crashfuse: one of the arguments is empty; was a variable not set?")
        return WRONG_USAGE
    if foreign := [argument for argument in argv if _is_foreign(argument)]:
        _say(f"crashfuse: {_not_utf8(foreign[0])}")
        return WRONG_USAGE
    share_one_heap()
    try:
        with ExitStack() as arguments.claims:  # of the folders that it writes to
            module, _, command = arguments.run.partition(".")
            getattr(import_module(f"crashfuse.cli.{module}"), command)(arguments)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of the output (head, say) has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CUT_OFF
    except DataError as error:
        count = len(error.problems)
        _say(*map(str, error.problems), f"{count} problem{'s' if count > 1 else ''} found.")
        return WRONG_DATA
    except (CrashfuseError, OSError) as error:
        _say(f"crashfuse: {_about_the_system(error) if isinstance(error, OSError) else error}")
        return WRONG_USAGE if isinstance(error, UsageError) else WRONG_DATA
    except UnicodeEncodeError as error:  # a file in a folder
        if not _is_foreign(error.object):
            raise
        _say(f"crashfuse: {_not_utf8(error.object)}")
        return WRONG_DATA
    except (MemoryError, RuntimeError) as error:
        if not out_of_memory(error):
            raise
        _say(f"crashfuse: {OUT_OF_MEMORY}")
        return WRONG_DATA
    except KeyboardInterrupt:
        from crashfuse.execution.cache import resume

        _say(f"Stopped. {resume('the same command (a study with --resume) continues there')}.")
        return INTERRUPTED
    return DONE


def _is_foreign(name: str) -> bool:
    return any("\ud800" <= letter <= "\udfff" for letter in name)  # stands for a byte that is not UTF-8


def _not_utf8(name: str) -> str:
    return f"the name {printable(name, 200)} is not UTF-8; rename the file or folder."


def _with_directions(argv: Sequence[str]) -> list[str]:
    """``--travel -x`` as one, which argparse would take for two options."""
    joined: list[str] = []
    for argument in argv:
        if joined[-1:] == ["--travel"] and argument in TRAVELS:
            joined[-1] = f"--travel={argument}"
        else:
            joined.append(argument)
    return joined


def _about_the_system(error: OSError) -> str:
    reason = (error.strerror or str(error) or type(error).__name__).rstrip(".")
    return f"{error.filename or 'something'} cannot be read or written: {reason[:1].lower()}{reason[1:]}."


def _say(*lines: str) -> None:
    for line in lines:
        print(printable(line, _LONGEST_LINE), file=sys.stderr)
