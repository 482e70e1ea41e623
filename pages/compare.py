"""Compare: the held-out test against every prediction of it."""

from functools import partial

import streamlit as st

from crashfuse.ui import compare
from crashfuse.ui.compare import Comparison
from crashfuse.ui.kit import frame
from crashfuse.ui.kit.address import chosen_config
from crashfuse.ui.kit.computation import study_request
from crashfuse.ui.kit.curves import choose_approach
from crashfuse.ui.kit.figures import choose
from crashfuse.ui.kit.files import export_button
from crashfuse.ui.kit.progress import patience, result_of, show_training, stop_with_a_single_test
from crashfuse.ui.kit.text import plain

TABS = {"Pulses": compare.show_pulses, "Why": compare.show_why, "Ratings and metrics": compare.show_ratings}

view = frame.enter_with_campaign(
    "Compare", lambda view: f"Test {plain(view.held_out.id)}: {plain(view.held_out.condition)}"
)
test, campaign, config = view.held_out, view.campaign, chosen_config()
stop_with_a_single_test(campaign)

request = study_request(campaign, (test.id,), config)
study = result_of(
    request,
    invitation=f"Test {plain(test.id)} has not been predicted yet. Every approach will be fitted on the CAE runs and "
    f"{len(config.training_campaign(campaign, test.id).tests)} other tests. "
    + patience(config, "The displacement domain takes some seconds, the networks a little longer."),
    button=f"Predict test {test.id}",
)
show_training(config, study.config.approaches)
comparison = Comparison.of(view, request.key, config, study)
compare.show_headline(comparison)
with st.container(horizontal=True, vertical_alignment="center", gap="small", key="asked"):
    tab = choose("Tab", list(TABS), key="compare_tab")
    choose_approach(comparison.subject, list(comparison.fold.ratings), comparison.advice)
    st.space("stretch")
    export_button(partial(compare.show_files, comparison))
comparison.subject.offer()
TABS[tab](comparison)
