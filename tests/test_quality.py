"""Lint, format and types are part of the tests, so that one command proves a change."""

import subprocess
import sys

import pytest

from tests.conftest import ROOT


@pytest.mark.parametrize("tool", [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"]])
@pytest.mark.slow
def test_the_code_is_clean(tool: list[str]) -> None:
    done = subprocess.run([sys.executable, "-m", *tool], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_streamlit_is_imported_by_the_front_end_only() -> None:
    """The core runs without the dashboard: only app.py, pages and crashfuse/ui know Streamlit."""
    core = [path for path in (ROOT / "crashfuse").rglob("*.py") if "ui" not in path.parts]
    assert core
    assert [path for path in core if "import streamlit" in path.read_text(encoding="utf-8")] == []
