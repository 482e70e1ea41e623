"""A package of somebody else, built and installed beside crashfuse, adds an approach and a format."""

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import DATA, ROOT

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel of the example package unpacked, as pip installs it."""
    source, wheels, there = (tmp_path_factory.mktemp(name) for name in ("source", "wheels", "installed"))
    shutil.copytree(DATA / "scaled_cae", source, dirs_exist_ok=True)
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(wheels)]
    subprocess.run(build, cwd=source, check=True, capture_output=True)
    with zipfile.ZipFile(next(wheels.glob("*.whl"))) as wheel:
        wheel.extractall(there)
    return there


SHOW = """
import scaled_cae.polar  # before crashfuse, which then does not look for what is half there
import contextlib, io, json, os, sys
import pytest

folder, place, *tests = sys.argv[1:]
wanted = "test_contracts or (TestCareless and (foreign or nothing_at_all or sound))"
with contextlib.redirect_stdout(io.StringIO()) as said:
    pytest.main(["-v", "-p", "no:cacheprovider", "-c", os.devnull, "-k", wanted, *tests])

import crashfuse
from crashfuse import cli
from crashfuse.approaches.registry import APPROACHES, create
from crashfuse.approaches.base import Settings
from crashfuse.readers.formats import FORMATS

shown = {"tested": said.getvalue()}
shown["known"] = ["scaled_cae" in APPROACHES, "polar" in FORMATS, "broken" in APPROACHES]


def command(name, *arguments):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        ended = cli.main([*arguments])
    shown[name] = [ended, out.getvalue(), err.getvalue()]


def refused(name, call):
    try:
        call()
    except crashfuse.CrashfuseError as error:
        shown[name] = str(error)


chosen = ["cae", "scaled_cae"]
scaled_cae.ScaledCae.in_words = "the CAE model times {factor}"
study = ["study", folder, "--held-out", "T3", "T4", "--workers", "1", "--out", f"{place}/study"]
command("study", *study, "--approach", *chosen)
given = ["--speed-kph", "56", "--front-weight-kg", "950", "--rear-weight-kg", "700"]
command("import", "import", f"{place}/P2.polar", "--out", f"{place}/imported", *given)

from streamlit.testing.v1 import AppTest

os.environ["CRASHFUSE_CAMPAIGN"] = folder
app = AppTest.from_file("app.py", default_timeout=60)
app.query_params.update({"test": "T3", "approaches": chosen})
app.run()
app.switch_page("pages/compare.py").run()
assert not app.exception
(figure,) = app.get("plotly_chart")
shown["legend"] = [trace["name"] for trace in json.loads(figure.proto.spec)["data"][:3]]
app.button_group(key="compare_tab").set_value("Ratings and metrics").run()
shown["table"] = app.table[0].value.to_string()

refused("broken approach", lambda: create("broken", Settings()))
refused("leaving approach", lambda: create("leaving", Settings()))
campaign = crashfuse.load_campaign(folder)
ways = {"failing": lambda *_: 1 / 0, "ending": lambda *_: sys.exit(3), "skipping": lambda *_: pytest.skip("no data")}
for name, fail in ways.items():
    scaled_cae.ScaledCae.predict = fail
    refused(f"{name} approach", lambda: crashfuse.predict(campaign, campaign.tests[0].condition, "scaled_cae"))
scaled_cae.polar._record = lambda *_: 1 / 0
command("failing reader", "import", f"{place}/P1.polar", "--out", f"{place}/c")
command("broken reader", "import", f"{place}/P1.lost", "--out", f"{place}/c")
command("broken reader by name", "import", f"{place}/P1.lost", "--out", f"{place}/c", "--format", "lost")
print(json.dumps(shown))
"""


CARELESS = """
import pytest
import scaled_cae.polar
import test_contracts


class TestCareless(test_contracts.TestPolar):
    @pytest.fixture(autouse=True)
    def careless(self, monkeypatch):
        monkeypatch.setattr(scaled_cae.polar, "_record", lambda name, content: 1 / 0)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a test in the package's format, two files that its readers break on, tests of a careless one."""
    folder = tmp_path_factory.mktemp("place")
    time_s = np.arange(-500, 1500) * 1e-4
    accel_g = -36 * np.sin(np.pi * time_s / 0.07) * ((time_s > 0) & (time_s < 0.07))
    (folder / "P2.polar").write_bytes(np.column_stack([time_s, accel_g]).tobytes())
    (folder / "P1.polar").write_bytes(b"123")
    (folder / "P1.lost").write_bytes(b"123")
    (folder / "test_careless.py").write_text(CARELESS, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def shown(installed: Path, place: Path, campaign_on_disk: Path) -> dict[str, Any]:
    """What one process with crashfuse and the package shows of it: its own tests, then all else, faults last."""
    path = os.pathsep.join([str(ROOT), str(installed)])
    environment = {**os.environ, "PYTHONPATH": path, "CRASHFUSE_CACHE": str(place / "cache")}
    tests = DATA / "scaled_cae" / "tests", place / "test_careless.py"
    command = [sys.executable, "-c", SHOW, *map(str, (campaign_on_disk, place, *tests))]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_what_it_adds_stands_beside_ours(shown: dict[str, Any], place: Path) -> None:
    """Imported before crashfuse it is known, too, but for the approach that cannot be loaded.

    Its approach is studied by the command line, in report, legend and table; its format recognised and imported.
    """
    assert shown["known"] == [True, True, False]
    ended, out, err = shown["study"]
    assert ended == 0, err
    assert re.search(r"^ *Scaled CAE +\d", out, re.MULTILINE)
    assert "the CAE model times {factor}" in out
    assert "Scaled CAE" in (place / "study" / "report.html").read_text(encoding="utf-8")
    assert "Scaled CAE" in " ".join(shown["legend"])
    assert "Scaled CAE" in shown["table"]
    ended, out, err = shown["import"]
    assert ended == 0, err
    assert out.startswith("P2: 34.8 mph (56.0 km/h)")


def test_what_breaks_in_it_is_told_as_its_own_fault(shown: dict[str, Any]) -> None:
    of_package = "of the package scaled-cae"
    nothing = "AttributeError: module 'scaled_cae' has no attribute 'Nothing'"
    for name, trouble in (
        ("broken", f"'broken' {of_package} cannot be used: {nothing}"),
        ("leaving", f"'leaving' {of_package} cannot be used: SystemExit"),
        ("ending", f"'scaled_cae' {of_package} failed: SystemExit: 3"),
        ("skipping", f"'scaled_cae' {of_package} failed: Skipped: no data"),
        ("failing", f"'scaled_cae' {of_package} failed: ZeroDivisionError: division by zero"),
    ):
        assert shown[f"{name} approach"] == f"The approach {trouble}. Tell its authors."


def test_so_is_what_breaks_in_its_readers(shown: dict[str, Any], place: Path) -> None:
    told = {name: shown[name][2].splitlines()[0] for name in shown if "reader" in name}
    assert all(shown[name][0] in (1, 2) for name in told)
    assert not (place / "c").exists()
    lost = (
        "The reader 'lost' of the package scaled-cae cannot be used: AttributeError: module 'scaled_cae.polar' has no "
    )
    assert told["failing reader"] == (
        "P1.polar: expected Polar, found the reader of the package scaled-cae failed: ZeroDivisionError: division by "
        "zero. Tell its authors; use another format."
    )
    assert lost in told["broken reader"]
    assert told["broken reader by name"].startswith(f"crashfuse: {lost}attribute 'LOST'.")


def test_its_own_tests_hold_it_to_both_contracts(shown: dict[str, Any]) -> None:
    """Ten tests of an approach and ten of a reader, one of which has nothing to test in this format."""
    ended = re.findall(r"::Test(?:ScaledCae|Polar)::\S+ ([A-Z]+)", shown["tested"])
    assert Counter(ended) == {"PASSED": 19, "SKIPPED": 1}, shown["tested"]


def test_a_reader_that_breaks_is_found_out_by_the_contract(shown: dict[str, Any]) -> None:
    """Its fault would be told to users in a sentence; to its authors it is a test that fails."""
    ended = re.findall(r"::TestCareless::test_\w*(?:foreign|nothing_at_all|sound)\S* ([A-Z]+)", shown["tested"])
    assert ended == ["FAILED"] * 4, shown["tested"]
    assert "the reader of the package scaled-cae failed: ZeroDivisionError: division by zero" in shown["tested"]


UNUSED = """
import sys
from crashfuse import cli
from crashfuse.approaches.registry import require_approach
from crashfuse.errors import CrashfuseError
from crashfuse.readers.formats import FORMATS

folder, place, source = sys.argv[1:]
few, at = ["--approach", "cae"], "--speed-mph 20 --front-weight-lb 2000 --rear-weight-lb 1500".split()
for command in (
    ["check", folder],
    ["study", folder, "--held-out", "T3", *few, "--workers", "1", "--out", f"{place}/study"],
    ["predict", folder, *at, *few, "--out", f"{place}/predicted"],
    ["next-test", folder, "--out", f"{place}/next"],
    ["import", source, "--format", "csv", "--out", f"{place}/imported"],
):
    cli.main(command)
    assert "slow_to_import" not in sys.modules, command
assert "slow" in FORMATS.declared
try:
    require_approach("slow")
except CrashfuseError as error:
    print(error)
"""


@pytest.mark.usefixtures("one_cache")
def test_what_is_not_used_is_not_imported(tmp_path: Path, campaign_on_disk: Path) -> None:
    """A package that hangs as it is imported is in the way of those alone who ask for what it adds."""
    there = tmp_path / "slow_to_import-1.0.dist-info"
    there.mkdir()
    (tmp_path / "slow_to_import.py").touch()
    (there / "METADATA").write_text("Metadata-Version: 2.1\nName: slow-to-import\nVersion: 1.0\n", encoding="utf-8")
    points = "[crashfuse.approaches]\nslow = slow_to_import:A\n[crashfuse.readers]\nslow = slow_to_import:R\n"
    (there / "entry_points.txt").write_text(points, encoding="utf-8")
    path = os.pathsep.join([str(ROOT), str(tmp_path)])
    command = [sys.executable, "-c", UNUSED, str(campaign_on_disk), str(tmp_path), str(campaign_on_disk / "tests")]
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    assert "The approach 'slow' of the package slow-to-import cannot be used: AttributeError" in done.stdout
