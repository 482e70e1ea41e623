"""Data: open a campaign and see its content."""

import streamlit as st

from crashfuse.campaign_folder.load import unread_files
from crashfuse.reporting.result_tables import quality_table
from crashfuse.signals.filters import cfc_filter
from crashfuse.ui import address, earlier, editing, frame, page_tables
from crashfuse.ui.beside import choose_beside_runs, choose_tests, key_of, usual_approach, without_clicks
from crashfuse.ui.chosen import View
from crashfuse.ui.computation import StudyRequest, chosen_config
from crashfuse.ui.figures import show_cached_figure
from crashfuse.ui.importing import step as importing
from crashfuse.ui.importing.session import running
from crashfuse.ui.navigation import end_page, open_page, show_link
from crashfuse.ui.opening import show_open_forms
from crashfuse.ui.tables import show_table
from crashfuse.ui.tabs import show_tabs
from crashfuse.ui.text import plain
from crashfuse.wording import speed

CLASSES = (60, 180, 600)
AS_READ = "As read"
ASKED = "asked for the next prediction"  # session key


def show_summary(view: View) -> None:
    """Say in a line what was accepted, and offer the next step."""
    campaign = view.campaign
    speeds = [test.condition.speed_mps for test in campaign.tests]
    paired = sum(campaign.cae.paired_run(test.condition) is not None for test in campaign.tests)
    tests = "1 test" if len(campaign.tests) == 1 else f"{len(campaign.tests)} tests"
    at = view.display.words(speed(min(speeds), max(speeds), form=".0f"))
    with st.container(horizontal=True, vertical_alignment="center", key="summary"):
        st.markdown(
            f"**{tests} at {at}, {len(campaign.cae):,} CAE runs**", width="content",
            help=f"Tests that have a CAE run at their own condition: {paired}.",
        )  # fmt: skip
        st.caption(
            f"Fingerprint {campaign.fingerprint[:12]}", width="content",
            help=f"SHA-256 of all data, the same wherever the files lie: {campaign.fingerprint}",
        )  # fmt: skip
        asked = offer_next(view)
    for warning in campaign.warnings:
        st.warning(plain(warning), icon=":material/warning:")
    editing.offer_leaving_out(view)
    if unread := unread_files(view.folder):
        st.caption(plain(unread))
    editing.show_last_change(view)
    if asked:
        open_page("compare")


def offer_next(view: View) -> bool:
    """Show what to do next; True if it was asked for."""
    if len(view.campaign.tests) == 1:
        show_link("predict", "Next: predict another condition")
        return False
    request = StudyRequest(view.campaign, (view.held_out.id,), chosen_config())
    st.button(
        f"Next: predict test {plain(view.held_out.id)} from the others, and compare", type="primary",
        icon=":material/arrow_forward:", on_click=predict_next, args=(request,),
    )  # fmt: skip
    return bool(st.session_state.pop(ASKED, False))


def predict_next(request: StudyRequest) -> None:
    """Start the prediction; a callback, so that a click while the page is still drawn counts."""
    request.ask("compare")
    st.session_state[ASKED] = True


def show_tests(view: View) -> None:
    """All tests overlaid, as read or filtered."""
    campaign, test = view.campaign, view.held_out
    editing.show_tests_in_use(view)
    earlier.show_missing(campaign, test.id, usual_approach(), among_tests=True)
    options = [AS_READ, *(f"CFC {cfc}" for cfc in CLASSES)]
    address.default("filter", AS_READ, options)
    row = st.container(horizontal=True, vertical_alignment="bottom")
    with row:
        choice = st.segmented_control(
            "Channel filter class (SAE J211-1)", options, default=AS_READ,
            required=True, key="filter", persist_state="session",
            help="For this figure only: approaches are fitted and rated on the pulses as read.",
        )  # fmt: skip
    tests, also = choose_tests(view, row)
    cfc = None if choice == AS_READ else float(choice.removeprefix("CFC "))
    show_cached_figure(
        lambda: without_clicks(campaign.plot(tests=tests, held_out=test.id, cfc=cfc, also=also, display=view.display)),
        f"Pulses of tests over time, {'as read' if cfc is None else f'filtered to {choice}'}, coloured by speed",
        "tests",
        campaign.fingerprint,
        test.id,
        cfc,
        view.display,
        tests,
        key_of(also),
        chosen_config(),  # by which predictions are made
        name=" ".join([*(tests if len(tests) < len(campaign.tests) else ["tests"]), choice]),
        beside=also,
    )
    reading = "as they are in the files"
    if campaign.channel_filter_class is not None:
        reading = f"filtered to CFC {campaign.channel_filter_class:g}, as campaign.toml asks"
    if cfc is None:
        st.caption(f"Pulses were read {reading}. Dark is slow, bright fast; hues, dashes and marks tell repeats apart.")
        return
    peaks = [
        abs(accel * view.display.accel_scale).max()
        for accel in (test.pulse.accel_mps2, cfc_filter(test.pulse.accel_mps2, cfc=cfc, dt_s=test.pulse.dt_s))
    ]
    st.caption(
        f"Thick: filtered to {choice}; thin: as read, {reading}. The filter takes the peak of {plain(test.id)} from "
        f"{peaks[0]:.1f} to {peaks[1]:.1f} {view.display.unit}. It sees 0–100 ms only, so the first and last "
        "milliseconds may differ from those of a filtered full record."
    )


def show_conditions(view: View) -> None:
    """Show where tests and CAE runs lie, and how the CAE model rates before any correction."""
    campaign = view.campaign
    show_cached_figure(
        lambda: campaign.plot("conditions", held_out=view.held_out.id, display=view.display),
        "Speed against front and rear weight of CAE runs and tests; the same numbers are in the table below",
        "conditions",
        campaign.fingerprint,
        view.held_out.id,
        view.display.system,
        name="conditions",
    )
    st.markdown(
        f"**The tests, and how the CAE run paired with each rates before any correction** ({campaign.rating_basis})"
    )
    show_table(page_tables.conditions(campaign, view.display), "conditions")


def show_library(view: View) -> None:
    """The pulses of the CAE model."""
    campaign = view.campaign
    earlier.show_missing(campaign, view.held_out.id, usual_approach(), among_tests=True)
    also = choose_beside_runs(view)
    show_cached_figure(
        lambda: without_clicks(campaign.plot("cae", also=also, display=view.display)),
        "Pulses of the CAE model over time: the middle 90 % of all runs, and the runs at the tests' conditions",
        "library",
        campaign.fingerprint,
        view.display,
        key_of(also),
        chosen_config(),
        name="CAE runs",
        beside=also,
    )
    paired = any(campaign.cae.paired_run(test.condition) is not None for test in campaign.tests)
    lines = "Lines are the runs" if paired else "No run was"
    st.caption(
        "The shaded band holds the middle 90 % of all CAE runs at each time, whatever their speed. "
        f"{lines} made at a test's own condition."
    )
    show_quality(view)


def show_quality(view: View) -> None:
    """Show what the solver says of the CAE runs, judged by the campaign's limits."""
    st.markdown("**Is the CAE model fit to be believed?**")
    verdict = view.campaign.quality
    st.markdown(plain(verdict.summary))
    table = quality_table(verdict)
    if not table.empty:
        show_table(table, "quality")
    for sentence in verdict.named:
        st.warning(plain(sentence), icon=":material/warning:")
    if verdict.failing:
        with st.expander("All runs that fail"):
            runs = verdict.failing_runs[["id", "fails"]].rename(columns={"id": "CAE run", "fails": "Beyond the limit"})
            st.dataframe(runs, hide_index=True)


TABS = {
    "Tests": show_tests,
    "Conditions": show_conditions,
    "CAE model": show_library,
    "Open another campaign": lambda _: show_open_forms(),
}

view = frame.enter()
if (source := running()) is not None:
    importing.show(source, view)
    end_page()
if view is None:
    st.title("crashfuse")
    st.markdown(
        "crashfuse corrects a CAE crash model with the few full-frontal barrier tests that you have, predicts the "
        "pulse of a crash that was never run, and rates every prediction by ISO/TS 18571."
    )
    frame.offer_sample()
    st.caption("A synthetic car: 11 tests and about a thousand CAE runs, made by a small simulation.")
    st.subheader("Or open a campaign of your own")
    show_open_forms()
    end_page()

frame.show_head(view, plain(view.campaign.name))
show_summary(view)
show_tabs(TABS, view, key="data_tab")
