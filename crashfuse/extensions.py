"""Approaches and readers of other packages, found by their entry points; each is imported when it is asked for."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import entry_points
from itertools import zip_longest
from typing import TypeVar, overload

from crashfuse.errors import printable

T = TypeVar("T")
S = TypeVar("S")

NO_FAULTS = (KeyboardInterrupt, GeneratorExit)
"""What the code of another package may raise that is not its fault: Ctrl-C, and the end of a generator around it."""


class Extended(Mapping[str, T]):
    """Ours by name, then those of other packages, each imported when its name is asked for, or all are listed.

    ``kind`` is what they are, for messages. ``check`` takes the name, the object of the entry point and its package; it
    returns what is to be used, or raises a ValueError that says what is wrong with it.
    """

    def __init__(self, ours: dict[str, T], group: str, kind: str, check: Callable[[str, object, str], T]) -> None:
        self.ours, self._kind, self._check = ours, kind, check
        self._entries = {entry.name: entry for entry in sorted(entry_points(group=group), key=lambda own: own.name)}
        self._loaded: dict[str, T] = {}
        self._broken: dict[str, str] = {}

    @property
    def declared(self) -> tuple[str, ...]:
        """All names, those of what cannot be used among them; nothing is imported."""
        return tuple(dict.fromkeys([*self.ours, *self._entries]))

    @property
    def imported(self) -> tuple[T, ...]:
        """Those of other packages that have been asked for."""
        return tuple(self._loaded.values())

    def package(self, name: str) -> str:
        """The package of one that is not ours; else empty."""
        entry = None if name in self.ours else self._entries.get(name)
        return "" if entry is None else entry.dist.name if entry.dist is not None else entry.value.partition(".")[0]

    def broken(self, name: str) -> str:
        """Why another package's cannot be used; empty if it can."""
        if name not in self.ours and name in self._entries and name not in {**self._loaded, **self._broken}:
            try:
                self._loaded[name] = self._check(name, self._entries[name].load(), self.package(name))
            except NO_FAULTS:
                raise
            except BaseException as error:  # SystemExit, too, and what test frameworks raise
                whose = f"The {self._kind} {name!r} of the package {self.package(name)}"
                self._broken[name] = f"{whose} cannot be used: {said(error)}"
        return self._broken.get(name, "")

    def mapped(self, value: Callable[[T], S]) -> Mapping[str, S]:
        """Something of each by name, looked up as it is asked for."""
        return _Mapped(self, value)

    def __getitem__(self, name: str) -> T:
        if name in self.ours:
            return self.ours[name]
        if self.broken(name):
            raise KeyError(name)
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return (name for name in self.declared if not self.broken(name))

    def __len__(self) -> int:
        return sum(1 for _ in self)


class Names(Sequence[str]):
    """Names of all, listed as late as can be; a copy is a tuple."""

    def __init__(self, of: Mapping[str, object]) -> None:
        self._of = of

    def __iter__(self) -> Iterator[str]:
        return iter(self._of)

    def __len__(self) -> int:
        return len(self._of)

    @overload
    def __getitem__(self, at: int) -> str: ...
    @overload
    def __getitem__(self, at: slice) -> tuple[str, ...]: ...
    def __getitem__(self, at: int | slice) -> str | tuple[str, ...]:
        return tuple(self)[at]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and all(ours == theirs for ours, theirs in zip_longest(self, other))

    def __hash__(self) -> int:
        return hash(tuple(self))

    def __repr__(self) -> str:
        return repr(tuple(self))

    def __reduce__(self) -> tuple[object, ...]:
        return tuple, (tuple(self),)


class _Mapped(Mapping[str, S]):
    def __init__(self, of: Mapping[str, T], value: Callable[[T], S]) -> None:
        self._of, self._value = of, value

    def __getitem__(self, name: str) -> S:
        return self._value(self._of[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._of)

    def __len__(self) -> int:
        return len(self._of)


def said(error: BaseException) -> str:
    """An error of another package in a sentence for its authors."""
    text = printable(" ".join(str(error).split()))
    return f"{type(error).__name__}{f': {text}' if text else ''}. Tell its authors."
