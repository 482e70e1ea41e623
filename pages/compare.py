"""Compare: the held-out test against every prediction of it."""

from crashfuse.ui import earlier, explanations, frame
from crashfuse.ui.compare import displacement, files, headline, networks, pulses, ratings, why
from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.computation import StudyRequest, chosen_config
from crashfuse.ui.panel import result_of, stop_with_a_single_test
from crashfuse.ui.tabs import show_tabs
from crashfuse.ui.text import plain

TABS = {
    "Pulses": pulses.show,
    "Why": why.show,
    "Over displacement": displacement.show,
    "Networks": networks.show,
    "Ratings and metrics": ratings.show,
    "Files and report": files.show,
}

view = frame.enter_with_campaign(
    "Compare", lambda view: f"Test {plain(view.held_out.id)}: {plain(view.held_out.condition)}"
)
test, campaign, config = view.held_out, view.campaign, chosen_config()
stop_with_a_single_test(campaign)

request = StudyRequest(campaign, (test.id,), config)
study = result_of(
    request,
    invitation=f"Test {plain(test.id)} has not been predicted yet. Every approach will be fitted on the CAE runs and "
    f"{len(config.training_campaign(campaign, test.id).tests)} other tests. "
    + explanations.patience(config, "The displacement domain takes some seconds, the networks a little longer."),
    button=f"Predict test {test.id}",
)
explanations.show_missing(config, study.config.approaches)
comparison = Comparison.of(view, request, study)
headline.show(comparison)
earlier.show_missing(campaign, test.id, comparison.leading)
show_tabs(TABS, comparison, key="compare_tab")
