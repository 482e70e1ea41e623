"""Past results: opened again, and two studies compared."""

from contextlib import suppress

import streamlit as st

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.errors import DataError, UsageError
from crashfuse.reporting.past_results import comparison_means, comparison_table, described, history_table
from crashfuse.reporting.plots.compared import rating_differences
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.report import comparison_report
from crashfuse.study.comparison import StudyComparison
from crashfuse.study.history import PastResult, past_results
from crashfuse.ui import address, campaigns, frame, page_tables
from crashfuse.ui.downloads import download_report, download_table
from crashfuse.ui.figure_tools import file_name
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.navigation import open_page
from crashfuse.ui.page_tables import window_label
from crashfuse.ui.predict.condition import fill_in
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain

_ROW_PX, _MOST_ROWS = 35, 9
_WIDTHS_PX = {"Campaign": 125, "What": 195}  # all columns fit at 900 px
_TABLE, _REFUSED = "past results", "result that could not be opened"  # session keys


def visible() -> list[PastResult]:
    """Past results: all of this machine, or, where folders are restricted, those of campaigns open to this visitor."""
    results = past_results()
    if not campaigns.roots():
        return results
    mine = {data for name in campaigns.open_campaigns() if (data := _fingerprint(name)) is not None}
    return [result for result in results if result.fingerprint in mine]


def show_results(results: list[PastResult], display: Display) -> None:
    """Show the list; a click on a row opens that result."""
    table = history_table(results, display)

    def take() -> None:
        rows = st.session_state[_TABLE].selection.rows
        st.session_state[_REFUSED] = _open(results[rows[0]]) if rows else ""

    event = st.dataframe(
        table.drop(columns="Data"), hide_index=True, on_select=take, selection_mode="single-row", key=_TABLE,
        height=_ROW_PX * min(len(table) + 1, _MOST_ROWS) + 3, alt="Studies and predictions of this machine",
        column_config={
            "Mean rating": st.column_config.TextColumn(
                alignment="right", help="Over the longest window; of a prediction the central 80 % of what is expected."
            ),
            **{name: st.column_config.TextColumn(width=width) for name, width in _WIDTHS_PX.items()},
        },
    )  # fmt: skip
    if refused := st.session_state.pop(_REFUSED, ""):
        st.warning(plain(refused), icon=":material/folder_off:")
    elif rows := event["selection"]["rows"]:
        open_page(_page(results[rows[0]]))


def compare_two(studies: list[PastResult], display: Display) -> None:
    """Let the user choose two studies, and show which rates better."""
    by_id = {result.id: result for result in studies}
    latest, *others = sorted(studies, key=lambda result: len(result.tests), reverse=True)  # of the largest ones
    before = next((result for result in others if result.fingerprint == latest.fingerprint), others[0])
    before, latest = sorted((before, latest), key=lambda result: result.date)
    chosen = []
    for label, key, usual in (("First study", "first", before), ("Second study", "second", latest)):
        if st.session_state.get(key) not in by_id:
            st.session_state[key] = usual.id
            address.publish()  # the next result would be another default
        name = st.selectbox(  # over the whole width: a description ends with the campaign's name
            label, list(by_id), format_func=lambda name: described(by_id[name], display), key=key,
            persist_state="session",
        )  # fmt: skip
        chosen.append(by_id[name])
    try:
        compared = _compared(chosen[0].id, chosen[1].id, chosen)
    except UsageError as error:
        st.info(str(error), icon=":material/join_inner:")
        return
    way = compared.ways[0]
    if len(compared.ways) > 1:
        way = choose("Left out", compared.ways, key="compared_way", label_of=page_tables.WAYS.__getitem__)
    else:
        st.caption(f"{page_tables.WAYS[way]}, the only way that both studies have.")
    _show(compared, way, display)


@st.cache_resource(max_entries=20, show_spinner=False)
def _compared(first: str, second: str, _chosen: list[PastResult]) -> StudyComparison:  # noqa: ARG001 - the key
    return StudyComparison(*_chosen)


def _show(compared: StudyComparison, way: str, display: Display) -> None:
    window = compared.window(display.window_ms)
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in compared.sentences(window, way)))
    for caution in compared.cautions:
        st.caption(f":material/warning: {plain(caution)}")
    st.subheader(f"Mean rating over {window_label(window)}")
    show_table(comparison_means(compared, window, way), "compared means")
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
        name=file_name("studies compared", window_label(window), way),
    )
    approach = choose(
        "Approach", approaches, key="compared_approach", default=usual if usual in approaches else approaches[0],
        label_of=lambda name: LABELS.get(name, name),
    )  # fmt: skip
    show_table(comparison_table(compared, approach, window, way), "compared tests")
    with st.container(horizontal=True):
        download_table("comparison.csv", lambda: compared.ratings)
        download_report(lambda: comparison_report(compared, display), "", "comparison.html")


def _open(result: PastResult) -> str:
    """Choose in the session whatever a result rests on; returns what is in the way, if anything."""
    names = [name for name in campaigns.open_campaigns() if _fingerprint(name) == result.fingerprint]
    here = st.session_state["campaign"]
    name = here if here in names else next(iter(names), None)
    if name is None:
        return _in_the_way(result)
    frame.choose_campaign(name)
    if name != here:
        frame.note(f"Opened in {campaigns.label(name)}, which has the data of this result.")
    config = result.config
    st.session_state.update(
        preset=config.preset, seed=config.seed, device=config.device,
        approaches=[approach for approach in APPROACHES if approach in config.approaches],
        leave_out="speed group" if config.leave_out == "speed group" else "test",
    )  # fmt: skip
    if len(result.tests) == 1:
        st.session_state["test"] = result.tests[0]
    if result.condition is not None:
        fill_in(campaigns.load(name), result.condition)
    return ""


def _in_the_way(result: PastResult) -> str:
    """Why no open campaign has the data of a result."""
    of = f"The campaign {result.campaign} with the data {result.fingerprint[:8]}"
    for name in campaigns.open_campaigns():
        with suppress(DataError):
            campaign = campaigns.load(name)
            unused = ", ".join(test for test, _ in campaign.unused)
            if campaign.name == result.campaign and unused:
                return f"{of} is open with other tests: use {unused} again on the page Data, then choose it again."
            if campaign.name == result.campaign:
                return (
                    f"{of} was changed since: undo that on the page Data, or open a copy of it, then choose it again."
                )
    return f"{of} is not open on this server: open its folder on the page Data, then choose this result again."


def _page(result: PastResult) -> str:
    if result.condition is not None:
        return "predict"
    return "compare" if len(result.tests) == 1 else "study"


def _fingerprint(name: str) -> str | None:
    try:
        return campaigns.fingerprint_of(name)
    except DataError:
        return None
