"""Visitors of a server: whom what it computes belongs to, its log, and whether a log-in is set up that can work."""

import importlib.util
import logging
import os
import sys
import time
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crashfuse.errors import DataError, Problem, UsageError, printable

LOG = "CRASHFUSE_LOG"  # environment variable: file to append to, instead of standard error
_LINE = "%(asctime)s %(message)s"
_LONGEST, _LONGEST_ADDRESS = 1000, 200
_PAUSE_S, _MOST_ORIGINS = 60, 20  # of lines on refused pages, which anybody can cause
_SHARED, _EACH = ("redirect_uri", "cookie_secret"), ("client_id", "client_secret", "server_metadata_url")
_SHORTEST = 32  # characters of the secret that signs the cookies
_HOW_TO = "see the how-to on a team server"
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


def check_login(files: Sequence[str | Path], *, required: bool = False) -> bool:
    """Whether a secrets file asks for a log-in; an error if that cannot work, or if it is ``required`` in vain."""
    asked = [(path, auth) for path in map(Path, files) if path.is_file() and (auth := _auth_in(path)) is not None]
    for path, auth in asked:
        _check_section(path, auth)
    if required and not asked:
        raise DataError(Problem(str(files[0]), "a secrets file with a section [auth]", "none", _HOW_TO))
    if asked and importlib.util.find_spec("authlib") is None:
        raise UsageError('A log-in needs, in a checkout: python -m pip install ".[login]".')
    return bool(asked)


def providers(auth: dict[str, Any]) -> list[str | None]:
    """Names of whom a log-in may be with; None for the one without a name."""
    if "client_id" in auth:
        return [None]
    return [name for name, value in auth.items() if hasattr(value, "keys") and "client_id" in value]


def _auth_in(path: Path) -> dict[str, Any] | None:
    try:
        auth = tomllib.loads(path.read_text(encoding="utf-8")).get("auth")
    except (OSError, ValueError) as error:
        raise DataError(Problem(str(path), "a TOML file that can be read", str(error), "correct it")) from error
    return auth if auth is None or isinstance(auth, dict) else {}


def _check_section(path: Path, auth: dict[str, Any]) -> None:
    wanted = [auth[name] for name in providers(auth) if name] or [auth]
    lacking = [name for name in _SHARED if not auth.get(name)]
    lacking += [name for section in wanted for name in _EACH if not section.get(name)]
    where, advice = f"{path}, [auth]", _HOW_TO
    problems = [Problem(where, name, "none", advice) for name in dict.fromkeys(lacking)]
    if not lacking and not str(auth["redirect_uri"]).endswith("/oauth2callback"):
        expected = "the server's address with /oauth2callback"
        problems.append(Problem(where, expected, str(auth["redirect_uri"]), advice, "redirect_uri"))
    if not lacking and len(str(auth["cookie_secret"])) < _SHORTEST:
        expected, found = f"at least {_SHORTEST} random characters", f"{len(str(auth['cookie_secret']))}"
        problems.append(Problem(where, expected, found, advice, "cookie_secret"))
    if problems:
        raise DataError(problems)
