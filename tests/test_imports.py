"""What a script waits for: each use loads what it needs, and no heavy package beyond that."""

import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = {"numpy", "numba", "scipy", "pandas", "sklearn", "pyarrow", "torch", "plotly", "streamlit", "pytest"}
HEAVY |= {"torch._dynamo"}  # the compiler
RATE = "import numpy as np, crashfuse; t = np.sin(np.arange(600) / 90); crashfuse.rate_iso18571(t, 0.9 * t, dt_s=1e-4)"
PREDICT = (
    "import sys, crashfuse; campaign = crashfuse.load_campaign(sys.argv[1]); at = campaign.tests[0].condition; "
    "prediction = crashfuse.predict(campaign, at, 'cae'); prediction.metrics; prediction.plot()"
)


def loaded(statement: str, *arguments: str) -> set[str]:
    """The heavy packages that a fresh interpreter has after a statement."""
    code = f"{statement}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code, *arguments], check=True, capture_output=True, text=True)
    return HEAVY & set(done.stdout.split())


def test_the_package_itself_loads_nothing_heavy() -> None:
    """Names are imported when they are first asked for."""
    assert loaded("import crashfuse") == set()


def test_a_rating_loads_numpy_alone() -> None:
    """Two arrays in, the rating out."""
    assert loaded(RATE) == {"numpy"}


@pytest.mark.slow
def test_a_campaign_is_loaded_without_torch() -> None:
    """Nor does it need figures or the dashboard."""
    assert not {"torch", "plotly", "streamlit", "sklearn", "pytest"} & loaded("from crashfuse import load_campaign")


@pytest.mark.slow
def test_a_prediction_with_tables_and_a_figure_needs_no_dashboard(campaign_on_disk: Path) -> None:
    """Streamlit is for pages, and pytest for the contracts."""
    assert not {"streamlit", "pytest"} & loaded(PREDICT, str(campaign_on_disk))
