"""A cached result belongs to the code that computes it: other code leaves it alone, a comment changes nothing."""

import shutil
from pathlib import Path

import pytest

from crashfuse.execution.code_digest import code_digest
from tests.conftest import ROOT

EMULATOR, TIME, DISPLACEMENT, PREDICTION = (
    "crashfuse.cae.model",
    "crashfuse.approaches.time_domain.lf_tcn",
    "crashfuse.approaches.displacement_domain.approach",
    "crashfuse.study.estimate",
)
CODE = "\n\ndef another() -> int:\n    return 1\n"


def changed_by(tmp_path: Path, file: str, added: str) -> set[str]:
    """Modules whose digests change when this is added to the end of a file."""
    package = tmp_path / "crashfuse"
    shutil.copytree(ROOT / "crashfuse", package)
    path = package / file
    path.write_text(path.read_text(encoding="utf-8") + added, encoding="utf-8")
    modules = (EMULATOR, TIME, DISPLACEMENT, PREDICTION)
    return {module for module in modules if code_digest(module, package) != code_digest(module)}


@pytest.mark.parametrize("room", ["results/files", "execution/jobs", "cli/output", "readers/record", "study/running"])
def test_code_that_computes_none_of_it_counts_for_nothing(tmp_path: Path, room: str) -> None:
    """A report, a page or a reader can change without throwing trained networks away."""
    assert changed_by(tmp_path, f"{room}.py", CODE) == set()


@pytest.mark.parametrize(
    "added", ["# a comment\n", '"""A text."""\n', '\n\nif True:\n    """A text."""\n    # and a comment\n']
)
def test_what_is_only_read_by_people_counts_for_nothing(tmp_path: Path, added: str) -> None:
    file = "approaches/time_domain/lf_tcn.py"
    assert changed_by(tmp_path, file, added) == ({TIME, PREDICTION} if "if" in added else set())


@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("signals/pulse.py", {EMULATOR, TIME, DISPLACEMENT, PREDICTION}),
        ("cae/model.py", {EMULATOR, DISPLACEMENT, PREDICTION}),
        ("approaches/time_domain/network.py", {TIME, PREDICTION}),
        ("approaches/displacement_domain/gaussian_process.py", {DISPLACEMENT, PREDICTION}),
        ("study/config.py", {PREDICTION}),
        ("execution/workers.py", set()),
    ],
)
def test_code_counts_for_what_it_computes(tmp_path: Path, file: str, changed: set[str]) -> None:
    assert changed_by(tmp_path, file, CODE) == changed
