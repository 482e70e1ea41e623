"""Data: open a campaign, and see what is in it."""

from collections.abc import Callable
from pathlib import Path

import streamlit as st

from crashfuse.errors import DataError
from crashfuse.filters import cfc_filter
from crashfuse.plots import pulses as plots
from crashfuse.plots.canvas import accel_scale
from crashfuse.plots.conditions import condition_space
from crashfuse.ui import campaigns, evidence, frame, importing, tables
from crashfuse.ui.foreign import Source, begin, leave, running, source_at
from crashfuse.ui.problems import show_problems
from crashfuse.ui.text import plain
from crashfuse.ui.uploads import open_uploads
from crashfuse.units import MPH

ROUND = "uploads so far"
CLASSES = (60, 180, 600)
AS_READ = "As read"


def attempt(open_it: Callable[[], str | Source]) -> None:
    """Open a campaign and turn to it, or begin to import; what is wrong is kept for the page to show."""
    st.session_state.pop(frame.REFUSED, None)
    try:
        opened = open_it()
        if isinstance(opened, Source):
            begin(opened)
        else:
            leave()
            frame.choose_campaign(opened)
    except DataError as error:
        st.session_state[frame.REFUSED] = error.problems


def open_folder() -> None:
    """Open the folder that was typed in."""
    text = st.session_state["folder"].strip().strip('"')  # as file managers copy a path
    if text:
        attempt(lambda: campaign_or_source(Path(text)))


def campaign_or_source(path: Path) -> str | Source:
    """Put a campaign folder on the shelf; what is none, but can be imported, is a source."""
    try:
        return campaigns.open_folder(path)
    except DataError:
        if path.is_dir() and any((path / table).is_file() for table in ("tests.csv", "cae.csv")):
            raise
        try:
            return source_at(path.expanduser())
        except (DataError, OSError, RuntimeError, ValueError):
            pass
        raise


def open_upload() -> None:
    """Open what was dropped, and empty the field if it was sound."""
    files = st.session_state[f"files {st.session_state.get(ROUND, 0)}"]
    attempt(lambda: open_uploads(files))
    if frame.REFUSED not in st.session_state:
        st.session_state[ROUND] = st.session_state.get(ROUND, 0) + 1


def doors() -> None:
    """Both ways to open a campaign of one's own, and what was wrong with the last."""
    folder, upload = st.columns(2, gap="large")
    with folder.form("open folder", border=False):
        st.text_input(
            "A campaign folder on this computer",
            key="folder",
            placeholder="the folder that holds tests.csv and cae.csv",
            help="On the computer that crashfuse runs on. Nothing is copied or sent anywhere. Files and folders of "
            "other formats are taken, too, to be imported.",
        )
        st.form_submit_button("Open folder", icon=":material/folder_open:", on_click=open_folder)
    with upload.form("open upload", border=False):
        st.file_uploader(
            "Or a zip of one, its files together, or test and CAE files to import",
            accept_multiple_files=True,
            key=f"files {st.session_state.get(ROUND, 0)}",
            help="A campaign is CSV and Parquet. Imported are NHTSA, ISO-MME, LS-DYNA (binout, nodout), TDMS, and CSV "
            "or Excel tables of any form; what they are taken for is shown first. Files go to the computer that "
            "crashfuse runs on, no further, and are deleted when it ends. Open what is larger than the limit as a "
            "folder.",
        )
        st.form_submit_button("Open upload", icon=":material/upload_file:", on_click=open_upload)
    if problems := st.session_state.get(frame.REFUSED):
        show_problems(problems)
    importing.show_unfinished()
    with st.expander("What does a campaign folder look like?", icon=":material/help:"):
        st.code(
            "tests.csv            one row a test: id, speed_mph, front_weight_lb, rear_weight_lb\n"
            "tests/<id>.csv       its pulse: time_ms, acceleration_g\n"
            "cae.csv              one row a CAE run: id, speed_mph, front_weight_lb, rear_weight_lb\n"
            "cae_pulses.parquet   all CAE pulses: id, time_ms, acceleration_g",
            language=None,
        )
        st.markdown(
            "Speeds may be in mph, km/h or m/s (`_mph`, `_kph`, `_mps`), weights in lb or kg, time in ms or s, and "
            "accelerations in g or m/s² (`_g`, `_mps2`): the end of a column's name tells. Pulses of either source "
            "may be single files or one table, CSV or Parquet."
        )


def show_summary(view: frame.View) -> None:
    """Say what was accepted, in numbers."""
    campaign = view.campaign
    speeds = [test.condition.speed_mps / MPH for test in campaign.tests]
    paired = sum(campaign.cae.paired_run(test.condition) is not None for test in campaign.tests)
    numbers = st.columns(3)
    numbers[0].metric("Tests", len(campaign.tests), help=f"{paired} of them have a CAE run at their own condition.")
    numbers[1].metric("Test speeds", f"{min(speeds):.0f}–{max(speeds):.0f} mph")
    numbers[2].metric("CAE runs", f"{len(campaign.cae):,}")
    st.caption(
        f"Fingerprint {campaign.fingerprint[:12]}",
        help=f"SHA-256 of all data, the same wherever the files lie: {campaign.fingerprint}",
    )
    for warning in campaign.warnings:
        st.warning(plain(warning), icon=":material/warning:")
    page, label = "compare", f"Next: predict test {plain(view.held_out.id)} from the others, and compare"
    if len(campaign.tests) == 1:
        page, label = "predict", "Next: predict another condition"
    st.page_link(frame.pages()[page], label=label, icon=":material/arrow_forward:")


def show_tests(view: frame.View) -> None:
    """All tests over each other, as they were read or filtered."""
    campaign, test = view.campaign, view.held_out
    st.subheader("Tests")
    choice = st.segmented_control(
        "Channel filter class (SAE J211-1)", [AS_READ, *(f"CFC {cfc}" for cfc in CLASSES)], default=AS_READ,
        required=True, key="filter", persist_state="session",
        help="Only what is drawn: what is learned from and rated are the pulses as read.",
    )  # fmt: skip
    cfc = None if choice == AS_READ else float(choice.removeprefix("CFC "))
    evidence.show_figure(
        plots.measured_pulses(
            campaign.tests,
            highlight=test.id,
            cfc=cfc,
            window_ms=view.window_ms,
            unit=view.unit,
            deceleration=view.deceleration,
        ),
        alt="Pulses of all tests over time, coloured by speed",
    )
    reading = "as they are in the files"
    if campaign.channel_filter_class is not None:
        reading = f"filtered to CFC {campaign.channel_filter_class:g}, as campaign.toml asks"
    if cfc is None:
        st.caption(f"Pulses were read {reading}. Dark is slow, bright is fast; dashes tell repeats apart.")
        return
    scale = accel_scale(view.unit, deceleration=False)
    peaks = [
        abs(accel * scale).max()
        for accel in (test.pulse.accel_mps2, cfc_filter(test.pulse.accel_mps2, cfc=cfc, dt_s=test.pulse.dt_s))
    ]
    st.caption(
        f"Thick: filtered to {choice}; thin: as read, {reading}. The filter takes the peak of {plain(test.id)} from "
        f"{peaks[0]:.1f} to {peaks[1]:.1f} {view.unit}. It sees 0–100 ms only, so the first and last milliseconds may "
        "differ from a filtered full record."
    )


def show_conditions(view: frame.View) -> None:
    """Where tests and CAE runs lie, and how the CAE model rates before any correction."""
    campaign = view.campaign
    st.subheader("Conditions")
    evidence.show_kept_figure(
        lambda: condition_space(campaign.cae, campaign.tests, held_out=view.held_out.id),
        "Speed against front and rear weight of CAE runs and tests; the same numbers are in the table below",
        "conditions",
        campaign.fingerprint,
        view.held_out.id,
    )
    st.markdown("**The tests, and how the CAE model rates against each before any correction** (ISO/TS 18571)")
    st.table(tables.conditions(campaign), border="horizontal")


def show_library(view: frame.View) -> None:
    """The pulses of the CAE model."""
    campaign = view.campaign
    st.subheader("CAE model")
    evidence.show_kept_figure(
        lambda: plots.library_band(
            campaign.cae, campaign.tests, window_ms=view.window_ms, unit=view.unit, deceleration=view.deceleration
        ),
        "Pulses of the CAE model over time: the middle 90 % of all runs, and the runs at the tests' conditions",
        "library",
        campaign.fingerprint,
        view.window_ms,
        view.unit,
        view.deceleration,
    )
    st.caption(
        "The shaded band holds the middle 90 % of all CAE runs at each time, whatever their speed. "
        "Lines are the runs made at a test's own condition."
    )


view = frame.enter()
if (source := running()) is not None:
    importing.show(source, view)
    st.stop()
if view is None:
    st.title("crashfuse")
    st.markdown(
        "crashfuse corrects a CAE crash model with the few full-frontal barrier tests that you have, predicts the "
        "pulse of a crash that was never run, and rates every prediction by ISO/TS 18571."
    )
    frame.offer_sample()
    st.caption("A synthetic car: 11 tests and about a thousand CAE runs, made by a small simulation.")
    st.subheader("Or open a campaign of your own")
    doors()
    st.stop()

st.title(plain(view.campaign.name))
show_summary(view)
show_tests(view)
show_conditions(view)
show_library(view)
st.subheader("Open another campaign")
doors()
