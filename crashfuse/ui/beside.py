"""What a figure of pulses shows: the curves that were chosen, one filled band, and whatever is put beside them.

The choices stay until they are changed, over figures, windows, pages and reloads, and are in the address. A curve is
shown or hidden here alone, not by clicks in a legend, which the next redraw would forget.
"""

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass

import plotly.graph_objects as go
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.nearness import nearest_tests
from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.reporting.figures import RUN, Further, prediction_name, pulse_name
from crashfuse.reporting.plots.curves import TEST
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.ui.chosen import View
from crashfuse.ui.computation import FitRequest, answers, chosen_config
from crashfuse.ui.earlier import EARLIER, Earlier, earlier_of_test
from crashfuse.ui.kept import kept_choice
from crashfuse.ui.navigation import end_page
from crashfuse.ui.other_seeds import other_seeds
from crashfuse.ui.pins import pinned
from crashfuse.ui.text import plain
from crashfuse.wording import read_out

_RECOMMENDED = "recommended"  # the approach whose band is filled, unless another is chosen
_NEAREST = 3
_MOST = 24  # further curves: with the test and the approaches some thirty
_PIN = "at:"  # begins the id of a pinned prediction, as RUN that of a CAE run: no id of a test has a colon in it


@dataclass(frozen=True, eq=False)
class Shown:
    """What a figure shows.

    Attributes
    ----------
    test : bool
        Whether the held-out test is among it.
    approaches : tuple of str
        Those that are shown.
    also : tuple of str, PredictedPulse or EarlierPrediction
        What is put beside them: tests and CAE runs by their ids, pinned predictions, and those with other settings.
    band : str
        The approach whose band is filled; predictions put beside it are by it, too.
    key : Hashable
        Equal for equal choices: part of the key of a cached figure.
    unlike : tuple of str
        In what it is unlike the usual figure, in few words for names of files: hidden curves, another filled band.
    every : bool
        Whether no approach is hidden.
    """

    test: bool
    approaches: tuple[str, ...]
    also: tuple[Further, ...]
    band: str
    key: Hashable
    unlike: tuple[str, ...]
    every: bool

    @property
    def by(self) -> str:
        """By which approaches its predictions are, in words."""
        return "every approach" if self.every else read_out([LABELS[name] for name in self.approaches])

    def named(self, drawn: str, *, of_test: bool = True) -> str:
        """What is drawn, and what is unlike the usual figure of that, for names of files.

        A figure without a curve ``of_test``, such as what is left of predictions less the test, lacks none.
        """
        return " ".join([drawn, *(own for own in self.unlike if of_test or own != _hidden(TEST))])

    def of(self, test: str) -> str:
        """What it shows of a test, in words."""
        prediction = f"by {self.by}" if self.approaches else ""
        if not self.test:
            return f"prediction of test {test} {prediction}" if prediction else f"beside test {test}"
        return f"test {test} and its prediction {prediction}" if prediction else f"test {test}"


def choose_curves(
    view: View,
    predictions: Mapping[str, Prediction],
    recommended: str | None,
    condition: Condition,
    held_out: str = "",
    offered: Sequence[str] | None = None,
) -> Shown:
    """Let the user choose what a figure shows: of the predictions at a condition, and beside them.

    ``held_out`` is the id of the test that was measured there, if any. Elsewhere the pinned predictions are shown
    without being asked for. A figure with curves that it always shows says which others are ``offered``.
    """
    known = [*([TEST] if held_out else []), *predictions] if offered is None else offered
    with st.popover("Curves", icon=":material/stacked_line_chart:"):
        chosen = _choose_of(known) if known else []
        band = _choose_band(predictions, recommended) if offered is None else leading(predictions, recommended)
        if held_out:
            beside, missing = _choose_beside(view, band, earlier_of_test(view.campaign, held_out, band), held_out)
        else:
            beside, missing = _choose_beside(view, band, other_seeds(view.campaign, condition, band), at=condition)
    st.button(
        "Nearest tests", icon=":material/near_me:", on_click=_add_nearest, args=(view.campaign, condition, held_out),
        help=f"Also show {_NEAREST} tests: the nearest by speed and weights, as shares of the speed and the mass.",
    )  # fmt: skip
    if held_out and any(isinstance(own, PredictedPulse) for own in beside):
        missing.append(f"Pinned predictions learned from {plain(held_out)}, too.")
    _say(missing)
    approaches = tuple(name for name in chosen if name in predictions)
    if offered is None and not (approaches or beside or TEST in chosen):
        st.info("No curve is chosen.", icon=":material/visibility_off:")
        end_page()
    key = approaches, key_of(beside), band, TEST in chosen
    usual = _usual_band(predictions, recommended) if offered is None else band
    unlike = unlike_usual([name for name in known if name not in chosen], band, usual)
    return Shown(TEST in chosen, approaches, beside, band, key, unlike, len(approaches) == len(predictions))


def key_of(also: Sequence[Further]) -> Hashable:
    """Equal for equal pulses put beside others: part of the key of a cached figure."""
    return tuple(each if isinstance(each, str) else each.text for each in also)


def unlike_usual(hidden: Sequence[str], band: str, usual: str) -> tuple[str, ...]:
    """What tells a figure from the one with all curves and the usual filled band, in few words for names of files."""
    return (*map(_hidden, hidden), *([f"{LABELS[band]} band"] if band != usual else []))


def _hidden(curve: str) -> str:
    return f"no {_label(curve)}"


def leading(predictions: Mapping[str, Prediction], recommended: str | None) -> str:
    """The approach whose band is filled and by which other predictions are: the recommended one, or as chosen."""
    chosen = st.session_state["band"]
    if chosen in predictions and predictions[chosen].draws_mps2 is not None:
        return str(chosen)
    return _usual_band(predictions, recommended)


def choose_tests(view: View, row: DeltaGenerator) -> tuple[tuple[str, ...], tuple[Further, ...]]:
    """Let the user choose tests, all by default, and CAE runs and predictions beside them, in a row of choices."""
    names = {test.id: pulse_name(test.id, test.condition, view.display) for test in view.campaign.tests}
    with row, st.container(horizontal=True, vertical_alignment="bottom", gap="small"):
        only = _choose_several("only", names, "Tests", "all")
        further, missing = _choose_beside_tests(view, *names)
    _say([*_unknown("only", names), *missing])
    return tuple(test for test in view.campaign.test_ids if not only or test in only), further


def choose_beside_runs(view: View) -> tuple[Further, ...]:
    """Let the user choose tests, CAE runs and predictions beside those of the CAE model."""
    further, missing = _choose_beside_tests(view)
    _say(missing)
    return further


def _choose_beside_tests(view: View, *tests: str) -> tuple[tuple[Further, ...], list[str]]:
    """As :func:`_choose_beside`, where no prediction is shown by itself, but perhaps some tests."""
    approach = usual_approach()
    with st.popover("Beside them", icon=":material/stacked_line_chart:"):  # closed, a thousand runs cost nothing
        earlier = earlier_of_test(view.campaign, view.held_out.id, approach, among_tests=True)
        return _choose_beside(view, approach, earlier, *tests)


def usual_approach() -> str:
    """The approach whose predictions stand beside tests, where none is shown by itself."""
    return by_preference(chosen_config().approaches)[0]


def without_clicks(figure: go.Figure) -> go.Figure:
    """The same figure, with a legend that takes no clicks: what they hide would come back with the next redraw."""
    return figure.update_layout(legend={"itemclick": False, "itemdoubleclick": False})


def _choose_of(known: Sequence[str]) -> list[str]:
    chosen = kept_choice(
        "curves", known, st.pills, "Curves", selection_mode="multi", width="content",
        format_func=_label,
        help="The choice stays, whatever else you change, and is in the link.",
    )  # fmt: skip
    return [name for name in known if name in chosen]


def _label(curve: str) -> str:
    return LABELS.get(curve, "Test")


def _usual_band(predictions: Mapping[str, Prediction], recommended: str | None) -> str:
    return recommended if recommended is not None and recommended in predictions else by_preference(predictions)[0]


def _choose_several(key: str, labels: Mapping[str, str], title: str, placeholder: str) -> list[str]:
    """Let the user choose of some pulses by their labels."""
    if len(st.session_state[key]) > _MOST:  # of a link, or one more of History: Streamlit would refuse them all
        st.session_state[key] = st.session_state[key][-_MOST:]
    return kept_choice(
        key, list(labels), st.multiselect, title, format_func=labels.__getitem__, max_selections=_MOST,
        placeholder=placeholder, filter_mode="contains", select_all=False,
    )  # fmt: skip


def _choose_band(predictions: Mapping[str, Prediction], recommended: str | None) -> str:
    with_band = [name for name, own in predictions.items() if own.draws_mps2 is not None]
    if with_band:
        labels = {_RECOMMENDED: "Recommended", **{name: LABELS[name] for name in with_band}}
        if st.session_state["band"] not in labels:
            st.session_state["band"] = _RECOMMENDED
        st.selectbox(
            "Filled band", list(labels), format_func=labels.__getitem__, key="band", persist_state="session",
            help="Of other bands the edges are drawn. Predictions put beside are by this approach.",
        )  # fmt: skip
    return leading(predictions, recommended)


def _choose_beside(
    view: View, approach: str, earlier: Earlier, *shown: str, at: Condition | None = None
) -> tuple[tuple[Further, ...], list[str]]:
    """Further pulses, and sentences on what cannot be shown.

    Of the tests those that the figure does not show anyway are among the choices. On Predict, ``at`` a condition, the
    pinned predictions are shown without being asked for.
    """
    campaign, pins = view.campaign, pinned()
    at_pins = {f"{_PIN}{text}": prediction_name(approach, pin, view.display) for text, pin in pins.items()}
    tests = [test for test in campaign.tests if test.id not in shown]
    unasked = "" if at is None else at.text
    offered = {
        **{test.id: pulse_name(test.id, test.condition, view.display) for test in tests},
        **earlier.names,
        **({} if unasked else at_pins),
        **_offered_runs(campaign.fingerprint, view.display, campaign),
    }
    kinds = [*(["tests"] if tests else []), *(["other settings"] if earlier.names else []), "CAE runs"]
    also = _choose_several("also", offered, "Also show", ", ".join(kinds))
    if unasked:
        also += [name for name in at_pins if name != f"{_PIN}{unasked}"]
    wanted = [pins[name.removeprefix(_PIN)] for name in also if name in at_pins]
    at_pinned = _pinned_predictions(campaign, wanted, approach)
    missing = [*_unknown("also", {*campaign.test_ids, *offered}), *earlier.missing]
    if wanted and not at_pinned:
        missing.append("Pinned predictions are shown once the page Predict has an answer with these settings.")
    return (
        *(name for name in also if name not in at_pins and name not in earlier.names),
        *earlier.chosen,
        *at_pinned,
    ), missing


def _unknown(key: str, known: Collection[str]) -> list[str]:
    """Sentence on tests and CAE runs that a link asks for and that the campaign does not have."""
    wanted = [name for name in st.session_state[key] if not name.startswith((_PIN, EARLIER))]
    missing = ", ".join(name.removeprefix(RUN)[:80] for name in wanted if name not in known)
    return [f"Not among the tests in use and the CAE runs: {plain(missing)}."] if missing else []


def _say(missing: Sequence[str]) -> None:
    """Say beside a figure what it cannot show: folded away, nobody would know that it lacks what a link asks for."""
    for sentence in missing:
        st.caption(sentence, width="content")


@st.cache_resource(max_entries=8, show_spinner=False)
def _offered_runs(key: str, display: Display, _campaign: Campaign) -> Mapping[str, str]:  # noqa: ARG001
    """Labels of a campaign's CAE runs by their ids, thousands of them, made once for all sessions."""
    runs = zip(_campaign.cae.ids, _campaign.cae.conditions, strict=True)
    return {(name := f"{RUN}{run}"): pulse_name(name, at, display) for run, at in runs}


def _pinned_predictions(campaign: Campaign, wanted: Sequence[Condition], approach: str) -> list[PredictedPulse]:
    """By one approach; none until the approaches are fitted on all tests."""
    request = FitRequest(campaign, chosen_config())
    fitted = request.result if wanted else None
    if fitted is None:
        return []
    return [
        PredictedPulse(campaign, (estimate,), request.config)
        for condition in wanted
        for estimate in answers(request.key, condition, fitted)
        if estimate.approach == approach
    ]


def _add_nearest(campaign: Campaign, condition: Condition, held_out: str) -> None:
    near = nearest_tests(campaign.without([held_out] if held_out else []), condition, _NEAREST)
    also = st.session_state["also"]
    st.session_state["also"] = list(dict.fromkeys([*also, *(test.id for test in near)]))[:_MOST]
