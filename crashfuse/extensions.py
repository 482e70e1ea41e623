"""Approaches and readers of other packages, found by their entry points."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import TypeVar

from crashfuse.errors import printable

T = TypeVar("T")

NO_FAULTS = (KeyboardInterrupt, GeneratorExit)
"""What the code of another package may raise that is not its fault: Ctrl-C, and the end of a generator around it."""


@dataclass(frozen=True, slots=True)
class Broken:
    """An entry point that cannot be used, and why."""

    name: str
    sentence: str


def load(group: str, kind: str, check: Callable[[str, object], T]) -> Iterator[tuple[str, T, str] | Broken]:
    """Load the entry points of a group (``crashfuse.approaches``, ``crashfuse.readers``), sorted by name.

    ``kind`` is what they are, for messages. ``check`` takes the name and the loaded object; it returns it, or raises a
    ValueError that says what is wrong with it. Yields name, checked object and the name of its package, or a Broken.
    """
    for entry in sorted(entry_points(group=group), key=lambda entry: entry.name):
        package = entry.dist.name if entry.dist is not None else entry.value.partition(".")[0]
        try:
            one: tuple[str, T, str] | Broken = entry.name, check(entry.name, entry.load()), package
        except NO_FAULTS:
            raise
        except BaseException as error:  # SystemExit, too, and what test frameworks raise
            sentence = f"The {kind} {entry.name!r} of the package {package} cannot be used: {said(error)}"
            one = Broken(entry.name, sentence)
        yield one


def said(error: BaseException) -> str:
    """An error of another package in a sentence for its authors."""
    text = printable(" ".join(str(error).split()))
    return f"{type(error).__name__}{f': {text}' if text else ''}. Tell its authors."
