"""Data: open a campaign, and see what is in it."""

from pathlib import Path

import streamlit as st

from crashfuse.errors import DataError
from crashfuse.plots import pulses as plots
from crashfuse.ui import campaigns, evidence, frame, tables


def open_campaign() -> None:
    """Open the folder that was typed in."""
    st.session_state.pop("refused", None)
    text = st.session_state["folder"].strip().strip('"')  # as file managers copy a path
    if not text:
        return
    try:
        frame.choose_campaign(campaigns.open_folder(Path(text)))
    except DataError as error:
        st.session_state["refused"] = error.problems


def folder_field() -> None:
    """Field and button to open a campaign folder, and what was wrong with the last one."""
    with st.form("open", border=False):
        left, right = st.columns([5, 1], vertical_alignment="bottom")
        left.text_input(
            "Campaign folder",
            key="folder",
            placeholder="the folder that holds tests.csv and cae.csv",
            help="On the computer that crashfuse runs on. Nothing is copied or sent anywhere.",
        )
        right.form_submit_button("Open", on_click=open_campaign, width="stretch")
    if problems := st.session_state.get("refused"):
        frame.show_problems(problems)


view = frame.enter()
if view is None:
    st.title("crashfuse")
    st.markdown(
        "crashfuse corrects a CAE crash model with the few full-frontal barrier tests that you have, predicts the "
        "pulse of a crash that was never run, and rates every prediction by ISO/TS 18571."
    )
    frame.offer_sample()
    st.caption("A synthetic car: 11 tests and about a thousand CAE runs, made by a small simulation.")
    st.space("small")
    folder_field()
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
    st.stop()

campaign = view.campaign
st.title(campaign.name)
first, second, third = st.columns(3)
first.metric("Tests", len(campaign.tests))
second.metric("CAE runs", f"{len(campaign.cae):,}")
third.metric(
    "Fingerprint",
    campaign.fingerprint[:12],
    help=f"SHA-256 of all data, the same wherever the files lie: {campaign.fingerprint}",
)
for warning in campaign.warnings:
    st.warning(warning, icon=":material/warning:")

st.subheader("Tests")
evidence.show_figure(
    plots.measured_pulses(
        campaign.tests,
        highlight=view.held_out.id,
        window_ms=view.window_ms,
        unit=view.unit,
        deceleration=view.deceleration,
    ),
    alt="Pulses of all tests over time, coloured by speed",
)
st.table(tables.conditions(campaign), border="horizontal")

st.subheader("CAE model")
evidence.show_figure(
    plots.library_band(
        campaign.cae, campaign.tests, window_ms=view.window_ms, unit=view.unit, deceleration=view.deceleration
    ),
    alt="Pulses of the CAE model over time: the middle 90 % of all runs, and the runs at the tests' conditions",
)
st.caption(
    "The shaded band holds the middle 90 % of all CAE runs at each time, whatever their speed. "
    "Lines are the runs made at a test's own condition."
)

st.subheader("Open another campaign")
folder_field()
