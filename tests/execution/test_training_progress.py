"""A watch keeps what steps report, and draws what networks say of their training as the pages do."""

import numpy as np
import pytest

from crashfuse import StudyConfig, run_study, watching
from crashfuse.campaign import Campaign
from crashfuse.execution.training_progress import Watched


def watched() -> Watched:
    return Watched(lambda _: None)


def test_a_step_that_starts_over_starts_a_new_curve() -> None:
    watch = watched()
    for _ in range(2):
        for i in range(3):
            watch.report("Fit", i, 3, loss=float(i))
    assert watch.steps["Fit"].curves["loss"] == [(0, 0), (1, 1), (2, 2)]


def test_a_long_curve_is_thinned_but_keeps_its_end() -> None:
    """Whatever is reported, a figure gets at most about a thousand points."""
    watch = watched()
    for i in range(5000):
        watch.report("Train", i, 5000, loss=float(i))
    points = watch.steps["Train"].curves["loss"]
    assert len(points) <= 1000
    assert points[0] == (0, 0)
    assert points[-1] == (4999, 4999)


@pytest.mark.slow
@pytest.mark.usefixtures("quick_networks")
def test_the_losses_of_a_training_are_those_of_its_result(campaign: Campaign) -> None:
    """What is drawn while networks train is what the figure of the result draws: the mean over the networks."""
    with watching() as watch:
        study = run_study(campaign, StudyConfig(("lf_tcn",)), held_out=["T2"], workers=1, watch=watch)
    result = {trace.name: trace.y for trace in study.plot("T2", "training").data}
    live = {trace.name: trace.y for trace in watch.plot("Training LF TCN").data}
    assert list(live) == list(result) == ["Training error", "Error on held-back CAE runs"]
    for name, losses in live.items():
        np.testing.assert_allclose(losses, result[name], rtol=1e-3)  # the result keeps four digits
