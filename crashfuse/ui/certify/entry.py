"""What the page Certify is given: rows of a table, uploaded files, and what is wrong with either."""

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

import pandas as pd
import streamlit as st
from streamlit.elements.lib.column_types import ColumnConfig

from crashfuse.certification import file_store
from crashfuse.errors import CrashfuseError, DataError, UsageError, refuse_if, shortened
from crashfuse.files.csv_text import neutral
from crashfuse.ui.kit.text import plain
from crashfuse.units import UnitSystem

T = TypeVar("T")
SEPARATOR = "~"  # between the fields of a row, kept as a text
_LONGEST, _WIDE, _MOST_ROWS = 100, 30, 1000  # of a text; of one that needs room; of rows, which stand in the address


@dataclass(frozen=True)
class Field:
    """A column of a table to be filled in."""

    label: str
    help: str | None = None
    factor: Callable[[list[str]], float] | None = None  # of a number: by the row, from what is kept to what is shown
    options: Mapping[str, str] | None = None  # with their labels, of a text that is chosen

    def column(self, begun: Sequence[str]) -> ColumnConfig:
        """How the browser shows it; numbers are texts: else it would take 25,5 for 255, and drop what is none."""
        if self.options is None:
            alignment: Literal["right", "left"] = "left" if self.factor is None else "right"
            return st.column_config.TextColumn(self.label, help=self.help, alignment=alignment)
        labels = {**self.options, **{text: text for text in begun if text and text not in self.options}}
        width: Literal["large"] | None = "large" if any(len(label) > _WIDE for label in labels.values()) else None
        return st.column_config.SelectboxColumn(
            self.label, width=width, options=labels, format_func=lambda text: labels[str(text)]
        )

    def shown(self, text: str, row: list[str]) -> str | None:
        """What a cell shows of a text that is kept."""
        number = _number(text) if self.factor is not None else None
        if number is None or self.factor is None:
            return neutral(text) or None  # the table can be saved
        return f"{number * self.factor(row):.6g}"

    def text(self, value: object, row: list[str]) -> str:
        """What is kept of what was filled into a cell."""
        text = str(value or "").strip()[:_LONGEST].replace(SEPARATOR, "-")
        number = _number(text) if self.factor is not None else None
        return text if number is None or self.factor is None else f"{number / self.factor(row):.12g}"


def _number(text: str) -> float | None:
    whole, comma, decimals = text.partition(",")  # a decimal comma; of 1,234 nobody knows
    with suppress(ValueError):
        number = float(f"{whole}.{decimals}" if comma and len(decimals) != len("234") else text)
        return number if math.isfinite(number) else None
    return None


def parts_of(text: str, n: int) -> list[str]:
    """The ``n`` fields of a row, of whatever a link has."""
    return [*text.split(SEPARATOR, n - 1), *[""] * n][:n]


def edit_table(
    key: str, fields: Mapping[int, Field], blank: Sequence[str], units: UnitSystem, deciding: int | None = None
) -> None:
    """Let rows, texts in session and address, be edited; a new one begins as ``blank``.

    The table keeps the rows that it began with, the browser what was edited since, until something else changes rows
    or units, or rows are deleted. Another text in a ``deciding`` place empties the rest of its row.
    """
    state, memory = st.session_state, f"{key} table"
    begun, number, before = state.get(memory, ([], 0, None))
    if f"{key} {number}" not in state or before != (state[key], units):
        rows = (parts_of(text, len(blank)) for text in state[key])
        begun, number = [parts for parts in rows if parts != [*blank]], number + 1
        state[memory] = begun, number, (list(state[key]), units)

    def take() -> None:
        edits = state[f"{key} {number}"]
        rows, anew = [*map(list, begun), *(list(blank) for _ in edits["added_rows"])], bool(edits["deleted_rows"])
        for row, cells in (*edits["edited_rows"].items(), *enumerate(edits["added_rows"], len(begun))):
            if row < len(begun) and cells.get(str(deciding), rows[row][deciding or 0]) != rows[row][deciding or 0]:
                rows[row], anew = list(blank), True
            for place in filter(lambda place: str(place) in cells, fields):  # one that decides is the first
                rows[row][place] = fields[place].text(cells[str(place)], rows[row])
        left = [parts for row, parts in enumerate(rows) if row not in edits["deleted_rows"] and parts != [*blank]]
        state[key] = [SEPARATOR.join(parts) for parts in left][: _MOST_ROWS + 1]  # of more it is told that they are
        state[memory] = begun, number, None if anew else (list(state[key]), units)

    columns = {str(place): [field.shown(row[place], row) for row in begun] for place, field in fields.items()}
    st.data_editor(
        pd.DataFrame(columns, pd.RangeIndex(1, len(begun) + 1), dtype=object),
        column_config={str(place): field.column([row[place] for row in begun]) for place, field in fields.items()},
        key=f"{key} {number}",
        num_rows="dynamic",
        on_change=take,
        placeholder="",
        hide_index=False,  # by which messages name a row
        alt=key.capitalize(),
    )


def require_few(rows: Sequence[object], name: str) -> None:
    """Raise a DataError for more rows than an address can hold."""
    refuse_if(len(rows) > _MOST_ROWS, name, f"at most {_MOST_ROWS} rows", "more", "upload a file for more")


def uploaded(content: bytes, name: str, read: Callable[[Path], T]) -> T:
    """Read an uploaded content by a function that takes a path; messages give it this name."""
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
