"""Verdicts on the Certify page, their record, domain and files."""

from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import partial

import streamlit as st

from crashfuse.approaches.registry import APPROACHES
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.certification import file_store
from crashfuse.certification.certify import APPROACH, Certification, is_computed
from crashfuse.certification.criteria import Criteria, criteria_text
from crashfuse.certification.earlier import FILE, Earlier, parse_earlier
from crashfuse.certification.matrix import Matrix
from crashfuse.errors import CrashfuseError
from crashfuse.reporting.certification_facts import Place, sentences
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.certification_tables import SHOWN, csv_as_given, matrix_table
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.report.certification import certification_report
from crashfuse.reporting.verdicts import Verdicts, certify
from crashfuse.ui.certify.criteria import criteria_asked
from crashfuse.ui.certify.entry import choose_kept, find_kept, show_wrong
from crashfuse.ui.certify.matrix import matrix_asked
from crashfuse.ui.kit import address
from crashfuse.ui.kit.address import chosen_config
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import Request, said_of
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.files import download_bytes, download_report, download_table
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain
from crashfuse.units import counted

_CHOICE, _WRONG, _KEPT = "earlier", "verdicts that could not be kept", "verdicts that were kept"  # session keys
_MANY, _MANY_PX = 3, 620  # criteria whose record scrolls
_RECORD = {
    "What left-out tests showed": (
        "record",
        "Predicted and measured values of left-out tests by criterion",
        "Lines: 95 % of tests are predicted there. Left: left out alone; right: with its speed group.",
    ),
    "Are the probabilities right?": (
        "reliability",
        "Share of left-out tests that met a criterion over its probability",
        "Verdicts in bins of probability, n in each; lines: exact 95 % bounds.",
    ),
}


def judge(campaign: Campaign, criteria: Criteria, matrix: Matrix) -> Request[Verdicts]:
    """Judge criteria at the conditions of a matrix, by the approach and the settings that are chosen."""
    address.default("approach", APPROACH, APPROACHES)
    approach = st.session_state["approach"]
    config = replace(chosen_config(approach), leave_out="test")
    return Request(
        ("certification", said_of(campaign), criteria, matrix, approach, config.preset, config.seed, config.device),
        f"{campaign.name}: verdicts on {len(matrix.ids)} planned tests",
        lambda watch: certify(campaign, criteria, matrix, approach=approach, config=config, watch=watch),
        lambda: is_computed(campaign, criteria, matrix, config),
    )


def last_verdicts(view: View) -> tuple[Verdicts | None, str]:
    """Verdicts of what Certify has chosen, if known, else what it takes to know them."""
    try:
        criteria, matrix = criteria_asked(view), matrix_asked(view)
    except CrashfuseError as error:
        return None, f"the criteria or planned tests cannot be read: {error}"
    if criteria is None:
        return None, "criteria are not declared: start with limits of these tests"
    if matrix is None:
        return None, "no tests are planned yet"
    verdicts = judge(view.campaign, criteria, matrix).result
    return verdicts, "" if verdicts is not None else f"{len(matrix.ids):,} planned tests are not judged yet"


def question(criteria: Criteria, matrix: Matrix) -> str:
    """What was asked, in a line."""
    n, planned = counted(len(criteria.items), "criterion"), counted(len(matrix.ids), "planned test")
    return f"{n} · {planned} · confidence {criteria.confidence:g} · change"


@dataclass(frozen=True, eq=False)
class Judgement:
    """Verdicts, notes on the tests, and how the reader wants to see them."""

    verdicts: Verdicts
    display: Display
    notes: tuple[Note, ...]
    key: Hashable  # equal for equal verdicts: the beginning of the key of a cached figure

    @property
    def certification(self) -> Certification:
        """Verdicts, record and domain in SI."""
        return self.verdicts.certification

    def show_sentences(self, place: Place) -> None:
        """Show what is said in a place, a line each."""
        st.markdown("\n".join(f"- {plain(sentence)}" for sentence in sentences(self.certification, place)))

    def show_figure(self, name: str, alt: str, file: str) -> None:
        """Show a figure of the verdicts."""
        draw = partial(self.verdicts.plot, name, display=self.display)
        show_cached_figure(draw, alt, name, self.key, self.display, name=file)


def show_record(judgement: Judgement) -> None:
    """Show how often verdicts, also earlier ones, were wrong."""
    certification = judgement.certification
    st.caption("Verdicts on each test from the others, and without its speed group, against what was measured.")
    judgement.show_sentences("record")
    if certification.record.trials:
        with st.expander("Verdicts on left-out tests, by criterion", icon=":material/table:"):
            show_table(SHOWN["record"](certification, judgement.display), "counts")
        name, alt, meaning = _RECORD[choose("Figure", list(_RECORD), key="record")]
        st.caption(meaning)
        is_long = name == "record" and len(certification.criteria.items) >= _MANY
        with st.container(height=_MANY_PX if is_long else "content", border=False):
            judgement.show_figure(name, alt, "track_record" if name == "record" else name)
    with st.expander("Earlier verdicts", icon=":material/history:", expanded=certification.since is not None):
        _choose_earlier(certification)
        if certification.since is None:
            st.caption("Tests run since are held against earlier verdicts.")
            return
        judgement.show_sentences("since")
        if certification.since.trials:
            show_table(SHOWN["since"](certification, judgement.display), "earlier verdicts")


def beside_earlier(verdicts: Verdicts, key: Hashable) -> Verdicts:
    """The verdicts beside the earlier certification that was chosen, if it can be read."""
    try:
        earlier = find_kept(FILE, _CHOICE, parse_earlier)
        return verdicts if earlier is None else _beside((key, earlier.digest), verdicts, earlier)
    except CrashfuseError as error:
        show_wrong(error)
        return verdicts


@st.cache_resource(max_entries=8, show_spinner=False)
def _beside(key: Hashable, _verdicts: Verdicts, _earlier: Earlier) -> Verdicts:  # noqa: ARG001
    return Verdicts(_verdicts.certification.beside(_earlier))


def _choose_earlier(certification: Certification) -> None:
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
    elif (message := state.pop(_KEPT, None)) is not None:
        st.success(message, icon=":material/bookmark:")


def _read(content: bytes, campaign: Campaign) -> Earlier:
    earlier = parse_earlier(content)
    earlier.require_of(campaign)
    return earlier


def _keep(certification: Certification) -> None:
    try:
        kept = file_store.keep_certification(certification_json(certification), certification.campaign)
        st.session_state[_KEPT] = (
            f"Kept on this machine since {kept.date}. SHA-256 {kept.digest}: noted before a test, it shows that the "
            "verdicts came first."
        )
    except CrashfuseError as error:
        st.session_state[_WRONG] = error


def _described(earlier: Earlier) -> str:
    asked = ", ".join(criterion.name for criterion in earlier.criteria.items)
    return (
        f"{earlier.date} · {len(earlier.matrix.ids):,} conditions, {len(earlier.tests)} tests · {asked} at "
        f"{earlier.criteria.confidence:g} · {earlier.settings.get('approach', 'unknown approach')}"
    )


def show_domain(judgement: Judgement) -> None:
    """Show where predictions are checked, with the conditions of the matrix in it."""
    alt = "Speed against mass: the checked region, CAE runs, tests, planned tests"
    judgement.show_figure("domain", alt, "validated_domain")
    st.caption("  \n".join(plain(sentence) for sentence in sentences(judgement.certification, "domain")))


def show_files(judgement: Judgement) -> None:
    """Offer them; criteria and matrix ask for the same again."""
    verdicts, certification = judgement.verdicts, judgement.certification
    of = certification.campaign.name
    with st.container(horizontal=True):
        download_report(lambda: certification_report(certification, judgement.display, judgement.notes), of)
        download_bytes("certification.csv", lambda: csv_as_given(verdicts.table), of)
        download_table("track_record.csv", lambda: verdicts.track_record, of)
        download_table("credibility.csv", lambda: verdicts.credibility, of)
        download_bytes("criteria.toml", lambda: criteria_text(certification.criteria).encode(), of)
        download_bytes("matrix.csv", lambda: csv_as_given(matrix_table(certification.matrix)), of)
        download_bytes("certification.json", lambda: certification_json(certification), of)
