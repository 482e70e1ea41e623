"""Past results: the list of them, and two compared."""

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.errors import UsageError
from crashfuse.reporting.past_results import (
    comparison_means,
    comparison_table,
    described,
    history_table,
    left_out_in_words,
)
from crashfuse.reporting.plots.compared import rating_differences
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.report import comparison_report
from crashfuse.study.comparison import StudyComparison, telling_pair
from crashfuse.study.history import PastResult, past_results
from crashfuse.ui import address, campaigns
from crashfuse.ui.downloads import download_report, download_table
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.page_tables import window_label
from crashfuse.ui.reopening import fingerprint, offer_predictions, offer_pulses, open_result
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain
from crashfuse.ui.uploads import uploaded

_ROW_PX, _MOST_ROWS = 35, 9
_OPEN = "Open"
_WIDTHS_PX = {_OPEN: 62, "Campaign": 100, "What": 195}  # all columns fit at 900 px
_TICKED = ("first", "second")  # session keys: ids of the results that are compared; "" for none
_TABLE, _CLICKED, _CHOSEN = "past results", "clicked result", "result to open"
_HOW_TO_COMPARE = (
    "No two studies listed here share a test and differ in their data or settings: run one again with another seed, "
    "say, and both are compared here."
)


def visible() -> list[PastResult]:
    """Past results of campaigns that are open to this visitor and, unless folders are restricted, of all folders.

    What somebody has uploaded is never for everybody.
    """
    mine = {data for name in campaigns.open_campaigns() if (data := fingerprint(name)) is not None}
    hidden = uploaded() - mine
    return [
        result
        for result in past_results()
        if result.fingerprint not in hidden and (result.fingerprint in mine or not campaigns.roots())
    ]


def of_campaign(results: list[PastResult], here: str) -> list[PastResult]:
    """Those of the open campaign, or those of all, as the user chooses; all if it has none."""
    own = [result for result in results if result.campaign == here]
    if not own or len(own) == len(results):
        return results
    labels = {"this": plain(here), "all": "All campaigns"}
    return own if choose("Campaigns", list(labels), key="listed", label_of=labels.__getitem__) == "this" else results


def with_ticked(results: list[PastResult], listed: list[PastResult], chosen: list[PastResult]) -> list[PastResult]:
    """The list with whatever is ticked, of any campaign: what is compared can be seen, and its tick taken away."""
    missing = [result for result in chosen if result not in listed]
    return sorted([*listed, *missing], key=results.index) if missing else listed


def is_suggested() -> bool:
    """Whether nobody has ticked anything yet, so that two results are compared that are worth it."""
    return [st.session_state[key] for key in _TICKED] == [None, None]


def ticked(results: list[PastResult], listed: list[PastResult]) -> list[PastResult]:
    """Those that are ticked, the first one first; until somebody ticks one, two of the list that differ."""
    if is_suggested():
        return list(telling_pair([result for result in listed if result.tests]) or ())
    asked = [st.session_state[key] for key in _TICKED]
    by_id = {result.id: result for result in results}
    if any(asked_id and asked_id not in by_id for asked_id in asked):
        st.warning("A result of this link is not in the list of this machine.", icon=":material/link_off:")
    return [by_id[asked_id] for asked_id in asked if asked_id in by_id]


def show_results(results: list[PastResult], chosen: list[PastResult], display: Display, here: str) -> None:
    """Show the list: a button in each row opens it, by keyboard a field below; ticks choose which are compared."""
    table = history_table(results, display).drop(columns="Data")
    if set(table["Campaign"]) == {here}:
        table = table.drop(columns="Campaign")
    table.insert(0, _OPEN, _OPEN)
    rows = [row for row, result in enumerate(results) if result in chosen]
    address.put(_TABLE, {"selection": {"rows": rows, "columns": [], "cells": []}})

    def tick() -> None:
        found = [results[row] for row in st.session_state[_TABLE].selection.rows]
        new = [result for result in found if result not in chosen]
        kept = [] if new and is_suggested() else [result for result in chosen if result in found]
        ids = [result.id for result in [*kept, *new][-2:]]
        st.session_state.update(zip(_TICKED, [*ids, "", ""], strict=False))  # "": none, and that was chosen

    def open_clicked() -> None:
        open_result(results[st.session_state[_CLICKED].row])

    def open_chosen() -> None:
        open_result(next(result for result in results if result.id == st.session_state[_CHOSEN]))
        st.session_state[_CHOSEN] = None  # to be chosen again, if it could not be opened

    st.dataframe(
        table, hide_index=True, on_select=tick, selection_mode="multi-row", key=_TABLE,
        height=_ROW_PX * min(len(table) + 1, _MOST_ROWS) + 3, alt="Studies and predictions of this machine",
        column_config={
            _OPEN: st.column_config.ButtonColumn("", width=_WIDTHS_PX[_OPEN], key=_CLICKED, on_click=open_clicked),
            "What": st.column_config.TextColumn(
                width=_WIDTHS_PX["What"], help="A test is left out alone, with all at about its speed, or both ways."
            ),
            "Campaign": st.column_config.TextColumn(width=_WIDTHS_PX["Campaign"]),
            "Mean rating": st.column_config.TextColumn(
                "Rating", alignment="right",
                help="Over the longest window: of a study the mean, of a prediction 80 % of what is to be expected.",
            ),
        },
    )  # fmt: skip
    named = {result.id: described(result, display) for result in results}
    st.selectbox(
        "Open a result", list(named), index=None, placeholder="Open a result", key=_CHOSEN, on_change=open_chosen,
        format_func=named.__getitem__, label_visibility="collapsed",
    )  # fmt: skip


def compare(chosen: list[PastResult], display: Display) -> None:
    """Show the two that are ticked beside each other, or say what to tick."""
    if len(chosen) < 2:
        st.markdown(_HOW_TO_COMPARE if is_suggested() else "Tick two results to compare them.")
        return
    first, second = chosen
    st.header("Two compared")
    st.markdown(f"First: **{plain(described(first, display))}**  \nSecond: **{plain(described(second, display))}**")
    if not (first.tests or second.tests):
        offer_predictions(first, second)
        return
    if not (first.tests and second.tests):
        st.info("A prediction has no ratings: tick two studies, or two predictions.", icon=":material/join_inner:")
        return
    try:
        compared = _compared(first.id, second.id, chosen)
    except UsageError as error:
        st.info(plain(error), icon=":material/join_inner:")
        return
    way = compared.ways[0]
    if len(compared.ways) > 1:
        way = choose("Left out", compared.ways, key="compared_way", label_of=left_out_in_words)
    elif way in first.by_way:  # else the cautions say it
        st.caption(f"{left_out_in_words(way)}.")
    offer_pulses(first, second)
    _show(compared, way, display)


@st.cache_resource(max_entries=20, show_spinner=False)
def _compared(first: str, second: str, _chosen: list[PastResult]) -> StudyComparison:  # noqa: ARG001 - the key
    return StudyComparison(*_chosen)


def _show(compared: StudyComparison, way: str, display: Display) -> None:
    window = compared.window(display.window_ms)
    for caution in compared.cautions:
        st.markdown(f":material/warning: {plain(caution)}")
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in compared.sentences(window, way)))
    several = compared.over(window, way)["held_out"].nunique() > 1
    st.subheader(f"{'Mean rating' if several else 'Rating'} over {window_label(window)}")
    show_table(comparison_means(compared, window, way), "compared means")
    if several:
        _show_each_test(compared, window, way)
    with st.container(horizontal=True):
        download_table("comparison.csv", lambda: compared.ratings)
        download_report(lambda: comparison_report(compared, display), "", "comparison.html")


def _show_each_test(compared: StudyComparison, window: float, way: str) -> None:
    approaches = list(compared.means(window, way)["approach"])
    usual = compared.second.approach
    st.subheader("Each test")
    show_cached_figure(
        lambda: rating_differences(compared, window, way),
        "Rating of each test in the second study minus that in the first, by approach, with their mean",
        compared.first.id,
        compared.second.id,
        window,
        way,
        name=f"studies compared {compared.first.id} {compared.second.id} {way} 0-{window:g}ms",
    )
    approach = choose(
        "Approach", approaches, key="compared_approach", default=usual if usual in approaches else approaches[0],
        label_of=lambda name: LABELS.get(name, name),
    )  # fmt: skip
    show_table(comparison_table(compared, approach, window, way), "compared tests")
