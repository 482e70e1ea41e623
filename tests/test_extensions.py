"""A package of somebody else, built and installed beside crashfuse, adds an approach and a format."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

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


def run(installed: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Python with crashfuse and the package."""
    path = os.pathsep.join([str(ROOT), str(installed)])
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, encoding="utf-8"
    )


def test_its_approach_stands_beside_ours_and_keeps_the_contract(
    installed: Path, campaign_on_disk: Path, tmp_path: Path
) -> None:
    """Studied by the command line, rated, in the report under its label; run by the contract's own tests."""
    out = tmp_path / "out"
    study = ("study", str(campaign_on_disk), "--held-out", "T3", "--workers", "1", "--out", str(out))
    done = run(installed, "-m", "crashfuse", *study, "--approach", "cae", "scaled_cae")
    assert done.returncode == 0, done.stderr
    assert "\nScaled CAE  " in done.stdout
    assert "Scaled CAE" in (out / "report.html").read_text(encoding="utf-8")
    test = tmp_path / "test_theirs.py"
    test.write_text(
        "from crashfuse.testing import ApproachContract\nfrom scaled_cae import ScaledCae\n\n\n"
        "class TestScaledCae(ApproachContract):\n    approach = ScaledCae\n",
        encoding="utf-8",
    )
    done = run(installed, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(test), "-c", os.devnull)
    assert done.returncode == 0, done.stdout
    assert "10 passed" in done.stdout


def test_its_format_is_recognised_and_imported(installed: Path, tmp_path: Path) -> None:
    """By the name of a file, as ours are."""
    time_s = np.arange(-500, 1500) * 1e-4
    accel_g = -36 * np.sin(np.pi * time_s / 0.07) * ((time_s > 0) & (time_s < 0.07))
    (tmp_path / "P1.polar").write_bytes(np.column_stack([time_s, accel_g]).tobytes())
    given = ("--speed-kph", "56", "--front-weight-kg", "950", "--rear-weight-kg", "700")
    source, out = str(tmp_path / "P1.polar"), str(tmp_path / "c")
    done = run(installed, "-m", "crashfuse", "import", source, "--out", out, *given)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("P1: 34.8 mph (56.0 km/h)")


def test_what_breaks_in_it_is_told_as_its_own_fault(installed: Path, campaign_on_disk: Path, tmp_path: Path) -> None:
    """What cannot be loaded, and what fails while it reads: one sentence that names the package, no traceback."""
    code = (
        "import crashfuse\n"
        "from crashfuse.approaches.registry import APPROACHES, create\n"
        "from crashfuse.approaches.settings import Settings\n"
        "print('broken' in APPROACHES)\n"
        "try:\n    create('broken', Settings())\nexcept crashfuse.UsageError as error:\n    print(error)\n"
        "import scaled_cae\n"
        "scaled_cae.ScaledCae.predict = lambda *_: 1 / 0\n"
        f"campaign = crashfuse.load_campaign({str(campaign_on_disk)!r})\n"
        "try:\n    crashfuse.predict(campaign, campaign.tests[0].condition, 'scaled_cae')\n"
        "except crashfuse.CrashfuseError as error:\n    print(error)\n"
    )
    told = run(installed, "-c", code).stdout.splitlines()
    assert told == [
        "False",
        "The approach 'broken' of the package scaled-cae cannot be used: AttributeError: module 'scaled_cae' has no "
        "attribute 'Nothing'. Tell its authors.",
        "The approach 'scaled_cae' of the package scaled-cae failed: ZeroDivisionError: division by zero. Tell its "
        "authors.",
    ]
    (tmp_path / "P1.polar").write_bytes(b"123")
    given = ("--speed-kph", "56", "--front-weight-kg", "950", "--rear-weight-kg", "700")
    done = run(installed, "-m", "crashfuse", "import", str(tmp_path / "P1.polar"), "--out", str(tmp_path / "c"), *given)
    assert done.returncode == 1
    assert "P1.polar: expected Polar, found the reader of the package scaled-cae failed: ValueError" in done.stderr
    assert "Traceback" not in done.stderr
