"""Exceptions of crashfuse, all derived from :class:`CrashfuseError`."""

import math
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from numbers import Real
from pathlib import Path
from types import UnionType
from typing import TypeVar, get_args

T = TypeVar("T")

NO_FILE, CHECK_PATH, KEEP_ONE, CORRECT_CELL = "no such file", "check the path", "keep one of them", "correct the cell"

_LONGEST = 300  # characters of one part of a message; a cell of an unknown file may have millions


def printable(text: str, most: int = _LONGEST) -> str:
    """Return text from a file as one line that a terminal can show: no control characters, limited length."""
    if len(text) <= most and text.isprintable():
        return text
    shown = "".join(
        c if c.isprintable() or unicodedata.category(c) == "Zs" else c.encode("unicode_escape").decode()
        for c in text[: most + 1]
    )
    return shown if len(shown) <= most else f"{shown[:most]}…"


class CrashfuseError(Exception):
    """Base of every error that crashfuse raises on purpose; its text is a sentence for the user."""

    def _render_traceback_(self) -> list[str]:
        return [f"{type(self).__name__}: {self}"]


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem with the data; texts are shortened and escaped, so any file content is safe to print."""

    where: str  # the file (relative to the campaign folder), upload or signal
    expected: str
    found: str
    advice: str  # how to fix it, as an instruction
    column: str | None = None
    row: int | None = None  # the header is row 1, as in a spreadsheet

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
    """Keep the first problems of each kind and summarise the rest in one, for a readable list.

    Problems are of one kind if they have the same advice in the same column of one file or of files in one folder.
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
    """The data are invalid. Holds all problems found, not only the first (exit code 1)."""

    def __init__(self, problems: Problem | Sequence[Problem]) -> None:
        self.problems = (problems,) if isinstance(problems, Problem) else tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type["DataError"], tuple[tuple[Problem, ...]]]:
        return type(self), (self.problems,)  # so that a worker process returns it intact


def refusal(
    where: str, expected: str, found: str, advice: str, column: str | None = None, row: int | None = None
) -> DataError:
    """The error of a single problem."""
    return DataError(Problem(where, expected, found, advice, column, row))


def refuse_if(
    wrong: object, where: str, expected: str, found: str, advice: str, column: str | None = None, row: int | None = None
) -> None:
    """Raise a DataError with this problem if something is wrong, such as more rows than anybody needs."""
    if wrong:
        raise refusal(where, expected, found, advice, column, row)


def require_there(path: Path, what: str) -> None:
    """Raise a DataError if nothing is at this path, where ``what`` should be."""
    refuse_if(not path.exists(), str(path), what, NO_FILE, CHECK_PATH)


def refuse_all(problems: Sequence[Problem], name: str, most: int = 20) -> None:
    """Raise a DataError with the first problems of a source and the count of the rest, if there are any."""
    if problems:
        rest = [Problem(name, "none", f"{len(problems) - most} more like these", "correct them too")]
        raise DataError([*problems[:most], *(rest if len(problems) > most else [])])


@contextmanager
def collecting(problems: list[Problem]) -> Iterator[None]:
    """Append the problems of a DataError to ``problems`` instead of raising it."""
    try:
        yield
    except DataError as error:
        problems += error.problems


class UsageError(CrashfuseError):
    """The request refers to something that does not exist, or is invalid (exit code 2)."""


def require_a(kind: type | UnionType, given: object, how: str) -> None:
    """Raise a UsageError if this is no such object; ``how`` is how to get one."""
    if not isinstance(given, kind):
        kinds = [kind] if isinstance(kind, type) else get_args(kind)
        name = "path" if Path in kinds else kinds[0].__name__
        raise UsageError(f"This takes a {name} ({how}), not {printable(repr(given), 60)}.")


def as_path(given: object, what: str) -> Path:
    """The path that is given, as text or as a path; a UsageError if it is neither. ``what`` lies there."""
    if not isinstance(given, str | Path):
        raise UsageError(f"The path of {what} is text or a pathlib.Path, not {printable(repr(given), 60)}.")
    return Path(given)


def require_number(what: str, given: object) -> None:
    """Raise a UsageError if this is no finite number: a text, a list, a truth value, NaN."""
    if not isinstance(given, Real) or isinstance(given, bool) or not math.isfinite(given):
        raise UsageError(f"{what} is a number, not {printable(repr(given), 60)}.")


def several(given: str | Iterable[T]) -> tuple[str | T, ...]:
    """What is given one by one; a single name, or whatever else is no series, alone."""
    return tuple(given) if isinstance(given, Iterable) and not isinstance(given, str) else (given,)


def one_of(kind: str, name: object, choices: Mapping[str, T]) -> T:
    """The choice of this name; a UsageError names the nearest one, and all, if there is none."""
    if isinstance(name, str) and name in choices:
        return choices[name]
    near = get_close_matches(str(name).lower(), choices, 1)
    meant = f"did you mean {near[0]}? All are" if near else "choose from"
    raise UsageError(f"There is no {kind} {printable(repr(name), 60)}; {meant} {', '.join(choices)}.")


def out_of_memory(error: BaseException) -> bool:
    """Whether an exception says that memory ran out; PyTorch has no class of its own for it."""
    says_so = any(text in str(error) for text in ("allocate memory", "out of memory"))
    return isinstance(error, MemoryError) or (isinstance(error, RuntimeError) and says_so)


OUT_OF_MEMORY = (
    "Memory ran out. Close other programs, or ask for less at once: fewer workers or CAE runs, a shorter record."
)


class NotFittedError(CrashfuseError):
    """An approach was used before it was fitted."""


class Cancelled(CrashfuseError):
    """The user stopped the computation; finished parts remain in the cache."""
