"""What is installed is pinned, hashed, licensed and listed; what is built holds what it should, and runs anywhere."""

import base64
import hashlib
import json
import os
import re
import socket
import subprocess
import sys
import tarfile
import time
import tomllib
import urllib.request
import zipfile
from collections.abc import Iterator
from importlib.metadata import Distribution, distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from supply_chain.audit import pins, problems
from tests.conftest import ROOT

HASHES, SBOM = ROOT / "supply_chain" / "hashes.txt", ROOT / "sbom.cdx.json"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

pytestmark = pytest.mark.slow

PERMISSIVE = {
    *("0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "ISC", "MIT", "MIT-0", "MIT-CMU"),
    *("AFL-2.1", "PSF-2.0", "Zlib", "Apache-2.0 WITH LLVM-exception", "The MIT License (MIT)"),
    *("3-Clause BSD License", "Apache License 2.0", "Apache Software License", "BSD", "BSD License", "MIT License"),
    *("Apache 2.0", "ISC License (ISCL)", "Python Software Foundation License"),
    *("MPL-2.0", "Mozilla Public License 2.0 (MPL 2.0)"),  # asks for changes to its own files only
}


def hashed() -> dict[str, tuple[str, list[str]]]:
    found = {}
    for entry in HASHES.read_text(encoding="utf-8").replace("\\\n", "").splitlines():
        requirement, *hashes = entry.split(" --hash=")
        name, version = requirement.partition(";")[0].strip().split("==")
        found[name] = version, [each.strip() for each in hashes]
    return found


def licensed() -> dict[str, tuple[str, str]]:
    _, _, *lines = (ROOT / "THIRD_PARTY.md").read_text(encoding="utf-8").splitlines()
    rows = (re.split(r"\s*\|\s*", line.strip("| ")) for line in lines)
    return {canonicalize_name(name): (version, licence) for name, version, licence in rows}


def bill() -> tuple[dict[str, str], dict[str, set[str]]]:
    """Version of each component of the bill of materials, and the names that each one, and the project, needs."""
    written = json.loads(SBOM.read_text(encoding="utf-8"))
    parts = {part["bom-ref"]: canonicalize_name(part["name"]) for part in written["components"]}
    names = {**parts, written["metadata"]["component"]["bom-ref"]: "crashfuse"}
    needs = {names[each["ref"]]: {names[ref] for ref in each.get("dependsOn", ())} for each in written["dependencies"]}
    return {parts[part["bom-ref"]]: part["version"] for part in written["components"]}, needs


def asked_for(*extras: str) -> dict[str, Requirement]:
    texts = [*PROJECT["dependencies"], *(text for extra in extras for text in PROJECT["optional-dependencies"][extra])]
    return {canonicalize_name(requirement.name): requirement for requirement in map(Requirement, texts)}


def test_all_three_lists_hold_every_pin_and_nothing_else() -> None:
    """If this fails, make them anew: docs/how-to/supply-chain.md. Nothing tells of the machine that made them."""
    pinned = pins()
    assert {name: version for name, (version, _) in hashed().items()} == pinned
    assert {name: version for name, (version, _) in licensed().items()} == pinned
    assert bill()[0] == pinned
    for name, (_, hashes) in hashed().items():
        assert hashes, name
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", each) for each in hashes), name
    for path in (HASHES, SBOM):
        assert not re.search(r"file:|index-url|find-links", path.read_text(encoding="utf-8"))


def test_what_the_project_asks_for_is_pinned_within_its_range() -> None:
    pinned, wanted = pins(), asked_for(*PROJECT["optional-dependencies"])
    assert [name for name, each in wanted.items() if not each.specifier.contains(pinned.get(name, "0"))] == []
    assert bill()[1]["crashfuse"] == set(wanted)


def test_what_pinned_distributions_need_is_pinned() -> None:
    pinned = pins()
    for distribution in distributions():
        if canonicalize_name(distribution.name) in pinned:
            for needed in map(Requirement, distribution.requires or ()):
                if needed.marker is None or needed.marker.evaluate({"extra": ""}):
                    assert canonicalize_name(needed.name) in pinned, f"{distribution.name} needs {needed.name}"


def test_no_licence_asks_users_to_publish_their_work() -> None:
    """All are permissive, but for NVIDIA's own, which lets users run its libraries, and what only tests use."""
    others = {
        name: licence
        for name, (_, licence) in licensed().items()
        if set(re.split(r" AND | OR |; ", licence)) - PERMISSIVE
    }
    cuda = {name for name in others if name.startswith(("nvidia-", "cuda-"))}
    tests_only = {"nptdms": "LGPL-3.0-only", "objective-rating-metrics": "UNKNOWN"}  # MIT, in its licence file
    assert {name: others[name] for name in others.keys() - cuda} == tests_only
    assert not tests_only.keys() & asked_for(*(PROJECT["optional-dependencies"].keys() - {"test"})).keys()
    assert {who for who, needed in bill()[1].items() if needed & tests_only.keys()} == {"crashfuse"}


@pytest.fixture
def toy(tmp_path: Path) -> Distribution:
    code = b"answer = 42\n"
    (tmp_path / "toy.py").write_bytes(code)
    info = tmp_path / "toy-1.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toy\nVersion: 1.5+cpu\n", encoding="utf-8")
    digest = base64.urlsafe_b64encode(hashlib.sha256(code).digest()).rstrip(b"=").decode()
    (info / "RECORD").write_text(f"toy.py,sha256={digest},{len(code)}\ntoy-1.5.dist-info/RECORD,,\n", encoding="utf-8")
    (found,) = distributions(path=[str(tmp_path)])
    return found


def test_an_audit_finds_other_versions_and_altered_and_missing_files(toy: Distribution, tmp_path: Path) -> None:
    """By the hash that was recorded on installing; a build for another device (+cpu) is the same version."""
    assert list(problems([toy], {"toy": "1.5"})) == []
    assert list(problems([toy], {"toy": "1.4"})) == ["toy: 1.5+cpu is installed, 1.4 is pinned."]
    assert list(problems([toy], {})) == ["toy: 1.5+cpu is installed, nothing is pinned."]
    (tmp_path / "toy.py").write_text("answer = 43\n", encoding="utf-8")
    assert list(problems([toy], {"toy": "1.5"})) == ["toy: toy.py was altered."]
    (tmp_path / "toy.py").unlink()
    assert list(problems([toy], {"toy": "1.5"})) == ["toy: toy.py is missing."]


def _built(checkout: Path, target: str, folder: Path) -> Path:
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(command, cwd=checkout, check=True, capture_output=True)
    (path,) = folder.iterdir()
    return path


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("source")
    with tarfile.open(_built(ROOT, "sdist", folder / "sdist")) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    return unpacked


@pytest.fixture(scope="module")
def installed(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that the source distribution builds, as it is installed, far from any checkout."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(_built(source, "wheel", tmp_path_factory.mktemp("wheel"))) as archive:
        archive.extractall(folder)  # noqa: S202 - our own wheel
    return folder


def _files(folder: Path) -> set[str]:
    found = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return {path.as_posix() for path in found if "__pycache__" not in path.parts}


def test_the_source_distribution_holds_what_a_test_needs(source: Path) -> None:
    assert _files(source / "tests") == _files(ROOT / "tests")
    assert _files(source / "sample_data") == _files(ROOT / "sample_data")
    hidden = {path.name for path in source.iterdir() if path.name.startswith(".")}
    assert hidden == {".github", ".gitignore", ".pre-commit-config.yaml", ".streamlit"}


def test_the_wheel_holds_the_package_and_the_dashboard_and_nothing_else(installed: Path) -> None:
    """All of the package, app.py with its pages and settings, the licences; no test, no data, nothing compiled."""
    package = {f"crashfuse/{name}" for name in _files(ROOT / "crashfuse")}
    pages = {f"crashfuse/dashboard/pages/{name}" for name in _files(ROOT / "pages")}
    own = {"crashfuse/dashboard/app.py", "crashfuse/dashboard/.streamlit/config.toml"}
    endings = {".py", ".pyi", ".typed", ".j2", ".css", ".html", ".js", ".safetensors", ".toml", ".md", ".csv"}
    assert {Path(name).suffix for name in package} == endings
    assert len(package) > 100
    assert len(pages) >= 5
    assert {name for name in _files(installed) if name.startswith("crashfuse/")} == package | pages | own
    (info,) = installed.glob("*.dist-info")
    licences = {"licenses/LICENSE", "licenses/THIRD_PARTY.md"}
    assert _files(info) == {"METADATA", "WHEEL", "RECORD", "entry_points.txt", *licences}


def _outside(installed: Path, folder: Path) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("CRASHFUSE", "PYTHON"))}
    return {**kept, "PYTHONPATH": str(installed), "CRASHFUSE_CACHE": str(folder / "cache")}


_FIRST_PAGE = """
from pathlib import Path
from streamlit.testing.v1 import AppTest
import crashfuse.cli, crashfuse.results.render
print(crashfuse.__file__)
app = AppTest.from_file(str(Path(crashfuse.__file__).parent / "dashboard" / "app.py"), default_timeout=120).run()
next(button for button in app.button if button.label == "Load the sample campaign").click().run()
assert not app.exception, app.exception
assert not app.error, app.error
assert crashfuse.cli.main(["check", "cache/sample"]) == 0
"""


def test_the_dashboard_opens_the_sample_outside_a_checkout(installed: Path, tmp_path: Path) -> None:
    """It finds its pages, and makes the sample, which is not shipped but is that of the checkout."""
    command, env = [sys.executable, "-c", _FIRST_PAGE], _outside(installed, tmp_path)
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(installed))
    made = tmp_path / "cache" / "sample" / "tests.csv"
    assert made.read_bytes() == (ROOT / "sample_data" / "tests.csv").read_bytes()


@pytest.fixture
def served(installed: Path, tmp_path: Path) -> Iterator[str]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "crashfuse", "app", "--port", str(port)]
    env = {**_outside(installed, tmp_path), "STREAMLIT_SERVER_HEADLESS": "true"}
    with (tmp_path / "log.txt").open("w") as log:
        server = subprocess.Popen(command, cwd=tmp_path, env=env, stdout=log, stderr=log)
        try:
            yield f"http://127.0.0.1:{port}"
        finally:
            server.terminate()
            server.wait(30)


def test_the_app_starts_outside_a_checkout(served: str) -> None:
    deadline = time.monotonic() + 90
    while True:
        try:
            with urllib.request.urlopen(f"{served}/_stcore/health") as answer:  # noqa: S310 - our own server
                assert answer.read() == b"ok"
            return
        except OSError:
            assert time.monotonic() < deadline, "The server did not start."
            time.sleep(0.2)
