"""The page History: past results, notes on them, one opened again, two compared."""

from contextlib import suppress

import streamlit as st

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.errors import DataError, UsageError
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
from crashfuse.study.history import LONGEST_NOTE, PastResult, annotate, forget, past_results
from crashfuse.ui.kit import address, campaigns
from crashfuse.ui.kit.address import choose_campaign, note_for_next_page, pin_all
from crashfuse.ui.kit.curves import settings_text
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.files import download_report, download_table
from crashfuse.ui.kit.navigation import open_next
from crashfuse.ui.kit.results import show_table, window_label
from crashfuse.ui.kit.text import plain, show_label
from crashfuse.ui.kit.uploads import uploaded_data
from crashfuse.ui.kit.visitors import note_in_log, visitor
from crashfuse.ui.predict import fill_in

_ROW_PX, _MOST_ROWS = 35, 9
_OPEN = "Open"
_TICKED = ("first", "second")  # session keys: ids of the results that are compared; "" for none
_TABLE, _CLICKED, _CHOSEN = "past results", "clicked result", "result to open"
_REFUSED = "refused result"  # session key


def visible() -> list[PastResult]:
    """Past results of campaigns open to this visitor and, unless folders are restricted, of all but uploads."""
    mine = {data for name in campaigns.open_campaigns() if (data := _fingerprint(name)) is not None}
    hidden = uploaded_data() - mine
    return [
        result
        for result in past_results()
        if result.fingerprint not in hidden and (result.fingerprint in mine or not campaigns.roots())
    ]


def choose_listed(results: list[PastResult], here: str) -> list[PastResult]:
    """Those of the open campaign or of all, as the user chooses."""
    here_only = [result for result in results if result.campaign == here]
    if not here_only or len(here_only) == len(results):
        return results
    labels = {"this": plain(here), "all": "All campaigns"}
    shown = choose("Campaigns", list(labels), key="listed", label_of=labels.__getitem__)
    return here_only if shown == "this" else results


def is_suggested() -> bool:
    """Whether nobody has ticked anything yet, so that two results are compared that are worth it."""
    return [st.session_state[key] for key in _TICKED] == [None, None]


def ticked(results: list[PastResult], listed: list[PastResult]) -> list[PastResult]:
    """Those that are ticked; until somebody ticks one, two of the list that differ."""
    if is_suggested():
        return list(telling_pair([result for result in listed if result.tests]) or ())
    by_id = {result.id: result for result in results}
    asked = [asked_id for key in _TICKED if (asked_id := st.session_state[key])]
    if not {*asked} <= {*by_id}:
        st.warning("A result of this link is not in the list of this machine.", icon=":material/link_off:")
    return [by_id[asked_id] for asked_id in asked if asked_id in by_id]


def show_results(results: list[PastResult], chosen: list[PastResult], display: Display, here: str) -> None:
    """Show the list, from which results are opened and, by ticks, compared."""
    table = history_table(results, display).drop(columns="Data")
    if set(table["Campaign"]) == {here}:
        table = table.drop(columns="Campaign")
    table.insert(0, _OPEN, _OPEN)
    rows = [row for row, result in enumerate(results) if result in chosen]
    address.put(_TABLE, {"selection": {"rows": rows, "columns": [], "cells": []}})

    def tick() -> None:
        selected = [results[row] for row in st.session_state[_TABLE].selection.rows]
        new = [result for result in selected if result not in chosen]
        kept = [] if new and is_suggested() else [result for result in chosen if result in selected]
        ids = [result.id for result in [*kept, *new][-2:]]
        st.session_state.update(zip(_TICKED, [*ids, "", ""], strict=False))

    def open_clicked() -> None:
        open_result(results[st.session_state[_CLICKED].row])

    def open_chosen() -> None:
        open_result(next(result for result in results if result.id == st.session_state[_CHOSEN]))
        st.session_state[_CHOSEN] = None  # to be chosen again, if it could not be opened

    text = st.column_config.TextColumn
    st.dataframe(
        table, hide_index=True, on_select=tick, selection_mode="multi-row", key=_TABLE,
        height=_ROW_PX * min(len(table) + 1, _MOST_ROWS) + 3, alt="Studies and predictions of this machine",
        column_config={  # all columns fit at 900 px
            _OPEN: st.column_config.ButtonColumn("", width=62, key=_CLICKED, on_click=open_clicked),
            "What": text(width=195, help="A test is left out alone, with all at about its speed, or both ways."),
            "Campaign": text(width=100),
            "Mean rating": text(
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


def edit_ticked(ticked: list[PastResult], display: Display) -> None:
    """Offer a note on each result that is ticked, and to take it off the list."""
    for result in ticked:
        key, label = f"note on {result.id}", f"Note on {described(result, display)}"
        show_label(label)
        with st.container(horizontal=True, vertical_alignment="bottom"):
            st.text_input(
                label, result.note, LONGEST_NOTE, key=key, label_visibility="collapsed",
                placeholder="such as: baseline CAE model, before the new rail", on_change=_annotate, args=(result, key),
            )  # fmt: skip
            st.button(
                "Take off the list", icon=":material/playlist_remove:", key=f"forget {result.id}", on_click=_forget,
                args=(result,), help="For everybody on this machine. It is listed again when it is asked for again.",
            )  # fmt: skip
        if refused := st.session_state.pop(f"{key} refused", ""):
            st.warning(plain(refused), icon=":material/warning:")


def _annotate(result: PastResult, key: str) -> None:
    """Keep the note; what is refused stays in its field, and why is shown below it."""
    try:
        annotate(result, st.session_state[key])
    except DataError as error:
        st.session_state[f"{key} refused"] = str(error.problems[0])
    except OSError as error:
        st.session_state[f"{key} refused"] = f"The note was not kept: {error.strerror or error}."


def _forget(result: PastResult) -> None:
    forget(result)
    note_in_log(visitor(), f"took a result of {result.campaign} off the list")


def compare(chosen: list[PastResult], display: Display) -> None:
    """Show the two that are ticked beside each other, or say what to tick."""
    if len(chosen) < 2:
        st.markdown("Tick two results to compare them: studies with a test in common, or predictions.")
        return
    first, second = chosen
    st.header("Two compared")
    st.markdown(f"First: **{plain(described(first, display))}**  \nSecond: **{plain(described(second, display))}**")
    try:
        if not (first.tests or second.tests):
            _offer_predictions(first, second)
            return
        if not (first.tests and second.tests):
            raise UsageError("A prediction has no ratings: tick two studies, or two predictions.")
        compared = _compared(first.id, second.id, chosen)
    except UsageError as error:
        st.info(plain(error), icon=":material/join_inner:")
        return
    way = compared.ways[0]
    if len(compared.ways) > 1:
        way = choose("Left out", compared.ways, key="compared_way", label_of=left_out_in_words)
    elif way in first.by_way:  # else the cautions say it
        st.caption(f"{left_out_in_words(way)}.")
    _offer_pulses(first, second)
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
        (compared.first.id, compared.second.id, window, way),
        name=f"studies compared {compared.first.id} {compared.second.id} {way} 0-{window:g}ms",
    )
    approach = choose(
        "Approach", approaches, key="compared_approach", default=usual if usual in approaches else approaches[0],
        label_of=lambda name: LABELS.get(name, name),
    )  # fmt: skip
    show_table(comparison_table(compared, approach, window, way), "compared tests")


def say_refused() -> None:
    """Say what is in the way of opening a result, if that was just tried."""
    if refused := st.session_state.pop(_REFUSED, ""):
        st.warning(plain(refused), icon=":material/folder_off:")


def open_result(result: PastResult, test: str = "", settings: str = "") -> bool:
    """Open a result, at a test and beside that by other settings perhaps; False if it cannot be, which is then said."""
    names = [name for name in campaigns.open_campaigns() if _fingerprint(name) == result.fingerprint]
    state, config = st.session_state, result.config
    here = state["campaign"]
    if not names:
        state[_REFUSED] = _in_the_way(result)
        return False
    name = here if here in names else names[0]
    choose_campaign(name)
    if name != here:
        note_for_next_page(f"Opened in {campaigns.label(name)}, which has the data of this result.")
    state.update(
        preset=config.preset, seed=config.seed, device=config.device,
        approaches=[approach for approach in APPROACHES if approach in config.approaches],
        leave_out="speed group" if config.leave_out == "speed group" else "test",
    )  # fmt: skip
    if len(result.tests) == 1 or test:
        state["test"] = test or result.tests[0]
    if result.condition is not None:
        fill_in(campaigns.load(name), result.condition)
    at_test = test or len(result.tests) == 1
    page = "predict" if result.condition is not None else "compare" if at_test else "study"
    if settings:
        state[f"{page}_also"] = list(dict.fromkeys([*state[f"{page}_also"], settings]))
    open_next(page)
    return True


def _in_the_way(result: PastResult) -> str:
    data = f"campaign {result.campaign} with the data {result.fingerprint[:8]}"
    for name in campaigns.open_campaigns():
        with suppress(DataError):
            campaign = campaigns.load(name)
            if campaign.name == result.campaign:
                unused = ", ".join(test for test, _ in campaign.unused)
                change = f"use {unused} again" if unused else "undo the last change, or open a copy"
                return f"The {data} was changed since: {change} on the page Data, then choose the result again."
    return f"You have not opened the {data}: open its folder, or upload it, on the page Data, then choose it again."


def _fingerprint(name: str) -> str | None:
    """That of the data of an open campaign; None if it cannot be read any more."""
    try:
        return campaigns.fingerprint_of(name)
    except DataError:
        return None


def _offer_pulses(first: PastResult, second: PastResult) -> None:
    """Offer to show both on Compare, if they rest on the same data and have one test in common."""
    shared = [test for test in first.tests if test in second.tests]
    config, others = first.config.split_configs[0], second.config.split_configs
    other = settings_text(next((way for way in others if way.leave_out == config.leave_out), others[0]))

    def open_both() -> None:
        open_result(first, shared[0], other)

    if first.fingerprint == second.fingerprint and len(shared) == 1 and other != settings_text(config):
        st.button(
            f"Show both on Compare, {plain(shared[0])}", icon=":material/stacked_line_chart:", on_click=open_both,
            help="The pulses of the second stand beside those of the first.",
        )  # fmt: skip


def _offer_predictions(first: PastResult, second: PastResult) -> None:
    """Offer to show two predictions beside each other on the page Predict: by other settings, or one of them pinned."""
    same_settings = (first.config.preset, first.config.seed) == (second.config.preset, second.config.seed)
    if first.fingerprint != second.fingerprint or not (same_settings or first.condition == second.condition):
        raise UsageError(
            "Predict shows predictions beside each other that rest on the same data and differ in their condition or "
            "in their settings; these do not."
        )

    def open_both() -> None:
        if same_settings and open_result(first):
            pin_all([result.condition for result in (first, second) if result.condition is not None])
        elif not same_settings:
            open_result(first, settings=settings_text(second.config))

    st.button("Show both on Predict", icon=":material/keep:", type="primary", on_click=open_both)
