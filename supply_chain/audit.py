"""Compare an installation with its pins, and each installed file with the hash that its wheel recorded.

``python -m supply_chain.audit``, in the environment to be checked; it needs no network. pip and uv check hashes only
while they install, and no tool that we know of checks the files afterwards.
"""

import base64
import csv
import hashlib
import sys
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import Distribution, distributions
from pathlib import Path

from packaging.utils import canonicalize_name
from packaging.version import Version

PINS = Path(__file__).parents[1] / "constraints.txt"
_UNPINNED = ("crashfuse", "pip")


def pins() -> dict[str, str]:
    """Pinned version of each distribution, by canonical name."""
    lines = (line.strip() for line in PINS.read_text(encoding="utf-8").splitlines())
    pairs = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {canonicalize_name(name): version for name, version in pairs}


def problems(installed: Iterable[Distribution], pinned: Mapping[str, str]) -> Iterator[str]:
    """What is wrong, a sentence each: another version than the pinned one, a file that was altered or is missing."""
    for distribution in installed:
        name = canonicalize_name(distribution.name)
        expected = pinned.get(name, "nothing")
        if Version(distribution.version).public != expected and name not in _UNPINNED:
            yield f"{name}: {distribution.version} is installed, {expected} is pinned."
        # not distribution.files, which leaves out missing files in some versions of Python
        for file, recorded, *_ in csv.reader((distribution.read_text("RECORD") or "").splitlines()):
            if not recorded.startswith("sha256="):  # RECORD itself, and bytecode
                continue
            path = Path(str(distribution.locate_file(file)))
            if not path.is_file():
                yield f"{name}: {file} is missing."
            elif _digest(path) != recorded.removeprefix("sha256="):
                yield f"{name}: {file} was altered."


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").digest()
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode()


def main() -> int:
    """Print what is wrong and return the exit code: 0 if nothing is, else 1."""
    installed = list(distributions())
    found = list(problems(installed, pins()))
    print(*found, f"{len(installed)} distributions checked, {len(found)} problems.", sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
