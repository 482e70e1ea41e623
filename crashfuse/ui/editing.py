"""Editing the open campaign on the page Data: tests in use, tests taken out, the last change undone, a copy to edit."""

import os
from collections.abc import Callable
from pathlib import Path

import streamlit as st

from crashfuse.campaign_folder.editing import copy_campaign, leave_out, remove_tests, say_why, use_again
from crashfuse.campaign_folder.history import changed_by, changes, is_sample, undo
from crashfuse.campaign_folder.settings import LONGEST_REASON
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.ui import address, campaigns, journal, recent
from crashfuse.ui.chosen import View, choose_campaign
from crashfuse.ui.problems import show_problems
from crashfuse.ui.text import plain, show_label
from crashfuse.ui.uploads import is_ours
from crashfuse.ui.visitors import visitor

_USED, _REMOVED, _COPY = "tests in use", "test to take out", "copy folder"  # widget keys
_REFUSED = "edit refused"  # session key


def can_be_edited(folder: Path) -> bool:
    """True if a campaign folder is the user's own and can be written: not the sample, nor an upload."""
    return not is_ours(folder) and os.access(folder, os.W_OK)


def show_last_change(view: View) -> None:
    """Show in a line what was changed last, with a button that undoes it."""
    last = next(iter(changes(view.folder)), None) if can_be_edited(view.folder) else None
    if last is None:
        return
    with st.container(horizontal=True, vertical_alignment="center", gap="small"):
        st.markdown(f":material/history: {plain(last.what)}.", width="content")
        st.button(
            "Undo",
            icon=":material/undo:",
            on_click=_edit,
            args=(view, lambda: undo(view.folder, last).what, "Undone: "),
            help=f"{plain(str(last))}. The folder will be what it was before.",
        )


def offer_leaving_out(view: View) -> None:
    """Offer to leave out of use the tests whose sensor failed, with what happened as the reason."""
    doubtful = [test for test in view.campaign.tests if test.faults]
    if len(view.campaign.tests) > 1 and can_be_edited(view.folder):
        for test in doubtful:
            st.button(
                f"Leave {plain(test.id)} out of use", icon=":material/block:", key=f"leave out {test.id}",
                on_click=_leave_out_failed, args=(view, test),
            )  # fmt: skip


def _leave_out_failed(view: View, test: CrashTest) -> None:
    why = "; ".join(fault.text for fault in test.faults)[:LONGEST_REASON]
    _edit(view, lambda: leave_out(view.folder, [test.id], why), gone=[test.id])


def show_tests_in_use(view: View) -> None:
    """Show which tests are in use, to be changed by a click; of a campaign that cannot be edited, offer a copy."""
    if problems := st.session_state.pop(_REFUSED, None):
        show_problems(problems, "Nothing was changed", "The campaign is as it was.", place="edit")
    if not can_be_edited(view.folder):
        _offer_copy(view)
        return
    used, unused = view.campaign.test_ids, tuple(test_id for test_id, _ in view.campaign.unused)
    address.put(_USED, list(used))
    with st.container(horizontal=True, vertical_alignment="bottom"):
        st.pills(
            "Tests in use", sorted((*used, *unused)), selection_mode="multi", format_func=plain, key=_USED,
            on_change=_change_use, args=(view, used), width="content", wrap=True,
            help="A click leaves a test out of use, another one uses it again. It stays in the folder, but nothing "
            "learns from it and it is not rated: `unused` in campaign.toml.",
        )  # fmt: skip
        with st.popover("Take out …", icon=":material/delete:", help="Take a test out of the campaign folder."):
            st.selectbox("Test", sorted((*used, *unused)), key=_REMOVED)
            st.caption("Its row and its pulse leave the folder. Undo brings them back.")
            st.button("Take it out of the folder", on_click=_take_out, args=(view,))
    for test_id in unused:
        key, label = f"why {test_id} of {view.folder} is left out", f"Why is {test_id} left out?"
        address.put(key, view.campaign.why_unused.get(test_id, ""))
        show_label(label)
        st.text_input(
            label, key=key, max_chars=LONGEST_REASON, on_change=_say_why, args=(view, test_id, key),
            label_visibility="collapsed", placeholder="no reason given; what you write stands in every report",
        )  # fmt: skip


def _change_use(view: View, used: tuple[str, ...]) -> None:
    """Leave out the tests that were just deselected, and use those again that were selected."""
    chosen = set(st.session_state[_USED])
    if out := [test_id for test_id in used if test_id not in chosen]:
        _edit(view, lambda: leave_out(view.folder, out), gone=out)
    if again := sorted(chosen - {*used}):
        _edit(view, lambda: use_again(view.folder, again))


def _say_why(view: View, test_id: str, key: str) -> None:
    """Keep the reason, an empty one, too; a test that is in use by now, by the click that ended typing, needs none."""

    def keep() -> str:
        try:
            return say_why(view.folder, test_id, st.session_state[key])
        except UsageError:
            return f"{test_id} is not left out any more: no reason was kept"

    _edit(view, keep)


def _take_out(view: View) -> None:
    test_id = st.session_state[_REMOVED]
    _edit(view, lambda: remove_tests(view.folder, [test_id]), gone=[test_id])


def _edit(view: View, change_it: Callable[[], str], before: str = "", gone: list[str] | None = None) -> None:
    """Change the campaign and say so; a refusal is kept for the page to show."""
    try:
        with changed_by(visitor().name):
            told = change_it()
    except DataError as error:
        st.session_state[_REFUSED] = error.problems
    except (UsageError, OSError) as error:
        expected, advice = "a change that can be made", "choose otherwise, or check your rights"
        st.session_state[_REFUSED] = (Problem(view.campaign.name, expected, _said(error), advice),)
    else:
        if st.session_state["test"] in (gone or ()):
            st.session_state["test"] = None
        journal.note(visitor(), f"{before}{told}, in {view.folder}")
        st.toast(f"{before}{plain(told)}.", icon=":material/check:")


def _offer_copy(view: View) -> None:
    """Offer to save a campaign that cannot be edited as one that can be."""
    what = "The sample" if is_sample(view.folder) else "This campaign"
    with st.popover("Save a copy to edit", icon=":material/content_copy:"):
        st.markdown(f"{what} itself is not edited: leave tests out of use, or add some, in a copy.")
        st.text_input(
            "Folder of the copy", key=_COPY, persist_state="session", placeholder=str(Path.home() / "my-campaign"),
            help="On the computer that crashfuse runs on. It must not hold anything yet.",
        )  # fmt: skip
        st.button("Save the copy", type="primary", on_click=_save_copy, args=(view,))


def _save_copy(view: View) -> None:
    text = st.session_state.get(_COPY, "")
    try:
        folder = campaigns.typed_folder(text, "folder of the copy", "a new or empty folder")
        copy_campaign(view.folder, folder)
        choose_campaign(campaigns.open_folder(folder))
    except DataError as error:
        st.session_state[_REFUSED] = error.problems
        return
    except OSError as error:
        expected, advice = "a folder that can be written", "check the path and your rights"
        st.session_state[_REFUSED] = (Problem(text.strip(), expected, _said(error), advice),)
        return
    recent.remember(folder)
    st.toast("Saved; the copy is open.", icon=":material/check:")


def _said(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
