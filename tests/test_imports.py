"""What a script waits for: each use loads what it needs, and no heavy package beyond that."""

import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = {"numpy", "numba", "scipy", "pandas", "sklearn", "pyarrow", "torch", "plotly", "streamlit", "pytest"}
HEAVY |= {"torch._dynamo"}  # the compiler
HEAVY |= {"scipy.stats", "scipy.signal"}  # each takes as long as the rest of SciPy
RATE = "import numpy as np, crashfuse; t = np.sin(np.arange(600) / 90); crashfuse.rate_iso18571(t, 0.9 * t, dt_s=1e-4)"
IN_TURN = """
import sys
from crashfuse import load_campaign
campaign = load_campaign(sys.argv[1])
print(*sys.modules)
import crashfuse
prediction = crashfuse.predict(campaign, campaign.tests[0].condition, "cae")
prediction.metrics
prediction.plot()
print(*sys.modules)
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.approaches.time_domain.config import TcnConfig
TimeDomain(TcnConfig(channels=6, dilations=(1,), epochs=1, min_steps=2, members=2)).fit(campaign)
print(*sys.modules)
"""


def loaded(program: str, *arguments: str) -> list[set[str]]:
    """The heavy packages that a fresh interpreter has wherever the program prints all its modules."""
    done = subprocess.run([sys.executable, "-c", program, *arguments], check=True, capture_output=True, text=True)
    return [HEAVY & set(line.split()) for line in done.stdout.splitlines()]


def test_the_package_itself_loads_nothing_heavy_and_a_rating_numpy_alone() -> None:
    assert loaded(f"import sys, crashfuse; print(*sys.modules)\n{RATE}\nprint(*sys.modules)") == [set(), {"numpy"}]


@pytest.mark.slow
def test_the_pages_load_no_networks() -> None:
    """Names and figures of all approaches are drawn without torch, which takes as long to load as all else."""
    (pages,) = loaded("import sys, crashfuse.ui.kit.frame, crashfuse.results.render; print(*sys.modules)")
    assert not {"torch", "scipy.stats", "scipy.signal", "sklearn", "pytest"} & pages


@pytest.mark.slow
def test_loading_predicting_and_training_load_one_after_the_other_what_each_needs(campaign_on_disk: Path) -> None:
    """A campaign no torch and no figures; a prediction without networks no torch; a training no torch.compile."""
    campaign, prediction, training = loaded(IN_TURN, str(campaign_on_disk))
    assert not {"torch", "plotly", "streamlit", "sklearn", "pytest"} & campaign
    assert not {"torch", "streamlit", "pytest"} & prediction
    assert {"torch", "torch._dynamo"} & training == {"torch"}
