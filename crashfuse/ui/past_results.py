"""Past results on the page Study: studies, predictions, certifications; two compared."""

from functools import partial

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.campaign import Campaign
from crashfuse.certification import file_store
from crashfuse.certification.certify import APPROACH
from crashfuse.certification.earlier import Earlier
from crashfuse.errors import Problem, UsageError
from crashfuse.results.comparison import comparison_result, described, history_table, left_out_in_words
from crashfuse.results.render.html import report
from crashfuse.study.history import LONGEST_NOTE, PastResult, StudyComparison, annotate, past_results
from crashfuse.ui.certify import criteria, matrix
from crashfuse.ui.kit import address, campaigns
from crashfuse.ui.kit.address import pin_all
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.files import export_button, offer
from crashfuse.ui.kit.navigation import open_next
from crashfuse.ui.kit.results import refused_into, show_problems, show_table, window_label
from crashfuse.ui.kit.text import plain
from crashfuse.ui.kit.uploads import uploaded_data
from crashfuse.units import Sentence

_ROW_PX, _MOST_ROWS = 35, 9
_TICKED = "ticked"  # session key: ids of the results to open or to compare
_TABLE, _REFUSED = "past results", "refused result"  # session keys


def show(view: View, row: DeltaGenerator) -> None:
    """Show the list, what can be done with those ticked, and two studies compared."""
    if problems := st.session_state.pop(_REFUSED, None):
        show_problems(problems, "This could not be done", "", place="past results")
    results = _listed(view.campaign)
    if not results:
        st.markdown("Nothing yet: studies, predictions and kept certifications of this campaign appear here.")
        return
    _show_list(results, view)
    by_id = {result.id: result for result in results}
    ticked = [by_id[asked] for asked in st.session_state[_TICKED] if asked in by_id]
    if len(ticked) < len(st.session_state[_TICKED]):
        st.warning("A result of this link is not on this machine.", icon=":material/link_off:")
    for result, which in zip(ticked, ("the first: ", "the second: ") if len(ticked) > 1 else ("",), strict=False):
        _show_ticked(result, which, view)
    if len(ticked) < 2:
        st.caption("Tick a result to open it or to note something, two studies to compare them.")
        return
    studies = [result for result in ticked if isinstance(result, PastResult) and result.tests]
    try:
        if len(studies) < 2:
            raise UsageError("Only two studies are compared, by their ratings.")
        _show_compared(StudyComparison(*studies), view, row)
    except UsageError as error:
        st.info(plain(error), icon=":material/join_inner:")


def _listed(campaign: Campaign) -> list[PastResult | Earlier]:
    hidden, is_restricted = uploaded_data(), bool(campaigns.roots())
    studies = [
        result
        for result in past_results()
        if result.fingerprint == campaign.fingerprint
        or (result.campaign == campaign.name and result.fingerprint not in hidden and not is_restricted)
    ]
    results: list[PastResult | Earlier] = [*studies, *file_store.certifications(campaign).values()]
    return sorted(results, key=lambda result: result.date.replace("T", " ")[:16], reverse=True)


def _show_list(results: list[PastResult | Earlier], view: View) -> None:
    state, table = st.session_state, history_table(results).without("Campaign", "Data", "Id").texts(view.display)
    rows = [row for row, result in enumerate(results) if result.id in state[_TICKED]]
    address.put(_TABLE, {"selection": {"rows": rows, "columns": [], "cells": []}})

    def tick() -> None:
        selected = [results[row].id for row in state[_TABLE].selection.rows]
        before = [ticked for ticked in state[_TICKED] if ticked in selected]
        state[_TICKED] = [*before, *(ticked for ticked in selected if ticked not in before)][-2:]

    st.dataframe(
        table, hide_index=True, on_select=tick, selection_mode="multi-row", key=_TABLE,
        height=_ROW_PX * min(len(table) + 1, _MOST_ROWS) + 3, alt="Past results of this campaign, the latest first",
        column_config={  # all columns fit at 900 px
            "What": st.column_config.TextColumn(width=210),
            "Mean rating": st.column_config.TextColumn(
                "Result", help="Mean or expected rating over the longest window, or planned tests that need not be run."
            ),
        },
    )  # fmt: skip


def _show_ticked(result: PastResult | Earlier, which: str, view: View) -> None:
    key, text = f"note on {result.id}", described(result)

    def note(result: PastResult) -> None:
        with refused_into(_REFUSED, result.campaign):
            annotate(result, st.session_state[key])

    with st.container(horizontal=True, vertical_alignment="center"):
        st.button(f"Open {which}{plain(text)}", icon=":material/arrow_forward:", on_click=_open, args=(result, view))
        if isinstance(result, PastResult):
            label, example = plain(Sentence("Note on {}", text)), "note, such as: before the new rail"
            st.text_input(
                label, result.note, LONGEST_NOTE, key=key, label_visibility="collapsed", placeholder=example,
                on_change=note, args=(result,),
            )  # fmt: skip


def _open(result: PastResult | Earlier, view: View) -> None:
    if isinstance(result, Earlier):
        _open_certification(result, view)
        return
    state, config = st.session_state, result.config
    if result.fingerprint != view.campaign.fingerprint:
        expected, advice = f"the data {result.fingerprint[:8]}", "undo the change on Data, or open a copy"
        state[_REFUSED] = (Problem(result.campaign, expected, "data that were changed since", advice),)
        return
    state.update(
        preset=config.preset, seed=config.seed, device=config.device,
        approaches=[approach for approach in APPROACHES if approach in config.approaches],
        leave_out="speed group" if config.leave_out == "speed group" else "test", study_tab="Ratings",
    )  # fmt: skip
    if result.condition is not None:
        address.choose_condition(view.campaign, result.condition)
        pin_all([result.condition])
        open_next("predict")
    elif len(result.tests) == 1:
        state["test"] = result.tests[0]
        open_next("compare")


def _open_certification(earlier: Earlier, view: View) -> None:
    state, kept = st.session_state, file_store.certifications(view.campaign)
    with refused_into(_REFUSED, view.campaign.name):
        matrix.take(earlier.matrix)
        criteria.take(earlier.criteria)
        state["earlier"] = next(name for name, other in kept.items() if other.id == earlier.id)
        labelled = [name for name, label in LABELS.items() if label == earlier.settings.get("approach")]
        state["approach"] = next(iter(labelled), APPROACH)
        open_next("certify")


def _show_compared(compared: StudyComparison, view: View, row: DeltaGenerator) -> None:
    result, way = comparison_result(compared, view.display.window_ms), compared.ways[0]
    window = compared.window(view.display.window_ms)
    st.subheader(f"The two compared, {window_label(window)}")
    if len(compared.ways) > 1:
        way = choose("Left out", compared.ways, key="compared_way", label_of=left_out_in_words)
    shown = result.parts["ways"][compared.ways.index(way)]
    for caution in result.cautions:
        st.markdown(f":material/warning: {plain(caution)}")
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in shown.answer))
    show_table(shown.tables["means"], "compared means")
    if compared.over(window, way)["held_out"].nunique() > 1:
        draw = partial(shown.figures["differences"].draw, view.display)
        alt = "Ratings by test, second study minus first"
        of = compared.first.id, compared.second.id, way, f"0-{window:g}ms"
        show_cached_figure(draw, alt, *of, name=f"studies compared {' '.join(of)}")
    with row:
        export_button(partial(offer, "", {**result.files, "comparison.html": lambda: report(result, view.display)}))
