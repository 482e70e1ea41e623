"""An earlier certification beside the verdicts on the Certify page: what became of what it said."""

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.certification import kept_files
from crashfuse.certification.certify import Certification
from crashfuse.certification.changes import Changes
from crashfuse.certification.earlier import FILE, Earlier
from crashfuse.errors import CrashfuseError
from crashfuse.reporting.certification_changes import change_sentences, shown_changes
from crashfuse.reporting.certification_record import certification_json
from crashfuse.ui import address
from crashfuse.ui.certify.judgement import Judgement
from crashfuse.ui.certify.results import coloured
from crashfuse.ui.certify.uploaded import choose_kept, find_kept, show_wrong
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain

_CHOICE, _WRONG = "earlier", "verdicts that could not be kept"  # session keys


def show(judgement: Judgement) -> None:
    """Ask for an earlier certification; show whether it came true, and what is said otherwise today."""
    try:
        earlier = _choose(judgement.certification)
        changes = None if earlier is None else Changes.of(earlier, judgement.certification)
    except CrashfuseError as error:
        show_wrong(error)
        return
    if changes is None:
        st.caption(
            "What an earlier certification said is held against the tests that were run since. Choose one, and what "
            "became of it is in the report, too."
        )
        return
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in change_sentences(changes)))
    table = shown_changes(changes, judgement.display)
    if not table.empty:
        show_table(coloured(table, "Then", "Now").hide(axis="index"), key="earlier verdicts")


def changes_of(judgement: Judgement) -> Changes | None:
    """What became of the earlier certification that was chosen; None if none was, or it cannot be read any more."""
    try:
        earlier = find_kept(FILE, _CHOICE, Earlier.parse)
        return None if earlier is None else Changes.of(earlier, judgement.certification)
    except CrashfuseError:  # which is said beside the verdicts
        return None


def _choose(certification: Certification) -> Earlier | None:
    """Offer those of this vehicle that are kept, to upload one, and to keep today's; None while none is chosen."""
    campaign, state = certification.campaign, st.session_state
    kept, of_these = kept_files.certifications(campaign), campaign.fingerprint[:8]
    shown, file_key = f"kept of {of_these}", f"earlier file {of_these}"
    earlier, wrong = None, state.pop(_WRONG, None)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        place = st.container()
        with st.popover("Upload one", icon=":material/upload:"):
            label = f"The {FILE} of an earlier certification of this vehicle"
            try:
                earlier = choose_kept(label, FILE, _CHOICE, file_key, lambda content: _read(content, campaign))
            except CrashfuseError as error:
                wrong = wrong or error
        st.button("Keep today’s verdicts", icon=":material/bookmark_add:", on_click=_keep, args=(certification,))
    address.put(shown, state[_CHOICE] if state[_CHOICE] in kept else None)
    place.selectbox(
        "Earlier certification", list(kept), index=None, format_func=lambda name: _described(kept[name]), key=shown,
        placeholder="none chosen" if kept else "none of this vehicle is kept on this machine",
        on_change=lambda: state.update({_CHOICE: state[shown]}),
    )  # fmt: skip
    if wrong is not None:
        raise wrong
    return earlier


def _read(content: bytes, campaign: Campaign) -> Earlier:
    """An uploaded certification of this vehicle."""
    earlier = Earlier.parse(content)
    earlier.unknown_of(campaign)
    return earlier


def _keep(certification: Certification) -> None:
    try:
        kept = kept_files.keep_certification(certification_json(certification), certification.campaign)
        st.toast(f"Kept on this machine since {kept.date}, to be held against later tests.", icon=":material/bookmark:")
    except CrashfuseError as error:
        st.session_state[_WRONG] = error


def _described(earlier: Earlier) -> str:
    """One in a few words, to choose it by."""
    n, tests = len(earlier.matrix.ids), len(earlier.tests)
    conditions, learned = "1 condition" if n == 1 else f"{n:,} conditions", "1 test" if tests == 1 else f"{tests} tests"
    return f"{earlier.date} · {conditions} from {learned} · {earlier.settings['approach']} · {earlier.digest[:8]}"
