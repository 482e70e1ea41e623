"""The figure of a learning curve draws the means that the tables state."""

import numpy as np
import pandas as pd
import pytest

from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.learning import over_number_of_tests
from crashfuse.study.config import StudyConfig
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import one_more


def made_up(campaign: Campaign, approaches: tuple[str, ...], sizes: tuple[int, ...] = (1, 2, 3)) -> LearningCurve:
    """A curve of known means: 0.9 − 0.1 / n, with a band of 8 / n g where the approach has one."""
    rows = [
        {
            "n_tests": size, "chosen": "", "choice": choice, "held_out": test, "approach": name, "window_ms": 60.0,
            "overall": 0.6 if name == "cae" else 0.9 - 0.1 / size, "inside": np.nan if name == "cae" else 0.9,
            "half_width_g": np.nan if name == "cae" else 8 / size,
        }
        for size in sizes for choice in ("even", "random") for test in campaign.test_ids for name in approaches
    ]  # fmt: skip
    return LearningCurve(
        campaign, StudyConfig(approaches=approaches, windows_ms=(60.0,)), 1, pd.DataFrame(rows), (), 1.0
    )


def test_ratings_and_band_are_drawn_over_the_number_of_tests(campaign: Campaign) -> None:
    """Even and random choices, the raw CAE model as a level line from zero tests, the band's half width below."""
    drawn = {trace.name: trace for trace in over_number_of_tests(made_up(campaign, ("cae", "fused"))).data}
    level = drawn["CAE, without any test"]
    assert list(level.x) == [0, 5]
    assert list(level.y) == pytest.approx([0.6, 0.6])
    for way in ("evenly over speed", "at random"):
        assert list(drawn[f"Fused, {way}"].y) == pytest.approx([0.8, 0.85, 0.9 - 0.1 / 3])
    band = drawn["Fused"]
    assert band.yaxis == "y2"
    assert list(band.x) == [1, 2, 3]
    assert list(band.y) == pytest.approx([8, 4, 8 / 3])


def test_one_more_test_is_drawn_where_it_can_be_told(campaign: Campaign) -> None:
    """From four numbers of tests on, with its interval; not before."""
    name = "Fused, expected with one test more"
    assert name not in [trace.name for trace in over_number_of_tests(made_up(campaign, ("fused",))).data]
    curve = made_up(campaign, ("fused",), (1, 2, 3, 4))
    expected = {trace.name: trace for trace in over_number_of_tests(curve).data}[name]
    more = one_more(curve)
    assert more is not None
    assert expected.x[-1] == len(campaign.tests) + 1
    assert expected.y[-1] == pytest.approx(more.rating)
    assert expected.error_y.array[-1] == pytest.approx(more.upper - more.gain)
    assert expected.error_y.arrayminus[-1] == pytest.approx(more.gain - more.lower)


def test_the_raw_cae_model_alone_is_a_level_line(campaign: Campaign) -> None:
    """There is no band to draw, and nothing to extrapolate."""
    figure = over_number_of_tests(made_up(campaign, ("cae",)))
    assert [trace.name for trace in figure.data] == ["CAE, without any test"]
    assert "yaxis2" not in figure.layout
