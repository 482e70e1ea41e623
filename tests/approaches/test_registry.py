"""The registry is all that a new approach has to be entered in."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from crashfuse.approaches.registry import create
from crashfuse.approaches.settings import Settings
from crashfuse.errors import UsageError
from tests.conftest import ROOT

CONSTANT = '''
"""A pulse that brakes evenly."""

import numpy as np

from crashfuse.approaches.base import Approach, FittedState, Prediction
from crashfuse.execution.progress import SILENT
from crashfuse.signals.pulse import GRID_S


class Constant(Approach):
    name, label, in_words = "constant", "Constant", "the constant pulse"
    description = "the vehicle stops evenly within 100 ms."
    colour, dash, preference, learns_from_tests = "#123456", "dashdot", 5, False

    def fit(self, campaign, watch=SILENT):
        return self

    def predict(self, condition):
        return Prediction(condition, np.linspace(0, -20 * condition.speed_mps, GRID_S.size))

    def left_out(self, campaign):
        return {test.id: self.predict(test.condition) for test in campaign.tests}

    def learned(self):
        return FittedState({}, {})

    def restore(self, campaign, learned):
        return self
'''

SHOW = """
import json
from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.reporting.plots.palette import COLOURS, DASHES
from crashfuse.reporting.report.study import study_report
from crashfuse.reporting.result_tables import scores_table
from crashfuse.study.config import StudyConfig
from crashfuse.study.recommendation import recommend
from crashfuse.study.running import run_study
from crashfuse.testing import small_campaign

study = run_study(small_campaign(), StudyConfig(approaches=("cae", "constant")), held_out=["T2"], workers=1)
print(json.dumps({
    "default": StudyConfig().approaches,
    "label": LABELS["constant"],
    "curve": [COLOURS["constant"], DASHES["constant"]],
    "scores": sorted(set(scores_table(study)["approach"])),
    "advice": recommend(study).sentences,
    "report": CLASSES["constant"].description in study_report(study),
}))
"""


@pytest.mark.slow
def test_a_new_approach_is_one_module_and_one_entry(tmp_path: Path) -> None:
    """In a copy of the package: then a study rates it, figures draw it, the report and the recommendation name it."""
    package = tmp_path / "crashfuse"
    shutil.copytree(ROOT / "crashfuse", package, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "approaches" / "constant.py").write_text(CONSTANT, encoding="utf-8")
    registry = package / "approaches" / "registry.py"
    source = registry.read_text(encoding="utf-8").replace("    Fused,\n", "    Fused,\n    Constant,\n")
    entered = f"from crashfuse.approaches.constant import Constant\n{source}"
    registry.write_text(entered, encoding="utf-8")
    paths = os.pathsep.join(map(str, (tmp_path, ROOT)))  # the copy comes before the original
    done = subprocess.run(
        [sys.executable, "-c", SHOW], env={**os.environ, "PYTHONPATH": paths}, cwd=tmp_path, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout)
    assert shown["default"][-1] == "constant"
    assert shown["label"] == "Constant"
    assert shown["curve"] == ["#123456", "dashdot"]
    assert shown["scores"] == ["cae", "constant"]
    assert "the constant pulse" in shown["advice"][0]
    assert shown["report"]


def test_what_is_not_there_is_named_with_what_there_is() -> None:
    """An approach, a preset or a device that nobody knows."""
    with pytest.raises(UsageError, match="no approach 'crystal ball'; choose from cae, lf_tcn, "):
        create("crystal ball", Settings())
    with pytest.raises(UsageError, match="no preset 'slow'; choose from fast, paper"):
        Settings(preset="slow")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="no device 'abacus'; choose from auto, cpu, cuda"):
        Settings(device="abacus")  # type: ignore[arg-type]
