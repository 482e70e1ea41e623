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
import urllib.request
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from supply_chain.audit import altered, unpinned, vulnerable
from supply_chain.hashes import HASHES, TORCH, entries, unknown
from supply_chain.inventory import CUDA, ROOT, SBOM, TABLE, Component, installation, licence, pins, sbom, table

pytestmark = pytest.mark.slow

PERMISSIVE = {
    *("0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "ISC", "MIT", "MIT-CMU", "PSF-2.0"),
    *("Zlib", "LLVM-exception"),
    "MPL-2.0",  # asks for changes to its own files only
}


@pytest.fixture(scope="module")
def installed() -> tuple[Component, ...]:
    """Everything that crashfuse and its extras need here."""
    return installation()


def test_everything_that_is_installed_is_pinned(installed: tuple[Component, ...]) -> None:
    """In this very version; if this fails, install with -c constraints.txt, or pin what is new."""
    assert unpinned(installed) == []


def test_every_pin_has_its_hashes() -> None:
    """And nothing else has: the files are made from the pins; what CUDA brings along is not for them."""
    hashed = entries(HASHES.read_text(encoding="utf-8") + TORCH.read_text(encoding="utf-8"))
    versions = dict(requirement.partition(";")[0].strip().split("==") for requirement in hashed)
    assert versions == {name: version for name, version in pins().items() if not name.startswith(CUDA)}
    assert all(hashes for hashes in hashed.values())
    assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", each) for hashes in hashed.values() for each in hashes)


def test_a_file_that_nobody_listed_is_told(tmp_path: Path) -> None:
    """One byte more, and it is not the file that was pinned."""
    path = tmp_path / "torch-2.13.0-py3-none-any.whl"
    path.write_bytes(b"something else")
    assert unknown([path]) == [path.name]


def test_the_table_of_licences_is_current() -> None:
    """If this fails: python -m supply_chain.inventory."""
    written = TABLE.read_text(encoding="utf-8").splitlines()
    assert [line for line in table().splitlines() if line not in written] == []
    pinned = pins()
    listed = dict(re.findall(r"^\| ([a-z0-9-]+) \| (\d\S*) \|", "\n".join(written), flags=re.MULTILINE))
    assert listed == {name: pinned.get(name) for name in listed}


def test_no_licence_asks_users_to_publish_their_work(installed: tuple[Component, ...]) -> None:
    """All are permissive; tests alone compare with a package under the LGPL, which nobody needs to use crashfuse."""
    others = {
        (each.name, each.purpose)
        for each in installed
        if set(re.findall(r"[^\s()]+", each.licence)) - {"AND", "OR", "WITH"} - PERMISSIVE
    }
    assert others == {("nptdms", "test")}


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"license_expression": "MIT OR Apache-2.0", "license": "something else"}, "MIT OR Apache-2.0"),
        ({"license": "BSD", "classifier": ["License :: OSI Approved :: MIT License"]}, "MIT"),
        ({"license": "MPL-2.0 AND MIT"}, "MPL-2.0 AND MIT"),
        ({"license": "GPL-3.0-only", "classifier": ["License :: OSI Approved"]}, "GPL-3.0-only"),
    ],
)
def test_a_licence_is_read_from_any_age_of_metadata(fields: dict[str, str | list[str]], expected: str) -> None:
    """The expression first, then classifiers, then what was written by hand."""
    assert licence({"name": "toy", **fields}) == expected


def test_an_unknown_licence_is_an_error() -> None:
    """Nobody's silence is taken for a permission."""
    with pytest.raises(ValueError, match="toy: no licence is known"):
        licence({"name": "toy", "license": "Ask me"})


def test_the_bill_of_materials_is_current_and_whole() -> None:
    """Each component is as installed, at its pin, and every reference leads to one; if not, run the inventory."""
    written = json.loads(SBOM.read_text(encoding="utf-8"))
    assert (written["bomFormat"], written["specVersion"]) == ("CycloneDX", "1.6")
    components = {each["bom-ref"]: each for each in written["components"]}
    for component in json.loads(sbom())["components"]:
        assert components[component["bom-ref"]] == component
    assert all(pins()[each["name"]] == each["version"] for each in components.values())
    known = {*components, written["metadata"]["component"]["bom-ref"]}
    assert {each["ref"] for each in written["dependencies"]} == known
    assert {ref for each in written["dependencies"] for ref in each["dependsOn"]} == set(components)


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Component:
    """A distribution of one module, installed with the hash of its file."""
    code = b"answer = 42\n"
    (tmp_path / "toy.py").write_bytes(code)
    info = tmp_path / "toy-1.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toy\nVersion: 1.5\n", encoding="utf-8")
    digest = base64.urlsafe_b64encode(hashlib.sha256(code).digest()).rstrip(b"=").decode()
    (info / "RECORD").write_text(f"toy.py,sha256={digest},{len(code)}\ntoy-1.5.dist-info/RECORD,,\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return Component("toy", "1.5", "MIT", "use", ())


def test_an_altered_or_missing_file_is_found(toy: Component, tmp_path: Path) -> None:
    """By the hash that was recorded when it was installed."""
    assert altered([toy]) == []
    (tmp_path / "toy.py").write_text("answer = 43\n", encoding="utf-8")
    assert altered([toy]) == ["toy: toy.py was altered."]
    (tmp_path / "toy.py").unlink()
    assert altered([toy]) == ["toy: toy.py is gone."]


def test_an_unpinned_version_is_found(toy: Component) -> None:
    """What nobody pinned is told, too."""
    assert unpinned([toy]) == ["toy 1.5 is installed, no version is pinned."]


def _advisory(number: int, events: list[dict[str, str]], **other: object) -> dict[str, object]:
    ranges = [{"type": "ECOSYSTEM", "events": events}]
    affected = {"package": {"ecosystem": "PyPI", "name": "Toy"}, "ranges": ranges, **other}
    return {"id": f"A-{number}", "summary": "it leaks", "affected": [affected]}


def test_known_vulnerabilities_are_found_without_a_network(toy: Component, tmp_path: Path) -> None:
    """In a zip of advisories: by range, by list; not what is fixed, to come, withdrawn, or another's."""
    start = {"introduced": "0"}
    advisories = [
        _advisory(1, [start, {"fixed": "1.6"}]),
        _advisory(2, [start, {"fixed": "1.5"}]),
        _advisory(3, [start, {"last_affected": "1.5"}]),
        _advisory(4, [{"introduced": "1.10"}]),
        _advisory(5, [start, {"fixed": "1.1"}, {"introduced": "1.5rc1"}]),
        _advisory(6, [], versions=["1.4", "1.5.0"]),
        {**_advisory(7, [start]), "withdrawn": "2026-01-01T00:00:00Z"},
        _advisory(8, [start], package={"ecosystem": "npm", "name": "toy"}),
    ]
    path = tmp_path / "all.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for advisory in advisories:
            archive.writestr(f"{advisory['id']}.json", json.dumps(advisory))
    assert vulnerable([toy], path) == [f"toy 1.5: A-{number}: it leaks" for number in (1, 3, 5, 6)]


def test_a_zip_without_advisories_is_no_good_news(toy: Component, tmp_path: Path) -> None:
    """It is an error."""
    with zipfile.ZipFile(tmp_path / "all.zip", "w"):
        pass
    with pytest.raises(ValueError, match="holds no advisory"):
        vulnerable([toy], tmp_path / "all.zip")


def _built(checkout: Path, target: str, folder: Path) -> Path:
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(command, cwd=checkout, check=True, capture_output=True)
    (path,) = folder.iterdir()
    return path


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from this checkout."""
    return _built(ROOT, "wheel", tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def unpacked(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel as it is installed, far from any checkout."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)  # noqa: S202 - our own wheel
    return folder


def test_the_wheel_holds_the_package_and_the_dashboard_and_nothing_else(wheel: Path) -> None:
    """Every module, app.py with its pages and settings, the licence; no test, no data, nothing compiled."""
    names = set(zipfile.ZipFile(wheel).namelist())
    code = {path.relative_to(ROOT).as_posix() for path in (ROOT / "crashfuse").rglob("*.py")}
    pages = {f"crashfuse/dashboard/pages/{path.name}" for path in (ROOT / "pages").glob("*.py")}
    assert len(code) > 80
    assert len(pages) >= 5
    assert {name for name in names if name.startswith("crashfuse/")} == {
        *code,
        *pages,
        "crashfuse/py.typed",
        "crashfuse/dashboard/app.py",
        "crashfuse/dashboard/.streamlit/config.toml",
    }
    info = {name.partition("/")[2] for name in names if not name.startswith("crashfuse/")}
    assert info == {"METADATA", "WHEEL", "RECORD", "entry_points.txt", "licenses/LICENSE"}


def test_the_source_distribution_builds_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    """To the byte; and it holds what a test needs, but no cache."""
    sdist = _built(ROOT, "sdist", tmp_path / "sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    (source,) = (tmp_path / "source").iterdir()
    assert _built(source, "wheel", tmp_path / "again").read_bytes() == wheel.read_bytes()
    assert (source / "tests" / "test_supply_chain.py").is_file()
    assert (source / "sample_data" / "tests.csv").is_file()
    assert {path.name for path in source.iterdir() if path.name.startswith(".")} == {".gitignore", ".streamlit"}


def _outside(unpacked: Path, folder: Path) -> dict[str, str]:
    """Surroundings in which the unpacked wheel is what is found."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("CRASHFUSE", "PYTHON"))}
    return {**kept, "PYTHONPATH": str(unpacked), "CRASHFUSE_CACHE": str(folder / "cache")}


def test_the_wheel_makes_and_reads_the_sample_outside_a_checkout(unpacked: Path, tmp_path: Path) -> None:
    """The sample is made, not shipped, and is the one of the checkout."""
    code = (
        "import sys, crashfuse, crashfuse.cli; print(crashfuse.__file__);"
        "sys.exit(crashfuse.cli.main(['sample', 'campaign']) or crashfuse.cli.main(['check', 'campaign']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=_outside(unpacked, tmp_path), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(unpacked))
    assert "Nothing is wrong." in done.stdout
    assert (tmp_path / "campaign" / "tests.csv").read_bytes() == (ROOT / "sample_data" / "tests.csv").read_bytes()


_FIRST_PAGE = """
from pathlib import Path
from streamlit.testing.v1 import AppTest
import crashfuse
app = AppTest.from_file(str(Path(crashfuse.__file__).parent / "dashboard" / "app.py"), default_timeout=120).run()
next(button for button in app.button if button.label == "Load the sample campaign").click().run()
assert not app.exception, app.exception
assert not app.error, app.error
"""


def test_the_dashboard_opens_the_sample_outside_a_checkout(unpacked: Path, tmp_path: Path) -> None:
    """It finds its pages, and makes the sample when it is asked for."""
    command, env = [sys.executable, "-c", _FIRST_PAGE], _outside(unpacked, tmp_path)
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "cache" / "sample" / "tests.csv").is_file()


@pytest.fixture
def served(unpacked: Path, tmp_path: Path) -> Iterator[str]:
    """Address of ``crashfuse app`` as it runs from the unpacked wheel."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "crashfuse", "app", "--port", str(port)]
    env = {**_outside(unpacked, tmp_path), "STREAMLIT_SERVER_HEADLESS": "true"}
    with (tmp_path / "log.txt").open("w") as log:
        server = subprocess.Popen(command, cwd=tmp_path, env=env, stdout=log, stderr=log)
        try:
            yield f"http://127.0.0.1:{port}"
        finally:
            server.terminate()
            server.wait(30)


def test_the_app_starts_outside_a_checkout(served: str) -> None:
    """The server answers on this machine's own address."""
    deadline = time.monotonic() + 90
    while True:
        try:
            with urllib.request.urlopen(f"{served}/_stcore/health") as answer:  # noqa: S310 - our own server
                assert answer.read() == b"ok"
            return
        except OSError:
            assert time.monotonic() < deadline, "The server did not start."
            time.sleep(0.2)
