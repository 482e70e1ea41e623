"""An earlier certification beside the verdicts on the Certify page: what became of what it said."""

from collections.abc import Hashable

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.certification import file_store
from crashfuse.certification.certify import Certification
from crashfuse.certification.earlier import FILE, Earlier, parse_earlier
from crashfuse.errors import CrashfuseError
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.certification_tables import SHOWN
from crashfuse.reporting.verdicts import Verdicts
from crashfuse.ui.certify.results import Judgement, coloured
from crashfuse.ui.certify.uploaded import choose_kept, find_kept, show_wrong
from crashfuse.ui.kit import address
from crashfuse.ui.kit.results import show_table

_CHOICE, _WRONG, _KEPT = "earlier", "verdicts that could not be kept", "verdicts that were kept"  # session keys


def beside(verdicts: Verdicts, key: Hashable) -> Verdicts:
    """The verdicts beside the earlier certification that was chosen; says so if it cannot be read any more."""
    try:
        earlier = find_kept(FILE, _CHOICE, parse_earlier)
        return verdicts if earlier is None else _beside((key, earlier.digest), verdicts, earlier)
    except CrashfuseError as error:
        show_wrong(error)
        return verdicts


@st.cache_resource(max_entries=8, show_spinner=False)
def _beside(key: Hashable, _verdicts: Verdicts, _earlier: Earlier) -> Verdicts:  # noqa: ARG001
    return Verdicts(_verdicts.certification.beside(_earlier))


def show(judgement: Judgement) -> None:
    """Ask for an earlier certification; show whether it came true, and what is said otherwise today."""
    _choose(judgement.certification)
    if judgement.certification.since is None:
        st.caption(
            "Tests run since are held against what an earlier certification said. Its verdicts count in the record, "
            "and what became of it is in the report, too."
        )
        return
    judgement.show_sentences("changes")
    table = SHOWN["changes"](judgement.certification, judgement.display)
    if not table.empty:
        show_table(coloured(table, "Then", "Now").hide(axis="index"), key="earlier verdicts")


def _choose(certification: Certification) -> None:
    """Offer those of this vehicle that are kept, to upload one, and to keep today's."""
    campaign, state = certification.campaign, st.session_state
    kept, of_these = file_store.certifications(campaign), campaign.fingerprint[:8]
    shown, file_key = f"kept of {of_these}", f"earlier file {of_these}"
    wrong = state.pop(_WRONG, None)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        place = st.container()
        with st.popover("Upload one", icon=":material/upload:"):
            label = f"The {FILE} of an earlier certification of this vehicle"
            try:
                choose_kept(label, FILE, _CHOICE, file_key, lambda content: _read(content, campaign))
            except CrashfuseError as error:
                wrong = wrong or (error if state[_CHOICE] is None else None)  # what was chosen is told above
        st.button("Keep today’s verdicts", icon=":material/bookmark_add:", on_click=_keep, args=(certification,))
    address.put(shown, state[_CHOICE] if state[_CHOICE] in kept else None)
    place.selectbox(
        "Earlier certification", list(kept), index=None, format_func=lambda name: _described(kept[name]), key=shown,
        placeholder="none chosen" if kept else "none of this vehicle is kept on this machine",
        on_change=lambda: state.update({_CHOICE: state[shown]}),
    )  # fmt: skip
    if wrong is not None:
        show_wrong(wrong)
    elif (told := state.pop(_KEPT, None)) is not None:
        st.success(told, icon=":material/bookmark:")


def _read(content: bytes, campaign: Campaign) -> Earlier:
    earlier = parse_earlier(content)
    earlier.require_of(campaign)
    return earlier


def _keep(certification: Certification) -> None:
    try:
        kept = file_store.keep_certification(certification_json(certification), certification.campaign)
        st.session_state[_KEPT] = (
            f"Kept on this machine since {kept.date}. SHA-256 {kept.digest}: who has this number before a test is run "
            "can show that the verdicts were there first."
        )
    except CrashfuseError as error:
        st.session_state[_WRONG] = error


def _described(earlier: Earlier) -> str:
    """One in a few words, to choose it by."""
    asked = ", ".join(criterion.name for criterion in earlier.criteria.items)
    return (
        f"{earlier.date} · {len(earlier.matrix.ids):,} conditions, {len(earlier.tests)} tests · {asked} at "
        f"{earlier.criteria.confidence:g} · {earlier.settings.get('approach', 'unknown approach')}"
    )
