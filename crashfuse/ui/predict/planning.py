"""Planning: pulse metrics over impact speed, and which test to run next."""

import streamlit as st

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.reporting.glossary import TTZV
from crashfuse.reporting.plots.next_test import next_tests
from crashfuse.reporting.plots.sweep import sweep_figure
from crashfuse.reporting.report import next_test_report, sweep_report
from crashfuse.reporting.report.prediction import NEXT_TEST_MEANING
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.study.next_test import ConditionRange, NextTest, next_tests_table, rank_next_tests
from crashfuse.study.sweep import missing_over_speed, sweep_table, weights_sentence
from crashfuse.ui import page_tables
from crashfuse.ui.computation import SweepRequest
from crashfuse.ui.downloads import download_report, download_table
from crashfuse.ui.figures import show_figure
from crashfuse.ui.panel import result_or_none
from crashfuse.ui.predict.answer import Answer
from crashfuse.ui.tables import show_table
from crashfuse.units import LB, MPH

_BEST = 5


def show_over_speed(answer: Answer) -> None:
    """Show every metric over speed, at the weights chosen above."""
    view, condition, request = answer.view, answer.condition, answer.request
    st.markdown("Predictions of every approach over impact speed, at the weights above, with the tests as points.")
    sweeps = result_or_none(
        SweepRequest(request, answer.fitted, condition),
        invitation="About thirty speeds are predicted, which takes about ten seconds.",
        button="Predict over speed",
    )
    if sweeps is None:
        return
    metric = st.selectbox(
        "Pulse metric", list(METRIC_LABELS), format_func=METRIC_LABELS.__getitem__, key="sweep metric", help=TTZV
    )
    show_figure(
        sweep_figure(sweeps, metric, view.campaign),
        alt=f"{METRIC_LABELS[metric]} over impact speed, every approach with its band, tests as points",
    )
    st.caption(weights_sentence(condition, view.campaign.tests))
    for sentence in missing_over_speed(sweeps, metric):
        st.caption(sentence)
    with st.container(horizontal=True):
        download_table("sweep.csv", lambda: sweep_table(sweeps, view.campaign))
        download_report(lambda: sweep_report(view.campaign, sweeps, request.config), "sweep.html")


def show_next_test(answer: Answer) -> None:
    """Show which test would narrow the band most, over a range chosen here."""
    campaign, request = answer.campaign, answer.request
    domains = [fit.approach for fit in answer.fitted.fits if isinstance(fit.approach, DisplacementDomain)]
    if not domains or not isinstance(domains[0].bias_, HierarchicalBias):
        st.info("Ranking next tests needs the displacement domain with the fast settings.")
        return
    st.markdown(NEXT_TEST_MEANING)
    usual = ConditionRange.of(campaign.tests)
    ends = []
    axes = (("Speeds (mph)", MPH, 0.5), ("Front weights (lb)", LB, 10.0), ("Rear weights (lb)", LB, 10.0))
    library = campaign.cae.vectors
    for column, (label, unit, step), axis in zip(st.columns(3), axes, range(3), strict=True):
        low, high = (end.vector[axis] / unit for end in (usual.low, usual.high))
        least = max(min(float(library[:, axis].min()) / unit, low), step)
        most = max(float(library[:, axis].max()) / unit, high)
        ends.append(
            column.slider(
                label, _down(least, step), _up(most, step), (_down(low, step), _up(high, step)), step=step,
                format="%.1f" if step < 1 else "%.0f",
                key=f"range of {label} {campaign.fingerprint[:8]}", persist_state="session",
                help="The range of interest; all conditions in it are weighted equally.",
            )
        )  # fmt: skip
    kind = answer.condition.factors or usual.low.factors
    low, high = (Condition(ends[0][i] * MPH, ends[1][i] * LB, ends[2][i] * LB, kind) for i in (0, 1))
    try:
        over = ConditionRange(low, high)
        ranked = _ranked(request.key, over, domains[0])
    except UsageError as error:
        st.warning(str(error), icon=":material/warning:")
        return
    show_figure(next_tests(ranked, campaign.tests), alt="How much each candidate would narrow the band, over its speed")
    st.markdown(f"**The best {_BEST}**" + (f", for {', '.join(f'{k} {v}' for k, v in kind if v)}" if kind else ""))
    show_table(page_tables.next_tests(ranked[:_BEST]), "next tests")
    with st.container(horizontal=True):
        download_table("next_tests.csv", lambda: next_tests_table(ranked))
        download_report(lambda: next_test_report(campaign, over, ranked, request.config), "next_test.html")


@st.cache_data(show_spinner="Ranking candidates …", max_entries=32)
def _ranked(key: object, over: ConditionRange, _domain: DisplacementDomain) -> tuple[NextTest, ...]:  # noqa: ARG001
    return rank_next_tests(_domain, over)


def _down(value: float, step: float) -> float:
    return step * int(value / step + 1e-6)


def _up(value: float, step: float) -> float:
    return -step * int(-value / step - 1 + 1e-6)
