"""Which files may be installed: the SHA-256 of each file that the index has of each pinned version.

``python -m supply_chain.hashes`` writes ``hashes.txt`` and ``hashes-torch.txt`` anew; it asks the package index, by uv,
and takes the versions of ``constraints.txt``. ``python -m supply_chain.hashes FILE …`` checks files against them.
"""

import hashlib
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from supply_chain.inventory import CUDA, PINS, ROOT

HASHES = ROOT / "supply_chain" / "hashes.txt"
TORCH = ROOT / "supply_chain" / "hashes-torch.txt"

_ELSEWHERE = {
    "torch==2.13.0": ("sha256:6746dbcbeb526eb61330b76b41ff1b4eb848951103a892eeb080dfa2b264667b",),
}
"""Files that the package index does not have: torch's build for CPUs, for Linux on x86-64 and Python 3.11."""

_HEAD = """\
# SHA-256 of every file of every pinned version but torch's, made by python -m supply_chain.hashes; for
# python -m pip install --no-deps --require-hashes -r supply_chain/hashes.txt
"""
_TORCH_HEAD = """\
# The same for torch. By hash pip would take the index's build, for CUDA, although one for CPUs is at hand: so fetch it
# by version, and check the file by python -m supply_chain.hashes FILE
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


def unknown(files: Iterable[Path]) -> list[str]:
    """Names of the files whose hash is not among those that were written."""
    both = entries("\n".join(path.read_text(encoding="utf-8") for path in (HASHES, TORCH)))
    known = {each for hashes in both.values() for each in hashes}
    return [path.name for path in files if f"sha256:{_digest(path)}" not in known]


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _write(path: Path, head: str, found: Mapping[str, tuple[str, ...]]) -> None:
    lines = [" \\\n    ".join([name, *(f"--hash={each}" for each in hashes)]) for name, hashes in found.items()]
    path.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
    print(f"{path.name}: {len(found)} distributions, {sum(map(len, found.values()))} files")


def main(files: list[str]) -> int:
    """Write both, or check files; returns the exit code: 1 if a file is unknown."""
    if files:
        strange = unknown(map(Path, files))
        print(*(f"{name} has no known hash." for name in strange), f"{len(files)} checked.", sep="\n")
        return 1 if strange else 0
    found = {
        requirement: hashes + _ELSEWHERE.get(requirement, ())
        for requirement, hashes in entries(compiled()).items()
        if not requirement.startswith(CUDA)
    }
    torch = {requirement: found.pop(requirement) for requirement in list(found) if requirement.startswith("torch==")}
    _write(HASHES, _HEAD, found)
    _write(TORCH, _TORCH_HEAD, torch)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
