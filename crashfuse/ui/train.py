"""The page Train: approaches trained without the held-out tests or on all of them, and what they have learned."""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import streamlit as st

from crashfuse.approaches.registry import BASELINE
from crashfuse.campaign_folder.load import ARCHIVE
from crashfuse.crash_test import CrashTest
from crashfuse.errors import CrashfuseError, DataError
from crashfuse.execution.jobs import Job
from crashfuse.results.figures import ONE_PROCESS, Draw
from crashfuse.results.result_tables import archive_table
from crashfuse.study.config import StudyConfig
from crashfuse.study.study import Study
from crashfuse.ui.certify.entry import show_wrong
from crashfuse.ui.kit import address, campaigns, progress
from crashfuse.ui.kit.address import choose_held_out, chosen_config, kept
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import fit_request, jobs, learn_vehicles, study_request
from crashfuse.ui.kit.editing import can_be_edited, show_last_change, show_refused, use_archive
from crashfuse.ui.kit.figures import choose, show_cached_figure, show_tabs
from crashfuse.ui.kit.files import offer
from crashfuse.ui.kit.frame import choose_settings
from crashfuse.ui.kit.navigation import open_next, show_link
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import LF, TIME_DOMAIN, plain
from crashfuse.units import read_out
from crashfuse.vehicle_archive import LEAST_VEHICLES, VehicleArchive, load_archive

_PAST = "past vehicles"  # widget key
_ON_ALL, _NETWORKS = "Train on all tests", "Networks"
_LEARNED = (
    (
        "training",
        "learning_curve",
        "Mean square error over epochs",
        "**Training on CAE runs**: mean square error of {members} networks; validation: on a tenth of the runs.",
    ),
    (
        "fine-tuning",
        "left_out_rmse",
        "Error on fitted and on left-out tests, by strength",
        "**Fine-tuning on tests**: chosen is how far a test may differ from what all share, the least with an error "
        "on left-out tests within one standard error of the lowest.",
    ),
    ("fine-tuning", "tuning_curve", "Loss over steps", "**Fine-tuning on tests**: loss on the other tests."),
)
"""How networks were trained: figure, what the state has of it, alternative text, what to see."""
_FIGURES = {
    "Bias by speed": (
        "bias",
        "Bias of the CAE model in each test over displacement, coloured by speed",
        "What has to be added to the CAE model to get each test; fitted to all but {test}. Steep ends: at TTZV.",
    ),
    "Parts of the bias": (
        "bias parts",
        "Parts of the bias expected in test {test} over displacement, with 95 % bands",
        "What the other {n} tests predict of the bias in {test}. Shared: the same in every test. Ratio: trend and "
        "humps of the CAE pulse, times a factor. Parts can cancel: their sum is better known than each. Of the test's "
        "own part, its repeatability, only the size can be predicted.",
    ),
}
"""The library's name, the alternative text, and what to see."""


def show(view: View) -> None:
    """Show the tab that the user chooses."""
    show_tabs({"Train": _show_form, "Diagnostics": _show_diagnostics}, view, key="train_tab", export=_show_files)


def _show_form(view: View) -> None:
    campaign, (config, trouble) = view.campaign, choose_settings()
    left, right = st.columns(2, gap="medium")
    study = None
    with left.container(border=True, height="stretch"):
        st.markdown("**Without the held-out tests**, for the page Compare")
        if len(campaign.tests) > 1:
            held_out = _choose_tests(view)
            request = study_request(campaign, held_out, config)
            wrong = trouble or ("" if held_out else "Choose at least one test.")
            study = None if wrong else request.find()
            _offer(study, "Train without them", request.start, wrong)
            if study is not None and (predicted := study.result or study.part) is not None:
                _show_predicted(predicted, config)
        else:
            st.caption(f"{plain(campaign.test_ids[0])} is the only test: none is left to learn from.")
    fit = fit_request(campaign, config)
    fitted = None if trouble else jobs().get(fit.key)
    with right.container(border=True, height="stretch"):
        st.markdown("**On all tests**, for the page Predict")
        ready = fitted is not None and fitted.result is not None
        with suppress(CrashfuseError):  # starting the job shows it
            ready = ready or (fitted is None and not trouble and fit.in_cache())
        if ready:
            learned = f"{len(campaign.tests)} tests and {len(campaign.cae):,} CAE runs"
            st.markdown(f":material/check_circle: Learned from {learned}.")
            show_link("predict", "Predict a new condition")
        else:
            _offer(fitted, _ON_ALL, fit.start, trouble)
    if study is not None and study.active:
        progress.show_job(study, study.part, time.monotonic())
    if fitted is not None and fitted.active:
        progress.show_job(fitted, None, math.inf)
    _show_past_vehicles(view)


def _choose_tests(view: View) -> tuple[str, ...]:
    known = view.campaign.test_ids
    address.default("held_out", [view.held_out.id])
    asked = st.session_state["held_out"]
    if missing := [test for test in asked if test not in known]:
        st.caption(f":material/link_off: No test here is named {plain(', '.join(missing))[:80]}.")
        st.session_state["held_out"] = [test for test in asked if test not in missing]
    tip = "While one is predicted, all others train, those listed here, too."
    chosen = st.multiselect("Held-out tests, each in turn", known, help=tip, **kept("held_out"))
    return tuple(test for test in known if test in chosen)


def _offer(job: Job[Any] | None, label: str, start: Callable[[], None], trouble: str) -> None:
    if job is None or job.state in ("failed", "cancelled"):
        st.button(label, type="primary", icon=":material/play_arrow:", on_click=start, disabled=bool(trouble))
    if trouble:
        st.caption(f":material/info: {plain(trouble)}")
    elif job is not None:
        progress.show_end(job)


def _show_predicted(study: Study, config: StudyConfig) -> None:
    progress.show_training(config, study.config.approaches)
    st.markdown(f":material/check_circle: Rated, {plain(read_out([fold.held_out for fold in study.folds]))}.")

    def open_test(test: CrashTest) -> None:
        choose_held_out(test)
        open_next("compare")

    with st.container(horizontal=True):
        for fold in study.folds:
            st.button(f"Compare {plain(fold.held_out)}", on_click=open_test, args=(fold.test,))


def _show_files(view: View) -> None:
    request = fit_request(view.campaign, chosen_config())
    invitation = "These are the models of all tests, as by `crashfuse train`."
    fitted = progress.result_or_none(request, invitation=invitation, button=_ON_ALL)
    if fitted is not None:
        offer(view.campaign.name, {"models.zip": partial(fitted.models, view.campaign)})


def _show_diagnostics(view: View) -> None:
    campaign, state, key = view.campaign, st.session_state, "diagnosed"
    config, test = chosen_config(), view.held_out.id
    progress.stop_with_a_single_test(campaign)
    with st.container(horizontal=True, vertical_alignment="center"):
        choice = choose("Diagnostics", [_NETWORKS, *_FIGURES], key="diagnostics")
        st.markdown("of what was learned without", width="content")
        address.put(key, test)
        look: dict[str, Any] = {"key": key, "on_change": lambda: choose_held_out(campaign.test(state[key]))}
        st.selectbox("Held-out test", campaign.test_ids, width=120, label_visibility="collapsed", **look)
    others = config.training_campaign(campaign, test)
    request = study_request(campaign, (test,), config)
    invitation = f"Nothing was trained without {plain(test)} yet."
    study = progress.result_of(request, invitation=invitation, button=f"Train without {test}")
    progress.show_training(config, study.config.approaches)

    def show(draw: Draw, name: str, alt: str, meaning: str) -> None:
        key = request.key, study.config.approaches, view.display
        show_cached_figure(draw, alt, name, key, name=name)
        st.caption(meaning)

    if choice == _NETWORKS:
        _show_networks(study, view, show)
        return
    figure, alt, meaning = _FIGURES[choice]
    if figure == "bias parts" and config.preset == "paper":
        st.info(ONE_PROCESS)
        return
    plot = campaign.draw if figure == "bias" else study.draw
    draw = partial(plot, figure=figure, held_out=test, display=view.display)
    show(draw, choice.lower(), alt.format(test=test), meaning.format(test=plain(test), n=len(others.tests)))


def _show_networks(study: Study, view: View, show: Callable[[Draw, str, str, str], None]) -> None:
    (fold,) = study.folds
    states = {own.approach: own.state for own in fold.estimates if own.approach in ("lf_tcn", "time_domain")}
    if not states:
        st.info("No approach with a network is known here yet.", icon=":material/info:")
        return
    plot, last = partial(study.draw, fold.held_out, display=view.display), [*states][-1]
    shown = [name for name in (BASELINE, *states) if name in fold.ratings]
    alt = f"Acceleration over time: test {fold.held_out}, the CAE model and networks"
    show(partial(plot, "acceleration", approaches=shown, band=last), "networks", alt, f"{LF} {TIME_DOMAIN}")
    for figure, key, alt, meaning in _LEARNED:
        if key in states[last]:
            show(partial(plot, figure, approaches=[last]), figure, alt, meaning.format(**states[last]))


def _show_past_vehicles(view: View) -> None:
    prior, editable, state = view.campaign.prior, can_be_edited(view.folder), st.session_state
    with st.expander("Past vehicles", expanded=prior is not None or bool(state.get(_PAST))):
        show_refused()
        if prior is not None:
            st.markdown(plain(prior.sentence))
            path = view.folder / ARCHIVE
            _show_archive(_archive(path, campaigns.stamp(path)), "archive in use")
        else:
            st.markdown("No archive is in use. Past vehicles teach a campaign before its tests do.")
        if editable:
            # another widget once it is in use: what was uploaded is then no longer shown
            key = f"archive file {view.campaign.fingerprint[:8]}"
            with st.container(horizontal=True, vertical_alignment="center"):
                if prior is not None:
                    st.button("Use none", icon=":material/close:", on_click=use_archive, args=(view, None))
                show_last_change(view)

            def take() -> None:
                if (file := state[key]) is not None:
                    use_archive(view, file.getvalue())

            st.file_uploader("Use an archive from a file", type=Path(ARCHIVE).suffix[1:], key=key, on_change=take)
        else:
            st.caption(":material/lock: Put one into a copy: *Save a copy to edit* on Data, or `crashfuse sample DIR`.")
        _learn_archive(view, editable=editable)


def _learn_archive(view: View, *, editable: bool) -> None:
    st.markdown("**Learn an archive** from three or more campaigns with four tests or more each.")
    known, state = list(campaigns.open_campaigns()), st.session_state
    if not {*state.get(_PAST, [])} <= {*known}:  # an upload was closed
        state[_PAST] = [name for name in state[_PAST] if name in known]
    tip = "Of vehicles with like CAE models. If this campaign is among them, it is taken out where it is judged."
    chosen = st.multiselect("Campaigns to learn from", known, format_func=campaigns.label, help=tip, **kept(_PAST))
    if len(chosen) < LEAST_VEHICLES:
        st.caption(f":material/info: Choose {LEAST_VEHICLES} or more; {len(known)} are open.")
        show_link("data", "Open another campaign")
        return
    try:
        request = learn_vehicles([campaigns.folder_of(name) for name in chosen], chosen_config().seed)
    except DataError as error:
        show_wrong(error)
        return
    archive = progress.result_or_none(request, invitation="What is finished is kept.", button="Learn an archive")
    if archive is None:
        return
    with st.container(horizontal=True):
        offer("", {ARCHIVE: lambda: archive.content})
        if editable:
            use = partial(use_archive, view, archive.content)
            st.button("Use it for this campaign", icon=":material/check:", on_click=use)
    _show_archive(archive, "archive learned")


def _show_archive(archive: VehicleArchive, key: str) -> None:
    st.markdown(plain(archive.sentence))
    with st.expander("Its record, vehicle by vehicle", icon=":material/table:"):
        show_table(archive_table(archive.record), key)


@st.cache_resource(max_entries=4, show_spinner=False)
def _archive(path: Path, stamp: tuple[int, ...]) -> VehicleArchive:  # noqa: ARG001 - part of the key
    return load_archive(path)
