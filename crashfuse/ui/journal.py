"""The log of a server: when, who and what, a line each; never what is in a file."""

import logging
import os
import sys
import time

from crashfuse.errors import printable
from crashfuse.ui.visitors import Visitor, names

ROOTS = "CRASHFUSE_ROOT"  # environment variable: folders that pages may open and write to, one a line
LOG = "CRASHFUSE_LOG"  # environment variable: file to append to, instead of standard error
_LINE = "%(asctime)s %(message)s"
_LONGEST, _LONGEST_ADDRESS = 1000, 200
_PAUSE_S, _MOST_ORIGINS = 60, 20  # of lines on refused pages, which anybody can cause

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
    _add(f"{names(visitors) or 'nobody'}: {what}")


class Refusals:
    """Pages of another origin that may not open the WebSocket: why a browser stays empty behind a proxy."""

    def __init__(self) -> None:
        self._told: dict[str, float] = {}  # by the origin, when

    def note(self, origin: str, host: str | None) -> None:
        """Add a line, once a minute for each origin; ``host`` is what the server was asked for as."""
        now, who = time.monotonic(), printable(repr(origin), _LONGEST_ADDRESS)
        self._told = {each: at for each, at in self._told.items() if now - at < _PAUSE_S}
        if who in self._told or len(self._told) == _MOST_ORIGINS:
            return
        self._told[who] = now
        here = printable(repr(host), _LONGEST_ADDRESS)
        _add(
            f"page of {who}: was refused and stays empty, for the server was asked for as {here}. If the first is this "
            "server's address in the browser, let the proxy pass on that name with its port (Host), or add the address "
            "to server.corsAllowedOrigins."
        )


def _add(line: str) -> None:
    log.info("%s", printable(line, _LONGEST))
