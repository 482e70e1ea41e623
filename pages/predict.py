"""Predict: the pulse at a condition that was never tested, over speed, and which test to run next."""

from functools import partial

import streamlit as st

from crashfuse.ui import predict
from crashfuse.ui.kit import frame, results
from crashfuse.ui.kit.address import chosen_config
from crashfuse.ui.kit.computation import fit_request
from crashfuse.ui.kit.curves import choose_approach
from crashfuse.ui.kit.figures import choose
from crashfuse.ui.kit.files import export_button
from crashfuse.ui.kit.progress import patience, result_of, show_training
from crashfuse.ui.predict import Answer, choose_condition, show_pins

TABS = {"Pulses": predict.show_pulses, "Over speed": predict.show_over_speed, "Next test": predict.show_next_test}

view = frame.enter_with_campaign("Predict", lambda view: f"from {len(view.campaign.tests)} tests and the CAE runs")
campaign, config = view.campaign, chosen_config()
request = fit_request(campaign, config)


def ask_and_answer() -> None:
    """Ask for a condition, and show what is predicted there."""
    condition = choose_condition(campaign, view.display)
    fitted = result_of(
        request,
        invitation=f"The approaches have not been fitted on all {len(campaign.tests)} tests of this campaign yet. "
        + patience(config, "This takes a minute or two, once; then every condition is answered at once."),
        button="Predict",
    )
    answer = Answer(view, request.key, config, fitted, condition)
    show_training(config, fitted.approaches)
    if answer.advice is not None:
        use, expected, *reasons = answer.advice.facts
        known = [fact.sentence for fact in reasons if fact.code != "condition.extrapolated"]  # said above
        results.show_recommendation([use.sentence, expected.sentence], known)
    with st.container(horizontal=True, vertical_alignment="center", gap="small", key="asked"):
        tab = choose("Tab", list(TABS), key="predict_tab")
        choose_approach(answer.subject, answer.fitted.approaches, answer.advice)
        if answer.advice is not None:
            show_pins(answer)
        st.space("stretch")
        export_button(partial(predict.show_files, answer))
    answer.subject.offer()
    TABS[tab](answer)


job = request.find()
if job is not None and job.result is not None:
    frame.by_itself(ask_and_answer)
else:  # the sidebar shows what runs
    ask_and_answer()
