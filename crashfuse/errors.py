"""The one tree of exceptions: catch :class:`CrashfuseError` and you have caught them all."""

import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

_LONGEST = 300  # characters of one part of a message; a stranger's cell may have millions


def printable(text: str, most: int = _LONGEST) -> str:
    """Return text from a file as one line that a terminal can show: no control characters, not too long."""
    if len(text) <= most and text.isprintable():
        return text
    shown = "".join(
        c if c.isprintable() or unicodedata.category(c) == "Zs" else c.encode("unicode_escape").decode()
        for c in text[: most + 1]
    )
    return shown if len(shown) <= most else f"{shown[:most]}…"


class CrashfuseError(Exception):
    """Base of every error that crashfuse raises on purpose; its text is a sentence for the user."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong with the data, and what to do about it.

    Parameters
    ----------
    where : str
        The file (relative to the campaign folder), upload or signal.
    expected, found : str
        What the contract asks for and what is there instead.
    advice : str
        What to do, as an instruction.
    column, row : str, int, optional
        Where in the file; rows count the header as row 1, as a spreadsheet does.

    Whatever a file put into one of the texts, they are short and harmless to print.
    """

    where: str
    expected: str
    found: str
    advice: str
    column: str | None = None
    row: int | None = None

    def __post_init__(self) -> None:
        for part in ("where", "expected", "found", "advice", "column"):
            text = getattr(self, part)
            if text is not None:
                object.__setattr__(self, part, printable(text))

    def __str__(self) -> str:
        place = self.where
        if self.column is not None:
            place += f", column {self.column}"
        if self.row is not None:
            place += f", row {self.row}"
        return f"{place}: expected {self.expected}, found {self.found}; {self.advice}."


def shortened(problems: Sequence[Problem], most: int = 20) -> list[Problem]:
    """Keep the first problems of each kind, and count the rest in one: a list that a person can read.

    Of one kind are problems with the same advice in the same column of one file, or of the files of one folder.
    """
    kinds: dict[tuple[str, str, str], list[Problem]] = {}
    for problem in problems:
        home = problem.where.partition(",")[0].partition("/")[0]
        column = (problem.column or "").partition(" ")[0]
        kinds.setdefault((home, problem.advice, column), []).append(problem)
    listed: list[Problem] = []
    for (home, _, column), alike in kinds.items():
        listed += alike[:most]
        if len(alike) > most:
            found = f"{len(alike) - most} more like these"
            listed.append(Problem(home, alike[0].expected, found, "correct them too", column or None))
    return listed


class DataError(CrashfuseError):
    """The data are wrong. Holds every problem that was found, not only the first (exit code 1)."""

    def __init__(self, problems: Problem | Sequence[Problem]) -> None:
        self.problems = (problems,) if isinstance(problems, Problem) else tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type["DataError"], tuple[tuple[Problem, ...]]]:
        return type(self), (self.problems,)  # a worker process hands it back whole


@contextmanager
def collecting(problems: list[Problem]) -> Iterator[None]:
    """Append what is wrong with the data to ``problems`` instead of raising it."""
    try:
        yield
    except DataError as error:
        problems += error.problems


class UsageError(CrashfuseError):
    """What was asked for does not exist or makes no sense (exit code 2)."""


class NotFittedError(CrashfuseError):
    """A prediction was asked of an approach that has not been fitted."""


class Cancelled(CrashfuseError):
    """The user stopped the computation; nothing was lost, finished parts stay in the cache."""
