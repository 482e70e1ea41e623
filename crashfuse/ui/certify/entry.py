"""What the page Certify is given: rows typed in field by field, uploaded files, and what is wrong with either."""

import math
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import streamlit as st

from crashfuse.certification import file_store
from crashfuse.errors import CrashfuseError, DataError, UsageError, shortened
from crashfuse.ui.kit.text import plain
from crashfuse.units import UnitSystem

T = TypeVar("T")
SEPARATOR = "~"  # between the fields of a row, kept as a text


class Field(NamedTuple):
    """A field of a row; ``factor`` leads from the number kept to the one shown, ``clears`` has places to be emptied."""

    label: str
    options: dict[str, str] | None = None
    factor: float | None = None
    help: str | None = None
    clears: Sequence[int] = ()

    def number(self, text: str) -> float | None:
        """The number that is shown for a text, if it is one."""
        with suppress(ValueError):
            shown = float(f"{float(text) * (self.factor or 1.0):.6g}")
            return shown if math.isfinite(shown) else None
        return None

    def text(self, value: float | str | None, kept: str) -> str:
        """What is kept of a widget's value: what it shows already changes nothing."""
        if isinstance(value, float):
            return kept if value == self.number(kept) else f"{value / (self.factor or 1.0):.12g}"
        return (value or "").replace(SEPARATOR, "-")


def parts_of(text: str, n: int) -> list[str]:
    """The ``n`` fields of a row, of whatever a link has."""
    return [*text.split(SEPARATOR, n - 1), *[""] * n][:n]


def edit_rows(
    key: str,
    widths: Sequence[float],
    fields: Callable[[list[str]], Sequence[Field | None]],
    units: UnitSystem,
    most: int | None = None,
) -> None:
    """Let rows, the first ``most``, be typed in that session and address hold as texts; a width of 0 hides a place.

    Another list or unit begins with widgets of its own: a browser would send what it showed before.
    """
    state, written = st.session_state, f"{key} as typed"
    texts, number = state.get(written, (None, 0))
    if texts != state[key]:
        number += 1
        state[written] = list(state[key]), number
    unlabelled = {place for place, width in enumerate(widths) if width}

    def keep(row: int, place: int, field: Field, widget: str) -> None:
        parts = parts_of(state[key][row], len(widths))
        parts[place] = field.text(state[widget], parts[place])
        parts = ["" if other in field.clears else part for other, part in enumerate(parts)]
        state[key] = [*state[key][:row], SEPARATOR.join(parts), *state[key][row + 1 :]]
        if not field.clears:  # else other widgets begin
            state[written] = list(state[key]), number

    for row, text in enumerate(state[key][:most]):
        parts = parts_of(text, len(widths))
        *columns, last = st.columns([*filter(None, widths), 0.5], vertical_alignment="bottom", gap="small")
        shown = [(place, field) for place, field in enumerate(fields(parts)) if widths[place]]
        for column, (place, field) in zip(columns, shown, strict=True):
            if field is not None:
                widget = f"{key} {number} {row} {place} in {units.speed} {units.weight} {units.acceleration}"
                with column:
                    change = partial(keep, row, place, field, widget)
                    _edit(field, parts[place], widget, change, row=None if place in unlabelled else row + 1)
                unlabelled.discard(place)
        remaining = [*state[key][:row], *state[key][row + 1 :]]
        last.button(
            "", icon=":material/close:", help=f"Remove row {row + 1}", key=f"remove {key} {number} {row}",
            type="tertiary", on_click=state.update, args=({key: remaining},),
        )  # fmt: skip


def _edit(field: Field, text: str, widget: str, change: Callable[[], None], *, row: int | None) -> None:
    label = field.label if row is None else f"{field.label}, row {row}"  # which is read out
    look: dict[str, Any] = {"key": widget, "on_change": change}
    look |= {"help": field.help} if row is None else {"label_visibility": "collapsed"}
    if field.factor is not None:
        st.session_state.setdefault(widget, field.number(text))
        st.number_input(label, value=None, step=1.0, format="%.6g", **look)
    elif field.options is not None:
        options = field.options | ({} if text in ("", *field.options) else {text: text})  # what is not known, too
        st.session_state.setdefault(widget, text or None)
        look |= {"format_func": options.__getitem__, "placeholder": "not given", "required": bool(field.clears)}
        st.selectbox(label, list(options), index=None, **look)
    else:
        st.session_state.setdefault(widget, text)
        st.text_input(label, max_chars=100, **look)


def uploaded(content: bytes, name: str, read: Callable[[Path], T]) -> T:
    """Read an uploaded file's content by a function of the library, which takes a path; messages give it this name."""
    with tempfile.TemporaryDirectory(prefix="crashfuse-") as folder:
        path = Path(folder, name)
        path.write_bytes(content)
        return read(path)


def choose_kept(label: str, file: str, choice: str, key: str, read: Callable[[bytes], object]) -> None:
    """Ask for a file that is kept on the server, by a name in the address."""
    state = st.session_state

    def take(content: bytes | None) -> None:
        state[choice] = None
        if content is not None:
            read(content)
            state[choice] = file_store.keep(content, file)

    upload(label, file, key, take)


def upload(label: str, file: str, key: str, take: Callable[[bytes | None], None]) -> None:
    """Ask for a file whose content is taken, None once it is taken away; show what was wrong with the last."""
    state, wrong = st.session_state, f"{key}: wrong"

    def changed() -> None:
        given, state[wrong] = state[key], None
        try:
            take(given and given.getvalue())
        except DataError as error:  # it was read under its usual name
            named = (replace(problem, where=problem.where.replace(file, given.name, 1)) for problem in error.problems)
            state[wrong] = DataError([*named])
        except CrashfuseError as error:
            state[wrong] = error

    st.file_uploader(label, type=Path(file).suffix[1:], key=key, on_change=changed)
    if (error := state.get(wrong)) is not None:
        show_wrong(error)


def find_kept(file: str, choice: str, read: Callable[[bytes], T]) -> T | None:
    """What the address has as this choice; None if it has none. A CrashfuseError if it is gone."""
    if (name := st.session_state[choice]) is None:
        return None
    if (content := file_store.find(name)) is None:
        raise UsageError(f"The {file} of this link is not on this server any more. Upload it again.")
    return read(content)


def show_wrong(error: CrashfuseError) -> None:
    """Show what is wrong, a sentence each."""
    sentences = shortened(error.problems) if isinstance(error, DataError) else error.args[:1]
    st.error("  \n".join(plain(sentence) for sentence in sentences), icon=":material/error:")
