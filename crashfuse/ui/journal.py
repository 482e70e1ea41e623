"""The log of a server: when, who and what, a line each; never what is in a file."""

import logging
import os
import sys

from crashfuse.errors import printable
from crashfuse.ui.visitors import Visitor, names

ROOTS = "CRASHFUSE_ROOT"  # environment variable: folders that pages may open and write to, separated as in PATH
LOG = "CRASHFUSE_LOG"  # environment variable: file to append to, instead of standard error
_LINE = "%(asctime)s %(message)s"
_LONGEST = 1000

log = logging.getLogger(__name__)


def begin() -> None:
    """Let the lines, and the program's warnings and unforeseen errors, go to the file or to standard error."""
    file = os.environ.get(LOG)
    handler = logging.FileHandler(file, encoding="utf-8") if file else logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter(_LINE, "%Y-%m-%dT%H:%M:%S%z"))
    whole = logging.getLogger("crashfuse")
    whole.handlers[:] = [handler]
    whole.propagate = False
    log.setLevel(logging.INFO)


def note(who: Visitor | set[Visitor], what: str) -> None:
    """Add a line."""
    visitors = {who} if isinstance(who, Visitor) else who
    log.info("%s", printable(f"{names(visitors) or 'nobody'}: {what}", _LONGEST))
