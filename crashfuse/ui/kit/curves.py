"""Curves of a figure of pulses: a prediction with its band, and what is chosen beside it."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass

import streamlit as st

from crashfuse.approaches.neighbours import nearest_tests
from crashfuse.approaches.registry import BASELINE, LABELS
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.results import figures
from crashfuse.results.display import Display
from crashfuse.results.drawing import Drawing
from crashfuse.results.plots.curves import TEST
from crashfuse.study.config import StudyConfig
from crashfuse.study.outliers import departures_near
from crashfuse.study.prediction import PredictedPulse, by_one
from crashfuse.ui.kit import address
from crashfuse.ui.kit.address import chosen_config, kept_choice, pinned
from crashfuse.ui.kit.campaigns import HASHED, View
from crashfuse.ui.kit.computation import answers, fit_request
from crashfuse.ui.kit.text import plain
from crashfuse.units import read_out

AVERAGE = "average"  # stands among the curves for that of the draws
_NEAREST = 3
_NEAREST_HELP = f"The {_NEAREST} nearest tests by speed and mass, and any that stands apart near the condition."
_MOST = 24  # added curves: with the test and the approaches some thirty
_PIN = "at:"  # begins what stands for a pin in the address: no id of a test has a colon in it


@dataclass(frozen=True, eq=False)
class Shown:
    """What a figure shows."""

    approach: str  # whose prediction and band it shows; added predictions are by it, too
    others: tuple[str, ...]  # further approaches, the held-out test, the average
    also: tuple[figures.Further, ...]

    @property
    def approaches(self) -> tuple[str, ...]:
        """By which approaches its predictions are."""
        return (*(name for name in self.others if name in LABELS), self.approach)

    @property
    def key(self) -> Hashable:
        """Equal for equal choices: part of the key of a cached figure."""
        return self.approach, self.others, tuple(curve if isinstance(curve, str) else curve.text for curve in self.also)

    @property
    def by(self) -> str:
        """By which approaches its predictions are, in words."""
        return read_out([LABELS[name] for name in self.approaches])

    def draw(self, figure: Callable[..., Drawing]) -> Drawing:
        """A figure of these curves; clicks in its legend would hide what then comes back."""
        drawing = figure(approaches=self.approaches, also=self.also, band=self.approach)
        drawing.update(legend={"itemclick": False, "itemdoubleclick": False})
        return drawing

    def named(self, drawn: str) -> str:
        """A name of files: what is drawn, and which curves."""
        return " ".join([drawn, *map(_label, (self.approach, *self.others))])


def predicted(campaign: Campaign, config: StudyConfig, condition: Condition) -> PredictedPulse | None:
    """What is predicted at a condition from all tests with some settings, if it is ready."""
    if (fitted := fit_request(campaign, config).result) is None:
        return None
    return PredictedPulse(campaign, tuple(answers(condition, fitted)), config)


def choose_curves(view: View, condition: Condition, approach: str, known: Sequence[str], test: str = "") -> Shown:
    """Let the user choose what a figure shows beside the prediction of a held-out test, or at a condition."""
    page = "compare" if test else "predict"
    others, key = [name for name in known if name != approach], f"{page}_curves"
    offered = [TEST, *others] if test else [*others, AVERAGE]
    address.default(key, [TEST, BASELINE] if test else [] if pinned() else [BASELINE])
    with st.popover("Curves", icon=":material/stacked_line_chart:"):
        look = {"selection_mode": "multi", "width": "content", "help": "Stays on this page, and is in the link."}
        chosen = kept_choice(key, offered, st.pills, "Beside the prediction", format_func=_label, **look)
        added, at_pins, missing = _add(view, condition, approach, test)
    if st.toggle("Nearest tests", key=f"{page}_nearest", persist_state="session", help=_NEAREST_HELP):
        added = [*dict.fromkeys([*added, *_nearest(view.campaign, condition, test)])]
    for sentence in missing:  # folded away, nobody would know that the figure lacks what a link asks for
        st.caption(sentence, width="content")
    return Shown(approach, tuple(name for name in offered if name in chosen), (*added, *at_pins))


def _label(curve: str) -> str:
    return {TEST: "Test", AVERAGE: "Average", **LABELS}[curve]


def _add(
    view: View, condition: Condition, approach: str, test: str
) -> tuple[list[str], list[PredictedPulse], list[str]]:
    campaign, pins, key = view.campaign, pinned(), f"{'compare' if test else 'predict'}_also"
    offered = {
        **{t.id: figures.pulse_name(t.id, t.condition, view.display) for t in campaign.tests if t.id != test},
        **{f"{_PIN}{text}": figures.prediction_name(approach, pin, view.display) for text, pin in pins.items() if test},
        **_offered_runs(view.display, campaign),
    }
    asked = st.session_state[key]
    if len(asked) > _MOST:  # of a link, or one more: Streamlit would refuse them all
        asked = st.session_state[key] = asked[-_MOST:]
    also = kept_choice(
        key, list(offered), st.multiselect, "Also show", format_func=offered.__getitem__, max_selections=_MOST,
        placeholder="tests, CAE runs, pinned predictions", filter_mode="contains", select_all=False,
    )  # fmt: skip
    wanted = [pin for text, pin in pins.items() if (f"{_PIN}{text}" in also if test else text != condition.text)]
    found = (predicted(campaign, chosen_config(), pin) for pin in wanted)
    at_pins = by_one(approach, [prediction for prediction in found if prediction is not None])
    unknown = [name for name in asked if not name.startswith(_PIN) and name not in {*campaign.test_ids, *offered}]
    names = ", ".join(name.removeprefix(figures.RUN)[:80] for name in unknown)
    missing = [f"Not among the tests in use and the CAE runs: {plain(names)}."] if unknown else []
    if wanted and not at_pins:
        missing.append("Pinned predictions are shown once Predict has an answer with these settings.")
    elif at_pins and test:
        missing.append(f"Pinned predictions learned from {plain(test)}, too.")
    return [name for name in also if not name.startswith(_PIN)], at_pins, missing


def _nearest(campaign: Campaign, condition: Condition, test: str) -> list[str]:
    near = nearest_tests(campaign.without([test] if test else []), condition, _NEAREST)
    apart = (departure.test for departure in departures_near(campaign, condition))
    return [name for name in (*(own.id for own in near), *apart) if name != test]


@st.cache_resource(max_entries=8, show_spinner=False, hash_funcs=HASHED)
def _offered_runs(display: Display, campaign: Campaign) -> Mapping[str, str]:
    runs = zip(campaign.cae.ids, campaign.cae.conditions, strict=True)
    return {(name := f"{figures.RUN}{run}"): figures.pulse_name(name, at, display) for run, at in runs}
