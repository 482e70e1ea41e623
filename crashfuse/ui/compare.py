"""The page Compare: how each approach rates on a held-out test, which one to use, why, and files."""

from collections.abc import Hashable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import streamlit as st

from crashfuse.approaches.registry import BASELINE, LABELS, by_preference
from crashfuse.campaign import Campaign
from crashfuse.results.fit_explanations import estimates_result, whole_sentences
from crashfuse.results.plots.curves import TEST
from crashfuse.results.rating_tables import excursions_table, humps_table
from crashfuse.results.study import quality_of, study_files, study_result
from crashfuse.signals.rating import WEIGHTS
from crashfuse.signals.rating_explanation import rating_headline, rating_sentences
from crashfuse.study.facts import departure_fact
from crashfuse.study.recommendation import Account, Recommendation, account
from crashfuse.study.study import Fold, Study
from crashfuse.ui.kit import address, results
from crashfuse.ui.kit.address import chosen_config, kept
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import advised, study_request
from crashfuse.ui.kit.curves import choose_curves
from crashfuse.ui.kit.editing import edit_notes, notes_of
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.files import choose_report, export_button, offer, offer_pulses, offer_result
from crashfuse.ui.kit.progress import result_of, show_training, stop_with_a_single_test
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import DRAWS, HUMPS, LF, RATING_PARTS, plain

_BADGES = {"Excellent": "blue", "Good": "blue", "Fair": "orange", "Poor": "orange"}
_MOTION, _RESIDUALS = "Motion", "Residuals"
_CORRIDORS_HELP = (
    "Of the rating: 1 inside the inner corridor, 0 outside the outer: ± 5 %, ± 50 % of the test's largest acceleration."
)
_CURVES = {
    "Over displacement": (
        "displacement",
        "Acceleration over displacement, up to maximum crush: {}",
        "Marks: maximum crush with its 95 % interval. Area under a curve: energy per unit mass, ½ v0².",
    ),
    "Energy": ("energy", "Absorbed energy over crush: {}", "At maximum crush: all of ½ m v0². Slope: crush force."),
    _RESIDUALS: (
        "residuals",
        "Prediction minus test, over time: {}",
        "Where a band leaves zero, the test left it. RMS: over the rated window.",
    ),
}
"""By the figure's name on the page: the library's name, alternative text, what to see."""


def show(view: View) -> None:
    """Show the ratings of the held-out test, and the tab that the user chooses."""
    test, campaign, config = view.held_out, view.campaign, chosen_config()
    stop_with_a_single_test(campaign)
    request = study_request(campaign, (test.id,), config)
    others = config.training_campaign(campaign, test.id)
    learned = f"Every approach will be fitted on the CAE runs and {len(others.tests)} other tests."
    invitation = f"Test {plain(test.id)} has not been predicted yet. {learned}"
    study = result_of(request, invitation=invitation, button=f"Predict test {test.id}")
    show_training(config, study.config.approaches)
    fold, advice = study.fold(test.id), None
    if study.config.approaches == config.approaches:
        advice = advised(request.key, test.condition, view.display.window_ms, fold.estimates, others)
    key = request.key, study.config.approaches, view.display
    comparison = _Comparison(view, study, fold, others, advice, key)
    _show_headline(comparison)
    tabs = {"Pulses": _show_pulses, "Why": _show_why, "Ratings and metrics": _show_ratings}
    with st.container(horizontal=True, vertical_alignment="center", gap="small", key="asked"):
        tab = choose("Tab", list(tabs), key="compare_tab")
        st.space("stretch")
        export_button(partial(_show_files, comparison))
    tabs[tab](comparison)


class _Comparison(NamedTuple):
    view: View
    study: Study  # of the held-out test alone; while networks train, of fewer approaches than the settings ask for
    fold: Fold
    others: Campaign  # what the predictions learned from
    advice: Recommendation | None  # made without this test; None while approaches are still missing
    key: Hashable  # of cached figures

    @property
    def window_ms(self) -> float:
        return self.view.display.window_ms


def _show_headline(comparison: _Comparison) -> None:
    _choose_rated(comparison)
    if (advice := comparison.advice) is None:
        return
    approach, window_ms = st.session_state["explained"], comparison.window_ms
    rated = {name: ratings[window_ms].overall for name, ratings in comparison.fold.ratings.items()}
    repeat = comparison.study.repeatability.get(comparison.fold.held_out, {}).get(window_ms)
    test_account = _account(comparison.key, comparison, approach)
    lines = [f"**{plain(of)}:** {plain(how)}" for of, how in quality_of(test_account, repeat).items()]
    reasons: list[str] = [fact.sentence for fact in (*advice.after(rated[advice.approach]), *test_account.about_test)]
    if repeat is not None:
        reasons.append(repeat.sentence(rated[approach], LABELS[approach]))
    icon = ":material/warning: " if test_account.disappoints else ""
    results.show_with_reasons(icon + "  \n".join(lines), [*reasons, *whole_sentences(comparison.fold.estimates)])


def _choose_rated(comparison: _Comparison) -> None:
    rated = {name: by_window[comparison.window_ms] for name, by_window in comparison.fold.ratings.items()}
    best = by_preference(rated)[0] if comparison.advice is None else comparison.advice.approach

    def label(name: str) -> str:
        overall, grade = rated[name].overall, rated[name].grade
        star = ":material/star: " if name == best and comparison.advice is not None else ""
        return f"{star}{LABELS[name]} **{overall:.3f}** :{_BADGES[grade]}-badge[{grade}]"

    address.default("explained", best, list(rated))
    of = f"Ratings over {results.window_label(comparison.window_ms)}"
    look = {"label_visibility": "collapsed", "required": True, "wrap": True, "format_func": label}
    st.segmented_control(of, list(rated), **kept("explained", on_change=address.publish, **look))


def _show_pulses(comparison: _Comparison) -> None:
    test = comparison.view.held_out
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        shown = choose("Figure", [_MOTION, *_CURVES], key="compared")
        corridors = shown == _MOTION and st.toggle("Corridors", **kept("corridors", help=_CORRIDORS_HELP))
        approach, known = st.session_state["explained"], list(comparison.fold.ratings)
        curves = choose_curves(comparison.view, test.condition, approach, known, test.id)
    figure, alt, caption = _CURVES.get(shown, ("motion", "Acceleration, velocity and displacement over time: {}", ""))
    notes = notes_of(comparison.view)
    notes_here = tuple(note for note in notes if note.test == test.id)
    name = "pulses with corridors" if corridors else "pulses" if shown == _MOTION else shown.lower()

    look: dict[str, Any] = {"corridors": corridors, "notes": notes_here, "display": comparison.view.display}
    draw = partial(curves.draw, partial(comparison.study.draw, test.id, figure, measured=TEST in curves.others, **look))
    of = f"test {test.id}{' and its' if TEST in curves.others else ','} prediction by {curves.by}"
    key = shown, corridors, notes_here, comparison.key, curves.key
    show_cached_figure(draw, alt.format(of), *key, name=curves.named(name))
    if caption:
        st.caption(caption)
    edit_notes(comparison.view, notes)


def _show_why(comparison: _Comparison) -> None:
    display, test = comparison.view.display, comparison.view.held_out
    approach = st.session_state["explained"]
    explanation = comparison.fold.explained(approach, comparison.window_ms)
    said = rating_sentences(explanation)
    st.markdown(f"**{LABELS[approach]} {plain(rating_headline(explanation))}**")
    draw = partial(comparison.study.draw, test.id, display=display)
    bars, words = st.container(key="why").columns([3, 2], gap="medium")
    with bars:
        alt = f"The four scores of every prediction of test {test.id}, as bars"
        show_cached_figure(partial(draw, "scores"), alt, "parts", comparison.key, name="scores")
    first, *others = sorted(WEIGHTS, key=lambda part: part != explanation.costliest)
    with words:
        st.markdown(plain(said[first]), help=RATING_PARTS)
        with st.expander("The other three scores", icon=":material/notes:"):
            st.markdown("\n".join(f"- {plain(said[part])}" for part in others))
        departure = _account(comparison.key, comparison, approach).departure
        if departure is not None and departure.apart:
            st.markdown(f":material/warning: {plain(departure_fact(departure).sentence)}")
    alt = f"Test {test.id} and its prediction by {LABELS[approach]}: corridors, shifted, warped, and their slopes"
    curves, name = partial(draw, "rating", approaches=[approach]), f"rating of {LABELS[approach]}"
    show_cached_figure(curves, alt, "rated curves", approach, comparison.key, name=name)
    with st.expander("Humps, and stretches outside the corridor", icon=":material/table:"):
        show_table(humps_table(explanation), "humps")
        st.caption(HUMPS)
        show_table(excursions_table(explanation), "excursions")


@st.cache_resource(max_entries=50, show_spinner=False)  # which would stand over figures of another choice
def _account(key: Hashable, _comparison: _Comparison, approach: str) -> Account:  # noqa: ARG001
    view, fold = _comparison.view, _comparison.fold
    return account(view.campaign, chosen_config(), fold, view.display.window_ms, approach=approach)


def _show_ratings(comparison: _Comparison) -> None:
    campaign, fold, window_ms, config = comparison.view.campaign, comparison.fold, comparison.window_ms, chosen_config()
    terms = f"By {campaign.rating_basis}. Single draws: {DRAWS} {LF}"
    window, approach = results.window_label(window_ms), st.session_state["explained"]
    st.subheader(f"Ratings; scores and single draws over {window}", help=terms)
    draws = {name: fold.rating_interval(name, window_ms) for name in fold.with_band}
    to_ttzv = {name: fold.overall_to_ttzv(name) for name in fold.ratings if config.to_ttzv and fold.ttzv_ms is not None}
    show_table(results.ratings_table(fold.ratings, window_ms, draws, to_ttzv), "ratings")
    known = () if comparison.advice is None else comparison.advice.sentences
    about = estimates_result(campaign, fold.estimates, comparison.view.held_out, known)
    metrics, others = about.tables["metrics"], {*fold.ratings} - {BASELINE, approach}
    if not st.toggle("Metrics of all approaches", key="all_metrics", persist_state="session"):
        metrics = metrics.without(*(LABELS[name] for name in others))
    with st.container(key="metrics"):
        results.show_metrics(replace(about, tables={**about.tables, "metrics": metrics}))
    results.show_details(about)


def _show_files(comparison: _Comparison) -> None:
    test, study, estimates = comparison.view.held_out, comparison.study, comparison.fold.estimates
    of, display = f"{comparison.others.name} {test.id}", comparison.view.display
    options = choose_report(comparison.view, [test.id])
    if comparison.advice is None:
        offer(of, study_files(study))
        return
    offer_result(study_result(study, options, display.window_ms), display, of, options.form)
    remark = f"Test {test.id}, at this condition, was left out."
    offer_pulses(comparison.others, estimates, comparison.advice.approach, chosen_config().seed, [remark])
