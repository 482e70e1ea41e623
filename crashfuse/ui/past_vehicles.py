"""The part of the page Train on past vehicles: the archive in use, another one from a file, one learned here."""

from pathlib import Path

import streamlit as st

from crashfuse.campaign_folder.load import ARCHIVE
from crashfuse.errors import DataError
from crashfuse.reporting.result_tables import archive_table
from crashfuse.ui.certify.entry import show_wrong
from crashfuse.ui.kit import campaigns
from crashfuse.ui.kit.address import chosen_config
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import learn_vehicles
from crashfuse.ui.kit.editing import can_be_edited, show_last_change, show_refused, use_archive
from crashfuse.ui.kit.files import download_bytes
from crashfuse.ui.kit.navigation import show_link
from crashfuse.ui.kit.progress import result_or_none
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain
from crashfuse.vehicle_archive import LEAST_VEHICLES, VehicleArchive, load_archive

_CHOSEN = "past vehicles"  # widget key


def show_past_vehicles(view: View) -> None:
    """Show the archive that teaches the campaign; let it be taken out, another be put in, or one be learned."""
    prior, editable, state = view.campaign.prior, can_be_edited(view.folder), st.session_state
    wanted = f"past vehicles of {view.name}"  # once in use, or being learned: it is not folded under the mouse
    state[wanted] = state.get(wanted, False) or prior is not None or bool(state.get(_CHOSEN))
    with st.expander("Past vehicles", icon=":material/inventory_2:", expanded=state[wanted]):
        show_refused()
        if prior is not None:
            st.markdown(plain(prior.sentence))
            path = view.folder / ARCHIVE
            _show_record(_read(path, campaigns.stamp(path)), "archive in use")
        else:
            st.markdown(
                "No archive is in use. Past vehicles teach a campaign before its tests do, most with few tests."
            )
        if editable:
            with st.container(horizontal=True, vertical_alignment="center"):
                if prior is not None:
                    st.button("Use none", icon=":material/close:", on_click=use_archive, args=(view, None))
                show_last_change(view)
            _offer_upload(view)
        else:
            st.caption(
                ":material/lock: The folder of this campaign is not written to. An archive can be put into a copy: "
                "*Save a copy to edit* on the page Data, or `crashfuse sample DIR`."
            )
        _learn(view, editable=editable)


def _offer_upload(view: View) -> None:
    # another widget once it is in use: what was uploaded is then no longer shown
    key = f"archive file {view.campaign.fingerprint[:8]}"

    def take() -> None:
        if (file := st.session_state[key]) is not None:
            use_archive(view, file.getvalue())

    st.file_uploader("Use an archive from a file", type=Path(ARCHIVE).suffix[1:], key=key, on_change=take)


def _learn(view: View, *, editable: bool) -> None:
    st.markdown("**Learn an archive** from three or more campaigns with four tests or more each.")
    known, state = list(campaigns.open_campaigns()), st.session_state
    if not {*state.get(_CHOSEN, [])} <= {*known}:  # an upload was closed
        state[_CHOSEN] = [name for name in state[_CHOSEN] if name in known]
    chosen = st.multiselect(
        "Campaigns to learn from", known, key=_CHOSEN, format_func=campaigns.label, persist_state="session",
        help="Of vehicles with like CAE models. If this campaign is among them, it is taken out where it is judged.",
    )  # fmt: skip
    if len(chosen) < LEAST_VEHICLES:
        st.caption(f":material/info: Choose {LEAST_VEHICLES} or more; {len(known)} are open.")
        show_link("data", "Open another campaign")
        return
    try:
        request = learn_vehicles([campaigns.folder_of(name) for name in chosen], chosen_config().seed)
    except DataError as error:
        show_wrong(error)
        return
    invitation = "Five vehicles take some 20 minutes on two cores; what is finished is kept."
    archive = result_or_none(request, invitation=invitation, button="Learn an archive")
    if archive is None:
        return
    with st.container(horizontal=True):
        download_bytes(ARCHIVE, lambda: archive.content)
        if editable:
            st.button(
                "Use it for this campaign", icon=":material/check:",
                on_click=lambda: use_archive(view, archive.content),
                help=f"It is put into the campaign's folder, as {ARCHIVE}.",
            )  # fmt: skip
    _show_record(archive, "archive learned")


def _show_record(archive: VehicleArchive, key: str) -> None:
    st.markdown(plain(archive.sentence))
    with st.expander("Its record, vehicle by vehicle", icon=":material/table:"):
        show_table(archive_table(archive.record), key)


@st.cache_resource(max_entries=4, show_spinner=False)
def _read(path: Path, stamp: tuple[int, ...]) -> VehicleArchive:  # noqa: ARG001 - part of the key
    return load_archive(path)
