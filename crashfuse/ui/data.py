"""The page Data: what a campaign holds, and ways to open one: a folder, dropped files, files that can be imported."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import has_table
from crashfuse.campaign_folder.load import unread_files
from crashfuse.condition import about_label
from crashfuse.errors import DataError, Problem
from crashfuse.readers.formats import all_formats
from crashfuse.results.campaign import cae_errors_table
from crashfuse.results.drawing import Drawing
from crashfuse.results.fit_explanations import events_sentences, events_table
from crashfuse.results.plots.displacement import missing_force
from crashfuse.results.result_tables import IN_RANGE, about_table, quality_table, tests_table, wall_table
from crashfuse.signals.filters import cfc_filter
from crashfuse.study.facts import campaign_facts
from crashfuse.ui import import_step
from crashfuse.ui.kit import address, campaigns, editing
from crashfuse.ui.kit.address import REFUSED, choose_campaign, choose_held_out, chosen_config, kept
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import mending_request, study_request
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.frame import offer_sample, show_title
from crashfuse.ui.kit.navigation import open_page, show_link
from crashfuse.ui.kit.progress import result_or_none
from crashfuse.ui.kit.results import show_problems, show_table
from crashfuse.ui.kit.text import TTZV, plain
from crashfuse.ui.kit.uploads import Source, begin_import, leave_import, open_uploads, running_import, source_at
from crashfuse.units import speed

_ROUND = "uploads so far"
_PICKED = "folder picked"  # session key
_CLASSES = (60, 180, 600)
_AS_READ = "As read"
_WAYS = {
    "add": ("Add tests or CAE runs", ":material/add:"),
    "open": ("Open another campaign", ":material/folder_open:"),
}
_ASKED = "asked for the next prediction"  # session key
_MEND = "What to mend in the CAE model"
_LAYOUT = """<pre>tests.csv            one row a test: id, speed_mph, front_weight_lb, rear_weight_lb
tests/&lt;id&gt;.csv       its pulse: time_ms, acceleration_g
cae.csv              one row a CAE run: id, speed_mph, front_weight_lb, rear_weight_lb
cae_pulses.parquet   all CAE pulses: id, time_ms, acceleration_g</pre>"""  # st.code fetches 1.5 MB to colour programs


def show(view: View | None) -> None:
    """Show an import that goes on, else the open campaign, else how to open one."""
    if (source := running_import()) is not None:
        with st.container(key="import-step"):
            import_step.show_import(source, view)
    elif view is None:
        st.title("crashfuse")
        st.markdown(
            "crashfuse corrects a CAE crash model with the few full-frontal barrier tests that you have, predicts the "
            "pulse of a crash that was never run, and rates every prediction by ISO/TS 18571."
        )
        offer_sample()
        st.caption("A synthetic car: 11 tests and about a thousand CAE runs, made by a small simulation.")
        st.subheader("Or open a campaign of your own")
        _show_open_forms()
    elif (way := st.session_state["opening"]) is not None:
        with show_title(_WAYS[way][0]):
            st.button("Back", icon=":material/arrow_back:", on_click=st.session_state.update, args=({"opening": None},))
        _show_open_forms()
    else:
        _show_head(view)
        tabs = {"Tests": _show_tests, "Conditions": _show_conditions, "CAE model": _show_library}
        with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
            tab = choose("Tab", list(tabs), key="data_tab")
            _offer_next(view)
        tabs[tab](view)


def _show_head(view: View) -> None:
    campaign = view.campaign
    speeds = [test.condition.speed_mps for test in campaign.tests]
    paired = sum(campaign.cae.paired_run(test.condition) is not None for test in campaign.tests)
    with show_title(plain(campaign.name)):
        at = view.display.words(speed(*dict.fromkeys((min(speeds), max(speeds))), form=".0f"))
        tip = f"Tests with a paired CAE run: {paired}. SHA-256 of all data: {campaign.fingerprint}"
        st.caption(f"Tests at {at} · Fingerprint {campaign.fingerprint[:12]}", width="content", help=tip)
        for way, (label, icon) in _WAYS.items():
            st.button(label, icon=icon, on_click=st.session_state.update, args=({"opening": way},))
    for warning in campaign.warnings:
        st.warning(plain(warning), icon=":material/warning:")
    editing.offer_leaving_out(view)
    if unread := unread_files(view.folder):
        st.caption(plain(unread))
    editing.show_last_change(view)


def _offer_next(view: View) -> None:
    if len(view.campaign.tests) == 1:
        show_link("predict", "Next: predict another condition")
        return
    request = study_request(view.campaign, (view.held_out.id,), chosen_config())

    def predict_next() -> None:  # a callback, so that a click while the page is still drawn counts
        request.ask("compare")
        st.session_state[_ASKED] = True

    label = f"Next: predict test {plain(view.held_out.id)} from the others, and compare"
    st.button(label, type="primary", icon=":material/arrow_forward:", on_click=predict_next)
    if st.session_state.pop(_ASKED, False):
        open_page("compare")


def _show_tests(view: View) -> None:
    campaign, test, display = view.campaign, view.held_out, view.display
    shown = tuple(asked for asked in st.session_state["overlaid"] if asked in campaign.test_ids)
    options = [_AS_READ, *(f"CFC {cfc}" for cfc in _CLASSES)]
    address.default("filter", _AS_READ, options)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        editing.choose_tests_in_use(view)
        look = kept("filter", default=_AS_READ, help="Of this figure: approaches use the pulses as read.")
        choice = str(st.segmented_control("Channel filter class (SAE J211-1)", options, required=True, **look))
        if shown:
            all_tests, args = f"All {len(campaign.tests)} tests", ({"overlaid": list[str]()},)
            st.button(all_tests, icon=":material/stacked_line_chart:", on_click=st.session_state.update, args=args)
    for fact in campaign_facts(campaign):
        if fact.code == "test.stands_apart" and fact.about[0] in shown:
            st.markdown(f":material/warning: {plain(display.words(fact.sentence))}")
    editing.show_tests_out_of_use(view)
    cfc = None if choice == _AS_READ else float(choice.removeprefix("CFC "))
    alt = f"Pulses of tests over time, {'as read' if cfc is None else f'filtered to {choice}'}, coloured by speed"
    draw = partial(campaign.draw, tests=shown, held_out=test.id, cfc=cfc, display=display)
    key = test.id, shown, cfc, display
    show_cached_figure(draw, alt, "tests", campaign.fingerprint, key, name=f"tests {choice}")
    asked = campaign.channel_filter_class
    reading = "as they are in the files" if asked is None else f"filtered to CFC {asked:g}, as campaign.toml asks"
    if cfc is None:
        st.caption(f"Read {reading}. Dark: slow; bright: fast; dashes, marks: repeats.")
        return
    accel = test.pulse.accel_mps2
    filtered = cfc_filter(accel, cfc=cfc, dt_s=test.pulse.dt_s)
    peaks = [abs(pulse * display.accel_scale).max() for pulse in (accel, filtered)]
    became = f"The peak of {plain(test.id)} goes from {peaks[0]:.1f} to {peaks[1]:.1f} {display.unit}."
    st.caption(f"Thick: filtered to {choice}; thin: as read, {reading}. {became}")


def _show_conditions(view: View) -> None:
    campaign = view.campaign
    draw = partial(campaign.draw, "conditions", held_out=view.held_out.id, display=view.display)
    alt, key = "Speed against front and rear weight of CAE runs and tests", (view.held_out.id, view.display.system)
    show_cached_figure(draw, alt, "conditions", campaign.fingerprint, key, name="conditions")
    in_their_table = {about_label(name) for test in campaign.tests for name, _ in test.about}
    show_table(tests_table(campaign).without(IN_RANGE, *in_their_table), "conditions")  # which the figure shows
    if not (about := about_table(campaign)).empty:
        st.markdown("**Where tests and CAE runs come from**")
        show_table(about, "about")
    if not (walls := wall_table(campaign)).empty:
        st.markdown("**The force of the barrier beside mass and pulse**")
        draw = partial(campaign.draw, "wall", display=view.display)
        alt = "Force of the barrier, and mass times deceleration (dotted)"
        show_cached_figure(draw, alt, "wall", campaign.fingerprint, view.display, name="wall")
        show_table(walls, "walls")


def _show_library(view: View) -> None:
    campaign, test, display = view.campaign, view.held_out, view.display
    errors, table = cae_errors_table(campaign, display.window_ms), st.container()
    with st.container(horizontal=True, vertical_alignment="center"):
        _choose_overlaid(view)
        meaning = f"{TTZV} Ratings by {campaign.rating_basis}."
        is_whole = st.toggle("CAE and test", key="cae and test", persist_state="session", help=meaning)
    if not is_whole:
        minus = (replace(own, kind="difference") if own.kind == "pair" else own for own in errors.columns)
        errors = replace(errors, columns=tuple(minus))
    with table:
        show_table(errors, "cae errors", "CAE / test, **difference**" if is_whole else "CAE minus test")
    left, right = st.columns(2, gap="medium")
    with left:
        draw = partial(campaign.draw, "cae and test", held_out=test.id, display=display)
        alt, key = f"Test {test.id} and the CAE model at its condition, over time", (test.id, display)
        show_cached_figure(draw, alt, "cae and test", campaign.fingerprint, key, name=f"{test.id} and CAE")
    with st.expander(f"All {len(campaign.cae):,} CAE runs", icon=":material/stacked_line_chart:"):
        alt = "Pulses of the CAE model over time: the middle 90 % of all runs, and paired runs"
        draw = partial(campaign.draw, "cae", display=display)
        show_cached_figure(draw, alt, "library", campaign.fingerprint, display, name="CAE runs")
        st.caption(plain(campaign.quality.summary))
    _show_quality(campaign)
    if len(campaign.tests) > 1:
        with right:
            _show_mending(view)


def _choose_overlaid(view: View) -> None:
    state, key, ids = st.session_state, "test over CAE", view.campaign.test_ids
    address.put(key, view.held_out.id)
    look: dict[str, Any] = {"key": key, "label_visibility": "collapsed"}
    look["on_change"] = lambda: choose_held_out(view.campaign.test(state[key]))
    st.segmented_control("Test", ids, required=True, wrap=True, format_func=plain, **look)


def _show_mending(view: View) -> None:
    campaign, display = view.campaign, view.display
    tip = "A line a test, dark: slow, bright: fast. By all tests: a diagnosis, no left-out prediction."
    st.markdown(f"**{_MEND}**", help=tip)
    events = result_or_none(mending_request(campaign, display.window_ms), invitation="", button=_MEND)
    if events is None:
        return
    alt = "Force that the CAE model lacks in each test over displacement, and the ranges to mend"

    def draw() -> Drawing:
        drawing = missing_force(events, display)
        drawing.update(showlegend=False)  # eleven names would leave half a column no room
        return drawing

    show_cached_figure(draw, alt, _MEND, campaign.fingerprint, display, name="what to mend")
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in events_sentences(events)))
    if events.events:
        with st.expander("Every range", icon=":material/table:"):
            show_table(events_table(events))


def _show_quality(campaign: Campaign) -> None:
    verdict = campaign.quality
    if not (table := quality_table(verdict)).empty:
        st.markdown(f"**Quality of the CAE runs**: {plain(verdict.summary)}")
        show_table(table, "quality")
    for sentence in verdict.named:
        st.warning(plain(sentence), icon=":material/warning:")
    if verdict.failing:
        with st.expander("All runs that fail"):
            runs = verdict.failing_runs[["id", "fails"]].rename(columns={"id": "CAE run", "fails": "Beyond the limit"})
            st.dataframe(runs, hide_index=True)


def _show_open_forms() -> None:
    folder, upload = st.columns(2, gap="large")
    with folder.form("open folder", border=False):
        usual = "a campaign, tests or CAE runs: the whole path"
        tip = "On the computer that crashfuse runs on. What is no campaign is imported, once you have seen it."
        st.text_input("A folder or file on this computer", key="folder", placeholder=usual, help=tip)
        st.form_submit_button("Open folder", icon=":material/folder_open:", on_click=_open_folder)
    with folder:
        _pick_folder()
    if folders := campaigns.recent_folders():
        with folder.container(horizontal=True, vertical_alignment="center", gap="small"):
            st.caption("Opened before:", width="content")
            for place, label in zip(folders, campaigns.folder_labels(folders), strict=True):
                open_it, tip = partial(_attempt, partial(_campaign_or_source, place)), plain(str(place))
                st.button(plain(label), key=f"recent {place}", help=tip, type="tertiary", on_click=open_it)
    with upload.form("open upload", border=False):
        tip = f"A campaign, or files to import: {all_formats()}. They go to crashfuse alone, which deletes them."
        key = f"files {st.session_state.get(_ROUND, 0)}"
        st.file_uploader("Or upload files", accept_multiple_files=True, key=key, help=tip)
        st.form_submit_button("Open upload", icon=":material/upload_file:", on_click=_open_upload)
    if problems := st.session_state.get(REFUSED):
        show_problems(problems, place="open")
    import_step.show_unfinished()
    with st.expander("What does a campaign folder look like?", icon=":material/help:"):
        st.html(_LAYOUT)
        st.caption("Names of columns end in units: `_mph`, `_kph`, `_mps`, `_lb`, `_kg`, `_ms`, `_s`, `_g`, `_mps2`.")


def _pick_folder() -> None:
    state, (start, *_) = st.session_state, (*campaigns.recent_folders(), *campaigns.roots(), Path.home())
    here = Path(state.get(_PICKED) or start)

    def go(folder: Path) -> None:
        state[_PICKED] = state["folder"] = str(folder)

    def enter() -> None:
        if name := state[f"folders in {here}"]:
            go(here / name)

    with st.popover("Pick a folder", icon=":material/folder:"):
        st.caption(plain(str(here)))
        is_top = here.parent == here or not campaigns.may_open(here.parent)
        st.button("Up", icon=":material/arrow_upward:", on_click=go, args=(here.parent,), disabled=is_top)
        names = campaigns.folders_in(here)
        look: dict[str, Any] = {"placeholder": "choose one" if names else "none", "disabled": not names}
        st.selectbox("Folders in it", names, index=None, key=f"folders in {here}", on_change=enter, **look)
        st.button("Open this folder", type="primary", on_click=_attempt, args=(partial(_campaign_or_source, here),))


def _attempt(open_it: Callable[[], str | Source]) -> None:
    st.session_state.pop(REFUSED, None)
    try:
        opened = open_it()
        st.session_state.update(data_tab=None, opening=None)  # what was opened is to be seen
        if isinstance(opened, Source):
            begin_import(opened)
        else:
            leave_import()
            choose_campaign(opened)
    except DataError as error:
        st.session_state[REFUSED] = error.problems


def _open_folder() -> None:
    if text := campaigns.unquoted(st.session_state["folder"]):
        _attempt(lambda: _campaign_or_source(Path(text)))


def _campaign_or_source(path: Path) -> str | Source:
    path = campaigns.allowed(path)
    if path.is_file():
        return _source_or_advice(path)
    try:
        return campaigns.open_folder(path)
    except DataError:
        if not has_table(path):
            with suppress(DataError, OSError):
                return source_at(path)
        raise


def _source_or_advice(file: Path) -> Source:
    try:
        return source_at(file)
    except (DataError, OSError) as error:
        expected, found = "a campaign folder, or a file that can be imported", "a file of another kind"
        advice = "name the folder that holds tests.csv and cae.csv"
        if file.suffix.lower() == ".zip":
            found = error.problems[0].found if isinstance(error, DataError) else str(error)
            advice = "upload it if it is a campaign, or unpack it and name its folder"
        raise DataError(Problem(str(file), expected, found, advice)) from error


def _open_upload() -> None:
    state, so_far = st.session_state, st.session_state.get(_ROUND, 0)
    _attempt(lambda: open_uploads(state[f"files {so_far}"]))
    state[_ROUND] = so_far + (REFUSED not in state)
