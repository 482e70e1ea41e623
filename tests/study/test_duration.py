"""Steps that are expected of a computation are those that it reports."""

import pytest

from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import Watch
from crashfuse.study.config import StudyConfig
from crashfuse.study.running import run_study


@pytest.mark.parametrize("held_out", [("T1",), ("T1", "T2")])
@pytest.mark.usefixtures("quick_networks")
@pytest.mark.slow
def test_every_step_that_is_expected_is_reported_under_its_name(
    campaign: Campaign, tmp_path_factory: pytest.TempPathFactory, held_out: tuple[str, ...]
) -> None:
    """Of one prediction, in this process, and of several: emulator, networks, fits, predictions, repeatability."""
    expected: list[str] = []
    reported: dict[str, bool] = {}
    watch = Watch(
        lambda progress: reported.update({progress.step: progress.done == progress.total}),
        on_expected=expected.extend,
    )
    cache = Cache(tmp_path_factory.mktemp("cache"))
    run_study(campaign, StudyConfig(), held_out=held_out, cache=cache, watch=watch, workers=1)
    assert set(expected) - reported.keys() <= {"Repeatability"}  # with other processes one of them computes it
    assert "Training LF TCN" in expected
    assert all(
        reported[step] for step in expected if step in reported and step != "Checking the band on left-out tests"
    )
