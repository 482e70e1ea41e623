"""What can be said of an installation without a network: that it is what was pinned, unaltered, and known to be safe.

``python -m supply_chain.audit [--advisories all.zip]``, in the environment that is to be checked. Advisories are those
of the Open Source Vulnerabilities database for PyPI, which it gives out as one zip: fetched where there is a network,
read where there is none. Where there is one, ``pip-audit -r supply_chain/hashes.txt`` asks it directly.
"""

import argparse
import base64
import csv
import hashlib
import json
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from supply_chain.inventory import Component, installation, pins

_LARGEST_ADVISORY = 1 << 22


def unpinned(components: Sequence[Component]) -> list[str]:
    """Distributions whose version is not the pinned one."""
    pinned = pins()
    return [
        f"{each.name} {each.version} is installed, {pinned.get(each.name, 'no version')} is pinned."
        for each in components
        if pinned.get(each.name) != each.version
    ]


def altered(components: Sequence[Component]) -> list[str]:
    """Installed files whose SHA-256 is not the one that their distribution recorded, or that are gone."""
    return [text for each in components for text in _altered(metadata.distribution(each.name))]


def _altered(distribution: metadata.Distribution) -> Iterator[str]:
    # not distribution.files: from some version of Python on it leaves out what is gone
    for name, recorded, *_ in csv.reader((distribution.read_text("RECORD") or "").splitlines()):
        mode, _, expected = recorded.partition("=")
        if mode != "sha256":  # RECORD itself, and what was compiled since
            continue
        path = Path(str(distribution.locate_file(name)))
        if not path.is_file():
            yield f"{distribution.name}: {name} is gone."
            continue
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").digest()
        if base64.urlsafe_b64encode(digest).rstrip(b"=").decode() != expected:
            yield f"{distribution.name}: {name} was altered."


def vulnerable(components: Sequence[Component], advisories: Path) -> list[str]:
    """Distributions in a version of which a zip of advisories (OSV's form) tells.

    Raises
    ------
    ValueError
        If the zip holds no advisory.
    """
    versions = {each.name: Version(each.version) for each in components}
    found, read = [], 0
    with zipfile.ZipFile(advisories) as archive:
        for member in archive.infolist():
            if not member.filename.endswith(".json") or member.file_size > _LARGEST_ADVISORY:
                continue
            advisory = json.loads(archive.read(member))
            read += 1
            if "withdrawn" in advisory:
                continue
            for name in sorted({name for name, _ in _affected(advisory, versions)}):
                what = str(advisory.get("summary") or advisory.get("details", "")).partition("\n")[0]
                found.append(f"{name} {versions[name]}: {advisory['id']}: {what[:200]}")
    if not read:
        raise ValueError(f"{advisories} holds no advisory.")
    return found


def _affected(advisory: Mapping[str, Any], versions: Mapping[str, Version]) -> Iterator[tuple[str, Version]]:
    for affected in advisory.get("affected", ()):
        package = affected.get("package", {})
        name = canonicalize_name(package.get("name", ""))
        if package.get("ecosystem") != "PyPI" or name not in versions:
            continue
        listed = {_version(text) for text in affected.get("versions", ())}
        ranges = [each["events"] for each in affected.get("ranges", ()) if each.get("type") == "ECOSYSTEM"]
        if versions[name] in listed or any(_within(versions[name], events) for events in ranges):
            yield name, versions[name]


def _within(version: Version, events: Sequence[Mapping[str, str]]) -> bool:
    """Whether a version lies in a range, by the last event before or at it."""
    inside = False
    for event in sorted(events, key=lambda each: _version(next(iter(each.values()))) or Version("0")):
        (kind, text), *_ = event.items()
        bound = _version(text) or Version("0")
        if kind == "introduced" and version >= bound:
            inside = True
        elif (kind == "fixed" and version >= bound) or (kind == "last_affected" and version > bound):
            inside = False
    return inside


def _version(text: str) -> Version | None:
    try:
        return Version(text)
    except InvalidVersion:
        return None


def main() -> int:
    """Check, print what is wrong, and return the exit code: 0 nothing, 1 something."""
    parser = argparse.ArgumentParser(prog="python -m supply_chain.audit", description="Check what is installed.")
    parser.add_argument("--advisories", type=Path, metavar="all.zip", help="of the OSV database, for PyPI")
    arguments = parser.parse_args()
    components = installation()
    problems = unpinned(components) + altered(components)
    if arguments.advisories is not None:
        problems += vulnerable(components, arguments.advisories)
    print(*problems, f"{len(components)} distributions checked, {len(problems)} problems.", sep="\n")
    if arguments.advisories is None:
        print("Known vulnerabilities were not looked up: that takes --advisories, or a network and pip-audit.")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
