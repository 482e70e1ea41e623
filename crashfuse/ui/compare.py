"""The page Compare: how each approach rates on a held-out test, which one to use, why, and files."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from html import escape

import plotly.graph_objects as go
import streamlit as st

from crashfuse.approaches.registry import BASELINE, LABELS
from crashfuse.campaign import Campaign
from crashfuse.reporting.fit_explanations import whole_sentences
from crashfuse.reporting.plots.curves import TEST
from crashfuse.reporting.plots.palette import GRADE_COLOURS
from crashfuse.reporting.rating_tables import REPEAT, excursions_table, humps_table
from crashfuse.reporting.report.study import study_report
from crashfuse.signals.rating import WEIGHTS
from crashfuse.signals.rating_explanation import rating_sentences
from crashfuse.study.config import StudyConfig
from crashfuse.study.facts import window_facts
from crashfuse.study.recommendation import Account, Recommendation, account
from crashfuse.study.repeatability import Repeatability
from crashfuse.study.study import Fold, Study
from crashfuse.ui.kit import results
from crashfuse.ui.kit.address import chosen_config
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import advised, study_request
from crashfuse.ui.kit.curves import Subject, choose_approach, choose_curves, without_clicks
from crashfuse.ui.kit.editing import edit_notes, notes_of
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.files import choose_report, download_report, download_table, export_button, offer_pulses
from crashfuse.ui.kit.navigation import component
from crashfuse.ui.kit.progress import patience, result_of, show_training, stop_with_a_single_test
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import A_REPEAT, DRAWS, HUMPS, LF, RATING_PARTS, plain
from crashfuse.units import difference

_NO_CHANGE = 0.005  # in rating
_KEY = "clicked rating"
_MOTION, _RESIDUALS = "Motion", "Residuals"
_CORRIDORS_HELP = "1 inside the inner corridor, 0 outside the outer: ± 5 %, ± 50 % of the test's largest acceleration."
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
    study = result_of(
        request,
        invitation=f"Test {plain(test.id)} has not been predicted yet. Every approach will be fitted on the CAE runs "
        f"and {len(config.training_campaign(campaign, test.id).tests)} other tests. "
        + patience(config, "The displacement domain takes some seconds, the networks a little longer."),
        button=f"Predict test {test.id}",
    )
    show_training(config, study.config.approaches)
    comparison = _Comparison(view, config, study, request.key)
    _show_headline(comparison)
    tabs = {"Pulses": _show_pulses, "Why": _show_why, "Ratings and metrics": _show_ratings}
    with st.container(horizontal=True, vertical_alignment="center", gap="small", key="asked"):
        tab = choose("Tab", list(tabs), key="compare_tab")
        choose_approach(comparison.subject, list(comparison.fold.ratings), comparison.advice)
        st.space("stretch")
        export_button(partial(_show_files, comparison))
    comparison.subject.offer()
    tabs[tab](comparison)


@dataclass(frozen=True, eq=False)
class _Comparison:
    view: View
    config: StudyConfig  # the settings that were chosen
    study: Study  # of the held-out test alone; while networks train, of fewer approaches than the settings ask for
    request_key: Hashable  # equal for equal data and settings

    @property
    def window_ms(self) -> float:
        return self.view.display.window_ms

    @property
    def key(self) -> Hashable:  # of cached figures
        return self.request_key, self.study.config.approaches, self.view.display

    @property
    def fold(self) -> Fold:
        return self.study.fold(self.view.held_out.id)

    @cached_property
    def others(self) -> Campaign:  # what the predictions learned from
        return self.config.training_campaign(self.view.campaign, self.view.held_out.id)

    @cached_property
    def advice(self) -> Recommendation | None:  # made without this test; None while approaches are still missing
        if self.study.config.approaches != self.config.approaches:
            return None
        condition = self.view.held_out.condition
        return advised(self.request_key, condition, self.window_ms, self.fold.estimates, self.others)

    @property
    def subject(self) -> Subject:
        return Subject(self.view, self.view.held_out.condition, self.view.held_out.id)

    @property
    def repeats(self) -> Mapping[float, Repeatability]:  # what a repeat of the test would rate, where it is known
        return self.study.repeatability.get(self.view.held_out.id, {})


def _show_headline(comparison: _Comparison) -> None:
    st.html(_row(comparison))
    for fact in window_facts(comparison.view.held_out, comparison.window_ms):
        st.caption(plain(comparison.view.display.words(fact.sentence)))
    with st.container(key="clicks"):  # takes no room; the row is painted without it, only a click has to wait
        chosen = {"compare_tab": "Why"}
        component("ratings")(
            key=_KEY,
            on_approach_change=lambda: st.session_state.update(chosen, explained=st.session_state[_KEY]["approach"]),
        )
    if (advice := comparison.advice) is None:
        return
    overall = {name: ratings[comparison.window_ms].overall for name, ratings in comparison.fold.ratings.items()}
    rated = overall[advice.approach]
    missed = advice.expected is not None and advice.expected.is_missed_by(rated)
    repeat = comparison.repeats.get(comparison.window_ms)
    beside = [] if repeat is None else [repeat.sentence(rated, LABELS[advice.approach])]
    first, *reasons = (fact.sentence for fact in advice.after(rated))
    headline: list[str] = [first]
    if (raw := overall.get(BASELINE, rated)) - rated >= _NO_CHANGE:
        headline.append(f"The raw CAE model rates {raw:.3f}, higher.")
    results.show_recommendation(headline, [*reasons, *beside], "warning" if missed else "lightbulb")


def _row(comparison: _Comparison) -> str:
    rated = {name: by_window[comparison.window_ms] for name, by_window in comparison.fold.ratings.items()}
    items = []
    for name, rating in rated.items():
        change = _change(rating.overall, rated[BASELINE].overall) if BASELINE in rated and name != BASELINE else ""
        label = f'<span role="button" tabindex="0" data-approach="{name}" title="Why">{escape(LABELS[name])}</span>'
        grade = f'<span class="cf-grade" style="{results.fill(GRADE_COLOURS[rating.grade])}">{rating.grade}</span>'
        values = f"<b>{rating.overall:.3f}</b>{change}{grade}"
        best = comparison.advice is not None and name == comparison.advice.approach
        items.append(_item(label, values, recommended=best))
    if (repeat := comparison.repeats.get(comparison.window_ms)) is not None:
        values = f"<b>{repeat.value:.3f}</b><small>{repeat.lower:.2f}–{repeat.upper:.2f} (95 %)</small>"
        items.append(_item(f"<i>{REPEAT}</i>", values))
    window, basis = results.window_label(comparison.window_ms), comparison.view.campaign.rating_basis
    label = escape(f"Ratings over {window}, with the change from the raw CAE model: {basis}")
    return f'<div class="cf-ratings" role="list" aria-label="{label}" title="{label}">{"".join(items)}</div>'


def _item(name: str, values: str, *, recommended: bool = False) -> str:
    mark, style = ("<span>recommended</span>", ' class="cf-best"') if recommended else ("", "")
    return (
        f'<div role="listitem"{style}><div class="cf-name"><span>{name}</span>{mark}</div>'
        f'<div class="cf-values">{values}</div></div>'
    )


def _change(rating: float, raw: float) -> str:
    by = rating - raw
    style = "" if abs(by) < _NO_CHANGE else ' class="cf-better"' if by > 0 else ' class="cf-worse"'
    return f"<small{style}>{difference(rating, raw, 3)}</small>"


def _show_pulses(comparison: _Comparison) -> None:
    test = comparison.view.held_out
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        shown = choose("Figure", [_MOTION, *_CURVES], key="compared")
        corridors = shown == _MOTION and st.toggle(
            "Corridors of the rating", key="corridors", persist_state="session", help=_CORRIDORS_HELP
        )
        curves = choose_curves(comparison.subject, list(comparison.fold.ratings))
    figure, alt, caption = _CURVES.get(shown, ("motion", "Acceleration, velocity and displacement over time: {}", ""))
    notes = notes_of(comparison.view)
    notes_here = tuple(note for note in notes if note.test == test.id)
    name = "pulses with corridors" if corridors else "pulses" if shown == _MOTION else shown.lower()

    def draw() -> go.Figure:
        drawn = comparison.study.plot(
            test.id, figure, approaches=curves.approaches, also=curves.also, band=curves.approach,
            measured=TEST in curves.others, corridors=corridors, notes=notes_here, display=comparison.view.display,
        )  # fmt: skip
        return without_clicks(drawn)

    show_cached_figure(
        draw, alt.format(curves.of(test.id)), shown, corridors, notes_here, comparison.key, curves.key,
        beside=curves.also, name=curves.named(name),
    )  # fmt: skip
    st.caption(caption or "".join(whole_sentences(comparison.fold.estimates)))
    edit_notes(comparison.view, notes)


def _show_why(comparison: _Comparison) -> None:
    display, test, advice = comparison.view.display, comparison.view.held_out, comparison.advice
    approach = comparison.subject.approach
    explanation = comparison.fold.explained(approach, comparison.window_ms)
    said = {part: plain(text) for part, text in rating_sentences(explanation).items()}
    st.markdown(f"**{LABELS[approach]} {said['overall'].partition('. ')[0].removesuffix('.')}.**")
    draw = partial(comparison.study.plot, test.id, display=display)
    bars, words = st.columns(2, gap="medium")
    with bars:
        alt = f"The four scores of every prediction of test {test.id}, as bars"
        show_cached_figure(partial(draw, "scores"), alt, "parts", comparison.key, name="scores")
    parts = sorted(WEIGHTS, key=lambda part: part != explanation.costliest)
    words.markdown("\n".join(f"- {said[part]}" for part in parts), help=RATING_PARTS)
    if advice is not None:
        test_account = _account(comparison.key, advice.approach, comparison)
        if test_account.disappoints or (test_account.departure is not None and test_account.departure.apart):
            sentences = [fact.sentence for fact in test_account.about_test]
            results.show_account(sentences, missed=test_account.disappoints)
    alt = f"Test {test.id} and its prediction by {LABELS[approach]}: corridors, shifted, warped, and their slopes"
    curves, name = partial(draw, "rating", approaches=[approach]), f"rating of {LABELS[approach]}"
    show_cached_figure(curves, alt, "rated curves", approach, comparison.key, name=name)
    with st.expander("Humps, and stretches outside the corridor", icon=":material/table:"):
        show_table(humps_table(explanation, display), "humps")
        st.caption(HUMPS)
        show_table(excursions_table(explanation, display), "excursions")


@st.cache_resource(max_entries=50, show_spinner="Comparing the test with its neighbours …")
def _account(key: Hashable, approach: str, _comparison: _Comparison) -> Account:  # noqa: ARG001
    campaign, config = _comparison.view.campaign, _comparison.config
    return account(campaign, config, _comparison.fold, _comparison.window_ms, approach=approach)


def _show_ratings(comparison: _Comparison) -> None:
    campaign, fold, window_ms = comparison.view.campaign, comparison.fold, comparison.window_ms
    terms = f"By {campaign.rating_basis}. Single draws: {DRAWS} {A_REPEAT}"
    st.subheader("Rating by approach and window", help=terms)
    added = dict(prediction.curve(comparison.view.display) for prediction in comparison.subject.predictions())
    by_name = {name: (fold, name) for name in fold.ratings} | {
        name: (Fold.of(fold.test, [estimate], comparison.config.windows_ms), estimate.approach)
        for name, estimate in added.items()
    }
    rated = {name: own.ratings[approach] for name, (own, approach) in by_name.items()}
    draws = {n: own.rating_interval(a, window_ms) for n, (own, a) in by_name.items() if a in own.with_band}
    ending = by_name if comparison.config.to_ttzv and fold.ttzv_ms is not None else {}
    to_ttzv = {name: own.overall_to_ttzv(approach) for name, (own, approach) in ending.items()}
    show_table(results.ratings_table(rated, window_ms, comparison.repeats, draws, to_ttzv), "ratings")
    st.caption(f"Corridor, phase, magnitude, slope and single draws: over {results.window_label(window_ms)}.")
    if "lf_tcn" in comparison.config.approaches:
        st.caption(LF)
    columns = [
        (results.TEST_COLUMN, campaign.metrics_of(comparison.view.held_out)),
        *((LABELS[estimate.approach], estimate.metrics) for estimate in fold.estimates),
        *((name, estimate.metrics) for name, estimate in added.items()),
    ]
    results.show_metrics(columns, comparison.view)
    said = () if comparison.advice is None else comparison.advice.sentences
    results.show_details(columns, fold.estimates, comparison.view, said)


def _show_files(comparison: _Comparison) -> None:
    test, study, estimates = comparison.view.held_out, comparison.study, comparison.fold.estimates
    of = f"{comparison.others.name} {test.id}"
    report = choose_report(comparison.view, [test.id])
    with st.container(horizontal=True):
        download_table("scores.csv", lambda: study.scores, of)
        download_table("pulses.csv", lambda: study.pulses, of)
        download_table("metrics.csv", lambda: study.metrics, of)
        if comparison.advice is not None:
            download_report(lambda: study_report(study, comparison.view.display, report), f"{of} {report.form}")
    if comparison.advice is not None:
        remark = f"Test {test.id}, at this condition, was left out."
        offer_pulses(comparison.others, estimates, comparison.advice.approach, comparison.config.seed, [remark])
