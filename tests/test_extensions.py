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


def test_its_approach_stands_beside_ours(installed: Path, campaign_on_disk: Path, tmp_path: Path) -> None:
    """Studied by the command line, rated, in the report under its label."""
    out = tmp_path / "out"
    study = ("study", str(campaign_on_disk), "--held-out", "T3", "--workers", "1", "--out", str(out))
    done = run(installed, "-m", "crashfuse", *study, "--approach", "cae", "scaled_cae")
    assert done.returncode == 0, done.stderr
    assert "\nScaled CAE  " in done.stdout
    assert "Scaled CAE" in (out / "report.html").read_text(encoding="utf-8")


def test_its_own_tests_hold_it_to_both_contracts(installed: Path) -> None:
    """Ten tests of an approach and ten of a reader, one of which has nothing to test in this format."""
    own = DATA / "scaled_cae" / "tests"
    done = run(installed, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(own), "-c", os.devnull)
    assert done.returncode == 0, done.stdout
    assert "19 passed, 1 skipped" in done.stdout


def test_a_reader_that_breaks_is_found_out_by_the_contract(installed: Path, tmp_path: Path) -> None:
    """Its fault would be told to users in a sentence; to its authors it is a test that fails."""
    careless = "scaled_cae.polar._record = lambda name, content: 1 / 0\n"
    own = (DATA / "scaled_cae" / "tests" / "test_contracts.py").read_text(encoding="utf-8")
    test = tmp_path / "test_careless.py"
    test.write_text(f"{own}\n\nimport scaled_cae.polar\n\n{careless}", encoding="utf-8")
    wanted = "TestPolar and (hollow or foreign or nothing or sound)"
    done = run(installed, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(test), "-c", os.devnull, "-k", wanted)
    assert "4 failed" in done.stdout
    assert "the reader of the package scaled-cae failed: ZeroDivisionError: division by zero" in done.stdout


def test_it_may_be_imported_before_crashfuse(installed: Path) -> None:
    """By its own tests, say: what it imports of crashfuse does not look for it while it is half there."""
    code = (
        "import scaled_cae.polar\n"
        "from crashfuse.approaches.registry import APPROACHES\n"
        "from crashfuse.readers.formats import FORMATS\n"
        "print('scaled_cae' in APPROACHES, 'polar' in FORMATS)\n"
    )
    assert run(installed, "-c", code).stdout == "True True\n"


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


def test_what_breaks_in_it_is_told_as_its_own_fault(installed: Path, campaign_on_disk: Path) -> None:
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


def test_so_is_what_breaks_in_its_readers(installed: Path, tmp_path: Path) -> None:
    """One that fails while it reads, and one that cannot be loaded, asked for by name or needed by a file."""
    (tmp_path / "P1.polar").write_bytes(b"123")
    (tmp_path / "P1.lost").write_bytes(b"123")
    code = (
        "import sys, scaled_cae.polar\n"
        "from crashfuse import cli\n"
        "scaled_cae.polar._record = lambda *_: 1 / 0\n"
        "sys.exit(cli.main(['import', *sys.argv[1:]]))\n"
    )

    def told(name: str, *options: str) -> str:
        done = run(installed, "-c", code, str(tmp_path / name), "--out", str(tmp_path / "c"), *options)
        assert done.returncode in (1, 2)
        assert not (tmp_path / "c").exists()
        return done.stderr.splitlines()[0]

    lost = (
        "The reader 'lost' of the package scaled-cae cannot be used: AttributeError: module 'scaled_cae.polar' has no "
    )
    assert told("P1.polar") == (
        "P1.polar: expected Polar, found the reader of the package scaled-cae failed: ZeroDivisionError: division by "
        "zero. Tell its authors; use another format."
    )
    assert lost in told("P1.lost")
    assert told("P1.lost", "--format", "lost").startswith(f"crashfuse: {lost}attribute 'LOST'.")


def test_its_approach_stands_on_the_pages(installed: Path, campaign_on_disk: Path) -> None:
    """Chosen like ours: in the row of ratings, in the legend of the figure, in the tables."""
    code = (
        "import json, os\n"
        "from streamlit.testing.v1 import AppTest\n"
        "from crashfuse import load_campaign, run_study\n"
        f"os.environ['CRASHFUSE_CAMPAIGN'] = {str(campaign_on_disk)!r}\n"
        "chosen = ['cae', 'scaled_cae']\n"
        f"run_study(load_campaign({str(campaign_on_disk)!r}), held_out=['T3'], approaches=chosen, workers=1)\n"
        f"app = AppTest.from_file({str(ROOT / 'app.py')!r}, default_timeout=60)\n"
        "app.query_params.update({'test': 'T3', 'approaches': chosen})\n"
        "app.run()\n"
        "app.switch_page('pages/compare.py').run()\n"
        "assert not app.exception\n"
        "(figure,) = app.get('plotly_chart')\n"
        "print([trace['name'] for trace in json.loads(figure.proto.spec)['data'][:3]])\n"
        "app.button_group(key='compare_tab').set_value('Ratings and metrics').run()\n"
        "print(app.table[0].value.to_string())\n"
    )
    done = run(installed, "-c", code)
    assert done.returncode == 0, done.stderr
    legend, table = done.stdout.split("\n", maxsplit=1)
    assert "Scaled CAE" in legend
    assert "Scaled CAE" in table
