"""Study: every test left out in turn, alone and with all others at about the same speed."""

from dataclasses import replace
from functools import partial

import streamlit as st

from crashfuse.study.recommendation import recommend
from crashfuse.ui.kit import frame, results
from crashfuse.ui.kit.address import chosen_config
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import StudyRequest
from crashfuse.ui.kit.figures import choose
from crashfuse.ui.kit.files import export_button
from crashfuse.ui.kit.navigation import end_page
from crashfuse.ui.kit.progress import patience, result_of, show_training, stop_with_a_single_test
from crashfuse.ui.study import (
    Outcome,
    by_group,
    show_bands,
    show_files,
    show_learning_curve,
    show_paper_tables,
    show_ratings,
)

TABS = {
    "Ratings": show_ratings,
    "Bands": show_bands,
    "The paper's tables": show_paper_tables,
}
LEARNING_CURVE = "How many tests are enough"  # needs no study


def request_of(view: View) -> StudyRequest:
    """Each test left out in turn, and then with its speed group, unless a fit takes minutes, or a GPU: the paper's."""
    config = chosen_config()
    both = replace(config, leave_out="both") if config.preset == "fast" else config
    return StudyRequest(view.campaign, view.campaign.test_ids, both)


view = frame.enter_with_campaign(
    "Study",
    lambda view: f"{len(view.campaign.tests)} tests, each left out in turn",
    by_group=lambda view: by_group(request_of(view)),
)
campaign, request = view.campaign, request_of(view)
config = request.config
stop_with_a_single_test(campaign)
row = st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center")
with row:
    tab = choose("Tab", [*TABS, LEARNING_CURVE], key="study_tab")
if tab == LEARNING_CURVE:
    show_learning_curve(view, chosen_config())
    end_page()
again = "; then again without any other test at about its speed" if config.leave_out == "both" else ""
study = result_of(
    request,
    invitation="How well does each approach predict a test that it has not seen? Every test is left out in turn, "
    f"predicted from all others, and rated{again}. "
    f"This has not been run yet for the {len(campaign.tests)} tests of this campaign. "
    + patience(config, "It takes a minute or more the first time; meanwhile you can work on the other pages."),
    button=f"Leave out each of {len(campaign.tests)} tests",
)
outcome = Outcome(view, config, study, request.key)
with row:
    export_button(partial(show_files, outcome))
show_training(config, study.config.approaches)
if outcome.whole:
    first, *others = map(view.display.words, recommend(study).sentences)
    use, _, why = first.partition(". ")
    told = others.pop(-1 if study.speed_groups is not None and by_group(request) else 0)
    longest = max(study.config.windows_ms)
    if outcome.window_ms != longest:  # what is said does not follow the choice in the sidebar
        told += f" This is over {results.window_label(longest)}."
    results.show_recommendation([f"{use}. {told}", why, *others])
TABS[tab](outcome)
