"""Planning on the page Predict: pulse metrics over impact speed, and which test to run next."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.approaches.registry import BASELINE, LABELS
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.reporting.glossary import TTZV
from crashfuse.reporting.planning import NextTests
from crashfuse.reporting.plots.sweep import BEST
from crashfuse.reporting.report import next_test_report, sweep_report
from crashfuse.reporting.report.prediction import NEXT_TEST_MEANING
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.study.next_test import ConditionRange, NextTest, rank_next_tests
from crashfuse.study.sweep import missing_over_speed, weights_sentence
from crashfuse.ui.kit import address, results
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import sweep_over_speed
from crashfuse.ui.kit.figures import show_figure
from crashfuse.ui.kit.files import download_report, download_table
from crashfuse.ui.kit.progress import result_or_none
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain
from crashfuse.ui.predict import DECIMALS, Answer, Field
from crashfuse.wording import IN_SI

_AXES = (
    Field("Speeds", "speed_range", "mph", 0.5),
    Field("Front weights", "front_range", "lb", 10.0),
    Field("Rear weights", "rear_range", "lb", 10.0),
)


def show_over_speed(answer: Answer) -> None:
    """Show every metric over speed, at the weights chosen above."""
    view, condition, request = answer.view, answer.condition, answer.request
    if not answer.whole:
        st.info("Speeds are predicted once every approach is fitted.", icon=":material/hourglass_top:")
        return
    sweep = result_or_none(
        sweep_over_speed(request, answer.fitted, condition),
        invitation="About thirty speeds are predicted, which takes about ten seconds.",
        button="Predict over speed",
    )
    if sweep is None:
        return
    metric = st.selectbox(
        "Pulse metric", list(METRIC_LABELS), format_func=METRIC_LABELS.__getitem__, key="sweep_metric",
        persist_state="session", help=TTZV,
    )  # fmt: skip
    approaches = answer.subject.approach, BASELINE
    shown = replace(sweep, sweeps=tuple(own for own in sweep.sweeps if own.approach in approaches))
    show_figure(
        shown.plot(metric, display=view.display),
        alt=f"{METRIC_LABELS[metric]} over impact speed by {LABELS[answer.subject.approach]}, tests as points",
        name=f"{metric} over speed {condition.text.partition(' ')[2]}",
    )
    st.caption(plain(weights_sentence(condition, view.campaign.tests)))
    for sentence in missing_over_speed(shown.sweeps, metric):
        st.caption(plain(sentence))
    with st.container(horizontal=True):
        download_table("sweep.csv", lambda: sweep.table, view.campaign.name)
        download_report(lambda: sweep_report(sweep, view.display), view.campaign.name, "sweep.html")


def show_next_test(answer: Answer) -> None:
    """Show which test would narrow the band most, over a range chosen here."""
    campaign, request = answer.view.campaign, answer.request
    domains = [fit.approach for fit in answer.fitted.fits if isinstance(fit.approach, DisplacementDomain)]
    if not domains or not isinstance(domains[0].bias_, HierarchicalBias):
        st.info("Ranking next tests needs the displacement domain with the fast settings.")
        return
    usual = ConditionRange.of(campaign.tests)
    ends, display = [], answer.view.display
    for place, (column, axis) in enumerate(zip(st.columns(3), _AXES, strict=True)):
        tests = [float(end.vector[place]) for end in (usual.low, usual.high)]
        ends.append(_range(column, axis, answer.view, campaign.cae.vectors[:, place], tests))
    kind = answer.condition.factors or usual.low.factors
    low, high = (Condition.of_vector([v0, front, rear], kind) for v0, front, rear in zip(*ends, strict=True))
    try:
        over = ConditionRange(low, high)
        candidates = NextTests(campaign, over, _ranked(request.key, over, domains[0]), request.config)
    except UsageError as error:
        st.warning(plain(error.args[0]), icon=":material/warning:")
        return
    show_figure(
        candidates.plot(display=display), alt="How much each candidate would narrow the band, over its speed",
        name=f"next test {over.low.text} to {over.high.text}",
    )  # fmt: skip
    st.caption(NEXT_TEST_MEANING)
    if answer.subject.approach != DisplacementDomain.name:
        st.caption(
            f"Only the displacement domain can rank tests: this does not follow {LABELS[answer.subject.approach]}."
        )
    named = ", ".join(f"{name} {value}" for name, value in kind if value)
    usual_kind = "" if answer.condition.factors else ", of which there are most tests"
    st.markdown(f"**The best {BEST}**" + (f", for {plain(named)}{usual_kind}" if named else ""))
    show_table(results.next_tests_styled(candidates.ranked[:BEST], display), "next tests")
    with st.container(horizontal=True):
        download_table("next_tests.csv", lambda: candidates.table, campaign.name)
        download_report(lambda: next_test_report(candidates, display), campaign.name, "next_test.html")


@st.cache_data(show_spinner="Ranking candidates …", max_entries=32)
def _ranked(key: object, over: ConditionRange, _domain: DisplacementDomain) -> tuple[NextTest, ...]:  # noqa: ARG001
    return rank_next_tests(_domain, over)


def _range(
    column: DeltaGenerator, axis: Field, view: View, runs: np.ndarray, tests: Sequence[float]
) -> tuple[float, float]:
    """Slider for a range in SI, at first that of the tests; kept as it was chosen, ``20:35 mph``."""
    own_unit, unit = (units.unit(axis.unit) for units in (view.campaign.units, view.display.units))
    state, step = st.session_state, axis.step
    own_in_si, in_si = IN_SI[own_unit], IN_SI[unit]
    least, most = min(float(runs.min()), *tests), max(float(runs.max()), *tests)
    low = step * int(max(least / in_si, step) / step + 1e-6)
    high = -step * int(-most / in_si / step - 1 + 1e-6)
    try:
        first, last = _ends(state[axis.key] or "")
        lies_in = least / 2 <= first <= last <= 2 * most
    except (ValueError, KeyError):
        lies_in = False
    if not lies_in:  # nothing yet, a link that was cut, or another campaign's
        state[axis.key] = None
    address.default(axis.key, f"{tests[0] / own_in_si:.9g}:{tests[1] / own_in_si:.9g} {own_unit}")
    ends = _ends(state[axis.key])
    slider = f"{axis.key}, {low:g} to {high:g} {unit}"  # another range is another widget
    address.put(slider, tuple(round(min(max(end / in_si, low), high), DECIMALS) for end in ends))

    def take() -> None:
        first, last = state[slider]
        state[axis.key] = f"{first:.12g}:{last:.12g} {unit}"

    label = view.display.title(axis.label, axis.unit)
    column.slider(
        label, low, high, step=step, format="%.1f" if step < 1 else "%.0f", key=slider, on_change=take,
        help="The range of interest; all conditions in it are weighted equally.",
    )  # fmt: skip
    return ends


def _ends(text: str) -> tuple[float, float]:
    numbers, _, unit = text.partition(" ")
    first, last = numbers.split(":")
    return float(first) * IN_SI[unit], float(last) * IN_SI[unit]
