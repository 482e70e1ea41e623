"""The recipes on the architecture page work: applied to a copy of the program, they give what they promise."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from tests.conftest import ROOT, write_campaign

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r'```python title="([^":]+)(?:: in (\w+))?"\n(.*?)```', PAGE, flags=re.DOTALL)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the program to which all recipes were applied."""
    copy = tmp_path_factory.mktemp("program")
    ignored = shutil.ignore_patterns("__pycache__")
    for name in ("crashfuse", "pages", "tests", ".streamlit"):
        shutil.copytree(ROOT / name, copy / name, ignore=ignored)
    for name in ("app.py", "pyproject.toml"):
        shutil.copy(ROOT / name, copy)
    for path, table, code in BLOCKS:
        apply(copy / path, table, code)
    return copy


def apply(path: Path, table: str, code: str) -> None:
    """Write a file, add a function to one, or a line to a table in it with the imports above that line."""
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        path.write_text(code, encoding="utf-8")
        return
    text = path.read_text(encoding="utf-8")
    if not table:
        path.write_text(text.replace("\n\nclass _", f"\n\n{code}\n\nclass _", 1), encoding="utf-8")
        return
    *imports, entry = code.rpartition("\n\n") if code.startswith("from ") else ("", code)
    start = re.search(rf"^{table}\b.*[{{(\[]$", text, flags=re.MULTILINE)
    assert start, f"{path.name} has no {table}"
    end = re.compile(r"^[})\]]", re.MULTILINE).search(text, start.end())
    assert end
    text = text[: end.start()] + entry + text[end.start() :]
    path.write_text(re.sub(r"^from ", f"{imports[0]}\nfrom ", text, count=1, flags=re.MULTILINE), encoding="utf-8")


def run(program: Path, *arguments: str) -> str:
    """What Python prints in the copy of the program."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=program,
        env={**os.environ, "PYTHONPATH": str(program)},
        capture_output=True,
        text=True,
        encoding="utf-8",
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_there_are_five_recipes() -> None:
    """Each names the files that it touches, two at most."""
    recipes = re.split(r"^### ", PAGE, flags=re.MULTILINE)[1:]
    files = {recipe.partition("\n")[0]: set(re.findall(r'title="([^":]+)', recipe)) for recipe in recipes}
    assert list(files) == [f"A new {what}" for what in ("approach", "format", "metric", "figure", "page")]
    assert all(1 <= len(touched) <= 2 for touched in files.values())


@pytest.mark.slow
def test_a_new_approach_keeps_the_contract_and_is_studied(
    program: Path, campaign_on_disk: Path, tmp_path: Path
) -> None:
    """Registered, it is run by the contract test and known to the command line."""
    contract = "tests/approaches/test_contract.py"
    assert "passed" in run(program, "-m", "pytest", "-q", "-p", "no:cacheprovider", contract, "-k", "scaled_cae")
    study = ("study", str(campaign_on_disk), "--held-out", "T3", "--workers", "1", "--out", str(tmp_path / "out"))
    assert "\nScaled CAE  " in run(program, "-m", "crashfuse", *study, "--approach", "cae", "scaled_cae")


@pytest.mark.slow
def test_a_new_format_is_recognised_and_imported(program: Path, tmp_path: Path) -> None:
    """By its name; the rest is detected as in any format."""
    time_s = np.arange(1200) * 1e-4
    accel_g = -36 * np.sin(np.pi * time_s / 0.07) * (time_s < 0.07)
    told = {"speed_kph": 56, "step_s": 1e-4, "acceleration_g": accel_g.tolist()}
    (tmp_path / "V7.pulse.json").write_text(json.dumps(told), encoding="utf-8")
    weights = ("--front-weight-kg", "950", "--rear-weight-kg", "700")
    out = run(
        program, "-m", "crashfuse", "import", str(tmp_path / "V7.pulse.json"), "--out", str(tmp_path / "c"), *weights
    )
    assert out.startswith("V7: 34.8 mph (56.0 km/h)")


def test_a_new_metric_is_read_off_every_pulse(program: Path) -> None:
    """With its unit and interval."""
    code = """if True:
        import numpy as np
        from crashfuse.signals.metrics import METRIC_LABELS, pulse_metrics
        still = np.zeros((3, 1250))
        (metric,) = (m for m in pulse_metrics(still[0], 15.0, draws_mps2=still) if m.name == "crush_20")
        print(metric.text, metric.unit, METRIC_LABELS["crush_20"])"""
    assert run(program, "-c", code) == "300.0 [300.0, 300.0] mm Crush at 20 ms\n"


@pytest.mark.slow
def test_a_new_figure_draws_what_it_is_given(program: Path) -> None:
    """A curve for each test, over ms."""
    code = """if True:
        from crashfuse.reporting.plots.jerk import jerk
        from crashfuse.testing import small_campaign
        figure = jerk(small_campaign().tests)
        print(len(figure.data), round(float(figure.data[0].x.max())), figure.layout.yaxis.title.text)"""
    assert run(program, "-c", code) == "4 100 Jerk (g/ms)\n"


@pytest.mark.slow
def test_a_new_page_is_in_the_navigation_and_shows_its_figure(
    program: Path, campaign: Campaign, tmp_path: Path
) -> None:
    """Reached through app.py, as the others are."""
    folder = write_campaign(campaign, tmp_path / "campaign")
    code = f"""if True:
        import os
        os.environ["CRASHFUSE_CAMPAIGN"] = {str(folder)!r}
        from streamlit.testing.v1 import AppTest
        app = AppTest.from_file("app.py", default_timeout=60).run().switch_page("pages/jerk.py").run()
        assert not app.exception, app.exception
        print(app.title[0].value, len(app.get("plotly_chart")))"""
    assert run(program, "-c", code) == "Jerk 1\n"
