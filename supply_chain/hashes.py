"""Which files may be installed: the SHA-256 of each file that the index has of each pinned version.

``python -m supply_chain.hashes`` writes ``hashes.txt`` anew; it asks the package index, by uv, and takes the
versions of ``constraints.txt``.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from supply_chain.inventory import CUDA, PINS, ROOT

HASHES = ROOT / "supply_chain" / "hashes.txt"

_ELSEWHERE = {
    "torch==2.13.0": ("sha256:6746dbcbeb526eb61330b76b41ff1b4eb848951103a892eeb080dfa2b264667b",),
}
"""Files that the package index does not have: torch's build for CPUs, for Linux on x86-64 and Python 3.11."""

_HEAD = """\
# SHA-256 of every file of every pinned version, made by python -m supply_chain.hashes; for
# python -m pip install --no-deps --require-hashes -r supply_chain/hashes.txt
# (without the libraries that torch's builds for CUDA bring along).
"""


def compiled() -> str:
    """What uv finds for all extras, on any platform."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "hashes.txt"
        command = ["-m", "uv", "pip", "compile", "--quiet", "--universal", "--all-extras", "--generate-hashes"]
        options = ["--no-annotate", "--no-header", "--python-version", "3.11", "-c", str(PINS), "-o", str(out)]
        subprocess.run([sys.executable, *command, *options, str(ROOT / "pyproject.toml")], check=True)
        return out.read_text(encoding="utf-8")


def entries(text: str) -> dict[str, tuple[str, ...]]:
    """Hashes by requirement (name, version and marker) of a file of requirements."""
    lines = (line for line in text.replace("\\\n", "").splitlines() if line and not line.startswith("#"))
    parts = (line.split(" --hash=") for line in lines)
    return {requirement.strip(): tuple(each.strip() for each in hashes) for requirement, *hashes in parts}


def main() -> None:
    """Write the file."""
    found = {
        requirement: hashes + _ELSEWHERE.get(requirement, ())
        for requirement, hashes in entries(compiled()).items()
        if not requirement.startswith(CUDA)
    }
    lines = [" \\\n    ".join([name, *(f"--hash={each}" for each in hashes)]) for name, hashes in found.items()]
    HASHES.write_text(_HEAD + "\n".join(lines) + "\n", encoding="utf-8")
    print(f"{len(found)} distributions, {sum(map(len, found.values()))} files: {HASHES.name}")


if __name__ == "__main__":
    main()
