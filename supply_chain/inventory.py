"""What an installation consists of: every distribution that crashfuse needs, its version, its licence.

``python -m supply_chain.inventory`` writes ``THIRD_PARTY.md`` and ``sbom.cdx.json`` anew, from the metadata of what is
installed.
"""

import json
import tomllib
import uuid
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parent.parent
TABLE, SBOM, PINS = ROOT / "THIRD_PARTY.md", ROOT / "sbom.cdx.json", ROOT / "constraints.txt"

CUDA = ("nvidia-", "cuda-", "triton")
"""What torch's builds for CUDA bring along; the builds for CPUs do without."""

# Metadata written before licences had identifiers (PEP 639), in the words that occur.
_SPDX = {
    "3-Clause BSD License": "BSD-3-Clause",
    "Apache 2.0": "Apache-2.0",
    "Apache License 2.0": "Apache-2.0",
    "Apache License, Version 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "BSD": "BSD-3-Clause",
    "BSD License": "BSD-3-Clause",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
}
_IN_ITS_FILE = {"objective-rating-metrics": "MIT"}  # metadata name none: read in the licence file that it installs
_OTHER_PLATFORMS = {"cffi": "MIT", "colorama": "BSD-3-Clause", "pycparser": "BSD-3-Clause"}  # Windows needs them


@dataclass(frozen=True, slots=True)
class Component:
    """A distribution that an installation needs.

    Attributes
    ----------
    name, version, licence : str
        The licence as an SPDX expression.
    purpose : str
        ``use``, or the extra that needs it.
    needs : tuple of str
        Names of the distributions that it needs itself.
    """

    name: str
    version: str
    licence: str
    purpose: str
    needs: tuple[str, ...]


def pins() -> dict[str, str]:
    """Pinned version of each distribution, from ``constraints.txt``."""
    lines = (line.partition("#")[0].strip() for line in PINS.read_text(encoding="utf-8").splitlines())
    return {canonicalize_name(name): version for name, _, version in (line.partition("==") for line in lines if line)}


def required_for() -> dict[str, list[Requirement]]:
    """What the project itself asks for: to be used, and for each extra."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    texts = {"use": project["dependencies"], **project["optional-dependencies"]}
    return {purpose: [Requirement(text) for text in each] for purpose, each in texts.items()}


def installation() -> tuple[Component, ...]:
    """Everything that crashfuse and its extras need here, by name; without what CUDA brings along.

    Raises
    ------
    importlib.metadata.PackageNotFoundError
        If something of it is not installed.
    """
    purposes: dict[str, str] = {}
    needs: dict[str, set[str]] = {}
    extras: dict[str, set[str]] = {}
    for purpose, required in required_for().items():
        waiting = list(required)
        while waiting:
            requirement = waiting.pop()
            name = canonicalize_name(requirement.name)
            if name in needs and requirement.extras <= extras[name]:
                continue
            purposes.setdefault(name, purpose)
            extras[name] = extras.get(name, set()) | requirement.extras
            needed = list(_needed(metadata.distribution(name), extras[name]))
            needs[name] = {canonicalize_name(each.name) for each in needed}
            waiting += needed
    return tuple(_component(name, purposes[name], tuple(sorted(needs[name]))) for name in sorted(needs))


def _needed(distribution: metadata.Distribution, extras: set[str]) -> Iterator[Requirement]:
    environment = {name: str(value) for name, value in default_environment().items()}
    for requirement in map(Requirement, distribution.requires or ()):
        if canonicalize_name(requirement.name).startswith(CUDA):
            continue
        marker = requirement.marker
        if marker is None or any(marker.evaluate({**environment, "extra": extra}) for extra in ("", *extras)):
            yield requirement


def _component(name: str, purpose: str, needs: tuple[str, ...]) -> Component:
    distribution = metadata.distribution(name)
    told = _IN_ITS_FILE.get(name) or _OTHER_PLATFORMS.get(name) or licence(distribution.metadata.json)
    return Component(name, Version(distribution.version).public, told, purpose, needs)


def licence(fields: Mapping[str, str | list[str]]) -> str:
    """Licence of a distribution as an SPDX expression: its own, else what its older fields say.

    Raises
    ------
    ValueError
        If they say nothing that is known here.
    """
    if expression := fields.get("license_expression"):
        return str(expression)
    told = [str(text).rpartition(" :: ")[2] for text in fields.get("classifier", ()) if text.startswith("License :: ")]
    told.append(str(fields.get("license", "")).strip())
    for text in told:
        with suppress(InvalidLicenseExpression):
            return canonicalize_license_expression(_SPDX.get(text, text))
    raise ValueError(f"{fields['name']}: no licence is known by the name of {[text[:60] for text in told]}.")


def table() -> str:
    """The licences of all distributions, for people."""
    pinned = pins()
    found = {name: Component(name, pinned[name], spdx, "Windows", ()) for name, spdx in _OTHER_PLATFORMS.items()}
    found |= {each.name: each for each in installation()}
    rows = [f"| {c.name} | {c.version} | {c.licence} | {c.purpose} |" for _, c in sorted(found.items())]
    head = (
        "# Software of others\n\n"
        "What an installation of crashfuse with all its extras brings along, in the versions of `constraints.txt`,\n"
        "and under which licence (SPDX). `python -m supply_chain.inventory` makes it from the metadata of what is\n"
        "installed; a test checks it. What a user installs is under permissive licences, but for MPL-2.0, which asks\n"
        "for changes to its own files only. LGPL is npTDMS alone, which only tests use, to compare with.\n\n"
        "torch's builds for CUDA, PyPI's for Linux among them, also bring NVIDIA's libraries (`nvidia-*`, `cuda-*`:\n"
        "NVIDIA's own licence, which lets users run them) and triton (MIT). Builds for CPUs do without.\n\n"
        "| Distribution | Version | Licence | Needed for |\n| --- | --- | --- | --- |\n"
    )
    return head + "\n".join(rows) + "\n"


def sbom() -> str:
    """The same as a bill of materials in CycloneDX 1.6, with who needs whom; the same bytes from the same versions."""
    version = metadata.version("crashfuse")
    components = installation()
    wanted = {canonicalize_name(each.name) for required in required_for().values() for each in required}
    references = {each.name: f"pkg:pypi/{each.name}@{each.version}" for each in components}
    itself = f"pkg:pypi/crashfuse@{version}"
    document = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, ' '.join([itself, *references.values()]))}",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": itself,
                "name": "crashfuse",
                "version": version,
                "licenses": [{"license": {"id": "MIT"}}],
                "purl": itself,
            }
        },
        "components": [
            {
                "type": "library",
                "bom-ref": references[each.name],
                "name": each.name,
                "version": each.version,
                "scope": "required" if each.purpose == "use" else "optional",
                "licenses": [{"expression": each.licence}],
                "purl": references[each.name],
            }
            for each in components
        ],
        "dependencies": [
            {"ref": itself, "dependsOn": [references[name] for name in sorted(wanted)]},
            *(
                {"ref": references[each.name], "dependsOn": [references[name] for name in each.needs]}
                for each in components
            ),
        ],
    }
    return json.dumps(document, indent=1) + "\n"


def _wanted() -> set[str]:
    """Names that the project itself asks for."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    required = [
        *project["dependencies"],
        *(text for each in project["optional-dependencies"].values() for text in each),
    ]
    return {canonicalize_name(Requirement(text).name) for text in required}


def main() -> None:
    """Write both files."""
    TABLE.write_text(table(), encoding="utf-8")
    SBOM.write_text(sbom(), encoding="utf-8")
    print(f"{len(installation())} distributions: {TABLE.name}, {SBOM.name}")


if __name__ == "__main__":
    main()
