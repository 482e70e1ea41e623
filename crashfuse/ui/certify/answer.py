"""The tab Answer: skip, run, would miss or cannot say, with reasons, caveats and what-ifs."""

from dataclasses import replace
from functools import partial

import pandas as pd
import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Certification, Variant
from crashfuse.certification.criteria import Criteria, varied
from crashfuse.reporting.certification_facts import DECISIVE, exceptions, sentences
from crashfuse.reporting.certification_tables import changed_text
from crashfuse.reporting.plots.certification import MOST_WORDS
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.verdicts import Planned, Verdicts, planned
from crashfuse.study.outliers import departures
from crashfuse.ui.certify import results
from crashfuse.ui.certify.results import Judgement, judge
from crashfuse.ui.kit import address
from crashfuse.ui.kit.figures import choose, show_clickable
from crashfuse.ui.kit.navigation import open_page
from crashfuse.ui.kit.progress import show_end, show_job
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain
from crashfuse.ui.predict import fill_in
from crashfuse.units import joined

_CELL, _CRITERION = "cell", "criterion of the cell"  # session keys
_MANY_PX = 560  # of a list that scrolls: the reason stays beside it
_FEW, _MOST = 12, 200  # planned tests in a list without scrolling, and at all
_WITHOUT = "without "  # what if
_WAYS = ("Planned tests", "By criterion")
_MEANINGS = {
    "skip": "would meet all criteria at once, with the confidence asked for",
    "run": "uncertain, or a wrong answer costs too much: a test, or another design, can tell",
    "would miss": "would miss a criterion: another design, not a test, is needed",
    "cannot say": "beyond what the tests check, or records end too early",
    "was run": "a test was made there",
}


def show(judgement: Judgement) -> None:
    """Show the answer, why, what speaks against it, and what would change it."""
    certification = judgement.certification
    _show_headline(certification)
    subjects = list(exceptions(certification).items())
    with st.container(key="caveats"):
        for subject, (first, *others) in [own for own in subjects if own[0] in DECISIVE]:
            more = f" :gray[and {len(others)} more below]" if others else ""
            st.markdown(f":small[:material/warning: **{plain(subject)}:** {plain(first)}{more}]")
    left, right = st.columns([3, 2], gap="medium")
    with left:
        way = choose("Shown as", _WAYS, key="answered")
        (_show_planned if way == _WAYS[0] else _show_matrix)(judgement)
    with right:
        _show_reason(certification, judgement.display)
    _show_variants(certification)
    n = sum(len(told) for _, told in subjects)
    with st.expander(f"All {n} caveats, and the answer in sentences", icon=":material/list:"):
        for subject, told in subjects:
            st.markdown(f"**{plain(subject)}**\n" + "\n".join(f"- {plain(sentence)}" for sentence in told))
        st.markdown("**The answer in sentences**")
        judgement.show_sentences("summary")


def _show_headline(certification: Certification) -> None:
    (headline,) = sentences(certification, "answer")
    st.subheader(headline, anchor=False)
    for sentence in sentences(certification, "headline"):
        st.caption(plain(sentence))


def _show_planned(judgement: Judgement) -> None:
    rows, chosen = planned(judgement.certification), str(st.session_state[_CELL] or "").partition(" | ")[0]
    with st.container(height=_MANY_PX if len(rows) > _FEW else "content", border=False, gap=None, key="planned_tests"):
        for number, row in enumerate(rows[:_MOST]):
            label = f"**{row.word}** *{plain(row.id)}* {plain(judgement.display.speed(row.condition.speed_mps))} · "
            st.button(
                label + plain(judgement.display.words(row.why)), key=f"planned {row.word} {number}", width="stretch",
                type="primary" if row.id == chosen else "secondary", on_click=_choose, args=(row.id,),
            )  # fmt: skip
    if len(rows) > _MOST:
        st.caption(f"The slowest {_MOST}; *By criterion* has all.")
    words = dict.fromkeys(row.word for row in rows)
    st.caption("  \n".join(f"**{word}**: {_MEANINGS[word]}" for word in _MEANINGS if word in words))


def _choose(cell: str) -> None:
    st.session_state[_CELL] = cell


def _show_matrix(judgement: Judgement) -> None:
    n = len(judgement.certification.matrix.ids)
    with st.container(height=_MANY_PX if n > _FEW else "content", border=False):
        draw = partial(judgement.verdicts.plot, display=judgement.display)
        alt = "Verdicts by planned test and criterion"
        show_clickable(draw, alt, _choose, "verdict matrix", judgement.key, judgement.display, name="verdicts")
    told = "Probability that a test there meets the criterion. Click a cell for its reason."
    st.caption(told if n <= MOST_WORDS else "Point at a cell for its verdict.")


def _show_reason(certification: Certification, display: Display) -> None:
    state, rows = st.session_state, {row.id: row for row in planned(certification)}
    test, _, criterion = str(state.get(_CELL) or "").partition(" | ")
    if test not in rows:  # of another matrix
        test = ""
    shown = f"planned test of {len(rows)}"
    state[shown] = test or None
    st.selectbox(
        "Why? Choose a planned test, or click one", list(rows), index=None, key=shown, placeholder="none chosen",
        format_func=lambda i: f"{i} · {display.speed(rows[i].condition.speed_mps)} · {rows[i].word}",
        on_change=lambda: _choose(state[shown]),
    )  # fmt: skip
    if not test:
        return
    row, verdicts = rows[test], {own.criterion.name: own for own in certification.rows[test]}
    with st.container(border=True):
        st.markdown(f"**{plain(test)}: {row.word}** · {plain(display.words(row.why))}")
        st.caption(plain(display.condition(row.condition)))
        state[_CRITERION] = criterion if criterion in verdicts else _deciding(row, certification)
        st.pills(
            "Criterion", list(verdicts), key=_CRITERION, required=True, label_visibility="collapsed",
            format_func=lambda name: plain(f"{name}: {verdicts[name].word}"),
            on_change=lambda: _choose(f"{test} | {state[_CRITERION]}"),
        )  # fmt: skip
        verdict = verdicts[state[_CRITERION]]
        st.markdown(f"**{plain(display.words(joined([verdict.criterion.label, verdict.criterion.limits], ', ')))}**")
        st.markdown(plain(display.words(verdict.reason)))
        button, args = "See the predicted pulse there", (certification.campaign, row.condition)
        if st.button(button, icon=":material/arrow_forward:", on_click=fill_in, args=args):
            open_page("predict")


def _deciding(row: Planned, certification: Certification) -> str:
    words = {"would miss": "not met", "run": "open"}
    verdicts = certification.rows[row.id]
    deciding = [own for own in verdicts if own.word == words.get(row.word)] or verdicts
    return min(deciding, key=lambda own: 0.0 if own.probability is None else own.probability).criterion.name


def _variants(certification: Certification) -> dict[str, tuple[Campaign, Criteria]]:
    campaign, criteria, tests = certification.campaign, certification.criteria, certification.campaign.test_ids
    apart = [own.test for own in departures(campaign)]
    without = dict.fromkeys((*apart, *tests)) if len(tests) > 1 else ()
    return {
        **{name: (campaign, other) for name, other in varied(criteria).items()},
        **{f"{_WITHOUT}{test}": (campaign.without((test,)), criteria) for test in without},
    }


def _show_variants(certification: Certification) -> None:
    variants, state, table, key = _variants(certification), st.session_state, [], "what_if"
    address.put(key, [name for name in state[key] if name in variants])
    asked = st.pills(
        "What if …", [*variants], selection_mode="multi", format_func=plain, key=key, persist_state="session"
    )
    for name in asked:
        request = judge(*variants[name], certification.matrix)
        if request.find() is None:
            request.start()
        if (job := request.find()) is None:
            continue
        if job.active:
            show_job(job)
        elif job.result is not None:
            variant = Variant.of(name, certification, job.result.certification)
            saved, changed = "{} of {}".format(*variant.saved), changed_text(variant)
            table.append({"What if": name, "Need not be run": saved, "What changes": changed or "nothing"})
        else:
            show_end(job)
    if table:
        show_table(pd.DataFrame(table), key="what if")


def show_files(judgement: Judgement) -> None:
    """Offer them; what the page shows *without* a test is in them, as other limits and confidences always are."""
    certification, asked = judgement.certification, st.session_state["what_if"]
    variants, matrix = _variants(certification), certification.matrix
    without = [name for name in variants if name in asked and name.startswith(_WITHOUT)]
    known = {name: other for name in without if (other := judge(*variants[name], matrix).result) is not None}
    others = (Variant.of(name, certification, other.certification) for name, other in known.items())
    with_all = replace(certification, variants=(*certification.variants, *others))
    results.show_files(replace(judgement, verdicts=Verdicts(with_all)))
