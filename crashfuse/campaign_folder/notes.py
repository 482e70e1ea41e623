"""Notes on tests, and marks in time on their figures: ``notes.csv`` of a campaign folder.

They are shown, drawn and reported as text; nothing is computed from them: they are no part of the fingerprint.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from crashfuse import errors
from crashfuse.campaign_folder.condition_tables import TABLES, listed
from crashfuse.campaign_folder.history import taking_turns
from crashfuse.errors import DataError, Problem, UsageError, as_path, printable, refusal, require_a, several
from crashfuse.files.atomic import replacing
from crashfuse.files.csv_text import csv_text, read_rows

FILE = "notes.csv"
COLUMNS = ("test", "start_ms", "end_ms", "text")
LONGEST_TEXT = 500  # characters
MOST = 500
LATEST_MS = 100.0  # pulses are shown until then
_ADVICE = f"correct it, or take {FILE} out of the folder"


@dataclass(frozen=True, slots=True)
class Note:
    """A note on a test; with a start, a mark on its figures over time at that moment, or from there to an end.

    A UsageError refuses no text, one that is too long, and times that are not in order within 0 to 100 ms.
    """

    test: str  # its id
    text: str  # at most 500 characters; runs of white space become single spaces
    start_ms: float | None = None
    end_ms: float | None = None

    def __post_init__(self) -> None:
        require_a(str, self.test, "the id of a test")
        require_a(str, self.text, "the text of the note")
        object.__setattr__(self, "text", printable(" ".join(self.text.split()), 10 * LONGEST_TEXT))
        if not self.text:
            raise UsageError("A note needs a text.")
        if len(self.text) > LONGEST_TEXT:
            raise UsageError(f"A note has at most {LONGEST_TEXT} characters, not {len(self.text)}.")
        start, end = self.start_ms, self.end_ms
        for name in ("start_ms", "end_ms"):
            if getattr(self, name) is not None:
                errors.require_number(name, getattr(self, name))
        if start is None and end is not None:
            raise UsageError("A mark that has an end needs a start.")
        if start is not None and not 0 <= start <= (LATEST_MS if end is None else end) <= LATEST_MS:
            raise UsageError(f"A mark lies between 0 and {LATEST_MS:g} ms, its start before its end.")

    @property
    def when(self) -> str:
        """The time in words; empty for a note on the test as a whole."""
        if self.start_ms is None:
            return ""
        return f"{self.start_ms:g} ms" if self.end_ms is None else f"{self.start_ms:g}–{self.end_ms:g} ms"


def read_notes(folder: str | Path) -> tuple[Note, ...]:
    """The notes in a campaign folder, in order; none without a ``notes.csv``; a DataError if that is no such table."""
    path = as_path(folder, "a campaign folder") / FILE
    return _read(path) if path.exists() else ()


def write_notes(folder: str | Path, notes: Sequence[Note]) -> None:
    """Write ``notes.csv`` in place of the one there, or take that away if there are none; see :func:`change_notes`."""
    change_notes(folder, lambda _: notes)


def change_notes(folder: str | Path, change: Callable[[tuple[Note, ...]], Sequence[Note]]) -> None:
    """Change the notes that are there to others, while nobody else does; a DataError changes nothing.

    It is one if the old or new file cannot be read, or the old one has other columns, which would be lost.
    """
    path = as_path(folder, "a campaign folder") / FILE
    with taking_turns(path.parent):
        notes = change(_read(path, alone=True) if path.exists() else ())
        for note in several(notes):
            require_a(Note, note, "crashfuse.Note(test, text)")
        if not notes:
            path.unlink(missing_ok=True)
            return
        ends = [["" if end is None else float(f"{end:.6g}") for end in (note.start_ms, note.end_ms)] for note in notes]
        rows = [(note.test, *times, note.text) for note, times in zip(notes, ends, strict=True)]
        with replacing(path, path.with_name(TABLES[0])) as temporary:
            temporary.write_bytes(csv_text([COLUMNS, *rows]).encode())
            _read(temporary)


def _read(path: Path, *, alone: bool = False) -> tuple[Note, ...]:
    names, rows, numbers = read_rows(path, FILE)
    expected = f"the columns {', '.join(COLUMNS)}"
    if missing := [name for name in COLUMNS if name not in names]:
        raise refusal(FILE, expected, f"none named {missing[0]}", _ADVICE)
    if alone and (others := [name or "one without a name" for name in names if name not in COLUMNS]):
        raise refusal(FILE, f"{expected} alone", f"{listed(others)}, which would be lost", "take them out")
    errors.refuse_if(len(rows) > MOST, FILE, f"at most {MOST} notes", f"{len(rows)}", "take some out")
    notes, problems = [], []
    for row, number in zip(rows, numbers, strict=True):
        test, start, end, text = (row[names.index(name)] for name in COLUMNS)
        try:
            times = [float(cell) if cell.strip() else None for cell in (start, end)]
            notes.append(Note(test.strip(), text, *times))
        except (UsageError, ValueError) as error:
            expected = str(error) if isinstance(error, UsageError) else "times in ms, or nothing"
            found = printable(", ".join((test, start, end, text)), 80)
            problems.append(Problem(FILE, expected.rstrip("."), found, _ADVICE, row=number))
    if problems:
        raise DataError(errors.shortened(problems))
    return tuple(notes)
