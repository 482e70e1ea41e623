"""How each approach rates, and which one was to be used: the head of the Compare page."""

from html import escape

import streamlit as st

from crashfuse.approaches.registry import BASELINE, LABELS
from crashfuse.reporting.rating_tables import REPEAT
from crashfuse.ui import explanations, page_tables
from crashfuse.ui.compare.comparison import Comparison
from crashfuse.wording import difference, joined

_NO_CHANGE = 0.005  # in rating
# The row is painted at once, without this: only a click has to wait for it.
_JS = """
export default ({ setTriggerValue }) => {
  const open = event => {
    const rating = event.target.closest?.(".cf-ratings [data-approach]");
    if (rating) setTriggerValue("approach", rating.dataset.approach);
    return rating;
  };
  const press = event => {
    if (["Enter", " "].includes(event.key) && open(event)) event.preventDefault();  // Space would scroll
  };
  document.addEventListener("click", open);
  document.addEventListener("keydown", press);
  return () => {
    document.removeEventListener("click", open);
    document.removeEventListener("keydown", press);
  };
};
"""
_clicks = st.components.v2.component("crashfuse_ratings", js=_JS)
_KEY = "clicked rating"


def show(comparison: Comparison) -> None:
    """Show the ratings in a row, and the recommendation."""
    st.html(_row(comparison))
    with st.container(key="clicks"):  # takes no room
        _clicks(key=_KEY, on_approach_change=_explain)
    if (advice := comparison.advice) is None:
        return
    rated = comparison.fold.ratings[advice.approach][comparison.window_ms].overall
    missed = advice.expected is not None and advice.expected.is_missed_by(rated)
    beside = []
    if (repeat := comparison.repeats.get(comparison.window_ms)) is not None:
        beside.append(repeat.sentence(rated, LABELS[advice.approach]))
    told, *reasons = advice.after(rated)
    if BASELINE in comparison.fold.ratings:
        raw = comparison.fold.ratings[BASELINE][comparison.window_ms].overall
        if raw - rated >= _NO_CHANGE:
            told = joined([told, f"The raw CAE model rates {raw:.3f}, higher."])
    explanations.show_recommendation([told, *reasons], beside, "warning" if missed else "lightbulb")


def _explain() -> None:
    """Open the tab that takes the rating apart which was clicked."""
    st.session_state.update(compare_tab="Why", explained=st.session_state[_KEY]["approach"])


def _row(comparison: Comparison) -> str:
    """HTML list: by approach its rating, the change from the raw CAE model and the grade; then that of a repeat."""
    window_ms = comparison.window_ms
    overall = {name: by_window[window_ms] for name, by_window in comparison.fold.ratings.items()}
    items = []
    for name, rating in overall.items():
        values = f"<b>{rating.overall:.3f}</b>"
        if BASELINE in overall and name != BASELINE:
            values += _change(rating.overall, overall[BASELINE].overall)
        values += explanations.grade_chip(rating.grade)
        label = f'<span role="button" tabindex="0" data-approach="{name}" title="Why">{escape(LABELS[name])}</span>'
        items.append(_item(label, values, recommended=name == comparison.recommended))
    if (repeat := comparison.repeats.get(window_ms)) is not None:
        values = f"<b>{repeat.value:.3f}</b><small>{repeat.lower:.2f}–{repeat.upper:.2f} (95 %)</small>"
        items.append(_item(f"<i>{REPEAT}</i>", values))
    window, basis = page_tables.window_label(window_ms), comparison.view.campaign.rating_basis
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
