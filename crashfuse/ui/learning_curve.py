"""How many tests are enough: the learning curve of a campaign, and what one more test would buy."""

import math
from collections.abc import Hashable
from dataclasses import dataclass, replace

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.errors import DataError
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import Watch
from crashfuse.reporting.report import learning_curve_report
from crashfuse.reporting.report.prediction import LEARNING_CURVE_MEANING, ONE_MORE_MEANING
from crashfuse.reporting.result_tables import curve_table, gains_table
from crashfuse.study.config import StudyConfig
from crashfuse.study.learning_curve import CURVE_CONFIG, LearningCurve, is_curve_cached, learning_curve
from crashfuse.study.one_more_test import Cost, sentences
from crashfuse.ui.chosen import View
from crashfuse.ui.computation import Request, said_of
from crashfuse.ui.downloads import download_report, download_table
from crashfuse.ui.figures import show_figure
from crashfuse.ui.panel import result_or_none
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain


@dataclass(frozen=True)
class LearningCurveRequest(Request[LearningCurve]):
    """Predict the tests of a campaign from fewer of the others."""

    campaign: Campaign
    config: StudyConfig

    @property
    def key(self) -> Hashable:  # noqa: D102
        return "learning curve", said_of(self.campaign), self.config

    @property
    def title(self) -> str:  # noqa: D102
        return f"{self.campaign.name}: predict tests from fewer of the others"

    def work(self, watch: Watch) -> LearningCurve:  # noqa: D102
        return learning_curve(self.campaign, self.config, watch=watch)

    def in_cache(self) -> bool:  # noqa: D102
        return is_curve_cached(self.campaign, self.config, Cache())


def show_learning_curve(view: View, config: StudyConfig) -> None:
    """Show rating, band and decided verdicts over the number of tests, for the raw CAE model and fused."""
    campaign = view.campaign
    st.markdown(
        "How good would the prediction be with fewer tests, and what would one more add? Parts of the tests, evenly "
        "chosen over speed and at random, predict all the others."
    )
    settings = replace(CURVE_CONFIG, seed=config.seed, device=config.device)
    found = result_or_none(
        LearningCurveRequest(campaign, settings),
        invitation="This has not been computed for this campaign yet. It takes a minute or more the first time; "
        "meanwhile you can work on the other pages.",
        button=f"Predict from 1 to {len(campaign.tests) - 1} tests",
    )
    if found is None:
        return
    criteria = view.folder / "criteria.toml"
    if criteria.is_file():
        try:
            found = found.decided(criteria)
        except DataError as error:
            st.warning(plain(str(error.problems[0])), icon=":material/error:")
    curve = found.over(view.display.window_ms)
    amount = st.number_input(
        "Cost of one test", min_value=0.0, value=None, step=1000.0, format="%.0f", placeholder="optional, any currency",
        key="cost", persist_state="session", width=260,
        help="In any currency. Gains are then also given as the cost of one hundredth of rating.",
    )  # fmt: skip
    cost = Cost(amount) if amount and 0 < amount < math.inf else None  # a link may hold any number
    st.info("  \n".join(plain(sentence) for sentence in sentences(curve, cost)), icon=":material/science:")
    show_figure(
        found.plot(display=view.display),
        alt="Mean rating of tests not learned from, width of the band and decided verdicts, over the number of tests",
        name="learning curve",
    )
    st.caption(
        f"{LEARNING_CURVE_MEANING} Points: means with their standard error; shaded: the central 80 % of the single "
        f"ratings. {campaign.rating_basis}."
    )
    if not (steps := gains_table(curve, cost)).empty:
        st.markdown("**What further tests gained**")
        show_table(steps, "gains")
        st.caption(ONE_MORE_MEANING)
    with st.expander("All means", icon=":material/table:"):
        show_table(curve_table(curve, view.display), "learning curve")
    with st.container(horizontal=True):
        download_table("learning_curve.csv", lambda: found.table, campaign.name)
        download_report(lambda: learning_curve_report(curve, cost, view.display), campaign.name, "learning_curve.html")
