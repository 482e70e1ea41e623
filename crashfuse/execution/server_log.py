"""Visitors of a server, whom what it computes belongs to, and its log."""

import logging
import os
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass

from crashfuse.errors import printable

LOG = "CRASHFUSE_LOG"  # environment variable: file to append to, instead of standard error
_LINE = "%(asctime)s %(message)s"
_LONGEST, _LONGEST_ADDRESS = 1000, 200
_PAUSE_S, _MOST_ORIGINS = 60, 20  # of lines on refused pages, which anybody can cause
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Visitor:
    """Whom uploads, imports and jobs belong to."""

    key: str  # the same in all sessions of one person or browser; nobody else can guess it
    name: str  # what others and the log may know: the e-mail address, or a short name of the browser


def names(visitors: Iterable[Visitor]) -> str:
    """What others may know of them, in a line."""
    return " and ".join(sorted(visitor.name for visitor in visitors))


def begin_log() -> None:
    """Let lines, warnings and errors go to the file, else to standard error."""
    file = os.environ.get(LOG)
    handler = logging.FileHandler(file, encoding="utf-8") if file else logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter(_LINE, "%Y-%m-%dT%H:%M:%S%z"))
    whole = logging.getLogger("crashfuse")
    whole.handlers[:] = [handler]
    whole.propagate = False
    log.setLevel(logging.INFO)


def note_in_log(who: Visitor | set[Visitor], what: str) -> None:
    """Add a line."""
    visitors = {who} if isinstance(who, Visitor) else who
    _add_line(f"{names(visitors) or 'nobody'}: {what}")


class Refusals:
    """Pages of another origin that may not open the WebSocket: why a browser stays empty behind a proxy."""

    def __init__(self) -> None:
        self._noted: dict[str, float] = {}  # by the origin, when

    def note(self, origin: str, host: str | None) -> None:
        """Add a line, once a minute for each origin; ``host`` is the name that was asked for."""
        now, who, here = time.monotonic(), *(printable(repr(text), _LONGEST_ADDRESS) for text in (origin, host))
        self._noted = {each: at for each, at in self._noted.items() if now - at < _PAUSE_S}
        if who not in self._noted and len(self._noted) < _MOST_ORIGINS:
            self._noted[who] = now
            _add_line(
                f"page of {who}: was refused and stays empty, for the server was asked for as {here}. Let the proxy "
                "pass on that name with its port (Host), or add the address to server.corsAllowedOrigins."
            )


def _add_line(line: str) -> None:
    log.info("%s", printable(line, _LONGEST))
