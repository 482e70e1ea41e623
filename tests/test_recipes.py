"""The recipes on the architecture page work: applied to a copy of the program, they give what they promise."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.slow

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r'```python title="([^":]+)(?:: in (\w+))?"\n(.*?)```', PAGE, flags=re.DOTALL)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the program to which all recipes were applied."""
    copy = tmp_path_factory.mktemp("program")
    being_written = shutil.ignore_patterns("*.pyc.*")  # by other processes; what is compiled is taken along
    for name in ("crashfuse", "pages", "tests", ".streamlit"):
        shutil.copytree(ROOT / name, copy / name, ignore=being_written)
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
        env={**os.environ, "PYTHONPATH": str(program), "CRASHFUSE_CACHE": str(program / "cache")},
        capture_output=True,
        text=True,
        encoding="utf-8",
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_there_are_five_recipes() -> None:
    recipes = re.split(r"^### ", PAGE, flags=re.MULTILINE)[1:]
    files = {recipe.partition("\n")[0]: set(re.findall(r'title="(?!tests)([^":]+)', recipe)) for recipe in recipes}
    assert list(files) == [f"A new {what}" for what in ("approach", "format", "metric", "figure", "page")]
    assert all(1 <= len(touched) <= 2 for touched in files.values())


SHOW = """
import contextlib, io, json, os, sys
import pytest  # which wants to be there before what it looks into
with contextlib.redirect_stdout(io.StringIO()) as said:
    contract = pytest.main(["-q", "-p", "no:cacheprovider", "tests/approaches/test_contract.py", "-k", "scaled_cae"])
with contextlib.redirect_stdout(io.StringIO()) as of_reader:
    read = pytest.main(["-q", "-p", "no:cacheprovider", "tests/readers/test_contract.py", "-k", "json"])
import numpy as np
from crashfuse import cli, load_campaign
from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.results.plots.jerk import jerk
from crashfuse.results.plots.palette import (COLOURS)
from crashfuse.results.study import study_report
from crashfuse.results.result_tables import scores_table
from crashfuse.signals.metrics import METRIC_LABELS, pulse_metrics
from crashfuse.study.config import StudyConfig
from crashfuse.study.recommendation import recommend
from crashfuse.study.running import run_study
from streamlit.testing.v1 import AppTest

folder, place = sys.argv[1:]
shown, campaign = {"contract": [contract, said.getvalue()]}, load_campaign(folder)
shown["contract of readers"] = [read, of_reader.getvalue()]


def printed(*arguments):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert cli.main([*arguments]) == 0
    return out.getvalue()


config = StudyConfig(approaches=("cae", "scaled_cae"))
study = run_study(campaign, config, held_out=["T3"], workers=1)
shown["approach"] = {
    "default": [*StudyConfig().approaches],
    "label": LABELS["scaled_cae"],
    "colour": COLOURS["scaled_cae"],
    "scores": sorted(set(scores_table(study)["approach"])),
    "recommended": "the scaled CAE model" in recommend(study).sentences[0],
    "report": CLASSES["scaled_cae"].description in study_report(study),
}
options = ["--held-out", "T3", "--workers", "1", "--out", f"{place}/out", "--approach", *config.approaches]
shown["studied"] = printed("study", folder, *options)
weights = ["--front-weight-kg", "950", "--rear-weight-kg", "700"]
shown["imported"] = printed("import", f"{place}/V7.pulse.json", "--out", f"{place}/c", *weights)
still = np.zeros((3, 1250))
(metric,) = (m for m in pulse_metrics(still[0], 15.0, draws_mps2=still) if m.name == "crush_20")
short = [m.value for m in pulse_metrics(still[0, :100], 15.0) if m.name == "crush_20"]
shown["metric"] = [metric.text_with_unit, METRIC_LABELS["crush_20"], *short]
figure = jerk(campaign.tests).figure()
shown["figure"] = [len(figure.data), round(float(figure.data[0].x.max())), figure.layout.yaxis.title.text]
os.environ["CRASHFUSE_CAMPAIGN"] = folder
app = AppTest.from_file("app.py", default_timeout=60).run().switch_page("pages/jerk.py").run()
assert not app.exception, app.exception
shown["page"] = [app.title[0].value, len(app.get("plotly_chart"))]
print(json.dumps(shown))
"""


@pytest.fixture(scope="module")
def shown(program: Path, campaign_on_disk: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What one process shows of all that was added."""
    place = tmp_path_factory.mktemp("place")
    time_s = np.arange(1200) * 1e-4
    accel_g = -36 * np.sin(np.pi * time_s / 0.07) * (time_s < 0.07)
    told = {"speed_kph": 56, "step_s": 1e-4, "acceleration_g": accel_g.tolist()}
    (place / "V7.pulse.json").write_text(json.dumps(told), encoding="utf-8")
    found: dict[str, Any] = json.loads(run(program, "-c", SHOW, str(campaign_on_disk), str(place)))
    return found


def test_a_new_approach_keeps_the_contract(shown: dict[str, Any]) -> None:
    ended, said = shown["contract"]
    assert ended == 0, said
    assert re.search(r"^10 passed", said, flags=re.MULTILINE), said


def test_a_new_approach_is_studied(shown: dict[str, Any]) -> None:
    found = shown["approach"]
    assert found["default"][-1] == "scaled_cae"
    assert (found["label"], found["colour"]) == ("Scaled CAE", "#8C6D1F")
    assert found["scores"] == ["cae", "scaled_cae"]
    assert found["recommended"]
    assert found["report"]
    assert re.search(r"^ *Scaled CAE +\d", shown["studied"], re.MULTILINE)


def test_a_new_format_metric_figure_and_page_are_there(shown: dict[str, Any]) -> None:
    """The format is imported by its name, its reader keeps the contract; the metric has its unit and interval.

    The figure has a curve for each test, over ms; the page is reached through app.py, as the others are.
    """
    ended, said = shown["contract of readers"]
    assert ended == 0, said
    assert shown["imported"].startswith("V7: 34.8 mph (56.0 km/h)")
    assert shown["metric"] == ["300.0 [300.0, 300.0] mm", "Crush at 20 ms", None]
    assert shown["figure"] == [4, 100, "Jerk (g/ms)"]
    assert shown["page"] == ["Jerk", 1]
