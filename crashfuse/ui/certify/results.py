"""Verdicts on the Certify page: the answer with reasons and what-ifs, their record, domain and files."""

from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import streamlit as st

from crashfuse.approaches.registry import APPROACHES
from crashfuse.campaign import Campaign
from crashfuse.certification import file_store
from crashfuse.certification.certify import APPROACH, Certification, Variant, certify, is_computed
from crashfuse.certification.criteria import Criteria, varied
from crashfuse.certification.earlier import FILE, Earlier, parse_earlier
from crashfuse.certification.matrix import Matrix
from crashfuse.errors import CrashfuseError
from crashfuse.results.certification import certification_json, certification_result
from crashfuse.results.certification_facts import exceptions
from crashfuse.results.certification_tables import Planned, planned, turned_texts
from crashfuse.results.display import Display
from crashfuse.results.plots.certification import planned_scales
from crashfuse.results.table import Table
from crashfuse.study.outliers import departures
from crashfuse.ui.certify.criteria import criteria_asked
from crashfuse.ui.certify.entry import choose_kept, find_kept, show_wrong
from crashfuse.ui.certify.matrix import matrix_asked, question_files
from crashfuse.ui.kit import address
from crashfuse.ui.kit.address import chosen_config, kept
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import Request, said_of, usual_s
from crashfuse.ui.kit.editing import notes_of
from crashfuse.ui.kit.figures import choose, show_cached_figure, show_clickable
from crashfuse.ui.kit.files import offer_result
from crashfuse.ui.kit.navigation import open_page
from crashfuse.ui.kit.progress import show_end, show_job
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain
from crashfuse.units import counted, joined

_CHOICE, _KEPT = "earlier", "verdicts that were kept"  # session keys
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


def judge(campaign: Campaign, criteria: Criteria, matrix: Matrix) -> Request[Certification]:
    """Judge criteria at the conditions of a matrix, by the chosen approach and settings."""
    address.default("approach", APPROACH, APPROACHES)
    approach = st.session_state["approach"]
    config = replace(chosen_config(approach), leave_out="test")
    return Request(
        ("certification", said_of(campaign), criteria, matrix, approach, config.preset, config.seed, config.device),
        f"{campaign.name}: verdicts on {len(matrix.ids)} planned tests",
        lambda watch: certify(campaign, criteria, matrix, approach=approach, config=config, watch=watch),
        lambda: is_computed(campaign, criteria, matrix, config),
        lambda: usual_s(campaign, config, 2 * len(campaign.tests)),
    )


def last_verdicts(view: View) -> tuple[Certification | None, str]:
    """Verdicts of what Certify has chosen, if known, else what it takes to know them."""
    try:
        criteria, matrix = criteria_asked(view), matrix_asked(view)
    except CrashfuseError as error:
        return None, f"the criteria or planned tests cannot be read: {error}"
    if criteria is None:
        return None, "no criteria declared yet"
    if matrix is None:
        return None, "no tests are planned yet"
    verdicts = judge(view.campaign, criteria, matrix).result
    return verdicts, "" if verdicts is not None else f"{len(matrix.ids):,} planned tests not judged yet"


def question(criteria: Criteria, matrix: Matrix) -> str:
    """What was asked, in a line."""
    n, planned = counted(len(criteria.items), "criterion"), counted(len(matrix.ids), "planned test")
    return f"{n} · {planned} · confidence {criteria.confidence:g} · change"


def _show_sentences(told: Sequence[str]) -> None:
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in told))


def _key(certification: Certification) -> Hashable:
    digest = None if certification.since is None else certification.since.earlier.digest
    return said_of(certification.campaign), certification.criteria, certification.matrix, certification.config, digest


def _show_figure(view: View, certification: Certification, name: str, alt: str, file: str) -> None:
    draw = partial(certification_result(certification).figures[name].draw, view.display)
    show_cached_figure(draw, alt, name, _key(certification), view.display, name=file)


def show_record(view: View, certification: Certification) -> None:
    """Show how often verdicts, also earlier ones, were wrong."""
    result = certification_result(certification)
    _show_sentences(result.sentences["record"])
    if certification.record.trials:
        with st.expander("Verdicts on left-out tests, by criterion", icon=":material/table:"):
            show_table(result.tables["record"], "counts")
        name, alt, meaning = _RECORD[choose("Figure", list(_RECORD), key="record")]
        st.caption(meaning)
        _show_figure(view, certification, name, alt, "track_record" if name == "record" else name)
    with st.expander("Earlier verdicts", icon=":material/history:", expanded=certification.since is not None):
        _choose_earlier(certification)
        if certification.since is None:
            return
        _show_sentences(result.sentences["since"])
        if certification.since.trials:
            show_table(result.tables["since"], "earlier verdicts")


@st.cache_resource(max_entries=50, show_spinner=False)
def keep_past(key: Hashable, _verdicts: Certification) -> None:  # noqa: ARG001 - once
    """List it among past results, if there is room on this machine."""
    with suppress(CrashfuseError):
        file_store.keep_certification(certification_json(_verdicts), _verdicts.campaign)


def beside_earlier(verdicts: Certification, key: Hashable) -> Certification:
    """The verdicts beside the chosen earlier certification, if it can be read."""
    try:
        earlier = find_kept(FILE, _CHOICE, parse_earlier)
        return verdicts if earlier is None else _beside((key, earlier.digest), verdicts, earlier)
    except CrashfuseError as error:
        show_wrong(error)
        return verdicts


@st.cache_resource(max_entries=8, show_spinner=False)
def _beside(key: Hashable, _verdicts: Certification, _earlier: Earlier) -> Certification:  # noqa: ARG001
    return _verdicts.beside(_earlier)


def _choose_earlier(certification: Certification) -> None:
    campaign, state = certification.campaign, st.session_state
    of_these = campaign.fingerprint[:8]

    def keep() -> None:
        try:
            today = file_store.keep_certification(certification_json(certification), campaign)
            noted = f"SHA-256 {today.digest}: noted before a test, it shows that the verdicts came first."
            state[_KEPT] = f"Kept on this machine since {today.date}. {noted}"
        except CrashfuseError as error:
            state[_KEPT] = error

    with st.container(horizontal=True, vertical_alignment="bottom"):
        place = st.container()
        with st.popover("Upload one", icon=":material/upload:"):
            label, key = f"The {FILE} of an earlier certification of this vehicle", f"earlier file {of_these}"
            choose_kept(label, FILE, _CHOICE, key, lambda content: parse_earlier(content).require_of(campaign))
        st.button("Keep today’s verdicts", icon=":material/bookmark_add:", on_click=keep)
    if isinstance(told := state.pop(_KEPT, None), CrashfuseError):
        show_wrong(told)
    elif told is not None:
        st.success(told, icon=":material/bookmark:")
    kept, shown = file_store.certifications(campaign), f"kept of {of_these}"
    address.put(shown, state[_CHOICE] if state[_CHOICE] in kept else None)
    place.selectbox(
        "Earlier certification", list(kept), index=None, format_func=lambda name: _described(kept[name]), key=shown,
        placeholder="none chosen" if kept else "none of this vehicle is kept on this machine",
        on_change=lambda: state.update({_CHOICE: state[shown]}),
    )  # fmt: skip


def _described(earlier: Earlier) -> str:
    asked = ", ".join(criterion.name for criterion in earlier.criteria.items)
    return (
        f"{earlier.date} · {len(earlier.matrix.ids):,} conditions, {len(earlier.tests)} tests · {asked} at "
        f"{earlier.criteria.confidence:g} · {earlier.settings.get('approach', 'unknown approach')}"
    )


def show_domain(view: View, certification: Certification) -> None:
    """Show where predictions are checked, with the conditions of the matrix in it."""
    alt = "Speed against mass: the checked region, CAE runs, tests, planned tests"
    _show_figure(view, certification, "domain", alt, "validated_domain")
    st.caption("  \n".join(map(plain, certification_result(certification).sentences["domain"])))


_CELL, _CRITERION = "cell", "criterion of the cell"  # session keys
_MOST = 200  # planned tests in a list
_WITHOUT = "without "  # what if


def show_answer(view: View, certification: Certification) -> None:
    """Show the answer, why, what speaks against it, and what would change it."""
    result = certification_result(certification)
    headline, *others = result.answer
    st.subheader(headline, anchor=False)
    for sentence in dict.fromkeys((*others, *result.sentences["costs"])):
        st.caption(plain(sentence))
    with st.container(key="caveats"):
        for subject, sentence in result.against.items():
            st.markdown(f":small[:material/warning: **{plain(subject)}:** {plain(sentence)}]")
    rows = planned(certification)
    chosen, _, criterion = str(st.session_state[_CELL] or "").partition(" | ")
    if chosen not in {row.id for row in rows}:  # of another matrix, or none: the one to act on
        acting = [row.id for row in rows if row.word == "run"] or [rows[0].id]
        chosen, criterion = certification.run_first or acting[-1], ""
    left, right = st.container(key="answers").columns([12, 5], gap="small")
    with left:
        _show_planned(view, certification, chosen)
    with right, st.container(key="why"):
        _show_reason(certification, view.display, chosen, criterion)
    _show_variants(certification)
    caveats = exceptions(certification)
    with st.expander(f"All {sum(map(len, caveats.values()))} caveats", icon=":material/list:"):
        for subject, told in caveats.items():
            st.markdown(f"**{plain(subject)}**")
            _show_sentences(told)


def _show_planned(view: View, certification: Certification, chosen: str) -> None:
    rows = planned(certification)
    left, right = st.columns([10, 11], gap=None)
    with left, st.container(gap=None, key="planned_tests"):
        st.markdown(f"**Answer** *Test* **{view.display.system.speed}**")
        for number, row in enumerate(rows[:_MOST]):
            label = f"**{row.word}** *{plain(row.id)}* **{view.display.speeds(row.condition.speed_mps):.1f}** "
            st.button(
                label + plain(view.display.words(row.brief)), key=f"planned {row.word} {number}", width="stretch",
                type="primary" if row.id == chosen else "secondary", on_click=_choose, args=(row.id,),
            )  # fmt: skip
    with right:
        draw = partial(planned_scales, certification, view.display, slice(_MOST), names=False)
        alt = "Interval, measured value and limit by test"
        show_clickable(draw, alt, _choose, "planned scales", _key(certification), view.display, name="planned")
    more = f" The slowest {_MOST} of {len(rows)}." if len(rows) > _MOST else ""
    st.caption(f"Bar: 95 of 100 tests. Line: limit, missed where shaded. Dot: measured.{more}")


def _choose(cell: str) -> None:
    st.session_state[_CELL] = cell


def _show_reason(certification: Certification, display: Display, test: str, criterion: str) -> None:
    state, row = st.session_state, next(row for row in planned(certification) if row.id == test)
    verdicts = {own.criterion.name: own for own in certification.rows[test]}
    with st.container(border=True):
        st.markdown(f"**{plain(row.id)}: {plain(row.word)}** at {plain(display.condition(row.condition))}")
        if more := [*([row.why] if row.why != row.brief else []), *row.further]:
            st.caption(plain(display.words(joined(more, "; "))))
        state[_CRITERION] = criterion if criterion in verdicts else _deciding(row, certification)
        st.pills(
            "Criterion", list(verdicts), key=_CRITERION, required=True, label_visibility="collapsed",
            format_func=lambda name: plain(verdicts[name].criterion.title),
            on_change=lambda: _choose(f"{test} | {state[_CRITERION]}"),
        )  # fmt: skip
        verdict = verdicts[state[_CRITERION]]
        st.markdown(f"**{verdict.word}:** {plain(verdict.criterion.label)}\n\n{plain(display.words(verdict.reason))}")
        button, args = "See the predicted pulse there", (certification.campaign, row.condition)
        if st.button(button, on_click=address.choose_condition, args=args):
            open_page("predict")


def _deciding(row: Planned, certification: Certification) -> str:
    words = {"would miss": "not met", "run": "open"}
    verdicts = certification.rows[row.id]
    deciding = [own for own in verdicts if own.word == words.get(row.word)] or verdicts
    return min(deciding, key=lambda own: 0.0 if own.probability is None else own.probability).criterion.name


def _variants(certification: Certification) -> dict[str, tuple[Callable[[], Campaign], Criteria]]:
    campaign, criteria, tests = certification.campaign, certification.criteria, certification.campaign.test_ids
    apart = [own.test for own in departures(campaign)]
    without = dict.fromkeys((*apart, *tests)) if len(tests) > 1 else ()
    return {
        **{name: (lambda: campaign, other) for name, other in varied(criteria).items()},
        **{f"{_WITHOUT}{test}": (partial(certification.without, test), criteria) for test in without},
    }


def _show_variants(certification: Certification) -> None:
    variants, state, table, key = _variants(certification), st.session_state, [], "what_if"
    address.put(key, [name for name in state[key] if name in variants])
    usual = "another confidence, limits, a test less"
    for name in st.multiselect("What if …", [*variants], placeholder=usual, **kept(key)):
        campaign, criteria = variants[name]
        request = judge(campaign(), criteria, certification.matrix)
        if request.find() is None:
            request.start()
        if (job := request.find()) is None:
            continue
        if job.active:
            show_job(job)
        elif job.result is not None:
            saved, turned = "{} of {}".format(*job.result.saved), joined(turned_texts(certification, job.result), "; ")
            table.append({"What if": name, "Need not be run": saved, "What changes": turned or "nothing"})
        else:
            show_end(job)
    if table:
        show_table(Table.of("what if", table))


def show_files(view: View, certification: Certification) -> None:
    """Offer them, with criteria and matrix; what is shown *without* a test is in them, as other limits always are."""
    variants, matrix, asked = _variants(certification), certification.matrix, st.session_state["what_if"]
    without = {name: own for name, own in variants.items() if name in asked and name.startswith(_WITHOUT)}
    judged = {name: judge(campaign(), criteria, matrix).result for name, (campaign, criteria) in without.items()}
    others = (Variant.of(name, certification, other) for name, other in judged.items() if other is not None)
    with_all = replace(certification, variants=(*certification.variants, *others))
    result = certification_result(with_all, notes_of(view))
    asks = {name: partial(bytes, content) for name, content in question_files(certification.criteria, matrix).items()}
    offer_result(replace(result, files={**result.files, **asks}), view.display, certification.campaign.name)
