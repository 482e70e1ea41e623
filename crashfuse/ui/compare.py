"""The page Compare: how each approach rates on a held-out test, which one to use, why, and files."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape

import plotly.graph_objects as go
import streamlit as st

from crashfuse.approaches.registry import BASELINE, LABELS
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.reporting.fit_explanations import whole_sentences
from crashfuse.reporting.plots.curves import TEST
from crashfuse.reporting.plots.palette import GRADE_COLOURS
from crashfuse.reporting.rating_tables import REPEAT, excursions_table, humps_table
from crashfuse.reporting.report.study import study_report
from crashfuse.signals.rating import WEIGHTS
from crashfuse.signals.rating_explanation import rating_sentences
from crashfuse.study.config import StudyConfig
from crashfuse.study.facts import window_facts
from crashfuse.study.left_out_account import Account, account
from crashfuse.study.recommendation import Recommendation
from crashfuse.study.repeatability import Repeatability
from crashfuse.study.study import Fold, Study
from crashfuse.ui.kit import results
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import advised
from crashfuse.ui.kit.curves import Shown, Subject, choose_curves, without_clicks
from crashfuse.ui.kit.editing import edit_notes, notes_of
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.files import choose_report, download_report, download_table, offer_pulses
from crashfuse.ui.kit.navigation import component
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import A_REPEAT, DRAWS, HUMPS, LF, RATING_PARTS, plain
from crashfuse.wording import difference

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


@dataclass(frozen=True, eq=False)
class Comparison:
    """A held-out test, every prediction of it, and how they are shown."""

    view: View
    config: StudyConfig  # the settings that were chosen
    study: Study  # of this test alone; while networks train, of fewer approaches than the settings ask for
    fold: Fold
    others: Campaign  # what the predictions learned from
    advice: Recommendation | None  # made without this test; None while approaches are still missing
    key: Hashable  # equal for equal data, settings and display: part of the key of a cached figure

    @classmethod
    def of(cls, view: View, key: Hashable, config: StudyConfig, study: Study) -> "Comparison":
        """The comparison that the held-out test's study allows."""
        test = view.held_out
        fold, others = study.fold(test.id), config.training_campaign(view.campaign, test.id)
        whole = study.config.approaches == config.approaches
        given = key, test.condition, view.display.window_ms
        advice = advised(*given, fold.estimates, others) if whole else None
        return cls(view, config, study, fold, others, advice, (key, study.config.approaches, view.display))

    @property
    def subject(self) -> Subject:
        """What further predictions are of."""
        return Subject(self.view, self.view.held_out.condition, self.view.held_out.id)

    @property
    def repeat(self) -> Repeatability | None:
        """What a repeat of the test would rate, if it is known."""
        return self.study.repeatability.get(self.view.held_out.id, {}).get(self.view.display.window_ms)

    def plot(self, figure: str, shown: Shown, *, corridors: bool = False, notes: Sequence[Note] = ()) -> go.Figure:
        """A figure of the test with the curves that were chosen."""
        drawn = self.study.plot(
            self.view.held_out.id, figure, approaches=shown.approaches, also=shown.also, band=shown.approach,
            measured=TEST in shown.others, corridors=corridors, notes=notes, display=self.view.display,
        )  # fmt: skip
        return without_clicks(drawn)


def show_headline(comparison: Comparison) -> None:
    """Show the ratings in a row, and the recommendation."""
    st.html(_row(comparison))
    for fact in window_facts(comparison.view.held_out, comparison.view.display.window_ms):
        st.caption(plain(comparison.view.display.words(fact.sentence)))
    with st.container(key="clicks"):  # takes no room; the row is painted without it, only a click has to wait
        chosen = {"compare_tab": "Why"}
        component("ratings")(
            key=_KEY,
            on_approach_change=lambda: st.session_state.update(chosen, explained=st.session_state[_KEY]["approach"]),
        )
    if (advice := comparison.advice) is None:
        return
    window_ms = comparison.view.display.window_ms
    overall = {name: ratings[window_ms].overall for name, ratings in comparison.fold.ratings.items()}
    rated = overall[advice.approach]
    missed = advice.expected is not None and advice.expected.is_missed_by(rated)
    repeat = comparison.repeat
    beside = [] if repeat is None else [repeat.sentence(rated, LABELS[advice.approach])]
    first, *reasons = (fact.sentence for fact in advice.after(rated))
    headline = [first]
    if (raw := overall.get(BASELINE, rated)) - rated >= _NO_CHANGE:
        headline.append(f"The raw CAE model rates {raw:.3f}, higher.")
    results.show_recommendation(headline, [*reasons, *beside], "warning" if missed else "lightbulb")


def _row(comparison: Comparison) -> str:
    rated = {name: by_window[comparison.view.display.window_ms] for name, by_window in comparison.fold.ratings.items()}
    items = []
    for name, rating in rated.items():
        change = _change(rating.overall, rated[BASELINE].overall) if BASELINE in rated and name != BASELINE else ""
        label = f'<span role="button" tabindex="0" data-approach="{name}" title="Why">{escape(LABELS[name])}</span>'
        grade = f'<span class="cf-grade" style="{results.fill(GRADE_COLOURS[rating.grade])}">{rating.grade}</span>'
        values = f"<b>{rating.overall:.3f}</b>{change}{grade}"
        best = comparison.advice is not None and name == comparison.advice.approach
        items.append(_item(label, values, recommended=best))
    if (repeat := comparison.repeat) is not None:
        values = f"<b>{repeat.value:.3f}</b><small>{repeat.lower:.2f}–{repeat.upper:.2f} (95 %)</small>"
        items.append(_item(f"<i>{REPEAT}</i>", values))
    window, basis = results.window_label(comparison.view.display.window_ms), comparison.view.campaign.rating_basis
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


def show_pulses(comparison: Comparison) -> None:
    """Show the test and its prediction in the figure that the user picks."""
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
    show_cached_figure(
        lambda: comparison.plot(figure, curves, corridors=corridors, notes=notes_here), alt.format(curves.of(test.id)),
        shown, corridors, notes_here, comparison.key, curves.key, beside=curves.also, name=curves.named(name),
    )  # fmt: skip
    st.caption(caption or "".join(whole_sentences(comparison.fold.estimates)))
    edit_notes(comparison.view, notes)


def show_why(comparison: Comparison) -> None:
    """Explain the rating of one approach."""
    display, test, advice = comparison.view.display, comparison.view.held_out, comparison.advice
    approach = comparison.subject.approach
    explanation = comparison.fold.explained(approach, comparison.view.display.window_ms)
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
def _account(key: Hashable, approach: str, _comparison: Comparison) -> Account:  # noqa: ARG001
    campaign, config = _comparison.view.campaign, _comparison.config
    return account(campaign, config, _comparison.fold, _comparison.view.display.window_ms, approach=approach)


def show_ratings(comparison: Comparison) -> None:
    """Show ratings, metrics, and what the approaches say of themselves."""
    campaign, fold, window_ms = comparison.view.campaign, comparison.fold, comparison.view.display.window_ms
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
    repeats = comparison.study.repeatability.get(comparison.view.held_out.id, {})
    show_table(results.ratings_table(rated, window_ms, repeats, draws, to_ttzv), "ratings")
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


def show_files(comparison: Comparison) -> None:
    """Offer tables; a report, and pulses for others, once every approach is known."""
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
