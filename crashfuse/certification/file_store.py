"""Matrices and certifications, kept beside the cache under a digest of their content: a link outlives the server.

Whoever takes it from here checks it again. Nobody finds a file whose content they do not know, but the certifications
of a vehicle by having the record of one of their tests.
"""

import hashlib
import os
import re
import time
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from crashfuse.campaign import Campaign
from crashfuse.certification.earlier import FILE, Earlier, parse_earlier, read_earlier
from crashfuse.errors import DataError, Problem
from crashfuse.execution.cache import default_folder
from crashfuse.files.atomic import write_atomically

LARGEST = 8 << 20  # bytes of a file; 10,000 conditions take less than a million, a verdict about a hundred
_MOST, _MOST_BYTES = 200, 64 << 20  # of all; what was not used for longest makes room
_UNUSED_S = 365 * 86400.0
_NAME = re.compile(r"[0-9a-f]{24}")


def keep(content: bytes, file: str) -> str:
    """Keep the content of a file that could be read; returns its name in links. A DataError if it is too large.

    What was not used for a year is deleted, and what is too much, the least recently used first.
    """
    if len(content) > LARGEST:
        size = f"{len(content) / 2**20:.1f} MB"
        raise DataError(Problem(file, f"at most {LARGEST >> 20} MB", size, "leave out some conditions"))
    name = _name(content)
    try:
        write_atomically(_home() / name, content)
    except OSError as error:
        raise DataError(Problem(file, "room on the server", error.strerror or "none", "free some space")) from error
    with suppress(OSError):  # another server may have removed one between two looks
        found, total = sorted(((path.stat(), path) for path in _home().iterdir()), key=lambda own: -own[0].st_mtime), 0
        for number, (stat, path) in enumerate(found):
            total += stat.st_size
            if number >= _MOST or total > _MOST_BYTES or time.time() - stat.st_mtime > _UNUSED_S:
                path.unlink(missing_ok=True)
    return name


def find(name: str) -> bytes | None:
    """The content kept under this name; None if there is none, or if it is not what was kept."""
    path = _home() / name
    with suppress(OSError):
        if _NAME.fullmatch(name) and path.stat().st_size <= LARGEST:  # of a link that anybody may have written
            content = path.read_bytes()
            if _name(content) == name:
                with suppress(OSError):
                    os.utime(path)  # it was used
                return content
    return None


def certifications(campaign: Campaign) -> dict[str, Earlier]:
    """Those kept that knew a test of this campaign, by name, the latest first."""
    found = {}
    for path in _home().glob("*"):
        with suppress(OSError, DataError):  # a matrix, or another server removed it between two looks
            earlier = _certification(path, path.stat().st_mtime_ns)
            if earlier.digest.startswith(path.name) and earlier.is_of(campaign):
                found[path.name] = earlier
    return dict(sorted(found.items(), key=lambda kept: kept[1].date, reverse=True))


def keep_certification(content: bytes, campaign: Campaign) -> Earlier:
    """Keep the file of a certification, unless one is kept that says the same; returns that which is."""
    new = parse_earlier(content)
    before = [own for own in certifications(campaign).values() if own == new]
    if not before:
        keep(content, FILE)
    return before[-1] if before else new


@lru_cache(maxsize=_MOST)
def _certification(path: Path, changed_ns: int) -> Earlier:  # noqa: ARG001 - of another time it is read again
    return read_earlier(path)


def _name(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:24]


def _home() -> Path:
    return default_folder() / "uploads"
